"""All scanners of one role: their clusters fused in the room frame, absence told by all of them."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from synthetic_room import Walk, empty_room, observe, rig, scan, score, straight_walk

from trackers.feeding import track_frames
from trackers.laser.clusters import Detections
from trackers.laser.group import ScannerGroup, fused, scanners_by_role
from trackers.laser.layer import KneeOptions, LaserLayer, WaistOptions
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Pose, Rig

AWAY_M = 3.6  # how far ahead the second rig stands, looking back


def detections(*places, variance=0.0, width=0.1, column=0, n_sample=9) -> Detections:
    position = np.array(places, float).reshape(-1, 2)
    each = np.ones(len(position))
    scanner = np.zeros((len(position), 2), np.bool_)
    scanner[:, column] = True
    return Detections(
        position,
        variance * each,
        np.full(len(position), n_sample),
        width * each,
        2 * each,
        np.zeros((len(position), 2)),
        scanner,
    )


def test_a_body_seen_by_two_scanners_is_one_detection_between_them():
    both = fused(detections((1.0, 1.0), (3.0, 0.0)), detections((5.0, 0.0), (1.1, 1.0), width=0.2, column=1), 0.2)
    np.testing.assert_allclose(both.position, [(1.05, 1.0), (3.0, 0.0), (5.0, 0.0)])
    np.testing.assert_allclose(both.width_m, [0.2, 0.1, 0.2])
    assert both.scanner.tolist() == [[True, True], [True, False], [False, True]]


def test_a_half_hidden_cluster_counts_less_and_makes_nothing_surer_than_a_whole_one():
    both = fused(detections((0.0, 0.0)), detections((0.12, 0.0), variance=0.02, column=1), 0.2)
    np.testing.assert_allclose(both.position, [(0.03, 0.0)])  # R is 0.01 m²: weights 3 and 1
    assert both.variance_m2 == [0.0]
    hidden = detections((0.0, 0.0), variance=0.02)
    np.testing.assert_allclose(fused(hidden, hidden, 0.2).variance_m2, [0.005])


def test_pairs_are_made_by_least_total_distance_and_within_the_gate_only():
    row, shifted = detections((0.0, 0.0), (0.3, 0.0)), detections((0.18, 0.0), (0.45, 0.0), column=1)
    np.testing.assert_allclose(fused(row, shifted, 0.2).position[:, 0], [0.09, 0.375])  # the nearest is 0.3 and 0.18
    assert len(fused(row, shifted, 0.1)) == 4


def sensor(back: bool, height_m: float, role: str) -> LaserSensor:
    pose = (
        Pose(xyz=(0, AWAY_M, height_m), rpy=(0, 0, -np.pi / 2))
        if back
        else Pose(xyz=(0, 0, height_m), rpy=(0, 0, np.pi / 2))
    )
    return LaserSensor(topic=f"/{role}/{back}", room_from_sensor=pose, role=role)


def seen_back(walk: Walk) -> Walk:
    """The walk as the rig that looks back sees it."""
    return Walk(np.array([0.0, AWAY_M]) - walk.position, walk.heading + np.pi, walk.phase)


FRONT, BACK = sensor(False, 0.45, "knee"), sensor(True, 0.45, "knee")
ONE_BEHIND_ANOTHER = straight_walk([(0.0, 1.0), (0.0, 2.4)], [(0.0, 0.0), (0.0, 0.0)], 1)
EMPTY = [
    replace(scan(None, 0, "knee", k, np.random.default_rng(k)), sensor=name)
    for k in range(6)
    for name in ("front", "back")
]


def both_scans(walk: Walk, k: int, seed: int = 3) -> dict:
    rng, stamp = np.random.default_rng(seed + k), round((1 + 0.1 * k) * NS_PER_S)
    return {
        "front": replace(scan(walk, k, "knee", stamp, rng), sensor="front"),
        "back": replace(scan(seen_back(walk), k, "knee", stamp, rng), sensor="back"),
    }


def test_a_beam_of_each_of_two_scanners_is_enough_for_somebody_new():
    both = fused(detections((1.0, 1.0), (3.0, 0.0), n_sample=1), detections((1.1, 1.0), column=1, n_sample=1), 0.2)
    assert both.n_sample.tolist() == [2, 1]
    assert ScannerGroup({"front": FRONT}, EMPTY, KneeOptions()).sufficient(both).tolist() == [True, False]


def test_beams_without_a_return_tell_half_as_much_where_the_room_is_not_known():
    behind, nothing = (
        replace(EMPTY[0], ranges_m=np.full_like(EMPTY[0].ranges_m, range_m)) for range_m in (5.0, np.inf)
    )
    place = np.array([[0.0], [2.0]])
    known, learned = (ScannerGroup({"front": FRONT}, empty, KneeOptions()) for empty in (EMPTY, []))
    seen = {
        (group is known, scan is behind): 1 - float(group.missed({"front": scan}, place)[0])
        for group in (known, learned)
        for scan in (behind, nothing)
    }
    assert seen[True, True] == seen[True, False] == seen[False, True] > 0.5
    assert seen[False, False] == pytest.approx(0.5 * seen[True, True])


@pytest.mark.parametrize("roll_rad", [0.0, np.pi])
def test_a_scanner_that_knows_the_room_tells_of_what_it_looks_at_alone(roll_rad: float):
    """Another one beside it, which learns, looks the other way, where nothing returns."""
    aside = FRONT.model_copy(update={"room_from_sensor": Pose(xyz=(0, 0, 0.45), rpy=(roll_rad, 0, -np.pi / 2))})
    places = np.array([[0.0, 2.0], [0.0, 3.6], [0.0, -2.0]])  # before the known wall, behind it, on the other side
    for range_m, is_seen in ((np.inf, False), (3.0, True)):
        group = ScannerGroup({"front": FRONT, "aside": aside}, EMPTY[::2], KneeOptions())
        assert group.seen_behind(places).tolist() == [True, False, False]
        ranges_m = np.full_like(EMPTY[0].ranges_m, range_m)
        group.detect({"aside": replace(EMPTY[0], sensor="aside", ranges_m=ranges_m)})
        assert group.seen_behind(places).tolist() == [True, False, is_seen]


def test_where_another_scanner_looks_past_there_is_nothing():
    """A beam on the edge of a leg, half on the wall behind it, says something between."""
    group = ScannerGroup({"front": FRONT, "back": BACK}, EMPTY, KneeOptions())
    scans = both_scans(ONE_BEHIND_ANOTHER, 0)
    ranges = scans["front"].ranges_m.copy()
    free = ranges.size // 3
    ranges[free : free + 6] = 1.6
    scans["front"] = replace(scans["front"], ranges_m=ranges)
    alone = ScannerGroup({"front": FRONT}, EMPTY, KneeOptions()).detect(scans)
    assert (len(alone), len(group.detect(scans))) == (2, 2)
    phantom = alone.position[np.abs(np.hypot(*alone.position.T) - 1.64) < 0.05]
    assert len(phantom) == 1
    assert np.hypot(*(group.detect(scans).position - phantom).T).min() > 0.3


def test_what_stands_in_the_shadow_of_one_scanner_another_sees():
    alone = ScannerGroup({"front": FRONT}, EMPTY, KneeOptions())
    both = ScannerGroup({"front": FRONT, "back": BACK}, EMPTY, KneeOptions())
    scans = both_scans(ONE_BEHIND_ANOTHER, 0)
    behind = [group.detect(scans).position[:, 1] > 1.7 for group in (alone, both)]
    assert (behind[0].sum(), behind[1].sum()) == (0, 1)  # legs side by side are one cluster
    hidden = np.array([[0.0], [2.4]])
    product = alone.missed(scans, hidden) * ScannerGroup({"back": BACK}, EMPTY, KneeOptions()).missed(scans, hidden)
    assert both.missed(scans, hidden) == product < alone.missed(scans, hidden)


def test_a_group_of_one_says_what_its_scanner_says_to_the_bit():
    scans = both_scans(ONE_BEHIND_ANOTHER, 0)
    layer = LaserLayer(FRONT, [item for item in EMPTY if item.sensor == "front"], KneeOptions())
    one, other = layer.detect(scans["front"]), ScannerGroup({"front": FRONT}, EMPTY, KneeOptions()).detect(scans)
    assert all(np.array_equal(value, getattr(other, name)) for name, value in vars(one).items())


def test_a_scanner_that_is_silent_leaves_the_others_to_it():
    group = ScannerGroup({"front": FRONT, "back": BACK}, EMPTY, KneeOptions())
    scans = both_scans(ONE_BEHIND_ANOTHER, 0)
    assert group.detect({"back": scans["back"]}).scanner.tolist() == [[False, True]]
    assert len(group.detect({})) == 0
    assert group.missed({}, np.zeros((2, 3))).tolist() == [1, 1, 1]


CROSSING = straight_walk(
    [(0.0, 0.9), (0.0, 2.2), (-1.5, 2.6)], [(0.0, 0.0), (0.0, 0.0), (0.7, -0.05)], 40
)  # the second is hidden


def test_a_tracker_uses_every_scanner_of_a_role_in_whatever_order_they_are_listed():
    observations = [each for k in range(len(CROSSING)) for each in both_scans(CROSSING, k).values()]
    area = rig().area
    results = []
    for order in permutations({"front": FRONT, "back": BACK}.items()):
        on = Rig(sensors=dict(order), area=area)
        tracker = make_tracker("laser-imm", on, EMPTY)
        results.append(list(track_frames(tracker, on, observations)))
        assert tracker.unused_sensors == []
    assert results[0] == results[1]
    both = score(CROSSING, results[0], skip=11)
    alone = Rig(sensors={"front": FRONT}, area=area)
    one = score(CROSSING, list(track_frames(make_tracker("laser-imm", alone, EMPTY), alone, observations)), skip=11)
    assert both.switches == both.misidentified == both.misses == 0
    assert one.misses > 20
    assert both.error_m < 0.12


def test_scanners_of_a_role_come_by_name_but_the_main_one_first():
    sensors = {name: FRONT.model_copy(update={"topic": f"/{name}"}) for name in ("c", "a", "b")}
    assert scanners_by_role(Rig(sensors=sensors), ("knee",)) == {"knee": ("a", "b", "c")}
    assert scanners_by_role(Rig(sensors=sensors, main="c"), ("knee", "waist")) == {"knee": ("c", "a", "b")}


def test_a_trunk_that_only_a_scanner_away_from_the_camera_sees_has_no_window():
    walk = straight_walk([(0.0, 1.0), (0.0, 2.4), (0.9, 1.8)], [(0.0, 0.0)] * 3, 12)
    given = []
    for k, picture in enumerate(each for each in observe(walk, 5) if each.sensor == "camera"):
        rng, stamp = np.random.default_rng(k), picture.stamp_ns
        given += [scan(walk, k, "waist", stamp, rng), picture]
        given.append(replace(scan(seen_back(walk), k, "waist", stamp, rng), sensor="away"))
    background = empty_room(np.random.default_rng(1), 5)
    background += [replace(item, sensor="away") for item in background if item.sensor == "waist"]
    camera_rig = rig(knee=False)
    on = Rig(sensors={"away": sensor(True, 0.95, "waist"), **camera_rig.sensors}, area=camera_rig.area)
    tracker = make_tracker("laser-fisheye-imm", on, background)
    frames = list(track_frames(tracker, on, given))
    assert len(frames[-1].tracks) == 3


@pytest.mark.parametrize("options", [WaistOptions(fuse_m=0.0), KneeOptions(fuse_m=0.0)])
def test_fusing_can_be_switched_off(options):
    group = ScannerGroup({"front": FRONT, "back": BACK}, EMPTY, options)
    scans = both_scans(ONE_BEHIND_ANOTHER, 0)
    detected = group.detect(scans)
    assert (detected.scanner.sum(axis=1) == 1).all()
