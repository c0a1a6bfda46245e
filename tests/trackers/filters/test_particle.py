"""The particle filter core: weights that are always a distribution, an exact filter as oracle, degenerate input, proposals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from trackers.errors import InputError
from trackers.filters.circular import circular_mean
from trackers.filters.negative_information import update_missed_particles
from trackers.filters.particle import Cloud, LogWeights, MixtureProposal, ParticleFilter, cascade
from trackers.filters.resampling import SCHEMES

F = np.array([[1.0, 0.1], [0.0, 1.0]])
Q = np.array([[0.0004, 0.002], [0.002, 0.04]])
R = 0.04
START_MEAN, START_COVARIANCE = np.array([0.5, 1.0]), np.array([[0.09, 0.02], [0.02, 0.25]])


def move(state, rng):
    noise = np.linalg.cholesky(Q) @ rng.standard_normal((2, state[0].size))
    return np.tensordot(F, state, 1) + noise.reshape(state.shape)


def likelihood_of(z):
    return lambda state: -0.5 * ((z - state[0]) ** 2 / R + np.log(2 * np.pi * R))


def still(state, rng):
    return state


def measured(n_step, seed=1):
    rng = np.random.default_rng(seed)
    state, made = rng.multivariate_normal(START_MEAN, START_COVARIANCE), []
    for _ in range(n_step):
        state = F @ state + np.linalg.cholesky(Q) @ rng.standard_normal(2)
        made.append(state[0] + rng.normal(0, np.sqrt(R)))
    return made


def exact(measurements):
    """filterpy's Kalman filter: means (k, 2), covariances (k, 2, 2), log-evidences (k,); None is coasting."""
    from filterpy.kalman import KalmanFilter

    oracle = KalmanFilter(2, 1)
    oracle.x, oracle.P, oracle.F, oracle.Q = START_MEAN[:, None].copy(), START_COVARIANCE.copy(), F, Q
    oracle.H, oracle.R = np.array([[1.0, 0.0]]), np.array([[R]])
    means, covariances, evidences = [], [], []
    for z in measurements:
        oracle.predict()
        evidence = 0.0
        if z is not None:
            oracle.update(z)
            innovation, S = oracle.y.item(), oracle.S.item()
            evidence = -0.5 * (innovation**2 / S + np.log(2 * np.pi * S))
        means.append(oracle.x.ravel().copy())
        covariances.append(oracle.P.copy())
        evidences.append(evidence)
    return np.array(means), np.array(covariances), np.array(evidences)


def start(n, p, rng):
    return Cloud.normal(np.tile(START_MEAN, (n, 1)), np.tile(START_COVARIANCE, (n, 1, 1)), p, rng)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("threshold", [0.5, 1.0])
def test_equals_the_kalman_filter_within_monte_carlo_error(scheme, threshold):
    n, p = 60, 1500
    zs: list[float | None] = [*measured(25)]
    zs[10:13] = [None] * 3
    means, covariances, evidences = exact(zs)
    algorithm, rng = ParticleFilter(scheme, threshold), np.random.default_rng(7)
    cloud, total = start(n, p, rng), np.zeros(n)
    for k, z in enumerate(zs):
        cloud = algorithm.step(cloud, move, None if z is None else likelihood_of(z), rng)
        if z is not None:
            total += cloud.weights.log_mean
        found = cloud.expectation(cloud.state)  # (2, n)
        # the sets are independent estimates of one mean: their own spread says how far off their average may be
        spread = found.std(axis=1, ddof=1)
        assert (abs(found.mean(axis=1) - means[k]) < 5 * spread / np.sqrt(n)).all()
        # and the spread itself is what so many particles can do: a few posterior deviations over root p
        assert (spread < 4 * np.sqrt(np.diag(covariances[k]) / p)).all()
        second = cloud.expectation((cloud.state - found[:, :, None]) ** 2).mean(axis=1)
        np.testing.assert_allclose(second, np.diag(covariances[k]), rtol=0.05)
    # the product of the evidences is unbiased (Del Moral), in the linear scale
    ratio = np.exp(total - evidences.sum())
    assert abs(ratio.mean() - 1) < 5 * ratio.std(ddof=1) / np.sqrt(n)
    assert ratio.std() < 0.6


