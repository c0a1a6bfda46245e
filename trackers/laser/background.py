"""Background subtraction in range space: which samples of a scan stand in front of the room.

`KnownBackground` compares with scans of the empty room. `LearnedBackground` has none and learns causally, from the past of
the same scanner only.

Samples follow ROS REP 117. A finite range within the scanner's limits is a return; +inf, or a range beyond the limit, is a
beam that met nothing; NaN and −inf are no reading at all and teach nothing. A finite range below the limit is counted as
met nothing: many drivers write 0 or a small error code where no light came back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field

from trackers.arrays import Array, Index, Mask
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import LaserScan

_RENORMALISE_ABOVE = 1e9
_MOST_CELLS = 25_000_000
"""Of the table of what was learned, beams times bins; it takes 16 bytes each."""


class BackgroundOptions(Strict):
    """How far in front of the room a sample must lie, and how the room is learned where no empty scans are given."""

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


def returns(scan: LaserScan) -> tuple[Float[Array, "n_beam"], Bool[Mask, "n_beam"], Bool[Mask, "n_beam"]]:
    """Ranges [m], which of them are returns, and which beams met nothing."""
    ranges = scan.ranges_m.astype(float)
    hit = (ranges >= scan.range_min_m) & (ranges <= scan.range_max_m) & (ranges < np.inf)  # NaN is none of these
    return ranges, hit, (ranges > -np.inf) & ~hit


class KnownBackground:
    """The room as scans without people show it: per beam a low quantile of the ranges, and their spread.

    Raises InputError for no scans, or scans of different beams.
    """

    def __init__(self, scans: Sequence[LaserScan], options: BackgroundOptions | None = None) -> None:
        options = options or BackgroundOptions()
        if not scans:
            raise InputError("background: no scans of the empty room; at least one is expected")
        self._first = scans[0]
        for scan in scans:
            _check_same_beams(scan, self._first)
        ranges, hit, _ = zip(*(returns(scan) for scan in scans), strict=True)
        seen = np.where(np.array(hit), np.array(ranges), np.inf)  # (n_scan, n_beam); nothing met counts as far away
        room = np.quantile(seen, options.quantile, axis=0, method="lower")
        near = np.where(np.isfinite(seen), seen, np.nan)
        finite = np.isfinite(seen).any(axis=0)
        deviation = np.zeros(room.size)
        centre = np.nanmedian(near[:, finite], axis=0)
        deviation[finite] = 1.4826 * np.nanmedian(np.abs(near[:, finite] - centre), axis=0)
        self.range_m = room
        self.threshold_m = room - np.maximum(options.margin_m, options.spread_factor * deviation)

    def foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Which samples stand in front of the room."""
        _check_same_beams(scan, self._first)
        ranges, hit, _ = returns(scan)
        return hit & (ranges < self.threshold_m)


