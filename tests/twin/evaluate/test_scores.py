"""CLEAR, identity, HOTA, OSPA and GOSPA on frames small enough to count by hand."""

import numpy as np
import pytest
from motmetrics_names import histories
from scipy.optimize import linear_sum_assignment

from twin.evaluate.clear import PairMatrix, clear, find_switches, identity, match_frames
from twin.evaluate.hota import THRESHOLDS, hota
from twin.evaluate.summary import gospa, ospa


def matrix(persons, tracks, values) -> PairMatrix:
    shape = (len(persons), len(tracks))
    return PairMatrix(np.array(persons, int), np.array(tracks, int), np.array(values, float).reshape(shape))


def test_an_earlier_pair_is_kept_though_another_track_is_nearer():
    frames = [matrix([1], [7], [[0.1]]), matrix([1], [7, 8], [[0.4, 0.0]])]
    second = match_frames(frames, 0.5)[1]
    assert second.columns.tolist() == [0]
    assert second.distances.tolist() == [0.4]


def test_as_many_pairs_as_possible_come_before_near_pairs():
    matches = match_frames([matrix([1, 2], [7, 8], [[0.0, 0.4], [0.4, 9.0]])], 0.5)[0]
    assert list(zip(matches.rows.tolist(), matches.columns.tolist(), strict=True)) == [(0, 1), (1, 0)]


def test_the_gate_itself_is_within_the_gate():
    assert clear([matrix([1], [7], [[0.5]])], 0.5).matches == 1
    assert clear([matrix([1], [7], [[0.5000001]])], 0.5).matches == 0


def test_a_distance_that_is_not_a_number_is_no_pair():
    assert clear([matrix([1], [7], [[np.nan]])], 0.5).matches == 0


def test_the_latest_owner_keeps_a_track_whatever_the_order_of_people():
    frames = [
        matrix([1], [7], [[0.1]]),
        matrix(
            [1, 2],
            [7],
            [
                [
                    0.9,
                ],
                [0.1],
            ],
        ),
        matrix([1, 2], [7], [[0.1], [0.4]]),
    ]
    reversed_frames = [PairMatrix(f.person_ids[::-1], f.track_ids, f.values[::-1]) for f in frames]
    for order in (frames, reversed_frames):
        last = match_frames(order, 0.5)[-1]
        assert order[-1].person_ids[last.rows].tolist() == [2]


def test_counts_by_hand():
    frames = [
        matrix([1, 2], [7, 8], [[0.1, 9], [9, 0.3]]),
        matrix([1, 2], [7], [[0.2], [9]]),  # person 2 missed
        matrix([1, 2], [9, 8], [[0.1, 9], [9, 0.1]]),  # person 1 under a new id
        matrix([1], [9, 5], [[0.1, 9]]),  # 5 is a false positive
        matrix([], [], []),
    ]
    scores = clear(frames, 0.5)
    assert (scores.persons, scores.matches, scores.misses, scores.false_positives) == (7, 6, 1, 1)
    assert scores.id_switches == 1
    assert histories(frames, 0.5).fragmentations == 1
    assert scores.mota == pytest.approx(1 - 3 / 7)
    assert scores.motp == pytest.approx(0.9 / 6)
    switch = find_switches(frames, match_frames(frames, 0.5))[0]
    assert (switch.frame, switch.person_id, switch.previous_track_id, switch.track_id) == (2, 1, 7, 9)
    # Best pairing: person 1 with 7 or 9 (two frames each), person 2 with 8 (two frames).
    identities = identity(frames, 0.5)
    assert (identities.true_positives, identities.misses, identities.false_positives) == (4, 3, 3)


def test_no_person_and_no_track():
    for frames in ([], [matrix([], [], [])]):
        scores, higher_order = clear(frames, 0.5), hota(frames)
        assert (scores.mota, scores.motp) == (None, None)
        assert identity(frames, 0.5).idf1 is None
        assert not higher_order.applies


def test_only_false_positives():
    frames = [matrix([], [3], [])]
    assert clear(frames, 0.5).mota is None
    assert clear(frames, 0.5).false_positives == 1
    assert identity(frames, 0.5).idf1 == 0
    assert hota(frames).applies
    assert hota(frames).hota.max() == 0


def test_hota_by_hand():
    # One person, two frames, first under id 7 (similarity 0.6), then under id 8 (similarity 1).
    scores = hota([matrix([1], [7], [[0.6]]), matrix([1], [8], [[1.0]])])
    coarse = THRESHOLDS < 0.61
    assert THRESHOLDS[0] == pytest.approx(0.05)
    assert THRESHOLDS[-1] == pytest.approx(0.95)
    np.testing.assert_allclose(scores.det_a, np.where(coarse, 1, 1 / 3))
    np.testing.assert_allclose(scores.ass_a, 1 / 2)
    np.testing.assert_allclose(scores.hota, np.sqrt(np.where(coarse, 1, 1 / 3) / 2))


def test_hota_written_out():
    """TrackEval's steps in loops, three people and three tracks that are there in each of four frames."""
    for seed in range(60):
        similarity = np.random.default_rng(seed).random((4, 3, 3)) ** 2
        potential, together = np.zeros((3, 3)), np.zeros((len(THRESHOLDS), 3, 3))
        for frame in similarity:
            for person, track in np.ndindex(3, 3):
                others = frame[person].sum() + frame[:, track].sum() - frame[person, track]
                potential[person, track] += frame[person, track] / others
        alignment = potential / (4 + 4 - potential)
        for frame in similarity:
            for person, track in zip(*linear_sum_assignment(-alignment * frame), strict=True):
                together[frame[person, track] >= THRESHOLDS, person, track] += 1
        right = together.sum(axis=(1, 2))
        associated = (together * together / (4 + 4 - together)).sum(axis=(1, 2)) / np.maximum(right, 1)
        ids = [1, 2, 3]
        scores = hota([matrix(ids, ids, frame) for frame in similarity])
        np.testing.assert_allclose(scores.hota, np.sqrt(right / (24 - right) * associated), err_msg=str(seed))


def test_set_distances_by_hand():
    distances = np.array([[0.3, 5.0], [4.0, 2.0], [6.0, 7.0]])  # three people, two tracks, one real pair
    assert ospa(distances, 1.0, 1) == pytest.approx((0.3 + 1 + 1) / 3)
    result = gospa(distances, 1.0, 2)
    assert (result.localisation, result.missed, result.false) == pytest.approx((0.09, 1.0, 0.5))
    assert result.distance == pytest.approx(np.sqrt(1.59))


@pytest.mark.parametrize(("shape", "expected_ospa", "expected_gospa"), [((0, 0), 0, 0), ((2, 0), 1, 1), ((0, 2), 1, 1)])
def test_set_distances_of_empty_sets(shape, expected_ospa, expected_gospa):
    assert ospa(np.zeros(shape), 1.0, 1) == expected_ospa
    assert gospa(np.zeros(shape), 1.0, 2).distance == expected_gospa


def test_values_of_a_wrong_shape_are_refused():
    with pytest.raises(ValueError, match="shape"):
        PairMatrix(np.array([1]), np.array([7, 8]), np.zeros((1, 1)))
