"""The paper's motion models as an IMM takes them: heading and speed, moved and linearised as an extended Kalman filter does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.motion import (
    DISTURBANCE_SIZE,
    HEADING,
    IMM_MODELS,
    SPEED,
    STATE_SIZE,
    TURN_RATE,
    MotionModel,
    disturbance_variances,
    linearise,
    nearest_turn,
    persistence,
)

_UNDISTURBED = np.zeros(DISTURBANCE_SIZE)


@dataclass(frozen=True)
class HeadingMotion:
    """One mode per model, over (x, y, θ, v, θ̇).

    Headings are angles: before modes are mixed or averaged each heading is moved by whole turns to within half a turn of the
    most probable mode's, so that modes a full turn apart mix as equals. Headings are not wrapped to one turn otherwise.

    Where it ends: the heading of somebody at rest cannot be measured, and to first order only a step along it is expected
    (`trackers.filters.velocity_motion` knows no heading).
    """

    models: tuple[MotionModel, ...] = IMM_MODELS
    turn_rate_variance: float = 1.0  # of a new track [rad²/s²]

    @property
    def n_mode(self) -> int:
        """The number of modes."""
        return len(self.models)

    def started(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"],
        position_variance_m2: float,
        speed_variance: float | Float[Array, "n"],
    ) -> tuple[Float[Array, "5 n"], Float[Array, "5 5 n"]]:
        """Mean and covariance of new tracks.

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
        """One step on; share: of the period that Q is for."""
        deviation = np.sqrt(disturbance_variances(self.models) / share).T[:, :, None]  # (2, m, 1)
        mean, F, G = linearise(mean, _UNDISTURBED, period_s, persistence(self.models)[:, None])
        noise = G * deviation
        covariance = _transition_times(F, _transition_times(F, covariance).swapaxes(0, 1))
        return mean, covariance + np.einsum("aqmn,bqmn->abmn", noise, noise)

    def aligned(self, mean: Float[Array, "5 m n"], probability: Float[Array, "m n"]) -> Float[Array, "5 m n"]:
        """Means with headings within half a turn of the most probable mode's."""
        if len(self.models) == 1:
            return mean
        headings = mean[HEADING]  # (m, n)
        likeliest = headings[probability.argmax(axis=0), np.arange(mean.shape[2])]
        aligned = mean.copy()
        aligned[HEADING] = nearest_turn(headings, likeliest)
        return aligned

    def velocity(self, mean: Float[Array, "5 *n"]) -> Float[Array, "2 *n"]:
        """Velocity [m/s]."""
        return mean[SPEED] * np.stack([np.cos(mean[HEADING]), np.sin(mean[HEADING])])


def _transition_times(F: Float[Array, "5 5 m n"], matrix: Float[Array, "5 5 m n"]) -> Float[Array, "5 5 m n"]:
    """F matrix, doing only the products that the models' Jacobian F (identity elsewhere) holds."""
    product = matrix.copy()
    product[:2] += np.einsum("abmn,bcmn->acmn", F[:2, HEADING:], matrix[HEADING:])
    product[HEADING] += F[HEADING, TURN_RATE] * matrix[TURN_RATE]
    product[TURN_RATE] *= F[TURN_RATE, TURN_RATE]
    return product
