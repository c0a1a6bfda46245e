"""Where a scan would have shown somebody."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.laser.bearings import DetectionModel, DetectionOptions
from trackers.observations import LaserScan
from trackers.rig import LaserSensor, Pose

WALL_M = 4.0
SURE = DetectionOptions(detected=0.9)


def scan(*nearer: tuple[float, float, float], field_deg: float = 180.0) -> LaserScan:
    """Half a degree a beam, a wall all around at 4 m; nearer: (from, to [deg], range [m])."""
    angles = np.arange(-field_deg / 2, field_deg / 2 + 0.25, 0.5)
    ranges = np.full(angles.size, WALL_M, np.float32)
    for first, last, range_m in nearer:
        ranges[(angles >= first) & (angles <= last)] = range_m
    return LaserScan("waist", 0, ranges, np.deg2rad(angles[0]), np.deg2rad(0.5), 0.05, 8.0)


def seen(at: LaserScan, *points: tuple[float, float], sensor: LaserSensor | None = None, options=SURE) -> list[float]:
    space = DetectionModel(sensor or LaserSensor(topic="/waist"), options)
    return space.seen(at, np.array(points, float).T).tolist()


def test_somebody_before_the_wall_would_be_seen_somebody_behind_it_or_in_it_not():
    assert seen(scan(), (2, 0), (3.8, 0), (4.0, 0), (5, 0)) == [0.9, 0.9, 0, 0]


def test_whoever_stands_behind_somebody_is_hidden_and_half_behind_half():
    before = scan((-10, 10, 1.0))
    edge = 2 * np.tan(np.deg2rad(10))
    hidden, half, clear = seen(before, (2, 0), (2, edge), (2, edge + 0.3))
    assert hidden == 0
    assert 0 < half < 0.9
    assert clear == 0.9


def test_what_stops_the_beams_may_be_the_one_looked_for():
    assert seen(scan((-10, 10, 1.9)), (2.0, 0)) == [0]


@pytest.mark.parametrize(("reading", "expected"), [(np.inf, 0.9), (np.nan, 0.0)])
def test_no_return_is_clear_to_the_end_of_the_range_no_reading_says_nothing(reading, expected):
    assert seen(scan((-90, 90, reading)), (3, 0), (8.5, 0)) == [expected, 0]


def test_beside_and_behind_the_field_of_view_nobody_would_be_seen():
    assert seen(scan(field_deg=90.0), (1, 0.5), (1, 2), (-1, 0)) == [0.9, 0, 0]


def test_a_scan_all_around_sees_behind_too():
    assert seen(scan(field_deg=360.0), (-2, 0), (-2, 1e-3), (-2, -1e-3)) == [0.9, 0.9, 0.9]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_body_across_the_seam_of_a_scan_all_around_is_hidden_on_either_side(side):
    """A third of it is behind what stands just beyond the seam, not behind what the beam at the seam met."""
    before = scan((172, 178, 1.0) if side > 0 else (-178, -172, 1.0), field_deg=360.0)
    across = (-2.0, -side * 2 * np.tan(np.deg2rad(0.6)))
    assert seen(before, across) == [pytest.approx(0.6)]
    assert seen(before, (2.0, 0.0), across) == [0.9, pytest.approx(0.6)]


def test_points_are_in_the_room():
    sensor = LaserSensor(topic="/waist", room_from_sensor=Pose(xyz=(1, 1, 0.9), rpy=(0, 0, np.pi / 2)))
    before = scan((-10, 10, 1.0))  # ahead is the room's +y
    assert seen(before, (1, 3), (3, 1.5), (1, -1), sensor=sensor) == [0, 0.9, 0]


def test_legs_may_hide_a_body_that_beams_pass_by():
    legs = DetectionOptions(detected=0.9, half_width_m=0.25, hidden_up_to=0.5)
    one_leg_covered = scan((3, 12, 1.0))
    assert seen(one_leg_covered, (2, 0), options=legs)[0] < 0.9
    assert seen(scan(), (2, 0), options=legs) == [pytest.approx(0.9)]


@pytest.mark.parametrize("range_m", [2.0, 4.0, 6.0, 7.5])
def test_a_thing_is_seen_as_often_as_enough_beams_fall_on_it(range_m):
    width_m, least, far = 0.08, 2, scan(field_deg=180)
    open_hall = LaserScan(
        "waist", 0, np.full_like(far.ranges_m, 9.0), far.angle_min_rad, far.angle_increment_rad, 0.05, 10.0
    )
    space = DetectionModel(LaserSensor(topic="/waist"), DetectionOptions(detected=0.9, width_m=width_m), least)
    starts = np.random.default_rng(3).uniform(0, 1, 20_000)  # in beams, where the thing begins
    beams = np.floor(starts + width_m / (range_m * open_hall.angle_increment_rad))
    assert space.seen(open_hall, np.array([[range_m], [0.0]]))[0] == pytest.approx(
        0.9 * np.mean(beams >= least), abs=0.01
    )
