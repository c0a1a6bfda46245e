"""Background subtraction in range space: samples of a scan in front of the room.

`KnownBackground` compares with scans of the empty room. `LearnedBackground` learns causally, from past scans of the same
scanner.

A beam without a reading for most of the time, while others have one, is taken to look into the open: many drivers write NaN then.

Both keep their knowledge per bearing (`BearingGrid`): scans may have any beams. A beam between two cells is foreground if it
is in front of the background of either, so that edges of objects do not flicker. Bearings never scanned have no background
and no foreground. A scan without beams is ignored.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Sequence
from statistics import median_low

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.laser.bearings import BearingGrid, returns
from trackers.observations import NS_PER_S, LaserScan
from trackers.user_input.text_file import refuse_unless_lifted

logger = logging.getLogger(__name__)

_RENORMALISE_ABOVE = 1e9
_MOST_CELLS = 25_000_000
"""Greatest size of the learned table, bearings times bins; it takes 16 bytes each."""
_SCANS = 9
"""Number of last scans that determine the spacing of beams."""
_FINER, _COARSER = 0.75, 1.5
"""Widths of beams, in cells, between which the cells are kept."""
_LEAST, _SHARE = 20, 0.1
"""Number and share of beams that cannot all begin to meet people in one scan: the scanner has just started."""
_UNKNOWN_SHARE = 0.02
"""Share of a scan's beams without a background from which a warning is given."""


class BackgroundOptions(Strict):
    """Options of the foreground, and of a background learned without empty scans."""

    margin_m: float = Field(
        default=0.12, gt=0, description="how much nearer than the room a sample must be to be foreground [m]"
    )
    spread_factor: float = Field(
        default=4.0, ge=0, description="least margin, in standard deviations of the beam's range in the empty room"
    )
    quantile: float = Field(
        default=0.05,
        ge=0,
        le=1,
        description="quantile of a beam's ranges in the empty scans that is taken for the room",
    )
    bin_m: float = Field(default=0.1, ge=0.01, description="width of a range bin while learning [m]")
    farthest_m: float = Field(
        default=100.0,
        gt=0,
        le=1000,
        description="ranges from here on share one bin while learning: some drivers give a limit of 1e6 m or none [m]",
    )
    memory_s: float = Field(default=60.0, gt=0, description="time constant with which what was learned fades [s]")
    initial_s: float = Field(default=1.0, gt=0, description="how long the first reading of a beam counts as seen [s]")
    static_share: float = Field(
        default=0.5,
        gt=0,
        lt=1,
        description="share of the time a range must be measured, of that in which the beam got so far, to be the room",
    )
    flicker_share: float = Field(
        default=0.3,
        gt=0,
        lt=1,
        description="the same share for a range that flickers: of every stay but the first only `flicker_s` count",
    )
    flicker_s: float = Field(
        default=1.0, gt=0, description="longest stay of a range in a beam that is taken for flicker [s]"
    )
    open_share: float = Field(
        default=0.1,
        gt=0,
        lt=1,
        description="share of the time that something farther must have been measured in a beam for a sample to be foreground",
    )


