"""A grid of voxels in the room, and what the rays of a scan say about each: met, passed, or neither."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt32
from numpy.typing import NDArray

from trackers.arrays import Array, Index, Mask
from trackers.environment.cloud import PointCloud

Counts = NDArray[np.uint32]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""States of a voxel: no ray came there; rays passed through; something is there."""

SMALLEST_VOXEL_M, LARGEST_VOXEL_M = 0.01, 0.5
MOST_VOXELS = 100_000_000
"""Voxels of a grid: what trackers work out of each takes some 30 bytes."""

_SHORT_OF_END = 1.0
"""A ray frees nothing within this many voxels of where it ends: its range has noise, and surfaces are met aslant."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Cubes of side `voxel_m`, `shape` (nx, ny, nz) of them, from the corner `origin_m` [m] of the room frame."""

    origin_m: Float[Array, "3"]
    voxel_m: float
    shape: tuple[int, int, int]

    @property
    def size(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    @property
    def upper_m(self) -> Float[Array, "3"]:
        """The corner opposite to the origin [m]."""
        return self.origin_m + self.voxel_m * np.array(self.shape)

    def flat(self, points: Float[Array, "n 3"]) -> tuple[Int[Index, "n"], Bool[Mask, "n"]]:
        """Flat index of the voxel of each point [m] (0 for those outside), and which points are inside.

        Raises ValueError for coordinates that are not finite.
        """
        cell, inside = self._cells(points)
        return (cell[0] * self.shape[1] + cell[1]) * self.shape[2] + cell[2], inside

    def column(self, points: Float[Array, "n axes"]) -> tuple[Int[Index, "n"], Bool[Mask, "n"]]:
        """Flat index of the column of voxels over each place, by 2 or 3 axes [m] (0 outside), and which are inside."""
        cell, inside = self._cells(points[:, :2])
        return cell[0] * self.shape[1] + cell[1], inside

    def _cells(self, points: Float[Array, "n axes"]) -> tuple[Int[Index, "axes n"], Bool[Mask, "n"]]:
        """Index of the cell along each axis, 0 outside, and which are inside."""
        axes = points.shape[1]
        # An axis a row: numpy is several times faster along long rows.
        place = (np.ascontiguousarray(points.T) - self.origin_m[:axes, None]) * (1 / self.voxel_m)
        if not np.isfinite(place).all():
            raise ValueError("points hold NaN or infinity; a place in the room is expected")
        within = (place >= 0) & (place < np.array(self.shape[:axes])[:, None])
        inside = np.logical_and.reduce(within, axis=0)
        return np.where(inside, place, 0.0).astype(np.intp), inside

    def centres(self, flat: Int[Index, "n"]) -> Float[Array, "n 3"]:
        """Middles [m] of voxels given by flat index."""
        return self.origin_m + self.voxel_m * (np.stack(np.unravel_index(flat, self.shape), axis=-1) + 0.5)


def count_rays(cloud: PointCloud, grid: Grid) -> tuple[UInt32[Counts, "size"], UInt32[Counts, "size"]]:
    """Count the points in each voxel, and the rays that passed through it.

    A ray is looked at every voxel's length, so a voxel of which it only clips a corner may be missed, and none counts
    twice for it but by rounding. The stations are in the grid.
    """
    hits = np.zeros(grid.size, dtype=np.uint32)
    flat, inside = grid.flat(cloud.points_m)
    np.add.at(hits, flat[inside], np.uint32(1))
    passes = np.zeros(grid.size, dtype=np.uint32)
    for station, origin in enumerate(cloud.origins_m):
        _march(cloud.points_m[cloud.station == station], origin, grid, passes)
    return hits, passes


def _march(points: Float[Array, "n 3"], origin: Float[Array, "3"], grid: Grid, passes: UInt32[Counts, "size"]) -> None:
    """Add one to every voxel on the way from the origin to each point."""
    start = (origin - grid.origin_m) / grid.voxel_m  # all lengths in voxels
    way = (points - origin) / grid.voxel_m
    length = np.linalg.norm(way, axis=1)
    way, length = way[length > 0], length[length > 0]
    way /= length[:, None]
    with np.errstate(divide="ignore"):
        leaves = np.where(way > 0, grid.shape - start, -start) / way  # nan where way is 0 and start too
    leaves = np.where(way == 0, np.inf, leaves).min(axis=1) - 1e-3
    length = np.minimum(length - _SHORT_OF_END, leaves)
    order = np.argsort(-length, kind="stable")  # so that the rays still under way are always the first ones
    way, length = way[order].astype(np.float32), length[order]
    x, y, z = np.ascontiguousarray(way.T)
    x0, y0, z0 = start.astype(np.float32)
    one = np.uint32(1)
    for step in range(int(max(length[0], 0)) + 1 if len(length) else 0):
        at = np.float32(step + 0.5)
        count = int(np.searchsorted(-length, -at, side="left"))  # those longer than `at`
        row = (x0 + at * x[:count]).astype(np.int32)
        row *= grid.shape[1]
        row += (y0 + at * y[:count]).astype(np.int32)
        row *= grid.shape[2]
        row += (z0 + at * z[:count]).astype(np.int32)
        np.add.at(passes, row, one)