class LearnedBackground:
    """The room learned from the scans so far: no scan ahead of the present one is used.

    Each beam keeps, per range bin (one more for "met nothing"), how long it has seen something there, fading over
    `memory_s`. A nearer object hides a bin and counts neither for nor against it; a farther reading counts against it.
    A bin is the room if it fills `static_share` of the time in which the beam came that far; or if it fills `flicker_share`
    with short stays, the first of which is none yet (an edge that the beam meets now and then comes back, and far more
    often than people do). A sample is foreground if its bin is not the room and if the beam has seen farther for at least
    `open_share` of its time.

    Hence: what the first scan of a beam shows is taken for the room, people included, until they walk on and the beam sees
    past them (a tenth of the time they stood there makes their place open again). A person who comes later and stands
    still is taken for furniture after about 0.7 `memory_s`, and forgotten again as slowly.
    """

    def __init__(self, options: BackgroundOptions | None = None) -> None:
        self._options = options or BackgroundOptions()
        self._first: LaserScan | None = None
        self._farthest_m = 0.0
        self._seen = np.empty((0, 0))  # (n_beam, n_bin + 4): seconds seen, times the weight of the scan; see `_column`
        self._flickered = np.empty((0, 0))  # like `_seen`, with the first `flicker_s` of every stay but the first only
        self._total = np.empty(0)  # (n_beam,)
        self._stay_column = np.empty(0, np.intp)  # (n_beam,) what each beam saw last
        self._stay_s = np.empty(0)  # (n_beam,) and for how long by now
        self._came_back = np.empty(0, np.bool_)  # (n_beam,) and whether it had been there before
        self._weight = 1.0  # grows with time, so that nothing has to be faded at every scan
        self._t = -np.inf

    def foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Which samples stand in front of the room as known so far; the scan is then learned from."""
        ranges, hit, missed = returns(scan)
        if self._first is None:
            self._first = scan
            self._farthest_m = min(scan.range_max_m, self._options.farthest_m)
            n_bin = int(np.ceil(self._farthest_m / self._options.bin_m)) + 1
            _check_size(scan, n_bin)
            self._seen = np.zeros((ranges.size, n_bin + 4))
            self._flickered = np.zeros_like(self._seen)
            self._total = np.zeros(ranges.size)
            self._stay_column = np.zeros(ranges.size, np.intp)
            self._stay_s = np.zeros(ranges.size)
            self._came_back = np.zeros(ranges.size, np.bool_)
        _check_same_beams(scan, self._first)
        column = self._column(ranges, hit, missed)
        foreground = self._in_front(column, hit)
        self._learn(column, hit | missed, scan.t)
        return foreground

    def _column(
        self, ranges: Float[Array, "n_beam"], hit: Bool[Mask, "n_beam"], missed: Bool[Mask, "n_beam"]
    ) -> Int[Index, "n_beam"]:
        """Column of `_seen` for each beam: 1 + bin, so that each bin has neighbours; the last but one for nothing met."""
        column = np.ones(ranges.size, np.intp)
        column[hit] = (np.minimum(ranges[hit], self._farthest_m) / self._options.bin_m).astype(np.intp) + 1
        column[missed] = self._seen.shape[1] - 2
        return column

    def _in_front(self, column: Int[Index, "n_beam"], hit: Bool[Mask, "n_beam"]) -> Bool[Mask, "n_beam"]:
        beams = np.flatnonzero(hit & (self._total > 0))
        here = column[beams]
        near = _around(self._seen, beams, here)
        # where this range fills the share of all time, it fills that of the time beyond: no need to sum
        undecided = near <= self._options.static_share * self._total[beams]
        beams, here, near = beams[undecided], here[undecided], near[undecided]
        farther = np.arange(self._seen.shape[1]) > here[:, None] + 1
        beyond = (self._seen[beams] * farther).sum(axis=1)
        room = near > self._options.static_share * (near + beyond)
        room |= _around(self._flickered, beams, here) > self._options.flicker_share * (near + beyond)
        open_beam = beyond >= self._options.open_share * self._total[beams]
        foreground = np.zeros(hit.size, np.bool_)
        foreground[beams[~room & open_beam]] = True
        return foreground

    def _learn(self, column: Int[Index, "n_beam"], informed: Bool[Mask, "n_beam"], t: float) -> None:
        elapsed = t - self._t
        if elapsed <= 0:
            return
        # a gap is not time in which anything was seen
        elapsed = min(elapsed, self._options.initial_s)
        self._t = t
        self._weight *= np.exp(elapsed / self._options.memory_s)
        beams = np.flatnonzero(informed)
        new = self._total[beams] == 0
        seconds = self._weight * np.where(new, self._options.initial_s, elapsed)
        here = column[beams]
        stays = np.abs(here - self._stay_column[beams]) <= 1
        self._came_back[beams] = np.where(stays, self._came_back[beams], _around(self._seen, beams, here) > 0)
        self._seen[beams, here] += seconds
        self._stay_s[beams] = np.where(stays, self._stay_s[beams] + elapsed, 0.0)
        self._stay_column[beams] = here
        short = self._came_back[beams] & (self._stay_s[beams] < self._options.flicker_s)
        self._flickered[beams[short], here[short]] += seconds[short]
        self._total[beams] += seconds
        if self._weight > _RENORMALISE_ABOVE:
            self._seen /= self._weight
            self._flickered /= self._weight
            self._total /= self._weight
            self._weight = 1.0


def _around(
    table: Float[Array, "n_beam columns"], beams: Int[Index, "k"], column: Int[Index, "k"]
) -> Float[Array, "k"]:
    """The table's entries at a column and its two neighbours, summed, for each of `beams`."""
    return table[beams, column - 1] + table[beams, column] + table[beams, column + 1]


def _check_size(scan: LaserScan, n_bin: int) -> None:
    if scan.ranges_m.size * n_bin > _MOST_CELLS:
        raise InputError(
            f"scan of {scan.sensor!r}: {scan.ranges_m.size} beams of {n_bin} range bins are more than the "
            f"{_MOST_CELLS} cells a background is learned in; fewer beams, wider bins (background.bin_m) or a nearer "
            "background.farthest_m are expected"
        )


def _check_same_beams(scan: LaserScan, first: LaserScan) -> None:
    if scan.ranges_m.size != first.ranges_m.size:
        raise InputError(
            f"scan of {scan.sensor!r} at {scan.t:.3f} s has {scan.ranges_m.size} beams; "
            f"its background has {first.ranges_m.size}, and as many are expected"
        )
    if (
        abs(scan.angle_min_rad - first.angle_min_rad) > 1e-3
        or abs(scan.angle_increment_rad - first.angle_increment_rad) * first.ranges_m.size > 1e-2
    ):
        raise InputError(
            f"scan of {scan.sensor!r} at {scan.t:.3f} s starts at {scan.angle_min_rad:.4f} rad in steps of "
            f"{scan.angle_increment_rad:.6f} rad; its background at {first.angle_min_rad:.4f} rad in steps of "
            f"{first.angle_increment_rad:.6f} rad, and the same beams are expected"
        )
