"""Motion models of a maneuvering person, batched: over heading and speed with analytic Jacobians, and over velocities.

**Heading and speed** (Bai and Takahashi, appendix, A.1 and A.2). State (x, y, θ, v, θ̇): position [m], heading [rad], speed
[m/s], turn rate [rad/s]. Disturbance (Δv, Δθ̇): linear acceleration [m/s²] and turn acceleration [rad/s²], white, zero mean,
constant over one step of T seconds. With d = v T + ½ Δv T² and a = ω T + ½ Δθ̇ T²:

    x' = x + d cos θ − ½ d a sin θ      θ' = θ + a        θ̇' = ω + Δθ̇ T
    y' = y + d sin θ + ½ d a cos θ      v' = v + Δv T

A.1 (models 1 and 2) is ω = 0: the turn rate lasts one step; A.2 (model 3) is ω = θ̇: it persists. One function serves both,
selected by `turn_persists`. (The paper's A.2 is damaged in our copy; this form is inferred.) Position is first order in the
turned angle a, as in the paper.

**Velocities**, one mode each: people walk on, change their direction, or stand. State (x, y, vx, vy) [m, m/s]. In one step of
T seconds, with the share k of velocity that a mode keeps, and a constant, white, isotropic acceleration:

    vx' = k vx + ax T      x' = x + k vx T + ½ ax T²      and y alike

k = 1 is the white noise acceleration model (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, section 6.3.2); k = 0 is standing. The model is linear, so the filter is exact; and it has no heading, so a
standing person may step to any side.

Components are in the first axis and the batch (tracks, modes, particles) in the trailing ones, so that every operation runs
along the batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackers.arrays import Array, ArrayOrNumber, Float

STATE_SIZE = 5
DISTURBANCE_SIZE = 2
X, Y, HEADING, SPEED, TURN_RATE = range(STATE_SIZE)


@dataclass(frozen=True)
class MotionModel:
    """Motion model: whether the turn rate persists, and the variances of the disturbance."""

    turn_persists: bool
    acceleration_variance: float  # of Δv [m²/s⁴]
    turn_acceleration_variance: float  # of Δθ̇ [rad²/s⁴]


CONSTANT_VELOCITY = MotionModel(turn_persists=False, acceleration_variance=0.1, turn_acceleration_variance=0.1)
SUDDEN_ACCELERATION = MotionModel(turn_persists=False, acceleration_variance=100.0, turn_acceleration_variance=0.1)
SUDDEN_TURN = MotionModel(turn_persists=True, acceleration_variance=90.0, turn_acceleration_variance=800.0)
SINGLE_TURN = MotionModel(turn_persists=True, acceleration_variance=300.0, turn_acceleration_variance=300.0)

IMM_MODELS = (CONSTANT_VELOCITY, SUDDEN_ACCELERATION, SUDDEN_TURN)
"""Models 1, 2, 3 with the paper's Q1, Q2, Q3."""

KALMAN_MODELS = (SINGLE_TURN,)
"""The paper's single-model baseline: model 3 with Q = diag(300, 300)."""

MODE_STAYS = 0.9
"""Probability that a person keeps the mode over one step; the rest is shared evenly (paper, section V)."""

MEASUREMENT_VARIANCE_M2 = 0.01
"""Variance of a measured position on each axis, R = diag(0.01, 0.01) m² (paper, section III)."""


def transition_matrix(n_mode: int) -> Float[Array, "{n_mode} {n_mode}"]:
    """Return mode transition probabilities per step, row: from, column: to; `MODE_STAYS` on the diagonal."""
    if n_mode == 1:
        return np.ones((1, 1))
    matrix = np.full((n_mode, n_mode), (1 - MODE_STAYS) / (n_mode - 1))
    np.fill_diagonal(matrix, MODE_STAYS)
    return matrix


