"""LaserScan messages as drivers write them: sectors of a turn, and fields without a value."""

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tests.twin.recording.recorded import a_scan, write_ros2_bag
from trackers.errors import InputError
from trackers.observations import LaserScan
from trackers.rig import LaserSensor, OdometrySensor, Rig
from twin.recording.decoding import with_limits
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import LASER_SCAN, encode, time_message
from twin.recording.ros.scan_messages import RangeUnits, StandingScanners, joined, turns
from twin.run.feed import write_detections

MS = 10**6
RIG = Rig(sensors={"waist": LaserSensor(topic="/high", role="waist")})
PERIOD_NS = 100 * MS


def sectors_of(scan: LaserScan, cuts: list[int]) -> list[LaserScan]:
    """Cut a scan before these beams, as a driver does that publishes each packet."""
    beam_s = scan.sweep_time_s / (scan.ranges_m.size - 1)
    parts = np.split(np.arange(scan.ranges_m.size), cuts)
    return [
        replace(
            scan,
            stamp_ns=scan.stamp_ns + round(part[0] * beam_s * 1e9),
            ranges_m=scan.ranges_m[part],
            angle_min_rad=scan.angle_min_rad + part[0] * scan.angle_increment_rad,
            sweep_time_s=beam_s * (part.size - 1),
        )
        for part in parts
    ]


