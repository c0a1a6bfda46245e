"""Environment: knowledge of a room's space, queried for many points at once, and lines of sight through its voxels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from trackers.area import Area
from trackers.arrays import Array, Bool, Bytes, Float, Float32, Int32, Mask, Singles, UInt8
from trackers.environment.grid import FREE, OCCUPIED, UNKNOWN, Grid
from trackers.errors import InputError

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


_KNOWN_SHARE = 0.8
"""Least share of a tracked area that the scanner must have seen; the rest may be behind furniture."""


@dataclass(frozen=True, eq=False)
class Environment:
    """Walls, furniture and free space of a room from a range scanner; room frame, metres, z up.

    `room` is the room's name ('' if unknown), `area_m` its tracked area when scanned (empty: none), `stations_m` the scan's
    origins. `state` holds UNKNOWN, FREE or OCCUPIED for each voxel of `grid`, `surface_m` the mean of the points in each
    occupied voxel, in C order. `top_m` is the height of the object in each column of voxels: furniture, a wall up to
    `EnvironmentOptions.furniture_m`, else the floor; NaN where neither was seen, gaps of up to two columns closed.
    `ceiling_m` is NaN where none was seen. `walls_m` are segments in plan, the room to the left from first end to second; a
    wall continues above its doors.
    """

    room: str
    area_m: Float[Array, "k 2"]
    stations_m: Float[Array, "s 3"]
    grid: Grid
    state: UInt8[Bytes, "nx ny nz"]
    surface_m: Float32[Singles, "m 3"]
    top_m: Float32[Singles, "nx ny"]
    floor_m: float
    ceiling_m: float
    walls_m: Float[Array, "w 2 2"]

    def is_free(self, points: ArrayLike) -> Bool[Mask, "n"]:
        """Return a mask of points (n, 3) in free voxels; unknown space is not free."""
        flat, inside = self.grid.flat(_points(points))
        return inside & (self.state.ravel()[flat] == FREE)

    def distance_to_surface(self, points: ArrayLike) -> Float[Array, "n"]:
        """Return the distance [m] from each point (n, 3) to the nearest measured surface; NaN outside the grid.

        Interpolated between voxels: accurate to about half a voxel. Inside furniture it is the distance to the visible face.
        """
        points = _points(points)
        _, inside = self.grid.flat(points)
        # Between voxel centres; beyond the outermost constant.
        cell = (points - self.grid.origin_m) * (1 / self.grid.voxel_m) - 0.5
        cell = np.clip(cell, 0, np.array(self.grid.shape) - 1)
        low = np.minimum(cell.astype(np.intp), np.array(self.grid.shape) - 2)
        share = (cell - low).astype(np.float32)
        field, (_, ny, nz) = self._fields[0].ravel(), self.grid.shape
        first = (low[:, 0] * ny + low[:, 1]) * nz + low[:, 2]
        # eight corners: along z, then y, then x
        corners = field[first[:, None] + np.array([0, 1, nz, nz + 1])]
        beyond = field[first[:, None] + (ny * nz + np.array([0, 1, nz, nz + 1]))]
        along_x = corners + (beyond - corners) * share[:, :1]  # (n, 4)
        along_y = along_x[:, :2] + (along_x[:, 2:] - along_x[:, :2]) * share[:, 1:2]
        value = along_y[:, 0] + (along_y[:, 1] - along_y[:, 0]) * share[:, 2]
        return np.where(inside, value, np.nan)

    def height_under(self, places: ArrayLike) -> Float[Array, "n"]:
        """Return the height [m] of the top at each place (n, 2 or 3): furniture's, else the floor; NaN where unknown."""
        places = np.asarray(places, dtype=float)
        column, inside = self.grid.column(places)
        return np.where(inside, self.top_m.ravel()[column], np.nan)

    def head_weight(
        self,
        points: ArrayLike,
        *,
        above_furniture: float = 0.5,
        odd_height: float = 0.2,
        low_m: float = 0.8,
        high_m: float = 1.9,
    ) -> Float[Array, "n"]:
        """Return the weight of a head at each point (n, 3): the environment model of Suzuki et al. 2007, eq. 8.

        0 outside the walls and inside objects (their region A), `above_furniture` in the column above furniture (B),
        `odd_height` lower than `low_m` or higher than `high_m` above the floor (C), 1 elsewhere; the least where regions
        overlap. The three weights are the paper's; the two heights, which it does not give, are ours. Also ours: free space
        in a shelf, under a table, or over an unseen floor gets `above_furniture`. So does unknown space above free space, as
        it is merely hidden; unknown space under an object's top, or above no free space, is inside it or a wall.
        """
        points = _points(points)
        flat, inside = self.grid.flat(points)
        weight = self._weight_by_voxel(above_furniture)[flat] * inside
        height = points[:, 2] - self.floor_m
        odd = (height < low_m) | (height > high_m)
        weight[odd] = np.minimum(weight[odd], odd_height)
        weight[height <= 0] = 0.0  # the floor's own layer extends half a voxel above it
        return weight

    def visible(self, origin: ArrayLike, points: ArrayLike) -> Bool[Mask, "n"]:
        """Return a mask of points (n, 3) without an occupied voxel between them and the origin (3,).

        Voxels within 1.5 voxels of either end do not count: cameras hang on walls, heads come close to objects. Unknown
        space, and space beyond the grid, is transparent.
        """
        points, origin = _points(points), np.asarray(origin, dtype=float)
        if origin.shape != (3,) or not np.isfinite(origin).all() or not np.isfinite(points).all():
            raise ValueError(f"origin {origin}: one place (3,) and finite points are expected")
        return sees(self._fields[1], self.grid, origin, points)

    def agreement(self, points: ArrayLike, within_m: float = 0.15) -> float:
        """Return the share of measured points (n, 3) [m], for example of the empty room, on a known surface.

        Near 1 if environment and sensors are of the same room and well calibrated. Points in unknown space do not count; NaN
        without others.
        """
        points = _points(points)
        flat, inside = self.grid.flat(points)
        counted = inside & (self.state.ravel()[flat] != UNKNOWN)
        if not counted.any():
            return float("nan")
        return float((self.distance_to_surface(points[counted]) <= within_m).mean())

    def check(self, source: str, *, room: str | None = None, area: ArrayLike | None = None) -> None:
        """Raise InputError, with the prefix `source`, if this is the environment of another room.

        `room`: name of the sensors' room; `area` (k, 2) [m]: its tracked area. The names must agree if both are known, and
        at least four fifths of the area must have been seen by the scanner.
        """
        if room and self.room and room != self.room:
            raise InputError(f"{source}: is of the room {self.room!r}; one of {room!r} is expected")
        if area is None:
            return
        corners = np.asarray(area, dtype=float)
        low, high = self.grid.origin_m[:2], self.grid.upper_m[:2]
        outside = ~((corners >= low) & (corners <= high)).all(axis=1)
        bounds = f"x {low[0]:.2f} to {high[0]:.2f} m, y {low[1]:.2f} to {high[1]:.2f} m"
        if outside.any():
            x, y = corners[outside][0]
            raise InputError(
                f"{source}: reaches over {bounds} and not to the corner [{x:g}, {y:g}] of the rig's area; the environment "
                "of the room that the rig is in is expected"
            )
        first, last = corners.min(axis=0), corners.max(axis=0)
        step = self.grid.voxel_m
        x, y = np.meshgrid(np.arange(first[0], last[0], step), np.arange(first[1], last[1], step))
        places = np.stack([x.ravel(), y.ravel()], axis=-1) + step / 2
        places = places[Area(corners).contains(places)]
        seen = float(np.isfinite(self.height_under(places)).mean()) if len(places) else 1.0
        if seen < _KNOWN_SHARE:
            raise InputError(
                f"{source}: the scanner saw {seen:.0%} of the rig's area; {_KNOWN_SHARE:.0%} or more, of the room that the "
                "rig is in, is expected"
            )

    @cached_property
    def _fields(self) -> tuple[Float32[Singles, "nx ny nz"], Float32[Singles, "nx ny nz"]]:
        """Distance [m] from each voxel's centre to the mean point of its nearest occupied voxel, and leaps along lines of sight.

        Both computed on first use from one transform.
        """
        occupied = self.state == OCCUPIED
        if not occupied.any():
            nothing = np.full(self.grid.shape, np.inf, dtype=np.float32)
            return nothing, np.full_like(nothing, max(self.grid.shape))
        found = ndimage.distance_transform_edt(~occupied, return_indices=True)
        assert found is not None  # as no output arrays were given
        steps, nearest = found
        row = (np.cumsum(occupied.ravel(), dtype=np.int32) - 1).reshape(self.grid.shape)[tuple(nearest)]
        square = np.zeros(self.grid.shape, dtype=np.float32)
        for axis in range(3):
            middle = self.grid.origin_m[axis] + self.grid.voxel_m * (np.arange(self.grid.shape[axis]) + 0.5)
            off = self.surface_m[:, axis][row]
            off -= np.expand_dims(middle.astype(np.float32), tuple({0, 1, 2} - {axis}))
            off *= off
            square += off
        return np.sqrt(square, out=square), leaps_between(steps)

    @cached_property
    def _weight_levels(self) -> tuple[Bool[Mask, "size"], Bool[Mask, "size"]]:
        """Masks of the voxels in region A, and of those in the column of furniture or hidden."""
        free, unknown = self.state == FREE, self.state == UNKNOWN
        free_below = np.logical_or.accumulate(free, axis=2)
        middle = self.grid.origin_m[2] + self.grid.voxel_m * (np.arange(self.grid.shape[2]) + 0.5)
        furniture = (self.top_m > self.floor_m + self.grid.voxel_m)[..., None]
        within = furniture & (middle < self.top_m[..., None])
        never = (self.state == OCCUPIED) | (unknown & (within | ~free_below))
        lower = furniture | unknown | np.isnan(self.top_m)[..., None]
        return never.ravel(), lower.ravel()

    def _weight_by_voxel(self, above_furniture: float) -> Float[Array, "size"]:
        never, lower = self._weight_levels
        table = self.__dict__.setdefault("_weights", {})
        if above_furniture not in table:
            table.clear()
            weight = np.where(lower, min(above_furniture, 1.0), 1.0)
            weight[never] = 0.0
            table[above_furniture] = weight
        return table[above_furniture]


def _points(points: ArrayLike) -> Float[Array, "n 3"]:
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points have shape {points.shape}; (n, 3) is expected")
    return points
