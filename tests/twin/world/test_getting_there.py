"""Whoever is sent somewhere gets there, is refused beforehand, or is named as late."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackers.errors import InputError
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario
from twin.suites.cache import RecordingCache
from twin.suites.worker import cached_motion
from twin.view.activities import verb
from twin.world.simulation import Simulation
from twin.world.world import World

ROOM = """<mujoco model="office">
  <compiler angle="degree"/>
  <worldbody>
    <light pos="2 2 2.5" dir="0 0 -1"/>
    <geom name="floor" type="plane" pos="3 2 0" size="3.2 2.2 0.1"/>
    <geom name="south" type="box" pos="3 -0.05 1.3" size="3.1 0.05 1.3"/>
    <geom name="north" type="box" pos="3 4.05 1.3" size="3.1 0.05 1.3"/>
    <geom name="west" type="box" pos="-0.05 2 1.3" size="0.05 2.1 1.3"/>
    <geom name="east" type="box" pos="6.05 2 1.3" size="0.05 2.1 1.3"/>
    <body name="chair" pos="4 0.7 0">
      <geom type="box" pos="0 0 0.44" size="0.22 0.22 0.02"/>
      <site name="seat_chair" pos="0 0 0.46" euler="0 0 90"/>
    </body>
    <body name="desk" pos="4 {y:.3f} 0"><geom type="box" pos="0 0 0.72" size="0.8 0.4 0.02"/></body>
  </worldbody>
