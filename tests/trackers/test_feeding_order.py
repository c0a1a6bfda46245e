"""Observations reach a tracker in order of their stamps, each once."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, strategies as st

from trackers.arrival_order import MAX_WAIT_S, StampOrder
from trackers.feeding import FedTracker, track_frames
from trackers.observations import NS_PER_S, LaserScan, Observation
from trackers.rig import LaserSensor, Rig
from trackers.tracks import Track

RIG = Rig(sensors={"waist": LaserSensor(topic="/waist/scan", role="waist"), "knee": LaserSensor(topic="/knee/scan")})


def scan(t: float, sensor: str = "waist") -> LaserScan:
    return LaserScan(sensor, round(t * NS_PER_S), np.ones(3, np.float32), -0.1, 0.1, 0.05, 8.0)


def ordered(arriving: list[LaserScan]) -> tuple[list[Observation], StampOrder]:
    order = StampOrder()
    return [each for item in arriving for each in order.add(item)] + order.finish(), order


def test_what_comes_in_order_leaves_in_order_and_is_all_there() -> None:
    arriving = [scan(0.1 * k, sensor) for k in range(20) for sensor in ("waist", "knee")]
    left, order = ordered(arriving)
    assert left == arriving
    assert order.discarded == 0


@given(st.lists(st.tuples(st.sampled_from(["waist", "knee"]), st.floats(0, MAX_WAIT_S - 0.001)), max_size=60))
def test_nothing_is_lost_to_jitter_below_the_wait(late: list[tuple[str, float]]) -> None:
    taken = [(scan(0.1 * k, sensor), 0.1 * k + late_s) for k, (sensor, late_s) in enumerate(late)]
    arriving = [item for item, _ in sorted(taken, key=lambda each: each[1])]
    left, order = ordered(arriving)
    assert left == [item for item, _ in taken]
    assert order.discarded == 0


@given(st.lists(st.tuples(st.sampled_from(["waist", "knee"]), st.integers(0, 20)), max_size=60))
def test_stamps_never_go_back_nothing_comes_twice_and_what_is_dropped_is_counted(items: list[tuple[str, int]]) -> None:
    left, order = ordered([scan(0.1 * k, sensor) for sensor, k in items])
    assert all(later.stamp_ns >= earlier.stamp_ns for earlier, later in pairwise(left))
    assert len({(each.sensor, each.stamp_ns) for each in left}) == len(left)
    assert len(left) + order.discarded == len(items)


def test_the_wait_is_bounded() -> None:
    order = StampOrder()
    assert order.add(scan(0.0)) == []
    assert order.add(scan(MAX_WAIT_S - 0.001, "knee")) == []
    assert [each.t for each in order.add(scan(MAX_WAIT_S, "knee"))] == [0.0]


def test_a_stamp_far_ahead_holds_nobody_back() -> None:
    thirty_days_s = 30 * 86_400.0
    left, order = ordered([scan(0.0), scan(thirty_days_s, "knee"), scan(0.1), scan(0.2)])
    assert [each.t for each in left] == [0.0, 0.1, 0.2, thirty_days_s]
    assert order.discarded == 0


@given(st.floats(0.35, 0.95), st.booleans())
def test_a_sensor_that_stays_behind_is_waited_for_whichever_clock_is_wrong(ahead_s: float, knee: bool) -> None:
    arriving = [
        scan(0.1 * k + (ahead_s if (sensor == "knee") == knee else 0.0), sensor)
        for k in range(60)
        for sensor in RIG.sensors
    ]
    left, order = ordered(arriving)
    assert order.discarded <= 4 + 10 * ahead_s  # until it is known
    assert len(left) == len(arriving) - order.discarded


class Counting:
    """Reports where it stands after each observation."""

    def __init__(self) -> None:
        self.got: list[float] = []

    def update(self, observation: LaserScan) -> None:
        self.got.append(observation.t)

    def tracks(self) -> list[Track]:
        return [Track(1, float(len(self.got)), 0.0)]


def test_a_tracker_that_returns_nothing_is_asked_once_a_scan_of_the_main_sensor_in_order() -> None:
    arriving = [scan(0.0), scan(0.0, "knee"), scan(0.2), scan(0.1), scan(0.1), scan(0.2, "knee"), scan(1.0), scan(0.15)]
    tracker = Counting()
    frames = list(track_frames(tracker, RIG, arriving))  # pyright: ignore[reportArgumentType]
    assert [frame.stamp_ns / NS_PER_S for frame in frames] == [0.0, 0.1, 0.2, 1.0]
    assert [frame.tracks[0].x for frame in frames] == [1, 3, 4, 6]


def test_who_takes_any_order_gets_it_and_both_counts_are_told() -> None:
    class AnyOrder(Counting):
        takes_any_order = True
        discarded = 2

    tracker = AnyOrder()
    fed = FedTracker(tracker, RIG)  # pyright: ignore[reportArgumentType]
    for t in (0.2, 0.1, 0.1):
        fed.update(scan(t))
    assert tracker.got == [0.2, 0.1, 0.1]
    assert fed.discarded == 2

    held = FedTracker(Counting(), RIG)  # pyright: ignore[reportArgumentType]
    for t in (0.2, 0.1, 0.1):
        held.update(scan(t))
    assert held.discarded == 1
