"""The baseline by the camera alone, on plain figures."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import synthetic_room
import synthetic_view as view

from trackers.check import check_tracker
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.laser_vision_learning.vision_only.picture_tracks import AtDetections, WhiteAcceleration
from trackers.laser_vision_learning.vision_only.tracker import VisionOnly
from trackers.observations import NS_PER_S, Image, LaserScan
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.tracks import detections_of
from trackers.vision.person_detector import SHIPPED

PERIOD_S = 0.1
EMPTY = np.empty((0, 2))


def straight(t: float) -> np.ndarray:
    """Two people who pass each other 0.5 m apart in the middle, and one who stands."""
    return np.array([(-2.5 + 1.0 * t, 0.6), (2.5 - 1.0 * t, 1.1), (-1.0, -1.5)])


def film(on, seconds: float, where=straight) -> list[Image]:
    return [view.picture(on, t, where(t)) for t in np.arange(0, seconds, PERIOD_S)]


def empty_room(on, n: int = 5) -> list[Image]:
    return [view.picture(on, 1000.0 + k, EMPTY) for k in range(n)]


def tracked(on, pictures, background=None, **options):
    tracker = VisionOnly(on, empty_room(on) if background is None else background, np.random.default_rng(0), **options)
    return tracker, list(track_frames(tracker, on, pictures))


@pytest.mark.parametrize("fisheye", [False, True])
def test_people_who_pass_each_other_keep_their_tracks(fisheye):
    on = view.rig(fisheye)
    _, frames = tracked(on, film(on, 5.0))
    whose: dict[int, set[int]] = {}
    for frame in frames[5:]:
        truth = straight(frame.stamp_ns / NS_PER_S)
        assert len(frame.tracks) == 3
        for track in frame.tracks:
            off = np.hypot(*(truth - (track.x, track.y)).T)
            whose.setdefault(track.id, set()).add(int(off.argmin()))
            assert off.min() < 0.3
    assert sorted(map(sorted, whose.values())) == [[0], [1], [2]]
    last = {next(iter(whose[track.id])): track for track in frames[-1].tracks}
    assert abs(last[0].vx - 1.0) < 0.4 and abs(last[1].vx + 1.0) < 0.4 and abs(last[2].vx) < 0.3


def test_nothing_of_the_contract_of_a_tracker_is_broken():
    for fisheye in (False, True):
        on = view.rig(fisheye)
        assert check_tracker(lambda *given: VisionOnly(*given), on, film(on, 1.2), empty_room(on)) == []


def test_who_leaves_ends_and_who_comes_starts():
    on = view.rig()
    _, frames = tracked(on, film(on, 6.0, lambda t: np.array([(2.0 + 1.2 * t, 1.0), (-6.0 + 1.2 * t, 0.0)])))
    ids = [[track.id for track in frame.tracks] for frame in frames]
    assert ids[10] == [1] and ids[-1] == [2] and all(len(each) <= 2 for each in ids)
    gone = next(k for k, each in enumerate(ids) if k > 10 and 1 not in each)
    assert gone * PERIOD_S < (4.3 - 2.0) / 1.2 + 0.6


def test_a_person_out_of_sight_is_looked_for_and_known_again():
    on = view.rig()
    pictures = [
        view.picture(on, t, EMPTY if 2.0 <= t < 3.0 else np.array([(0.3 * t, 0.5)])) for t in np.arange(0, 5, 0.1)
    ]
    _, frames = tracked(on, pictures)
    statuses = [[track.status for track in frame.tracks] for frame in frames]
    assert statuses[22] == ["coasting"] and statuses[28] == []
    assert [track.id for track in frames[-1].tracks] == [1]


def test_pictures_that_tell_nothing_are_passed_over():
    on = view.rig()
    black = [
        replace(each, rgb=np.zeros_like(each.rgb)) if 20 <= k < 25 else each for k, each in enumerate(film(on, 3.0))
    ]
    tracker, frames = tracked(on, black)
    assert len(frames) == len(black)
    assert {track.id for frame in frames[5:] for track in frame.tracks} == {1, 2, 3}
    tracker.update(replace(black[0], stamp_ns=99 * NS_PER_S, rgb=np.full_like(black[0].rgb, 255)))
    assert tracker.tracks() == [] and detections_of(tracker)() == []  # and after so long nobody is where they were


def test_nobody_is_nobody():
    on = view.rig()
    _, frames = tracked(on, film(on, 1.0, lambda t: EMPTY))
    assert len(frames) == 10 and not any(frame.tracks for frame in frames)


def test_the_background_is_learned_where_none_is_given_and_that_is_said():
    on = view.rig()
    told, frames = tracked(on, film(on, 5.0), background=[])
    assert told.background_learned_causally and not tracked(on, [])[0].background_learned_causally
    assert len(frames[-1].tracks) >= 2  # who walks; who stands from the start is background


def test_what_comes_twice_or_late_is_dropped_and_counted():
    on = view.rig()
    pictures = film(on, 1.0)
    tracker = VisionOnly(on, empty_room(on))
    assert [len(tracker.update(each)) for each in (pictures[0], pictures[1], pictures[1], pictures[0])] == [1, 1, 0, 0]
    assert tracker.discarded == 2


def test_memory_is_flat():
    on = view.rig()
    tracker = VisionOnly(on, empty_room(on), np.random.default_rng(0))
    pictures = film(on, 1.5)

    def once(start: int) -> int:
        for k, each in enumerate(pictures):
            tracker.update(replace(each, stamp_ns=(start + k) * NS_PER_S // 10))
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    once(0)
    before = once(len(pictures))
    after = once(2 * len(pictures))
    tracemalloc.stop()
    assert after - before < 100_000


def test_what_the_rig_cannot_give_is_bad_input():
    with pytest.raises(
        InputError, match=r"no camera \(its sensors are waist, knee\); one of kind camera, fisheye or stereo"
    ):
        VisionOnly(synthetic_room.rig(camera=False))
    on = view.rig()
    with pytest.raises(InputError, match="camera: 'west' is no camera of the rig; valid are camera"):
        VisionOnly(on, camera="west")
    with pytest.raises(
        InputError, match=r"image of 'camera' has shape \(10, 10, 3\); the rig's intrinsics say \(240, 320, 3\)"
    ):
        VisionOnly(on).update(Image("camera", 0, np.zeros((10, 10, 3), np.uint8)))
    with pytest.raises(InputError, match="track_management.coast_s"):
        VisionOnly(on, track_management={"coast_s": -1})


def test_another_model_of_people_may_be_among_what_is_learned(tmp_path):
    on = view.rig()
    VisionOnly(on, Prior(learned={"people": SHIPPED}))
    with pytest.raises(InputError, match=r"mine.npz: cannot be read "):
        VisionOnly(on, Prior(learned={"people": tmp_path / "mine.npz"}))


def test_the_preset_uses_one_camera_and_says_so():
    both = {"other": view.rig().sensors["camera"], **synthetic_room.rig().sensors}
    tracker = make_tracker("laser-vision-learning-vision", view.rig().model_copy(update={"sensors": both}))
    assert isinstance(tracker, VisionOnly) and tracker.camera == "camera"
    assert tracker.unused_sensors == ["other", "waist", "knee"]


def test_particles_move_by_white_acceleration():
    state = np.zeros((4, 1, 200_000))
    state[2] = 1.0
    moved = WhiteAcceleration(0.5, 2.0, np.array([0.5]))(state, np.random.default_rng(0))[:, 0]
    T, q = 0.5, 2.0
    np.testing.assert_allclose(moved.mean(axis=1), (0.25, 0, 0.5, 0), atol=0.01)
    covariance = np.cov(moved[[0, 2]])
    np.testing.assert_allclose(covariance, q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]), rtol=0.02)


def test_a_detection_weighs_by_its_covariance_and_draws_from_it():
    covariance = np.array([[[0.04, 0.01], [0.01, 0.09]], [[0.01, 0], [0, 0.01]]])
    by = AtDetections(np.array([(1.0, 2.0), (0.0, 0.0)]), covariance, np.zeros((2, 2, 50_000)), 1e-3)
    drawn = by.draw(50_000, np.random.default_rng(0))
    np.testing.assert_allclose(np.cov(drawn[:2, 0]), covariance[0], rtol=0.05, atol=1e-3)
    at = np.array([[[1.2], [5.0]], [[2.0], [5.0]], [[0.0], [0]], [[0.0], [0]]])
    expected = np.exp(-0.5 * 0.2**2 * np.linalg.inv(covariance[0])[0, 0]) + 1e-3
    np.testing.assert_allclose(by.log_likelihood(at)[:, 0], [np.log(expected), np.log(1e-3)], rtol=1e-9)


def test_a_scan_under_the_name_of_the_camera_is_refused():
    on = view.rig()
    (name,) = on.sensors
    scan = LaserScan(name, 0, np.ones(3, np.float32), 0.0, 0.1, 0.1, 5.0, 0.0)
    for background, fed in ([], [scan]), ([scan], film(on, 0.2)):
        with pytest.raises(InputError, match="LaserScan.* Image( or DepthImage)? is expected"):
            tracked(on, fed, background)