def test_resampling_only_where_it_is_due():
    state = np.random.default_rng(0).standard_normal((1, 2, 100))
    log = np.zeros((2, 100))
    log[1, 10:] = -np.inf  # the second set has 10 particles left
    cloud = Cloud(state, LogWeights.of(log))
    for threshold, due in ((0.0, [False, False]), (0.05, [False, False]), (0.5, [False, True]), (1.0, [False, True])):
        after = ParticleFilter(threshold=threshold).resampled(cloud, np.random.default_rng(1))
        changed = (after.state != cloud.state).any(axis=(0, 2))
        np.testing.assert_array_equal(changed, due)
        kept = ~np.array(due)
        np.testing.assert_array_equal(after.weights.normalised[kept], cloud.weights.normalised[kept])
        np.testing.assert_allclose(after.weights.normalised[due], 0.01)
        assert np.isin(after.state[0, 1], state[0, 1, :10]).all() == due[1]
    np.testing.assert_allclose(cloud.weights.effective_sample_size, [100, 10])


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    arrays(
        float,
        st.tuples(st.integers(1, 4), st.integers(1, 6)),
        elements=st.floats(-1.7e308, 1.7e308) | st.floats(-5, 5) | st.just(-np.inf),
    ),
    st.integers(0, 2**32),
)
def test_weights_are_a_distribution_whatever_the_likelihood(log, seed):
    weights = LogWeights.of(log)
    for update in (np.zeros_like(log), np.random.default_rng(seed).permutation(log.ravel()).reshape(log.shape)):
        weights = weights.updated(update)
        p = log.shape[1]
        assert not np.isnan(weights.log).any() and (weights.log <= 0).all()
        np.testing.assert_allclose(weights.normalised.sum(axis=1), 1)
        np.testing.assert_allclose(weights.normalised, np.exp(weights.log), rtol=1e-12)
        assert (weights.effective_sample_size >= 1 - 1e-9).all() and (weights.effective_sample_size <= p + 1e-9).all()
        np.testing.assert_array_equal(weights.lost, np.isneginf(weights.log_mean))


def test_weights_by_hand():
    weights = LogWeights.of(np.log([[1.0, 3.0], [2.0, 2.0]]) - 5000)
    np.testing.assert_allclose(weights.normalised, [[0.25, 0.75], [0.5, 0.5]])
    np.testing.assert_allclose(weights.effective_sample_size, [1.6, 2.0])
    after = weights.updated(np.log([[0.6, 0.2], [0.1, 0.3]]))
    np.testing.assert_allclose(after.normalised, [[0.5, 0.5], [0.25, 0.75]])
    np.testing.assert_allclose(np.exp(after.log_mean), [0.25 * 0.6 + 0.75 * 0.2, 0.2])
    assert len(after) == 2


def test_a_measurement_impossible_for_a_whole_set_changes_none_of_its_weights():
    weights = LogWeights.of(np.log([[0.2, 0.8], [0.2, 0.8]]))
    after = weights.updated(np.array([[-np.inf, -np.inf], [-np.inf, 0.0]]))
    np.testing.assert_allclose(after.normalised, [[0.2, 0.8], [0.0, 1.0]])
    np.testing.assert_array_equal(after.lost, [True, False])
    assert np.isneginf(after.log_mean[0])
    # found again: the mark is of the last measurement
    assert not after.updated(np.zeros((2, 2))).lost.any()
    # at the very start there are no weights to keep
    np.testing.assert_allclose(LogWeights.of(np.full((1, 4), -np.inf)).normalised, 0.25)


