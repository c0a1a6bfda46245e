"""Posture of tracks: who lies stays unseen by trunks, is seen by the head, and gets up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackers.filters.imm import Imm
from trackers.fusion.look import Look
from trackers.fusion.options import FusionOptions, HeadEvidenceOptions
from trackers.fusion.person_state import HEAD, HEAD_PLACE, LEGS, OUTLINE, PLACE, PersonMotion
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import DEPTH_SHOWN, FLOOR_SHOWN, SILHOUETTE_SHOWN, TRUNK_SHOWN, Posture
from trackers.observations import NS_PER_S

ROW, ONE = np.array([0]), np.ones(1)


def headed(posture: Posture, height_m: float, seconds: float) -> Posture:
    """Return a posture after pictures of a head of a person of 1.8 m, ten in a second."""
    for _ in range(round(10 * seconds)):
        posture = posture.later(0.1, 60.0).by_head(ROW, height_m * ONE, 0.03**2 * ONE, 1.8 * ONE, 0.1 * ONE)
    return posture


def test_the_height_of_a_head_tells_the_three_postures_apart() -> None:
    for posture, height_m in enumerate((1.68, 1.28, 0.65)):
        assert headed(Posture.upright(1), height_m, 4).probability[0].argmax() == posture


def test_probabilities_stay_so_and_a_lying_person_who_is_shown_as_standing_gets_up() -> None:
    lying = headed(headed(Posture.upright(1), 1.28, 3), 0.65, 3)
    assert lying.lies[0] and lying.rests[0]
    assert lying.shown(TRUNK_SHOWN)[0] < 0.05 < lying.shown(SILHOUETTE_SHOWN)[0] + 0.05
    up = lying
    for _ in range(6):
        up = up.detected(ROW, TRUNK_SHOWN[2] * ONE, ONE)
    assert not up.lies[0]
    np.testing.assert_allclose([each.probability.sum() for each in (lying, up)], 1)


def test_who_lies_stays_so_while_one_camera_shows_them_and_a_scanner_does_not() -> None:
    """Ten outlines of one body in a second tell what one tells; that the scanner goes on missing the trunk outweighs them."""
    nobody = np.empty(0, np.intp)
    outline = Look(
        ("camera",), FusionOptions().camera, np.empty((0, 2)), np.empty((0, 2, 2)), nobody, nobody,
        lambda points: np.ones(points.shape[1:]), SILHOUETTE_SHOWN, observes=OUTLINE,
    )  # fmt: skip
    kinds = FusionOptions()
    for other in (
        replace(outline, kind=kinds.trunk, by_posture=TRUNK_SHOWN, observes=PLACE),
        replace(outline, kind=kinds.floor, by_posture=FLOOR_SHOWN, observes=LEGS),
        replace(outline, kind=kinds.stereo, by_posture=DEPTH_SHOWN, observes=HEAD_PLACE),
    ):
        assert other.alike_s == other.kind.lasts_s < outline.alike_s
    missed = np.log(1 - 0.63 * np.array(TRUNK_SHOWN))[None]  # two of three beams pass
    for alike_s, lies in ((outline.alike_s, True), (outline.kind.lasts_s, False)):
        seen = headed(headed(Posture.upright(1), 1.28, 3), 0.65, 3)
        for _ in range(100):
            seen = seen.later(0.1, 60.0).weighed(ROW, missed)
            seen = seen.detected(ROW, SILHOUETTE_SHOWN[2] * ONE, 0.1 / alike_s * ONE)
        assert seen.lies[0] == lies


def test_legs_far_before_the_trunk_are_a_sitting_persons_and_a_seat_ends_with_who_leaves_it() -> None:
    sitting = Posture.upright(1)
    for _ in range(30):
        sitting = sitting.later(0.1, 60.0).by_legs(ROW, np.array([[0.5, 0.0]]), 0.1**2 * ONE, 0.1 * ONE)
    assert sitting.probability[0, 1] > 0.5
    sitting = sitting.settled(np.zeros((1, 2)), np.zeros((1, 2)), ONE)
    np.testing.assert_array_equal(sitting.seat, 0)
    no, yes = np.zeros(1, np.bool_), np.ones(1, np.bool_)
    for off_m, of_legs, head_is_up, speed_m_s, rests in (
        (0.1, no, no, 0.1, True),
        (0.1, no, no, 1.0, False),
        (0.8, no, no, 0.1, True),
        (0.8, no, yes, 0.1, False),  # who lies down has no head up there
        (0.2, no, yes, 0.1, True),
        (1.5, no, no, 0.1, False),
        (0.5, yes, no, 0.1, True),
        (1.0, yes, no, 0.1, False),  # farther than legs reach: they walk
    ):
        later = sitting
        for _ in range(3):
            later = later.by_place(ROW, off_m * ONE, of_legs, head_is_up, speed_m_s * ONE, ONE)
        assert later.rests[0] == rests
    walks = sitting.by_place(ROW, np.zeros(1), no, no, 2.0 * ONE, ONE)
    assert np.isnan(walks.settled(np.zeros((1, 2)), np.zeros((1, 2)), ONE).seat).all()


def test_the_farther_off_legs_are_the_less_they_tell_of_who_sits() -> None:
    """They are another's, or the place is wrong: who walks away from a place must not sit there the more surely."""
    off_m = np.array([0.8, 1.2, 2.0, 4.0])
    row, apart = np.arange(4), np.column_stack([off_m, 0 * off_m])
    for sigma_m in (0.0, 0.2):
        posture = Posture.upright(4).by_legs(row, apart, np.full(4, sigma_m**2), np.full(4, 0.1))
        odds = posture.probability[:, 1] / posture.probability[:, 0]
        assert (np.diff(odds) < 1e-9).all()
        np.testing.assert_allclose(odds[-1], 0.09 / 0.9, rtol=0.01)
    # 5 % strays over 4 m², and legs 0.32 m about a sitting person's place and a stride of 0.1 m: for a third of the time alike
    variance = 0.32**2 + 0.1**2
    sits = 0.95 * np.exp(-0.5 * 0.8**2 / variance) / (2 * np.pi * variance) + 0.05 / 4
    once = Posture.upright(1).by_legs(ROW, apart[:1], np.zeros(1), 0.1 * ONE).probability[0]
    np.testing.assert_allclose(once[1] / once[0], 0.1 * (sits / (0.05 / 4)) ** (1 / 3), rtol=1e-3)


