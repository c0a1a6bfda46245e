"""Proposals with weight corrections, likelihoods in stages, means on the circle, and clouds that were not seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.errors import InputError
from trackers.filters.circular import circular_mean
from trackers.filters.negative_information import update_missed_particles
from trackers.filters.particle import Cloud, MixtureProposal, ParticleFilter, cascade

STEP_M, FRESH_M = 0.5, 2.0


def normal(x, mean, deviation):
    return -0.5 * ((x - mean) / deviation) ** 2 - np.log(deviation * np.sqrt(2 * np.pi))


def walk(state, rng):
    return state + STEP_M * rng.standard_normal(state.shape)


def mixture(share, corrected=True):
    densities = {
        "log_draw": lambda x: normal(x[0], 3.0, FRESH_M),
        "log_transition": lambda x, before: normal(x[0], before[0], STEP_M),
    }
    return MixtureProposal(
        share, walk, lambda p, rng: 3.0 + FRESH_M * rng.standard_normal((1, 1, p)), **(densities if corrected else {})
    )


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_a_corrected_mixture_estimates_what_the_motion_model_alone_does(share):
    """Prior N(0, 1), a step of N(0, 0.25), measured at 2 with variance 1: the exact posterior mean is 2 · 1.25 / 2.25."""
    rng = np.random.default_rng(3)
    cloud = Cloud.of(rng.standard_normal((1, 1, 3000)))
    after = ParticleFilter(threshold=0).step_proposed(cloud, mixture(share), lambda x: normal(x[0], 2.0, 1.0), rng)
    assert after.expectation(after.state)[0, 0] == pytest.approx(2 * 1.25 / 2.25, abs=0.08)


def test_an_uncorrected_mixture_goes_where_it_is_drawn():
    rng = np.random.default_rng(3)
    cloud = Cloud.of(rng.standard_normal((1, 1, 3000)))
    after = ParticleFilter(threshold=0).step_proposed(cloud, mixture(0.8, corrected=False), None, rng)
    assert after.expectation(after.state)[0, 0] == pytest.approx(0.8 * 3, abs=0.15)


def test_what_a_mixture_cannot_be():
    with pytest.raises(InputError, match="1.5; a number from 0 to 1"):
        mixture(1.5)
    with pytest.raises(InputError, match="one density of two"):
        MixtureProposal(0.5, walk, lambda p, rng: np.zeros((1, 1, p)), log_draw=lambda x: x[0])


def test_a_bootstrap_step_is_the_proposal_of_the_motion_model_to_the_bit():
    first, second = np.random.default_rng(8), np.random.default_rng(8)
    cloud = Cloud.of(np.random.default_rng(0).standard_normal((1, 4, 50)))
    measured = lambda x: normal(x[0], 1.0, 0.3)  # noqa: E731
    plain = ParticleFilter().step(cloud, walk, measured, first)
    proposed = ParticleFilter().step_proposed(cloud, mixture(0.0), measured, second)
    assert plain.state.tobytes() == proposed.state.tobytes()
    np.testing.assert_allclose(plain.weights.normalised, proposed.weights.normalised, rtol=1e-12)


def test_stages_are_asked_about_survivors_alone_and_add_up():
    asked = []

    def inside(particles, of_set):
        asked.append(particles.shape[1])
        return np.where(np.abs(particles[0]) < 1, -0.5, -np.inf)

    def near(particles, of_set):
        asked.append(particles.shape[1])
        return -np.abs(particles[0] - 0.1 * of_set)

    state = np.array([[[0.2, 5.0, -0.4], [0.9, 0.3, -2.0]]])
    total = cascade([inside, near])(state)
    assert asked == [6, 4]
    np.testing.assert_allclose(total, [[-0.7, -np.inf, -0.9], [-1.3, -0.7, -np.inf]])
    assert np.isneginf(cascade([lambda particles, of_set: np.full(of_set.size, -np.inf), near])(state)).all()
    assert asked == [6, 4]  # nobody was left to ask about


@given(st.floats(-3.1, 3.1), st.integers(2, 9))
def test_a_mean_of_angles_turns_with_them_and_does_not_mind_where_the_circle_is_cut(turn, n):
    angles = np.linspace(-0.4, 0.4, n) + turn
    mean, length = circular_mean(np.mod(angles, 2 * np.pi), np.full(n, 1 / n))
    assert np.cos(mean - turn) == pytest.approx(1, abs=1e-9)
    assert 0.9 < length <= 1


def test_angles_that_cancel_have_no_direction():
    _, length = circular_mean(np.array([[0.0, np.pi], [0.0, 0.0]]), np.full((2, 2), 0.5))
    np.testing.assert_allclose(length, [0, 1], atol=1e-12)


def test_a_cloud_that_was_not_seen_is_where_it_could_not_be():
    cloud = Cloud.of(np.array([[[0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0]], [[0.0] * 4] * 2]))
    after, chance = update_missed_particles(cloud, lambda points: np.where(points[0] < 1.5, 0.0, 0.5))
    np.testing.assert_allclose(after.weights.normalised, [[0, 0, 0.5, 0.5], [0.25] * 4])
    np.testing.assert_allclose(chance, [0.25, 0.0])
    assert after.weights.lost.tolist() == [False, True]
