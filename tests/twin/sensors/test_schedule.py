"""The scheduler against a world that renders nothing: when, how late, and whether at all."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import cast

import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.observations import LaserScan
from trackers.rig import LaserSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.schedule import ComingStamps, Delivery, Schedule, Scheduled, SensorEvent, Timing
from twin.sensors.sensor import Reading, State


class FakeWorld:
    """Remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def snapshot(self, t: float) -> Snapshot:
        self.asked.append(t)
        return Snapshot(t, cast("object", None), cast("object", None), np.zeros(0, np.int16))  # type: ignore[arg-type]


class Clock:
    """A sensor that reports the times of its snapshots, how often it was asked, and a random number."""

    def __init__(self, name: str = "clock", instants_s: tuple[float, ...] = (0.0,), draws: int = 1) -> None:
        self.name, self.instants_s, self._draws = name, instants_s, draws

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        times = [snapshot.t for snapshot in snapshots]
        count = (state or 0) + 1
        values = np.array([*times, count, *rng.random(self._draws)], dtype=np.float32)
        return Reading(LaserScan(self.name, stamp_ns, values, 0.0, 0.1, 0.0, 1.0)), count

    def rig_sensor(self) -> LaserSensor:
        return LaserSensor(topic=f"/{self.name}/scan")


def schedule(*timings: dict[str, float], duration_s: float = 1.0, **options: int) -> Schedule:
    return Schedule(
        [
            Scheduled(Clock(f"s{place}", **options), Timing(**timing), np.random.default_rng(place))
            for place, timing in enumerate(timings)
        ],
        duration_s,
    )


def arrivals(plan: Schedule) -> list[Delivery]:
    return list(plan.observe(FakeWorld()))


def events_of(plan: Schedule) -> list[SensorEvent]:
    return [event for _, _, event, _ in plan.ordered()]


def values(deliveries: Iterable[Delivery]) -> list[bytes]:
    return [delivery.reading.observation.ranges_m.tobytes() for delivery in deliveries]


def test_stamps_are_exact_and_the_end_is_left_out():
    events = events_of(schedule({"rate_hz": 10}, duration_s=26.2))
    assert len(events) == 262
    assert [event.stamp_ns for event in events] == [number * 100_000_000 for number in range(262)]
    assert events[3] == SensorEvent("s0", 300_000_000, 300_000_000, dropped=False)


@pytest.mark.parametrize("rate_hz", [0.2, 0.7, 3.0, 10.0])
def test_no_stamp_is_prepared_farther_ahead_than_asked_however_rare_stamps_are(rate_hz):
    plan, batches = schedule({"rate_hz": rate_hz}, duration_s=20.0), []
    list(ComingStamps(plan.ordered(), 1.0).until(20.0, batches.append))
    assert max((batch[-1][0] - batch[0][0] for batch in batches), default=0) <= 1_000_000_000


@given(ahead_s=st.sampled_from([0.0, 0.5, 1.0]), asked_s=st.lists(st.floats(0, 4), max_size=5).map(sorted))
def test_stamps_are_told_in_time_and_prepared_before_they_are_due(ahead_s, asked_s):
    plan, prepared = schedule({"rate_hz": 10}, {"rate_hz": 7, "phase_s": 0.05}, duration_s=3.0), []
    stamps, told = ComingStamps(plan.ordered(), ahead_s), {}
    for t in asked_s:
        for stamp_ns, sensors in stamps.until(t, prepared.extend):
            assert stamp_ns <= t * 1e9
            assert not told or ahead_s == 0 or (stamp_ns, sensors) in prepared or stamp_ns > 2.8e9
            told[stamp_ns] = sensors
        assert max((stamp_ns for stamp_ns, _ in prepared), default=0.0) <= (t + ahead_s + 0.1) * 1e9
    due = [event for event in events_of(plan) if event.stamp_ns <= max(asked_s, default=-1.0) * 1e9]
    assert list(told) == sorted({event.stamp_ns for event in due})
    assert all(event.sensor in told[event.stamp_ns] for event in due)
    assert [stamp_ns for stamp_ns, _ in prepared] == sorted({stamp_ns for stamp_ns, _ in prepared})


