"""Motion models over velocities, one mode each: people walk on, change their direction, or stand.

State (x, y, vx, vy) [m, m/s]. In one step of T seconds, with the share k of velocity that a mode keeps, and a constant,
white, isotropic acceleration:

vx' = k vx + ax T      x' = x + k vx T + ½ ax T²      and y alike

k = 1 is the white noise acceleration model (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, section 6.3.2); k = 0 is standing. The model is linear, so the filter is exact; and it has no heading, so a
standing person may step to any side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array

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
    """One mode per model."""

    models: tuple[VelocityModel, ...] = (WALKS_ON, CHANGES_WAY, STANDS)

    @property
    def n_mode(self) -> int:
        """Number of modes."""
        return len(self.models)

    def started(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"],
        position_variance_m2: float,
        speed_variance: float | Float[Array, "n"],
    ) -> tuple[Float[Array, "4 n"], Float[Array, "4 4 n"]]:
        """Return mean and covariance of new tracks; both variances are those on each axis."""
        covariance = np.zeros((_SIZE, _SIZE, len(position)))
        covariance[0, 0] = covariance[1, 1] = position_variance_m2
        covariance[2, 2] = covariance[3, 3] = speed_variance
        return np.concatenate([position, velocity], axis=1).T, covariance

    def moved(
        self, mean: Float[Array, "4 m n"], covariance: Float[Array, "4 4 m n"], period_s: float, share: float
    ) -> tuple[Float[Array, "4 m n"], Float[Array, "4 4 m n"]]:
        """Return mean and covariance one step later; share: of the models' nominal period."""
        kept = np.array([model.kept for model in self.models])[:, None] ** share  # (m, 1)
        after, half = mean.copy(), covariance.copy()  # half: F P
        after[2:] *= kept
        after[:2] += period_s * after[2:]
        half[2:] *= kept
        half[:2] += period_s * half[2:]
        spread = half.copy()  # F P Fᵀ
        spread[:, 2:] *= kept
        spread[:, :2] += period_s * spread[:, 2:]
        variance = np.array([model.acceleration_variance for model in self.models])[:, None] / share
        for place, speed in ((0, 2), (1, 3)):
            spread[place, place] += variance * period_s**4 / 4
            spread[place, speed] += variance * period_s**3 / 2
            spread[speed, place] += variance * period_s**3 / 2
            spread[speed, speed] += variance * period_s**2
        return after, spread

    def aligned(self, mean: Float[Array, "4 m n"], probability: Float[Array, "m n"]) -> Float[Array, "4 m n"]:
        """Return the means unchanged: there is no angle to align."""
        return mean

    def velocity(self, mean: Float[Array, "4 *n"]) -> Float[Array, "2 *n"]:
        """Return the velocity [m/s]."""
        return mean[2:]
