"""Which measurement can belong to which track, and the global nearest neighbour (Bai and Takahashi, section IV)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]


def validation_region(predicted: Array, position: Array, radius_m: float) -> Mask:
    """Whether each measurement lies in each track's validation region, (n, k): the union of circles around its modes.

    predicted: mode-conditioned positions (n, m, 2) [m]; position: measurements (k, 2) [m].
    """
    difference = position[None, None] - predicted[:, :, None]  # (n, m, k, 2)
    square = np.einsum("nmka,nmka->nmk", difference, difference)
    return (square <= radius_m**2).any(axis=1)


def mahalanobis(predicted: Array, innovation_covariance: Array, position: Array) -> Array:
    """N: the smallest Mahalanobis distance over the modes for each track and measurement, (n, k) (eq. 5).

    predicted: (n, m, 2) [m]; innovation_covariance: (n, m, 2, 2) [m²]; position: (k, 2) [m].
    """
    n, _m = predicted.shape[:2]
    if n == 0 or len(position) == 0:
        return np.zeros((n, len(position)))
    inverse, _ = inverse_2x2(innovation_covariance)
    difference = position[None, None] - predicted[:, :, None]  # (n, m, k, 2)
    square = np.einsum("nmka,nmka->nmk", difference @ inverse, difference)
    return np.sqrt(np.maximum(square.min(axis=1), 0.0))


def global_nearest_neighbour(distance: Array, allowed: Mask) -> tuple[Index, Index]:
    """One-to-one pairs (tracks, measurements) of least total distance among the allowed ones, as many pairs as can be.

    distance, allowed: (n, k). Returns two index arrays of equal length, tracks ascending.
    """
    if not allowed.any():
        return np.empty(0, np.intp), np.empty(0, np.intp)
    # a forbidden pair costs more than every allowed pair together, so that it is only taken when nothing else is left
    forbidden = (np.abs(distance[allowed]).max() + 1.0) * (min(distance.shape) + 1)
    rows, columns = linear_sum_assignment(np.where(allowed, distance, forbidden))
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]