def persistence(models: tuple[MotionModel, ...]) -> Float[Array, "{len(models)}"]:
    """Return 1 for each model whose turn rate persists, else 0."""
    return np.array([float(model.turn_persists) for model in models])


def disturbance_variances(models: tuple[MotionModel, ...]) -> Float[Array, "{len(models)} 2"]:
    """Return the diagonal of Q of each model."""
    return np.array([(model.acceleration_variance, model.turn_acceleration_variance) for model in models])


def propagate(
    state: Float[Array, "5 *batch"],
    disturbance: Float[Array, "2 *noise"],
    period_s: float,
    turn_persists: Array | float,
) -> Float[Array, "5 *result"]:
    """Return the state after one step of `period_s`, under a disturbance (A.1, A.2).

    `turn_persists` is 1 for A.2 and 0 for A.1; it and the trailing axes broadcast.
    """
    distance, turned, _, along = _displacement(state, disturbance, period_s, turn_persists)
    return _displaced(state, disturbance, period_s, turn_persists, distance, turned, along)


def linearise(
    state: Float[Array, "5 *batch"],
    disturbance: Float[Array, "2 *noise"],
    period_s: float,
    turn_persists: Array | float,
) -> tuple[Float[Array, "5 *result"], Float[Array, "5 5 *result"], Float[Array, "5 2 *result"]]:
    """Return `propagate` and its Jacobians with respect to the state and to the disturbance."""
    T = period_s
    half_square = 0.5 * T * T
    distance, turned, across, along = _displacement(state, disturbance, T, turn_persists)
    following = _displaced(state, disturbance, T, turn_persists, distance, turned, along)
    by_turn = 0.5 * distance * across  # ∂(x', y')/∂a
    persisting = T * turn_persists

    by_state = np.zeros((STATE_SIZE, STATE_SIZE, *following.shape[1:]))
    by_state[X, X] = by_state[Y, Y] = by_state[HEADING, HEADING] = by_state[SPEED, SPEED] = 1.0
    by_state[X, HEADING] = -distance * along[1]
    by_state[Y, HEADING] = distance * along[0]
    by_state[:2, SPEED] = T * along
    by_state[:2, TURN_RATE] = persisting * by_turn
    by_state[HEADING, TURN_RATE] = persisting
    by_state[TURN_RATE, TURN_RATE] = turn_persists

    by_disturbance = np.zeros((STATE_SIZE, DISTURBANCE_SIZE, *following.shape[1:]))
    by_disturbance[:2, 0] = half_square * along
    by_disturbance[:2, 1] = half_square * by_turn
    by_disturbance[HEADING, 1] = half_square
    by_disturbance[SPEED, 0] = by_disturbance[TURN_RATE, 1] = T
    return following, by_state, by_disturbance


def _displacement(
    state: Array, disturbance: Array, period_s: float, turn_persists: Array | float
) -> tuple[ArrayOrNumber, ArrayOrNumber, Float[Array, "2 *batch"], Float[Array, "2 *result"]]:
    """Return distance d and turned angle a of the step, the unit vector left of the heading, and ∂(x', y')/∂d."""
    half_square = 0.5 * period_s * period_s
    distance = state[SPEED] * period_s + disturbance[0] * half_square
    turned = state[TURN_RATE] * (turn_persists * period_s) + disturbance[1] * half_square
    cos, sin = np.cos(state[HEADING]), np.sin(state[HEADING])
    across = np.array([-sin, cos])
    along = np.array([cos, sin]) + 0.5 * turned * across
    return distance, turned, across, along


def _displaced(
    state: Array,
    disturbance: Array,
    period_s: float,
    turn_persists: Array | float,
    distance: ArrayOrNumber,
    turned: ArrayOrNumber,
    along: Float[Array, "2 *result"],
) -> Float[Array, "5 *result"]:
    following = np.empty((STATE_SIZE, *along.shape[1:]))
    following[:2] = state[:2] + distance * along
    following[HEADING] = state[HEADING] + turned
    following[SPEED] = state[SPEED] + disturbance[0] * period_s
    following[TURN_RATE] = turn_persists * state[TURN_RATE] + disturbance[1] * period_s
    return following


