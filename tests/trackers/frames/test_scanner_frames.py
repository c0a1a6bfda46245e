"""Poses of scanners: composed, interpolated, matched; and the memory of places."""

from dataclasses import replace

import numpy as np
import pytest
from driving_room import BEAMS, drive, scan_at

from trackers.area import Pose
from trackers.frames.rig_frames import OdometryTrack, RigFrames
from trackers.frames.scan_matching import MatchingOptions, between, compose, inverse, placed
from trackers.frames.sensor_frame import ScanMemory, SensorFrame
from trackers.observations import NS_PER_S, LaserScan, Odometry
from trackers.rig import LaserSensor, OdometrySensor, Rig


def test_poses_compose_and_come_back():
    rng = np.random.default_rng(0)
    first, second, point = rng.normal(0, 2, (5, 3)), rng.normal(0, 2, (5, 3)), rng.normal(0, 2, (5, 2))
    np.testing.assert_allclose(placed(compose(first, second), point), placed(first, placed(second, point)), atol=1e-12)
    np.testing.assert_allclose(placed(inverse(first), placed(first, point)), point, atol=1e-12)
    np.testing.assert_allclose(compose(first, between(first, second))[:, :2], second[:, :2], atol=1e-12)


def located(path, motions, sweep_s: float = 0.08, odometry=None, start=None):
    frame = SensorFrame(path[0] if start is None else start, MatchingOptions())
    found = []
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        scan = scan_at(pose, 0.1 * k, sweep_s, motion)
        frame.locate(scan, np.ones(BEAMS, np.bool_), None if odometry is None else odometry[k])
        found.append(frame.pose)
    return np.array(found), frame


def test_scan_matching_follows_a_scanner_that_drives_and_turns_while_it_sweeps():
    path, motions = drive()
    found, frame = located(path, motions)
    assert np.hypot(*(found - path)[:, :2].T).max() < 0.06
    assert np.abs(between(path, found)[:, 2]).max() < 0.03
    assert frame.has_moved and frame.n_untrusted == 0


@pytest.mark.parametrize("with_odometry", [True, False])
@pytest.mark.parametrize("turn", [-1.0, 0.5, 1.2])
def test_the_first_scan_of_a_scanner_that_drives_already_is_not_bent(turn: float, with_odometry: bool):
    path, motions = drive(8, turn=turn)
    frame = SensorFrame(path[0], MatchingOptions())
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        known = (pose, motion) if with_odometry else (None, None)
        frame.locate(scan_at(pose, 0.1 * k, 0.09, motion), np.ones(BEAMS, np.bool_), *known)
        error = between(pose, frame.pose)
        assert np.hypot(*error[:2]) < 0.01
        assert abs(error[2]) < 0.006


def test_wheels_that_begin_to_turn_are_believed_from_the_first_scan_on():
    frame = SensorFrame(np.zeros(3), MatchingOptions())
    for k, yaw in enumerate([0.0, 0.01, 0.02]):
        pose = np.array([0.0, 0.0, yaw])
        frame.locate(scan_at(pose, 0.1 * k), np.ones(BEAMS, np.bool_), pose)
        assert abs(between(pose, frame.pose)[2]) < 0.004


@pytest.mark.parametrize("mount_yaw", [0.0, 2.0])
def test_a_scanner_on_a_base_that_drives_already_is_placed_by_the_bases_odometry(mount_yaw: float):
    mount = np.array([0.2, 0.1, mount_yaw])
    path, motions = drive(3, turn=1.2)
    scanner = Pose(xyz=(0.2, 0.1, 0.3), rpy=(0, 0, mount_yaw))
    rig = Rig(
        sensors={
            "base": OdometrySensor(topic="/odom"),
            "scan": LaserSensor(topic="/scan", mounted_on="base", room_from_sensor=scanner),
        }
    )
    frames = RigFrames(rig, ["scan"], MatchingOptions())
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        for late_s in (0.0, 0.045, 0.09):
            x, y, yaw = compose(compose(pose, _driven(motion, late_s)), inverse(mount)).tolist()
            stamp_ns = round((0.1 * k + late_s) * NS_PER_S)
            assert frames.add(Odometry("base", stamp_ns, Pose(xyz=(x, y, 0), rpy=(0, 0, yaw)).matrix))
        frame = frames.located(scan_at(pose, 0.1 * k, 0.09, motion), np.ones(BEAMS, np.bool_))
        error = between(pose, frame.pose)
        assert np.hypot(*error[:2]) < 0.005
        assert abs(error[2]) < 0.003


