"""The tracked area: a polygon on the floor, and what lies inside it.

Not shapely's, though as fast: who stands on the border must be judged to the bit as in the recordings there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Mask

_TOLERANCE_M = 1e-9


class Area:
    """A polygon with corners (c, 2) [m], in either sense of rotation, widened by `margin_m` all around."""

    def __init__(self, corners: ArrayLike, margin_m: float = 0.0) -> None:
        self._start = np.asarray(corners, float).T  # (2, c)
        end = np.roll(self._start, -1, axis=1)
        self._edge = end - self._start
        self._end_y = end[1]
        self._slope = self._edge[0] / np.where(self._edge[1] == 0, 1.0, self._edge[1])
        self._length_square = np.maximum((self._edge**2).sum(axis=0), 1e-18)
        self._margin_m = margin_m
        turned = np.array([-self._edge[1], self._edge[0]]) / np.sqrt(self._length_square)
        to_the_middle = self._start.mean(axis=1)[:, None] - self._start
        rotation = np.sign((turned * to_the_middle).sum())  # 0: it has no inside
        self._inward = rotation * turned.T  # (c, 2), unit vectors
        self._border = (self._inward * self._start.T).sum(axis=1)[:, None]
        self._convex = rotation != 0 and bool((self._inward @ self._start >= self._border - _TOLERANCE_M).all())

    def contains(self, points: Array) -> Mask:
        """Whether points (n, 2) lie in the polygon or within the margin of its border, (n,)."""
        if not self._convex:
            return self._exactly(points)
        # how far inside the nearest side's line: all that is to be asked, but in the margin and on the border
        depth_m = np.minimum.reduce(self._inward @ points.T - self._border, axis=0)
        inside = depth_m > _TOLERANCE_M
        if inside.all():  # as most are, most of the time
            return inside
        unsure = ~inside & (depth_m >= -self._margin_m - _TOLERANCE_M)
        if unsure.any():
            inside[unsure] = self._exactly(points[unsure])
        return inside

    def _exactly(self, points: Array) -> Mask:
        x, y = points[:, :1], points[:, 1:]
        off_x, off_y = x - self._start[0], y - self._start[1]  # (n, c)
        # a ray towards +x crosses an odd number of edges from inside
        straddles = (self._start[1] > y) != (self._end_y > y)
        crossed = straddles & (off_x < off_y * self._slope)
        along = (off_x * self._edge[0] + off_y * self._edge[1]) / self._length_square
        along = np.minimum(np.maximum(along, 0), 1)
        gap_square = (off_x - along * self._edge[0]) ** 2 + (off_y - along * self._edge[1]) ** 2
        return np.logical_xor.reduce(crossed, axis=1) | (gap_square <= self._margin_m**2).any(axis=1)
