"""What a look without a return says: the target is where it could not be seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats

from trackers.filters.imm import Imm, ImmState
from trackers.filters.motion import KALMAN_MODELS, SPEED, HeadingMotion, VelocityMotion
from trackers.filters.negative_information import (
    LEAVES,
    existence_after_detection,
    existence_after_miss,
    miss_probability,
    probability_within,
    update_missed,
)

ALONG_X = np.array([[1.0], [0.0]])


def walking_to(x_m_s: float = 1.0, n_coasted: int = 5, models=None) -> ImmState:
    """One track at the origin half a second after it was last seen, walking along x."""
    imm = Imm() if models is None else Imm(HeadingMotion(models))
    state = imm.start(np.array([[-0.1 * x_m_s * n_coasted, 0.0]]), np.array([[x_m_s, 0.0]]), 0.02, 0.2)
    return imm.predict_over(state, 0.1 * n_coasted, 0.1)


def test_a_look_that_shows_nothing_anywhere_says_nothing():
    state = walking_to()
    after, chance = update_missed(state, lambda at: np.ones(at.shape[1:]), ALONG_X)
    np.testing.assert_allclose(after.mean, state.mean, atol=1e-12)
    np.testing.assert_allclose(after.covariance, state.covariance, atol=1e-12)
    np.testing.assert_allclose(after.probability, state.probability, atol=1e-12)
    np.testing.assert_allclose(chance, 1)


def test_moments_are_those_of_the_density_times_the_chance_of_a_miss():
    state = walking_to(models=KALMAN_MODELS)
    place = stats.multivariate_normal(state.mean[:2, 0, 0], state.covariance[:2, :2, 0, 0])
    deviation = np.sqrt(state.covariance[0, 0, 0, 0])

    def missed(at):
        return 1 / (1 + np.exp(3 * (at[0] - at[1] - 0.3 * deviation) / deviation))

    after, chance = update_missed(state, missed, ALONG_X)
    drawn = place.rvs(400_000, random_state=np.random.default_rng(1)).T
    weight = missed(drawn)
    assert chance[0] == pytest.approx(weight.mean(), abs=0.01)
    np.testing.assert_allclose(after.mean[:2, 0, 0], np.average(drawn, axis=1, weights=weight), atol=0.03 * deviation)
    expected = np.cov(drawn, aweights=weight)
    np.testing.assert_allclose(after.covariance[:2, :2, 0, 0], expected, atol=0.06 * deviation**2)


def test_the_speed_follows_the_position_by_their_covariance():
    state = walking_to(models=KALMAN_MODELS)
    after, _ = update_missed(state, lambda at: (at[0] < 0).astype(float), ALONG_X)
    P, moved = state.covariance[..., 0, 0], after.mean[:, 0, 0] - state.mean[:, 0, 0]
    assert moved[0] < 0
    assert after.mean[SPEED, 0, 0] < state.mean[SPEED, 0, 0]
    np.testing.assert_allclose(moved, P[:, :2] @ np.linalg.solve(P[:2, :2], moved[:2]), atol=1e-12)


def test_modes_that_put_the_target_where_it_would_be_seen_lose_weight():
    state = walking_to()
    spread = state.mean.copy()
    spread[0, :, 0] = [-1.0, 0.0, 1.0]
    state = ImmState(spread, state.covariance, state.probability)
    after, _ = update_missed(state, lambda at: np.where(at[0] < -0.5, 1.0, 0.05), ALONG_X)
    hidden = stats.norm.cdf(-0.5, spread[0, :, 0], np.sqrt(state.covariance[0, 0, :, 0]))
    expected = state.probability[:, 0] * (hidden + 0.05 * (1 - hidden))
    np.testing.assert_allclose(after.probability[:, 0], expected / expected.sum(), atol=0.1)
    assert after.probability[0, 0] > 2 * state.probability[0, 0]


def test_a_target_that_would_surely_have_been_seen_stays_where_the_model_has_it():
    state = walking_to()
    after, chance = update_missed(state, lambda at: np.zeros(at.shape[1:]), ALONG_X)
    np.testing.assert_allclose(after.mean, state.mean, atol=1e-12)
    np.testing.assert_allclose(after.covariance, state.covariance, atol=1e-12)
    assert chance[0] <= 1e-3


def test_a_position_known_exactly_stays_finite():
    state = walking_to()
    known = ImmState(state.mean, np.zeros_like(state.covariance), state.probability)
    after, _ = update_missed(known, lambda at: (at[0] < 0).astype(float), ALONG_X)
    for values in (after.mean, after.covariance, after.probability):
        assert np.isfinite(values).all()
    np.testing.assert_allclose(after.mean, known.mean, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(
    angle=st.floats(-np.pi, np.pi),
    edge_m=st.floats(-1.0, 1.0),
    seen=st.floats(0.0, 0.99),
    speed_m_s=st.floats(0.1, 3.0),
    n_coasted=st.integers(1, 15),
)
def test_nothing_makes_a_covariance_that_is_none(angle, edge_m, seen, speed_m_s, n_coasted):
    state = walking_to(speed_m_s, n_coasted)
    hidden = lambda at: np.where(at[0] * np.cos(angle) + at[1] * np.sin(angle) < edge_m, 1.0, 1 - seen)  # noqa: E731
    after, chance = update_missed(state, hidden, ALONG_X)
    assert 0 < chance[0] <= 1 + 1e-9
    assert np.linalg.eigvalsh(after.covariance.T).min() > -1e-9
    assert after.probability.sum() == pytest.approx(1)


@given(angle=st.floats(-np.pi, np.pi), edge_m=st.floats(-0.5, 0.5), way=st.floats(-np.pi, np.pi))
def test_a_turned_room_is_the_same_room(angle, edge_m, way):
    imm = Imm(VelocityMotion(), np.full((3, 3), 1 / 3))
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    velocity = np.array([[np.cos(way), np.sin(way)]])

    def after(turned):
        state = imm.predict_over(imm.start(np.zeros((1, 2)), velocity @ turned.T, 0.02, 0.2), 0.5, 0.1)
        missed = lambda at: np.where(np.einsum("i,i...->...", turned[:, 0], at) < edge_m, 1.0, 0.1)  # noqa: E731
        return update_missed(state, missed, imm.velocity(state))

    (here, chance), (there, chance_there) = after(np.eye(2)), after(R)
    assert chance_there[0] == pytest.approx(chance[0])
    both = np.kron(np.eye(2), R)
    np.testing.assert_allclose(there.mean[..., 0], both @ here.mean[..., 0], atol=1e-9)
    np.testing.assert_allclose(there.covariance[:, :, 0, 0], both @ here.covariance[:, :, 0, 0] @ both.T, atol=1e-9)


PROBABILITIES = st.floats(0.01, 0.99)


@given(PROBABILITIES, PROBABILITIES, st.floats(0.01, 5), st.floats(0.5, 100))
def test_existence_is_bayes_over_left_there_unseen_and_seen(existence, missed, elapsed_s, survival_s):
    stays = existence * np.exp(-elapsed_s / survival_s)
    outcomes = {"gone": 1 - stays, "unseen": stays * missed, "seen": stays * (1 - missed)}
    expected = outcomes["unseen"] / (outcomes["gone"] + outcomes["unseen"])
    got = existence_after_miss(np.array([existence]), np.array([missed]), elapsed_s, survival_s)
    assert got[0] == pytest.approx(expected, rel=1e-12)
    assert got[0] < existence


@given(PROBABILITIES, st.floats(0.01, 1.0), st.floats(0.0, 0.99))
def test_of_those_beyond_the_border_some_have_left_and_the_others_are_nowhere(existence, unseen, beyond):
    possible = 1 - beyond + LEAVES * beyond
    inside, left = existence * (1 - beyond) / possible, existence * LEAVES * beyond / possible
    expected = inside * unseen / (1 - existence + inside * unseen + left)
    missed = np.array([(1 - beyond) * unseen])
    got = existence_after_miss(np.array([existence]), missed, 0.0, 10.0, np.array([beyond]))
    assert got[0] == pytest.approx(expected, rel=1e-9)


def hidden_walker(x_m_s: float, y_m_s: float, duration_s: float, border_m: float) -> float:
    """Existence of one who walks on out of sight, in an area that ends at x = border_m."""

    def is_inside(at):
        return at[0] <= border_m

    imm = Imm(VelocityMotion())
    state = imm.start(np.zeros((1, 2)), np.array([[x_m_s, y_m_s]]), 0.005, 0.05)
    existence = np.ones(1)
    for _ in range(round(duration_s / 0.1)):
        state = imm.predict_over(state, 0.1, 0.1)
        along = imm.velocity(state)
        beyond = miss_probability(state, lambda at: ~is_inside(at), along)
        state, missed = update_missed(state, lambda at: is_inside(at).astype(float), along)
        existence = existence_after_miss(existence, missed, 0.1, 60.0, beyond)
    return float(existence[0])


def test_who_walks_out_of_sight_towards_the_border_may_have_left_and_who_walks_along_it_has_not():
    out = [hidden_walker(1.2, 0.0, duration_s, 0.6) for duration_s in (0.3, 1.0, 2.0)]
    along = [hidden_walker(0.0, 1.2, duration_s, 0.6) for duration_s in (0.3, 1.0, 2.0)]
    assert out[0] == pytest.approx(along[0], abs=0.01)  # not there yet
    assert out[0] > out[1] > out[2]
    assert 1 - out[2] > 2 * (1 - along[2])


def test_who_cannot_be_seen_fades_as_people_leave_and_in_plain_sight_at_once():
    hidden, plain = np.ones(1), np.ones(1)
    for _ in range(100):
        hidden = existence_after_miss(hidden, np.ones(1), 0.1, 10.0)
    for _ in range(3):
        plain = existence_after_miss(plain, np.full(1, 0.05), 0.1, 10.0)
    assert hidden[0] == pytest.approx(np.exp(-1))
    assert plain[0] < 0.02


@given(PROBABILITIES, st.floats(1e-3, 1e3))
def test_existence_is_bayes_over_theirs_and_not(existence, likelihood_ratio):
    odds = existence / (1 - existence) * likelihood_ratio
    got = existence_after_detection(np.array([existence]), np.array([likelihood_ratio]))
    assert got[0] == pytest.approx(odds / (1 + odds), rel=1e-9)


@given(st.floats(-1.0, 1.0), st.floats(0.1, 1.0))
def test_how_probably_a_look_shows_nothing_is_over_all_places_and_modes(edge_m, missed_beyond):
    state = walking_to(1.0, 8)
    missed = lambda at: np.where(at[0] > edge_m, missed_beyond, 1.0)  # noqa: E731
    beyond = 1 - stats.norm.cdf(edge_m, state.mean[0, :, 0], np.sqrt(state.covariance[0, 0, :, 0]))
    expected = state.probability[:, 0] @ (1 - (1 - missed_beyond) * beyond)
    assert miss_probability(state, missed, ALONG_X)[0] == pytest.approx(expected, abs=0.12)
    assert miss_probability(state, missed, ALONG_X)[0] == pytest.approx(update_missed(state, missed, ALONG_X)[1][0])


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(0.01, 4.0), min_size=2, max_size=2),
    st.floats(-0.95, 0.95),
    st.floats(0.1, 3.0),
    st.floats(-np.pi, np.pi),
)
def test_the_chance_to_be_within_a_radius_is_that_of_the_density(variances, correlation, radius_m, way):
    mean, cross = np.array([3.0, -2.0]), correlation * np.sqrt(variances[0] * variances[1])
    covariance = np.array([[variances[0], cross], [cross, variances[1]]])
    state = VelocityMotion().started(mean[None], np.zeros((1, 2)), 1.0, 1.0)
    full = np.repeat(state[1][:, :, None], 1, axis=2)
    full[:2, :2, 0, 0] = covariance
    track = ImmState(state[0][:, None], full, np.ones((1, 1)))
    drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, 4000)
    expected = (np.hypot(*(drawn - mean).T) <= radius_m).mean()
    along = np.array([[np.cos(way)], [np.sin(way)]])
    (chance,) = probability_within(track, mean[None], radius_m, along)
    assert chance == pytest.approx(expected, abs=0.04)  # five standard errors of 4000 draws


@pytest.mark.parametrize("sigma_m", [1e-3, 0.05, 0.5, 5.0])
@pytest.mark.parametrize("radius_m", [0.1, 0.5, 2.0])
def test_within_a_radius_of_a_round_density_is_what_rayleigh_says(sigma_m, radius_m):
    mean, covariance = VelocityMotion().started(np.zeros((1, 2)), np.zeros((1, 2)), sigma_m**2, 1.0)
    track = ImmState(mean[:, None], covariance[:, :, None], np.ones((1, 1)))
    expected = -np.expm1(-0.5 * (radius_m / sigma_m) ** 2)
    assert probability_within(track, np.zeros((1, 2)), radius_m, ALONG_X)[0] == pytest.approx(expected, abs=1e-4)


def test_the_chance_to_be_within_a_radius_grows_with_it_and_falls_with_time():
    now, later = walking_to(n_coasted=1), walking_to(n_coasted=20)
    for state in (now, later):
        centre = (state.mean[:2] * state.probability).sum(axis=1).T
        chances = [probability_within(state, centre, radius_m, ALONG_X)[0] for radius_m in (0.1, 0.5, 1.0, 50.0)]
        assert chances == sorted(chances) and chances[-1] == pytest.approx(1)
    at = [(state.mean[:2] * state.probability).sum(axis=1).T for state in (now, later)]
    assert probability_within(now, at[0], 0.5, ALONG_X) > 0.95 > 0.5 > probability_within(later, at[1], 0.5, ALONG_X)