def nearest_turn(angle: Array, reference: Array) -> Array:
    """Return `angle` plus whole turns to within half a turn of `reference` [rad]."""
    return angle - 2 * np.pi * np.round((angle - reference) / (2 * np.pi))


_UNDISTURBED = np.zeros(DISTURBANCE_SIZE)


@dataclass(frozen=True)
class HeadingMotion:
    """One mode per model, over (x, y, θ, v, θ̇).

    Before modes are mixed or averaged, each heading is moved by whole turns to within half a turn of the most probable
    mode's, so that modes a full turn apart mix as equals. Headings are not wrapped otherwise.

    Limitation: the heading of a person at rest cannot be measured, and to first order only a step along it is expected
    (`VelocityMotion` has no heading).
    """

    models: tuple[MotionModel, ...] = IMM_MODELS
    turn_rate_variance: float = 1.0  # of a new track [rad²/s²]

    @property
    def n_mode(self) -> int:
        """Number of modes."""
        return len(self.models)

    def started(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"],
        position_variance_m2: float | Float[Array, "n"],
        speed_variance: float | Float[Array, "n"],
    ) -> tuple[Float[Array, "5 n"], Float[Array, "5 5 n"]]:
        """Return mean and covariance of new tracks.

        The heading's standard deviation is the speed's over the speed itself, at most that of an unknown angle (π/√3).
        """
        n, speed = len(position), np.hypot(velocity[:, 0], velocity[:, 1])
        mean = np.zeros((STATE_SIZE, n))
        mean[:2] = position.T
        mean[HEADING] = np.arctan2(velocity[:, 1], velocity[:, 0])
        mean[SPEED] = speed
        covariance = np.zeros((STATE_SIZE, STATE_SIZE, n))
        covariance[0, 0] = covariance[1, 1] = position_variance_m2
        covariance[HEADING, HEADING] = np.minimum(speed_variance / np.maximum(speed, 1e-6) ** 2, np.pi**2 / 3)
        covariance[SPEED, SPEED] = speed_variance
        covariance[TURN_RATE, TURN_RATE] = self.turn_rate_variance
        return mean, covariance

    def moved(
        self, mean: Float[Array, "5 m n"], covariance: Float[Array, "5 5 m n"], period_s: float, share: float
    ) -> tuple[Float[Array, "5 m n"], Float[Array, "5 5 m n"]]:
        """Return mean and covariance one step later; share: of the nominal period of Q."""
        deviation = np.sqrt(disturbance_variances(self.models) / share).T[:, :, None]  # (2, m, 1)
        mean, F, G = linearise(mean, _UNDISTURBED, period_s, persistence(self.models)[:, None])
        noise = G * deviation
        covariance = _transition_times(F, _transition_times(F, covariance).swapaxes(0, 1))
        return mean, covariance + np.einsum("aqmn,bqmn->abmn", noise, noise)

    def aligned(self, mean: Float[Array, "5 m n"], probability: Float[Array, "m n"]) -> Float[Array, "5 m n"]:
        """Return means with headings within half a turn of the most probable mode's."""
        if len(self.models) == 1:
            return mean
        headings = mean[HEADING]  # (m, n)
        likeliest = headings[probability.argmax(axis=0), np.arange(mean.shape[2])]
        aligned = mean.copy()
        aligned[HEADING] = nearest_turn(headings, likeliest)
        return aligned

    def velocity(self, mean: Float[Array, "5 *n"]) -> Float[Array, "2 *n"]:
        """Return the velocity [m/s]."""
        return mean[SPEED] * np.stack([np.cos(mean[HEADING]), np.sin(mean[HEADING])])


