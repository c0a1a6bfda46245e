"""Bearings: knowledge about a scanner's surroundings is stored per bearing, whatever beams a scan has.

Many scanners (LD19, YDLidar, RPLidar) change the number of their beams by a few from scan to scan and start each elsewhere;
others turn clockwise, or all around with the seam anywhere. The detection probability of a scan follows from its bearings: no
person stands where the beams continue behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import pi

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.observations import LaserScan
from trackers.rig import LaserSensor

_FINEST_RAD = 1e-6
"""Least width of a cell: 1 mm at 1 km. Finer beams share cells."""
_ON_CELL = 0.05
"""Distance from the middle of a cell, in cells, within which a beam is on it, allowing for rounding and jitter of a mirror.
"""
_HALF = 0.5 - 1e-6
"""Half a cell, so that rounding does not decide to which cell a beam between two belongs."""


@lru_cache(maxsize=4)
def returns(scan: LaserScan) -> tuple[Float[Array, "n_beam"], Bool[Mask, "n_beam"], Bool[Mask, "n_beam"]]:
    """Return ranges [m], a mask of returns, and a mask of beams without return; read-only, kept for the last few scans.

    Samples follow ROS REP 117. A finite range within the scanner's limits is a return; +inf, or a range beyond the limit, is a
    beam without return; NaN and −inf are no reading. A finite range below the limit counts as no return: many drivers write 0
    or a small error code then.
    """
    ranges = scan.ranges_m.astype(float)
    hit = (ranges >= scan.range_min_m) & (ranges <= scan.range_max_m) & (ranges < np.inf)  # NaN is neither
    ranges.flags.writeable = hit.flags.writeable = False  # what is kept is shared
    return ranges, hit, (ranges > -np.inf) & ~hit


def counter_clockwise(scan: LaserScan) -> LaserScan:
    """Return the scan with its beams in counter-clockwise order, reversed if necessary; a reversed sweep is negative."""
    if scan.angle_increment_rad > 0:
        return scan
    last_rad = scan.angle_min_rad + max(scan.ranges_m.size - 1, 0) * scan.angle_increment_rad
    return replace(
        scan,
        ranges_m=scan.ranges_m[::-1],
        angle_min_rad=last_rad,
        angle_increment_rad=-scan.angle_increment_rad,
        sweep_time_s=-scan.sweep_time_s,
    )


def seen_from_above(scan: LaserScan, *, is_upside_down: bool) -> LaserScan:
    """Return the scan in counter-clockwise order as seen from above, by a scanner with the same x axis that stands upright."""
    if is_upside_down:
        scan = replace(scan, angle_min_rad=-scan.angle_min_rad, angle_increment_rad=-scan.angle_increment_rad)
    return counter_clockwise(scan)


def beams_of_turn(scan: LaserScan) -> int | None:
    """Return the number of beams of a full turn, after which the first follows the last; None for less than a turn.

    At most one beam may be missing at the seam. Beams beyond a turn repeat the first bearings.
    """
    count, step = scan.ranges_m.size, abs(scan.angle_increment_rad)
    if count < 3 or (count + 1.5) * step < 2 * pi:
        return None
    return min(count, round(2 * pi / step))


class BearingGrid:
    """Cells of equal width around the circle, and one row of a background's table per covered cell.

    origin_rad: the bearing of the middle of the first cell. Rows are numbered in order of coverage.
    """

    def __init__(self, origin_rad: float, step_rad: float) -> None:
        self.step_rad = max(step_rad, _FINEST_RAD)
        self._origin_rad = origin_rad
        self._n_cell = max(round(2 * pi / self.step_rad), 1)
        self._row = np.full(self._n_cell, -1, np.intp)
        self.n_row = 0
        self._beams: tuple[float, float, int] | None = None
        self._looked_up = np.empty(0, np.intp), np.empty(0, np.intp)

    def rows(self, scan: LaserScan) -> tuple[Int[Index, "n_beam"], Int[Index, "n_beam"]]:
        """Return the rows of the cells on either side of each beam, −1 if not covered; equal for a beam on a cell.

        If every beam is on a cell, both are the same array.
        """
        beams = (scan.angle_min_rad, scan.angle_increment_rad, scan.ranges_m.size)
        if beams != self._beams:
            place = self._place(scan.angles_rad)
            nearest = np.rint(place)
            on_cell = np.abs(place - nearest) <= _ON_CELL
            before = np.where(on_cell, nearest, np.floor(place))
            after = np.where(on_cell, nearest, before + 1)
            lower = self._row[before.astype(np.intp) % self._n_cell]
            upper = lower if on_cell.all() else self._row[after.astype(np.intp) % self._n_cell]
            self._beams, self._looked_up = beams, (lower, upper)
        return self._looked_up

    def cover(self, scan: LaserScan) -> tuple[Int[Index, "k"], Int[Index, "k"]]:
        """Return the rows of the cells in the scan, and the beam nearest to each; new cells get new rows."""
        count, spacing = scan.ranges_m.size, abs(scan.angle_increment_rad)
        if count == 0:
            return np.empty(0, np.intp), np.empty(0, np.intp)
        first_rad, span_rad = counter_clockwise(scan).angle_min_rad, (count - 1) * spacing
        reach_rad = _HALF * max(spacing, self.step_rad)
        start = float(self._place(np.array([first_rad]))[0])
        lowest = int(np.ceil(start - reach_rad / self.step_rad))
        highest = int(np.floor(start + (span_rad + reach_rad) / self.step_rad))
        cell = np.arange(lowest, min(highest, lowest + self._n_cell - 1) + 1)
        # a turn is no whole number of cells
        rest_rad = 2 * pi - self._n_cell * self.step_rad
        off_rad = (cell - start) * self.step_rad + cell // self._n_cell * rest_rad
        looked_at = (off_rad >= -reach_rad) & (off_rad <= span_rad + reach_rad)
        cell, off_rad = cell[looked_at] % self._n_cell, off_rad[looked_at]
        beam = np.minimum(np.maximum(np.rint(off_rad / spacing), 0), count - 1).astype(np.intp)
        new = cell[self._row[cell] < 0]
        if new.size:
            self._row[new] = self.n_row + np.arange(new.size)
            self.n_row += new.size
            self._beams = None
        return self._row[cell], beam if scan.angle_increment_rad > 0 else count - 1 - beam

    def rows_at(self, bearing_rad: Float[Array, "n"]) -> Int[Index, "n"]:
        """Return the rows of the cells at bearings, −1 where they are not covered."""
        return self._row[np.rint(self._place(bearing_rad)).astype(np.intp) % self._n_cell]

    def beside(self) -> Int[Index, "2 n_row"]:
        """Return the rows of the cells before and after that of each row; its own where they are not covered."""
        cell = np.flatnonzero(self._row >= 0)
        row, found = self._row[cell], np.empty((2, self.n_row), np.intp)
        for of_side, step in zip(found, (-1, 1), strict=True):
            of_side[row] = self._row[(cell + step) % self._n_cell]
        return np.where(found < 0, np.arange(self.n_row), found)

    @classmethod
    def of(cls, scans: Sequence[LaserScan]) -> BearingGrid:
        """Make a grid from the beams of the first scan, with the median spacing of all."""
        first = counter_clockwise(scans[0])
        steps_rad = sorted(abs(scan.angle_increment_rad) for scan in scans)
        return cls(first.angle_min_rad, steps_rad[(len(steps_rad) - 1) // 2])

    def resized(self, step_rad: float) -> tuple[BearingGrid, Int[Index, "n_row"]]:
        """Return the same bearings in cells of another width, and for each new row the old one it continues."""
        grid = BearingGrid(self._origin_rad, step_rad)
        place = np.arange(grid._n_cell) * (grid.step_rad / self.step_rad)
        row = self._row[np.rint(place).astype(np.intp) % self._n_cell]
        known = row >= 0
        grid.n_row = int(known.sum())
        grid._row = np.where(known, np.cumsum(known) - 1, -1)
        return grid, row[known]

    def _place(self, bearing_rad: Float[Array, "n"]) -> Float[Array, "n"]:
        """Return bearings in cells after the origin, from −1/2 on."""
        half_rad = 0.5 * self.step_rad
        return ((bearing_rad - self._origin_rad + half_rad) % (2 * pi) - half_rad) / self.step_rad


@lru_cache(maxsize=8)
def _reaches(scan: LaserScan) -> Float[Array, "n_padded"]:
    """Return how far each beam reaches [m], and those next to either end; read-only, kept for the last few scans."""
    reach_m = np.zeros(scan.ranges_m.size + 2)  # beside the scan nothing is detected
    np.copyto(reach_m[1:-1], np.minimum(scan.ranges_m, scan.range_max_m), where=~np.isnan(scan.ranges_m))
    if beams_of_turn(scan) is not None:
        reach_m[0], reach_m[-1] = reach_m[-2], reach_m[1]
    reach_m.flags.writeable = False
    return reach_m


ACROSS = np.array([-1.0, 0.0, 1.0])
"""Positions across a body, in half its width, at which beams are tested."""


class DetectionOptions(Strict):
    """Options of a body's extent in the beams of one layer, and of its detection (ours)."""

    detected: float = Field(
        default=0.95,
        ge=0,
        lt=1,
        description="detection probability of a body that nothing occludes; 0: no negative evidence (ours)",
    )
    width_m: float | None = Field(
        default=None,
        gt=0,
        description="width on which as many beams must fall as a cluster has samples, or a body is not detected [m]; null: far "
        "away it is detected as surely as near by (ours)",
    )
    half_width_m: float = Field(default=0.12, gt=0, description="half the width of a body across the beams [m] (ours)")
    behind_m: float = Field(
        default=0.1, description="how far behind a body's axis a beam must go on to have passed it [m] (ours)"
    )
    hidden_up_to: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of a body's width in clear beams up to which it may still be occluded (ours)",
    )


