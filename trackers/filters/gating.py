"""Which measurement can belong to which track, and the global nearest neighbour (Bai and Takahashi, section IV)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from trackers.arrays import Array, Index, Mask


def distances(first: Array, second: Array) -> Array:
    """Distance between each of `first` (n, 2) and each of `second` (k, 2), (n, k) [m]."""
    difference = first[:, None] - second[None]
    return np.hypot(difference[..., 0], difference[..., 1])


def validation_region(predicted: Array, position: Array, radius_m: float) -> Mask:
    """Whether each measurement lies in each track's validation region, (n, k): the union of circles around its modes.

    predicted: mode-conditioned positions (n, m, 2) [m]; position: measurements (k, 2) [m].
    """
    x, y = _differences(predicted, position)
    return np.logical_or.reduce(x * x + y * y <= radius_m**2, axis=1)


def mahalanobis(predicted: Array, innovation_covariance: Array, position: Array) -> Array:
    """N: the smallest Mahalanobis distance over the modes for each track and measurement, (n, k) (eq. 5).

    predicted: (n, m, 2) [m]; innovation_covariance: symmetric, (n, m, 2, 2) [m²]; position: (k, 2) [m].
    """
    x, y = _differences(predicted, position)
    s_xx, s_xy, s_yy = (
        innovation_covariance[..., 0, 0],
        innovation_covariance[..., 0, 1],
        innovation_covariance[..., 1, 1],
    )
    determinant = s_xx * s_yy - s_xy * s_xy
    # the quadratic form of the inverse, in closed form: a x² + 2 b x y + c y²
    a, b, c = (s_yy / determinant)[..., None], (-s_xy / determinant)[..., None], (s_xx / determinant)[..., None]
    square = x * (a * x + 2 * b * y) + c * y * y
    return np.sqrt(np.maximum(square.min(axis=1), 0.0))


def _differences(predicted: Array, position: Array) -> tuple[Array, Array]:
    """x and y of measurements (k, 2) less those of modes (n, m, 2), (n, m, k) each."""
    return position[:, 0] - predicted[..., 0, None], position[:, 1] - predicted[..., 1, None]


def global_nearest_neighbour(distance: Array, allowed: Mask) -> tuple[Index, Index]:
    """One-to-one pairs (tracks, measurements) of least total distance among the allowed ones, as many pairs as can be.

    distance, allowed: (n, k). Returns two index arrays of equal length, tracks ascending.
    """
    if not allowed.any():
        return np.empty(0, np.intp), np.empty(0, np.intp)
    # a forbidden pair costs more than every allowed pair together, so that it is only taken when nothing else is left
    forbidden = (np.abs(distance).max(where=allowed, initial=0.0) + 1.0) * (min(distance.shape) + 1)
    rows, columns = linear_sum_assignment(np.where(allowed, distance, forbidden))
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]
