"""The library hall: as many people as its scenario says, who come and go, meet, walk together, merge and part.

The seed is none of those that the scenario was made with.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

from trackers.observations import NS_PER_S
from trackers.rig import PinholeSensor
from twin.recording.situation_table import situation_table
from twin.scenario import load_scenario
from twin.truth.situations import INTERACTION_M
from twin.truth.truth_types import Situation, TruthDetail, TruthFrame
from twin.world.simulation import Simulation

pytestmark = pytest.mark.slow

SEED = 7
AT_A_GATE_M = 1.2  # gates are passages 2.4 m wide
GREETS_S = 4.0
SCANNERS = ("west", "east")
RATE_HZ = 3  # often enough for who is where, and a quarter of the work


@dataclass(frozen=True)
class Afternoon:
    """A run of the hall, seen by its scanners at `RATE_HZ`."""

    names: dict[int, str]
    arrive_s: dict[str, float]
    gates: np.ndarray  # (n, 2) [m]
    frames: list[TruthFrame]
    situations: list[Situation]

    def of(self, kind: str) -> list[Situation]:
        return [each for each in self.situations if each.kind == kind]

    def together_s(self, *names: str) -> float:
        """How long two were closer than `INTERACTION_M`, at the longest."""
        return max(
            (
                (each.end_ns - each.start_ns) / NS_PER_S
                for each in self.of("interaction")
                if {self.names[each.first_id], self.names[each.second_id]} == set(names)
            ),
            default=0.0,
        )


def run_of(name: str, *changes: str) -> Afternoon:
    scenario = load_scenario(name, [f"seed={SEED}", "background=none", *changes])
    frames: list[TruthFrame] = []
    details: list[TruthDetail] = []
    with Simulation(scenario, images=False, on_truth=frames.append, on_detail=details.append) as simulation:
        for _ in simulation:
            pass
        scene = simulation.world.scene
    sites = [scene.model.site(number) for number in range(scene.model.nsite)]
    return Afternoon(
        names={number: name for name, number in scene.ids.items()},
        arrive_s={name: person.arrive_s for name, person in scenario.people.items()},
        gates=np.array([site.pos[:2] for site in sites if site.name.startswith("gate_")]),
        frames=frames,
        situations=[each for each in details if isinstance(each, Situation)],
    )


@pytest.fixture(scope="module")
def afternoon() -> Afternoon:
    return run_of("library-hall", *(f"sensors.{name}.rate_hz={RATE_HZ}" for name in SCANNERS))


@pytest.fixture(scope="module")
def busy() -> Afternoon:
    return run_of("library-hall-busy", "duration_s=40", *(f"sensors.{name}.rate_hz=10" for name in SCANNERS))


def places(frame: TruthFrame) -> np.ndarray:
    return np.array([(person.x, person.y) for person in frame.people])


def inside(frame: TruthFrame) -> np.ndarray:
    return np.array([person.in_area for person in frame.people])


@pytest.mark.nightly
def test_ten_people_on_average_and_more_than_fifteen_at_times(afternoon):
    count = np.array([inside(frame).sum() for frame in afternoon.frames])
    assert 9.0 < count.mean() < 11.0
    assert 0.02 < (count > 15).mean() < 0.2
    assert count.min() >= 4


def test_about_one_in_six_is_close_to_somebody(afternoon):
    close = total = 0
    for frame in afternoon.frames:
        apart = np.linalg.norm(places(frame)[:, None] - places(frame), axis=-1)
        np.fill_diagonal(apart, np.inf)
        close += ((apart < INTERACTION_M).any(axis=1) & inside(frame)).sum()
        total += inside(frame).sum()
    assert 0.14 < close / total < 0.18


def test_people_come_and_go_through_the_gates(afternoon):
    first, last = {}, {}
    for frame in afternoon.frames:
        for person in frame.people:
            first.setdefault(person.id, (frame.stamp_ns, person.x, person.y))
            last[person.id] = (frame.stamp_ns, person.x, person.y)
    assert len(first) == len(afternoon.names)  # everybody comes

    def gate_of(place):
        gap = np.linalg.norm(afternoon.gates - place, axis=1)
        return int(gap.argmin()) if gap.min() < AT_A_GATE_M else None

    came = {id_: gate_of(row[1:]) for id_, row in first.items() if afternoon.arrive_s[afternoon.names[id_]] > 0}
    end_ns = afternoon.frames[-1].stamp_ns
    left = {id_: gate_of(row[1:]) for id_, row in last.items() if row[0] < end_ns}
    assert None not in came.values()
    assert None not in left.values()
    assert set(came.values()) == set(left.values()) == set(range(len(afternoon.gates)))
    assert len(left) > 20


def test_nobody_waits_in_a_gate(afternoon):
    waits = Counter()
    for frame in afternoon.frames:
        gap = np.linalg.norm(places(frame)[:, None] - afternoon.gates, axis=-1).min(axis=1)
        slow = np.array([np.hypot(person.vx, person.vy) < 0.2 for person in frame.people])
        waits.update(frame.people[row].id for row in np.flatnonzero((gap < AT_A_GATE_M) & slow))
    interval_s = (afternoon.frames[1].stamp_ns - afternoon.frames[0].stamp_ns) / NS_PER_S
    assert max(waits.values(), default=0) * interval_s < 2.0


def test_people_meet_and_walk_together(afternoon):
    assert afternoon.together_s("ines", "jonas") > GREETS_S
    assert afternoon.together_s("vera", "wim") > GREETS_S
    assert afternoon.together_s("petra", "quentin") > GREETS_S
    assert afternoon.together_s("finn", "greta") > GREETS_S


def test_each_scanner_merges_people_and_parts_them_again(afternoon):
    for scanner in SCANNERS:
        merged = [each for each in afternoon.of("merged") if each.sensor == scanner]
        assert sum(each.complete for each in merged) >= 4
    assert sum(each.complete for each in afternoon.of("correlated")) >= 5


def test_the_picture_shows_the_area(afternoon):
    """Of people in the area the ground point is in the picture in at least 99 of 100 frames."""
    with Simulation(load_scenario("library-hall", ["background=none", "people={}"])) as simulation:
        camera = simulation.true_rig.sensors["camera"]
    assert isinstance(camera, PinholeSensor)
    inside_m = np.concatenate([places(frame)[inside(frame)] for frame in afternoon.frames])
    on_floor = np.column_stack([inside_m, np.zeros(len(inside_m))])
    pose, lens = camera.room_from_sensor, camera.intrinsics
    _, seen = lens.project((on_floor - pose.translation) @ pose.rotation)
    assert seen.mean() >= 0.99


def test_in_the_busy_place_somebody_is_close_all_the_time(busy):
    assert len(busy.names) == 11
    stamps = np.array([frame.stamp_ns for frame in busy.frames])
    assert all(inside(frame).all() for frame in busy.frames)
    table = situation_table(busy.situations)
    assert 0.5 < table.select("correlated").pair_frames(stamps) / len(stamps) < 1.2
    merged = table.select("merged_rig")
    lasts_s = (merged.end_ns - merged.start_ns) / NS_PER_S
    assert len(merged) * 60 / 40 >= 15
    assert (lasts_s >= 0.5).mean() >= 0.4
