"""Averages of angles."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array


def circular_mean(angle_rad: Array, weight: Array) -> tuple[Array, Array]:
    """The weighted mean direction of angles (..., p) [rad], (...) in (−π, π], and the mean resultant length, (...).

    The length is 1 where all point one way and 0 where they cancel, so that the direction says nothing (Mardia and Jupp,
    "Directional Statistics", 2000, section 2.2). weight: (..., p), each row sums to 1.
    """
    x, y = (weight * np.cos(angle_rad)).sum(axis=-1), (weight * np.sin(angle_rad)).sum(axis=-1)
    return np.arctan2(y, x), np.hypot(x, y)
