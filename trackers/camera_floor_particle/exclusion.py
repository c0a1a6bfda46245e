"""The occlusion exclusion model (section 3.2): particles of different persons do not stand on the same spot."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.camera_floor_particle.options import ExclusionOptions

_GRID_M = 0.02
"""Side of the elements of the grid that squares are marked on."""
_MOST_ELEMENTS = 1000
"""Along each axis: 20 m. Particles farther off are taken for the border's."""


def excluded(
    places: Float[Array, "2 n p"], evidence: Float[Array, "n"], options: ExclusionOptions
) -> Bool[Mask, "n p"]:
    """Mark the particles whose square overlaps that of another person's particle, at x, y [m].

    Each person's particles are marked on a grid and spread by the side of a square, so that it costs no pairs. By the
    paper both lose their particles there, here (ours) only the one that the last measurement made less likely (`evidence`).
    """
    n = places.shape[1]
    if n < 2 or options.side_m == 0:
        return np.zeros(places.shape[1:], np.bool_)
    low, high = places.min(axis=2), places.max(axis=2)
    reach = options.side_m + 2 * _GRID_M
    meet = ((low[:, :, None] - reach < high[:, None]) & (high[:, :, None] + reach > low[:, None])).all(axis=0)
    if meet.sum() == n:  # each track meets itself alone
        return np.zeros(places.shape[1:], np.bool_)
    from_corner = (places - places.min(axis=(1, 2), keepdims=True)) / _GRID_M
    column, row = np.minimum(np.floor(from_corner + 1e-9).astype(np.intp), _MOST_ELEMENTS - 1)
    person = np.argsort(-evidence, kind="stable")[:, None]
    column, row = column[person[:, 0]], row[person[:, 0]]
    marked = np.zeros((n, row.max() + 1, column.max() + 1), np.uint8)
    marked[np.arange(n)[:, None], row, column] = 1
    side = 2 * int(options.side_m / _GRID_M + 1e-9) + 1
    spread = np.stack([cv2.dilate(each, np.ones((side, side), np.uint8)) for each in marked]).astype(np.intp)
    before = np.cumsum(spread, axis=0) - spread  # of those likelier
    others = before if options.likelier_stays else spread.sum(axis=0) - spread
    overlapping = np.empty(places.shape[1:], np.bool_)
    overlapping[person[:, 0]] = others[np.arange(n)[:, None], row, column] > 0
    return overlapping
