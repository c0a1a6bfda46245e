"""Gating of measurements, and the global nearest neighbour (Bai and Takahashi, section IV)."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.scipy_functions import linear_sum_assignment


def distances(first: Float[Array, "n 2"], second: Float[Array, "k 2"]) -> Float[Array, "n k"]:
    """Return the distances between each of `first` and each of `second` [m]."""
    difference = first[:, None] - second[None]
    return np.hypot(difference[..., 0], difference[..., 1])


def linked(near: Bool[Mask, "n n"]) -> Int[Index, "n"]:
    """Return for each its cluster by single linkage, named by the first member; near is symmetric.

    Like scipy's `connected_components`, whose checks take ten times as long as joining a few dozen.
    """
    first = np.arange(len(near))
    while True:
        lower = np.minimum(np.where(near, first, len(near)).min(axis=1, initial=len(near)), first)
        if np.array_equal(lower, first):
            return first
        first = lower[lower]  # follow the chain to its present first member


def validation_region(
    predicted: Float[Array, "n m 2"], position: Float[Array, "k 2"], radius_m: Float[Array, "k"] | float
) -> Bool[Mask, "n k"]:
    """Return a mask of pairs whose measurement [m] lies in the track's validation region: the union of circles around its
    modes.
    """
    x, y = _differences(predicted, position)
    return np.logical_or.reduce(x * x + y * y <= radius_m**2, axis=1)


def mahalanobis(
    predicted: Float[Array, "n m 2"], innovation_covariance: Float[Array, "n m 2 2"], position: Float[Array, "k 2"]
) -> Float[Array, "n k"]:
    """Return N: the smallest Mahalanobis distance over the modes for each track and measurement (eq. 5); positions [m]."""
    return mahalanobis_distances(predicted, innovation_covariance, position, np.zeros(len(position)))[0]


def mahalanobis_distances(
    predicted: Float[Array, "n m 2"],
    covariance: Float[Array, "n m 2 2"],
    position: Float[Array, "k 2"],
    variance_m2: Float[Array, "k"],
) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Return N of measurements, each with its own variance on each axis [m²], and −2 ln p, of the likeliest mode.

    p is the density of a measurement [1/m²], a Gaussian of the predicted covariance and that variance, S: N² + ln |S| + 2 ln
    2π is −2 ln p. An uncertain track explains measurements anywhere, but none well.
    """
    x, y = _differences(predicted, position)
    s_xx = covariance[..., 0, 0, None] + variance_m2
    s_yy = covariance[..., 1, 1, None] + variance_m2
    s_xy = covariance[..., 0, 1, None]
    determinant = s_xx * s_yy - s_xy * s_xy
    # the quadratic form of the inverse, in closed form
    square = (x * (s_yy * x - 2 * s_xy * y) + s_xx * y * y) / determinant
    square = np.maximum(square, 0.0)
    N = np.sqrt(square.min(axis=1))
    return N, (square + np.log(determinant)).min(axis=1) + 2 * np.log(2 * np.pi)


def _differences(
    predicted: Float[Array, "n m 2"], position: Float[Array, "k 2"]
) -> tuple[Float[Array, "n m k"], Float[Array, "n m k"]]:
    """Return x and y of measurements less those of modes."""
    return position[:, 0] - predicted[..., 0, None], position[:, 1] - predicted[..., 1, None]


def max_weight_assignment(worth: Float[Array, "n k"]) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"]]:
    """Return the one-to-one pairs (tracks, ascending; measurements) of greatest total worth, without worthless ones."""
    rows, columns = linear_sum_assignment(np.maximum(worth, 0.0), maximize=True)
    real = worth[rows, columns] > 0
    return rows[real], columns[real]


def global_nearest_neighbour(
    distance: Float[Array, "n k"], allowed: Bool[Mask, "n k"]
) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"]]:
    """Return the one-to-one pairs (tracks, ascending; measurements) of least total distance among the most allowed ones.

    Distances may be any costs, negative ones too.
    """
    if not np.count_nonzero(allowed):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    # one more forbidden pair costs more than any set of allowed pairs saves
    forbidden = 2 * min(distance.shape) * (float(np.abs(distance[allowed]).max()) + 1) + 1
    rows, columns = linear_sum_assignment(np.where(allowed, distance, forbidden))
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]
