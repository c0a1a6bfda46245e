"""Whose trunk and whose legs: what one moment of the tracker pairs."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.filters.imm import Imm
from trackers.laser.detections import Detections
from trackers.laser_fisheye_imm.association import Association, Matches
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.observations import NS_PER_S

PERIOD_S, NOW = 0.1, NS_PER_S


def ago(*seconds: float) -> np.ndarray:
    """Stamps so long before now [ns]."""
    return np.array([NOW - round(each * NS_PER_S) for each in seconds])


def detections(*places: tuple[float, float]) -> Detections:
    position = np.array(places, dtype=float).reshape(-1, 2)
    nothing = np.zeros(len(position))
    scanner = np.ones((len(position), 1), np.bool_)
    n_sample = np.full(len(position), 9)
    return Detections(position, nothing, n_sample, nothing + 0.1, nothing + 2, np.zeros((len(position), 2)), scanner)


def followed(people: People, measured_ns: np.ndarray) -> People:
    """All confirmed, last measured at these stamps."""
    roster = people.roster.confirm(np.arange(len(people)), 1)
    return people.changed(roster=roster.changed(measured_ns=measured_ns))


def matched(trunks: Detections, legs: Detections, **options) -> Matches:
    """Of one person in sight at (0, 1.5) and one last seen 0.8 s ago at (0.4, 1.9), both confirmed."""
    imm = Imm()
    places = np.array([[0.0, 1.5], [0.4, 1.9]])
    state = imm.start(places, np.zeros((2, 2)), 0.02, np.full(2, 0.1))
    people = People.started(state, places, 0, np.zeros((2, 4)), np.zeros(2, np.int64))
    people = followed(people, ago(PERIOD_S, 0.8))
    count = len(trunks)
    seen = Seen(
        trunks,
        legs,
        np.ones(len(legs), np.bool_),
        None,
        np.zeros((count, 4)),
        np.zeros(count, np.bool_),
        np.zeros(count, np.bool_),
    )
    return Association(people, LaserFisheyeImmOptions.model_validate(options), 0.5, NOW).matches(seen)


LEGS_OF_THE_FIRST = ((-0.1, 1.45), (0.12, 1.5))


def test_legs_beside_a_trunk_are_those_of_somebody_hidden():
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, (0.42, 1.85)))
    assert sorted(found.track.tolist()) == [0, 1]
    assert found.trunk[found.track == 1].tolist() == [-1]


def test_a_bag_beside_the_legs_of_a_trunk_is_not_somebody_hidden_near_by():
    bag = (0.2, 1.62)
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, bag))
    assert found.track.tolist() == [0]
    assert len(found.new_position) == 0
    mistaken = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, bag), management={"apart_m": 0.0})
    assert sorted(mistaken.track.tolist()) == [0, 1]


def test_the_only_one_hidden_is_re_identified_by_both_legs_but_not_by_what_may_be_no_leg_at_all():
    beyond_the_prediction = (1.5, 2.3)
    one = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction))
    assert one.track.tolist() == [0]
    both = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction, (1.3, 2.2)))
    assert sorted(both.track.tolist()) == [0, 1]


def test_trunk_before_legs_as_in_the_paper_or_whichever_is_likelier():
    places = np.array([[0.0, 1.5]])
    people = followed(
        People.started(
            Imm().start(places, np.zeros((1, 2)), 0.02, 0.1), places, 0, np.zeros((1, 4)), np.zeros(1, np.int64)
        ),
        ago(PERIOD_S),
    )
    nothing = np.zeros(1, np.bool_)
    far_trunk, near_legs = (0.75, 1.5), ((-0.1, 1.45), (0.1, 1.55))
    seen = Seen(
        detections(far_trunk),
        detections(*near_legs),
        np.ones(len(near_legs), np.bool_),
        None,
        np.zeros((1, 4)),
        nothing,
        nothing,
    )

    def trunk_of(**options) -> list[int]:
        return Association(people, LaserFisheyeImmOptions(**options), 0.5, NOW).matches(seen).trunk.tolist()

    assert trunk_of() == [-1]
    assert trunk_of(at_once=False) == [0]


def test_a_shirt_decides_between_two_who_are_about_as_near():
    imm = Imm()
    places = np.array([[0.0, 2.0], [0.5, 2.0]])
    shirts = np.array([[0.1, 0.9], [0.9, 0.1]])
    people = People.started(imm.start(places, np.zeros((2, 2)), 0.02, 0.1), places, 0, shirts, np.array([9, 9]))
    people = followed(people, ago(PERIOD_S, PERIOD_S))
    shown = np.ones(1, np.bool_)
    seen = Seen(detections((0.2, 2.0)), detections(), np.empty(0, np.bool_), None, np.array([[0.9, 0.1]]), shown, shown)

    def whose(**options) -> list[int]:
        given = LaserFisheyeImmOptions.model_validate(options)
        return Association(people, given, 0.5, NOW).matches(seen).track.tolist()

    assert whose() == [1]
    assert whose(colour_weight=0) == [0]


def test_the_own_shirt_speaks_for_somebody_beside_whose_shirt_nobody_has_seen():
    places = np.array([[0.0, 2.0], [0.5, 2.0]])
    shirts = np.array([[0.9, 0.1], [0.0, 0.0]])
    people = People.started(Imm().start(places, np.zeros((2, 2)), 0.02, 0.1), places, 0, shirts, np.array([9, 0]))
    people = followed(people, ago(PERIOD_S, PERIOD_S))
    shown = np.ones(1, np.bool_)

    def whose(look: list[float], **options) -> list[int]:
        seen = Seen(detections((0.3, 2.0)), detections(), np.empty(0, np.bool_), None, np.array([look]), shown, shown)
        given = LaserFisheyeImmOptions.model_validate(options)
        return Association(people, given, 0.5, NOW).matches(seen).track.tolist()

    assert whose([0.8, 0.2]) == [0]
    assert whose([0.8, 0.2], even_at=0) == [1]
    assert whose([0.1, 0.9]) == [1]


def test_who_comes_back_far_from_the_prediction_is_known_by_the_shirt():
    places = np.array([[0.4, 1.9]])
    state = Imm().start(places, np.zeros((1, 2)), 0.02, 0.1)
    people = followed(People.started(state, places, 0, np.array([[0.9, 0.1]]), np.array([9])), ago(0.8))

    def whose(shirt: list[float]) -> list[int]:
        seen = Seen(
            detections((1.5, 2.3)),
            detections(),
            np.empty(0, np.bool_),
            None,
            np.array([shirt]),
            *2 * (np.ones(1, np.bool_),),
        )
        return Association(people, LaserFisheyeImmOptions(), 0.5, NOW).matches(seen).track.tolist()

    assert whose([0.8, 0.2]) == [0]
    assert whose([0.1, 0.9]) == []


def of_two_hidden(legs: Detections, **options) -> Matches:
    """Of two people out of sight since half a second, last seen at (-0.3, 2) and (0.3, 2)."""
    imm = Imm()
    places = np.array([[-0.3, 2.0], [0.3, 2.0]])
    people = People.started(
        imm.start(places, np.zeros((2, 2)), 0.06, 0.1), places, 0, np.zeros((2, 4)), np.zeros(2, np.int64)
    )
    people = followed(people, ago(0.5, 0.5))
    nothing = np.zeros(0, np.bool_)
    firm = np.ones(len(legs), np.bool_)
    seen = Seen(detections(), legs, firm, None, np.zeros((0, 4)), nothing, nothing)
    return Association(people, LaserFisheyeImmOptions.model_validate(options), 0.5, NOW).matches(seen)


def test_legs_that_one_hidden_person_explains_better_are_that_persons():
    assert of_two_hidden(detections((0.3, 2.1))).track.tolist() == [1]


def of_somebody_new(knows_room: bool) -> Matches:
    """Of one person seen once, at (0, 2), with a foot ahead and one behind, and a third leg half a step before them."""
    place, legs = np.array([[0.0, 2.0]]), detections((-0.25, 2.0), (0.25, 2.0), (0.45, 2.1))
    people = People.started(
        Imm().start(place, np.zeros((1, 2)), 0.06, 0.1), place, 0, np.zeros((1, 4)), np.zeros(1, np.int64)
    )
    assert not people.confirmed.any()
    seen = Seen(detections(), legs, np.ones(3, np.bool_), None, np.zeros((0, 4)), *[np.zeros(0, np.bool_)] * 2)
    return Association(people, LaserFisheyeImmOptions(), 0.5, NOW, sees_waists=False, knows_room=knows_room).matches(
        seen
    )


def test_somebody_new_takes_both_their_legs_before_legs_pair_off():
    theirs = of_somebody_new(knows_room=True)
    assert theirs.position == pytest.approx(np.array([[0.0, 2.0]]))
    assert not theirs.lone
    assert theirs.new_position == pytest.approx(np.array([[0.45, 2.1]]))


def test_what_may_be_a_flicker_of_the_room_takes_no_legs():
    paired = of_somebody_new(knows_room=False)
    assert paired.position == pytest.approx(np.array([[-0.25, 2.0]]))
    assert paired.lone.all()
