"""The motion over velocities: against filterpy's Kalman filter, and that people stand and step to any side."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.filters.imm import Imm
from trackers.filters.motion import IMM_MODELS, STANDS, HeadingMotion, MotionModel, VelocityModel, VelocityMotion

PERIOD_S = 0.1


@pytest.mark.parametrize("model", [VelocityModel(1.0, 3.0), VelocityModel(0.4, 2.0), STANDS])
def test_one_mode_is_filterpys_kalman_filter(model):
    from filterpy.kalman import KalmanFilter

    imm = Imm(VelocityMotion((model,)))
    state = imm.start(np.array([[1.0, 2.0]]), np.array([[0.5, -0.2]]), 0.02, 0.7)
    oracle = KalmanFilter(4, 2)
    oracle.x, oracle.P, oracle.R = np.array([1.0, 2.0, 0.5, -0.2]), np.diag([0.02, 0.02, 0.7, 0.7]), imm.R
    k, T, one = model.kept, PERIOD_S, np.eye(2)
    oracle.F = np.block([[one, k * T * one], [0 * one, k * one]])
    G = np.concatenate([T**2 / 2 * one, T * one])
    oracle.Q, oracle.H = model.acceleration_variance * G @ G.T, np.eye(2, 4)
    for z in np.random.default_rng(1).normal(1.5, 0.3, (40, 2)):
        state = imm.update(imm.predict(state, T), np.array([0]), z[None])
        oracle.predict()
        oracle.update(z)
        np.testing.assert_allclose(state.mean[:, 0, 0], oracle.x, atol=1e-9)
        np.testing.assert_allclose(state.covariance[:, :, 0, 0], oracle.P, atol=1e-9)


def test_velocities_keep_and_spread_as_much_in_a_second_however_often_it_is_looked_at():
    imm = Imm(VelocityMotion((VelocityModel(0.5, 2.0),)))
    start = imm.start(np.zeros((1, 2)), np.array([[1.0, 0.0]]), 0.02, 1e-9)
    slow, fast = (imm.predict_over(start, 0.1, PERIOD_S), start)
    for _ in range(10):
        fast = imm.predict_over(fast, 0.01, PERIOD_S)
    assert imm.motion.velocity(imm.average(slow))[0, 0] == pytest.approx(0.5)
    assert imm.motion.velocity(imm.average(fast))[0, 0] == pytest.approx(0.5)
    on = Imm(VelocityMotion((VelocityModel(1.0, 2.0),)))
    slow, fast = (on.predict_over(start, 0.1, PERIOD_S), start)
    for _ in range(10):
        fast = on.predict_over(fast, 0.01, PERIOD_S)
    assert fast.covariance[2, 2, 0, 0] == pytest.approx(slow.covariance[2, 2, 0, 0])


def test_what_is_expected_of_somebody_at_rest_is_as_wide_to_every_side():
    imm = Imm(VelocityMotion())
    state = imm.start(np.zeros((1, 2)), np.array([[1.0, 0.0]]), 0.02, 0.1)
    for _ in range(20):
        state = imm.update(imm.predict(state, PERIOD_S), np.array([0]), np.zeros((1, 2)))
    _, covariance = imm.estimate(imm.predict(state, PERIOD_S))
    along, across = covariance[0, 0, 0], covariance[0, 1, 1]
    assert across == pytest.approx(along, rel=0.01)


def test_whoever_stays_in_one_place_stands_and_whoever_goes_does_not():
    imm = Imm(VelocityMotion(), measurement_covariance=np.eye(2) * 0.0015)
    start = imm.start(np.zeros((2, 2)), np.zeros((2, 2)), 0.02, 1.0)
    state, went = start, np.array([[0.0, 0.0], [0.12, 0.0]])
    for k in range(1, 15):
        state = imm.update(imm.predict(state, PERIOD_S), np.arange(2), k * went)
    stands, goes = state.probability[2]
    assert stands > 0.5
    assert goes < 0.05


def test_a_step_across_is_followed_where_a_heading_expects_none():
    rng = np.random.default_rng(3)
    way = np.zeros((70, 50, 2))  # of fifty people, who come, stand, and step across
    way[:12, :, 0], way[62:, :, 1] = np.linspace(-1, 0, 12)[:, None], 0.1 * np.arange(1, 9)[:, None]
    seen = way + rng.normal(0, 0.04, way.shape)
    gentle = tuple(
        MotionModel(m.turn_persists, *q) for m, q in zip(IMM_MODELS, [(0.1, 0.1), (10, 0.1), (9, 80)], strict=True)
    )
    off_m = []
    for motion in (VelocityMotion(), HeadingMotion(gentle)):
        imm = Imm(motion, measurement_covariance=np.eye(2) * 0.04**2)
        state = imm.start(seen[0], None, 0.02, 2.0)
        errors = []
        for z, at in zip(seen[1:], way[1:], strict=True):
            state = imm.update(imm.predict(state, PERIOD_S), np.arange(50), z)
            errors.append(np.hypot(*(imm.average(state)[:2].T - at).T).mean())
        off_m.append(max(errors[62:]))
    ours, of_headings = off_m
    assert ours < 0.065 < 0.09 < of_headings
