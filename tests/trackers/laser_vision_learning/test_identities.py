"""Identities by log-odds: against all assignments tried, and the beliefs that lead to them."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.laser_vision_learning.identities import Beliefs, Calibration, decided


@given(st.integers(1, 4), st.integers(0, 2), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_best_of_all_assignments_and_what_the_next_best_loses(q: int, more: int, seed: int) -> None:
    log_odds = np.random.default_rng(seed).uniform(-1, 1, (q, q + more))
    found = decided(log_odds, np.arange(q), margin=0.0)
    every = {each: sum(log_odds[i, k] for i, k in enumerate(each)) for each in permutations(range(q + more), q)}
    best = max(every, key=every.__getitem__)
    assert tuple(found.column) == best
    for body, column in enumerate(best):
        rivals = [total for each, total in every.items() if each[body] != column]
        if rivals:
            assert found.margin[body] == pytest.approx(every[best] - max(rivals))


def test_looks_that_are_sure_go_before_motion() -> None:
    found = decided(np.array([[-4.0, 5.0], [3.0, -2.0]]), np.arange(2), margin=3.0)
    assert found.column.tolist() == [1, 0]
    assert found.by_looks.all()


@pytest.mark.parametrize("log_odds", [np.zeros((2, 2)), [[2.0, 2.1], [2.0, 2.0]]], ids=["untrained", "doubtful"])
def test_else_motion_decides_and_that_is_told(log_odds: list) -> None:
    found = decided(np.array(log_odds), np.array([1, 0]), margin=3.0)
    assert found.column.tolist() == [1, 0]
    assert not found.by_looks.any()


def test_two_look_the_same_and_the_third_does_not() -> None:
    """The third is told by looks, the others by motion."""
    log_odds = np.array([[3.0, 3.0, -5.0], [3.0, 3.0, -5.0], [-5.0, -5.0, 6.0]])
    found = decided(log_odds, np.array([2, 0, 1]), margin=3.0)
    assert found.column.tolist() == [1, 0, 2]
    assert found.by_looks.tolist() == [False, False, True]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_order_of_tracks_and_identities_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    log_odds, own = rng.normal(0, 4, (4, 6)), np.arange(4)
    rows, columns = rng.permutation(4), rng.permutation(6)
    place = np.argsort(columns)
    one, other = decided(log_odds, own, 1.0), decided(log_odds[np.ix_(rows, columns)], place[own[rows]], 1.0)
    sure = one.by_looks[rows]
    np.testing.assert_array_equal(sure, other.by_looks)
    np.testing.assert_array_equal(place[one.column[rows]][sure], other.column[sure])


def test_scores_become_likelihood_ratios_by_those_of_certain_people() -> None:
    rng = np.random.default_rng(0)
    scores = Calibration().updated(rng.normal(0.8, 0.2, 5000), rng.normal(0.2, 0.2, 20000))
    # two normal distributions of one variance: (0.8 − 0.2) / 0.2² per unit of score, 0 half-way
    np.testing.assert_allclose(scores.log_ratio(np.array([0.5, 0.6, np.nan])), [0.0, 1.5, 0.0], atol=0.1)


def test_tracks_that_are_confused_share_their_identities_until_they_are_resolved() -> None:
    beliefs = Beliefs.none().of(np.arange(3), np.array([4, 7, 9]))
    beliefs = Beliefs(beliefs.serial, beliefs.number, np.eye(3, dtype=bool), beliefs.total, beliefs.count)
    beliefs = beliefs.scored(np.ones((3, 3)), memory=5)
    confused = np.zeros((3, 3), bool)
    confused[0, 1] = confused[1, 0] = True
    shared = beliefs.shared(confused)
    assert shared.doubtful.tolist() == [True, True, False]
    assert shared.count.any(axis=1).tolist() == [False, False, True]
    resolved = shared.resolved(np.array([True, False, False]), np.array([1, 0, 2]))
    assert resolved.possible.tolist() == [[False, True, False], [True, False, False], [False, False, True]]


def test_a_mean_score_follows_a_change_within_its_memory() -> None:
    beliefs = Beliefs.none().of(np.arange(1), np.array([1]))
    for score in [1.0] * 50 + [-1.0] * 15:
        beliefs = beliefs.scored(np.array([[score]]), memory=5)
    assert beliefs.mean(1)[0, 0] < -0.9
    assert np.isnan(beliefs.mean(6)).all()
