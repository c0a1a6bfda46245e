"""The frame of one scanner, standing or driving: a pose for each scan, beams at their own time, and a memory of places.

The memory is a map kept as scans: whether earlier scans saw a place free, or something standing there, and when. An occupancy
grid stores for each cell how often beams passed and how often they ended there. The same is kept here as the scans
themselves, each with its pose, and computed only for the places asked for: some dozens per scan, in place of tens of
thousands of cells. Bearings are half a degree wide, which is a leg's width at 10 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackers.arrays import AnyArray, Array, Bool, Float, Mask, Shaped
from trackers.frames.scan_matching import (
    HERE,
    Match,
    MatchingOptions,
    ScanMatcher,
    between,
    compose,
    inverse,
    placed,
    turned,
)
from trackers.laser.bearings import returns
from trackers.laser.clusters import directions
from trackers.observations import LaserScan

_BINS = 720
_HALF = 0.5 + 1e-6
"""Half a beam, and a little: a bin in the middle of two beams sees both, however they are rounded."""
_RECENT, _RECENT_S = 24, 0.25
_OLD, _OLD_S = 36, 2.0
_PASSED_M = 0.25
"""A beam that goes on by so much behind a place passed it [m]."""
_DARK = 1 / 3
"""Share of a scanner's range from which surfaces of a tenth of the reflectance have an echo, by the lidar equation: power falls
with the square of the range. A beam without an echo passed what is nearer; what is farther may have been there all the time."""
_STILL_M = 0.18
"""One that ends so near to a place met what stands there [m]."""


class SightCounts(NamedTuple):
    """Of each of n places, how many looks saw it free, and how many something there."""

    free: Float[Array, "n"]
    hit: Float[Array, "n"]


class ScanMemory:
    """The scans of the last seconds, and fewer of the last minute; oldest ones are written over."""

    def __init__(self) -> None:
        n = _RECENT + _OLD
        self._t = np.full(n, np.inf)
        self._view = np.zeros((n, 3))  # the fixed frame as the scanner saw it
        self._range = np.full((n, _BINS), np.nan)
        self._dark_m = np.zeros(n)
        self._n_recent = self._n_old = 0
        self._last_s = [-np.inf, -np.inf]

    def add(
        self, t: float, pose: Float[Array, "3"], bearings: Float[Array, "n"], reach: Float[Array, "n"],
        dark_m: float,
    ) -> None:  # fmt: skip
        """Keep a scan from a pose at time t [s], if the last one kept is old enough.

        reach: how far each beam came [m]; infinite where it had no echo, NaN where it says nothing. dark_m: range up to which
        dark surfaces have one.
        """
        if t - self._last_s[0] < _RECENT_S:
            return
        self._last_s[0] = t
        if t - self._last_s[1] >= _OLD_S:
            self._last_s[1] = t
            self._put(_RECENT + self._n_old % _OLD, t, pose, bearings, reach, dark_m)
            self._n_old += 1
        else:
            self._put(self._n_recent % _RECENT, t, pose, bearings, reach, dark_m)
            self._n_recent += 1

    def looks(self, places: Float[Array, "n 2"], before_s: Float[Array, "n"]) -> SightCounts:
        """Count the looks before these times [s] that saw each place [m] free, and those that saw something there."""
        kept = self._t < before_s.max(initial=-np.inf)
        if not kept.any():
            return SightCounts(np.zeros(len(places)), np.zeros(len(places)))
        seen_at = placed(self._view[kept][:, None], places[None])  # (k, n, 2)
        away = np.hypot(seen_at[..., 0], seen_at[..., 1])
        bin_ = np.rint(np.arctan2(seen_at[..., 1], seen_at[..., 0]) * (_BINS / (2 * np.pi))).astype(np.intp)
        ranges, rows = self._range[kept], np.arange(kept.sum())[:, None]
        beams = np.stack([ranges[rows, (bin_ + shift) % _BINS] for shift in (-1, 0, 1)])
        beams[np.isinf(beams) & (away > self._dark_m[kept, None])] = np.nan
        with np.errstate(invalid="ignore"):
            gap = beams - away
            free = (gap > _PASSED_M).sum(axis=0) >= 2
            hit = (np.abs(gap) < _STILL_M).any(axis=0)
        earlier = self._t[kept][:, None] < before_s
        return SightCounts((free & ~hit & earlier).sum(axis=0).astype(float), (hit & earlier).sum(axis=0).astype(float))

    def _put(self, row: int, t: float, pose: Array, bearings: Array, reach: Array, dark_m: float) -> None:
        self._t[row], self._view[row], self._dark_m[row] = t, inverse(pose), dark_m
        if bearings.size > 1:
            # each bin takes the beam nearest to its middle, the shorter of two; bins beyond the beams say nothing
            middle = np.arange(_BINS) * (2 * np.pi / _BINS)
            step = (bearings[-1] - bearings[0]) / (bearings.size - 1)
            beam = ((middle - bearings[0] + 0.5 * step) % (2 * np.pi) - 0.5 * step) / step
            near = np.stack([np.ceil(beam - _HALF), np.floor(beam + _HALF)]).astype(np.intp)
            inside = (near >= 0) & (near < bearings.size)
            self._range[row] = np.fmin.reduce(np.where(inside, reach[np.clip(near, 0, bearings.size - 1)], np.nan))


_STANDS_M, _STANDS_RAD = 0.05, 0.03
"""A scanner that was never matched farther from its start than this stands there."""
_WHEELS_STAND = 2e-3
"""Odometry that moves by no more from scan to scan is that of wheels that stand [m, rad]."""
_LONG_AGO_S = 1e6
_SURE = 10.0
"""Scans of the empty room are looks before everything else, and each counts for so many."""
_SAME_M = 0.02
_OWN_PART_M = 1.0
_DRIVEN_M, _TURNED_RAD = 1.0, 1.0
"""A range that stays the same while the scanner drives and turns by so much in all is a part of the robot."""


class SensorFrame:
    """Poses of a scanner in a fixed frame that begins where the rig says the scanner is; scans in order of time.

    Scans are as `trackers.laser.bearings.seen_from_above` returns them.
    """

    def __init__(
        self, start: Float[Array, "3"], options: MatchingOptions, empty_scans: Sequence[LaserScan] = ()
    ) -> None:
        self._start, self._options = np.array(start, float), options
        self._matcher = ScanMatcher(start, options)
        self._memory, self._empty = ScanMemory(), ScanMemory()
        self._own_range, self._driven = np.empty(0), np.empty((0, 2))
        self._odometry: Array | None = None  # at the last scan
        self._has_had_odometry = False
        self.rig_from_fixed = HERE
        """The fixed frame in that of the rig, which drifts and jumps with odometry."""
        self.pose = self._start
        self.has_moved = False
        self.n_scan = self.n_untrusted = 0
        self._match = Match(self._start, np.zeros(3), 1.0)
        for scan in empty_scans:
            self._remember(self._empty, scan.t - _LONG_AGO_S, scan)

    def locate(
        self,
        scan: LaserScan,
        still: Bool[Mask, "n_beam"],
        odometry: Float[Array, "3"] | None,
        sweeping: Float[Array, "3"] | None = None,
        *,
        follows: bool = True,
    ) -> None:
        """Find the pose of a scan by matching it. still: beams that may have met the room.

        odometry: the scanner's pose in the rig's frame by odometry at the stamp, None without any; sweeping: its motion (3,) a
        second during the sweep, likewise; follows: odometry goes on from that of the scan before, without a jump.
        """
        ranges, hit, _ = returns(scan)
        beams = (hit & ~self.own_parts(scan)).nonzero()[0]
        points = (ranges[beams] * directions(scan)[:, beams]).T
        moved = None
        if odometry is not None and self._odometry is not None and follows:
            moved = between(self._odometry, odometry)
        self._odometry = odometry
        self._has_had_odometry |= odometry is not None
        before = self.pose
        match = self._matcher.match(scan.t, points, self._times_s(scan, beams), still[beams], moved, sweeping)
        self.n_scan += 1
        if match.trust < self._options.least_trust:
            self.n_untrusted += 1
            if moved is None:
                self._memory = ScanMemory()
        off = between(self._start, match.pose)
        self.has_moved |= bool(np.hypot(*off[:2]) > _STANDS_M or abs(off[2]) > _STANDS_RAD)
        self.has_moved |= moved is not None and bool(np.abs(moved).max() > _WHEELS_STAND)
        self._match = match if self.has_moved else Match(self._start, np.zeros(3), match.trust)
        self.pose = self._match.pose
        if odometry is not None:
            self.rig_from_fixed = compose(odometry, inverse(self.pose))
        elif self.has_moved and not self._has_had_odometry:  # in a gap of odometry its frame stays where it was
            self.rig_from_fixed = compose(self._start, inverse(self.pose))
        self._watch_own_parts(ranges, hit, between(before, self.pose))
        self._remember(self._memory, scan.t, scan)

    def follow(self, scan: LaserScan, leader: SensorFrame, odometry: Float[Array, "3"]) -> None:
        """Take the pose of a scan from that of another scanner on the same base."""
        pose = compose(inverse(leader.rig_from_fixed), odometry)
        self.n_scan += 1
        self.rig_from_fixed, self.has_moved = leader.rig_from_fixed, leader.has_moved
        before, self.pose = self.pose, pose
        self._match = Match(pose, leader._match.motion, leader._match.trust)
        ranges, hit, _ = returns(scan)
        self._watch_own_parts(ranges, hit, between(before, pose))
        self._remember(self._memory, scan.t, scan)

    @property
    def driving(self) -> float:
        """Speed [m/s] and turn rate [rad/s] of the scanner together."""
        x, y, turn = self._match.motion
        return float(np.hypot(x, y) + abs(turn))

    def placed(self, scan: LaserScan, points: Float[Array, "k 2"], beam: Float[Array, "k"]) -> Float[Array, "k 2"]:
        """Return points of the scan, taken at these beams, in the fixed frame [m]."""
        at = self._times_s(scan, beam)[:, None] * self._match.motion
        return placed(self.pose, placed(at, points))

    def seen_from(self, points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Return points of the fixed frame in the scanner's [m]."""
        return placed(inverse(self.pose), points)

    def looks(self, places: Float[Array, "n 2"], before_s: Float[Array, "n"]) -> SightCounts:
        """Count the looks before these times [s] that saw places [m] free, and something there."""
        seen, known = self._memory.looks(places, before_s), self._empty.looks(places, before_s)
        return SightCounts(seen.free + _SURE * known.free, seen.hit + _SURE * known.hit)

    def own_parts(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Select the beams that meet a part of the robot."""
        if len(self._driven) != scan.ranges_m.size:
            return np.zeros(scan.ranges_m.size, np.bool_)
        return (self._driven[:, 0] >= _DRIVEN_M) & (self._driven[:, 1] >= _TURNED_RAD)

    def to_rig(
        self, places: Float[Array, "n 2"], velocities: Float[Array, "n 2"]
    ) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
        """Return places and velocities over the ground in the frame that the rig is given in."""
        if not self.rig_from_fixed.any():
            return places, velocities
        return placed(self.rig_from_fixed, places), turned(self.rig_from_fixed[2], velocities)

    def to_sensor(
        self, places: Float[Array, "n 2"], velocities: Float[Array, "n 2"], after_s: float
    ) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
        """Return places and velocities over the ground in the scanner's frame as of some time after its last scan's stamp."""
        here = inverse(compose(self.pose, after_s * self._match.motion))
        return placed(here, places), turned(here[2], velocities)

    def _times_s(self, scan: LaserScan, beam: Shaped[AnyArray, "k"]) -> Float[Array, "k"]:
        """Return the time of beams, or of places between two, after the stamp [s]."""
        first_s = max(-scan.sweep_time_s, 0.0)
        return first_s + scan.sweep_time_s * beam / max(scan.ranges_m.size - 1, 1)

    def _remember(self, memory: ScanMemory, t: float, scan: LaserScan) -> None:
        ranges, hit, missed = returns(scan)
        reach = np.where(
            hit & ~self.own_parts(scan), ranges, np.where(missed & (ranges >= scan.range_min_m), np.inf, np.nan)
        )
        memory.add(t, self.pose, scan.angles_rad, reach, _DARK * scan.range_max_m)

    def _watch_own_parts(self, ranges: Array, hit: Mask, step: Array) -> None:
        """Add the way driven to the beams whose range stays the same; the others begin again."""
        if self._own_range.size != ranges.size:
            self._own_range, self._driven = np.full(ranges.size, np.nan), np.zeros((ranges.size, 2))
        with np.errstate(invalid="ignore"):
            same = hit & (np.abs(ranges - self._own_range) < _SAME_M) & (ranges < _OWN_PART_M)
        self._driven = np.where(same[:, None], self._driven + np.array([np.hypot(*step[:2]), abs(step[2])]), 0.0)
        self._own_range = np.where(same, self._own_range, np.where(hit, ranges, np.nan))
