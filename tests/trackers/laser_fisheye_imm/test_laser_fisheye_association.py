"""Whose trunk and whose legs: what one moment of the tracker pairs."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.filters.imm import Imm
from trackers.laser.clusters import Detections
from trackers.laser_fisheye_imm.association import Association, Matches
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.laser_tracks import LaserTracks
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.rules import PAPER
from trackers.observations import NS_PER_S
from trackers.tracking.roster import Stage, associate

PERIOD_S, NOW = 0.1, NS_PER_S


def ago(*seconds: float) -> np.ndarray:
    """Stamps so long before now [ns]."""
    return np.array([NOW - round(each * NS_PER_S) for each in seconds])


def detections(*places: tuple[float, float]) -> Detections:
    position = np.array(places, dtype=float).reshape(-1, 2)
    nothing = np.zeros(len(position))
    scanner = np.ones((len(position), 1), np.bool_)
    n_sample = np.full(len(position), 9)
    return Detections(
        position, nothing + 0.0015, n_sample, nothing + 0.1, nothing + 2, np.zeros((len(position), 2)), scanner
    )


def followed(people: LaserTracks, measured_ns: np.ndarray) -> LaserTracks:
    """All confirmed, last measured at these stamps."""
    roster = people.roster.confirm(np.arange(len(people)), 1)
    return people.changed(roster=roster.changed(measured_ns=measured_ns))


def associated(people: LaserTracks, options: LaserFisheyeImmOptions, ns: int, **given) -> Association:
    """Of a moment that all but surely shows whoever was seen at the last, and hardly who was not."""
    seen_lately = ns - people.roster.measured_ns < round(1.5 * PERIOD_S * NS_PER_S)
    missed = np.where(seen_lately, 0.05, 0.9).__getitem__
    return Association(people, missed, np.zeros((len(people), 2)), options, ns, ns - NS_PER_S // 10, **given)


def matched(trunks: Detections, legs: Detections, /, **options) -> Matches:
    """Of one person in sight at (0, 1.5) and one last seen 0.8 s ago at (0.4, 1.9), both confirmed."""
    imm = Imm()
    places = np.array([[0.0, 1.5], [0.4, 1.9]])
    state = imm.start(places, np.zeros((2, 2)), 0.02, np.full(2, 0.1))
    people = LaserTracks.started(state, places, 0, np.zeros((2, 4)), np.zeros(2, np.int64))
    people = followed(people, ago(PERIOD_S, 0.8))
    count = len(trunks)
    seen = Seen(
        trunks,
        legs,
        np.ones(len(legs), np.bool_),
        np.zeros((count, 4)),
        np.zeros(count, np.bool_),
        np.zeros(count, np.bool_),
    )
    return associated(people, LaserFisheyeImmOptions.model_validate(options), NOW).matches(seen)


LEGS_OF_THE_FIRST = ((-0.1, 1.45), (0.12, 1.5))


def test_legs_beside_a_trunk_are_those_of_somebody_hidden():
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, (0.42, 1.85)))
    assert sorted(found.track.tolist()) == [0, 1]
    assert found.trunk[found.track == 1].tolist() == [-1]


def test_a_trunk_that_a_single_beam_shows_goes_on_with_its_person_but_starts_nobody():
    trunks = detections((0.0, 1.5), (2.0, 3.0), (3.0, 3.0))
    found = matched(trunks.changed(n_sample=np.array([1, 2, 3])), detections())
    assert found.track.tolist() == [0]
    assert found.new_position.tolist() == [[3.0, 3.0]]


def test_a_bag_beside_the_legs_of_a_trunk_is_not_somebody_hidden_near_by():
    bag = (0.2, 1.62)
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, bag))
    assert found.track.tolist() == [0]
    assert len(found.new_position) == 0
    mistaken = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, bag), track_management={"apart_m": 0.0})
    assert sorted(mistaken.track.tolist()) == [0, 1]


def test_by_the_paper_a_second_track_on_the_legs_of_who_has_a_trunk_gets_nothing():
    """The legs are nearer to it than to the person."""
    on_the_second = ((0.23, 1.7), (0.27, 1.7))
    found = matched(detections((0.0, 1.5)), detections(*on_the_second), **PAPER)
    assert found.track.tolist() == [0]
    their_own = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, *on_the_second), **PAPER)
    assert sorted(their_own.track.tolist()) == [0, 1]


def test_the_only_one_hidden_is_re_identified_by_both_legs_but_not_by_what_may_be_no_leg_at_all():
    beyond_the_prediction = (1.5, 2.3)
    one = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction))
    assert one.track.tolist() == [0]
    both = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, beyond_the_prediction, (1.3, 2.2)))
    assert sorted(both.track.tolist()) == [0, 1]


def test_of_several_hidden_the_likeliest_is_re_identified():
    places = np.array([[0.4, 1.9], [2.6, 1.9]])
    state = Imm().start(places, np.zeros((2, 2)), 0.02, np.full(2, 0.1))
    people = LaserTracks.started(state, places, 0, np.zeros((2, 4)), np.zeros(2, np.int64))
    people = followed(people, ago(0.8, 0.9))
    nothing = np.zeros(1, np.bool_)
    seen = Seen(detections((1.3, 1.9)), detections(), np.empty(0, np.bool_), np.zeros((1, 4)), nothing, nothing)
    assert associated(people, LaserFisheyeImmOptions(), NOW).matches(seen).track.tolist() == [0]


def test_trunk_before_legs_however_near_as_in_the_paper():
    places = np.array([[0.0, 1.5]])
    people = followed(
        LaserTracks.started(
            Imm().start(places, np.zeros((1, 2)), 0.02, 0.1), places, 0, np.zeros((1, 4)), np.zeros(1, np.int64)
        ),
        ago(PERIOD_S),
    )
    nothing = np.zeros(1, np.bool_)
    far_trunk, near_legs = (0.45, 1.5), ((-0.1, 1.45), (0.1, 1.55))
    seen = Seen(
        detections(far_trunk),
        detections(*near_legs),
        np.ones(len(near_legs), np.bool_),
        np.zeros((1, 4)),
        nothing,
        nothing,
    )

    found = associated(people, LaserFisheyeImmOptions(), NOW).matches(seen)
    assert found.trunk.tolist() == [0]
    assert found.position == pytest.approx(np.array([far_trunk]))


def test_a_shirt_decides_between_two_who_are_about_as_near():
    imm = Imm()
    places = np.array([[0.0, 2.0], [0.5, 2.0]])
    shirts = np.array([[0.1, 0.9], [0.9, 0.1]])
    people = LaserTracks.started(imm.start(places, np.zeros((2, 2)), 0.02, 0.1), places, 0, shirts, np.array([9, 9]))
    people = followed(people, ago(PERIOD_S, PERIOD_S))
    shown = np.ones(1, np.bool_)
    seen = Seen(detections((0.2, 2.0)), detections(), np.empty(0, np.bool_), np.array([[0.9, 0.1]]), shown, shown)

    def whose(**options) -> list[int]:
        given = LaserFisheyeImmOptions.model_validate(options)
        return associated(people, given, NOW).matches(seen).track.tolist()

    assert whose() == [1]
    assert whose(appearance={"weight": 0}) == [0]


def test_another_shirt_rules_nobody_out_whom_nothing_else_explains():
    """A look may be of what stands before them."""
    place, shown = np.array([[0.0, 2.0]]), np.ones(1, np.bool_)
    state = Imm().start(place, np.zeros((1, 2)), 0.02, 0.1)
    people = followed(LaserTracks.started(state, place, 0, np.array([[1.0, 0.0]]), np.array([9])), ago(PERIOD_S))
    seen = Seen(detections((0.1, 2.0)), detections(), np.empty(0, np.bool_), np.array([[0.0, 1.0]]), shown, shown)

    def whose(**options) -> list[int]:
        return associated(people, LaserFisheyeImmOptions(**options), NOW).matches(seen).track.tolist()

    assert whose() == [0]


def test_the_own_shirt_speaks_for_somebody_beside_whose_shirt_nobody_has_seen():
    places = np.array([[0.0, 2.0], [0.5, 2.0]])
    shirts = np.array([[0.9, 0.1], [0.0, 0.0]])
    people = LaserTracks.started(Imm().start(places, np.zeros((2, 2)), 0.02, 0.1), places, 0, shirts, np.array([9, 0]))
    people = followed(people, ago(PERIOD_S, PERIOD_S))
    shown = np.ones(1, np.bool_)

    def whose(look: list[float], **options) -> list[int]:
        seen = Seen(detections((0.3, 2.0)), detections(), np.empty(0, np.bool_), np.array([look]), shown, shown)
        given = LaserFisheyeImmOptions.model_validate(options)
        return associated(people, given, NOW).matches(seen).track.tolist()

    assert whose([0.8, 0.2]) == [0]
    assert whose([0.1, 0.9]) == [1]


@pytest.mark.parametrize(("same_below", "known", "others"), [(0.3, [0], []), (1.0, [0], [0]), (0.0, [], [])])
def test_who_comes_back_far_from_the_prediction_is_known_by_the_shirt(same_below, known, others):
    options = LaserFisheyeImmOptions(appearance={"same_below": same_below})
    places = np.array([[0.4, 1.9]])
    state = Imm().start(places, np.zeros((1, 2)), 0.02, 0.1)
    people = followed(LaserTracks.started(state, places, 0, np.array([[0.9, 0.1]]), np.array([9])), ago(0.8))

    def whose(shirt: list[float]) -> list[int]:
        seen = Seen(
            detections((1.5, 2.3)),
            detections(),
            np.empty(0, np.bool_),
            np.array([shirt]),
            *2 * (np.ones(1, np.bool_),),
        )
        return associated(people, options, NOW).matches(seen).track.tolist()

    assert whose([0.8, 0.2]) == known
    assert whose([0.1, 0.9]) == others


def of_two_hidden(legs: Detections, **options) -> Matches:
    """Of two people out of sight since half a second, last seen at (-0.3, 2) and (0.3, 2)."""
    imm = Imm()
    places = np.array([[-0.3, 2.0], [0.3, 2.0]])
    people = LaserTracks.started(
        imm.start(places, np.zeros((2, 2)), 0.06, 0.1), places, 0, np.zeros((2, 4)), np.zeros(2, np.int64)
    )
    people = followed(people, ago(0.5, 0.5))
    nothing = np.zeros(0, np.bool_)
    firm = np.ones(len(legs), np.bool_)
    seen = Seen(detections(), legs, firm, np.zeros((0, 4)), nothing, nothing)
    return associated(people, LaserFisheyeImmOptions.model_validate(options), NOW).matches(seen)


def test_legs_that_one_hidden_person_explains_better_are_that_persons():
    assert of_two_hidden(detections((0.3, 2.1))).track.tolist() == [1]


def of_somebody_new(knows_room: bool) -> Matches:
    """Of one person seen once, at (0, 2), with a foot ahead and one behind, and a third leg half a step before them."""
    place, legs = np.array([[0.0, 2.0]]), detections((-0.25, 2.0), (0.25, 2.0), (0.45, 2.1))
    people = LaserTracks.started(
        Imm().start(place, np.zeros((1, 2)), 0.06, 0.1), place, 0, np.zeros((1, 4)), np.zeros(1, np.int64)
    )
    assert not people.confirmed.any()
    seen = Seen(detections(), legs, np.ones(3, np.bool_), np.zeros((0, 4)), *[np.zeros(0, np.bool_)] * 2)
    return associated(people, LaserFisheyeImmOptions(), NOW, sees_waists=False, knows_room=knows_room).matches(seen)


def test_somebody_new_takes_both_their_legs_before_legs_pair_off():
    theirs = of_somebody_new(knows_room=True)
    assert theirs.position == pytest.approx(np.array([[0.0, 2.0]]))
    assert not theirs.single
    assert theirs.new_position == pytest.approx(np.array([[0.45, 2.1]]))


def test_what_may_be_a_flicker_of_the_room_takes_no_legs():
    paired = of_somebody_new(knows_room=False)
    assert paired.position == pytest.approx(np.array([[-0.25, 2.0]]))
    assert paired.single.all()


def of_one(measured: Detections, unseen: float, existence: float = 1.0, trunk: bool = True, **options) -> Matches:
    """Of one confirmed person expected at (0, 2), about 0.2 m, a moment that would not show them so probably."""
    place, nobody = np.array([[0.0, 2.0]]), detections()
    state = Imm().start(place, np.zeros((1, 2)), 0.04, 0.1)
    people = followed(LaserTracks.started(state, place, 0, np.zeros((1, 4)), np.zeros(1, np.int64)), ago(PERIOD_S))
    people = people.changed(existence=np.array([existence]))
    trunks, legs = (measured, nobody) if trunk else (nobody, measured)
    nothing = np.zeros(len(trunks), np.bool_)
    seen = Seen(trunks, legs, np.ones(len(legs), np.bool_), np.zeros((len(trunks), 4)), nothing, nothing)
    given = LaserFisheyeImmOptions.model_validate(options)
    return Association(
        people, np.array([unseen]).__getitem__, np.zeros((len(people), 2)), given, NOW, NOW - NS_PER_S // 10
    ).matches(seen)


def test_who_stands_in_plain_sight_is_what_is_seen_there_and_who_is_hidden_stays_hidden():
    """More than four deviations from where they are expected."""
    there = detections((0.9, 2.0))
    assert of_one(there, unseen=0.01).track.tolist() == [0]
    hidden = of_one(there, unseen=0.9)
    assert hidden.track.tolist() == []
    assert hidden.new_trunk.tolist() == [0]
    assert of_one(there, unseen=0.9, clutter_density_m2=None).track.tolist() == [0]


def test_who_is_likely_gone_is_not_the_next_to_come():
    there = detections((0.8, 2.0))
    assert of_one(there, unseen=0.9).track.tolist() == [0]
    assert of_one(there, unseen=0.9, existence=0.02).track.tolist() == []


def test_what_is_measured_where_it_is_expected_makes_surer_that_somebody_is_there():
    near, far = (of_one(detections((x, 2.0)), 0.01, existence=0.1).existence for x in (0.0, 0.7))
    assert near > 0.95
    assert 0.05 < far < 0.9
    assert of_one(detections((0.7, 2.0)), 0.01, 0.1, track_management={"survival_s": None}).existence == 1


def test_who_is_likely_gone_is_not_re_identified():
    places = np.array([[0.4, 1.9]])
    state = Imm().start(places, np.zeros((1, 2)), 0.02, 0.1)
    people = followed(LaserTracks.started(state, places, 0, np.array([[0.9, 0.1]]), np.array([9])), ago(0.8))
    shown = np.ones(1, np.bool_)
    seen = Seen(detections((1.5, 2.3)), detections(), np.empty(0, np.bool_), np.array([[0.8, 0.2]]), shown, shown)
    for existence, track in ((0.6, [0]), (0.4, [])):
        at = associated(people.changed(existence=np.array([existence])), LaserFisheyeImmOptions(), NOW)
        assert at.matches(seen).track.tolist() == track


def test_a_leg_between_a_trunk_and_somebody_hidden_is_whose_other_is_missing():
    """The trunk has both its legs nearer; without it they would all be in reach of either."""
    between = (0.33, 1.8)
    found = matched(detections((0.0, 1.5)), detections(*LEGS_OF_THE_FIRST, between, (0.48, 2.0)))
    (hidden,) = found.position[found.track == 1]
    assert hidden == pytest.approx(np.mean([between, (0.48, 2.0)], axis=0))
    assert not found.single[found.track == 1]


def test_a_look_costs_its_weight_about_what_is_even_and_never_more_than_that_it_is_wrong():
    people = LaserTracks.started(
        Imm().start(np.zeros((1, 2)), np.zeros((1, 2)), 0.02, 0.1),
        np.zeros((1, 2)),
        0,
        np.zeros((1, 4)),
        np.ones(1, np.int64),
    )
    at = associated(people, LaserFisheyeImmOptions(), NOW)
    alike, even, unknown, other = at._by_colour(np.array([[0.27, 0.37, np.nan, 1.0]]))[0]
    assert alike == pytest.approx(-6, abs=0.1)
    assert even == unknown == pytest.approx(0, abs=0.02)
    assert 10 < other < -2 * np.log(0.005)


def test_the_chance_of_a_miss_is_asked_only_where_it_decides_and_the_pairs_are_those_of_all():
    rng, n_asked, n_all = np.random.default_rng(0), 0, 0
    for _ in range(300):
        n, k = rng.integers(1, 6, size=2)
        missed, existence = rng.uniform(0.001, 1, n), rng.uniform(0.01, 1, n)
        asked: list[int] = []

        def of(track: np.ndarray, missed: np.ndarray = missed, asked: list[int] = asked) -> np.ndarray:
            asked += track.tolist()
            return missed[track]

        place = rng.normal(size=(n, 2))
        state = Imm().start(place, np.zeros((n, 2)), 0.02, np.full(n, 0.1))
        people = LaserTracks.started(state, place, 0, np.zeros((n, 4)), np.zeros(n, np.int64))
        people = people.changed(existence=existence)
        at = Association(people, of, np.zeros((n, 2)), LaserFisheyeImmOptions(), NOW, NOW - NS_PER_S // 10)
        cost, impossible = rng.normal(0, 8, (n, k)), rng.random((n, k)) < 0.6
        of_all = -2 * np.log((1 - existence + existence * missed) / existence)
        unpaired, everybody = at._unpaired(cost, impossible), np.ones(n, np.bool_)
        some, each = (associate([Stage(everybody, [cost], [impossible], of)]) for of in (unpaired, of_all))
        assert np.array_equal(some, each)
        n_asked, n_all = n_asked + len(asked), n_all + n
    assert 0 < n_asked < 0.7 * n_all
