"""Averages of angles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array, ArrayOrNumber


def circular_mean(
    angle_rad: Float[Array, "*n p"], weight: Float[Array, "*#n p"]
) -> tuple[Float[ArrayOrNumber, "*n"], Float[ArrayOrNumber, "*n"]]:
    """The weighted mean direction of angles, in (−π, π] [rad], and the mean resultant length.

    The length is 1 where all point one way and 0 where they cancel, so that the direction says nothing (Mardia and Jupp,
    "Directional Statistics", 2000, section 2.2). Each row of weights sums to 1.
    """
    x, y = (weight * np.cos(angle_rad)).sum(axis=-1), (weight * np.sin(angle_rad)).sum(axis=-1)
    return np.arctan2(y, x), np.hypot(x, y)