def test_stamps_do_not_drift():
    last = events_of(schedule({"rate_hz": 30, "phase_s": 0.01}, duration_s=3600))[-1]
    assert last.stamp_ns == round((0.01 + 107_999 / 30) * 1e9)


def test_sensors_are_taken_in_order_of_time_then_of_listing():
    plan = schedule({"rate_hz": 10}, {"rate_hz": 5}, {"rate_hz": 10, "phase_s": 0.05})
    order = [(event.stamp_ns, event.sensor) for event in events_of(plan)]
    assert order == sorted(order)
    assert [name for _, name in order[:4]] == ["s0", "s1", "s2", "s0"]
    world = FakeWorld()
    list(plan.observe(world))
    assert world.asked == sorted(world.asked)


def test_a_snapshot_is_of_the_stamp_and_of_each_instant_of_a_sweep():
    sweeping = Clock(instants_s=(0.0, 0.01, 0.02))
    plan = Schedule([Scheduled(sweeping, Timing(rate_hz=2, phase_s=0.1), np.random.default_rng(0))], 1.0)
    world = FakeWorld()
    deliveries = list(plan.observe(world))
    assert world.asked == [0.1, 0.1 + 0.01, 0.1 + 0.02, 0.6, 0.6 + 0.01, 0.6 + 0.02]
    # A sweep is complete with its last instant.
    assert [delivery.arrival_ns for delivery in deliveries] == [120_000_000, 620_000_000]


def test_readings_come_in_order_of_arrival():
    plan = schedule({"rate_hz": 10, "delay_s": 0.25}, {"rate_hz": 20})
    deliveries = arrivals(plan)
    times = [delivery.arrival_ns for delivery in deliveries]
    assert times == sorted(times)
    assert len(deliveries) == 30
    assert [delivery.reading.observation.sensor for delivery in deliveries[:6]] == ["s1"] * 5 + ["s0"]
    slow = [delivery for delivery in deliveries if delivery.reading.observation.sensor == "s0"]
    assert all(delivery.arrival_ns - delivery.stamp_ns == 250_000_000 for delivery in slow)


def test_of_two_that_arrive_together_the_earlier_measured_comes_first():
    plan = schedule({"rate_hz": 10}, {"rate_hz": 10, "delay_s": 0.1})
    together = [
        (delivery.arrival_ns, delivery.stamp_ns) for delivery in arrivals(plan) if delivery.arrival_ns == 300_000_000
    ]
    assert together == [(300_000_000, 200_000_000), (300_000_000, 300_000_000)]


def test_jitter_delays_within_its_bound():
    plan = schedule({"rate_hz": 100, "delay_s": 0.02, "jitter_s": 0.03}, duration_s=20)
    late = np.array([event.arrival_ns - event.stamp_ns for event in events_of(plan)]) / 1e9
    assert late.min() >= 0.02
    assert late.max() <= 0.05
    assert late.mean() == pytest.approx(0.035, abs=0.001)
    deliveries = arrivals(plan)
    assert len(deliveries) == 2000
    stamps = [delivery.stamp_ns for delivery in deliveries]
    assert stamps != sorted(stamps)  # a jitter of three periods lets later ones overtake


def test_dropout_loses_its_share_and_asks_nothing_of_the_world():
    plan = schedule({"rate_hz": 100, "dropout": 0.3}, duration_s=20)
    lost = np.array([event.dropped for event in events_of(plan)])
    assert lost.mean() == pytest.approx(0.3, abs=0.03)
    world = FakeWorld()
    assert len(list(plan.observe(world))) == len(world.asked) == np.count_nonzero(~lost)
    assert not arrivals(schedule({"rate_hz": 10, "dropout": 1.0}))


