"""The batched IMM against filterpy's, and where the mathematics ends."""

from dataclasses import replace

import numpy as np
import pytest

from trackers.errors import InputError
from trackers.filters.imm import Imm, ImmState, kalman
from trackers.filters.motion import HEADING, KALMAN_MODELS, SPEED, HeadingMotion, linearise, transition_matrix

PERIOD_S = 0.1


def filterpy_imm(start: ImmState, imm: Imm):
    """filterpy's estimator over the same models, track 0 of a start."""
    from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator

    class ModelFilter(ExtendedKalmanFilter):
        def __init__(self, model, mean, covariance):
            super().__init__(5, 2)
            self.model, self.x, self.P, self.R = model, mean.copy(), covariance.copy(), imm.R

        def predict(self, u=0):
            self.x, F, G = linearise(self.x, np.zeros(2), PERIOD_S, float(self.model.turn_persists))
            Q = np.diag([self.model.acceleration_variance, self.model.turn_acceleration_variance])
            self.P = F @ self.P @ F.T + G @ Q @ G.T

        def update(self, z):  # binds Jacobian and measurement function, which IMMEstimator does not pass
            super().update(z, lambda x: np.eye(2, 5), lambda x: x[:2])

    filters = [
        ModelFilter(model, start.mean[:, mode, 0], start.covariance[:, :, mode, 0])
        for mode, model in enumerate(imm.motion.models)
    ]
    return IMMEstimator(filters, start.probability[:, 0], imm.transition)


def coast(oracle):
    """A step without a measurement: filterpy's update(None) would re-weight the modes although nothing was measured."""
    oracle.mu = oracle.cbar.copy()
    oracle._compute_mixing_probabilities()
    oracle._compute_state_estimate()


def walk(rng, n, turn=0.12):
    """Measured positions (n, 2) of a maneuvering walk whose heading stays within half a turn of 0.3 rad."""
    heading, speed, position, measured = 0.3, 1.2, np.array([1.0, 2.0]), []
    for _ in range(n):
        heading = np.clip(heading + rng.normal(0, turn), -0.7, 1.3)
        speed = np.clip(speed + rng.normal(0, 0.2), 0.6, 2.2)
        position = position + PERIOD_S * speed * np.array([np.cos(heading), np.sin(heading)])
        measured.append(position + rng.normal(0, 0.1, 2))
    return np.array(measured)


UNEVEN = np.array([[0.9, 0.08, 0.02], [0.3, 0.7, 0.0], [0.1, 0.3, 0.6]])


