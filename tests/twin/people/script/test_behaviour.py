"""What people are told to do is what their bodies do, in a furnished room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest

from trackers.configuration import validate
from twin.people.body.person_spec import JOINTS
from twin.people.posture.postures import Postures
from twin.scenario import Scenario
from twin.truth.truth_types import FootTruth, PersonTruth
from twin.world.world import World

DT = 0.1
SENSORS = {"floor": {"kind": "floor", "mount": {"xyz": [-1.8, -1.4, 0]}}}


def scenario(
    people: dict[str, Any], duration_s: float = 30.0, room: str = "sensing_room", seed: int = 1000
) -> Scenario:
    content = {
        "name": "test", "room": room, "duration_s": duration_s, "seed": seed, "people": people, "sensors": SENSORS,
    }  # fmt: skip
    return validate(Scenario, content, "test")


def act(*script: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"start": [0.0, 0.0], "heading_deg": 0.0, "height_m": 1.75, "script": list(script)} | more


@dataclass
class Moment:
    """One person at one time."""

    t: float
    truth: PersonTruth
    doing: str

    @property
    def place(self) -> np.ndarray:
        return np.array([self.truth.x, self.truth.y])

    @property
    def feet(self) -> tuple[FootTruth, ...]:
        return self.truth.feet

    @property
    def load(self) -> float:
        return sum(foot.load_n for foot in self.feet)


def watch(world: World, seconds: float, name: str = "anna") -> Iterator[Moment]:
    """The person named at every `DT`, while they are there."""
    number = world.scene.ids[name]
    for k in range(int(seconds / DT)):
        frame = world.truth(round(k * DT * 1e9), {})
        action = doing(world, name)
        yield from (Moment(k * DT, person, action) for person in frame.people if person.id == number)


def moments(people: dict[str, Any], seconds: float, name: str = "anna", **more: Any) -> list[Moment]:
    return list(watch(World(scenario(people, seconds + 1, **more)), seconds, name))


def doing(world: World, name: str) -> str:
    """What somebody is at now."""
    return world.population.doing[world.population.names.index(name)]


def weight_of(run: list[Moment]) -> float:
    """The weight of somebody who stands at the start [N]."""
    return float(np.mean([moment.load for moment in run[:3]]))


def apart(one: float, other: float) -> float:
    return abs((one - other + np.pi) % (2 * np.pi) - np.pi)


def test_walks_end_at_their_last_waypoint() -> None:
    run = moments({"anna": act({"kind": "walk", "waypoints": [[0.5, 0.5], [-0.8, -0.5]]})}, 8)
    np.testing.assert_allclose(run[-1].place, [-0.8, -0.5], atol=0.12)
    assert np.hypot(run[-1].truth.vx, run[-1].truth.vy) < 0.02
    assert min(np.linalg.norm(moment.place - [0.5, 0.5]) for moment in run) < 0.3


def test_a_walk_with_a_face_goes_sideways_and_backwards() -> None:
    script = {"kind": "walk", "waypoints": [[-1.0, 0.0]], "face": [1.5, 0.0], "speed_m_s": 0.7}
    run = moments({"anna": act(script)}, 5)
    assert run[-1].place[0] < -0.8
    assert max(apart(moment.truth.yaw, 0.0) for moment in run) < 0.35


def test_runners_run() -> None:
    script = {"kind": "run", "waypoints": [[12.0, 0.0]], "speed_m_s": 3.5}
    run = moments({"anna": act(script)}, 4, room="plaza")
    assert max(np.hypot(moment.truth.vx, moment.truth.vy) for moment in run) == pytest.approx(3.5, rel=0.1)
    assert any(moment.load == 0 for moment in run)
    assert max(moment.load for moment in run) > 1.9 * weight_of(run)


@pytest.mark.parametrize(
    ("turn", "heading_deg"), [({"to_deg": 120}, 120), ({"by_deg": -200}, 160), ({"towards": [0.0, -1.0]}, -90)]
)
def test_turns_end_where_they_should(turn: dict[str, Any], heading_deg: float) -> None:
    run = moments({"anna": act({"kind": "turn"} | turn)}, 7)
    assert apart(run[-1].truth.yaw, np.deg2rad(heading_deg)) < 0.15
    assert max(np.linalg.norm(moment.place) for moment in run) < 0.15


def test_a_turn_by_more_than_half_a_circle_goes_the_way_it_says() -> None:
    run = moments({"anna": act({"kind": "turn", "by_deg": -200})}, 7)
    turned = np.unwrap([moment.truth.yaw for moment in run])
    assert turned.max() < 0.3
    assert turned[-1] == pytest.approx(np.deg2rad(-200), abs=0.15)


def test_who_sits_is_on_the_seat_and_shares_the_weight_with_it() -> None:
    script = [{"kind": "sit", "seat": "chair_left", "for_s": 4}, {"kind": "walk", "waypoints": [[0.0, 0.0]]}]
    run = moments({"anna": act(*script)}, 16)
    sits = [moment for moment in run if moment.doing == "sit"]
    seated = [moment for moment in sits if np.hypot(moment.truth.vx, moment.truth.vy) < 1e-3 and moment.truth.z < 0.65]
    assert len(seated) * DT >= 3.0
    for moment in seated[5:-10]:  # at the end the feet are loaded to rise
        np.testing.assert_allclose(moment.place, [1.22, 0.28], atol=0.15)
        assert 0.15 <= moment.load / weight_of(run) <= 0.25
    assert run[-1].truth.z > 0.85
    np.testing.assert_allclose(run[-1].place, [0.0, 0.0], atol=0.15)
    # the centre of mass rises and falls, but nothing is lost on average
    assert max(moment.load for moment in run) < 1.4 * weight_of(run)


def test_who_is_kept_from_the_last_steps_to_a_seat_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def sits_at_s() -> float:
        sits = scenario({"anna": act({"kind": "sit", "seat": "chair_left", "for_s": 4})})
        return next(moment.t for moment in watch(World(sits), 20) if moment.truth.z < 0.65)

    usual_s = sits_at_s()
    stands_near, kept = Postures.stands_near, iter([True])
    monkeypatch.setattr(Postures, "stands_near", lambda *given: not next(kept, False) and stands_near(*given))
    assert usual_s + 1 < sits_at_s() < usual_s + 8


def test_who_lies_is_off_the_floor_and_gets_up_again() -> None:
    script = [{"kind": "lie", "bed": "bed", "for_s": 3}, {"kind": "stand"}]
    run = moments({"anna": act(*script)}, 26)
    lies = [moment for moment in run if moment.load == 0]
    assert len(lies) * DT >= 3.0
    assert all(moment.truth.head_z < 1.45 for moment in lies)
    flat = [moment for moment in lies if moment.truth.head_z < 0.8]
    assert len(flat) * DT >= 3.0
    assert max(moment.truth.z for moment in flat) < 0.75
    assert run[-1].doing == "stand"
    assert run[-1].load == pytest.approx(weight_of(run), rel=0.02)


def test_the_velocity_is_that_of_the_pelvis_in_postures_too() -> None:
    run = moments({"anna": act({"kind": "sit", "seat": "chair_left", "for_s": 2}, {"kind": "stand"})}, 14)
    places = np.array([moment.place for moment in run])
    measured = (places[2:] - places[:-2]) / (2 * DT)
    told = np.array([(moment.truth.vx, moment.truth.vy) for moment in run])[1:-1]
    assert np.abs(told - measured).mean() < 0.03
    sits = np.array([moment.truth.z for moment in run])[1:-1] < 0.85
    assert np.abs(told[sits]).max() > 0.15
    assert np.abs(told - measured)[sits].max() < 0.12


def test_bending_brings_the_head_down_and_forward() -> None:
    run = moments({"anna": act({"kind": "bend", "angle_deg": 80, "for_s": 1.0}, {"kind": "stand"})}, 6)
    lowest = min(run, key=lambda moment: moment.truth.head_z)
    assert lowest.truth.head_z < 1.25
    assert lowest.truth.head_x - lowest.truth.x > 0.35
    assert run[-1].truth.head_z == pytest.approx(run[0].truth.head_z, abs=0.02)


def test_reaching_touches_the_point() -> None:
    world = World(scenario({"anna": act({"kind": "reach", "point": [0.55, 0.2, 1.2], "for_s": 2.0})}))
    hand = world.scene.model.geom("anna/left_hand").id
    gaps = []
    for moment in watch(world, 3.0):
        if moment.doing == "reach":
            gaps.append(np.linalg.norm(world.data.geom_xpos[hand] - [0.55, 0.2, 1.2]))
    assert min(gaps) < 0.06


def test_looks_follow_somebody_who_walks() -> None:
    people = {
        "anna": act({"kind": "look", "at": "ben"}, start=[-1.0, 0.0]),
        "ben": act({"kind": "walk", "waypoints": [[0.6, 0.8]], "speed_m_s": 0.8}, start=[0.6, -0.9]),
    }
    world = World(scenario(people))
    anna, ben = world.scene.ids["anna"], world.scene.ids["ben"]
    errors = []
    for k in range(15, 35):
        frame = {person.id: person for person in world.truth(round(k * DT * 1e9), {}).people}
        bearing = np.arctan2(frame[ben].head_y - frame[anna].head_y, frame[ben].head_x - frame[anna].head_x)
        errors.append(apart(frame[anna].head_yaw, bearing))
    assert max(errors) < 0.12


def test_a_head_turned_by_an_angle_is_free_again_after_its_time() -> None:
    run = moments({"anna": act({"kind": "look", "yaw_deg": 60, "for_s": 2.0}, {"kind": "stand"})}, 9)
    turned = [apart(moment.truth.head_yaw, moment.truth.yaw) for moment in run]
    assert max(turned[10:20]) == pytest.approx(np.deg2rad(60), abs=0.1)
    assert min(turned[40:]) < 0.5


def test_followers_keep_their_distance() -> None:
    people = {
        "anna": act({"kind": "follow", "person": "ben", "distance_m": 1.5}, start=[-8.0, 0.0]),
        "ben": act({"kind": "walk", "waypoints": [[6.0, 0.0], [6.0, 8.0]], "speed_m_s": 1.1}, start=[-5.0, 0.0]),
    }
    world = World(scenario(people, room="plaza"))
    gaps = []
    for k in range(80, 150):
        frame = {person.id: person for person in world.truth(round(k * DT * 1e9), {}).people}
        gaps.append(np.hypot(frame[1].x - frame[2].x, frame[1].y - frame[2].y))
    assert min(gaps) > 1.0
    assert max(gaps) < 2.4


def level_with(people: dict[str, Any], seconds: float, room: str) -> np.ndarray:
    """Of ben, as anna sees him at every `DT`: how far ahead of her he is, how far to her left, and their distance [m]."""
    world = World(scenario(people, room=room))
    rows = []
    for k in range(int(seconds / DT)):
        frame = {person.id: person for person in world.truth(round(k * DT * 1e9), {}).people}
        anna, ben = frame[world.scene.ids["anna"]], frame[world.scene.ids["ben"]]
        from_anna = complex(ben.x - anna.x, ben.y - anna.y) * np.exp(-1j * anna.yaw)
        rows.append((from_anna.real, from_anna.imag, abs(from_anna)))
    return np.array(rows)


def abreast(side: str, start: list[float], way: list[list[float]], **more: Any) -> dict[str, Any]:
    """Anna walks a way, and ben beside her."""
    return {
        "anna": act({"kind": "walk", "waypoints": way, "speed_m_s": 1.1}, start=start),
        "ben": act({"kind": "follow", "person": "anna", "beside": side}, start=[start[0], start[1] - 1.2]),
    } | more


def test_companions_walk_abreast_and_stand_abreast() -> None:
    ahead, left, apart_m = level_with(abreast("right", [-6.0, 0.0], [[3.0, 0.0]]), 13, "plaza").T
    walking = slice(30, 80)
    assert np.abs(ahead[walking]).max() < 0.2
    assert -0.85 < left[walking].min() <= left[walking].max() < -0.6
    assert apart_m.min() > 0.6
    assert apart_m[-10:].max() < 0.9


def test_a_companion_falls_behind_before_who_comes_their_way() -> None:
    towards = act({"kind": "walk", "waypoints": [[-7.0, -0.7]]}, start=[5.0, -0.7], heading_deg=180.0)
    ahead, left, _ = level_with(abreast("right", [-6.0, 0.0], [[8.0, 0.0]], cleo=towards), 14, "plaza").T
    behind = ahead < -0.5
    assert behind[20:70].any()
    assert np.abs(left[behind]).min() < 0.4
    assert ahead[-10:].min() > -0.5  # and has drawn level again


def test_a_companion_falls_behind_where_there_is_no_room() -> None:
    # into a passage whose wall leaves nobody room on her left
    ahead, _, _ = level_with(abreast("left", [-9.0, -0.6], [[-13.9, -0.6]]), 5, "library_hall").T
    assert ahead[20:25].min() > -0.4
    assert ahead[-8:].max() < -0.5


def test_who_meet_stand_face_to_face_and_part() -> None:
    script = [{"kind": "meet", "person": "ben", "for_s": 3.0}, {"kind": "walk", "waypoints": [[-1.0, -0.5]]}]
    people = {
        "anna": act(*script, start=[-1.0, -0.5]),
        "ben": act({"kind": "stand"}, start=[0.7, -0.4], heading_deg=180.0),
    }
    run = moments(people, 12)
    near = [moment for moment in run if np.hypot(moment.truth.x - 0.7, moment.truth.y + 0.4) < 1.15]
    assert len(near) * DT >= 3.0
    faces = [apart(moment.truth.yaw, np.arctan2(-0.4 - moment.truth.y, 0.7 - moment.truth.x)) for moment in near[10:25]]
    assert max(faces) < 0.25
    np.testing.assert_allclose(run[-1].place, [-1.0, -0.5], atol=0.15)


def test_who_only_stands_turns_to_who_meets_them() -> None:
    people = {
        "anna": act({"kind": "meet", "person": "ben", "for_s": 4.0}, start=[-1.0, -0.5]),
        "ben": act({"kind": "stand"}, start=[0.7, -0.4], heading_deg=0.0),
    }
    met = moments(people, 7.0, "ben")[-1]
    assert apart(met.truth.yaw, np.pi) < 0.35


def test_a_meeting_with_somebody_who_leaves_is_over() -> None:
    people = {
        "anna": act(
            {"kind": "meet", "person": "ben"}, {"kind": "walk", "waypoints": [[-1.0, -0.5]]}, start=[-1.0, 0.0]
        ),
        "ben": act({"kind": "leave", "to": [0.9, 1.7]}, start=[0.9, 1.3]),
    }
    np.testing.assert_allclose(moments(people, 9.0)[-1].place, [-1.0, -0.5], atol=0.15)


def test_only_feet_on_the_floor_carry() -> None:
    world = World(scenario({"anna": act({"kind": "walk", "waypoints": [[1.0, -0.8], [-1.0, 0.3]], "repeat": True})}))
    for k in range(600):
        (person,) = world.truth(k * 10**7, {}).people
        for foot in person.feet:
            assert not (foot.contact and foot.z > 0.001), k / 100


def test_whoever_comes_waits_until_who_left_is_through_the_door() -> None:
    """Nobody turns into somebody else in the doorway from one scan to the next."""
    door = [0.9, 1.7]
    people = {
        "anna": act({"kind": "walk", "waypoints": [[0.0, -0.5]]}, start=door, arrive_s=1.5),
        "ben": act({"kind": "leave", "to": door}, start=[0.5, 0.3]),
    }
    left = moments(people, 8.0, "ben")[-1].t
    came = moments(people, 8.0, "anna")[0].t
    assert left > 1.5
    assert 1.0 <= came - left < 1.3


def test_who_comes_in_by_a_door_begins_where_who_leaves_by_it_ends() -> None:
    door = [0.9, 2.1]  # in the wall
    goes = moments({"anna": act({"kind": "leave", "to": door}, start=[0.5, 0.3])}, 6.0)
    comes = moments({"anna": act({"kind": "walk", "waypoints": [[0.0, -0.5]]}, start=door, arrive_s=1.0)}, 6.0)
    assert comes[0].t == pytest.approx(1.0, abs=0.11)
    assert goes[-1].t < 5.0
    np.testing.assert_allclose(comes[0].place, goes[-1].place, atol=0.15)
    np.testing.assert_allclose(comes[-1].place, [0.0, -0.5], atol=0.12)


def test_people_come_and_leave() -> None:
    script = {"kind": "leave", "to": [-1.0, 0.0]}
    world = World(scenario({"anna": act(script, arrive_s=2.0), "ben": act({"kind": "stand"}, start=[1.2, -0.6])}))
    there = [moment.t for moment in watch(world, 8.0)]
    assert there[0] == pytest.approx(2.0, abs=0.11)
    assert 3.0 < there[-1] < 5.0
    # who is gone is nowhere to be seen, and bears on nothing
    snapshot = world.snapshot(7.0)
    assert snapshot.feet is not None
    assert snapshot.feet.load_n[0].sum() == 0
    geoms = world.scene.person_of_geom == world.scene.ids["anna"]
    assert world.data.geom_xpos[geoms, 2].max() < -50


def test_times_and_conditions_are_waited_for() -> None:
    people = {
        "anna": act({"kind": "walk", "waypoints": [[0.5, 0.0]], "at_s": 2.0}),
        "ben": act({"kind": "bend", "when": {"person": "anna", "does": "walk"}}, start=[-1.0, 0.7]),
        "cleo": act({"kind": "bend", "when": {"near": "anna", "within_m": 1.05}}, start=[1.2, -0.6]),
    }
    world = World(scenario(people))
    began: dict[str, float] = {}
    for k in range(50):
        world.snapshot(k * DT)
        for name in people:
            if doing(world, name) in ("walk", "bend"):
                began.setdefault(name, k * DT)
    assert began["anna"] == pytest.approx(2.0, abs=0.11)
    assert began["ben"] == pytest.approx(2.1, abs=0.21)
    assert began["cleo"] > began["anna"]


def test_two_do_not_sit_on_one_chair() -> None:
    sit = {"kind": "sit", "seat": "chair_left", "for_s": 3}
    people = {"anna": act(sit), "ben": act(sit, start=[-0.8, 0.5])}
    world = World(scenario(people))
    both = 0
    for k in range(200):
        frame = world.truth(round(k * DT * 1e9), {})
        both += sum(person.z < 0.7 for person in frame.people) == 2
    assert both == 0
    assert doing(world, "ben") in ("sit", "stand")


def test_nothing_jumps_on_the_way_through_a_busy_script() -> None:
    script = [
        {"kind": "walk", "waypoints": [[0.4, -0.3]]}, {"kind": "turn", "by_deg": 100}, {"kind": "bend", "for_s": 0.5},
        {"kind": "sit", "seat": "chair_left", "for_s": 1}, {"kind": "reach", "point": [0.5, 0.3, 1.0], "for_s": 0.5},
        {"kind": "lie", "bed": "bed", "for_s": 1}, {"kind": "walk", "waypoints": [[0.0, 0.0]]},
    ]  # fmt: skip
    world = World(scenario({"anna": act(*script)}, 60))
    before, done = None, set()
    for k in range(int(45 / 0.025)):
        world.population.advance(k * 0.025)
        coordinates = world.population.qpos(k * 0.025)[0]
        done.add(doing(world, "anna"))
        if before is not None:
            assert np.abs(coordinates[:3] - before[:3]).max() < 0.06, k * 0.025
            turn = 2 * np.arccos(np.minimum(abs(coordinates[3:7] @ before[3:7]), 1.0))
            assert turn < 0.15, k * 0.025
            jump = np.abs(coordinates[7:] - before[7:])
            assert jump.max() < 0.5, (k * 0.025, JOINTS[int(jump.argmax())])
        before = coordinates
    assert done >= {"walk", "turn", "bend", "sit", "reach", "lie", "stand"}


def test_floors_feel_what_the_truth_says() -> None:
    world = World(scenario({"anna": act({"kind": "stand"})}))
    model = world.scene.model
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "anna/pelvis") > 0
    snapshot = world.snapshot(1.0)
    assert snapshot.feet is not None
    mass_kg = world.scene.appearances["anna"].mass_kg
    assert snapshot.feet.load_n.sum() == pytest.approx(9.81 * mass_kg, rel=0.005)