</mujoco>"""


def scene(folder: Path, people: str, gap_m: float = 1.2, duration_s: float = 20.0) -> Scenario:
    """An office whose desk stands `gap_m` before the front edge of its chair."""
    (folder / "room.xml").write_text(ROOM.format(y=0.92 + gap_m + 0.4))
    (folder / "own.yaml").write_text(
        f"name: own\nroom: room.xml\nduration_s: {duration_s}\npeople: {people}\n"
        "sensors: {low: {kind: laser, rate_hz: 5, mount: {xyz: [0.1, 0.1, 0.4], yaw_deg: 45}}}\n"
    )
    return load_scenario(folder / "own.yaml")


def at_end(world: World, t: float) -> World:
    for moment in np.arange(0.5, t, 0.5):
        world.people.advance(float(moment))
    return world


@pytest.mark.parametrize("height_m", [1.2, 1.66, 1.95])
@pytest.mark.parametrize("gap_m", [0.2, 0.35, 0.45, 0.55, 0.65, 0.8])
def test_a_chair_before_a_desk_is_sat_on_or_refused(gap_m: float, height_m: float, tmp_path: Path) -> None:
    people = f"{{anna: {{start: [1, 1], height_m: {height_m}, script: {{kind: sit, seat: chair}}}}}}"
    scenario = scene(tmp_path, people, gap_m)
    refused = ""
    try:
        world = World(scenario)
    except InputError as error:
        world, refused = None, str(error)
    if world is None:
        assert gap_m < 0.7 and "people.anna.script.0.seat" in refused and "'desk' is in the way" in refused
        return
    assert gap_m > 0.3 or height_m > 1.5
    population = at_end(world, 13.0).population
    assert population.holds_posture()[0] and not population.under_way[0] and population.late() == []


@pytest.mark.parametrize("to", [(3.0, 3.7), (3.0, 3.85), (3.0, 4.0), (3.0, 4.1), (0.0, 2.0), (6.05, 0.5), (5.9, 3.9)])
def test_people_leave_at_a_wall_and_by_a_door_in_it(to: tuple[float, float], tmp_path: Path) -> None:
    people = f"{{ben: {{start: [1, 1], script: {{kind: leave, to: [{to[0]}, {to[1]}]}}}}}}"
    world = at_end(World(scene(tmp_path, people)), 12.0)
    assert not world.people.present(11.5)[0] and world.population.late() == []


def test_a_place_to_leave_at_far_outside_is_refused_with_one_that_is_not(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"people\.ben\.script\.to: \[3, 6\] is .* beyond .*\[3, 3\.6"):
        World(scene(tmp_path, "{ben: {start: [1, 1], script: {kind: leave, to: [3, 6]}}}"))


def test_who_waits_for_a_seat_that_is_taken_is_told_and_said_to_be_on_the_way(tmp_path: Path) -> None:
    people = (
        "{anna: {script: {kind: sit, seat: chair, seated: true}}, "
        "ben: {start: [1, 1], script: [{kind: stand, for_s: 1}, {kind: sit, seat: chair}]}}"
    )
    told: list[str] = []
    scenario = scene(tmp_path, people, duration_s=8)
    run = run_scenario(
        scenario, trackers=["sort"], out=tmp_path / "run", video=False, images=False, on_warning=told.append
    )
    late = [warning for warning in told if "ben has not reached chair after" in warning]
    assert len(late) == 1 and not any("anna has not" in warning for warning in told)
    assert "ben has not reached chair after" in run.files["report"].read_text(encoding="utf-8")
    assert verb("sit", under_way=True) == "goes to sit" and verb("sit") == "sits"


NEVER = {
    "nobody comes near": (
        "{anna: {start: [1, 1], script: {kind: walk, when: {near: [5, 3], within_m: 0.5}, waypoints: [[2, 1]]}}}",
        "anna waits since 0.0 s for [5, 3] to be within 0.5 m: walk has not started",
    ),
    "each waits for the other": (
        "{anna: {start: [1, 1], script: {kind: turn, by_deg: 9, when: {person: ben, does: turn}}}, "
        "ben: {start: [3, 1], script: {kind: turn, by_deg: 9, when: {person: anna, does: turn}}}}",
        "ben waits since 0.0 s for anna to turn: turn has not started",
    ),
    "nobody leads": (
        "{anna: {start: [1, 1], script: {kind: join, person: ben}}, ben: {start: [3, 1], script: {kind: stand}}}",
        "anna waits since 0.0 s for ben to lead",
    ),
    "behind a fence": (
        "{anna: {start: [1, 1], script: {kind: follow, person: ben}}, ben: {start: [5.5, 3.6], script: {kind: stand}}}",
        "anna waits since 0.0 s for a way to ben, to whom furniture leaves none",
    ),
    "beside, behind a fence": (
        "{anna: {start: [1, 1], script: {kind: follow, person: ben, beside: left}}, "
        "ben: {start: [5.5, 3.6], script: {kind: wander}}}",
        "ben waits since 0.0 s for a way out of where furniture leaves none",
    ),
    "has left": (
        "{anna: {start: [1, 1], script: [{kind: stand, for_s: 4}, {kind: follow, person: ben}]}, "
        "ben: {start: [5.3, 2], script: {kind: leave, to: [5.6, 2.2]}}}",
        "anna does not follow ben, who has left, at 4.0 s",
    ),
    "too far for the hand": (
        "{anna: {start: [1, 1], script: {kind: reach, point: [5, 1, 1]}}}",
        "anna cannot reach (5.0, 1.0, 1.0), which is 3.",
    ),
    "somebody stands there": (
        "{anna: {start: [1, 1.5], script: {kind: walk, waypoints: [[3, 1.5]]}}, ben: {start: [3, 1.5], script: {kind: stand}}}",
        "which others have taken",
    ),
}
FENCE = '<geom type="box" size=".02 .5 .5" pos="5 3.5 .5"/><geom type="box" size=".5 .02 .5" pos="5.5 3 .5"/>'


@pytest.mark.parametrize(("people", "told"), NEVER.values(), ids=NEVER.keys())
def test_whatever_of_a_script_is_never_done_is_told(people: str, told: str, tmp_path: Path) -> None:
    scenario = scene(tmp_path, people)
    room = tmp_path / "room.xml"
    room.write_text(room.read_text().replace("</worldbody>", f"{FENCE}</worldbody>"))
    late = at_end(World(scenario), 7.0).population.late()
    assert any(told in each for each in late), late


def test_who_has_not_arrived_is_told_of_precomputed_people_too(tmp_path: Path) -> None:
    scenario = scene(tmp_path, NEVER["somebody stands there"][0], duration_s=7.0)
    cache = RecordingCache(tmp_path / "cache", 10**9)
    for _ in range(2):  # made, and read from the cache
        (told,) = World(scenario, cached_motion(cache, scenario)).late()
        assert "which others have taken" in told


def test_two_people_on_one_seat_from_the_start_are_refused(tmp_path: Path) -> None:
    seated = "{script: {kind: sit, seat: chair, seated: true}}"
    with pytest.raises(InputError, match=r"people\.ben\.script\.0\.seat: 'anna' sits on 'chair' from the start too"):
        World(scene(tmp_path, f"{{anna: {seated}, ben: {seated}}}"))


@pytest.mark.parametrize("step_m", [0.05, 0.1, 0.15, 0.2])
def test_a_recorded_path_through_furniture_is_refused_wherever_its_rows_touch_it(step_m: float, tmp_path: Path) -> None:
    points = [[0.3 * k, 3 + step_m * k, 2.6] for k in range(round(2.4 / step_m))]
    with pytest.raises(InputError, match=r"people\.anna\.script\.points.* is inside 'desk'"):
        World(scene(tmp_path, f"{{anna: {{script: {{kind: path, points: {points}}}}}}}"))


@pytest.mark.parametrize(("unit", "told"), [(1.0, False), (0.1, True), (4.0, True)])
def test_speeds_of_a_recorded_path_that_nobody_walks_at_are_told(unit: float, told: bool, tmp_path: Path) -> None:
    points = [[0.5 * k / unit, 1 + 0.6 * k, 3.7] for k in range(7)]
    scenario = scene(tmp_path, f"{{anna: {{script: {{kind: path, points: {points}}}}}}}")
    with Simulation(scenario, images=False) as simulation:
        assert any("m/s in the median, where" in each for each in simulation.warnings) == told


def test_who_waits_for_a_doorway_or_a_seat_is_named_with_who_is_there(tmp_path: Path) -> None:
    people = (
        "{anna: {start: [4, 1.6], script: {kind: sit, seat: chair}}, ben: {start: [2, 1], script: {kind: sit, seat: chair}}, "
        "cleo: {start: [1, 3], script: {kind: stand}}, dora: {arrive_s: 1, start: [1.3, 3], script: {kind: stand}}}"
    )
    late = at_end(World(scene(tmp_path, people)), 12.0).people.late()
    assert late == [
        "dora has not come for 10 s: cleo stands where they come in",
        "ben has not reached chair after 11 s: anna is there",
    ]