class KnownBackground:
    """Background from scans without people: a low quantile of the ranges of a bearing and those beside it, and their spread.

    Raises InputError for no scans, or none with a beam.
    """

    def __init__(self, scans: Sequence[LaserScan], options: BackgroundOptions | None = None) -> None:
        options = options or BackgroundOptions()
        scans = [scan for scan in scans if scan.ranges_m.size]
        if not scans:
            raise InputError("background: no scans of the empty room; at least one, with beams, is expected")
        self._grid = BearingGrid.of(scans)
        covered = [self._grid.cover(scan) for scan in scans]
        seen = np.full((len(scans), self._grid.n_row), np.nan)  # NaN for bearings not in a scan
        for of_scan, scan, (row, beam) in zip(seen, scans, covered, strict=True):
            ranges, hit, _ = returns(scan)
            of_scan[row] = np.where(hit, ranges, np.inf)[beam]  # no return counts as far away
        quantile = np.nanquantile if np.isnan(seen).any() else np.quantile
        room = quantile(seen, options.quantile, axis=0, method="lower")
        near = np.where(np.isfinite(seen), seen, np.nan)
        finite = np.isfinite(seen).any(axis=0)
        deviation = np.zeros(room.size)
        centre = np.nanmedian(near[:, finite], axis=0)
        deviation[finite] = 1.4826 * np.nanmedian(np.abs(near[:, finite] - centre), axis=0)
        # a beam on an edge reads anything between what is on either side of it, and few scans do not show all of that
        nearest = np.fmin.reduce([room, *room[self._grid.beside()]])
        beside_edge, self._margin_m, self._warned = room > nearest + options.margin_m, options.margin_m, False
        margin_m = np.maximum(self._margin_m, np.where(beside_edge, 0.0, options.spread_factor * deviation))
        self._threshold_m = np.append(nearest - margin_m, np.nan)  # the last: row −1, of a bearing that is not covered
        self._on_edge = np.append(beside_edge | (margin_m > self._margin_m), False)
        self._rows, self._of_beams = None, (self._threshold_m, self._on_edge)

    def foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Return a mask of the samples in front of the room.

        A beam on an edge of the room meets now what is before it, now what is behind, so that nobody is clearly in front of
        both. Its sample is foreground where it goes on a foreground sample, from beam to beam: no farther from the one beside
        it in range than the margin and the spacing of the beams.
        """
        ranges, hit, _ = returns(scan)
        threshold_m, on_edge = self._room(scan)
        front = hit & (ranges < threshold_m)
        may_be = front | (hit & on_edge)
        if not (n_front := np.count_nonzero(front)) or np.count_nonzero(may_be) == n_front:
            return front
        near = np.where(may_be, ranges, 0.0)  # beams without a return are no candidates
        reach_m = self._margin_m + abs(scan.angle_increment_rad) * np.minimum(near[1:], near[:-1])
        goes_on = may_be[1:] & may_be[:-1] & (np.abs(near[1:] - near[:-1]) <= reach_m)
        run = np.concatenate([[0], (~goes_on).cumsum()])
        in_front = np.bincount(run[front], minlength=run.size) > 0
        return may_be & in_front[run]

    def seen_behind(self, bearing_rad: Float[Array, "n"], range_m: Float[Array, "n"]) -> Bool[Mask, "n"]:
        """Select the places, by bearing and range [m], before the room, or before the open, as the empty scans show it."""
        return range_m < self._threshold_m[self._grid.rows_at(bearing_rad)] + self._margin_m  # NaN where none looked

    def _room(self, scan: LaserScan) -> tuple[Float[Array, "n_beam"], Bool[Mask, "n_beam"]]:
        """Return the threshold of each beam [m], NaN where no empty scan looked, and a mask of the beams on an edge."""
        rows = self._grid.rows(scan)
        if rows is not self._rows:
            threshold_m = np.fmin(*(self._threshold_m[row] for row in rows))
            on_edge = np.logical_or(*(self._on_edge[row] for row in rows))
            self._rows, self._of_beams, unknown = rows, (threshold_m, on_edge), np.isnan(threshold_m)
            if not self._warned and unknown.sum() > _UNKNOWN_SHARE * unknown.size:
                self._warned = True
                logger.warning(
                    f"scan of {scan.sensor!r} at {scan.t:.3f} s: {unknown.sum()} of {unknown.size} beams look where no scan of "
                    "the empty room looked, and show nobody there; scans of the empty room by the same scanner, all around, are "
                    "expected"
                )
        return self._of_beams


class LearnedBackground:
    """Background learned from the scans so far.

    Each bearing stores, per range bin (and one for "no return"), the time of observation, fading over `memory_s`. A nearer
    object hides a bin and does not count; a farther reading counts against it. A bin is background if it fills
    `static_share` of the time in which the beam reached it, or `flicker_share` with short stays other than the first (an
    edge met now and then recurs far more often than people). A sample is foreground if its bin is not background and the
    beam has seen farther for at least `open_share` of its time.

    Consequently the first scan of a beam is taken for background, people included, until they walk on and the beam passes
    them (a tenth of the time they stood there). A person who arrives later and stands still becomes background after about
    0.7 `memory_s`, and is forgotten as slowly.
    """

    def __init__(self, options: BackgroundOptions | None = None) -> None:
        self._options = options or BackgroundOptions()
        self._grid: BearingGrid | None = None
        self._steps_rad: deque[float] = deque(maxlen=_SCANS)
        self._met_something = False
        self._farthest_m = 0.0
        # (n_row, n_bin + 4): observed seconds, times the weight of the scan; see `_column`
        self._seen = np.empty((0, 0))
        self._flickered = np.empty((0, 0))  # like `_seen`, with the first `flicker_s` of every stay except the first
        self._total = np.empty(0)  # (n_row,)
        self._blank = np.empty(0)  # (n_row,) the same without a reading, which is not in the total
        self._stay_column = np.empty(0, np.intp)  # (n_row,) the last column of each bearing
        self._stay_s = np.empty(0)  # (n_row,) and its duration so far
        self._came_back = np.empty(0, np.bool_)  # (n_row,) and whether it had been seen before
        self._weight = 1.0  # grows with time, which avoids fading the whole table at every scan
        self._ns: int | None = None

    def foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Return a mask of the samples in front of the background so far; then learn from the scan."""
        ranges, hit, missed = returns(scan)
        if ranges.size == 0:
            return np.zeros(0, np.bool_)
        grid = self._fitting_grid(scan, hit)
        row, beam = grid.cover(scan)
        self._make_rows(scan, grid.n_row)
        column = self._column(ranges, hit, missed)
        before, after = grid.rows(scan)
        known, foreground = self._in_front(before, column, hit)
        if after is not before:
            known_after, in_front_after = self._in_front(after, column, hit)
            foreground = (foreground | ~known) & (in_front_after | ~known_after) & (known | known_after)
        self._learn(row, column[beam], (hit | missed)[beam], np.isnan(ranges)[beam], scan.stamp_ns)
        return foreground

    def seen_behind(self, bearing_rad: Float[Array, "n"], range_m: Float[Array, "n"]) -> Bool[Mask, "n"]:
        """Select the places, by bearing and range [m], behind which something was measured in `open_share` of the time.

        Before a wall a return is of something that came. Where beams have not returned, it may be of a dark or slanting
        surface at the end of the range, which is met now and then.
        """
        if self._grid is None:
            return np.zeros(bearing_rad.size, np.bool_)
        row, column = self._grid.rows_at(bearing_rad), self._bins(range_m) + 1
        farther = np.arange(self._seen.shape[1] - 2) > column[:, None] + 1
        behind = (self._seen[row, :-2] * farther).sum(axis=1)
        return (row >= 0) & (behind > 0) & (behind >= self._options.open_share * (self._total + self._blank)[row])

    @property
    def has_started(self) -> bool:
        """True after the first learned scan."""
        return self._grid is not None

    def _fitting_grid(self, scan: LaserScan, hit: Bool[Mask, "n_beam"]) -> BearingGrid:
        """Return the grid, a new one if the scanner has just started, or the width of its beams has changed."""
        self._steps_rad.append(abs(scan.angle_increment_rad))
        n_hit = int(hit.sum())
        starts = not self._met_something and n_hit >= max(_LEAST, _SHARE * hit.size)
        self._met_something |= n_hit > 0
        if self._grid is None or starts:
            self._grid = BearingGrid.of([scan])
            self._farthest_m = min(scan.range_max_m, self._options.farthest_m)
            n_bin = int(np.ceil(self._farthest_m / self._options.bin_m)) + 1
            self._keep_rows(np.empty(0, np.intp), n_bin + 4)
        step_rad = median_low(self._steps_rad)
        if not _FINER * self._grid.step_rad < step_rad < _COARSER * self._grid.step_rad:
            self._grid, old_row = self._grid.resized(step_rad)
            self._keep_rows(old_row, self._seen.shape[1])
        return self._grid

    def _keep_rows(self, row: Int[Index, "k"], n_column: int) -> None:
        """Keep these rows of all learned tables; without any, make tables of `n_column` columns."""
        self._seen = self._seen[row] if row.size else np.empty((0, n_column))
        self._flickered = self._flickered[row] if row.size else np.empty((0, n_column))
        self._total, self._blank, self._stay_s = self._total[row], self._blank[row], self._stay_s[row]
        self._stay_column, self._came_back = self._stay_column[row], self._came_back[row]

    def _make_rows(self, scan: LaserScan, n_row: int) -> None:
        """Add empty rows for new bearings."""
        new, n_column = n_row - self._total.size, self._seen.shape[1]
        if new == 0:
            return
        if n_row * (n_column - 4) > _MOST_CELLS:
            refuse_unless_lifted(
                f"scan of {scan.sensor!r}: {n_row} beams of {n_column - 4} range bins are more than the {_MOST_CELLS} cells that "
                "a background is learned in",
                "fewer beams, wider bins (background.bin_m), a nearer background.farthest_m",
            )
        self._seen = np.concatenate([self._seen, np.zeros((new, n_column))])
        self._flickered = np.concatenate([self._flickered, np.zeros((new, n_column))])
        self._total, self._blank = np.pad(self._total, (0, new)), np.pad(self._blank, (0, new))
        self._stay_s = np.pad(self._stay_s, (0, new))
        self._stay_column, self._came_back = np.pad(self._stay_column, (0, new)), np.pad(self._came_back, (0, new))

    def _column(
        self, ranges: Float[Array, "n_beam"], hit: Bool[Mask, "n_beam"], missed: Bool[Mask, "n_beam"]
    ) -> Int[Index, "n_beam"]:
        """Return each beam's column of `_seen`: 1 + bin, so that each bin has neighbours; the last but one: no return."""
        column = np.ones(ranges.size, np.intp)
        column[hit] = self._bins(ranges[hit]) + 1
        column[missed] = self._seen.shape[1] - 2
        return column

    def _bins(self, range_m: Float[Array, "n"]) -> Int[Index, "n"]:
        return (np.minimum(range_m, self._farthest_m) / self._options.bin_m).astype(np.intp)

    def _in_front(
        self, row: Int[Index, "n_beam"], column: Int[Index, "n_beam"], hit: Bool[Mask, "n_beam"]
    ) -> tuple[Bool[Mask, "n_beam"], Bool[Mask, "n_beam"]]:
        """Return masks of rows, one per beam, that have learned anything, and of samples in front of their background."""
        blank_s = self._open_s()
        total_s = self._total + blank_s
        known = (row >= 0) & (total_s[row] > 0)
        beams = np.flatnonzero(hit & known)
        rows, here = row[beams], column[beams]
        near = _around(self._seen, rows, here)
        # a range that fills the share of all time also fills that of the time beyond: no sum is needed
        undecided = near <= self._options.static_share * total_s[rows]
        beams, rows, here, near = beams[undecided], rows[undecided], here[undecided], near[undecided]
        farther = np.arange(self._seen.shape[1]) > here[:, None] + 1
        beyond = (self._seen[rows] * farther).sum(axis=1) + blank_s[rows]
        room = near > self._options.static_share * (near + beyond)
        room |= _around(self._flickered, rows, here) > self._options.flicker_share * (near + beyond)
        is_open = beyond >= self._options.open_share * total_s[rows]
        foreground = np.zeros(hit.size, np.bool_)
        foreground[beams[~room & is_open]] = True
        return known, foreground

    def _open_s(self) -> Float[Array, "n_row"]:
        """Return the time without a reading of beams that have none for most of the time and `initial_s`; 0 for the others."""
        least_s = self._options.initial_s * self._weight
        is_open = self._blank > self._options.static_share * (self._blank + np.maximum(self._total, least_s))
        return np.where(is_open, self._blank, 0.0)

    def _learn(
        self,
        row: Int[Index, "k"],
        column: Int[Index, "k"],
        informed: Bool[Mask, "k"],
        blank: Bool[Mask, "k"],
        ns: int,
    ) -> None:
        """Learn at a stamp [ns] the present columns of these rows, as far as informed, and which have no reading."""
        initial_s = self._options.initial_s
        elapsed = initial_s if self._ns is None else (ns - self._ns) / NS_PER_S  # independent of the clock's epoch
        if elapsed <= 0:
            return
        # a gap is not observed time
        elapsed = min(elapsed, initial_s)
        self._ns = ns
        self._weight *= np.exp(elapsed / self._options.memory_s)
        if not blank.all():  # else no reading at all
            self._blank[row[blank]] += self._weight * elapsed
        rows, here = row[informed], column[informed]
        new = self._total[rows] == 0
        seconds = self._weight * np.where(new, initial_s, elapsed)
        stays = np.abs(here - self._stay_column[rows]) <= 1
        self._came_back[rows] = np.where(stays, self._came_back[rows], _around(self._seen, rows, here) > 0)
        self._seen[rows, here] += seconds
        self._stay_s[rows] = np.where(stays, self._stay_s[rows] + elapsed, 0.0)
        self._stay_column[rows] = here
        short = self._came_back[rows] & (self._stay_s[rows] < self._options.flicker_s)
        self._flickered[rows[short], here[short]] += seconds[short]
        self._total[rows] += seconds
        if self._weight > _RENORMALISE_ABOVE:
            for table in (self._seen, self._flickered, self._total, self._blank):
                table /= self._weight
            self._weight = 1.0


def _around(table: Float[Array, "n_row columns"], row: Int[Index, "k"], column: Int[Index, "k"]) -> Float[Array, "k"]:
    """Return the sum of the table's entries at a column and its two neighbours, for each row."""
    return table[row, column - 1] + table[row, column] + table[row, column + 1]
