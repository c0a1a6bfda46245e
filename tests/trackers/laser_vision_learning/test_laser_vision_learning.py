"""The fused system on whole and degraded rigs: pictures help, and nothing depends on them."""

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest
from synthetic_room import AREA, Walk, image, rig, score, straight_walk
from two_scanners import EMPTY, RIG, laser, observed

from trackers.check import check_tracker
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from trackers.presets import make_tracker
from trackers.rig import Pose, Rig, StereoSensor

PRESET = "laser-vision-learning"
CAMERA = rig(waist=False, knee=False).sensors["camera"]
FUSED = Rig(sensors={**RIG.sensors, "camera": CAMERA}, area=AREA)
PASSING = straight_walk([(-1.5, 1.5), (1.5, 1.75)], [(0.8, 0.0), (-0.8, 0.0)], 40)


@lru_cache(maxsize=2)
def pictures(walk: Walk, late_s: float = 0.0, every: int = 1):
    return [
        image(walk, k, round((1 + 0.1 * k + late_s) * NS_PER_S), np.random.default_rng(k), ("pink", "blue", "white"))
        for k in range(0, len(walk), every)
    ]


def followed(walk: Walk, on: Rig = FUSED, images=None, **options):
    images = pictures(walk) if images is None else images
    given = sorted([*observed(walk), *images], key=lambda each: each.stamp_ns)
    tracker, decisions, situations = make_tracker(PRESET, on, EMPTY, np.random.default_rng(0), options), [], set()
    frames = []
    for each in given:
        new = tracker.update(each) or []
        frames += new
        if new:
            decisions += tracker.decisions()
            situations |= set(tracker.situations().values())
    return frames + tracker.finish(), tracker, decisions, situations


def test_two_who_pass_are_learned_merge_and_keep_their_identities():
    frames, tracker, _, situations = followed(PASSING)
    found = score(PASSING, frames)
    assert (found.switches, found.misidentified) == (0, 0)
    assert {"apart", "interacting", "merged"} <= situations
    assert tracker.unused_sensors == []


def test_the_same_recording_gives_the_same_bits():
    assert repr(followed(PASSING)[0]) == repr(followed(PASSING)[0])


def test_laser_only_leaves_the_camera_alone_and_no_camera_is_laser_only():
    with_pictures, tracker, *_ = followed(PASSING, camera=False)
    assert tracker.unused_sensors == ["camera"]
    alone = followed(PASSING, RIG, images=[])[0]
    assert [frame.tracks for frame in with_pictures] == [frame.tracks for frame in alone]


def frozen(walk: Walk):
    first = pictures(walk)[0].rgb
    return [replace(each, rgb=first) for each in pictures(walk)]


@pytest.mark.parametrize(
    "images",
    [
        lambda walk: [],
        partial(pictures, late_s=0.4),
        partial(pictures, every=5),
        frozen,
    ],
    ids=["missing", "late", "one in five", "frozen"],
)
def test_pictures_that_are_missing_late_or_frozen_leave_it_to_the_scanners(images):
    frames, *_ = followed(PASSING, images=images(PASSING))
    found = score(PASSING, frames)
    assert found.misses <= 4 and found.misidentified == 0


def test_a_camera_believed_two_centimetres_and_a_degree_off_harms_nobody():
    believed = CAMERA.room_from_sensor
    off = Pose(
        xyz=(believed.xyz[0] + 0.02, *believed.xyz[1:]),
        rpy=(believed.rpy[0], believed.rpy[1], believed.rpy[2] + 0.0175),
    )
    wrong = CAMERA.model_copy(update={"room_from_sensor": off})
    found = score(PASSING, followed(PASSING, Rig(sensors={**RIG.sensors, "camera": wrong}, area=AREA))[0])
    assert (found.switches, found.misidentified) == (0, 0)


def test_one_scanner_and_a_camera():
    on = Rig(sensors={"front": laser(False), "camera": CAMERA}, area=AREA)
    found = score(PASSING, followed(PASSING, on)[0])
    assert found.misses <= 12


def test_a_picture_of_another_size_is_refused_by_name():
    wrong = [replace(each, rgb=each.rgb[::2]) for each in pictures(PASSING)]
    with pytest.raises(InputError, match="of 'camera'"):
        followed(PASSING, images=wrong)


def test_a_stereo_cameras_left_view_serves_where_there_is_no_other():
    intrinsics = {"width": 64, "height": 48, "fx": 40, "fy": 40, "cx": 31.5, "cy": 23.5}
    stereo = StereoSensor.model_validate({"topic": "/depth/image/compressed", "intrinsics": intrinsics})
    on = Rig(sensors={**RIG.sensors, "depth": stereo}, area=AREA)
    assert make_tracker(PRESET, on, EMPTY).unused_sensors == []
    both = Rig(sensors={**FUSED.sensors, "depth": stereo}, area=AREA)
    assert make_tracker(PRESET, both, EMPTY).unused_sensors == ["depth"]


def test_the_contract_holds_with_pictures():
    given = sorted([*observed(PASSING), *pictures(PASSING)], key=lambda each: each.stamp_ns)[:60]
    assert check_tracker(lambda on, empty, rng: make_tracker(PRESET, on, empty, rng), FUSED, given, EMPTY) == []


def test_two_who_arrive_as_one_are_two_once_they_part():
    """More people come out of what was one track than went in: the second gets a number of their own."""
    parting = straight_walk([(-0.12, 1.6), (0.12, 1.6)], [(-0.45, 0.0), (0.45, 0.0)], 40)
    frames, *_ = followed(parting)
    last = frames[-1].tracks
    assert len(last) == 2 and len({track.id for track in last}) == 2
    at = np.array(sorted((track.x, track.y) for track in last))
    assert np.hypot(*(at - parting.position[-1]).T).max() < 0.25
    assert len(frames[0].tracks) == 0 and score(parting, frames).false_positives <= 8


def test_one_of_a_merged_pair_may_leave_the_area():
    """Abreast to the border and beyond it; who stays keeps their number."""
    walk = straight_walk([(-0.6, 1.5), (-0.6, 1.85)], [(0.8, 0.0), (0.8, 0.0)], 45)
    turn = 20
    walk.position[turn:, 1, 0] = walk.position[turn, 1, 0]
    frames, *_ = followed(walk)
    numbers = [track.id for frame in frames for track in frame.tracks if np.hypot(track.x - 1.0, track.y - 1.85) < 0.3]
    assert len(frames[-1].tracks) == 1 and frames[-1].tracks[0].id == numbers[-1]
    assert len(set(numbers[-15:])) == 1


def test_frames_tell_situations_and_score_maps_of_whom_no_scanner_sees():
    frames, tracker, *_ = followed(PASSING)
    assert {"apart", "interacting"} <= {track.situation for frame in frames for track in frame.tracks}
    for frame in frames:
        for found in frame.maps:
            assert found.sensor == "camera" and (found.score >= 0).all() and found.score.ndim == 2
            assert found.patches.shape[1] == 2
    assert tracker.situations()
