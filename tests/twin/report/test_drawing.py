"""Mapping, colours and spans of time: the arithmetic under the pictures."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, strategies as st
from synthetic_run import laboratory, room

from trackers.observations import LaserScan
from trackers.rig import LaserSensor, Pose, Rig
from twin.report.birdseye import FloorView, ScannerOnFloor, floor_extent, room_svg, sensor_names_svg, svg_path
from twin.report.palette import IDENTITY_COLOURS, IdentityColours, SvgLabels
from twin.report.time_axis import (
    Span,
    format_minutes,
    format_time,
    median_period_ns,
    round_ticks,
    spans_of,
    split_at_gaps,
    subtract_spans,
    time_origin_ns,
)


def test_view_shows_the_extent_centred_at_one_scale() -> None:
    view = FloorView.fit(np.array([[-2.1, 0.0], [2.1, 2.0]]), 500, 400)
    assert view.scale == pytest.approx(100)
    np.testing.assert_allclose(
        view.pixels(np.array([[0.0, 1.0], [-2.5, 1.0], [0.0, 2.0]])), [[250, 200], [0, 200], [250, 100]]
    )


@pytest.mark.parametrize("side_m", [3.0, 40.0, 1e4, 1e7, 3e38])
def test_metre_lines_are_few_however_large_the_floor(side_m: float) -> None:
    view = FloorView.fit(np.array([[-side_m, 0.0], [side_m, side_m]]), 1000)
    for lines in view.metre_lines():
        assert 2 <= len(lines) <= 1000 / 36 + 1
        step_m = lines[1] - lines[0]
        assert min(abs(step_m / 10.0 ** np.floor(np.log10(step_m * 1.01)) - each) for each in (1, 2, 5)) < 1e-9


def test_extent_without_room_ignores_a_stray_return() -> None:
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan")})
    points = np.concatenate([np.random.default_rng(0).uniform(-3, 3, (500, 2)), [[80.0, 80.0]]])
    assert np.abs(floor_extent(rig, [], points)).max() < 3.1
    assert np.ptp(floor_extent(rig, []), axis=0).min() >= 6.0  # nothing known: the metres around the sensor
    assert floor_extent(laboratory(), room()).max() == pytest.approx(4.4)


def test_scan_reaches_the_floor_through_the_pose() -> None:
    scan = LaserScan("s", 0, np.array([1.0, np.inf, np.nan, 2.0], np.float32), 0.0, np.pi / 2, 0.1, 8.0)
    scanner = ScannerOnFloor(Pose(xyz=(1.0, 0.0, 0.4), rpy=(0.0, 0.0, np.pi / 2)))
    np.testing.assert_allclose(scanner.points(scan), [[1.0, 1.0], [3.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(
        scanner.free_space(scan, 1e3), [[1, 0], [1, 1], [-7, 0], [1, 0], [3, 0]], atol=1e-6
    )  # no return: as far as it sees; invalid: nothing


def test_room_svg_names_things_safely() -> None:
    # a rig's file may not name a sensor so: what draws does not rely on it
    rig = Rig.model_construct(sensors={"<b>": LaserSensor(topic="/scan")}, area=((0, 0), (1, 0), (1, 1)))
    text = room_svg(FloorView.fit(floor_extent(rig, []), 400), rig, room())
    assert "&lt;b&gt;" in text
    assert text.count('class="structure"') == 7 and 'class="glass"' not in text
    text = room_svg(FloorView.fit(floor_extent(rig, []), 400), rig, room(), glass=room()[:2])
    assert text.count('class="glass"') == 2


def test_sensors_on_the_plan_have_their_names() -> None:
    def at(x: float, z: float) -> LaserSensor:
        return LaserSensor(topic=f"/scan_{x}_{z}", room_from_sensor=Pose(xyz=(x, 0.5, z)))

    rig = Rig(sensors={"waist": at(0, 1), "knee": at(0, 0.3), "far-one": at(4, 1)}, area=((0, 0), (4, 0), (4, 1)))
    view = FloorView.fit(floor_extent(rig, []), 400)
    texts = re.findall(
        r'<text class="sensor-name[^>]* x="([0-9.]+)"[^>]*text-anchor="(\w+)">([^<]+)<',
        sensor_names_svg(view, rig, SvgLabels()),
    )
    (left, starts, both), (right, ends, alone) = texts
    assert (both, starts) == ("waist, knee", "start")
    assert (alone, ends) == ("far-one", "end")  # it would leave the picture
    assert 0 < float(left) < float(right) < 400
    near = Rig(sensors={**rig.sensors, "beside": at(0.2, 1), "next": at(0.4, 1)}, area=rig.area)
    rows = re.findall(
        r' y="([0-9.]+)"(?: dy="(-[0-9.]+)em")? [^>]*>(?:beside|next|waist)', sensor_names_svg(view, near, SvgLabels())
    )
    assert len({y for y, _ in rows}) == 1 and len({dy for _, dy in rows}) == 3  # lines of their own, whatever the size


@pytest.mark.parametrize("seed", range(20))
def test_labels_of_a_drawing_keep_apart_however_many_meet(seed: int) -> None:
    rng, labels, boxes = np.random.default_rng(seed), SvgLabels(), []
    for _ in range(12):
        text, x, y = "n" * rng.integers(2, 14), *rng.uniform(0, (150, 60))
        drawn = labels.write("name", text, x, y, rng.choice(["start", "end"]))
        (found,) = re.findall(r' x="([-0-9.]+)" y="([-0-9.]+)"(?: dy="(-[0-9.]+)em")? text-anchor="(\w+)"', drawn)
        left = float(found[0]) - 6.5 * len(text) * (found[3] == "end")
        boxes.append((left, left + 6.5 * len(text), float(found[1]) + 12 * float(found[2] or 0)))
    for k, (left, right, y) in enumerate(boxes):
        for start, end, other in boxes[:k]:
            assert left >= end or start >= right or abs(y - other) > 12


def test_thinned_path_stays_within_a_third_of_a_pixel() -> None:
    t = np.linspace(0, 6, 2000)
    line = np.column_stack([100 * t, 200 + 80 * np.sin(t)])
    kept = np.array([[float(v) for v in p.split()] for p in svg_path(line)[1:].split("L")])
    assert len(kept) < 100
    assert np.abs(np.interp(line[:, 0], kept[:, 0], kept[:, 1]) - line[:, 1]).max() < 0.45


def test_colours_follow_first_appearance() -> None:
    colours = IdentityColours([7, 3])
    assert colours[3] == IDENTITY_COLOURS[1]
    assert colours[100] == IDENTITY_COLOURS[2]
    assert colours[7] == IDENTITY_COLOURS[0]
    assert len({IdentityColours(range(8))[i] for i in range(8)}) == 8 or len(set(IDENTITY_COLOURS)) == 8


def test_times_read_as_people_write_them() -> None:
    assert format_time(12.34, 1) == "12.3 s"
    assert format_time(125.0) == "2:05"
    assert format_time(179.97, 1) == "3:00.0"
    assert format_time(-0.01, 1) == "0.0 s"
    assert format_minutes(60) == "1:00"
    assert time_origin_ns(3_000_000_000) == 0
    assert time_origin_ns(1_700_000_000_000_000_000) == 1_700_000_000_000_000_000
    np.testing.assert_allclose(round_ticks(-0.05, 26.2), np.arange(0, 27, 2))


def test_spans_break_at_gaps_and_labels() -> None:
    stamps = np.array([0, 100, 200, 500, 600])
    assert spans_of(stamps, 100) == [Span(-50, 250), Span(450, 650)]
    assert spans_of(stamps, 100, np.array([1, 1, 2, 2, 2])) == [Span(-50, 150, 1), Span(150, 250, 2), Span(450, 650, 2)]
    assert spans_of(np.zeros(0, np.int64), 100) == []
    assert [piece.tolist() for piece in split_at_gaps(stamps, 100)] == [[0, 1, 2], [3, 4]]
    assert median_period_ns(np.array([0, 1, 100, 101]), np.array([0, 100, 200])) == 100


@given(st.sets(st.integers(0, 40)), st.sets(st.integers(0, 40)))
def test_without_leaves_exactly_what_is_not_covered(whole: set[int], parts: set[int]) -> None:
    def of(samples: set[int]) -> list[Span]:
        return spans_of(np.array(sorted(samples), dtype=np.int64) * 100, 100)

    assert subtract_spans(of(whole), of(parts), 1) == of(whole - parts)