@pytest.mark.parametrize("turn", [-1.2, 1.0])
def test_a_slow_scanner_that_turns_is_followed_without_odometry(turn: float):
    period = 0.3
    motion = np.array([0.4, 0.0, turn])
    path = [np.array([-1.0, -1.0, 0.3])]
    for _ in range(9):
        path.append(compose(path[-1], _driven(motion, period)))
    frame = SensorFrame(path[0], MatchingOptions())
    for k, pose in enumerate(path):
        frame.locate(scan_at(pose, period * k, 0.25, motion), np.ones(BEAMS, np.bool_), None)
        error = between(pose, frame.pose)
        assert np.hypot(*error[:2]) < 0.05
        assert abs(error[2]) < 0.02
    assert frame.n_untrusted == 0


def _driven(motion, seconds: float):
    step = np.zeros(3)
    for _ in range(20):
        step = compose(step, motion * seconds / 20)
    return step


def test_a_scanner_that_stands_stays_exactly_where_the_rig_says():
    path = np.tile([0.5, 0.5, 1.0], (20, 1))
    found, frame = located(path, np.zeros((20, 3)))
    np.testing.assert_array_equal(found, path)
    assert not frame.has_moved


def test_slipping_wheels_are_corrected_by_the_scans():
    path, motions = drive(30)
    slipping = path[0] + (path - path[0]) * (1.15, 1.15, 1.0)
    found, _ = located(path, motions, odometry=slipping)
    assert np.hypot(*(found - path)[:, :2].T).max() < 0.06


@pytest.mark.parametrize("at", [8, 12, 20])
def test_a_slip_of_the_wheels_during_a_sweep_does_not_bend_the_scan(at: int):
    path, motions = drive(30)
    slipping = path.copy()
    slipping[at:] = compose(compose(path[at], np.array([0.0, 0.0, 0.05])), between(path[at], path[at:]))
    sure, _ = located(path, motions, sweep_s=0.09, odometry=path)
    found, frame = located(path, motions, sweep_s=0.09, odometry=slipping)
    assert np.abs(between(sure, found)[:, 2]).max() < 0.01
    assert frame.n_untrusted == 0


def test_without_anything_to_match_a_pose_is_odometrys_and_has_no_trust():
    frame = SensorFrame(np.zeros(3), MatchingOptions())
    for k in range(5):
        empty = LaserScan(
            "scan", k * NS_PER_S // 10, np.full(BEAMS, np.inf, np.float32), -np.pi, 2 * np.pi / BEAMS, 0.05, 20.0
        )
        frame.locate(empty, np.ones(BEAMS, np.bool_), np.array([0.1 * k, 0.0, 0.0]))
    np.testing.assert_allclose(frame.pose, [0.4, 0.0, 0.0])
    assert frame.n_untrusted == 4


def test_places_keep_what_earlier_scans_saw_of_them_wherever_the_scanner_is_by_then():
    memory = ScanMemory()
    for k, pose in enumerate(([0.0, 0.0, 0.0], [0.5, 0.0, 1.0], [1.0, -0.5, 2.0])):
        scan = scan_at(pose, k, extra=[(2.0, 0.0, 0.1)])
        memory.add(scan.t, np.array(pose), scan.angles_rad, scan.ranges_m.astype(float), np.inf)
    places = np.array(
        [[1.9, 0.0], [1.5, 1.0], [4.0, 0.0], [8.0, 0.0]]
    )  # the post, free floor, behind the post at first, outside
    looks = memory.looks(places, np.full(4, 10.0))
    np.testing.assert_array_equal(looks.hit > 0, [True, False, False, False])
    np.testing.assert_array_equal(looks.free[1], 3)
    assert looks.free[0] == looks.free[3] == 0 and 0 < looks.free[2] < 3
    assert memory.looks(places, np.full(4, 0.5)).free[1] == 1  # only what was seen until then