def test_a_far_measurement_leaves_a_filter_that_goes_on():
    algorithm, rng = ParticleFilter(), np.random.default_rng(2)
    cloud = start(3, 200, rng)
    for z in (1e6, 1e150, 0.5):  # squares to 1e300: every likelihood underflows, no logarithm does
        cloud = algorithm.step(cloud, move, likelihood_of(z), rng)
        assert np.isfinite(cloud.expectation(cloud.state)).all()
        assert not cloud.weights.lost.any()
    cloud = algorithm.step(cloud, move, lambda state: np.full(state.shape[1:], -np.inf), rng)
    assert cloud.weights.lost.all() and np.isfinite(cloud.expectation(cloud.state)).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_broken_likelihood_is_refused(bad):
    log_likelihood = np.zeros((2, 3))
    log_likelihood[1, 2] = bad
    weights = LogWeights.of(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -np.inf]]))
    with pytest.raises(InputError, match="NaN or \\+infinity"):
        weights.updated(log_likelihood)
    with pytest.raises(InputError, match="NaN or \\+infinity"):
        LogWeights.of(log_likelihood)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"\(2, 3\) is expected"):
        LogWeights.uniform(2, 3).updated(np.zeros((2, 1)))
    with pytest.raises(InputError, match="at least 1"):
        LogWeights.uniform(2, 0)
    with pytest.raises(InputError, match="sets, particles"):
        LogWeights.of(np.zeros(3))
    with pytest.raises(InputError, match="components, sets, particles"):
        Cloud.of(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="move made"):
        ParticleFilter().step(
            Cloud.of(np.zeros((2, 1, 3))), lambda state, rng: state[:1], None, np.random.default_rng(0)
        )


def test_particles_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="NaN or infinity"):
        Cloud.of(np.full((1, 1, 2), np.nan))
    with pytest.raises(InputError, match="NaN or infinity"):
        ParticleFilter().step(
            Cloud.of(np.zeros((1, 1, 2))), lambda state, rng: state + np.inf, None, np.random.default_rng(0)
        )


@pytest.mark.parametrize(
    "options", [{"threshold": -0.1}, {"threshold": 1.5}, {"threshold": np.nan}, {"resampling": "x"}]
)
def test_options_that_make_no_filter_are_refused(options):
    with pytest.raises(InputError, match=r"expected|valid are"):
        ParticleFilter(**options)


@pytest.mark.parametrize("shape", [(0, 5), (3, 1)])
def test_no_set_and_a_single_particle(shape):
    algorithm, rng = ParticleFilter("plain", 1.0), np.random.default_rng(0)
    cloud = Cloud.of(np.ones((2, *shape)))
    for _ in range(3):
        cloud = algorithm.step(cloud, still, lambda state: -state[0], rng)
    assert len(cloud) == shape[0]
    np.testing.assert_array_equal(cloud.expectation(cloud.state), np.ones((2, shape[0])))


def test_normal_start_has_its_moments_and_may_be_singular():
    mean = np.array([[1.0, -2.0, 3.0], [0.0, 0.0, 0.0]])
    root = np.array([[0.5, 0.0], [0.3, 0.2], [0.1, -0.4]])
    covariance = np.stack([root @ root.T, np.zeros((3, 3))])  # rank 2; rank 0
    cloud = Cloud.normal(mean, covariance, 40_000, np.random.default_rng(3))
    assert cloud.state.shape == (3, 2, 40_000)
    np.testing.assert_allclose(cloud.state.mean(axis=2).T, mean, atol=0.01)
    np.testing.assert_allclose(np.cov(cloud.state[:, 0]), covariance[0], atol=0.01)
    np.testing.assert_array_equal(cloud.state[:, 1], 0)


@pytest.mark.parametrize(
    "covariance", [[[1.0, 0.5], [0.0, 1.0]], [[1.0, 0.0], [0.0, -0.1]], [[np.nan, 0.0], [0.0, 1.0]]]
)
def test_a_start_without_a_covariance_is_refused(covariance):
    with pytest.raises(InputError, match="cloud of particles"):
        Cloud.normal(np.zeros((1, 2)), np.array([covariance]), 10, np.random.default_rng(0))


def test_the_same_generator_the_same_cloud():
    def run():
        rng = np.random.default_rng(9)
        cloud = start(2, 100, rng)
        for z in measured(5):
            cloud = ParticleFilter().step(cloud, move, likelihood_of(z), rng)
        return cloud.state

    np.testing.assert_array_equal(run(), run())


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
