"""Gathering the observations of one moment."""

import numpy as np
import pytest

from trackers.epochs import EpochGatherer
from trackers.observations import NS_PER_S, Image, LaserScan

SENSORS = ("waist", "knee", "camera")


def gatherer(awaited=SENSORS, period_s=0.1, max_wait_s=0.15) -> EpochGatherer:
    return EpochGatherer(set(awaited), "waist", period_s, max_wait_s)


def seen(sensor: str, t: float):
    ns = round(t * NS_PER_S)
    if sensor == "camera":
        return Image(sensor, ns, np.zeros((2, 2, 3), np.uint8))
    return LaserScan(sensor, ns, np.ones(3, np.float32), 0.0, 0.1, 0.1, 9.0)


def fed(gather: EpochGatherer, *arrivals: tuple[str, float]) -> list[tuple[float, str]]:
    """Epochs as (t, sensors) in the order in which they leave."""
    return [
        (round(epoch.t, 6), "".join(sorted(name[0] for name in epoch.observations)))
        for sensor, t in arrivals
        for epoch in gather.add(seen(sensor, t))
    ]


def test_an_epoch_leaves_when_its_last_sensor_reports():
    gather = gatherer()
    assert fed(gather, ("waist", 1.0), ("knee", 1.01)) == []
    assert fed(gather, ("camera", 1.04)) == [(1.0, "ckw")]


def test_sensors_may_come_in_any_order_and_the_main_ones_stamp_counts():
    gather = gatherer()
    assert fed(gather, ("camera", 1.03), ("knee", 1.02), ("waist", 1.0)) == [(1.0, "ckw")]


def test_a_silent_sensor_costs_the_waiting_time_and_no_more():
    gather = gatherer()
    arrivals = [(name, round(0.1 * k, 3)) for k in range(20) for name in ("waist", "knee")]
    left = fed(gather, *arrivals)
    assert left == [(round(0.1 * k, 3), "kw") for k in range(18)]
    assert [round(epoch.t, 3) for epoch in gather.finish()] == [1.8, 1.9]
    assert gather.discarded == 0


def test_late_and_double_observations_are_dropped_and_counted():
    gather = gatherer(("waist", "knee"))
    assert fed(gather, ("waist", 1.0), ("waist", 1.0)) == []  # twice while it waits
    assert fed(gather, ("knee", 1.0), ("knee", 1.0), ("waist", 0.9), ("waist", 1.0)) == [(1.0, "kw")]
    assert gather.discarded == 4
    assert fed(gather, ("waist", 1.1), ("knee", 1.1)) == [(1.1, "kw")]


def test_what_belonged_to_an_epoch_that_left_without_it_does_not_open_another():
    gather = gatherer(("waist", "knee"))
    assert fed(gather, ("waist", 1.0), ("waist", 1.1), ("waist", 1.2)) == [(1.0, "w")]
    assert fed(gather, ("knee", 1.02)) == []
    assert gather.discarded == 1


def test_epochs_leave_in_order_even_if_a_later_one_is_whole_first():
    gather = gatherer(("waist", "knee"))
    assert fed(gather, ("waist", 1.0), ("waist", 1.1), ("knee", 1.1), ("knee", 1.0)) == [(1.0, "kw"), (1.1, "kw")]


def test_images_without_a_scan_are_dropped_in_the_end():
    gather = gatherer()
    assert fed(gather, *[("camera", 0.1 * k) for k in range(50)]) == []
    assert gather.discarded == 48  # the last two may still find their scan
    assert gather.finish() == []
    assert gather.discarded == 50


def test_an_epoch_takes_the_main_sensors_stamp():
    gather = gatherer(("waist", "knee"))
    (epoch,) = [epoch for arrival in (("knee", 0.98), ("waist", 1.0)) for epoch in gather.add(seen(*arrival))]
    assert epoch.ns == NS_PER_S


def test_a_fast_scanner_opens_an_epoch_for_every_scan():
    gather = gatherer(("waist",))
    left = fed(gather, *[("waist", 0.025 * k) for k in range(8)])
    assert [t for t, _ in left] == [pytest.approx(0.025 * k) for k in range(8)]


def test_sensors_that_are_not_awaited_are_ignored():
    gather = gatherer(("waist",))
    assert fed(gather, ("knee", 1.0)) == []
    assert gather.discarded == 0