def test_a_beam_without_an_echo_tells_nothing_of_places_from_which_dark_surfaces_have_none():
    frame = SensorFrame(np.zeros(3), MatchingOptions())
    scan = scan_at(np.zeros(3), 0.0)
    silent = replace(scan, ranges_m=np.full_like(scan.ranges_m, np.inf), range_max_m=6.0)
    frame.locate(silent, np.ones(scan.ranges_m.size, np.bool_), None)
    places = np.array([[1.0, 0.0], [1.9, 0.0], [2.1, 0.0], [5.5, 0.0]])
    looks = frame.looks(places, np.full(4, 10.0))
    assert looks.free.tolist() == [1, 1, 0, 0]
    assert looks.hit.tolist() == [0, 0, 0, 0]


def test_odometry_is_interpolated_and_breaks_where_it_jumps_or_stops():
    track = OdometryTrack()
    for k in range(5):
        pose = np.eye(4)
        pose[0, 3] = 0.1 * k
        track.add(k * NS_PER_S // 10, pose)
    np.testing.assert_allclose(track.at(NS_PER_S // 20), [0.05, 0, 0], atol=1e-12)
    np.testing.assert_allclose(track.at(45 * NS_PER_S // 100), [0.45, 0, 0], atol=1e-12)
    assert track.at(-1) is None and track.at(2 * NS_PER_S) is None
    jumped = np.eye(4)
    jumped[0, 3] = 7.0
    track.add(NS_PER_S // 2, jumped)
    assert not track.follows(NS_PER_S // 10, NS_PER_S // 2) and track.follows(0, 4 * NS_PER_S // 10)
    assert track.at(NS_PER_S // 2) == pytest.approx([7.0, 0, 0])


def x_at(x: float) -> np.ndarray:
    return Pose(xyz=(x, 0, 0), rpy=(0, 0, 0)).matrix


@pytest.mark.parametrize("every_s", [0.05, 0.25, 0.5, 1.0])
def test_a_pose_is_carried_on_until_the_next_one_however_rare_they_are(every_s: float):
    track, speed = OdometryTrack(), 0.5
    n_scan = 0
    for tenth in range(60):
        t = tenth / 10
        for k in range(int(np.floor((t - 0.1) / every_s)) + 1, int(np.floor(t / every_s)) + 1):
            track.add(round(k * every_s * NS_PER_S), x_at(speed * k * every_s))
        if t >= 2 * every_s:
            np.testing.assert_allclose(track.at(round(t * NS_PER_S)), [speed * t, 0, 0], atol=1e-9)
            n_scan += 1
    assert n_scan >= 40 and track.rarity() == ""
    assert track.at(9 * NS_PER_S) is None


@pytest.mark.parametrize(
    ("every_s", "swing_m", "is_told"), [(0.5, 1.0, True), (2.0, 1.0, True), (0.1, 1.0, False), (0.5, 0.0, False)]
)
def test_odometry_too_rare_for_the_motion_is_told_where_nothing_can_be_matched(
    every_s: float, swing_m: float, is_told: bool
):
    rig = Rig(sensors={"base": OdometrySensor(topic="/odom"), "scan": LaserSensor(topic="/scan", mounted_on="base")})
    open_air, walls = RigFrames(rig, ["scan"], MatchingOptions()), RigFrames(rig, ["scan"], MatchingOptions())
    due_s = 0.0
    for tenth in range(100):
        t = tenth / 10
        x = swing_m * np.sin(t)
        if t >= due_s:
            due_s += every_s
            for frames in (open_air, walls):
                frames.add(Odometry("base", round(t * NS_PER_S), x_at(x)))
        scan = scan_at([x, 0.0, 0.0], t)
        walls.located(scan, np.ones(BEAMS, np.bool_))
        open_air.located(replace(scan, ranges_m=np.full_like(scan.ranges_m, np.inf)), np.ones(BEAMS, np.bool_))
    told = [each for each in open_air.warnings if each.startswith(f"odometry of base comes every {every_s:g} s: ")]
    assert len(told) == is_told
    assert not any("odometry of base" in each for each in walls.warnings)


def test_parts_of_the_robot_are_found_once_it_has_driven_and_turned():
    path, motions = drive(60, 0.6, 0.6)
    frame = SensorFrame(path[0], MatchingOptions())
    for k, pose in enumerate(path):
        scan = scan_at(pose, 0.1 * k, 0.0)
        scan.ranges_m[:12] = 0.25
        frame.locate(scan, np.ones(BEAMS, np.bool_), None)
    own = frame.own_parts(scan)
    assert own[:12].all() and not own[12:].any() and motions.size
