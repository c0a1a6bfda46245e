"""The motion models and their Jacobians."""

import numpy as np
import pytest

from trackers.filters.motion import (
    HEADING,
    IMM_MODELS,
    KALMAN_MODELS,
    TURN_RATE,
    disturbance_variances,
    linearise,
    nearest_turn,
    persistence,
    propagate,
    transition_matrix,
)

PERIOD_S = 0.1


def written_out(state, disturbance, T, persists):
    """A.1 and A.2 as the notes print them, one state at a time."""
    x, y, heading, v, rate = state
    dv, dw = disturbance
    d = v * T + 0.5 * dv * T**2
    if persists:
        a = rate * T + 0.5 * dw * T**2
        turn = 0.5 * d * a
        return [
            x - turn * np.sin(heading) + d * np.cos(heading),
            y + turn * np.cos(heading) + d * np.sin(heading),
            heading + a,
            v + dv * T,
            rate + dw * T,
        ]
    return [
        x - 0.25 * d * dw * T**2 * np.sin(heading) + d * np.cos(heading),
        y + 0.25 * d * dw * T**2 * np.cos(heading) + d * np.sin(heading),
        heading + 0.5 * dw * T**2,
        v + dv * T,
        dw * T,
    ]


@pytest.mark.parametrize("persists", [False, True])
def test_batched_models_are_the_papers_equations(persists):
    rng = np.random.default_rng(0)
    states, disturbances = rng.normal(size=(5, 20)), rng.normal(size=(2, 20)) * 10
    batched = propagate(states, disturbances, PERIOD_S, float(persists))
    singly = np.array([written_out(states[:, i], disturbances[:, i], PERIOD_S, persists) for i in range(20)]).T
    np.testing.assert_allclose(batched, singly, rtol=0, atol=1e-14)


@pytest.mark.parametrize("persists", [0.0, 1.0])
def test_jacobians_match_finite_differences(persists):
    rng = np.random.default_rng(1)
    state = rng.normal(size=(5, 40)) * np.array([3, 3, 3, 2, 2])[:, None]
    disturbance = rng.normal(size=(2, 40)) * 5
    following, by_state, by_disturbance = linearise(state, disturbance, PERIOD_S, persists)
    np.testing.assert_array_equal(following, propagate(state, disturbance, PERIOD_S, persists))
    step = 1e-6
    for column in range(5):
        moved = np.zeros((5, 1))
        moved[column] = step
        slope = propagate(state + moved, disturbance, PERIOD_S, persists)
        slope = (slope - propagate(state - moved, disturbance, PERIOD_S, persists)) / (2 * step)
        np.testing.assert_allclose(by_state[:, column], slope, atol=1e-8)
    for column in range(2):
        moved = np.zeros((2, 1))
        moved[column] = step
        slope = propagate(state, disturbance + moved, PERIOD_S, persists)
        slope = (slope - propagate(state, disturbance - moved, PERIOD_S, persists)) / (2 * step)
        np.testing.assert_allclose(by_disturbance[:, column], slope, atol=1e-8)


def test_turn_rate_outlives_a_step_only_where_it_persists():
    state = np.array([0.0, 0.0, 0.3, 1.0, 2.0])
    assert propagate(state, np.zeros(2), PERIOD_S, 0.0)[TURN_RATE] == 0
    turning = propagate(state, np.zeros(2), PERIOD_S, 1.0)
    assert turning[TURN_RATE] == 2.0
    assert turning[HEADING] == pytest.approx(0.5)


def test_constants_of_the_paper():
    np.testing.assert_array_equal(disturbance_variances(IMM_MODELS), [[0.1, 0.1], [100, 0.1], [90, 800]])
    np.testing.assert_array_equal(persistence(IMM_MODELS), [0, 0, 1])
    np.testing.assert_array_equal(disturbance_variances(KALMAN_MODELS), [[300, 300]])
    np.testing.assert_allclose(transition_matrix(3), np.full((3, 3), 0.05) + 0.85 * np.eye(3))
    np.testing.assert_array_equal(transition_matrix(1), [[1]])


def test_nearest_turn_moves_by_whole_turns():
    angles = np.array([0.1, 7.0, -9.0, 100.0])
    near = nearest_turn(angles, np.full(4, 3.0))
    assert (np.abs(near - 3.0) <= np.pi).all()
    np.testing.assert_allclose(np.exp(1j * near), np.exp(1j * angles), atol=1e-12)
