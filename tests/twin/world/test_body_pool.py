"""Bodies of those who have left make way for those who come, and nobody can tell from what is measured."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from trackers.configuration import validate
from trackers.errors import InputError
from twin.people import population as population_module
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.posture_rows import HISTORY_S
from twin.scenario import Scenario, load_scenario
from twin.world import body_pool, scene as scene_module
from twin.world.body_pool import body_pools
from twin.world.scene import build_scene, populate
from twin.world.simulation import Simulation
from twin.world.world import World

pytestmark = pytest.mark.slow

EVERY_S, STAY_S = 2.0, 5.0
SENSORS = {
    "low": {
        "kind": "laser", "rate_hz": 4, "sweep_time_s": 0.08, "delay_s": 0.3, "mount": {"xyz": [0, -1, 0.4]},
    },
    "camera": {
        "kind": "camera", "rate_hz": 1, "size": [40, 30], "vertical_field_of_view_deg": 70,
        "mount": {"xyz": [0, -4, 2], "yaw_deg": 90},
    },
}  # fmt: skip


def one_after_another(count: int, sensors: tuple[str, ...] = ("low",), **others: Any) -> Scenario:
    """People who cross the plaza, one every EVERY_S; and whoever else is there."""
    people = {
        f"p{number:03d}": {
            "script": {
                "kind": "path",
                "points": [
                    [EVERY_S * number + t, -3.0 + 1.2 * t, 1.0 + 0.5 * (number % 4)]
                    for t in (0.0, 0.5 * STAY_S, STAY_S)
                ],
            }
        }
        for number in range(count)
    }
    content = {
        "name": "crossing",
        "room": "plaza",
        "duration_s": EVERY_S * count,
        "background": "none",
        "people": people | others,
        "sensors": {name: SENSORS[name] for name in sensors},
    }
    return validate(Scenario, content, "test")


def test_as_many_bodies_as_people_at_once_not_as_ever_come() -> None:
    few, many = (body_pools(one_after_another(count).people) for count in (20, 400))
    assert len(few) == 1
    assert max(len(pool.names) for pool in many) <= 32
    assert sum(len(pool.names) for pool in many) < 2 * 400


def test_whoever_is_in_the_room_or_was_just_now_has_a_body(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(body_pool, "_LEAST", 2)
    scenario = one_after_another(20, zoe={"start": [3, -3], "arrive_s": 7.0})
    world = World(scenario)
    series = body_pools(scenario.people)
    assert len(series) > 2
    for t in np.arange(0.0, scenario.duration_s, 0.25).tolist():
        world.population.advance(t)
        present = {name for name, there in zip(world.scene.names, world.population.present(t), strict=True) if there}
        covering = [set(pool.names) for pool in series if pool.covers(t)]
        assert covering
        assert all(present <= names for names in covering)
    assert all("zoe" in pool.names for pool in series)
    first, second = series[:2]
    assert not second.covers(second.from_s - 1.01 * HISTORY_S)
    assert first.until_s == second.from_s


def test_nobody_can_tell_that_bodies_were_handed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = one_after_another(
        5,
        ("low", "camera"),
        ann={"start": [2, -2], "script": [{"kind": "look", "at": "p003", "for_s": 9}, {"kind": "bend"}]},
    )

    def measured() -> tuple[list[Any], set[int]]:
        seen: list[Any] = []
        bodies = set()
        with Simulation(scenario, on_truth=seen.append, on_detail=seen.append) as simulation:
            for delivered in simulation.deliveries():
                observation = delivered.encoded.observation
                seen.append(np.asarray(getattr(observation, "rgb", getattr(observation, "ranges_m", None))).tobytes())
                bodies.add(simulation.world.scene.model.nbody)
        return seen, bodies

    together, most = measured()
    monkeypatch.setattr(body_pool, "_LEAST", 2)
    by_turns, fewer = measured()
    assert len(most) == 1
    assert len(fewer) > 1
    assert min(fewer) < min(most)
    assert by_turns == together


def test_a_body_measures_the_same_alone_and_in_a_room() -> None:
    scene = build_scene(load_scenario("lab-five-people"))
    in_room = BodyMeasures.in_room(scene.model, scene.appearances, scene.names)
    alone = BodyMeasures.in_room(scene.model, scene.appearances, ())
    for name, values in vars(in_room).items():
        np.testing.assert_array_equal(values, getattr(alone, name), name)


def test_bodies_attached_in_groups_give_the_model_of_bodies_attached_one_by_one(monkeypatch) -> None:
    people = "{" + ", ".join(f"{name}: {{}}" for name in ("a", "ab", "b1", "b2", "b3", "z")) + "}"
    scenario = load_scenario("lab-five-people", [f"people={people}"])

    def model(together: int) -> bytes:
        monkeypatch.setattr(body_pool, "_MOST_TOGETHER", together)
        built = build_scene(scenario).model
        content = np.empty(mujoco.mj_sizeModel(built), np.uint8)
        mujoco.mj_saveModel(built, None, content)
        return content.tobytes()

    assert model(1) == model(2) == model(20)


def test_more_people_than_have_a_place_are_refused_before_a_body_is_made(monkeypatch) -> None:
    people = "{" + ", ".join(f"p{number}: {{}}" for number in range(400)) + "}"
    scenario = load_scenario("lab-five-people", [f"people={people}"])
    monkeypatch.setattr(body_pool.Bodies, "in_room", lambda *_, **__: pytest.fail("bodies were made"))
    with pytest.raises(InputError, match=r"fewer people than 400, or a larger area, are expected"):
        build_scene(scenario)


@pytest.mark.parametrize("name", ["everyday", "home-three-people", "lab-five-people", "library-hall"])
def test_starts_are_checked_by_the_draws_by_which_people_start(name, monkeypatch) -> None:
    drawn = []
    kept = scene_module.start_places, population_module.start_places

    def noting(which):
        return lambda *arguments: drawn.append(kept[which](*arguments)) or drawn[-1]

    monkeypatch.setattr(scene_module, "start_places", noting(0))
    monkeypatch.setattr(population_module, "start_places", noting(1))
    scenario = load_scenario(name, ["duration_s=1"])
    populate(scenario, build_scene(scenario))
    assert len(drawn) >= 1
    np.testing.assert_array_equal(drawn[0], drawn[-1])
