"""Lines of sight through a grid of voxels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from numpy.typing import NDArray

from trackers.arrays import Array, Mask, Singles
from trackers.environment.grid import Grid

Voxels = NDArray[np.int32]

_ENDS_VOXELS = 1.5
"""Distance from a line's ends within which voxels do not count: cameras hang on walls, heads come close to objects."""

_STEP_VOXELS = 0.75
_ROUNDS, _LEAPS = 3, 8
"""Numbers of rounds, and of leaps per round after which finished lines are removed; the rest is traced voxel by voxel."""


def leaps_between(steps: Float[Array, "nx ny nz"]) -> Float32[Singles, "nx ny nz"]:
    """Return the safe leap from each voxel, in voxels, without crossing an occupied one; 0 where occupied.

    steps: from the centre of each to that of its nearest occupied one, in voxels. The distance of two voxels' centres
    differs from that of points in them by 1.7 voxels at worst and rarely more than 1: a line that clips an object's corner
    may miss it.
    """
    return np.where(steps == 0, 0.0, np.maximum(steps - 1.0, _STEP_VOXELS)).astype(np.float32)


def sees(
    leaps: Float32[Singles, "nx ny nz"], grid: Grid, origin: Float[Array, "3"], points: Float[Array, "n 3"]
) -> Bool[Mask, "n"]:
    """Return a mask of points [m] with no occupied voxel between them and the origin, except near the ends."""
    way = np.ascontiguousarray((points - origin).T)
    length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    way /= np.maximum(length, 1e-9 * grid.voxel_m)
    return first_met(leaps, grid, origin, way, length / grid.voxel_m - _ENDS_VOXELS) < 0


def first_met(
    leaps: Float32[Singles, "nx ny nz"],
    grid: Grid,
    origin: Float[Array, "3"],
    way: Float[Array, "3 n"],
    end: Float[Array, "n"] | float = np.inf,
) -> Int32[Voxels, "n"]:
    """Trace each line to its first occupied voxel: the flat index, −1 without one before `end`.

    Lines start from one origin [m], along unit vectors `way`, up to `end` in voxels, and begin
    _ENDS_VOXELS away. They leap as far as `leaps` (`leaps_between`) allows (Hart 1996, Sphere tracing). A line at an
    occupied voxel, or its end, stays there, so lines need not be removed after every leap.
    """
    from_voxel = ((origin - grid.origin_m) / grid.voxel_m).T.reshape(3, -1)
    enters, leaves = _within(from_voxel, way, grid)
    first, last = np.maximum(enters, _ENDS_VOXELS), np.minimum(leaves, end)
    voxel = np.full(way.shape[1], -1, dtype=np.int32)
    line = np.flatnonzero(first < last)
    at, stop = first[line].astype(np.float32), last[line].astype(np.float32)
    along, start = way[:, line].astype(np.float32), from_voxel.astype(np.float32)
    start = start if start.shape[1] == 1 else start[:, line]
    table = leaps.ravel()
    for _ in range(_ROUNDS):
        leap, index = np.zeros(len(at), dtype=np.float32), np.zeros(len(at), dtype=np.int32)
        for _ in range(_LEAPS):
            index = _flat(start, along, at, grid)
            leap = table.take(index)
            at += leap
            np.minimum(at, stop, out=at)
        stopped = leap == 0
        voxel[line[stopped]] = index[stopped]
        on = ~stopped & (at < stop)
        line, at, stop, along = line[on], at[on], stop[on], along[:, on]
        start = start if start.shape[1] == 1 else start[:, on]
        if not len(line):
            return voxel
    steps = np.arange(0, float((stop - at).max()) + _STEP_VOXELS, _STEP_VOXELS, dtype=np.float32)
    places = np.minimum(at[:, None] + steps, stop[:, None])
    passed = _flat(start[:, :, None], along[:, :, None], places, grid)
    stops = table.take(passed) == 0
    voxel[line] = np.where(stops.any(axis=1), passed[np.arange(len(line)), stops.argmax(axis=1)], -1)
    return voxel


def _flat(
    start: Float32[Singles, "3 *from"], way: Float32[Singles, "3 *lines"], at: Float32[Singles, "*n"], grid: Grid
) -> Int32[Voxels, "*n"]:
    """Return the flat index of the voxel at each distance along each line."""
    row = (start[0] + at * way[0]).astype(np.int32)
    row *= grid.shape[1]
    row += (start[1] + at * way[1]).astype(np.int32)
    row *= grid.shape[2]
    row += (start[2] + at * way[2]).astype(np.int32)
    return row


def _within(
    start: Float[Array, "3 #n"], way: Float[Array, "3 n"], grid: Grid
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Return where each line enters and leaves the grid, in voxels from the start; a miss enters after it leaves."""
    across = 1 / np.where(np.abs(way) < 1e-12, 1e-12, way)
    one, other = -start * across, (np.array(grid.shape)[:, None] - start) * across
    margin = 1e-2  # margin for single precision: stay inside
    return np.minimum(one, other).max(axis=0) + margin, np.maximum(one, other).min(axis=0) - margin
