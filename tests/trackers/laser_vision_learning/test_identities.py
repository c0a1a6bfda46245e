"""Who is who at a split: against all assignments tried, and what groups do besides."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from trackers.laser_vision_learning.identities import IdentityOptions, decided

ANY = IdentityOptions(margin=0.0)


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_best_of_all_assignments_and_what_the_next_best_loses(q: int, m: int, seed: int) -> None:
    scores = np.random.default_rng(seed).uniform(-1, 1, (q, m))
    found = decided(scores, np.zeros((q, m)), ANY)
    if q <= m:
        every = {each: sum(scores[i, k] for i, k in enumerate(each)) for each in permutations(range(m), q)}
    else:
        every = {}
        for each in permutations(range(q), m):  # body of each member
            of = [-1] * q
            for member, body in enumerate(each):
                of[body] = member
            every[tuple(of)] = sum(scores[body, member] for member, body in enumerate(each))
    best = max(every, key=every.__getitem__)
    assert tuple(found.member) == best
    for body, member in enumerate(best):
        rivals = [total for each, total in every.items() if each[body] != member]
        if member != -1 and rivals:
            assert found.margin[body] == pytest.approx(every[best] - max(rivals))


def test_looks_that_are_sure_go_before_motion() -> None:
    motion = np.array([[0.0, 9.0], [9.0, 0.0]])
    found = decided(np.array([[-0.4, 0.5], [0.3, -0.2]]), motion)
    assert found.member.tolist() == [1, 0]
    assert found.by_looks.all()


@pytest.mark.parametrize("scores", [[[np.nan] * 2] * 2, [[0.2, 0.21], [0.2, 0.2]]], ids=["untrained", "doubtful"])
def test_else_motion_decides_and_that_is_told(scores: list) -> None:
    found = decided(np.array(scores), np.array([[9.0, 0.0], [0.0, 9.0]]))
    assert found.member.tolist() == [1, 0]
    assert not found.by_looks.any()


def test_one_classifier_is_enough_for_two() -> None:
    found = decided(np.array([[np.nan, 0.6], [np.nan, -0.5]]), np.zeros((2, 2)))
    assert found.member.tolist() == [1, 0]
    assert found.by_looks.all()


def test_two_look_the_same_and_the_third_does_not() -> None:
    """The third is told by looks, the others by motion."""
    scores = np.array([[0.3, 0.3, -0.5], [0.3, 0.3, -0.5], [-0.5, -0.5, 0.6]])
    found = decided(scores, np.array([[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 5.0]]))
    assert found.member.tolist() == [1, 0, 2]
    assert found.by_looks.tolist() == [False, False, True]


def test_more_who_come_out_than_went_in() -> None:
    found = decided(np.array([[0.5, -0.5], [-0.3, -0.3], [-0.5, 0.5]]), np.zeros((3, 2)))
    assert found.member.tolist() == [0, -1, 1]


def test_one_of_three_comes_out() -> None:
    found = decided(np.array([[-0.5, 0.4, 0.0]]), np.zeros((1, 3)))
    assert found.member.tolist() == [1]


def test_a_pair_that_stays_one_is_handed_over_twice() -> None:
    """A part of two, whose patches are of both: the single one is who looks like it."""
    part, single = [0.2, 0.1, -0.4], [-0.5, -0.6, 0.7]
    found = decided(np.array([part, part, single]), np.zeros((3, 3)))
    assert sorted(found.member[:2].tolist()) == [0, 1]
    assert found.member[2] == 2
    assert found.by_looks[2]


@pytest.mark.parametrize(("q", "m"), [(0, 2), (2, 0), (0, 0)])
def test_nobody_of_nobody(q: int, m: int) -> None:
    found = decided(np.zeros((q, m)), np.zeros((q, m)))
    assert found.member.tolist() == [-1] * q


def test_motion_that_cannot_be_is_the_last_to_be_taken() -> None:
    found = decided(np.full((2, 2), np.nan), np.array([[np.inf, 1.0], [2.0, np.inf]]))
    assert found.member.tolist() == [1, 0]
