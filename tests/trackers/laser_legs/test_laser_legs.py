"""People by their legs, from a scanner that stands and from one that drives."""

import numpy as np
import pytest
from driving_room import drive, legs_at, scan_at

from trackers.feeding import track_frames
from trackers.frames.planar import between, placed
from trackers.laser_legs.tracker import assigned
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Pose, Rig

POSTS = [(-1.0, 1.5, 0.05), (2.5, 1.0, 0.1), (0.5, -2.0, 0.03), (3.5, -1.5, 0.2)]


def rig_at(pose) -> Rig:
    x, y, yaw = (float(each) for each in pose)
    return Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(x, y, 0.3), rpy=(0, 0, yaw)))})


def tracked(path, motions, people, **options):
    """Frames of the tracker, with people (x, y, vx, vy) who walk on straight lines."""
    rig = rig_at(path[0])
    scans = []
    for k, (pose, motion) in enumerate(zip(path, motions, strict=True)):
        t = 0.1 * k
        legs = [leg for x, y, vx, vy in people for leg in legs_at((x + vx * t, y + vy * t), np.arctan2(vy, vx), t)]
        scans.append(scan_at(pose, t, 0.05, motion, [*POSTS, *legs]))
    tracker = make_tracker("laser-legs", rig, (), np.random.default_rng(0), options)
    return list(track_frames(tracker, rig, scans)), tracker


STANDING = np.tile([-2.0, -1.0, 0.3], (50, 1)), np.zeros((50, 3))
WALKER = (0.5, 1.2, 0.3, -0.6)


def misses(frames, walker, frame_of=lambda k, place: place, since: int = 15) -> int:
    found = 0
    for k, frame in enumerate(frames[since:], since):
        place = frame_of(k, np.array([walker[0] + walker[2] * 0.1 * k, walker[1] + walker[3] * 0.1 * k]))
        found += any(np.hypot(each.x - place[0], each.y - place[1]) < 0.4 for each in frame.tracks)
    return len(frames) - since - found


@pytest.mark.parametrize("way", [STANDING, drive()], ids=["stands", "drives"])
def test_somebody_who_walks_is_one_track_in_the_fixed_frame_and_posts_are_none(way):
    frames, tracker = tracked(*way, [WALKER], report_in="matched")
    assert misses(frames, WALKER) <= 3
    assert len({track.id for frame in frames for track in frame.tracks}) == 1
    assert tracker.warnings == []
    speeds = [np.hypot(track.vx, track.vy) for frame in frames[25:] for track in frame.tracks]
    assert np.median(speeds) == pytest.approx(np.hypot(0.3, 0.6), abs=0.2)


@pytest.mark.parametrize("way", [STANDING, drive()], ids=["stands", "drives"])
def test_where_there_is_no_person_there_is_hardly_a_track(way):
    frames, _ = tracked(*way, [])
    assert sum(len(frame.tracks) for frame in frames) <= 3


def test_a_rig_that_says_the_scanner_stands_has_its_reports_about_the_scanner():
    path, motions = drive()
    frames, _ = tracked(path, motions, [WALKER])
    start = path[0]

    def about_the_scanner(k, place):
        return placed(start, placed(between(path[k], np.zeros(3)), np.asarray(place)))

    assert misses(frames, WALKER, about_the_scanner) <= 3


def test_legs_go_two_to_each_person_and_a_stride_apart_at_most():
    people = np.array([[0.0, 0.0], [2.0, 0.0]])
    legs = np.array([[0.0, 0.1], [0.0, -0.15], [0.05, 0.3], [1.5, 0.0], [2.45, 0.0], [5.0, 0.0]])
    owner = assigned(people, np.full(2, 0.55), legs, np.array([2.0, 2, 0, 2, 3, 3]))
    np.testing.assert_array_equal(owner, [0, 0, -1, -1, 1, -1])
    assert assigned(people[:0], np.empty(0), legs, np.zeros(6)).tolist() == [-1] * 6
