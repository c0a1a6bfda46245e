"""Recorded paths drive bodies: where the file has them, as fast, in and out with it."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackers.configuration import validate
from trackers.errors import InputError
from twin.people.script.recorded import BODIES_NEED_M, RecordedPaths, close_calls, curve_through, describe_close_calls
from twin.scenario import Scenario
from twin.scenario.action import RecordedPath
from twin.scenario.pedestrians import Pedestrians, people_from
from twin.world.world import World

DATA = Path(__file__).parents[5] / "shared" / "data" / "trajectories"
SCANNER = {"low": {"kind": "laser", "rate_hz": 10, "mount": {"xyz": [0, 0, 0.4]}}}


def scenario(people: dict[str, Any], duration_s: float, room: str = "plaza") -> Scenario:
    content = {"name": "test", "room": room, "duration_s": duration_s, "people": people, "sensors": SCANNER}
    return validate(Scenario, content, "test")


def keeps(points: list[tuple[float, float, float]]) -> dict[str, Any]:
    return {"script": {"kind": "path", "points": points}}


def test_a_person_is_where_the_path_has_them_when_it_has_them() -> None:
    points = [(1.0 + 0.4 * k, -3.0 + 0.5 * k, 0.1 * k * k) for k in range(8)]
    world = World(scenario({"anna": keeps(points)}, 6.0))
    for t, x, y in points:
        (person,) = world.truth(round(t * 1e9), {}).people
        assert np.hypot(person.x - x, person.y - y) < 0.05
    assert world.truth(round(4.2e9), {}).people == ()
    assert World(scenario({"anna": keeps(points)}, 6.0)).truth(round(0.5e9), {}).people == ()


def test_who_was_there_before_the_start_comes_in_stride() -> None:
    points = [(-2.0 + 0.4 * k, -3.0 + 0.56 * k, 0.0) for k in range(12)]
    world = World(scenario({"anna": keeps(points)}, 3.0))
    (person,) = world.truth(0, {}).people
    assert person.vx == pytest.approx(1.4, abs=0.15)
    left, right = person.feet
    assert abs(left.x - right.x) > 0.15


def test_paths_are_overshot_nowhere() -> None:
    rows = [(0.0, 0.0, 0.0), (1.0, 0.0, 3.0), (2.0, 0.0, 3.0), (3.0, 0.0, 0.0), (3.4, 0.5, 0.0)]
    places = curve_through(np.array(rows))(np.arange(0.0, 3.4, 0.02))
    assert places.max() <= 3.0
    assert places.min() >= 0.0


def test_paths_may_meet_in_one_point() -> None:
    there, back = [(0, 0, 0), (4, 4, 0)], [(0, 4, 0), (4, 0, 0)]
    world = World(scenario({"anna": keeps(there), "ben": keeps(back)}, 4.0))
    with np.errstate(divide="raise", invalid="raise"):
        assert len(world.truth(2 * 10**9, {}).people) == 2


def test_others_keep_out_of_the_way_of_a_path() -> None:
    path = [(0.4 * k, -4.0 + 0.5 * k, 0.0) for k in range(20)]
    people = {"anna": keeps(path), "ben": {"start": [1.0, 0.1], "script": {"kind": "walk", "waypoints": [[-4.0, 0.1]]}}}
    world = World(scenario(people, 8.0))
    gaps = []
    for k in range(70):
        frame = {person.id: person for person in world.truth(k * 10**8, {}).people}
        if len(frame) == 2:
            gaps.append(np.hypot(frame[1].x - frame[2].x, frame[1].y - frame[2].y))
    assert min(gaps) > 0.5


def test_paths_that_come_closer_than_bodies_do_are_told() -> None:
    content = scenario(
        {
            "anna": keeps([(0, 0, 0), (4, 4, 0)]),
            "ben": keeps([(0, 4, 0.3), (4, 0, 0.3)]),
            "cleo": keeps([(0, 0, 9), (4, 4, 9)]),
        },
        4.0,
    )
    (call,) = close_calls(content.people)
    assert {call.first, call.second} == {"anna", "ben"}
    assert call.t == pytest.approx(2.0, abs=0.11)
    assert call.apart_m == pytest.approx(0.3, abs=0.05)
    assert "1 pair of recorded paths" in describe_close_calls([call])
    assert f"{BODIES_NEED_M:g} m" in describe_close_calls([call])
    assert describe_close_calls([]) == ""


def test_a_path_with_a_long_gap_is_kept_in_no_more_memory_than_a_short_one() -> None:
    points = [(0, 0, 0), (1, 0.5, 0), (1e6, 3, 0), (1e6 + 1, 3, 0.5)]
    content = scenario({"anna": keeps(points), "ben": keeps([(0, 0.1, 0), (1e8, 0, 1)])}, 1.0)
    tracemalloc.start()
    try:
        world = World(content)
        (_, _) = world.truth(0, {}).people
        assert len(close_calls(content.people, content.duration_s)) == 1
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


def test_places_do_not_depend_on_which_moments_were_asked_for_before() -> None:
    paths = {
        0: validate(RecordedPath, {"points": [(-3, 0, 0), (4, 1, 2), (30, 5, 5)]}, "test"),
        1: validate(RecordedPath, {"points": [(20, 1, 0), (21, 1, 1), (22.01, 2, 1)]}, "test"),
    }
    recorded = RecordedPaths(paths, 0.025)
    in_order = [recorded.at(tick) for tick in range(1400)]
    for tick in (1399, 3, 700, 801, 800, 0, 399, 400):
        np.testing.assert_array_equal(RecordedPaths(paths, 0.025).at(tick), in_order[tick])
    np.testing.assert_allclose(in_order[0][0][1], 1)
    np.testing.assert_allclose(in_order[-1][0], [5 + 5j, 2 + 1j])
    assert recorded.there(800).tolist() == [True, True] and recorded.there(900).tolist() == [True, False]


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (
            [(0, 0, 0), (4, 0, 40)],
            r"people\.anna\.script\.points, between 0 and 1, at 2\.5 s: \[0, 25\] is outside the room's walkable area",
        ),
        ([(0, 0, 0), (4, 40, 0)], "is outside the room's walkable area"),
    ],
)
def test_paths_through_walls_teach(points: list[tuple[float, float, float]], said: str) -> None:
    with pytest.raises(InputError, match=said):
        World(scenario({"anna": keeps(points)}, 3.0))


def test_paths_through_furniture_teach() -> None:
    points = [(0.0, 0.0, 0.0), (1.0, 1.0, 0.3), (2.0, 1.22, 0.28)]
    with pytest.raises(
        InputError,
        match=r"points, between 1 and 2, at 1\.\d+ s: .* is inside 'chair_left'; a place outside of furniture",
    ):
        World(scenario({"anna": keeps(points)}, 3.0, "sensing_room"))


@pytest.mark.skipif(not DATA.is_dir(), reason="the recordings of pedestrians are not here")
@pytest.mark.parametrize(("file", "rate_hz", "start_s"), [("eth.txt", 15.0, 300.0), ("zara01.txt", 25.0, 60.0)])
def test_a_part_of_a_real_recording_is_walked(file: str, rate_hz: float, start_s: float) -> None:
    seconds = 15.0
    people, _ = people_from(Pedestrians(file=str(DATA / file), frame_rate_hz=rate_hz, start_s=start_s), seconds, "test")
    content = scenario(people, seconds)
    world = World(content)
    names = {number: name for name, number in world.scene.ids.items()}
    rows: dict[str, dict[float, tuple[float, float]]] = {}
    for name, person in content.people.items():
        path = person.script[0]
        assert isinstance(path, RecordedPath)
        rows[name] = {round(t, 6): (x, y) for t, x, y in path.points if 0 <= t < seconds}
    walked, errors = set(), []
    for t in sorted({t for each in rows.values() for t in each}):
        for person in world.truth(round(t * 1e9), {}).people:
            if t in rows[names[person.id]]:
                walked.add(names[person.id])
                x, y = rows[names[person.id]][t]
                errors.append(np.hypot(person.x - x, person.y - y))
    assert walked == {name for name, each in rows.items() if each}
    assert max(errors) < 0.05
