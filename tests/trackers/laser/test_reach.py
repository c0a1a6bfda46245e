"""Warnings of scanners that see a place and cannot show people there: beams too far apart, or in the floor."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from trackers.area import Pose
from trackers.laser.reach import ScannerReach
from trackers.observations import NS_PER_S, LaserScan
from trackers.rig import LaserSensor, OdometrySensor, Rig

HALF_M, HIGH_M = 4.0, 2.5
AREA = ((-HALF_M, -HALF_M), (HALF_M, -HALF_M), (HALF_M, HALF_M), (-HALF_M, HALF_M))


def sensor(name: str = "low", height_m: float = 0.3, tilt_deg: float = 0.0, **others) -> LaserSensor:
    """A scanner in the middle of the room, its front dipped."""
    pose = Pose(xyz=(0.0, 0.0, height_m), rpy=(others.pop("roll", 0.0), np.radians(tilt_deg), 0.0))
    return LaserSensor(topic=f"/{name}/scan", room_from_sensor=pose, **others)


def scan(
    of: LaserSensor, step_deg: float, name: str = "low", t_s: float = 0.0, person_m: float | None = None
) -> LaserScan:
    """What it sees of the room, and of a person ahead at a distance."""
    angles = np.radians(np.arange(-180.0, 180.0 - 0.5 * step_deg, step_deg))
    ahead = of.room_from_sensor.rotation[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    with np.errstate(divide="ignore"):
        walls = (HALF_M / np.abs(ahead[:2])).min(axis=0)
        height_m = of.room_from_sensor.xyz[2]
        ends = np.where(ahead[2] < 0, height_m, max(HIGH_M - height_m, 0.5)) / np.abs(ahead[2])
    ranges = np.minimum(walls, ends)
    if person_m is not None:
        ranges[np.abs(angles) <= 0.15 / person_m] = person_m
    return LaserScan(name, round(t_s * NS_PER_S), ranges, float(angles[0]), np.radians(step_deg), 0.05, 30.0, 0.0)


def told(step_deg: float, *, area: tuple | None = AREA, person_m: float | None = None, **of) -> list[str]:
    """What is said of one scanner after two scans, a second apart."""
    mine = sensor(**of)
    reach = ScannerReach(Rig(sensors={"low": mine}, area=area))
    reach.add(scan(mine, step_deg))
    reach.add(scan(mine, step_deg, t_s=1.0, person_m=person_m))
    return reach.warnings()


def test_a_fine_level_scanner_is_not_warned_of() -> None:
    assert told(0.5) == [] and told(0.5, height_m=0.95) == []


@pytest.mark.parametrize("roll", [np.pi, -np.pi, 3.1416])
@pytest.mark.parametrize("height_m", [0.03, 1.8])
def test_a_level_scanner_upside_down_is_not_called_tilted(height_m: float, roll: float) -> None:
    for side in (-1, 1):
        area = ((1.0, side * 1.0), (HALF_M, side * 1.0), (HALF_M, side * HALF_M), (1.0, side * HALF_M))
        assert told(0.5, height_m=height_m, roll=roll, area=area) == []


@pytest.mark.parametrize(("height_m", "body"), [(0.3, "fewer than 2 meet a leg"), (0.95, "fewer than 3 meet a trunk")])
def test_a_coarse_scanner_is_named_with_a_step_that_would_do(height_m: float, body: str) -> None:
    (said,) = told(5.0, height_m=height_m)
    assert said.startswith("low: shows people in ") and "its beams are 5° apart" in said and body in said
    valid_deg = float(re.search(r"; ([\d.]+)° or less is expected here$", said)[1])
    assert told(360 / np.ceil(360 / valid_deg), height_m=height_m) == []
    assert told(360 / np.floor(360 / (1.2 * valid_deg)), height_m=height_m) != []


@pytest.mark.parametrize(("height_m", "tilt_deg"), [(0.3, 10.0), (0.95, 30.0), (0.95, -40.0)])
def test_a_tilted_scanner_is_named_with_a_tilt_that_would_do(height_m: float, tilt_deg: float) -> None:
    mine = sensor(height_m=height_m, tilt_deg=tilt_deg)
    ahead = replace(whole := scan(mine, 0.5), ranges_m=whole.ranges_m[180:541], angle_min_rad=-np.pi / 2)
    reach = ScannerReach(Rig(sensors={"low": mine}, area=AREA))
    reach.add(ahead)
    (said,) = reach.warnings()
    assert f"it is tilted by {abs(tilt_deg):g}°" in said
    assert ("meet the floor" if tilt_deg > 0 else "pass over heads") in said
    valid_deg = float(re.search(r"; ([\d.]+)° or less is expected here$", said)[1])
    assert 0 < valid_deg < abs(tilt_deg)
    better = sensor(height_m=height_m, tilt_deg=np.copysign(valid_deg, tilt_deg))
    whole = scan(better, 0.5)
    reach = ScannerReach(Rig(sensors={"low": better}, area=AREA))
    reach.add(replace(whole, ranges_m=whole.ranges_m[180:541], angle_min_rad=-np.pi / 2))
    assert reach.warnings() == []


def test_another_scanner_that_shows_the_same_places_silences_it() -> None:
    coarse, fine = sensor(), sensor("other")
    reach = ScannerReach(Rig(sensors={"low": coarse, "other": fine}, area=AREA))
    reach.add(scan(fine, 0.5, "other"))
    reach.add(scan(coarse, 5.0))
    assert reach.warnings() == []


def test_another_scanner_that_is_coarse_too_or_on_another_base_does_not() -> None:
    for other, step_deg in ((sensor("other"), 4.0), (sensor("other", mounted_on="base"), 0.5)):
        mine = sensor()
        sensors = {"low": mine, "other": other, "base": OdometrySensor(topic="/odom")}
        reach = ScannerReach(Rig(sensors=sensors, area=AREA))
        reach.add(scan(other, step_deg, "other"))
        reach.add(scan(mine, 5.0))
        assert any(said.startswith("low: ") for said in reach.warnings())


def test_a_level_scanner_above_all_heads_is_told_and_one_at_their_height_is_not() -> None:
    for area in (AREA, None):
        assert told(0.5, height_m=1.7, area=area) == []
        (said,) = told(0.5, height_m=300.0, area=area)
        assert said == "low: hangs 300 m high, over all heads; a height up to 1.5 m is expected"


def test_a_scanner_under_the_ceiling_that_looks_down_at_people_is_not_told() -> None:
    assert (
        told(0.5, height_m=2.4, tilt_deg=40.0) == []
        or "over all heads" not in told(0.5, height_m=2.4, tilt_deg=40.0)[0]
    )


def test_an_area_that_is_elsewhere_is_told() -> None:
    said = "low: sees nothing of the tracked area; another pose, or another area, is expected"
    assert told(0.5, area=((50.0, 50.0), (60.0, 50.0), (60.0, 60.0))) == [said]
    assert told(0.5, area=tuple((1e3 * x + 2e3, 1e3 * y) for x, y in AREA)) == [said]  # in millimetres
    nothing = replace(scan(sensor(), 5.0), ranges_m=np.full(72, np.nan))
    reach = ScannerReach(Rig(sensors={"low": sensor()}, area=AREA))
    reach.add(nothing)
    assert reach.warnings() == []  # that is told as a loss


def test_places_are_those_of_the_area_alone() -> None:
    widening = ((0.0, 0.0), (3.9, 0.0), (3.9, 0.6))  # three quarters of it are beyond the 2 m of a coarse scanner
    (said,) = told(1.5, area=widening)
    assert "beyond 2 m fewer than 2 meet a leg" in said
    assert told(1.5, area=((0.0, 0.0), (3.9, 0.0), (3.9, 0.6), (0.0, 0.6))) == []


def test_scanners_that_no_tracker_uses_are_left_out() -> None:
    mine = sensor()
    reach = ScannerReach(Rig(sensors={"low": mine}, area=AREA))
    reach.add(scan(mine, 5.0))
    assert reach.warnings(["low"]) == [] and len(reach.warnings(["another"])) == 1


def test_without_an_area_the_places_are_those_where_something_moved() -> None:
    assert told(5.0, area=None) == []
    (said,) = told(5.0, area=None, person_m=2.0)
    assert "shows people in 0 % of what it sees" in said
    assert told(5.0, area=None, person_m=0.4) == []  # near by the beams are close together


def test_on_a_moving_base_the_tilt_alone_is_told() -> None:
    sensors = {"base": OdometrySensor(topic="/odom")}
    for of, step_deg, n in ((sensor(mounted_on="base"), 5.0, 0), (sensor(tilt_deg=30, mounted_on="base"), 0.5, 1)):
        reach = ScannerReach(Rig(sensors=sensors | {"low": of}, area=AREA))
        reach.add(scan(of, step_deg))
        reach.add(scan(of, step_deg, t_s=1.0, person_m=2.0))
        assert len(reach.warnings()) == n


def test_beams_in_another_order_or_upside_down_are_judged_alike() -> None:
    mine, under = sensor(), sensor(roll=np.pi)
    whole = scan(mine, 5.0)
    turned = replace(
        whole,
        ranges_m=whole.ranges_m[::-1],
        angle_min_rad=float(whole.angles_rad[-1]),
        angle_increment_rad=-np.radians(5),
    )
    said = told(5.0)
    for of, given in ((mine, turned), (under, scan(under, 5.0))):
        reach = ScannerReach(Rig(sensors={"low": of}, area=AREA))
        reach.add(given)
        assert reach.warnings() == said


@pytest.mark.parametrize("ranges", [[], [1.0], [np.nan] * 72, [np.inf] * 72, [0.0] * 72])
@pytest.mark.parametrize("area", [AREA, None])
def test_scans_of_nothing_are_no_reason(ranges: list[float], area: tuple | None) -> None:
    mine = sensor()
    reach = ScannerReach(Rig(sensors={"low": mine}, area=area))
    for t_s in (0.0, 1.0):
        reach.add(replace(scan(mine, 5.0, t_s=t_s), ranges_m=np.array(ranges, float)))
    assert all("5° apart" in said for said in reach.warnings())


def test_a_vertical_scanner_is_told() -> None:
    assert told(0.5, tilt_deg=90.0) == ["low: scans no layer of people: it is tilted by 90°; 45° or less is expected"]


def pair_of(
    off_m: float = 0.0, yaw_deg: float = 0.0, *, mirrored: bool = False, walls: bool = True, late: bool = False
) -> list[str]:
    """What is said of two scanners after ten looks at a person on a circle; the rig has the second off by this."""
    places = {"low": (0.0, -3.0), "high": (-3.0, 0.0)}
    reach = ScannerReach(
        Rig(
            sensors={
                name: LaserSensor(
                    topic=f"/{name}/scan",
                    room_from_sensor=Pose(
                        xyz=(x + off_m * (name == "high"), y, 0.3),
                        rpy=(0.0, 0.0, np.radians(yaw_deg) * (name == "high")),
                    ),
                )
                for name, (x, y) in places.items()
            },
            area=AREA,
        )
    )
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for second in range(24):
        one = 1.5 * np.array([np.cos(second), np.sin(second)]) * (not late)
        people = [one, one * [1, -1]][: 1 + (mirrored and second % 5 > 1)]  # where a mirror shows them, often
        for name, place in places.items():
            with np.errstate(divide="ignore"):
                ranges = ((HALF_M - np.sign(ways) * place) / np.abs(ways)).min(axis=1)
            for person in people if second else ():  # nobody at first
                along = ways @ (person - place)
                aside = np.abs(ways @ [[0, 1], [-1, 0]] @ (person - place))
                is_hit = (aside < 0.15) & (along > 0)
                ranges[is_hit] = np.minimum(ranges, np.hypot(*(person - place)) - 0.1)[is_hit]
            if late and not second and name == "high":
                continue
            if not walls and name == "high":
                ranges[ranges > 3.5] = np.inf
            ranges = ranges[::-1] if mirrored and name == "high" else ranges
            stamp_ns = second * NS_PER_S + 10**7 * (name == "high")
            reach.add(LaserScan(name, stamp_ns, ranges, float(angles[0]), np.radians(0.5), 0.05, 30.0, 0.0))
    return [each for each in reach.warnings() if "contradicts" in each]


def test_two_scanners_that_agree_are_not_told_and_a_wrong_pose_or_a_mirrored_scan_is() -> None:
    assert pair_of() == [] and pair_of(0.2) == [] and pair_of(yaw_deg=5) == []
    for said in (pair_of(1.0), pair_of(yaw_deg=25), pair_of(yaw_deg=-40), pair_of(mirrored=True)):
        (line,) = said
        assert line.startswith("high: contradicts low: of ") and "metres, radians, upside down" in line


def test_a_scanner_that_sees_nothing_behind_or_knows_nothing_behind_contradicts_nobody() -> None:
    assert pair_of(yaw_deg=25, walls=False) == []
    assert pair_of(late=True) == []


def test_a_scanner_is_not_warned_of_before_the_other_has_scanned_what_it_shows() -> None:
    coarse, fine = sensor("coarse"), sensor("fine")
    reach = ScannerReach(Rig(sensors={"coarse": coarse, "fine": fine}, area=AREA))
    for of, step_deg, name in 2 * [(coarse, 5.0, "coarse"), (fine, 0.5, "fine")]:
        reach.add(scan(of, step_deg, name))
    assert reach.warnings() == []
