"""Gathering the observations of one moment, by declaration."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from trackers.observations import NS_PER_S, FloorFrame, Image, LaserScan, Observation
from trackers.tracking.synced_frames import FrameSynchronizer, SyncedFrame, SyncPolicy

TWO_LAYERS = SyncPolicy(triggers=("waist", "knee"), attached=("camera",))
CAMERAS = ("camera_1", "camera_2", "camera_3", "camera_4")


def seen(sensor: str, t: float) -> Observation:
    ns = round(t * NS_PER_S)
    if sensor.startswith("camera"):
        return Image(sensor, ns, np.zeros((2, 2, 3), np.uint8))
    if sensor == "floor":
        return FloorFrame(sensor, ns, np.zeros((2, 2), np.uint8))
    return LaserScan(sensor, ns, np.ones(3, np.float32), 0.0, 0.1, 0.1, 9.0)


def left(gather: FrameSynchronizer, *arrivals: tuple[str, float]) -> list[SyncedFrame]:
    return [moment for sensor, t in arrivals for moment in gather.add(seen(sensor, t))]


def fed(gather: FrameSynchronizer, *arrivals: tuple[str, float]) -> list[tuple[float, str]]:
    """Moments as (t, sensors) in the order in which they leave."""
    return [told(moment) for moment in left(gather, *arrivals)]


def told(moment: SyncedFrame) -> tuple[float, str]:
    return round(moment.t, 6), "".join(sorted(name[0] for name in moment.observations))


def test_a_moment_leaves_when_its_last_sensor_reports():
    gather = FrameSynchronizer(TWO_LAYERS)
    assert fed(gather, ("waist", 1.0), ("knee", 1.01)) == []
    assert fed(gather, ("camera", 1.04)) == [(1.0, "ckw")]


def test_sensors_may_come_in_any_order_and_the_first_openers_stamp_counts():
    gather = FrameSynchronizer(TWO_LAYERS)
    assert fed(gather, ("camera", 1.03), ("knee", 1.02), ("waist", 1.0)) == [(1.0, "ckw")]


def test_a_silent_sensor_costs_the_waiting_time_and_no_more():
    gather = FrameSynchronizer(TWO_LAYERS)
    arrivals = [(name, round(0.1 * k, 3)) for k in range(20) for name in ("waist", "knee")]
    assert fed(gather, *arrivals) == [(round(0.1 * k, 3), "kw") for k in range(18)]
    assert [round(moment.t, 3) for moment in gather.finish()] == [1.8, 1.9]
    assert gather.losses.total() == 0


@pytest.mark.parametrize("ahead_s", [0.17, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("behind", [("camera",), ("waist", "knee")])
def test_a_sensor_that_stays_behind_is_waited_for_whichever_clock_is_wrong(ahead_s: float, behind: tuple[str, ...]):
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee", "camera"), joined=("waist", "knee")))
    arrivals = [
        (name, round(0.1 * k + (0.0 if name in behind or k < 10 else ahead_s), 3))
        for k in range(60)
        for name in ("waist", "knee", "camera")
    ]
    frames = left(gather, *arrivals) + gather.finish()
    assert [frame.ns for frame in frames] == sorted({frame.ns for frame in frames})
    assert gather.losses.total() <= (3 + 10 * ahead_s) * len(behind)  # until it is known
    for name in behind:
        assert sum(name in frame.observations for frame in frames) >= 56 - 10 * ahead_s


@pytest.mark.parametrize("ahead_s", [0.3, 0.6])
@pytest.mark.parametrize(
    "rules",
    [TWO_LAYERS, SyncPolicy(triggers=("waist", "knee"), latest=("floor",), awaited=("waist", "knee", "floor"))],
    ids=["attached", "latest"],
)
def test_pictures_and_floors_join_frames_of_sensors_that_arrive_before_or_after_them(rules: SyncPolicy, ahead_s: float):
    other = "camera" if rules.attached else "floor"
    for ahead in ({other}, {"waist", "knee"}):
        gather = FrameSynchronizer(rules)
        arrivals = [
            (name, round(0.1 * k + (ahead_s if name in ahead else 0.0), 3))
            for k in range(60)
            for name in ("waist", "knee", other)
        ]
        frames = left(gather, *arrivals) + gather.finish()
        assert sum(other in {*each.observations, *each.latest} for each in frames) >= 50 - 10 * ahead_s


@pytest.mark.parametrize("burst", [1, 4, 7])  # up to a second late
@pytest.mark.parametrize("far_s", [0.0, 3600.0])
def test_bursts_and_a_stamp_of_another_day_cost_a_few_observations(burst: int, far_s: float):
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    arrivals: list[tuple[str, float]] = []
    for k in range(200):
        arrivals.append(("waist", round(0.1 * k + 0.3, 3)))
        if k == 50 and far_s:
            arrivals.append(("waist", far_s))
        if k % burst == burst - 1:
            arrivals += [("knee", round(0.1 * each, 3)) for each in range(k - burst + 1, k + 1)]
    left(gather, *arrivals)
    gather.finish()
    assert gather.losses.total() <= 40


def test_a_sensor_that_falls_silent_after_it_has_lagged_delays_no_frame_for_long():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    arrivals = [
        (name, round(0.1 * k + ahead_s, 3)) for k in range(30) for name, ahead_s in (("waist", 0.9), ("knee", 0.0))
    ]
    fed(gather, *arrivals)
    waits_s = []
    for k in range(30, 100):
        now_s = round(0.1 * k + 0.9, 3)
        waits_s += [now_s - t for t, _ in fed(gather, ("waist", now_s))]
    assert max(waits_s[-20:]) < 0.25


def test_a_sensor_once_late_delays_no_frame():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    arrivals = [(name, 0.1 * k) for k in range(20) for name in ("waist", "knee")]
    fed(gather, *arrivals[:-1])
    assert fed(gather, ("waist", 2.0), ("waist", 2.1), ("knee", 1.9)) == [(1.9, "w")]
    assert gather.losses.total() == 1


def test_a_sensor_whose_clock_is_hours_behind_holds_nobody_up():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    arrivals = [("waist", 3600 + 0.1 * k) if j else ("knee", 0.1 * k) for k in range(20) for j in (1, 0)]
    assert sum("w" in sensors for _, sensors in fed(gather, *arrivals)) >= 17


def test_late_and_double_observations_are_dropped_and_counted():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    assert fed(gather, ("waist", 1.0), ("waist", 1.0)) == []  # twice while it waits
    assert fed(gather, ("knee", 1.0), ("knee", 1.0), ("waist", 0.9), ("waist", 1.0)) == [(1.0, "kw")]
    assert gather.losses.total() == 4
    assert fed(gather, ("waist", 1.1), ("knee", 1.1)) == [(1.1, "kw")]


def test_what_belonged_to_a_moment_that_left_without_it_does_not_open_another():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    assert fed(gather, ("waist", 1.0), ("waist", 1.1), ("waist", 1.2)) == [(1.0, "w")]
    assert fed(gather, ("knee", 1.02)) == []
    assert gather.losses.total() == 1


def test_moments_leave_in_order_even_if_a_later_one_is_whole_first():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist", "knee")))
    assert fed(gather, ("waist", 1.0), ("waist", 1.1), ("knee", 1.1), ("knee", 1.0)) == [(1.0, "kw"), (1.1, "kw")]


def test_what_joins_no_moment_is_dropped_in_the_end():
    gather = FrameSynchronizer(TWO_LAYERS)
    assert fed(gather, *[("camera", 0.1 * k) for k in range(50)]) == []
    assert gather.losses.total() == 48  # the last two may still find their scan
    assert gather.finish() == []
    assert gather.losses.total() == 50


@pytest.mark.parametrize(("main", "t"), [(None, 0.98), ("knee", 0.98), ("waist", 1.0), ("camera", 1.03)])
def test_a_moment_takes_the_stamp_of_the_sensor_that_is_stated(main, t):
    rules = SyncPolicy(triggers=("knee", "waist"), attached=("camera",), main=main)
    for order in (("knee", "waist", "camera"), ("camera", "waist", "knee")):
        stamps = {"knee": 0.98, "waist": 1.0, "camera": 1.03}
        (moment,) = left(FrameSynchronizer(rules), *((name, stamps[name]) for name in order))
        assert moment.ns == round(t * NS_PER_S)
        assert {name: each.t for name, each in moment.observations.items()} == stamps


def test_a_fast_scanner_opens_a_moment_for_every_scan():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist",)))
    moments = fed(gather, *[("waist", 0.025 * k) for k in range(8)])
    assert [t for t, _ in moments] == [pytest.approx(0.025 * k) for k in range(8)]


def test_sensors_that_are_not_named_are_ignored():
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist",)))
    assert fed(gather, ("knee", 1.0)) == []
    assert gather.losses.total() == 0


def test_three_scanners_half_a_period_apart_are_of_one_moment_each_time():
    gather = FrameSynchronizer(SyncPolicy(triggers=("a", "b", "c"), max_wait_s=0.1))
    arrivals = sorted(
        (round(0.04 * k + phase, 3), name)
        for k in range(25)
        for name, phase in zip("abc", (0, 0.02, 0.01), strict=True)
    )
    moments = [*left(gather, *((name, t) for t, name in arrivals)), *gather.finish()]
    assert all(later.ns - earlier.ns == 0.04 * NS_PER_S for earlier, later in pairwise(moments[2:]))
    assert all(sorted(moment.observations) == ["a", "b", "c"] for moment in moments[2:-1])
    assert gather.losses.total() == 0


def test_scanners_faster_than_declared_that_miss_scans_never_make_two_moments_of_one_stamp():
    rng = np.random.default_rng(4)
    gather = FrameSynchronizer(SyncPolicy(triggers=("west", "east")))
    arrivals = [
        (name, round(0.04 * k, 3)) for k in range(100) for name in ("west", "east") if k < 4 or rng.random() > 0.2
    ]
    moments = [*left(gather, *arrivals), *gather.finish()]
    assert sum(len(moment.observations) for moment in moments) == len(arrivals)
    assert all(earlier.ns < later.ns for earlier, later in pairwise(moments))
    assert all(each.stamp_ns == moment.ns for moment in moments[4:] for each in moment.observations.values())


@pytest.mark.parametrize("seed", range(60))
def test_moments_of_any_rates_have_stamps_that_grow_and_hold_all_but_a_few_scans(seed):
    rng = np.random.default_rng(seed)
    names = [f"laser_{k}" for k in range(rng.integers(1, 5))]
    alike, loss = rng.random() < 0.5, rng.choice([0.0, 0.1, 0.3])
    rates = rng.choice([4, 5, 7.5, 9.97, 10, 12.5, 20, 40], len(names))
    arriving = []
    for name, rate_hz in zip(names, rates[[0] * len(names)] if alike else rates, strict=True):
        t = np.arange(1, 4 * rate_hz) / rate_hz + rng.uniform(0, 0.002, int(np.ceil(4 * rate_hz)) - 1)
        arriving += [seen(name, float(at)) for at in t[rng.random(t.size) >= loss]]
    arriving.sort(key=lambda each: each.stamp_ns)
    gatherer = FrameSynchronizer(SyncPolicy(tuple(names), main=str(rng.choice(names))))
    moments = [moment for each in arriving for moment in gatherer.add(each)] + gatherer.finish()
    assert all(before.ns < after.ns for before, after in pairwise(moments))
    n_held = sum(len(moment.observations) for moment in moments)
    assert n_held + gatherer.losses.total() == len(arriving)
    assert gatherer.losses.total() <= 0.02 * len(arriving) + 1


def test_a_first_picture_that_is_lost_makes_no_two_moments_of_one_stamp():
    names = ("a", "b", "c")
    gatherer = FrameSynchronizer(SyncPolicy(names, latest=("floor",), main="a", awaited=(*names, "floor")))
    arriving = [
        seen("b", 0.0),
        seen("c", 0.0),
        *(seen(name, t) for t in (0.05, 0.1, 0.15, 0.2, 0.25) for name in names),
    ]
    moments = [moment for each in arriving for moment in gatherer.add(each)] + gatherer.finish()
    assert [round(moment.t, 3) for moment in moments] == [0.0, 0.05, 0.1, 0.15, 0.2, 0.25]
    assert [len(moment.observations) for moment in moments] == [2, 3, 3, 3, 3, 3]


def test_cameras_alone_make_a_moment_of_four_pictures():
    gather = FrameSynchronizer(SyncPolicy(triggers=CAMERAS, period_s=0.05))
    arrivals = [(name, round(0.05 * k, 3)) for k in range(10) for name in CAMERAS]
    assert fed(gather, *arrivals) == [(round(0.05 * k, 3), "cccc") for k in range(10)]


def test_a_floor_alone_makes_a_moment_of_each_frame():
    gather = FrameSynchronizer(SyncPolicy(triggers=("floor",)))
    assert fed(gather, *[("floor", 0.1 * k) for k in range(5)]) == [(round(0.1 * k, 6), "f") for k in range(5)]


PERIOD_S = 1 / 4.5
PHASES = dict(zip(CAMERAS, (0.0, 0.2, 0.45, 0.7), strict=True))
STAGGERED = sorted((PERIOD_S * (k + phase), name) for k in range(12) for name, phase in PHASES.items())


def test_pictures_taken_one_after_another_join_the_nearest_moment_with_their_own_stamps():
    rules = SyncPolicy(triggers=CAMERAS[:1], attached=CAMERAS[1:], period_s=PERIOD_S, max_wait_s=PERIOD_S)
    gather = FrameSynchronizer(rules)
    moments = left(gather, *((name, t) for t, name in STAGGERED))
    assert [moment.ns for moment in moments[:9]] == [round(PERIOD_S * k * NS_PER_S) for k in range(9)]
    for moment in moments[2:9]:
        off_s = {name: each.t - moment.t for name, each in moment.observations.items()}
        expected = {name: PERIOD_S * (phase - (phase > 0.5)) for name, phase in PHASES.items()}
        assert off_s == pytest.approx(expected, abs=1e-8)
    assert gather.losses.total() == 0


def test_pictures_may_each_be_a_moment_of_their_own_those_of_one_stamp_together():
    rules = SyncPolicy(triggers=CAMERAS, joined=(), max_wait_s=0.06)
    gather = FrameSynchronizer(rules)
    moments = [*left(gather, *((name, t) for t, name in STAGGERED)), *gather.finish()]
    assert [(moment.t, *moment.observations) for moment in moments] == [
        (pytest.approx(t, abs=1e-8), name) for t, name in STAGGERED
    ]
    gather = FrameSynchronizer(rules)
    at_once = [(name, 0.2 * k) for k in range(5) for name in CAMERAS]
    assert fed(gather, *at_once) == [(round(0.2 * k, 6), "cccc") for k in range(5)]


BESIDE_A_FLOOR = SyncPolicy(triggers=CAMERAS[:2], latest=("floor",), period_s=0.05)


def test_a_slower_floor_is_held_the_newest_that_is_not_after_the_moment():
    gather = FrameSynchronizer(BESIDE_A_FLOOR)
    arrivals = [
        (name, round(0.05 * k, 3))
        for k in range(10)
        for name in ("floor", *CAMERAS[:2])
        if name != "floor" or k % 2 == 0
    ]
    moments = left(gather, *arrivals)
    assert [moment.t for moment in moments] == [pytest.approx(0.05 * k) for k in range(10)]
    assert [moment.latest["floor"].t for moment in moments] == [pytest.approx(0.1 * (k // 2)) for k in range(10)]
    assert not any("floor" in moment.observations for moment in moments)


def test_newest_is_by_stamp_not_by_arrival_and_late_or_double_values_are_counted():
    gather = FrameSynchronizer(BESIDE_A_FLOOR)
    both = [("camera_1", 1.0), ("camera_2", 1.0)]
    (moment,) = left(gather, ("floor", 0.95), ("floor", 0.9), ("floor", 0.95), ("floor", 1.02), *both)
    assert moment.latest["floor"].t == 0.95  # the one at 1.02 is of a later moment
    assert gather.losses.total() == 1
    (moment,) = left(gather, ("floor", 0.94), ("floor", 0.95), ("camera_1", 1.05), ("camera_2", 1.05))
    assert moment.latest["floor"].t == 1.02
    assert gather.losses.total() == 3


def test_a_floor_that_has_not_spoken_yet_holds_nobody_up():
    gather = FrameSynchronizer(BESIDE_A_FLOOR)
    (moment,) = left(gather, ("camera_1", 1.0), ("camera_2", 1.0))
    assert moment.latest == {}


def test_an_awaited_floor_is_waited_for_and_no_longer_than_said():
    rules = replace(BESIDE_A_FLOOR, awaited=(*CAMERAS[:2], "floor"), max_wait_s=0.08)
    gather = FrameSynchronizer(rules)
    both = [("camera_1", 1.0), ("camera_2", 1.0)]
    assert left(gather, ("floor", 0.9), *both) == []
    (moment,) = left(gather, ("floor", 1.0))
    assert moment.latest["floor"].t == 1.0
    assert left(gather, ("camera_1", 1.05), ("camera_2", 1.05)) == []
    assert left(gather, ("camera_1", 1.1), ("camera_2", 1.1)) == []
    (moment,) = left(gather, ("camera_1", 1.15))
    assert (moment.t, moment.latest["floor"].t) == (1.05, 1.0)


@pytest.mark.parametrize("times", [2, 3])
def test_scans_that_a_driver_publishes_again_make_no_frames(times):
    rng = np.random.default_rng(0)
    ranges_m = rng.normal(3.0, 0.01, (40, 100)).astype(np.float32)
    stream = [
        LaserScan("waist", 10**8 * k // times, ranges_m[k // times], 0.0, 0.01, 0.1, 9.0) for k in range(40 * times)
    ]
    gather = FrameSynchronizer(SyncPolicy(triggers=("waist",)))
    frames = [frame for each in stream for frame in gather.add(each)] + gather.finish()
    assert [frame.ns for frame in frames if frame.ns > 6 * 10**8] == [10**8 * k for k in range(7, 40)]


def test_values_are_held_in_bounded_memory_while_no_moment_opens():
    gather = FrameSynchronizer(BESIDE_A_FLOOR)
    left(gather, *[("floor", 0.1 * k) for k in range(1000)])
    assert len(gather._latest["floor"]) <= 3
    (moment,) = left(gather, ("camera_1", 99.95), ("camera_2", 99.95))
    assert moment.latest["floor"].t == pytest.approx(99.9)


@pytest.mark.parametrize(
    ("rules", "complaint"),
    [
        ({"triggers": ()}, "no sensor triggers a frame"),
        ({"triggers": ("a",), "attached": ("a",)}, "twice"),
        ({"triggers": ("a",), "latest": ("b",), "main": "b"}, "main is 'b'"),
        ({"triggers": ("a",), "awaited": ("a", "c")}, "awaited are c"),
    ],
)
def test_a_declaration_that_makes_no_sense_is_refused(rules, complaint):
    with pytest.raises(ValueError, match=complaint):
        SyncPolicy(**rules)


@pytest.mark.parametrize("order", [1, -1])
def test_joined_scanners_make_one_moment_and_pictures_keep_their_own_stamps(order):
    """Scans 20 ms apart are of one moment, though a picture is stamped between them, which a load of its stamp joins."""
    rules = SyncPolicy(("east", "west", "camera_1", "floor"), main="west", joined=("east", "west"))
    arrivals = [
        (name, round(0.1 * k + phase, 3))
        for k in range(12)
        for name, phase in (("east", 0.0), ("camera_1", 0.01), ("west", 0.02), ("floor", 0.01))[::order]
    ]
    gather = FrameSynchronizer(rules)
    moments = [told(each) for each in [*left(gather, *arrivals), *gather.finish()]]
    assert moments == [(round(0.1 * k + t, 3), who) for k in range(12) for t, who in ((0.01, "cf"), (0.02, "ew"))]
    assert gather.losses.total() == 0


def test_the_period_of_joined_sensors_is_their_own():
    """A fast camera leaves scanners at 10 Hz half of their period to join."""
    gather = FrameSynchronizer(SyncPolicy(("east", "west", "camera_1"), main="west", joined=("east", "west")))
    arrivals = sorted(
        [(round(0.1 * k + late, 3), name) for k in range(12) for name, late in (("west", 0.0), ("east", 0.04))]
        + [(round(0.02 * k + 0.005, 3), "camera_1") for k in range(60)]
    )
    moments = [told(each) for each in [*left(gather, *((name, t) for t, name in arrivals)), *gather.finish()]]
    assert [each for each in moments if each[1] != "c"] == [(round(0.1 * k, 3), "ew") for k in range(12)]