def _transition_times(F: Float[Array, "5 5 m n"], matrix: Float[Array, "5 5 m n"]) -> Float[Array, "5 5 m n"]:
    """Multiply F by a matrix, with only the products that the models' Jacobian F (identity elsewhere) needs."""
    product = matrix.copy()
    product[:2] += np.einsum("abmn,bcmn->acmn", F[:2, HEADING:], matrix[HEADING:])
    product[HEADING] += F[HEADING, TURN_RATE] * matrix[TURN_RATE]
    product[TURN_RATE] *= F[TURN_RATE, TURN_RATE]
    return product


_SIZE = 4


@dataclass(frozen=True)
class VelocityModel:
    """Motion model for one period."""

    kept: float  # share of the velocity, from 0 to 1
    acceleration_variance: float  # on each axis [m²/s⁴]


WALKS_ON = VelocityModel(1.0, 0.1)
CHANGES_WAY = VelocityModel(1.0, 10.0)
STANDS = VelocityModel(0.0, 1.0)
AGILE = VelocityModel(1.0, 3.0)
"""Single model for all motion: the best of variances 1, 3 and 9, measured in the twin."""


@dataclass(frozen=True)
class VelocityMotion:
    """One mode per model. Components after these four do not change."""

    models: tuple[VelocityModel, ...] = (WALKS_ON, CHANGES_WAY, STANDS)

    @property
    def n_mode(self) -> int:
        """Number of modes."""
        return len(self.models)

    def started(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"],
        position_variance_m2: float | Float[Array, "n"],
        speed_variance: float | Float[Array, "n"],
    ) -> tuple[Float[Array, "s n"], Float[Array, "s s n"]]:
        """Return mean and covariance of new tracks; both variances are those on each axis."""
        covariance = np.zeros((_SIZE, _SIZE, len(position)))
        covariance[0, 0] = covariance[1, 1] = position_variance_m2
        covariance[2, 2] = covariance[3, 3] = speed_variance
        return np.concatenate([position, velocity], axis=1).T, covariance

    def moved(
        self, mean: Float[Array, "s m n"], covariance: Float[Array, "s s m n"], period_s: float, share: float
    ) -> tuple[Float[Array, "s m n"], Float[Array, "s s m n"]]:
        """Return mean and covariance one step later; share: of the models' nominal period."""
        kept, noise = _effect(self.models, period_s, share)
        after, spread = mean.copy(), covariance.copy()
        after[2:4] *= kept
        after[:2] += period_s * after[2:4]
        spread[2:4] *= kept  # F P, then F P Fᵀ
        spread[:2] += period_s * spread[2:4]
        spread[:, 2:4] *= kept
        spread[:, :2] += period_s * spread[:, 2:4]
        spread[:_SIZE, :_SIZE] += noise
        return after, spread

    def aligned(self, mean: Float[Array, "s m n"], probability: Float[Array, "m n"]) -> Float[Array, "s m n"]:
        """Return the means unchanged: there is no angle to align."""
        return mean

    def velocity(self, mean: Float[Array, "s *n"]) -> Float[Array, "2 *n"]:
        """Return the velocity [m/s]."""
        return mean[2:4]


@lru_cache(maxsize=16)
def _effect(
    models: tuple[VelocityModel, ...], period_s: float, share: float
) -> tuple[Float[Array, "m 1"], Float[Array, "4 4 m 1"]]:
    """Return the share of velocity that each mode keeps over a step, and its noise of place and velocity."""
    kept = np.array([model.kept for model in models])[:, None] ** share
    variance = np.array([model.acceleration_variance for model in models])[:, None] / share
    noise = np.zeros((_SIZE, _SIZE, len(models), 1))
    for place, speed in ((0, 2), (1, 3)):
        noise[place, place] = variance * period_s**4 / 4
        noise[place, speed] = noise[speed, place] = variance * period_s**3 / 2
        noise[speed, speed] = variance * period_s**2
    return kept, noise
