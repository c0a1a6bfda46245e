"""A tracker that starts anew: what it reports behind a jump is what one made there reports, under ids of its own."""

from dataclasses import replace

import numpy as np
import pytest
from test_tracker_contract import world_of

from trackers.feeding import RestartedTracker, track_frames
from trackers.presets import make_tracker
from trackers.tracks import Detection, Track, TrackFrame, discarded, losses, misreported

SAMPLE = (
    "sort",
    "laser-imm",
    "laser-fisheye-imm",
    "laser-vision-learning-laser",
    "laser-vision-learning-vision",
    "floor-kalman",
    "camera-floor-particle",
    "rgbd-head",
)


def made(name, on, room, seed):
    return make_tracker(name, on, room, np.random.default_rng(seed))


@pytest.mark.parametrize("name", SAMPLE)
def test_behind_a_jump_a_tracker_knows_nothing_of_what_was_before(name):
    on, room, observations = world_of(name)
    stamps = sorted({each.stamp_ns for each in observations if each.sensor == on.main_sensor})
    jump_ns = stamps[len(stamps) // 2]
    parts = [[each for each in observations if (each.stamp_ns >= jump_ns) == late] for late in (False, True)]
    before, after = (list(track_frames(made(name, on, room, seed), on, part)) for seed, part in enumerate(parts))
    tracker = RestartedTracker(made(name, on, room, 0), lambda: made(name, on, room, 1), [jump_ns], on.main_sensor)
    assert misreported(tracker, on) == []
    frames = list(track_frames(tracker, on, [*parts[0], *parts[1]]))
    above = max((track.id for frame in before for track in frame.tracks), default=0)
    assert frames[: len(before)] == before
    assert frames[len(before) :] == [
        replace(frame, tracks=tuple(replace(track, id=track.id + above) for track in frame.tracks)) for frame in after
    ]
    assert any(frame.tracks for frame in before) and any(frame.tracks for frame in after)


class Counting:
    """A tracker without `finish` that reports by `tracks`: one person more with each observation."""

    discarded = 2

    def __init__(self):
        self.n = 0

    def update(self, observation):
        self.n += 1

    def tracks(self):
        return [Track(number + 1, 0.0, 0.0) for number in range(self.n)]

    def detections(self):
        return [Detection(0, ("waist",), "waist", float(self.n), 0.0)]


def test_what_a_tracker_tells_besides_is_told_of_all_of_them():
    on, _, observations = world_of("sort")
    scans = [each for each in observations if each.sensor == on.main_sensor][:6]
    tracker = RestartedTracker(Counting(), Counting, [scans[2].stamp_ns, scans[4].stamp_ns], on.main_sensor)
    frames, told = [], []
    for scan in scans:
        assert tracker.update(scan) is None
        frames.append(TrackFrame(scan.stamp_ns, tuple(tracker.tracks())))
        told.append([each.x for each in tracker.detections()])
    assert [[track.id for track in frame.tracks] for frame in frames] == [[1], [1, 2], [3], [3, 4], [5], [5, 6]]
    assert told == [[1], [2], [2, 1], [2], [2, 1], [2]]
    assert tracker.finish() == [] and not hasattr(tracker, "warnings")
    assert discarded(tracker) == 6 and losses(tracker) == {("", "dropped by the tracker"): 6}


def test_two_jumps_before_the_next_observation_make_one_new_tracker_each():
    on, _, observations = world_of("sort")
    scans = [each for each in observations if each.sensor == on.main_sensor]
    tracker = RestartedTracker(Counting(), Counting, [scans[0].stamp_ns + 1, scans[0].stamp_ns + 2], on.main_sensor)
    for scan in scans[:2]:
        tracker.update(scan)
    assert [track.id for track in tracker.tracks()] == [1]  # nobody was reported before the jump
