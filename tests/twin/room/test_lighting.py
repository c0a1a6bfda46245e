"""The room's light over time: lamps going off, clouds, flicker; a function of time alone."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_rooms import room_of, scenario_in

from trackers.errors import InputError
from twin.report.scene_pictures import fill_light
from twin.room.mjcf import Lighting, light_of
from twin.scenario import load_scenario
from twin.scenario.scenario import LightChange
from twin.view.contact_sheet import drawn_view
from twin.world.simulation import Simulation

ROOM = """
<mujoco>
  <visual><headlight active="1" diffuse="0.5 0.5 0.5"/></visual>
  <worldbody>
    <light name="lamp" type="directional" diffuse="0.4 0.3 0.2" ambient="0.1 0.1 0.1"/>
    <light name="sun" type="directional" diffuse="0.8 0.8 0.8"/>
  </worldbody>
</mujoco>
"""


def lighting(*changes: dict) -> tuple[Lighting, mujoco.MjModel]:
    model = mujoco.MjModel.from_xml_string(ROOM)
    return Lighting(model, [LightChange.model_validate(change) for change in changes], "scenario 'x'"), model


def test_a_lamp_goes_off_and_on_again():
    lit, model = lighting({"at_s": 2, "name": "lamp", "brightness": 0}, {"at_s": 5, "name": "lamp", "brightness": 1})
    before = model.light_diffuse.copy()
    for t, lamp in ((0, 1), (1.999, 1), (2, 0), (4, 0), (5, 1), (9, 1), (3, 0)):
        lit.apply(t)
        np.testing.assert_allclose(model.light_diffuse[0], lamp * before[0])
        np.testing.assert_allclose(model.light_diffuse[1], before[1])
    assert model.light_ambient[0].max() == 0


def test_a_cloud_comes_slowly_and_may_be_overtaken():
    lit, _ = lighting(
        {"at_s": 1, "name": "sun", "brightness": 0.5, "over_s": 2},
        {"at_s": 2, "name": "sun", "brightness": 1, "over_s": 1},
    )
    sun = [lit.factors(t)[1] for t in (0, 1, 1.5, 2, 2.5, 3, 4)]
    assert sun == pytest.approx([1, 1, 0.875, 0.75, 0.875, 1, 1])


def test_what_walls_throw_back_goes_with_the_lamps_each_by_its_share():
    lit, model = lighting({"at_s": 0, "brightness": 0.25})
    lit.apply(0.0)
    np.testing.assert_allclose(model.light_diffuse[1], 0.2)
    np.testing.assert_allclose(model.vis.headlight.diffuse, 0.125)
    lamp_only, other = lighting({"at_s": 0, "name": "lamp", "brightness": 0})
    lamp_only.apply(0.0)
    np.testing.assert_allclose(other.vis.headlight.diffuse, 0.5 * 2.4 / 3.3)


def test_flicker_swings_between_full_and_its_depth_until_the_next_change():
    lit, _ = lighting(
        {"at_s": 1, "name": "lamp", "brightness": 0.8, "flicker": {"hz": 2, "depth": 0.5}},
        {"at_s": 3, "name": "lamp", "brightness": 0.8},
    )
    assert [lit.factors(t)[0] for t in (0.9, 1, 1.25, 1.5, 3.25)] == pytest.approx([1, 0.8, 0.4, 0.8, 0.8])
    many = [lit.factors(t)[0] for t in np.linspace(1, 2.99, 400)]
    assert min(many) == pytest.approx(0.4, abs=1e-3)
    assert max(many) == pytest.approx(0.8, abs=1e-3)


def test_changes_may_be_listed_in_any_order():
    first, _ = lighting({"at_s": 1, "brightness": 0.5}, {"at_s": 2, "brightness": 0.2})
    second, _ = lighting({"at_s": 2, "brightness": 0.2}, {"at_s": 1, "brightness": 0.5})
    for t in (0.5, 1.5, 2.5):
        np.testing.assert_array_equal(first.factors(t), second.factors(t))


def test_a_light_that_is_not_there_is_named():
    with pytest.raises(
        InputError,
        match=r"lights\.0\.name: the room has no light 'lmap'; did you mean 'lamp'\? valid are lamp, sun, all \(every light\)",
    ):
        lighting({"at_s": 0, "name": "lmap"})


def test_a_change_before_the_start_is_refused():
    with pytest.raises(
        InputError, match=r"lights\.0\.at_s: a number greater than or equal to 0 is expected \(got -1\)"
    ):
        load_scenario("lab-five-people", ["lights=[{at_s: -1, brightness: 0}]"])


def test_pictures_get_dark_and_light_again():
    scenario = load_scenario(
        "lab-five-people",
        [
            "people=null",
            "people.one={start: [0, 2], script: {kind: stand}}",
            "sensors={view: {kind: camera, rate_hz: 5, mount: {xyz: [0, 0.2, 1.5], yaw_deg: 90}, size: [80, 60], "
            "field_of_view_deg: 70, noise: 'off'}}",
            "lights=[{at_s: 0.3, brightness: 0.3}, {at_s: 0.7, brightness: 1}]",
            "duration_s=1",
            "background_frames=6",
        ],
    )
    with Simulation(scenario) as simulation:
        background = [each.rgb.mean() for each in simulation.background()]
        means = [each.rgb.mean() for each in simulation]
    assert np.ptp(background) < 0.5, "the empty room was seen before the light changed"
    assert means[2] < 0.6 * means[0]
    assert means[4] == pytest.approx(means[0], rel=0.02)


UNLIT = '<light name="lamp" type="directional" dir="0.3 0.4 -1" active="false"/>'


def test_a_dark_room_is_dark_to_cameras_told_and_lit_for_whoever_looks_at_it(tmp_path: Path) -> None:
    room = room_of('<geom type="box" size=".3 .3 .5" pos="0 0 .5" rgba="1 0 0 1"/>', lamp=UNLIT)
    switched_off = ['lights=[{"at_s": 0, "brightness": 0}]']
    for scenario in (scenario_in(tmp_path, room), load_scenario("home-three-people", switched_off)):
        with Simulation(scenario) as simulation:
            said = [each for each in simulation.warnings if "is dark at the start" in each]
            rgb = next(look.rgb for look in simulation.look(10**9).values() if hasattr(look, "rgb"))
        assert len(said) == 1
        assert rgb.mean() < 10
        sheet, _ = drawn_view(scenario, 1.0, (320, 240))
        assert sheet[40:270, 10:320].mean() > 30  # the first tile: the room
    with Simulation(load_scenario("home-three-people")) as simulation:
        assert not [each for each in simulation.warnings if "dark" in each]


def test_a_picture_for_people_leaves_the_lamps_as_they_were():
    _, model = lighting()
    model.light_diffuse[:] = model.vis.headlight.ambient[:] = 0.01
    before = [np.array(each) for each in (model.light_active, model.vis.headlight.ambient, model.vis.headlight.diffuse)]
    with fill_light(model):
        assert light_of(model) > 0.49
    after = (model.light_active, model.vis.headlight.ambient, model.vis.headlight.diffuse)
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)
