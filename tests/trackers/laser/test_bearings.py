"""The same scene through other beams: varying counts, shifted, finer, coarser, clockwise, all around with any seam."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_room import Walk, body, cast, straight_walk

from trackers.errors import InputError
from trackers.laser.background import KnownBackground, LearnedBackground
from trackers.laser.bearings import BearingGrid, DetectionModel, DetectionOptions, beams_of_turn, counter_clockwise
from trackers.laser.layer import KneeOptions, LaserLayer, WaistOptions
from trackers.observations import NS_PER_S, LaserScan
from trackers.rig import LaserSensor, Pose

HALF_DEG = float(np.deg2rad(0.5))
FRONT = (-np.pi / 2, HALF_DEG, 361)
AROUND = (-np.pi, 2 * np.pi / 720, 720)
STANDING = straight_walk([(0.4, 1.5), (-1.1, 1.2), (1.0, 2.6)], [(0, 0), (0, 0), (0, 0)], 1)
ALL_AROUND = straight_walk([(0.4, 1.5), (-1.4, -0.02), (0.9, -1.3)], [(0, 0), (0, 0), (0, 0)], 1)
SENSOR = LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(1.0, -2.0, 0.9), rpy=(0, 0, 0.3)))


def look(walk: Walk | None, beams: tuple[float, float, int], t: float = 0.0, k: int = 0, height="waist") -> LaserScan:
    """A scan of the flat room with these beams (first bearing, step, count), σ 3 mm, by a seed of their own."""
    first, step, count = beams
    angles = first + step * np.arange(count)
    ellipses = (np.empty((0, 2)), np.empty((0, 2)), np.empty(0)) if walk is None else body(walk, k, height)[:3]
    rng = np.random.default_rng([round(t * 1000), count])
    ranges = np.minimum(cast(*ellipses, angles + np.pi / 2), 20.0) + rng.normal(0, 0.003, count)
    return LaserScan("waist", round(t * NS_PER_S), ranges.astype(np.float32), first, step, 0.05, 30.0)


def on_people(walk: Walk, scan: LaserScan) -> tuple[np.ndarray, np.ndarray]:
    """Which beams meet a person, and which are within a beam of where that changes."""
    angles = scan.angles_rad + np.pi / 2
    empty = cast(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), angles)
    met = cast(*body(walk, 0, "waist")[:3], angles) < empty
    reach = max(2, round(HALF_DEG / abs(scan.angle_increment_rad)) + 1)
    edge = np.zeros(met.size, bool)
    for shift in range(-reach, reach + 1):
        edge |= np.roll(met, shift) != met
    return met, edge


def randomized(beams: tuple[float, float, int], rng: np.random.Generator) -> tuple[float, float, int]:
    """The same field of view by a few beams more or fewer, started up to half a step elsewhere."""
    first, step, count = beams
    n = count + int(rng.integers(-4, 5))
    turned = step * count / n
    return first + float(rng.uniform(-0.5, 0.5)) * turned, turned, n


OTHER_BEAMS = {
    "the same": FRONT,
    "half a step on": (FRONT[0] + HALF_DEG / 2, HALF_DEG, 361),
    "a tenth of a step back": (FRONT[0] - HALF_DEG / 10, HALF_DEG, 361),
    "three beams fewer": (FRONT[0], np.pi / 357, 358),
    "twice as fine": (FRONT[0], HALF_DEG / 2, 721),
    "a third": (FRONT[0], HALF_DEG * 3, 121),
    "clockwise": (np.pi / 2, -HALF_DEG, 361),
    "clockwise, half a step on": (np.pi / 2 + HALF_DEG / 2, -HALF_DEG, 361),
    "a part": (-0.8, HALF_DEG, 150),
    "a turn further": (FRONT[0] + 2 * np.pi, HALF_DEG, 361),
}


@pytest.mark.parametrize("name", OTHER_BEAMS)
@pytest.mark.parametrize("kind", [KnownBackground, LearnedBackground])
def test_other_beams_show_the_same_foreground_but_for_edges(kind, name):
    room = [look(None, FRONT, 0.1 * k) for k in range(12)]
    if kind is KnownBackground:
        background = KnownBackground(room)
    else:
        background = LearnedBackground()
        for scan in room:
            assert not background.foreground(scan).any()
    scan = look(STANDING, OTHER_BEAMS[name], 1.2)
    found = background.foreground(scan)
    met, edge = on_people(STANDING, scan)
    assert met.any()
    np.testing.assert_array_equal(found[~edge], met[~edge])
    assert not found[edge & ~met].any()  # at an edge a beam is rather not foreground
    assert not background.foreground(look(None, OTHER_BEAMS[name], 1.3)).any()


@pytest.mark.parametrize("beams", [FRONT, AROUND], ids=["in front", "all around"])
@pytest.mark.parametrize("clockwise", [False, True])
def test_beams_that_vary_in_every_scan_are_learned_from_and_show_people(beams, clockwise):
    background, rng = LearnedBackground(), np.random.default_rng(5)

    def next_beams():
        first, step, count = randomized(beams, rng)
        return (first + step * (count - 1), -step, count) if clockwise else (first, step, count)

    shown = [background.foreground(look(None, next_beams(), 0.1 * k)).mean() for k in range(60)]
    assert max(shown) <= 0.01
    assert np.mean(shown) < 0.001
    for k in range(60, 70):
        scan = look(ALL_AROUND if beams is AROUND else STANDING, next_beams(), 0.1 * k)
        met, edge = on_people(ALL_AROUND if beams is AROUND else STANDING, scan)
        found = background.foreground(scan)
        assert found[met & ~edge].mean() > 0.99
        assert found[~met & ~edge].mean() < 0.01


def test_a_background_of_varying_scans_is_known_as_well_as_of_equal_ones():
    rng = np.random.default_rng(1)
    background = KnownBackground([look(None, randomized(FRONT, rng), 0.1 * k) for k in range(30)])
    for k in range(30, 40):
        scan = look(STANDING, randomized(FRONT, rng), 0.1 * k)
        met, edge = on_people(STANDING, scan)
        found = background.foreground(scan)
        np.testing.assert_array_equal(found[~edge & met], True)
        assert found[~met & ~edge].mean() < 0.01


def detected(scans: list[LaserScan], room: list[LaserScan], options=None) -> list[np.ndarray]:
    """Positions, width and samples of what a layer detects in each scan, by x."""
    layer = LaserLayer(SENSOR, room, options or WaistOptions())
    tables = []
    for scan in scans:
        seen = layer.detect(scan)
        turned = np.sort(np.mod(seen.angle, 2 * np.pi), axis=1)
        table = np.column_stack([seen.position, seen.width_m, seen.n_sample, turned])
        tables.append(table[table[:, 0].argsort()])
    return tables


def backwards(scan: LaserScan) -> LaserScan:
    last = scan.angle_min_rad + (scan.ranges_m.size - 1) * scan.angle_increment_rad
    return replace(
        scan, ranges_m=scan.ranges_m[::-1].copy(), angle_min_rad=last, angle_increment_rad=-scan.angle_increment_rad
    )


@pytest.mark.parametrize("options", [WaistOptions(), KneeOptions()], ids=["waist", "knee"])
@pytest.mark.parametrize("known", [True, False])
def test_a_clockwise_scanner_sees_the_same(options, known):
    room = [look(None, FRONT, 0.1 * k) for k in range(8)]
    walk = straight_walk([(0.4, 1.5), (0.7, 2.0), (-1.0, 2.6)], [(0.3, 0), (-0.5, 0.1), (0, -0.5)], 12)
    scans = [look(walk, FRONT, 1 + 0.1 * k, k) for k in range(12)]
    first = detected(room + scans, room if known else [], options)
    second = detected([backwards(each) for each in room + scans], room if known else [], options)
    assert sum(map(len, first)) > 20
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-9)


def seam_at(scan: LaserScan, beam: int) -> LaserScan:
    """A full turn from another beam on."""
    return replace(
        scan,
        ranges_m=np.roll(scan.ranges_m, -beam),
        angle_min_rad=scan.angle_min_rad + beam * scan.angle_increment_rad,
    )


@pytest.mark.parametrize("height", ["waist", "knee"])
@pytest.mark.parametrize("known", [True, False])
def test_wherever_a_full_turn_begins_the_same_is_seen(height, known):
    options = WaistOptions() if height == "waist" else KneeOptions()
    room = [look(None, AROUND, 0.1 * k) for k in range(8)]
    scans = [look(ALL_AROUND, AROUND, 1 + 0.1 * k, 0, height) for k in range(4)]
    expected = detected(room + scans, room if known else [], options)
    assert all(map(len, expected[8:]))
    edges = np.unique(
        np.concatenate([np.flatnonzero(np.abs(np.diff(scans[0].ranges_m)) > 0.2) + s for s in (-1, 0, 1)])
    )
    for beam in [1, 200, *edges.tolist()]:  # among them seams in the middle of everybody and at their edges
        turned = [seam_at(scan, beam) for scan in room + scans]
        for one, other in zip(expected, detected(turned, room if known else [], options), strict=True):
            np.testing.assert_allclose(other, one, atol=1e-6)


def test_points_of_a_full_turn_are_the_same_wherever_it_begins():
    room = [look(None, AROUND, 0.1 * k) for k in range(4)]
    scan = look(ALL_AROUND, AROUND, 1.0)
    expected = np.sort(LaserLayer(SENSOR, room, KneeOptions()).points(scan)[0], axis=0)
    for beam in range(0, 720, 16):
        found = LaserLayer(SENSOR, room, KneeOptions()).points(seam_at(scan, beam))[0]
        np.testing.assert_allclose(np.sort(found, axis=0), expected, atol=1e-6)


def test_a_turn_whose_last_beam_looks_where_the_first_did_counts_it_once():
    doubled = (-np.pi, 2 * np.pi / 720, 721)
    room = [look(None, doubled, 0.1 * k) for k in range(4)]
    seen = detected([look(ALL_AROUND, doubled, 1.0)], room)[0]
    expected = detected([look(ALL_AROUND, AROUND, 1.0)], [look(None, AROUND, 0.1 * k) for k in range(4)])[0]
    np.testing.assert_allclose(seen[:, :2], expected[:, :2], atol=5e-3)
    np.testing.assert_array_equal(seen[:, 3], expected[:, 3])


def test_free_space_of_a_full_turn_has_no_gap_at_its_seam():
    points = 2.0 * np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 721)), np.sin(a)])
    space = DetectionModel(LaserSensor(topic="/scan"), DetectionOptions(detected=0.9))
    for count in (455, 456, 720):
        for first in (-np.pi, 0.0, 1.234):
            scan = LaserScan("scan", 0, np.full(count, 5.0, np.float32), first, 2 * np.pi / (count + 0.4), 0.05, 8.0)
            np.testing.assert_allclose(space.seen(scan, points), 0.9)


def test_a_scan_without_beams_shows_nothing_teaches_nothing_and_tells_of_nobody():
    scan = look(STANDING, FRONT, 1.0)
    none = replace(scan, ranges_m=np.empty(0, np.float32))
    for room in ([look(None, FRONT)], []):
        layer = LaserLayer(SENSOR, room, WaistOptions())
        assert len(layer.detect(none)) == 0
        assert len(layer.points(none)[0]) == 0
        np.testing.assert_array_equal(layer.missed(none, np.array([[1.0, 2.0], [0.0, 0.0]])), 1.0)
        assert not layer.passes(none, np.array([[1.0, 2.0], [0.0, 0.0]])).any()
        assert len(layer.detect(look(None, FRONT, 1.1))) == 0
        assert len(layer.detect(look(STANDING, FRONT, 1.2))) == 3
    with pytest.raises(InputError, match="at least one"):
        KnownBackground([none])


@pytest.mark.parametrize("blank", [0, 361, 150], ids=["no beams", "nothing met", "nothing met in a part"])
def test_scans_that_read_nothing_before_the_first_are_not_the_room(blank):
    background = LearnedBackground()
    for k in range(20):
        background.foreground(
            LaserScan("waist", k * NS_PER_S // 10, np.full(blank, np.inf, np.float32), *FRONT[:2], 0.05, 30.0)
        )
    for k in range(20, 30):
        assert not background.foreground(look(None, FRONT, 0.1 * k)).any()
    scan = look(STANDING, FRONT, 3.0)
    assert background.foreground(scan)[on_people(STANDING, scan)[0]].mean() > 0.9


def test_open_space_is_learned_where_nobody_is_met_for_long():
    background = LearnedBackground()
    nothing = look(None, FRONT)
    for k in range(20):
        background.foreground(replace(nothing, stamp_ns=k * NS_PER_S // 10, ranges_m=np.full(361, np.inf, np.float32)))
    ranges = np.full(361, np.inf, np.float32)
    ranges[100:112] = 4.0
    found = background.foreground(replace(nothing, stamp_ns=2 * NS_PER_S, ranges_m=ranges))
    np.testing.assert_array_equal(np.flatnonzero(found), np.arange(100, 112))


def test_a_first_scan_of_few_wide_beams_does_not_set_the_width_for_good():
    background = LearnedBackground()
    background.foreground(look(None, (-0.3, 0.3, 3), 0.0))
    for k in range(1, 25):
        background.foreground(look(None, FRONT, 0.1 * k))
    scan = look(STANDING, FRONT, 2.5)
    met, edge = on_people(STANDING, scan)
    np.testing.assert_array_equal(background.foreground(scan)[~edge], met[~edge])


def test_one_scan_of_other_beams_changes_nothing_that_was_learned():
    plain, disturbed = LearnedBackground(), LearnedBackground()
    for k in range(20):
        scan = look(None, FRONT, 0.1 * k)
        plain.foreground(scan)
        disturbed.foreground(scan)
        if k == 10:
            disturbed.foreground(look(None, (-1.0, 0.001, 900), 1.0))
    scan = look(STANDING, FRONT, 2.0)
    np.testing.assert_array_equal(disturbed.foreground(scan), plain.foreground(scan))


def test_beams_where_no_empty_scan_looked_are_told_of_once(caplog):
    background = KnownBackground([look(None, (-np.pi / 2, HALF_DEG, 181))])
    for t in (1.0, 1.1):
        found = background.foreground(look(STANDING, FRONT, t))
        assert not found[182:].any()
    assert len(caplog.records) == 1
    assert "no scan of the empty room looked" in caplog.text


def test_the_grid_gives_the_same_rows_to_the_same_bearings_however_they_are_said():
    scan = look(None, FRONT)
    grid = BearingGrid.of([scan])
    rows, beams = grid.cover(scan)
    np.testing.assert_array_equal(rows, np.arange(361))
    np.testing.assert_array_equal(beams, np.arange(361))
    for same in (scan, replace(scan, angle_min_rad=scan.angle_min_rad + 2 * np.pi)):
        before, after = grid.rows(same)
        assert before is after
        np.testing.assert_array_equal(before, np.arange(361))
    np.testing.assert_array_equal(grid.rows(backwards(scan))[0], np.arange(361)[::-1])
    np.testing.assert_array_equal(grid.cover(backwards(scan))[1], np.arange(361)[::-1])
    assert grid.n_row == 361


def test_counter_clockwise_leaves_bearings_and_ranges_to_each_other():
    scan = look(STANDING, FRONT)
    turned = counter_clockwise(backwards(scan))
    assert counter_clockwise(scan) is scan
    np.testing.assert_array_equal(turned.ranges_m, scan.ranges_m)
    np.testing.assert_allclose(turned.angles_rad, scan.angles_rad, atol=1e-12)


@pytest.mark.parametrize(
    ("beams", "turn"), [(FRONT, None), (AROUND, 720), ((-np.pi, 2 * np.pi / 720, 721), 720), ((0, 0.0138, 455), 455)]
)
def test_a_turn_is_told_by_its_beams(beams, turn):
    assert beams_of_turn(look(None, beams)) == turn


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"angle_increment_rad": np.inf}, "angle_increment"),
        ({"angle_increment_rad": np.nan}, "angle_increment"),
        ({"angle_increment_rad": 0.0}, "angle_increment"),
        ({"angle_increment_rad": 0.5}, "in radians"),
        ({"angle_min_rad": -90.0}, "angle_min"),
        ({"angle_min_rad": np.nan}, "angle_min"),
        ({"range_min_m": np.nan}, "range_min"),
        ({"sweep_time_s": np.inf}, "time_increment"),
    ],
)
def test_beams_that_no_scanner_has_are_refused(changes, said):
    with pytest.raises(InputError, match=said):
        replace(look(None, FRONT), **changes)