def a_turn(n: int, span_rad: float, step_sign: int, stamp_ns: int = 0) -> LaserScan:
    ranges_m = np.random.default_rng(n + stamp_ns // MS).uniform(0.5, 5, n).astype(np.float32)
    step_rad = step_sign * span_rad / n
    return LaserScan("waist", stamp_ns, ranges_m, -0.5 * span_rad * step_sign, step_rad, 0.1, 8.0, 0.08)


def beams(scans: list[LaserScan]) -> Any:
    return np.array([[each.angle_min_rad, each.angle_increment_rad, each.ranges_m.size] for each in scans])


@given(
    st.integers(30, 400),
    st.floats(1.5, 2 * np.pi),
    st.sampled_from([-1, 1]),
    st.integers(1, 12),
    st.integers(0, 2**16),
)
def test_sectors_of_any_turn_are_found_and_give_the_turn_again(n, span_rad, sign, n_cut, seed):
    rng = np.random.default_rng(seed)
    cuts = sorted(rng.choice(np.arange(1, n), min(n_cut, n // 3), replace=False).tolist())
    whole = [a_turn(n, span_rad, sign, k * PERIOD_NS) for k in range(5)]
    messages = [sector for scan in whole for sector in sectors_of(scan, cuts)]
    found = turns(beams(messages), np.array([each.stamp_ns for each in messages]))
    assert found is not None
    assert found.tolist() == np.repeat(np.arange(5), len(cuts) + 1).tolist()
    again = joined(messages[: len(cuts) + 1])
    np.testing.assert_array_equal(again.ranges_m, whole[0].ranges_m)
    np.testing.assert_allclose(again.angles_rad, whole[0].angles_rad, rtol=0, atol=1e-9)
    assert again.stamp_ns == whole[0].stamp_ns
    if messages[0].sweep_time_s:
        assert again.sweep_time_s == pytest.approx(whole[0].sweep_time_s)


@given(st.integers(3, 400), st.floats(0.5, 2 * np.pi), st.sampled_from([-1, 1]), st.floats(0, 3))
def test_whole_scans_are_not_joined_whatever_beams_they_have(n, span_rad, sign, jitter):
    rng = np.random.default_rng(n)
    scans = beams([a_turn(n, span_rad, sign, k * PERIOD_NS) for k in range(30)])
    scans[:, 0] += jitter * rng.random(30) * abs(scans[0, 1])
    scans[:, 2] += rng.integers(0, 3, 30)
    assert turns(scans, np.arange(30) * PERIOD_NS) is None


@pytest.mark.parametrize("lost", [[], [7], [0, 1, 2], [9, 22, 23, 40]])
@pytest.mark.parametrize("stamped", ["by sector", "by turn"])
def test_a_bag_of_sectors_gives_its_turns_with_gaps_where_sectors_were_lost(tmp_path, lost, stamped):
    start_ns, n, cuts = 1_700_000_000 * 10**9, 360, [90, 180, 270]
    whole = [a_turn(n, 2 * np.pi, 1, start_ns + k * PERIOD_NS) for k in range(12)]
    messages = []
    for k, sector in enumerate(each for scan in whole for each in sectors_of(scan, cuts)):
        message: Any = TYPESTORE.deserialize_cdr(encode(sector).data, LASER_SCAN)
        said_ns = whole[k // 4].stamp_ns if stamped == "by turn" else sector.stamp_ns
        header = replace(message.header, stamp=time_message(said_ns))
        if k not in lost:
            messages.append(("/high", LASER_SCAN, sector.stamp_ns + 20 * MS, replace(message, header=header)))
    write_ros2_bag(tmp_path / "bag", messages)
    recording = Recording(tmp_path / "bag", RIG)
    scans = list(recording.observations())
    assert len(scans) == 12
    assert not any("stamp" in line for line in lines(recording.losses))
    for k, (scan, full) in enumerate(zip(scans, whole, strict=True)):
        assert isinstance(scan, LaserScan)
        kept = [number for number in range(4) if 4 * k + number not in lost]
        expected = np.concatenate([full.ranges_m[90 * each : 90 * each + 90] for each in kept])
        np.testing.assert_array_equal(scan.ranges_m[np.isfinite(scan.ranges_m)], expected)
    first_ns = scans[0].stamp_ns
    gaps = np.diff([each.stamp_ns - first_ns for each in scans[1:]])
    assert np.abs(gaps - PERIOD_NS).max() <= 70 * MS  # a turn that lost its first sector begins with its second


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((field, np.nan) for field in ("time_increment", "range_min", "range_max")),
        ("time_increment", 1.0),
        ("time_increment", -1.0),
        ("range_min", -1.0),
        ("range_max", 0.0),
        ("range_max", -1.0),
        ("angle_max", 0.0),
    ],
)
def test_a_field_without_a_value_is_told_and_the_scans_are_used(tmp_path, field, value):
    messages = []
    for k in range(20):
        message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(k * PERIOD_NS)).data, LASER_SCAN)
        messages.append(("/high", LASER_SCAN, k * PERIOD_NS, replace(message, **{field: value})))
    write_ros2_bag(tmp_path / "bag", messages)
    recording = Recording(tmp_path / "bag", RIG)
    assert len(list(recording.observations())) == 20
    assert [
        f"20 of 20 messages have fields without a usable value, the first at 0.00 s: {field} {value:g}" in line
        for line in lines(recording.losses)
    ] == [True]


@given(st.integers(2, 400), st.floats(-7, 7), st.floats(0.001, 0.1), st.sampled_from([-1, 1]), st.integers(-1, 1))
def test_bearings_are_doubted_only_where_angle_max_is_no_matter_of_counting(n, start, step, sign, counted):
    message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(0)).data, LASER_SCAN)
    step = min(step, 6 / n)
    end = start + sign * step * (n - 1 + counted)
    said = replace(message, angle_min=start, angle_increment=sign * step, ranges=np.ones(n, np.float32), angle_max=end)
    assert with_limits(said)[1] == ""
    assert with_limits(replace(said, angle_max=end + 2 * np.pi))[1] == ""
    assert "angle_max" in with_limits(replace(said, angle_max=end + 3 * step * sign))[1]


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize("beyond", [1.0, np.inf])
def test_a_bag_of_ranges_in_another_unit_is_refused_and_far_ones_are_read(tmp_path, unit, beyond):
    """Far: 120 m, as scanners out of doors see."""
    messages = []
    for k in range(20):
        message: Any = TYPESTORE.deserialize_cdr(encode(a_scan(k * PERIOD_NS)).data, LASER_SCAN)
        ranges = np.where(np.arange(31) % 5 == 0, beyond, np.where(unit == 1, 120.0, 2.4)) * unit
        changed = {"ranges": ranges.astype(np.float32), "range_min": 0.05 * unit, "range_max": 200 * unit}
        messages.append(("/high", LASER_SCAN, k * PERIOD_NS, replace(message, **changed)))
    write_ros2_bag(tmp_path / "bag", messages)
    recording = Recording(tmp_path / "bag", RIG)
    if unit == 1:
        assert len(list(recording.observations())) == 20
        return
    with pytest.raises(
        InputError, match=r"topic /high: .*the median range is 2400 m; ranges and limits in m are expected"
    ):
        list(recording.observations())


def room_scans(unit: float, width_m: float | None, half_m: float = 3.0) -> list[LaserScan]:
    """Scans of a square room, and of a round body that crosses it in front of the scanner (None: nobody)."""
    angles = np.radians(np.arange(-135.0, 135.0, 0.5))
    walls = half_m / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    scans = []
    for k in range(60):
        ranges = walls.copy()
        if width_m is not None:
            x, y, radius = 2.0, -2.0 + 4.0 * k / 59, width_m / 2
            along = x * np.cos(angles) + y * np.sin(angles)
            inside = radius**2 - (x**2 + y**2 - along**2)
            hit = (inside > 0) & (along > 0)
            ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(inside[hit]))
        noisy = ranges + np.random.default_rng(k).normal(0, 0.01, ranges.size)
        scans.append(
            LaserScan(
                "waist",
                2 * k * PERIOD_NS,
                (unit * noisy).astype(np.float32),
                float(angles[0]),
                float(np.radians(0.5)),
                0.05 * unit,
                30.0 * unit,
                0.0,
            )
        )
    return scans


MOUNTED = Rig(sensors={"waist": LaserSensor(topic="/high", mounted_on="base"), "base": OdometrySensor(topic="/odom")})


