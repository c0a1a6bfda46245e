"""Validation regions, distances and the assignment."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import multivariate_normal

from trackers.filters.gating import (
    global_nearest_neighbour,
    linked,
    mahalanobis,
    mahalanobis_distances,
    validation_region,
)


@pytest.mark.parametrize("radius_m", [0.5, 1.0])
def test_validation_region_is_the_union_of_circles(radius_m):
    modes = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 5.0]]])
    measured = np.array([[0.9, 0.0], [2.0, -0.9], [1.0, 0.5], [0.0, 4.1], [0.0, 3.9]])
    np.testing.assert_array_equal(
        validation_region(radius_m * modes, radius_m * measured, radius_m), [[True, True, False, True, False]]
    )


def test_mahalanobis_is_the_least_over_the_modes():
    rng = np.random.default_rng(0)
    modes, measured = rng.normal(size=(4, 3, 2)), rng.normal(size=(6, 2))
    root = rng.normal(size=(4, 3, 2, 2))
    S = root @ root.swapaxes(-1, -2) + 0.1 * np.eye(2)
    got = mahalanobis(modes, S, measured)
    for i in range(4):
        for j in range(6):
            by_mode = [
                (measured[j] - modes[i, m]) @ np.linalg.inv(S[i, m]) @ (measured[j] - modes[i, m]) for m in range(3)
            ]
            assert got[i, j] == pytest.approx(np.sqrt(min(by_mode)))


@pytest.mark.parametrize(("n", "k"), [(0, 0), (0, 5), (5, 0), (1, 1), (3, 400), (400, 3)])
def test_any_number_of_tracks_and_measurements(n, k):
    rng = np.random.default_rng(1)
    modes, measured = rng.normal(size=(n, 3, 2)), rng.normal(size=(k, 2))
    S = np.broadcast_to(np.eye(2), (n, 3, 2, 2))
    distance, allowed = mahalanobis(modes, S, measured), validation_region(modes, measured, 1.0)
    assert distance.shape == allowed.shape == (n, k)
    tracks, taken = global_nearest_neighbour(distance, allowed)
    assert len(set(tracks)) == len(tracks) == len(set(taken)) <= min(n, k)
    assert allowed[tracks, taken].all()


def test_global_not_greedy():
    distance = np.array([[1.0, 2.0], [1.1, 9.0]])
    tracks, taken = global_nearest_neighbour(distance, np.ones((2, 2), bool))
    assert dict(zip(tracks, taken, strict=True)) == {0: 1, 1: 0}


def test_a_pair_more_is_taken_whatever_it_costs():
    cost, forbidden = np.full((4, 4), 50.0), ~np.eye(4, dtype=bool)
    cost[[0, 1, 2], [1, 2, 3]], forbidden[[0, 1, 2], [1, 2, 3]] = -50.0, False
    tracks, taken = global_nearest_neighbour(cost, ~forbidden)
    assert tracks.tolist() == taken.tolist() == [0, 1, 2, 3]


def test_forbidden_pairs_are_left_alone_even_if_cheap():
    distance = np.array([[0.0, 5.0], [0.0, 0.1]])
    tracks, taken = global_nearest_neighbour(distance, np.array([[False, True], [False, False]]))
    assert (tracks.tolist(), taken.tolist()) == ([0], [1])


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_as_many_pairs_as_can_be_at_least_cost(n, k, seed):
    from itertools import permutations

    rng = np.random.default_rng(seed)
    distance, allowed = rng.uniform(-10, 10, (n, k)), rng.random((n, k)) < 0.6
    best = (0, 0.0)
    padded = list(range(k)) + [-1] * n
    for choice in set(permutations(padded, n)):
        pairs = [(i, j) for i, j in enumerate(choice) if j >= 0 and allowed[i, j]]
        best = min(best, (-len(pairs), sum(distance[i, j] for i, j in pairs)))
    tracks, taken = global_nearest_neighbour(distance, allowed)
    assert -len(tracks) == best[0]
    assert distance[tracks, taken].sum() == pytest.approx(best[1])


@given(st.integers(0, 12), st.floats(0, 0.5), st.integers(0, 2**32 - 1))
def test_linked_are_those_whom_chains_join_as_scipy_has_it(n, share, seed):
    from scipy.sparse.csgraph import connected_components

    near = np.random.default_rng(seed).random((n, n)) < share
    near |= near.T
    label = linked(near)
    theirs = connected_components(near, directed=False)[1] if n else np.zeros(0, int)
    np.testing.assert_array_equal(label[:, None] == label, theirs[:, None] == theirs)
    assert all((label[label == each] == each).all() and label[each] == each for each in label)


def test_a_measurement_with_noise_of_its_own_is_explained_by_whom_it_makes_likelier():
    rng = np.random.default_rng(0)
    modes, measured = rng.normal(size=(4, 3, 2)), rng.normal(size=(6, 2))
    root, variance = rng.normal(size=(4, 3, 2, 2)), rng.uniform(0.1, 2, 6)
    P = root @ root.swapaxes(-1, -2)
    N, unlikely = mahalanobis_distances(modes, P, measured, variance)
    for i, j in np.ndindex(4, 6):
        S = P[i] + variance[j] * np.eye(2)
        by_mode = [multivariate_normal.logpdf(measured[j], modes[i, m], S[m]) for m in range(3)]
        assert unlikely[i, j] == pytest.approx(-2 * max(by_mode))
        assert N[i, j] == pytest.approx(mahalanobis(modes[i : i + 1], S[None], measured[j : j + 1])[0, 0])