@pytest.mark.parametrize("transition", [transition_matrix(3), UNEVEN], ids=["even", "uneven"])
def test_equals_filterpy_over_200_steps_with_coasting(transition):
    imm = Imm(transition=transition)
    rng = np.random.default_rng(5)
    measured = walk(rng, 200)
    seen = rng.random(200) > 0.25
    seen[60:75] = False  # one coasting as long as a track may
    # two tracks side by side: the batch must not mix them
    state = imm.start(np.array([[1.0, 2.0], [-5.0, 9.0]]), np.array([[1.1, 0.4], [0.2, -1.0]]))
    oracle = filterpy_imm(state, imm)
    for k in range(200):
        state = imm.predict(state, PERIOD_S)
        oracle.predict()
        if seen[k]:
            state = imm.update(state, np.array([0]), measured[k][None])
            oracle.update(measured[k])
        else:
            coast(oracle)
        mean, covariance = imm.estimate(state)
        np.testing.assert_allclose(mean[0], oracle.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(covariance[0], oracle.P, rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.probability[:, 0], oracle.mu, rtol=0, atol=1e-9)


def test_one_mode_is_filterpys_extended_kalman_filter():
    single = kalman()
    state = single.start(np.array([[1.0, 2.0]]), np.array([[1.0, 0.3]]))
    from filterpy.kalman import ExtendedKalmanFilter

    oracle = ExtendedKalmanFilter(5, 2)
    oracle.x, oracle.P, oracle.R = state.mean[:, 0, 0].copy(), state.covariance[:, :, 0, 0].copy(), single.R
    for z in walk(np.random.default_rng(2), 100):
        state = single.update(single.predict(state, PERIOD_S), np.array([0]), z[None])
        oracle.x, F, G = linearise(oracle.x, np.zeros(2), PERIOD_S, 1.0)
        oracle.P = F @ oracle.P @ F.T + G @ np.diag([300.0, 300.0]) @ G.T
        oracle.update(z, lambda x: np.eye(2, 5), lambda x: x[:2])
        np.testing.assert_allclose(state.mean[:, 0, 0], oracle.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.covariance[:, :, 0, 0], oracle.P, rtol=0, atol=1e-9)


def test_tracks_do_not_depend_on_their_neighbours_in_the_batch():
    imm = Imm()
    rng = np.random.default_rng(3)
    position, velocity = rng.normal(size=(7, 2)), rng.normal(size=(7, 2))
    z = position + 0.1
    together = imm.update(imm.predict(imm.start(position, velocity), PERIOD_S), np.arange(7), z)
    for i in range(7):
        alone = imm.start(position[i : i + 1], velocity[i : i + 1])
        alone = imm.update(imm.predict(alone, PERIOD_S), np.array([0]), z[i][None])
        np.testing.assert_allclose(together.mean[..., i], alone.mean[..., 0], rtol=0, atol=1e-13)
        np.testing.assert_allclose(together.probability[:, i], alone.probability[:, 0], rtol=0, atol=1e-13)


def test_coasting_takes_the_probabilities_that_the_transitions_predict():
    imm = Imm()
    state = imm.start(np.zeros((1, 2)))
    state = ImmState(state.mean, state.covariance, np.array([[0.7], [0.2], [0.1]]))
    coasted = imm.predict(state, PERIOD_S)
    np.testing.assert_allclose(coasted.probability[:, 0], np.array([0.7, 0.2, 0.1]) @ imm.transition)
    np.testing.assert_allclose(imm.predict_over(state, 20.0, PERIOD_S).probability[:, 0], 1 / 3, atol=1e-6)


@pytest.mark.parametrize("turns", [-3, 1, 2])
def test_headings_a_full_turn_apart_are_the_same_heading(turns):
    imm = Imm()
    state = imm.start(np.array([[1.0, 1.0]]), np.array([[1.0, 0.5]]))
    for z in walk(np.random.default_rng(4), 10) - [0.0, 1.0]:
        state = imm.update(imm.predict(state, PERIOD_S), np.array([0]), z[None])
    shifted_mean = state.mean.copy()
    shifted_mean[HEADING, state.probability[:, 0].argmin()] += 2 * np.pi * turns
    shifted = ImmState(shifted_mean, state.covariance, state.probability)
    for one, other in ((state, shifted), (imm.predict(state, PERIOD_S), imm.predict(shifted, PERIOD_S))):
        for expected, got in zip(imm.estimate(one), imm.estimate(other), strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-9)


def test_covariances_stay_symmetric_and_positive_semidefinite():
    imm = Imm()
    rng = np.random.default_rng(6)
    state = imm.start(rng.normal(size=(20, 2)), rng.normal(size=(20, 2)) * 2)
    for k in range(300):
        state = imm.predict(state, PERIOD_S)
        if k % 5:
            state = imm.update(state, np.arange(20), state.positions[:, 0] + rng.normal(0, 0.5, (20, 2)))
        covariance = state.covariance.transpose(2, 3, 0, 1)
        np.testing.assert_array_equal(covariance, covariance.swapaxes(-1, -2))
        eigenvalues = np.linalg.eigvalsh(covariance)
        assert (eigenvalues[..., 0] >= -1e-12 * eigenvalues[..., -1]).all()
        np.testing.assert_allclose(state.probability.sum(axis=0), 1)


def test_a_singular_covariance_is_no_obstacle():
    imm = Imm()
    start = imm.start(np.array([[1.0, 1.0]]))
    certain = ImmState(start.mean, np.zeros_like(start.covariance), start.probability)
    updated = imm.update(certain, np.array([0]), np.array([[1.3, 1.0]]))
    np.testing.assert_array_equal(updated.mean, certain.mean)  # certainty is not moved by a noisy measurement
    followed = imm.update(imm.predict(certain, PERIOD_S), np.array([0]), np.array([[1.3, 1.0]]))
    assert np.isfinite(followed.mean).all()
    assert np.isfinite(followed.covariance).all()


def test_a_mode_that_cannot_be_entered_stays_finite():
    imm = Imm(transition=np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]))
    state = imm.start(np.array([[1.0, 1.0]]), np.array([[1.0, 0.0]]))
    state = ImmState(state.mean, state.covariance, np.array([[1.0], [0.0], [0.0]]))
    predicted = imm.predict(state, PERIOD_S)
    assert np.isfinite(predicted.mean).all()
    np.testing.assert_array_equal(predicted.probability[:, 0], [1, 0, 0])
    np.testing.assert_allclose(predicted.positions[0], [[1.1, 1.0]] * 3)