@pytest.mark.parametrize("rig", [RIG, MOUNTED])
@pytest.mark.parametrize("width_m", [None, 0.15, 0.5])
@pytest.mark.parametrize("unit", [1.0, 39.37, 100.0])
def test_ranges_wholly_in_another_unit_are_told(unit: float, width_m: float | None, rig: Rig) -> None:
    units = RangeUnits(rig)
    for scan in room_scans(unit, width_m):
        units.add(scan)
    said = units.warnings()
    assert units.warnings({"waist"}) == {}
    if unit == 1:
        assert said == {}
        return
    assert said["waist"].endswith("; ranges and limits in m are expected, not in cm or inches")
    is_seen = width_m is not None and rig is RIG
    assert ("what moves is " if is_seen else "sees nothing nearer than ") in said["waist"]


TURNS = {
    "stands": lambda t_s: 0.0,
    "shakes": lambda t_s: 0.5 * (-1) ** round(5 * t_s),
    "slips": lambda t_s: 20.0 * (t_s > 6),
    "slips back": lambda t_s: -35.0 * (5 < t_s < 9),
    "turns": lambda t_s: 11.0 * t_s,
}
"""Yaw of a scanner [degrees] over time."""


@pytest.mark.parametrize("how", TURNS)
def test_a_scanner_that_turns_unsaid_is_told(how: str) -> None:
    scanners, carried = StandingScanners(RIG), StandingScanners(MOUNTED)
    for scan in room_scans(1.0, 0.5):
        way = np.exp(1j * (scan.angles_rad + 1e-3 + np.radians(TURNS[how](scan.stamp_ns / 1e9))))
        x, y = np.where(way.real > 0, 12.0, 1.0), np.where(way.imag > 0, 5.0, 2.2)
        walls = np.minimum(x / np.abs(way.real), y / np.abs(way.imag))
        seen = replace(scan, ranges_m=np.where(scan.ranges_m < 2.9, scan.ranges_m, walls).astype(np.float32))
        scanners.add(seen)
        carried.add(seen)
    assert carried.warnings() == scanners.warnings({"waist"}) == []
    starts = [each[:50] for each in scanners.warnings()]
    assert starts == ["waist: seems to turn, though it is said to stand: "] * (how not in ("stands", "shakes"))


def test_a_scanner_whose_surroundings_never_come_again_is_told() -> None:
    scanners = StandingScanners(RIG)
    for scan in room_scans(1.0, None):
        scanners.add(replace(scan, ranges_m=scan.ranges_m + np.float32(1.2e-9 * scan.stamp_ns)))
    (line,) = scanners.warnings()
    assert line.startswith(
        "waist: seems to move, though it is said to stand: in half of 11 scans, one a second, at most "
    )


@pytest.mark.parametrize("empty", [np.inf, np.nan, 0.0, -100.0])
def test_a_scanner_with_people_alone_around_it_is_not_told(empty: float) -> None:
    """As in the open, farther from all walls than it sees: people are elsewhere in each scan."""
    rng, scanners = np.random.default_rng(0), StandingScanners(RIG)
    for scan in room_scans(1.0, None):
        ranges, angles = np.full(scan.ranges_m.size, empty), scan.angles_rad
        for x, y in rng.uniform(-8, 8, (20, 2)):
            gap = np.abs(np.angle(np.exp(1j * (angles - np.arctan2(y, x)))))
            ranges[gap < 0.2 / np.hypot(x, y)] = np.hypot(x, y)
        scanners.add(replace(scan, ranges_m=ranges.astype(np.float32)))
    assert scanners.warnings() == []


@pytest.mark.parametrize("n_beam", [0, 1, 2, 3])
def test_a_scanner_of_too_few_beams_to_show_anybody_is_told(n_beam: int) -> None:
    checks = RangeUnits(RIG)
    for scan in room_scans(1.0, 0.5)[:9]:
        checks.add(replace(scan, ranges_m=scan.ranges_m[270 : 270 + n_beam]))
    said = {1: "waist: has 1 beam in a scan, of which 3 side", 2: "waist: has 2 beams in a scan, of which 3 side"}
    assert checks.warnings().get("waist", "").startswith(said.get(n_beam, "")) and bool(checks.warnings()) == (
        n_beam in said
    )


def test_of_a_scanner_with_another_unit_nothing_else_is_told(tmp_path) -> None:
    """In metres by its limits' word, a beam is 2.6 m from the next where the walls are."""
    messages = []
    for scan in room_scans(100.0, 0.5):
        moved = encode(replace(scan, stamp_ns=scan.stamp_ns + 10**18))
        messages.append(("/high", LASER_SCAN, moved.observation.stamp_ns, moved.data))
    write_ros2_bag(tmp_path / "bag", messages)
    warned: list[str] = []
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG.dump_yaml())
    write_detections(tmp_path / "bag", io.StringIO(), tracker="sort", rig=rig, on_warning=warned.append)
    (about,) = [each for each in warned if each.startswith("waist: ")]
    assert "what moves is " in about