class DetectionModel:
    """Detection probability of bodies at empty places by a scanner's scans.

    least: the samples of the smallest cluster. A width w is met by w / s beams of spacing s or one more, at least k with the
    probability w / s − k + 1, clipped. A beam without a return (+inf) passed to the end of the range; one without a reading
    (NaN) gives no information.
    """

    def __init__(self, sensor: LaserSensor, options: DetectionOptions, least: int = 1) -> None:
        self.options, self._least = options, least
        self._origin_m = sensor.room_from_sensor.translation[:2].copy()
        self._scan_from_room = sensor.room_from_sensor.rotation[:2, :2].T.copy()
        self._middle_rad, self._ahead_from_room = np.nan, [[0.0, 0.0], [0.0, 0.0]]  # of the last scan's middle beam

    def seen(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that a body with its axis at room points would have been detected."""
        options, count, reach_m = self.options, scan.ranges_m.size, _reaches(scan)
        # bearings relative to the middle beam wrap around behind it
        middle = scan.angle_min_rad + 0.5 * (count - 1) * scan.angle_increment_rad
        if middle != self._middle_rad:
            cos, sin = np.cos(middle), np.sin(middle)
            ahead_from_room = np.array([[cos, sin], [-sin, cos]]) @ self._scan_from_room
            self._middle_rad, self._ahead_from_room = middle, ahead_from_room.tolist()
        (a, b), (c, d) = self._ahead_from_room
        off_x, off_y = points[0] - self._origin_m[0], points[1] - self._origin_m[1]
        x, y = a * off_x + b * off_y, c * off_x + d * off_y
        distance = np.sqrt(x * x + y * y)
        half = options.half_width_m / np.maximum(distance, options.half_width_m)
        bearing = np.arctan2(y, x) + ACROSS.reshape(-1, *[1] * x.ndim) * half
        if bearing.min(initial=0.0) < -np.pi or bearing.max(initial=0.0) > np.pi:
            bearing -= 2 * np.pi * np.rint(bearing / (2 * np.pi))
        beam = np.rint(bearing / scan.angle_increment_rad + (0.5 * (count - 1) + 1)).astype(np.intp)
        clear = (reach_m.take(beam, mode="clip") > distance + options.behind_m).sum(axis=0) / ACROSS.size
        seen = options.detected * np.maximum(clear - options.hidden_up_to, 0) / (1 - options.hidden_up_to)
        if options.width_m is None:
            return seen
        apart_m = np.maximum(distance * abs(scan.angle_increment_rad), 1e-9)
        return seen * np.minimum(np.maximum(options.width_m / apart_m - (self._least - 1), 0), 1)
