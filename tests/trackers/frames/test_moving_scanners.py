"""People by scanners on a base that moves: the same as by scanners that stand, whatever tracker takes their detections."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_room
from driving_room import MOUNT, WALKER, drive, driven, legs_of, rig_on_base, trunk_of

from trackers.area import Pose
from trackers.check import check_tracker
from trackers.feeding import track_frames
from trackers.frames.scan_matching import compose, inverse, placed, planar
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Rig
from trackers.tracks import report_frame

FOLLOWING = ("sort", "laser-imm", "laser-legs")
START = np.array([-2.0, -1.0, 0.3])
STANDS = np.tile(START, (50, 1)), np.zeros((50, 3))


def tracked(tracker, rig, fed, **options):
    made = make_tracker(tracker, rig, (), np.random.default_rng(0), options)
    return list(track_frames(made, rig, fed)), made


def walker_at(k):
    return np.array([WALKER[0] + WALKER[2] * 0.1 * k, WALKER[1] + WALKER[3] * 0.1 * k])


def errors(frames, frame_from_room=(), since=15):
    """Distance of the nearest track from the walker, frame by frame [m]; infinite where there is none."""
    off = []
    for frame in frames:
        k = round(frame.stamp_ns / NS_PER_S * 10)
        x, y = placed(frame_from_room[k], walker_at(k)) if len(frame_from_room) else walker_at(k)
        if k >= since:
            off.append(min((np.hypot(each.x - x, each.y - y) for each in frame.tracks), default=np.inf))
    return np.array(off)


ONE_LEG_M = 0.25
"""How far one leg alone, where the other is hidden, is from the middle of both: half a step and half the hips."""


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_a_walk_gives_the_same_tracks_to_scanners_that_stand_and_that_drive(tracker):
    x, y, yaw = START.tolist()
    rig = Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(x, y, 0.3), rpy=(0, 0, yaw)))})
    scans = [each for each in driven(STANDS, [WALKER])[0] if each.sensor == "scan"]
    frames, _ = tracked(tracker, rig, scans)
    assert errors(frames).max() < ONE_LEG_M
    for way in (STANDS, drive()):
        fed, odometry_from_room = driven(way, [WALKER])
        seen, made = tracked(tracker, rig_on_base(), fed)
        assert errors(seen, odometry_from_room).max() < ONE_LEG_M
        assert [len(each.tracks) for each in seen[15:]] == [1] * 35
        assert {each.id for frame in seen for each in frame.tracks} == {1}
        assert made.unused_sensors == [] and made.warnings == []
        speeds = [np.hypot(each.vx, each.vy) for frame in seen[25:] for each in frame.tracks]
        assert np.median(speeds) == pytest.approx(np.hypot(*WALKER[2:]), abs=0.2)


@pytest.mark.parametrize("tracker", ["sort", "laser-imm"])
def test_things_that_stand_are_hardly_people_to_a_scanner_that_drives(tracker):
    frames, _ = tracked(tracker, rig_on_base(), driven(drive(), [])[0])
    assert sum(len(frame.tracks) for frame in frames) <= 3


@pytest.mark.parametrize("tracker", FOLLOWING)
@pytest.mark.parametrize("report_in", ["rig", "matched"])
def test_tracks_and_detections_leave_in_the_frame_of_odometry_or_in_that_which_scan_matching_finds(tracker, report_in):
    fed, frame_from_room = driven(drive(30), [WALKER], slip=1.1)
    if report_in == "matched":
        frame_from_room = np.tile(frame_from_room[0], (30, 1))
    made, frames, off = make_tracker(tracker, rig_on_base(), options={"report_in": report_in}), [], []
    for each in fed:
        for frame in made.update(each):
            k = round(frame.stamp_ns / NS_PER_S * 10)
            x, y = placed(frame_from_room[k], walker_at(k))
            off.append(min((np.hypot(leg.x - x, leg.y - y) for leg in made.detections()), default=np.inf))
            frames.append(frame)
    assert errors(frames, frame_from_room).max() < ONE_LEG_M
    assert np.median(off) < ONE_LEG_M
    assert report_frame(made) == (None if report_in == "rig" else "matched")


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_a_scanner_in_the_room_and_one_on_a_base_tell_of_one_person(tracker):
    base = planar(MOUNT.matrix)
    fed, odometry_from_room = driven(drive(30), [WALKER], start=compose(START, inverse(base)))
    np.testing.assert_allclose(odometry_from_room, 0, atol=1e-9)
    there = LaserSensor(topic="/there", room_from_sensor=Pose(xyz=(4.0, 2.0, 0.3), rpy=(0, 0, np.pi)))
    on = rig_on_base()
    on = on.model_copy(update={"sensors": {**on.sensors, "there": there}})
    still = np.tile([4.0, 2.0, np.pi], (30, 1)), np.zeros((30, 3))
    fed += [replace(each, sensor="there") for each in driven(still, [WALKER])[0] if each.sensor == "scan"]
    frames, made = tracked(tracker, on, sorted(fed, key=lambda each: (each.stamp_ns, each.sensor)))
    assert errors(frames).max() < ONE_LEG_M and made.unused_sensors == []
    assert {len(frame.tracks) for frame in frames[15:]} == {1}


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_a_lost_scan_leaves_no_hole_where_odometry_tells_the_time(tracker):
    lost = {20, 27, 28}
    fed, odometry_from_room = driven(drive(), [WALKER], lost=lost)
    frames, _ = tracked(tracker, rig_on_base(), fed)
    assert [frame.stamp_ns for frame in frames] == [k * NS_PER_S // 10 for k in range(len(odometry_from_room))]
    assert errors(frames, odometry_from_room)[[k - 15 for k in lost]].max() < 0.3
    assert {track.status for k in lost for track in frames[k].tracks} == {"coasting"}


@pytest.mark.parametrize("tracker", ["sort", "laser-imm"])
def test_a_scan_that_comes_after_its_frame_was_given_measures_and_is_not_reported_again(tracker):
    fed, odometry_from_room = driven(drive(), [WALKER])
    late = next(each for each in fed if each.sensor == "scan" and each.stamp_ns == 2 * NS_PER_S)
    fed.remove(late)
    fed.insert(next(k for k, each in enumerate(fed) if each.stamp_ns == 22 * NS_PER_S // 10) + 1, late)
    frames, _ = tracked(tracker, rig_on_base(), fed)
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(set(stamps)) and len(stamps) >= len(odometry_from_room) - 1
    assert errors(frames, odometry_from_room).max() < 0.3


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_scans_that_come_late_together_are_all_taken(tracker):
    fed, _ = driven(drive(), [WALKER])
    late = [each for each in fed if each.sensor == "scan" and 2.0 <= each.t < 2.45]
    rest = [each for each in fed if each not in late]
    k = next(k for k, each in enumerate(rest) if each.sensor == "base" and each.t >= 2.5)
    frames, made = tracked(tracker, rig_on_base(), [*rest[: k + 1], *late, *rest[k + 1 :]])
    stamps = [each.stamp_ns for each in frames]
    assert len(late) == 5 and stamps == sorted(set(stamps)) and len(stamps) == 50 and not made.losses


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_a_gap_of_odometry_leaves_people_where_they_are_in_its_frame(tracker):
    fed, odometry_from_room = driven(drive(), [WALKER])
    fed = [each for each in fed if each.sensor == "scan" or not 2.0 < each.t < 3.4]
    frames, _ = tracked(tracker, rig_on_base(), fed)
    assert errors(frames, odometry_from_room).max() < 2 * ONE_LEG_M


@pytest.mark.parametrize("tracker", ["sort", "laser-imm"])
@pytest.mark.parametrize("role", ["knee", "waist"])
def test_a_scanner_upside_down_on_its_base_sees_people_where_they_are(tracker, role):
    """At the waist whatever has come to its place, which is said."""
    hung = replace_roll(MOUNT, np.pi)
    body = trunk_of if role == "waist" else legs_of
    upright, odometry_from_room = driven(drive(), [WALKER], body=body)
    flipped = [
        replace(each, angle_min_rad=-each.angle_min_rad, angle_increment_rad=-each.angle_increment_rad)
        if each.sensor == "scan"
        else each
        for each in upright
    ]
    frames, made = tracked(tracker, rig_on_base(role=role), upright)
    assert [("waist height" in each) for each in made.warnings] == [True] * (role == "waist")
    again, _ = tracked(tracker, rig_on_base(hung, role=role), flipped)
    assert errors(frames, odometry_from_room, since=20).max() < ONE_LEG_M
    np.testing.assert_allclose(
        errors(frames, odometry_from_room, since=20), errors(again, odometry_from_room, since=20), atol=1e-6
    )


def replace_roll(mount, roll):
    return mount.model_copy(update={"rpy": (roll, *mount.rpy[1:])})


@pytest.mark.parametrize("tracker", FOLLOWING)
def test_scans_of_a_tilting_mast_are_left_out_and_told(tracker):
    fed, _ = driven(drive(), [])
    tilted = Pose(rpy=(0, 0.3, 0)).matrix
    fed = [
        replace(each, frame_from_base=each.frame_from_base @ tilted)
        if each.sensor == "base" and 2 <= each.t < 3
        else each
        for each in fed
    ]
    frames, made = tracked(tracker, rig_on_base(), fed)
    assert len(frames) == 50
    assert made.warnings == ["scan was tilted by more than 10° in 10 scans: they were left out"]


@pytest.mark.parametrize("mounted", [True, False], ids=["on the base", "in the room"])
def test_a_camera_is_used_with_a_trunk_scanner_on_the_same_base(mounted):
    camera = synthetic_room.rig().sensors["camera"].model_copy(update={"mounted_on": "base" if mounted else None})
    on = rig_on_base(role="waist")
    on = on.model_copy(update={"sensors": {**on.sensors, "camera": camera}})
    assert make_tracker("laser-fisheye-imm", on).unused_sensors == ([] if mounted else ["camera"])


@pytest.mark.sample(5)
@pytest.mark.parametrize("tracker", [*FOLLOWING, "laser-vision-learning-laser"])
def test_trackers_keep_the_contract_through_every_fault_of_a_drive(tracker):
    fed, _ = driven(tuple(each[:16] for each in drive()), [WALKER], lost={9})
    assert check_tracker(lambda *made: make_tracker(tracker, *made), rig_on_base(), fed) == []