def test_a_sensor_that_first_sees_who_sits_down_elsewhere_does_not_make_them_rise() -> None:
    """Another sensor saw the person walk four metres off, ten seconds before it sees them sit."""
    people = People.started(Imm(PersonMotion()).start(np.zeros((1, 2))), np.zeros((1, 2)), 0, 1, 2)
    first, second, row = np.array([0]), np.array([1]), np.array([0])

    def measured(people: People, number: np.ndarray, x: float, ns: int) -> tuple[People, float]:
        off_m, rest_at = people.off_rest(row, number, np.array([[x, 0.0]]), 0.1 * ONE, ns)
        seen_ns = people.seen_ns.copy()
        seen_ns[0, number] = ns
        return people.changed(rest_at=rest_at, seen_ns=seen_ns), float(off_m[0])

    people, off_m = measured(people, first, 4.0, 0)
    for ns in range(0, 11 * NS_PER_S, NS_PER_S // 10):
        if ns > 5 * NS_PER_S:  # sits
            people = people.changed(posture=people.posture.changed(probability=np.array([[0.0, 1.0, 0.0]])))
        people, off_m = measured(people, second, 0.3 if ns > 10 * NS_PER_S else 0.0, ns)
    assert off_m > 0.2
    people, off_m = measured(people, first, 0.0, 11 * NS_PER_S)
    assert off_m == 0.0


def test_nobody_seen_for_long_is_not_taken_to_lie_but_from_a_seat() -> None:
    def missed(posture: Posture) -> float:
        for _ in range(20):
            chance = 1 - 0.95 * np.array([TRUNK_SHOWN])
            posture = posture.later(0.1, 60.0).weighed(ROW, 0.1 * np.log(chance))
        return float(posture.low[0])

    assert missed(headed(Posture.upright(1), 1.28, 3)) > missed(headed(Posture.upright(1), 1.68, 3))


def test_who_lies_down_from_a_seat_lies_behind_it_away_from_the_knees() -> None:
    legs = np.array([[0.0, 0.5]])
    sitting = headed(Posture.upright(1), 1.28, 3).settled(np.ones((1, 2)), legs, ONE)
    lying = headed(sitting, 0.65, 3)
    assert not sitting.lain[0] and lying.lies[0]
    down = lying.lain_down()
    np.testing.assert_allclose(down.seat, [[1.0, 0.7]])
    np.testing.assert_array_equal(down.lain_down().seat, down.seat)


def test_a_head_that_sinks_goes_aside_and_leaves_the_pelvis_where_it_is() -> None:
    """Who sits tips over: the pelvis goes less than half of the 0.6 m with the head, and most of it if that stays as high."""
    imm, at = Imm(PersonMotion()), np.zeros((1, 2))
    moved = {}
    for sinks_m in (0.0, 0.4):
        people = People.started(imm.start(at, None, 0.02**2), at, 0, 1, 1)
        posture = people.posture.changed(probability=np.array([[0.01, 0.98, 0.01]]))
        people = people.changed(stature_m=np.array([1.75]), posture=posture)
        for share in np.r_[np.zeros(20), np.linspace(0, 1, 10)]:
            people = people.in_state(imm.predict(people.state, 0.1)).with_parts_later(0.1, HeadEvidenceOptions())
            head = np.array([[0.6 * share, 0.0, 1.3 - sinks_m * share]])
            people = people.in_state(imm.update(people.state, np.array([0]), head, np.eye(3)[None] * 0.03**2, HEAD))
        moved[sinks_m] = people.positions[0, 0]
    assert moved[0.0] > 0.45 and moved[0.4] < 0.3


def test_a_seat_is_learned_of_who_sits_upright_sooner_than_of_who_tips_over() -> None:
    at = np.zeros((2, 2))
    imm, head = Imm(PersonMotion()), np.array([[0.0, 0.0, 1.3], [0.0, 0.0, 0.9]])
    state = imm.update(imm.start(at, at, 0.02**2), np.arange(2), head, np.tile(1e-6 * np.eye(3), (2, 1, 1)), HEAD)
    people = People.started(state, at, 0, 1, 1)
    sits = people.posture.changed(probability=np.tile([0.01, 0.98, 0.01], (2, 1)), seat=at, feet=at)
    people = people.changed(stature_m=np.full(2, 1.75), posture=sits)
    learned = people.settled(np.tile([0.3, 0.0], (2, 1)), np.full(2, 1.0)).seat
    assert learned[0, 0] > 0.05 and 0 < learned[1, 0] < learned[0, 0] / 3


def test_a_look_at_legs_after_a_gap_tells_no_more_than_one() -> None:
    off = np.array([[0.5, 0.0]])
    once, late = (Posture.upright(1).by_legs(ROW, off, 0.1**2 * ONE, since_s * ONE) for since_s in (0.3, 1.0))
    np.testing.assert_array_equal(once.probability, late.probability)


def test_one_speed_tells_once_that_a_person_walks_whatever_number_of_sensors_measures_it() -> None:
    state = Imm(PersonMotion()).start(np.zeros((1, 2)), np.array([[0.6, 0.0]]))
    people = People.started(state, np.zeros((1, 2)), 0, 1, 5)
    posture = people.posture.changed(probability=np.array([[0.1, 0.88, 0.02]]))
    by = [
        people.risen(posture, np.zeros(n, np.intp), np.zeros(n), np.zeros(n, np.bool_), np.linspace(0.5, 0.2, n), 0)
        for n in (1, 5)
    ]
    assert by[0].probability[0, 0] > 0.15
    np.testing.assert_allclose(by[0].probability, by[1].probability)


def test_statures_grow_and_sink_by_time_and_not_by_looks() -> None:
    for height_m in (1.5, 1.8):
        learned = []
        for rate_hz in (5, 12, 30):
            people = People.started(Imm(PersonMotion()).start(np.zeros((1, 2))), np.zeros((1, 2)), 0, 1, 1)
            people = people.changed(stature_m=np.array([1.75]))
            for _ in range(2 * rate_hz):
                people = people.learn_stature(ROW, height_m * ONE, 0.02**2 * ONE, ONE / rate_hz, 0.45)
            learned.append(people.stature_m[0])
        np.testing.assert_allclose(learned, learned[0], atol=1e-6)
        assert abs(learned[0] - 1.75) > 0.01
