"""Where a camera shows people: learned from those whom others measure, and over the heads of who sits."""

import numpy as np
import pytest
from synthetic_room import empty_room, observe, rig as room_rig, straight_walk
from synthetic_view import rig

from trackers.cameras import PlacedCamera
from trackers.filters.imm import Imm
from trackers.fusion.cameras import ShownPlaces, cameras_of, hidden
from trackers.fusion.look import Expected
from trackers.fusion.motion import PersonMotion
from trackers.fusion.options import FusionOptions
from trackers.fusion.people import People
from trackers.observations import Image
from trackers.rig import placed_camera

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
    expected = people.expected(np.zeros(1, np.bool_))
    np.testing.assert_array_equal(people.crowns, expected.crowns)
    np.testing.assert_allclose(people.crowns, [[1.0, 2.0, people.head[0, 2] + 0.12]])


@pytest.mark.parametrize(("head_m", "hides"), [(1.55, True), (0.5, False)])
def test_a_look_would_miss_who_is_behind_a_standing_person_and_not_behind_a_low_one(head_m: float, hides: bool):
    """The camera of the room hangs at 0.7 m: over the crown of who is low it sees the chest of the one behind."""
    empty = [each for each in empty_room(np.random.default_rng(1)) if isinstance(each, Image)]
    seen = next(each for each in observe(straight_walk([(0.0, 1.5)], [(0.1, 0.0)], 2), 5) if isinstance(each, Image))
    (camera,) = cameras_of(room_rig(waist=False, knee=False), empty, FusionOptions(), None, None)
    before, nothing = np.array([[0.0, 1.5]]), np.zeros((1, 2))
    expected = Expected(before, np.array([[0.0, 1.5, head_m]]), nothing, np.zeros(1), nothing, np.zeros(1, np.bool_))
    look = camera.look({"camera": seen}, expected, seen.stamp_ns)
    assert look is not None
    assert (look.missed(np.array([[0.0], [3.0]]))[0] == 1.0) == hides
