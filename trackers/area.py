"""The tracked area: a polygon on the floor, and what lies inside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def within(polygon: Array, points: Array, margin_m: float = 0.0) -> Mask:
    """Whether points (n, 2) lie in a polygon (c, 2) or within `margin_m` of its border, (n,) [m]."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    edge = end - start  # (c, 2)
    offset = points[:, None] - start[None]  # (n, c, 2)
    # a ray towards +x crosses an odd number of edges from inside
    straddles = (start[None, :, 1] > points[:, None, 1]) != (end[None, :, 1] > points[:, None, 1])
    rise = np.where(edge[:, 1] == 0, 1.0, edge[:, 1])
    crossing_x = start[:, 0] + (points[:, None, 1] - start[:, 1]) * (edge[:, 0] / rise)
    inside = (straddles & (points[:, None, 0] < crossing_x)).sum(axis=1) % 2 == 1
    length_square = np.maximum((edge**2).sum(axis=1), 1e-18)
    along = np.clip((offset * edge).sum(axis=-1) / length_square, 0, 1)  # (n, c)
    gap = offset - along[..., None] * edge
    return inside | (np.hypot(gap[..., 0], gap[..., 1]).min(axis=1) <= margin_m)
