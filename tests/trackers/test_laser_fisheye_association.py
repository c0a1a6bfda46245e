"""Whose trunk and whose legs: what one moment of the tracker pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackers.filters.imm import Imm
from trackers.laser.layer import Detections
from trackers.laser_fisheye_imm.association import Association, Matches, known_again
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.observations import NS_PER_S

PERIOD_S, NOW = 0.1, NS_PER_S


def ago(*seconds: float) -> np.ndarray:
    """Stamps so long before now [ns]."""
    return np.array([NOW - round(each * NS_PER_S) for each in seconds])


SEEN = np.ones(2, np.bool_)  # by their trunks


def detections(*places: tuple[float, float]) -> Detections:
    position = np.array(places, dtype=float).reshape(-1, 2)
    nothing = np.zeros(len(position))
    scanner = np.ones((len(position), 1), np.bool_)
    return Detections(position, nothing, nothing + 0.1, nothing + 2, np.zeros((2, len(position))), scanner)


def followed(people: People, measured_ns: np.ndarray) -> People:
    """All confirmed, last measured at these stamps."""
    roster = people.roster.confirm(np.arange(len(people)), 1)
    return people.changed(roster=roster.changed(measured_ns=measured_ns))


def matched(trunks: Detections, legs: Detections, **options) -> Matches:
    """Of one person in sight at (0, 1.5) and one last seen half a second ago at (0.4, 1.9), both confirmed."""
    imm = Imm()
    places = np.array([[0.0, 1.5], [0.4, 1.9]])
    state = imm.start(places, np.zeros((2, 2)), 0.02, np.full(2, 0.1))
    people = People.started(state, places, 0, SEEN, np.zeros((2, 4)), np.zeros(2, np.int64))
    people = followed(people, ago(PERIOD_S, 0.5))
    count = len(trunks)
    seen = Seen(trunks, legs, None, np.zeros((count, 4)), np.zeros(count, np.bool_), np.zeros(count, np.bool_))
    return Association(people, imm, LaserFisheyeImmOptions.model_validate(options), 0.5, NOW).matches(seen)


LEGS_OF_THE_FIRST = ((-0.1, 1.45), (0.12, 1.5))


@pytest.mark.parametrize("piece", [(0.05, 1.62), (-0.08, 1.38)])
def test_a_third_piece_of_legs_under_a_trunk_is_not_somebody_hidden(piece):
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, piece))
    assert found.track.tolist() == [0]
    assert len(found.new_position) == 0


def test_legs_beside_a_trunk_are_those_of_somebody_hidden():
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, (0.42, 1.85)))
    assert sorted(found.track.tolist()) == [0, 1]
    assert found.trunk[found.track == 1].tolist() == [-1]


def test_the_only_one_hidden_is_known_again_by_both_legs_but_not_by_what_may_be_no_leg_at_all():
    beyond_the_prediction = (1.5, 2.3)
    one = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction))
    assert one.track.tolist() == [0]
    both = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction, (1.3, 2.2)))
    assert sorted(both.track.tolist()) == [0, 1]


def by_shirt(unknown_is: float) -> list[int]:
    """Who gets the trunk between somebody without a reference, who is nearer, and somebody whose shirt it is."""
    imm = Imm()
    places = np.array([[0.0, 2.0], [0.5, 2.0]])
    shirts = np.array([[0.0, 0.0], [0.9, 0.1]])
    people = People.started(imm.start(places, np.zeros((2, 2)), 0.02, 0.1), places, 0, SEEN, shirts, np.array([0, 9]))
    people = followed(people, ago(PERIOD_S, PERIOD_S))
    shown = np.ones(1, np.bool_)
    seen = Seen(detections((0.15, 2.0)), detections(), None, np.array([[0.9, 0.1]]), shown, shown)
    options = LaserFisheyeImmOptions.model_validate({"unknown_colour": unknown_is})
    return Association(people, imm, options, 0.5, NOW).matches(seen).track.tolist()


def test_whose_shirt_it_is_comes_before_whose_shirt_nobody_knows():
    assert by_shirt(unknown_is=0.3) == [1]
    assert by_shirt(unknown_is=0.0) == [0]


@pytest.mark.parametrize(("looks", "at_m", "whose"), [(2, 0.2, [0]), (2, 0.6, []), (9, 0.2, [])])
def test_another_shirt_is_excused_by_few_looks_and_a_place_as_expected(looks, at_m, whose):
    imm = Imm()
    place = np.array([[0.0, 2.0]])
    people = People.started(
        imm.start(place, np.zeros((1, 2)), 0.02, 0.1), place, 0, SEEN[:1], np.array([[1.0, 0.0]]), np.array([looks])
    )
    people = followed(people, ago(PERIOD_S))
    shown = np.ones(1, np.bool_)
    seen = Seen(detections((at_m, 2.0)), detections(), None, np.array([[0.0, 1.0]]), shown, shown)
    assert Association(people, imm, LaserFisheyeImmOptions(), 0.5, NOW).matches(seen).track.tolist() == whose


def of_two_hidden(legs: Detections, **options) -> Matches:
    """Of two people out of sight since half a second, last seen at (-0.3, 2) and (0.3, 2)."""
    imm = Imm()
    places = np.array([[-0.3, 2.0], [0.3, 2.0]])
    people = People.started(
        imm.start(places, np.zeros((2, 2)), 0.06, 0.1), places, 0, SEEN, np.zeros((2, 4)), np.zeros(2, np.int64)
    )
    people = followed(people, ago(0.5, 0.5))
    nothing = np.zeros(0, np.bool_)
    seen = Seen(detections(), legs, None, np.zeros((0, 4)), nothing, nothing)
    return Association(people, imm, LaserFisheyeImmOptions.model_validate(options), 0.5, NOW).matches(seen)


def test_legs_between_two_hidden_people_are_no_ones_and_nobody_new():
    found = of_two_hidden(detections((0.02, 2.1)))
    assert found.track.size == 0
    assert len(found.new_position) == 0


def test_legs_that_one_hidden_person_explains_better_are_that_persons():
    assert of_two_hidden(detections((0.3, 2.1))).track.tolist() == [1]


def test_how_much_better_is_an_option():
    assert of_two_hidden(detections((0.02, 2.1)), knee={"clear_by": 0}).track.tolist() == [1]


def test_how_near_a_piece_is_a_trunks_own_is_an_option():
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, (0.05, 1.62)), knee={"under_m": 0})
    assert sorted(found.track.tolist()) == [0, 1]


def test_looks_are_like_anothers_where_they_are_not_like_ones_own():
    nowhere, nothing = np.empty((0, 2)), np.empty(0)
    E = np.array([[0.05, 0.2, np.nan], [0.1, 0.1, 0.2], [0.9, 0.9, 0.9]])
    found = Matches(
        track=np.array([0, 2, 1, 0]), position=np.zeros((4, 2)), variance=np.ones(4), trunk=np.array([0, 1, 2, -1]),
        new_position=nowhere, new_trunk=np.empty(0, np.intp), new_clearance=nothing, colour=E,
    )  # fmt: skip
    assert found.like_anothers(0.3).tolist() == [False, True, False, False]
    assert found.like_anothers(0.05).tolist() == [False, False, False, False]
    dim = replace(found, colour=np.minimum(E, 0.25))  # all are alike, as where the light fails
    assert dim.like_anothers(0.3).tolist() == [False] * 4
    assert replace(found, colour=None).like_anothers(0.3).tolist() == [False] * 4


def found_anew(at: tuple[float, float], shirt: tuple[float, float], looked_t: float = 0.2) -> list[tuple[int, int]]:
    """Of two people with known shirts, one looked upon at (0, 2) at `looked_t`, one just now, and somebody new since 0.7 s."""
    imm = Imm()
    places = np.array([[0.0, 2.0], [0.5, 2.0], at])
    shirts = np.array([[1.0, 0.0], [0.0, 1.0], shirt])
    whole = np.ones(3, np.bool_)
    people = People.started(
        imm.start(places, np.zeros((3, 2)), 0.02, 0.1), places, 0, whole, shirts, np.array([9, 9, 1])
    )
    roster = people.roster.confirm(np.arange(2), 1).changed(born_ns=np.array([0, 0, round(0.7 * NS_PER_S)]))
    looked_ns = np.array([round(looked_t * NS_PER_S), NOW, NOW])
    people = people.changed(roster=roster, clothes=people.clothes.changed(looked_ns=looked_ns))
    pairs = known_again(people, np.array([2]), LaserFisheyeImmOptions())
    return list(zip(*(each.tolist() for each in pairs), strict=True))


def test_whoever_wears_the_shirt_of_somebody_astray_is_that_person():
    assert found_anew((1.5, 2.0), (0.95, 0.05)) == [(0, 2)]


@pytest.mark.parametrize(
    ("at", "shirt", "looked_t"),
    [
        ((1.5, 2.0), (0.5, 0.5), 0.2),  # a shirt of neither
        ((1.5, 2.0), (0.0, 1.0), 0.2),  # of somebody who was seen in it since
        ((1.5, 2.0), (0.95, 0.05), 0.8),
        ((3.0, 2.0), (0.95, 0.05), 0.2),  # farther than anybody walks
    ],
)
def test_whoever_may_be_somebody_else_is_somebody_new(at, shirt, looked_t):
    assert found_anew(at, shirt, looked_t) == []


def test_a_merged_track_goes_on_where_the_other_was_under_its_own_number_and_shirt():
    imm = Imm()
    places = np.array([[0.0, 2.0], [0.5, 2.0], [1.5, 2.0]])
    shirts = np.array([[1.0, 0.0], [0.0, 1.0], [0.9, 0.1]])
    whole = np.ones(3, np.bool_)
    people = People.started(
        imm.start(places, np.zeros((3, 2)), 0.02, 0.1), places, 0, whole, shirts, np.array([9, 9, 1])
    )
    measured_ns = ago(0.7, 0.1, 0)
    people = people.changed(roster=people.roster.confirm(np.arange(2), 1).changed(measured_ns=measured_ns))
    merged = people.merged(np.array([0]), np.array([2]))
    assert merged.roster.id.tolist() == [1, 2]
    np.testing.assert_allclose(merged.positions, places[[2, 1]])
    assert merged.roster.measured_ns.tolist() == ago(0, 0.1).tolist()
    assert merged.clothes.reference.tolist() == shirts[:2].tolist()
    assert people.roster.measured_ns.tolist() == measured_ns.tolist()