def test_a_measurement_from_another_world_leaves_finite_probabilities():
    imm = Imm()
    state = imm.predict(imm.start(np.zeros((1, 2))), PERIOD_S)
    updated = imm.update(state, np.array([0]), np.array([[1e6, -1e6]]))
    assert np.isfinite(updated.mean).all()
    assert updated.probability.sum() == pytest.approx(1)


def test_no_time_changes_nothing_and_no_tracks_are_no_trouble():
    imm = Imm()
    state = imm.start(np.ones((2, 2)))
    assert imm.predict(state, 0.0) is state
    nobody = imm.start(np.empty((0, 2)))
    assert len(imm.predict(nobody, PERIOD_S)) == 0
    assert len(imm.update(nobody, np.empty(0, int), np.empty((0, 2)))) == 0
    mean, covariance = imm.estimate(nobody)
    assert mean.shape == (0, 5)
    assert covariance.shape == (0, 5, 5)


def test_a_gap_is_predicted_in_steps_of_the_nominal_period():
    imm = Imm()
    state = imm.start(np.zeros((1, 2)), np.array([[1.0, 0.0]]))
    stepwise = state
    for _ in range(7):
        stepwise = imm.predict(stepwise, PERIOD_S)
    at_once = imm.predict_over(state, 0.7, PERIOD_S)
    np.testing.assert_allclose(at_once.covariance, stepwise.covariance, rtol=1e-9)
    # scans that jitter by a few percent are one step of their own length
    one = imm.predict_over(state, 0.104, PERIOD_S)
    np.testing.assert_allclose(one.mean, imm.predict(state, 0.104).mean)


def test_the_noise_of_a_second_is_the_same_however_often_it_is_looked_at():
    """Q and the transition matrix are for the nominal period: a scanner four times as fast makes nobody calmer."""
    imm = Imm(HeadingMotion(turn_rate_variance=0.0))
    state = imm.start(np.zeros((1, 2)), np.array([[1.0, 0.0]]), speed_variance=1e-9)
    by_rate = []
    for step_s in (PERIOD_S, PERIOD_S / 4):
        followed = replace(state, probability=np.array([[1.0], [0.0], [0.0]]))
        for _ in range(round(PERIOD_S / step_s)):
            followed = imm.predict_over(followed, step_s, PERIOD_S)
        by_rate.append(followed)
    slow, fast = by_rate
    np.testing.assert_allclose(fast.probability, slow.probability, atol=0.01)
    single = Imm(HeadingMotion(KALMAN_MODELS))
    spread = []
    for step_s in (PERIOD_S, PERIOD_S / 4):
        followed = single.start(np.zeros((1, 2)), np.array([[1.0, 0.0]]), speed_variance=1e-9)
        for _ in range(round(1.0 / step_s)):
            followed = single.predict_over(followed, step_s, PERIOD_S)
        spread.append(followed.covariance[SPEED, SPEED, 0, 0])
    assert spread[1] == pytest.approx(spread[0], rel=1e-6)


@pytest.mark.parametrize("period", [-0.1, np.nan, np.inf])
def test_impossible_periods_are_refused(period):
    imm = Imm()
    state = imm.start(np.zeros((1, 2)))
    with pytest.raises(InputError, match="period|time"):
        imm.predict(state, period)
    with pytest.raises(InputError, match="time"):
        imm.predict_over(state, period, PERIOD_S)


