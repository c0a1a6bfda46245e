"""Where somebody can stand in a drawn building, and which of these places can be reached from which."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import meets_itself_at
from trackers.arrays import Array, Index
from twin.drawn.floor_plan import FloorPlan
from twin.geometry.polygon import inset

_CELL_M = 0.05
KEEP_M = 0.46
"""Distance that people's middles keep from walls and furniture in this check [m]; they walk a little closer."""

WALKED_M = 0.2
"""Distance from walls of the area that people's middles stay in [m]."""
_MARGINS_M = (0.18, 0.2)
"""What routes keep from the edge of that area: it must be wide enough for them everywhere [m]."""


class FreeSpace:
    """A grid of the floor on which walls and furniture are drawn.

    Places are in the plan's frame [m]. What can be reached is what is connected to the largest free part.
    """

    def __init__(self, plan: FloorPlan) -> None:
        columns, rows = np.ceil(plan.size_m / _CELL_M).astype(int) + 1
        y, x = np.mgrid[:rows, :columns] * _CELL_M
        inside = plan.is_inside(np.column_stack([x.ravel(), y.ravel()])).reshape(rows, columns)
        self._taken = np.pad((~inside).astype(np.uint8), 1, constant_values=1)
        for partition in plan.partitions:
            for first, last in ((0.0, partition.gap_m[0]), (partition.gap_m[1], partition.wall.length_m)):
                self.take(np.array([partition.wall.at(first), partition.wall.at(last)]))
        self._number: NDArray[np.int32] | None = None

    def copy(self) -> FreeSpace:
        """Return a grid that can be changed alone."""
        other = object.__new__(FreeSpace)
        other._taken, other._number = self._taken.copy(), self._number
        return other

    def take(self, corners: Array) -> None:
        """Draw a convex footprint (k, 2) [m], of two corners a line, as taken."""
        cells = np.rint((corners / _CELL_M + 1) * 256).astype(np.int32)
        if len(corners) == 2:
            cv2.line(self._taken, cells[0].tolist(), cells[1].tolist(), 1, thickness=2, shift=8)
        else:
            cv2.fillConvexPoly(self._taken, cells, 1, shift=8)
        self._number = None

    @property
    def _parts(self) -> NDArray[np.int32]:
        """The connected parts of the places where a middle can be, numbered from 1 by size; 0: taken."""
        if self._number is None:
            gap_m = cv2.distanceTransform(1 - self._taken, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * _CELL_M
            found = cv2.connectedComponentsWithStats((gap_m >= KEEP_M).astype(np.uint8), connectivity=4)
            number, stats = np.asarray(found[1], np.int32), np.asarray(found[2])
            order = np.zeros(len(stats), np.int32)
            order[1 + (-stats[1:, cv2.CC_STAT_AREA]).argsort(kind="stable")] = np.arange(1, len(stats))
            self._number = order[number]
        return self._number

    def is_reached(self, places: Array) -> NDArray[np.bool_]:
        """Which places (n, 2) [m] are free and in the largest free part."""
        parts = self._parts
        cells = np.rint(places / _CELL_M + 1).astype(int)
        there = ((cells >= 0) & (cells < parts.shape[::-1])).all(axis=1)
        reached = np.zeros(len(places), bool)
        reached[there] = parts[cells[there, 1], cells[there, 0]] == 1
        return reached

    @property
    def area_m2(self) -> float:
        """Area in which middles can be, of the largest part [m²]."""
        return float(np.count_nonzero(self._parts == 1)) * _CELL_M**2

    def walkable_area(self) -> Array | None:
        """Return the outline (k, 2) [m] of the largest part that is `WALKED_M` off what is taken; None if it is too ragged."""
        gap_m = cv2.distanceTransform(1 - self._taken, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * _CELL_M
        outlines, _ = cv2.findContours((gap_m >= WALKED_M).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        outline = max(outlines, key=cv2.contourArea)
        for rough_cells in (0.6, 1.2, 2.4):
            corners = (cv2.approxPolyDP(outline, rough_cells, closed=True)[:, 0].astype(np.float64) - 1) * _CELL_M
            if meets_itself_at(corners) is None and all(inset(corners, each) is not None for each in _MARGINS_M):
                return corners
        return None

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw places (count, 2) [m] of the largest free part, uniformly."""
        rows, columns = np.nonzero(self._parts == 1)
        chosen: Index = rng.integers(len(rows), size=count)
        return (np.column_stack([columns[chosen], rows[chosen]]).astype(np.float64) - 1) * _CELL_M
