"""The pinhole camera: things are drawn where they project, by any principal point, distortion and shutter."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from capsule_room import CapsuleWorld, capsule_model
from numpy.typing import NDArray
from pydantic import TypeAdapter

from trackers.rig import PinholeSensor
from twin.scenario.camera_descriptions import PinholeDescription
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.pinhole import pinhole_view
from twin.sensors.render import OffscreenRenderer, RendererOnDemand

MOUNT = {"xyz": [0.3, 0.2, 1.2], "yaw_deg": 80, "pitch_deg": 5, "roll_deg": 4}
_BALLS = {
    (0.4, 3.0, 1.3): "1 0 0",
    (-0.9, 3.0, 1.9): "0 1 0",
    (1.6, 3.0, 0.5): "0 0 1",
}
_DARK_ROOM = """
<mujoco>
  <statistic extent="8" center="0 2 1"/>
  <visual><headlight active="0"/><quality numslices="40" numstacks="30"/><map znear="0.005" zfar="10"/></visual>
  <worldbody/>
</mujoco>
"""


def describe(**changes: object) -> PinholeDescription:
    content = {"kind": "camera", "mount": MOUNT, "rate_hz": 10, "noise": "off", "size": [200, 150], "fx": 130.0}
    described = TypeAdapter(SensorDescription).validate_python(content | changes)
    assert isinstance(described, PinholeDescription)
    return described


def balls_in_the_dark() -> CapsuleWorld:
    """Glowing balls at known places and nothing else."""
    spec = mujoco.MjSpec.from_string(_DARK_ROOM)
    for number, (place, colour) in enumerate(_BALLS.items()):
        rgba = [*map(float, colour.split()), 1.0]
        spec.add_material(name=f"glow{number}", rgba=rgba, emission=1)
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=place, size=[0.06, 0, 0], material=f"glow{number}"
        )
    return CapsuleWorld(spec.compile())


def picture(world: CapsuleWorld, camera: PinholeDescription, t: float = 0.0) -> NDArray[np.uint8]:
    with RendererOnDemand(world.model) as renderer:
        sensor = build_sensor("camera", camera, renderer)
        snapshots = (world.snapshot(t + offset) for offset in sensor.instants_s)
        reading, _ = sensor.observe(0, snapshots, None, np.random.default_rng(0))
    return reading.observation.rgb


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"cx": 120.5, "cy": 90.0, "fy": 100.0},
        {"distortion": {"k1": -0.3, "k2": 0.08, "p1": 0.004, "p2": -0.003}},
        {"distortion": {"k1": 0.15, "k3": 0.05}, "cx": 110.0},
    ],
    ids=["plain", "off-axis", "barrel", "pincushion"],
)
def test_what_is_drawn_lies_where_it_projects(changes: dict):
    camera = describe(**changes)
    rgb = picture(balls_in_the_dark(), camera).astype(float)
    rig = camera.rig_sensor("camera")
    pose = rig.room_from_sensor
    places = (np.array(list(_BALLS)) - pose.translation) @ pose.rotation
    pixels, seen = rig.intrinsics.project(places)
    assert seen.all()
    for (u, v), colour in zip(pixels, _BALLS.values(), strict=True):
        weight = rgb[..., colour.split().index("1")]
        weight = np.where(weight > 60, weight, 0)
        rows, columns = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
        assert np.average(columns, weights=weight) == pytest.approx(u, abs=0.3)
        assert np.average(rows, weights=weight) == pytest.approx(v, abs=0.3)


def test_an_off_axis_picture_is_a_part_of_a_larger_one():
    world = CapsuleWorld(capsule_model())
    whole = picture(world, describe())
    part = picture(world, describe(size=[120, 90], cx=99.5 - 30, cy=74.5 - 20))
    difference = np.abs(part.astype(int) - whole[20:110, 30:150])  # another frustum rounds a few edges otherwise
    assert (difference.max(axis=2) > 1).mean() < 1e-3


def test_without_distortion_nothing_is_remapped():
    rig = describe().rig_sensor("camera")
    view = pinhole_view(rig.intrinsics, rig.room_from_sensor)
    assert view.maps is None
    assert (view.width, view.height) == (200, 150)
    bent = describe(distortion={"k1": -0.1}).rig_sensor("camera")
    wide = pinhole_view(bent.intrinsics, bent.room_from_sensor)
    assert wide.maps is not None
    assert wide.width > 200


def test_almost_no_distortion_is_almost_the_plain_picture():
    world = CapsuleWorld(capsule_model())
    plain = picture(world, describe()).astype(int)
    bent = picture(world, describe(distortion={"k1": 1e-7})).astype(int)
    assert np.abs(plain - bent).mean() < 1.5


def test_motion_blur_is_the_mean_of_its_instants():
    world = CapsuleWorld(capsule_model(), speed=3.0)
    camera = describe(motion_blur={"exposure_s": 0.04, "instants": 4})
    assert camera.instants_s == pytest.approx((0.005, 0.015, 0.025, 0.035))
    blurred = picture(world, camera, t=0.1).astype(float)
    sharp = [picture(world, describe(), t=0.1 + offset).astype(float) for offset in camera.instants_s]
    assert np.abs(blurred - np.mean(sharp, axis=0)).max() <= 1
    assert np.abs(blurred - sharp[0]).max() > 40
    still = CapsuleWorld(capsule_model(), speed=0)
    assert np.abs(picture(still, camera).astype(int) - picture(still, describe())).max() <= 1


def test_exposure_and_white_balance_scale_the_light():
    world = CapsuleWorld(capsule_model())
    plain = picture(world, describe()).astype(float)
    darker = picture(world, describe(exposure=0.5)).astype(float)
    assert np.abs(darker - 0.5 * plain).max() <= 0.5
    warm = picture(world, describe(white_balance=[1.2, 1.0, 0.5])).astype(float)
    assert np.abs(warm - np.minimum(plain * [1.2, 1.0, 0.5], 255)).max() <= 0.5


def test_noise_is_amplified_by_the_white_balance():
    world = CapsuleWorld(capsule_model({}))
    noisy = {"noise": {"read_sigma": 3.0}, "exposure": 0.4}
    plain = picture(world, describe(**noisy)).astype(float) - picture(world, describe(exposure=0.4))
    red = picture(world, describe(**noisy, white_balance=[2.0, 1, 1])).astype(float)
    red -= picture(world, describe(exposure=0.4, white_balance=[2.0, 1, 1]))
    assert red[..., 0].std() == pytest.approx(2 * plain[..., 0].std(), rel=0.1)
    assert red[..., 1].std() == pytest.approx(plain[..., 1].std(), rel=0.1)


def test_colour_depth_and_numbers_share_one_scene_update(monkeypatch: pytest.MonkeyPatch):
    world = CapsuleWorld(capsule_model())
    snapshot = world.snapshot(0.0)
    rig = describe().rig_sensor("camera")
    view = pinhole_view(rig.intrinsics, rig.room_from_sensor).view
    out = np.zeros((150, 200, 4), dtype=np.uint8)
    numbers = np.zeros_like(out)
    depth = np.zeros((150, 200), dtype=np.float32)
    updates = []
    update: Callable = mujoco.mjv_updateScene
    monkeypatch.setattr(mujoco, "mjv_updateScene", lambda *arguments: (updates.append(1), update(*arguments)))
    with OffscreenRenderer(world.model) as renderer:
        geoms = renderer.render(
            snapshot.data, rig.room_from_sensor.translation, [view], out, depth=depth, numbers=numbers
        )
    assert len(updates) == 1
    assert out.any()
    assert depth.min() > 0
    shown = geoms[np.ascontiguousarray(numbers).view("<u4")[..., 0] & 0xFFFFFF]
    assert (snapshot.person_of_geom[shown[shown >= 0]] > 0).any()


def test_samples_soften_colours_and_leave_depth_and_numbers_as_they_are():
    world = CapsuleWorld(capsule_model())
    rig = describe().rig_sensor("camera")
    view = pinhole_view(rig.intrinsics, rig.room_from_sensor).view
    drawn = []
    for samples in (0, 4):
        out, numbers = np.zeros((2, 150, 200, 4), dtype=np.uint8)
        depth = np.zeros((150, 200), dtype=np.float32)
        with OffscreenRenderer(world.model, samples=samples) as renderer:
            eye_m = rig.room_from_sensor.translation
            renderer.render(world.snapshot(0.0).data, eye_m, [view], out, depth=depth, numbers=numbers)
        drawn.append((out, depth, numbers))
    (plain, depth, numbers), (soft, soft_depth, soft_numbers) = drawn
    np.testing.assert_array_equal(depth, soft_depth)
    np.testing.assert_array_equal(numbers, soft_numbers)
    assert 0 < (plain != soft).any(axis=-1).mean() < 0.2, "edges alone"


def test_another_models_renderer_is_refused():
    world, other = CapsuleWorld(capsule_model()), capsule_model({})
    with RendererOnDemand(other) as renderer:
        sensor = build_sensor("camera", describe(), renderer)
        with pytest.raises(ValueError, match="another model"):
            sensor.observe(0, [world.snapshot(0.0)], None, np.random.default_rng(0))


def test_the_rig_tells_how_it_projects():
    rig = describe(distortion={"k1": -0.1, "p2": 0.01}).rig_sensor("hall")
    assert isinstance(rig, PinholeSensor)
    assert rig.topic == "/hall/image/compressed"
    assert rig.intrinsics.distortion == (-0.1, 0.0, 0.0, 0.01, 0.0)