def test_non_finite_input_is_refused_never_swallowed():
    imm = Imm()
    state = imm.predict(imm.start(np.zeros((1, 2))), PERIOD_S)
    with pytest.raises(InputError, match="measured position"):
        imm.update(state, np.array([0]), np.array([[np.nan, 0.0]]))
    with pytest.raises(InputError, match="new track"):
        imm.start(np.array([[np.inf, 0.0]]))
    broken = ImmState(state.mean, np.full_like(state.covariance, np.nan), state.probability)
    with pytest.raises(InputError, match="covariance"):
        imm.predict(broken, PERIOD_S)
    lost = ImmState(np.full_like(state.mean, np.nan), state.covariance, state.probability)
    for bad in (broken, lost):
        with pytest.raises(InputError, match="holds NaN"):
            imm.update(bad, np.array([0]), np.array([[0.1, 0.0]]))


@pytest.mark.parametrize("R", [np.zeros((2, 2)), np.diag([0.01, -0.01]), np.full((2, 2), np.nan), np.eye(3)])
def test_a_measurement_covariance_must_be_positive_definite(R):
    with pytest.raises(InputError, match="measurement covariance"):
        Imm(measurement_covariance=R)


@pytest.mark.parametrize("transition", [np.eye(2), np.full((3, 3), 0.5), -np.eye(3)])
def test_a_transition_matrix_holds_probabilities(transition):
    with pytest.raises(InputError, match="transition"):
        Imm(transition=transition)


def test_an_own_noise_for_each_measurement():
    imm = Imm()
    state = imm.predict(imm.start(np.zeros((2, 2))), PERIOD_S)
    z = np.array([[0.2, 0.0], [0.2, 0.0]])
    R = np.array([0.01, 1.0])[:, None, None] * np.eye(2)
    mean, _ = imm.estimate(imm.update(state, np.arange(2), z, R))
    same, _ = imm.estimate(imm.update(state, np.arange(2), z))
    assert mean[0] == pytest.approx(same[0])
    assert 0 < mean[1, 0] < 0.2 * mean[0, 0] / 0.2


def test_imm_beats_the_single_model_on_a_maneuvering_walk():
    rng = np.random.default_rng(8)
    n, runs = 90, 40
    t = np.arange(n)
    speed = np.where((t > 30) & (t < 40), 0.0, np.where(t > 60, 2.2, 1.2))
    heading = np.cumsum(np.where((t == 22) | (t == 50) | (t == 51), 1.2, 0.0))
    truth = np.cumsum(PERIOD_S * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1), axis=0)
    measured = truth[:, None] + rng.normal(0, 0.1, (n, runs, 2))
    npe = {}
    for name, estimator in (("imm", Imm()), ("kalman", kalman())):
        state = estimator.start(measured[0], (measured[1] - measured[0]) / PERIOD_S, speed_variance=2.0)
        errors = []
        for k in range(1, n):
            state = estimator.update(estimator.predict(state, PERIOD_S), np.arange(runs), measured[k])
            errors.append(((estimator.estimate(state)[0][:, :2] - truth[k]) ** 2).sum())
        noise = ((measured[1:] - truth[1:, None]) ** 2).sum(axis=(1, 2))
        npe[name] = np.mean(np.array(errors) / noise)
    assert npe["imm"] < npe["kalman"] < 1


def test_a_sum_of_components_is_measured_as_a_kalman_filter_measures_it():
    """One mode; the place of a body and of its head beside it, measured together: the textbook's update."""
    imm = kalman()
    state = imm.start(np.array([[0.3, -0.2]]), np.array([[1.0, 0.5]]))
    P, x = state.covariance[:, :, 0, 0], state.mean[:, 0, 0]
    H, R, z = (
        np.array([[1.0, 0, 0, 0.5, 0], [0, 1, 0, 0, 0], [0, 0, 0, 1, 0]]),
        np.diag([0.01, 0.02, 0.03]),
        [1.0, 2, 1],
    )
    after = imm.update(state, np.array([0]), np.array([z]), R[None], H)
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    np.testing.assert_allclose(after.mean[:, 0, 0], x + gain @ (z - H @ x), atol=1e-12)
    np.testing.assert_allclose(after.covariance[:, :, 0, 0], P - gain @ H @ P, atol=1e-12)