def test_the_same_again():
    def make() -> Schedule:
        return schedule({"rate_hz": 30, "jitter_s": 0.1, "dropout": 0.2}, {"rate_hz": 7, "jitter_s": 0.2}, duration_s=5)

    plan = make()
    first = arrivals(plan)
    for again in (arrivals(plan), arrivals(make())):
        assert values(first) == values(again)
        assert [one.arrival_ns for one in first] == [other.arrival_ns for other in again]


def test_noise_moves_no_arrival_and_jitter_no_drop_out():
    timing = {"rate_hz": 30, "jitter_s": 0.1, "dropout": 0.2}
    plain = events_of(schedule(timing, duration_s=5))
    noisier = schedule(timing, duration_s=5, draws=50)
    assert [delivery.arrival_ns for delivery in arrivals(noisier)] == sorted(
        event.arrival_ns for event in plain if not event.dropped
    )
    calm = events_of(schedule(timing | {"jitter_s": 0.0}, duration_s=5))
    assert [event.dropped for event in plain] == [event.dropped for event in calm]


def test_another_sensor_changes_no_stream():
    timing = {"rate_hz": 30, "jitter_s": 0.1, "dropout": 0.2}
    alone = arrivals(schedule(timing, duration_s=3))
    among = arrivals(schedule(timing, {"rate_hz": 50, "dropout": 0.5}, duration_s=3))
    kept = [delivery for delivery in among if delivery.reading.observation.sensor == "s0"]
    assert values(alone) == values(kept)


def test_states_are_carried_and_kept_apart():
    counts: dict[str, list[float]] = {"s0": [], "s1": []}
    for delivery in arrivals(schedule({"rate_hz": 10}, {"rate_hz": 5})):
        counts[delivery.reading.observation.sensor].append(float(delivery.reading.observation.ranges_m[1]))
    assert counts == {"s0": [float(n) for n in range(1, 11)], "s1": [float(n) for n in range(1, 6)]}


def test_work_is_done_as_it_is_asked_for():
    """Over a day, a hundred deliveries cost a hundred looks and what is on its way: nothing is prepared or kept."""
    plan = schedule({"rate_hz": 100, "delay_s": 0.05, "jitter_s": 0.02}, {"rate_hz": 10}, duration_s=86_400)
    world = FakeWorld()
    taken = list(itertools.islice(plan.observe(world), 100))
    assert len(taken) == 100
    assert len(world.asked) < 120


def test_no_sensors_and_no_time():
    assert events_of(Schedule([], 10.0)) == []
    assert arrivals(schedule({"rate_hz": 10}, duration_s=0.0)) == []
    assert arrivals(schedule({"rate_hz": 10, "phase_s": 2.0})) == []


def test_a_name_may_stand_only_once():
    twice = [Scheduled(Clock("a"), Timing(rate_hz=1), np.random.default_rng(0)) for _ in range(2)]
    with pytest.raises(ValueError, match="repeat"):
        Schedule(twice, 1.0)


@given(
    rate=st.floats(0.1, 1000),
    phase=st.floats(0, 2),
    delay=st.floats(0, 1),
    jitter=st.floats(0, 1),
    dropout=st.floats(0, 1),
)
def test_whatever_the_timing(rate: float, phase: float, delay: float, jitter: float, dropout: float):
    plan = schedule(
        {"rate_hz": rate, "phase_s": phase, "delay_s": delay, "jitter_s": jitter, "dropout": dropout},
        {"rate_hz": 3},
        duration_s=1.0,
    )
    events = events_of(plan)
    assert [event.stamp_ns for event in events] == sorted(event.stamp_ns for event in events)
    assert all(0 <= event.stamp_ns < 1e9 for event in events)
    deliveries = arrivals(plan)
    assert [delivery.arrival_ns for delivery in deliveries] == sorted(
        event.arrival_ns for event in events if not event.dropped
    )
