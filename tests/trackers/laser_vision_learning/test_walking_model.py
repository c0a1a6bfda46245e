"""The two-feet walking model: one foot stands while the other swings."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from trackers.laser_vision_learning.walking_model import WalkingModel, WalkingOptions, log_apart

STEADY = WalkingOptions(acceleration_m_s2=1e-9, turn_rad=1e-9, turn_slow_rad=0, turn_about=0, drift_m=0, phase=0)


def walked(options: WalkingOptions, speed: float, phase: float, heading: float, seconds: float, n: int):
    """Legs (n, side, x or y) and places (n, 2) of one particle that goes on for `seconds` in n steps."""
    model, rng = WalkingModel(options), np.random.default_rng(0)
    state = np.array([1.0, 2.0, heading, speed, phase]).reshape(5, 1, 1)
    legs, places = [], []
    for _ in range(n):
        legs.append(model.legs(state)[..., 0, 0])
        places.append(state[:2, 0, 0])
        state = model.move(state, seconds / n, np.zeros(1), rng)
    return np.array(legs), np.array(places)


@given(st.floats(0.3, 2.0), st.floats(-3.0, 3.0))
def test_on_the_floor_one_foot_stands_while_the_other_goes_twice_as_fast(speed, heading):
    options = STEADY.model_copy(update={"reach_share": 1.0})
    step_s = options.step / np.sqrt(speed)  # l / v
    legs, places = walked(options, speed, 0.0, heading, 0.999 * step_s, 20)
    left, right = legs[:, 0], legs[:, 1]
    assert np.ptp(left, axis=0).max() < 2e-3
    way = np.array([np.cos(heading), np.sin(heading)])
    np.testing.assert_allclose((right[-1] - right[0]) @ way, 2 * (places[-1] - places[0]) @ way, atol=2e-3)
    np.testing.assert_allclose((left + right) / 2, places, atol=1e-6)
    after, _ = walked(options, speed, 0.5, heading, 0.999 * step_s, 20)
    assert np.ptp(after[:, 1], axis=0).max() < 2e-3  # then the other


def test_who_stands_has_both_legs_beside_them():
    legs, _ = walked(STEADY, 0.0, 0.3, 0.0, 1.0, 2)
    np.testing.assert_allclose(legs[0], [[1.0, 2.0 + STEADY.half_width_m], [1.0, 2.0 - STEADY.half_width_m]], atol=1e-6)


def test_particles_stay_people():
    """Speeds stay positive, phases and headings within a turn, whatever the noise; who is unseen slows down."""
    model, rng = WalkingModel(WalkingOptions()), np.random.default_rng(1)
    state = model.start(np.zeros((2, 2)), 400, rng)
    for _ in range(50):
        state = model.move(state, 0.04, np.array([0.0, 1.0]), rng)
    assert (state[3] >= 0).all() and (state[4] >= 0).all() and (state[4] < 1).all() and (np.abs(state[2]) < 3.2).all()
    assert state[3, 1].mean() < 0.6 * state[3, 0].mean()


@pytest.mark.parametrize("elapsed_s", [0.0, 0.04, 2.0])
def test_the_same_generator_moves_them_the_same_way(elapsed_s):
    model = WalkingModel(WalkingOptions())
    state = model.start(np.zeros((3, 2)), 50, np.random.default_rng(2))
    moved = [model.move(state, elapsed_s, np.zeros(3), np.random.default_rng(3)) for _ in range(2)]
    assert np.array_equal(*moved)
    assert elapsed_s or np.allclose(moved[0][:4], state[:4], atol=1e-6)


@given(st.integers(0, 2**31), st.floats(0.1, 1.0))
def test_a_body_takes_up_room_and_no_more(seed, apart_m):
    """Particles nearer to another's place are less likely, those that have room all equally; so are those of strangers."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1, 1, (3, 2))
    state = np.zeros((5, 3, 40))
    state[:2] = places.T[..., None] + rng.normal(0, 0.3, (2, 3, 40))
    pairs = np.zeros((3, 3), bool)
    pairs[0, 1] = pairs[1, 0] = np.hypot(*(places[0] - places[1])) < 2 * apart_m
    log_psi = log_apart(state, places, pairs, apart_m)
    away = np.hypot(*(state[:2, 0] - places[1][:, None]))
    assert (log_psi <= 0).all() and (log_psi[2] == 0).all() and (log_psi[0, away >= apart_m] == 0).all()
    if pairs.any():
        near = np.argsort(-away)
        assert (np.diff(log_psi[0, near]) <= 1e-12).all() and (log_psi[0, away < apart_m - 1e-9] < 0).all()
