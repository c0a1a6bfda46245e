"""Association in stages."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.tracking.roster import Stage, associate, left_over


def pairs(*stages: Stage) -> list[tuple[int, int]]:
    return list(zip(*(index.tolist() for index in associate(stages)), strict=True))


COST = np.array([[1.0, 5.0], [0.5, 9.0], [0.1, 0.2]])


def test_a_stage_takes_what_is_cheapest_in_all():
    assert pairs(Stage(np.array([True, True, False]), [COST])) == [(0, 1), (1, 0)]


def test_an_earlier_stage_chooses_first():
    first, second = np.array([True, False, False]), np.array([False, True, True])
    assert pairs(Stage(first, [COST]), Stage(second, [COST])) == [(0, 0), (2, 1)]


def test_terms_add_up_and_vetoes_forbid():
    everyone = np.ones(3, np.bool_)
    veto = np.zeros((3, 2), np.bool_)
    veto[2] = True
    assert pairs(Stage(everyone, [COST, np.array([[0.0, 0], [0, 0], [9, 9]])])) == [(0, 1), (1, 0)]
    assert pairs(Stage(everyone, [COST], [veto])) == [(0, 1), (1, 0)]
    assert pairs(Stage(everyone, [COST], [np.ones((3, 2), np.bool_)])) == []
    assert pairs(Stage(~everyone, [COST])) == []


def test_whoever_was_paired_is_not_paired_again():
    everyone = np.ones(3, np.bool_)
    again = pairs(Stage(everyone, [COST]), Stage(everyone, [COST]))
    assert len({track for track, _ in again}) == len({measurement for _, measurement in again}) == len(again) == 2
    assert left_over(3, np.array([track for track, _ in again])).size == 1


def test_a_track_stays_without_a_measurement_where_that_is_cheaper():
    everyone = np.ones(3, np.bool_)
    assert pairs(Stage(everyone, [COST], unpaired=np.array([0.5, 0.4, 0.3]))) == [(2, 0)]
    assert pairs(Stage(everyone, [COST], unpaired=np.array([0.5, 9.0, 0.3]))) == [(1, 0), (2, 1)]
    assert pairs(Stage(everyone, [COST], [COST < 1], unpaired=np.full(3, 99.0))) == [(0, 0), (1, 1)]


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_pairs_and_tracks_without_cost_least_together(n, k, seed):
    rng = np.random.default_rng(seed)
    cost, unpaired, allowed = rng.normal(size=(n, k)), rng.normal(size=n), rng.random((n, k)) < 0.7
    choices = set(permutations([*range(k), *[-1] * n], n))
    possible = [each for each in choices if all(j < 0 or allowed[i, j] for i, j in enumerate(each))]
    least = min(sum(unpaired[i] if j < 0 else cost[i, j] for i, j in enumerate(each)) for each in possible)
    found = dict(pairs(Stage(np.ones(n, np.bool_), [cost], [~allowed], unpaired)))
    assert sum(cost[i, found[i]] if i in found else unpaired[i] for i in range(n)) == pytest.approx(least)
