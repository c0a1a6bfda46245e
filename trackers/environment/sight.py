"""Lines of sight through a grid of voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.environment.grid import Grid

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_ENDS_VOXELS = 1.5
_STEP_VOXELS = 0.75
_ROUNDS, _LEAPS = 3, 8
"""Lines still under way are sorted out after so many leaps, so many times; then the rest is looked at voxel by voxel."""


def leaps_between(steps: Array) -> Single:
    """How far one may go from each voxel, in voxels, without jumping over an occupied one; 0 where it is occupied.

    steps: from the middle of each to the middle of its nearest occupied one, in voxels. Two voxels' middles are as far
    apart as two points in them, give or take 1.7 voxels at worst and hardly ever more than 1: a line that only clips the
    corner of a thing may miss it.
    """
    return np.where(steps == 0, 0.0, np.maximum(steps - 1.0, _STEP_VOXELS)).astype(np.float32)


def sees(leaps: NDArray[np.float32], grid: Grid, origin: Array, points: Array) -> NDArray[np.bool_]:
    """Whether no occupied voxel lies between the origin (3,) and each point (n, 3) [m], the ends apart, (n,).

    Lines leap as far as `leaps`, of the grid's shape (`leaps_between`), allows (Hart 1996, Sphere tracing). One that comes to
    an occupied voxel leaps no further, one at its end stays there; so nothing has to be sorted out at every leap.
    """
    start = (origin - grid.origin_m) / grid.voxel_m  # all lengths in voxels
    way = np.ascontiguousarray((points - origin).T) / grid.voxel_m  # (3, n)
    length = np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    way /= np.maximum(length, 1e-9)
    enters, leaves = _within(start, way, grid)
    first = np.maximum(enters, _ENDS_VOXELS)
    end = np.minimum(leaves, length - _ENDS_VOXELS)
    clear = np.ones(len(points), dtype=bool)
    line = np.flatnonzero(first < end)
    at, end = first[line].astype(np.float32), end[line].astype(np.float32)
    way, start = way[:, line].astype(np.float32), start.astype(np.float32)
    table = leaps.ravel()
    for _ in range(_ROUNDS):
        leap = np.zeros(len(at), dtype=np.float32)
        for _ in range(_LEAPS):
            leap = table.take(_flat(start, way, at, grid))
            at += leap
            np.minimum(at, end, out=at)
        clear[line[leap == 0]] = False
        on = (leap > 0) & (at < end)
        line, at, end, way = line[on], at[on], end[on], way[:, on]
        if not len(line):
            return clear
    steps = np.arange(0, float((end - at).max()) + _STEP_VOXELS, _STEP_VOXELS, dtype=np.float32)
    places = np.minimum(at[:, None] + steps, end[:, None])
    clear[line] = (table.take(_flat(start, way[:, :, None], places, grid)) > 0).all(axis=1)
    return clear


def _flat(start: Single, way: Single, at: Single, grid: Grid) -> NDArray[np.int32]:
    """Flat index of the voxel at each distance along each line."""
    row = (start[0] + at * way[0]).astype(np.int32)
    row *= grid.shape[1]
    row += (start[1] + at * way[1]).astype(np.int32)
    row *= grid.shape[2]
    row += (start[2] + at * way[2]).astype(np.int32)
    return row


def _within(start: Array, way: Array, grid: Grid) -> tuple[Array, Array]:
    """Where each line (3, n) enters and leaves the grid, in voxels from the start; it enters after it leaves if it misses."""
    across = 1 / np.where(np.abs(way) < 1e-12, 1e-12, way)
    one, other = -start[:, None] * across, (np.array(grid.shape) - start)[:, None] * across
    margin = 1e-2  # single precision rounds: stay inside
    return np.minimum(one, other).max(axis=0) + margin, np.maximum(one, other).min(axis=0) - margin
