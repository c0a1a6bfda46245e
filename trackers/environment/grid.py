"""Point clouds, and a grid of voxels that the rays of a scan hit, pass, or do not reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Bool, Float, Index, Int, Mask, UInt32
from trackers.errors import InputError
from trackers.user_input.text_file import AnyPath, as_path


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points (n, 3) [m] in the room frame, the station index (n,) of each, and the stations' positions (s, 3) [m].

    Between a station and each of its points the ray met nothing, which gives free space. Raises InputError for arrays of
    inconsistent sizes and non-finite numbers.
    """

    points_m: NDArray[np.float64]
    station: NDArray[np.int16]
    origins_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        points, origins = np.shape(self.points_m), np.shape(self.origins_m)
        if len(points) != 2 or points[1] != 3:
            raise InputError(f"point cloud: points have shape {points}; (n, 3) is expected")
        if len(origins) != 2 or origins[1] != 3 or not origins[0]:
            raise InputError(f"point cloud: origins have shape {origins}; (s, 3) with at least one station is expected")
        if np.shape(self.station) != points[:1]:
            raise InputError(
                f"point cloud: there are {points[0]} points and the stations of {np.shape(self.station)}; one for each "
                "point is expected"
            )
        if points[0] and not (self.station.min() >= 0 and self.station.max() < origins[0]):
            raise InputError(
                f"point cloud: stations {self.station.min()} to {self.station.max()} are named and {origins[0]} given; "
                f"0 to {origins[0] - 1} are expected"
            )
        for name, values in (("points", self.points_m), ("origins", self.origins_m)):
            if not np.isfinite(values).all():
                raise InputError(f"point cloud: {name} hold NaN or infinity; leave out rays that met nothing")

    def write_ply(self, path: AnyPath) -> None:
        """Write the points as binary PLY (float32 x, y, z and the station), for CloudCompare and others."""
        record = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("station", "<i2")])
        rows = np.empty(len(self.points_m), dtype=record)
        for axis, name in enumerate("xyz"):
            rows[name] = self.points_m[:, axis]
        rows["station"] = self.station
        head = ["ply", "format binary_little_endian 1.0", "comment room frame, metres, z up"]
        head += [f"comment station {place[0]:.6f} {place[1]:.6f} {place[2]:.6f}" for place in self.origins_m]
        head += [f"element vertex {len(rows)}", *(f"property float {axis}" for axis in "xyz"), "property short station"]
        head += ["end_header", ""]
        as_path(path, "point cloud").write_bytes("\n".join(head).encode() + rows.tobytes())


Counts = NDArray[np.uint32]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""States of a voxel: no ray reached it; rays passed through; occupied."""

SMALLEST_VOXEL_M, LARGEST_VOXEL_M = 0.01, 0.5
MOST_VOXELS = 100_000_000
"""Greatest number of voxels of a grid: trackers use some 30 bytes for each."""

_AT_ONCE = 50_000
"""Number of points or rays worked at once: of millions, what is worked out of each would take several times their memory."""
_SHORT_OF_END = 1.0
"""Number of voxels before its end in which a ray frees nothing: ranges are noisy, and surfaces are hit obliquely."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Grid of cubic voxels of side `voxel_m`, `shape` (nx, ny, nz), from the corner `origin_m` [m] of the room frame."""

    origin_m: Float[Array, "3"]
    voxel_m: float
    shape: tuple[int, int, int]

    @property
    def size(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    @property
    def upper_m(self) -> Float[Array, "3"]:
        """Corner opposite to the origin [m]."""
        return self.origin_m + self.voxel_m * np.array(self.shape)

    def flat(self, points: Float[Array, "n 3"]) -> tuple[Int[Index, "n"], Bool[Mask, "n"]]:
        """Return the flat index of the voxel of each point [m] (0 for those outside), and which points are inside.

        Raises ValueError for coordinates that are not finite.
        """
        cell, inside = self._cells(points)
        return (cell[0] * self.shape[1] + cell[1]) * self.shape[2] + cell[2], inside

    def column(self, points: Float[Array, "n axes"]) -> tuple[Int[Index, "n"], Bool[Mask, "n"]]:
        """Return the flat index of the column of voxels at each place, by 2 or 3 axes [m] (0 outside), and which are inside."""
        cell, inside = self._cells(points[:, :2])
        return cell[0] * self.shape[1] + cell[1], inside

    def _cells(self, points: Float[Array, "n axes"]) -> tuple[Int[Index, "axes n"], Bool[Mask, "n"]]:
        """Return the index of the cell along each axis, 0 outside, and which are inside."""
        axes = points.shape[1]
        if len(points) > _AT_ONCE:
            starts = range(0, len(points), _AT_ONCE)
            cells, insides = zip(*(self._cells(points[first : first + _AT_ONCE]) for first in starts), strict=True)
            return np.concatenate(cells, axis=1), np.concatenate(insides)
        # One row per axis: numpy is several times faster along long rows.
        place = (np.ascontiguousarray(points.T) - self.origin_m[:axes, None]) * (1 / self.voxel_m)
        if not np.isfinite(place).all():
            raise ValueError("points hold NaN or infinity; a place in the room is expected")
        within = (place >= 0) & (place < np.array(self.shape[:axes])[:, None])
        inside = np.logical_and.reduce(within, axis=0)
        return np.where(inside, place, 0.0).astype(np.intp), inside

    def centres(self, flat: Int[Index, "n"]) -> Float[Array, "n 3"]:
        """Return the centres [m] of voxels given by flat index."""
        return self.origin_m + self.voxel_m * (np.stack(np.unravel_index(flat, self.shape), axis=-1) + 0.5)


def count_rays(cloud: PointCloud, grid: Grid) -> tuple[UInt32[Counts, "size"], UInt32[Counts, "size"]]:
    """Count the points in each voxel, and the rays that passed through it.

    A ray is sampled at every voxel's length, so a voxel clipped at a corner may be missed, and none counts twice except by
    rounding. The stations are in the grid.
    """
    hits = np.zeros(grid.size, dtype=np.uint32)
    flat, inside = grid.flat(cloud.points_m)
    np.add.at(hits, flat[inside], np.uint32(1))
    passes = np.zeros(grid.size, dtype=np.uint32)
    for station, origin in enumerate(cloud.origins_m):
        points = cloud.points_m[cloud.station == station]
        for first in range(0, len(points), _AT_ONCE):
            _march(points[first : first + _AT_ONCE], origin, grid, passes)
    return hits, passes


def _march(points: Float[Array, "n 3"], origin: Float[Array, "3"], grid: Grid, passes: UInt32[Counts, "size"]) -> None:
    """Add one to every voxel on the way from the origin to each point."""
    start = (origin - grid.origin_m) / grid.voxel_m  # all lengths in voxels
    way = (points - origin) / grid.voxel_m
    length = np.linalg.norm(way, axis=1)
    way, length = way[length > 0], length[length > 0]
    way /= length[:, None]
    with np.errstate(divide="ignore"):
        leaves = np.where(way > 0, grid.shape - start, -start) / way  # NaN where way and start are 0
    leaves = np.where(way == 0, np.inf, leaves).min(axis=1) - 1e-3
    length = np.minimum(length - _SHORT_OF_END, leaves)
    order = np.argsort(-length, kind="stable")  # so that the unfinished rays always come first
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
