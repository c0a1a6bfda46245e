"""Where a camera shows people: learned from those whom others measure, and over the heads of who sits."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_meeting
from synthetic_room import empty_room, observe, rig as room_rig, straight_walk
from synthetic_view import rig

from trackers.cameras import PlacedCamera
from trackers.filters.imm import Imm
from trackers.fusion.camera_sources import cameras_of
from trackers.fusion.look import Expected, Look
from trackers.fusion.options import FusionOptions
from trackers.fusion.person_state import PersonMotion
from trackers.fusion.person_tracks import People
from trackers.fusion.shown_places import depth_errors, depths_tell_to_m, hidden
from trackers.observations import Image
from trackers.rig import StereoSensor, placed_camera
from trackers.vision.person_windows import ShownPlaces

BEHIND_A_WALL, IN_VIEW = np.array([[4.0, 1.3]]), np.array([[1.0, -2.2]])


def camera() -> PlacedCamera:
    return placed_camera(next(iter(rig().sensors.values())))


def test_a_place_where_others_measure_people_who_are_not_shown_is_believed_hidden():
    places = ShownPlaces(camera())
    assert places.share(np.concatenate([BEHIND_A_WALL, IN_VIEW])).tolist() == [1.0, 1.0]
    shares = []
    for _ in range(50):
        places.learn(BEHIND_A_WALL, np.ones(1), np.zeros(1, np.bool_))
        places.learn(IN_VIEW, np.ones(1), np.ones(1, np.bool_))
        shares.append(places.share(BEHIND_A_WALL)[0])
    assert (np.diff(shares) < 0).all()
    assert shares[-1] < 0.1
    assert places.share(IN_VIEW) == pytest.approx(1.0)
    elsewhere = BEHIND_A_WALL + np.array([2.0, 0.0])
    assert places.share(elsewhere) == pytest.approx(1.0)


def test_looks_that_count_nothing_teach_nothing_and_many_teach_as_one_after_the_other():
    rng = np.random.default_rng(0)
    at, asked, shown = rng.uniform(-5, 5, (40, 2)), rng.uniform(0, 1, 40), rng.random(40) < 0.5
    together, singly = ShownPlaces(camera()), ShownPlaces(camera())
    together.learn(at, np.zeros(40), shown)
    assert (together.share(at) == 1).all()
    together.learn(at, asked, shown)
    for k in range(40):
        singly.learn(at[[k]], asked[[k]], shown[[k]])
    np.testing.assert_allclose(together.share(at), singly.share(at), rtol=1e-12)
    assert (together.share(at) < 1).any()


def test_shares_are_those_of_the_people_asked():
    places = ShownPlaces(camera())
    at = np.repeat(IN_VIEW, 400, axis=0)
    places.learn(at, np.ones(400), np.arange(400) % 4 == 0)
    # the belief weighs one look of a cell's
    assert places.share(IN_VIEW)[0] == pytest.approx(0.25, abs=0.02)


def test_the_share_does_not_jump_from_place_to_place():
    rng, places = np.random.default_rng(1), ShownPlaces(camera())
    places.learn(rng.uniform(-5, 5, (300, 2)), np.ones(300), rng.random(300) < 0.5)
    way = np.linspace([-4.0, -3.0], [4.0, 2.0], 5000)  # steps of 2 mm
    share = places.share(way)
    assert np.ptp(share) > 0.3
    assert np.abs(np.diff(share)).max() < 0.02


def test_a_camera_sees_over_the_head_of_who_sits_and_not_through_who_stands():
    eye_m, chest = np.array([0.0, 0.0, 2.4]), np.array([[4.0, 0.0, 1.1]])
    at = np.array([[3.0, 0.1], [3.0, 0.1], [3.0, 0.5], [3.9, 0.0]])
    crowns = np.column_stack([at, [1.25, 1.8, 1.8, 1.8]])  # sits, stands, stands aside, is the person seen
    assert hidden(eye_m, chest, crowns, 0.25).tolist() == [[False, True, False, False]]


def test_crowns_are_over_the_places_and_above_the_heads():
    people = People.started(Imm(PersonMotion()).start(np.array([[1.0, 2.0]])), np.array([[1.0, 2.0]]), 0, 1, 1)
    expected = people.expected(np.zeros(1, np.bool_), 0)
    np.testing.assert_array_equal(people.crowns, expected.crowns)
    np.testing.assert_allclose(people.crowns, [[1.0, 2.0, people.head[0, 2] + 0.12]])


@pytest.mark.parametrize(("head_m", "hides"), [(1.55, True), (0.5, False)])
def test_a_look_would_miss_who_is_behind_a_standing_person_and_not_behind_a_low_one(head_m: float, hides: bool):
    """The camera of the room hangs at 0.7 m: over the crown of who is low it sees the chest of the one behind."""
    empty = [each for each in empty_room(np.random.default_rng(1)) if isinstance(each, Image)]
    seen = next(each for each in observe(straight_walk([(0.0, 1.5)], [(0.1, 0.0)], 2), 5) if isinstance(each, Image))
    (camera,) = cameras_of(room_rig(waist=False, knee=False), empty, FusionOptions(), None, None)
    before, nothing = np.array([[0.0, 1.5]]), np.zeros((1, 2))
    head, no = np.array([[0.0, 1.5, head_m]]), np.zeros(1, np.bool_)
    expected = Expected(before, head, nothing, np.zeros(1), nothing, no, np.full(1, np.nan), no, ~no)
    look = camera.look({"camera": seen}, expected, seen.stamp_ns)
    assert look is not None
    assert (look.missed(np.array([[0.0], [3.0]]))[0] == 1.0) == hides


def nobody_expected() -> Expected:
    none = np.empty((0, 2))
    no = np.empty(0, np.bool_)
    return Expected(none, np.empty((0, 3)), none, np.empty(0), none, no, np.empty(0), no, no)


def shown_by(depth_to_m: float, scale_depth: float = 1.0) -> dict[str, np.ndarray]:
    """Return where the sources of one stereo camera show two people, whose depths are known up to a distance."""
    on = synthetic_meeting.rig(1)
    camera = on.cameras()["stereo_1"]
    assert isinstance(camera, StereoSensor)
    of_meeting = depths_tell_to_m(depth_errors(camera)) ** 2
    on = on.model_copy(
        update={"sensors": {"stereo_1": camera.model_copy(update={"baseline_m": 0.12 * depth_to_m**2 / of_meeting})}}
    )
    empty = list(synthetic_meeting.empty_room(on))
    heads = np.array([[[-0.6, -1.2, 1.6, 0.0], [0.9, 1.2, 1.6, 0.0]]])
    (image,) = synthetic_meeting.observe(on, heads)
    image = replace(image, depth_m=image.depth_m * np.float32(scale_depth))
    found = {}
    for source in cameras_of(on, empty, FusionOptions(), None, None):
        look = source.look({"stereo_1": image}, nobody_expected(), 0)
        found[type(source).__name__] = np.empty((0, 2)) if look is None else look.position
    return found


def test_depths_show_people_as_far_as_they_tell_them_apart_and_silhouettes_those_beyond():
    near, far = np.array([-0.6, -1.2]), np.array([0.9, 1.2])  # 1.8 and 4.5 m from the camera in its corner
    everybody, some, none = shown_by(6.0), shown_by(3.0), shown_by(6.0, scale_depth=0.0)
    assert len(everybody["Depths"]) == 2 and not len(everybody["Silhouettes"])
    eye_m = placed_camera(synthetic_meeting.rig(1).cameras()["stereo_1"]).eye_m[:2]
    for found, by in ((some["Depths"], near), (some["Silhouettes"], far)):
        assert np.arctan2(*(found - eye_m).T) == pytest.approx([np.arctan2(*(by - eye_m))], abs=0.05)
    assert not len(none["Depths"]) and len(none["Silhouettes"]) == 2
    # depths tell how far off outlines are, too: that of ellipsoids is not a person's
    by_outline = np.hypot(*(none["Silhouettes"] - far).T).min()
    assert np.hypot(*(some["Silhouettes"] - far).T) < 0.75 * by_outline


def test_depths_tell_farther_the_wider_the_baseline_is():
    camera = synthetic_meeting.rig(1).cameras()["stereo_1"]

    def to_m(**of: object) -> float:
        changed = camera.model_copy(update=of)
        assert isinstance(changed, StereoSensor)
        return depths_tell_to_m(depth_errors(changed))

    at = [to_m(baseline_m=each) for each in (0.06, 0.12, 0.24)]
    assert np.diff(np.square(at)) == pytest.approx([at[0] ** 2, 2 * at[0] ** 2])
    assert to_m(mode="ideal") == np.inf
    assert 3 < to_m(baseline_m=None) < 6


def test_errors_along_a_sight_stay_whichever_way_the_camera_looks_and_round_ones_do_not():
    """A camera's covariance is long along its sight: part of that is by how tall a person is."""
    angle = np.linspace(0.0, np.pi, 7)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    along = turn @ np.diag([0.09, 0.01]) @ turn.transpose(0, 2, 1)
    place, nobody = np.zeros((7, 2)), np.zeros(7, np.intp)

    def stays_m2(covariance: np.ndarray) -> np.ndarray:
        kind = FusionOptions().camera
        return Look(("camera",), kind, place, covariance, nobody, nobody, lambda at: at[0], (1.0, 1.0, 1.0)).stays_m2

    assert np.ptp(stays_m2(along)) < 1e-12
    assert (
        stays_m2(along)[0] > stays_m2(np.tile(0.05 * np.eye(2), (7, 1, 1)))[0] == FusionOptions().camera.offset_m ** 2
    )
