"""Score maps: eq. 1 summed patch by patch, maps that say nothing, and particles that crowd."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.filters.particle import Cloud
from trackers.laser_vision_learning.score_maps import ScoreMapOptions, ScoreMaps, in_levels

SIDE = 7.0
OPTIONS = ScoreMapOptions(deviation=1.5)


def scored(seed: int = 0, m: int = 2, k: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.integers(100, 160, (k, 2)).astype(float), rng.uniform(-1, 1, (m, k))


def test_the_map_is_the_sum_of_eq_1() -> None:
    centre, score = scored()
    maps = ScoreMaps.of(centre, score, SIDE, OPTIONS)
    sigma = OPTIONS.deviation * SIDE
    places = np.random.default_rng(1).integers(105, 155, (2, 50, 2)).astype(float)
    beta = np.maximum(score, 0) / np.maximum(score, 0).sum(axis=1, keepdims=True)
    squared = ((places[:, :, None] - centre) ** 2).sum(axis=-1)
    expected = (beta[:, None] * np.exp(-squared / sigma**2)).sum(axis=-1)
    found = maps.log_likelihood(places, 1e-9)
    ratio = np.exp(found) / expected
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.02)
    assert ratio.mean() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("value", [0.0, -0.5])
def test_without_a_positive_score_every_place_is_as_likely(value: float) -> None:
    centre, score = scored()
    score[1] = value
    maps = ScoreMaps.of(centre, score, SIDE, OPTIONS)
    assert maps.informative.tolist() == [True, False]
    places = np.random.default_rng(1).uniform(-500, 500, (2, 30, 2))
    places[:, 0] = np.nan  # behind a pinhole
    likelihood = maps.log_likelihood(places, OPTIONS.outlier)
    assert np.isfinite(likelihood).all()
    assert (likelihood[1] == 0).all()


def test_without_patches_too() -> None:
    maps = ScoreMaps.of(np.empty((0, 2)), np.empty((3, 0)), SIDE, OPTIONS)
    assert (maps.log_likelihood(np.zeros((3, 5, 2)), OPTIONS.outlier) == 0).all()


def test_no_place_is_impossible() -> None:
    centre, score = scored()
    maps = ScoreMaps.of(centre, score, SIDE, OPTIONS)
    far = maps.log_likelihood(np.full((2, 4, 2), 1e4), 0.1)
    np.testing.assert_allclose(np.exp(far[:, 0]), 0.1 * maps.maps.mean(axis=(1, 2)))


def still(state: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return state


def jittered(state: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return state + rng.normal(0, 0.02, state.shape)


def likelihood(state: np.ndarray) -> np.ndarray:
    return -0.5 * ((state[0] - 1.0) ** 2 + state[1] ** 2) / 0.5**2


def test_particles_crowd_level_by_level() -> None:
    cloud = Cloud.of(np.random.default_rng(0).normal(0, 1, (2, 3, 2000)))
    spreads = []
    for levels in (0, 1, 3):
        after = in_levels(cloud, likelihood, levels, jittered, np.random.default_rng(1))
        mean = after.expectation(after.state)
        spreads.append(np.sqrt(after.expectation((after.state - mean[..., None]) ** 2)).mean())
        # a normal prior times the likelihood to the power of levels + 1
        share = (levels + 1) / 0.5**2
        np.testing.assert_allclose(mean[0], share / (share + 1), atol=0.06)
    assert spreads[0] > spreads[1] > spreads[2]


def test_a_likelihood_that_says_nothing_changes_nothing() -> None:
    cloud = Cloud.of(np.random.default_rng(0).normal(0, 1, (2, 2, 100)))
    after = in_levels(cloud, lambda state: np.zeros(state.shape[1:]), 3, still, np.random.default_rng(0))
    np.testing.assert_array_equal(after.state, cloud.state)
    np.testing.assert_allclose(after.weights.normalised, cloud.weights.normalised)
