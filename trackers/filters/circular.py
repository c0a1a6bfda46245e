"""Averages of angles, and distributions over a grid of directions: a histogram filter on the circle."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trackers.arrays import Array, ArrayOrNumber, Float


def circular_mean(
    angle_rad: Float[Array, "*n p"], weight: Float[Array, "*#n p"]
) -> tuple[Float[ArrayOrNumber, "*n"], Float[ArrayOrNumber, "*n"]]:
    """Compute the weighted mean direction of angles, in (−π, π] [rad], and the mean resultant length.

    The length is 1 for equal angles and 0 where they cancel and the direction is meaningless (Mardia and Jupp, "Directional
    Statistics", 2000, section 2.2). Each row of weights sums to 1.
    """
    x, y = (weight * np.cos(angle_rad)).sum(axis=-1), (weight * np.sin(angle_rad)).sum(axis=-1)
    return np.arctan2(y, x), np.hypot(x, y)


@lru_cache(maxsize=8)
def grid_of(n_direction: int) -> Float[Array, "g"]:
    """Return `n_direction` directions around the circle, from 0 on [rad]."""
    grid = np.linspace(0, 2 * np.pi, n_direction, endpoint=False)
    grid.setflags(write=False)
    return grid


def mean_direction(belief: Float[Array, "n g"]) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Compute the `circular_mean` of distributions over a grid."""
    mean, length = circular_mean(np.broadcast_to(grid_of(belief.shape[1]), belief.shape), belief)
    return np.asarray(mean), np.asarray(length)


def diffused(belief: Float[Array, "n g"], sigma_rad: float) -> Float[Array, "n g"]:
    """Convolve a belief about directions with a wrapped normal of this deviation, by its Fourier coefficients."""
    n_direction = belief.shape[1]
    damped = np.exp(-0.5 * (np.arange(n_direction // 2 + 1) * sigma_rad) ** 2)
    return np.maximum(np.fft.irfft(np.fft.rfft(belief, axis=1) * damped, n_direction, axis=1), 0.0)


def drawn(belief: Float[Array, "n g"], n_particle: int, rng: np.random.Generator) -> Float[Array, "n p"]:
    """Draw directions from distributions over a grid [rad]."""
    shares = np.cumsum(belief, axis=1)
    drawn = rng.random((len(belief), n_particle))
    step = (drawn[:, :, None] > shares[:, None, :-1]).sum(axis=2)
    return grid_of(belief.shape[1])[step]
