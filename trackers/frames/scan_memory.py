"""A map kept as scans: whether earlier looks saw a place free, or something standing there, and when.

An occupancy grid stores for each cell how often beams passed and how often they ended there. The same is kept here as the scans
themselves, each with its pose, and worked out only for the places that are asked for: some dozens a scan, in place of tens of
thousands of cells. Bearings are half a degree wide, which is a leg's width at 10 m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.frames.planar import inverse, placed

_BINS = 720
_HALF = 0.5 + 1e-6
"""Half a beam, and a little: a bin in the middle of two beams sees both, however they are rounded."""
_RECENT, _RECENT_S = 24, 0.25
_OLD, _OLD_S = 36, 2.0
_PASSED_M = 0.25
"""A beam that goes on by so much behind a place passed it [m]."""
_STANDS_M = 0.18
"""One that ends so near to a place met what stands there [m]."""


class Looks(NamedTuple):
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
        self._n_recent = self._n_old = 0
        self._last_s = [-np.inf, -np.inf]

    def add(self, t: float, pose: Float[Array, "3"], bearings: Float[Array, "n"], reach: Float[Array, "n"]) -> None:
        """Keep a scan from a pose at time t [s], if the last one kept is old enough.

        reach: how far each beam came [m]; infinite where it met nothing, NaN where it says nothing.
        """
        if t - self._last_s[0] < _RECENT_S:
            return
        self._last_s[0] = t
        if t - self._last_s[1] >= _OLD_S:
            self._last_s[1] = t
            self._put(_RECENT + self._n_old % _OLD, t, pose, bearings, reach)
            self._n_old += 1
        else:
            self._put(self._n_recent % _RECENT, t, pose, bearings, reach)
            self._n_recent += 1

    def looks(self, places: Float[Array, "n 2"], before_s: Float[Array, "n"]) -> Looks:
        """Count the looks before these times [s] that saw each place [m] free, and those that saw something there."""
        kept = self._t < before_s.max(initial=-np.inf)
        if not kept.any():
            return Looks(np.zeros(len(places)), np.zeros(len(places)))
        seen_at = placed(self._view[kept][:, None], places[None])  # (k, n, 2)
        away = np.hypot(seen_at[..., 0], seen_at[..., 1])
        bin_ = np.rint(np.arctan2(seen_at[..., 1], seen_at[..., 0]) * (_BINS / (2 * np.pi))).astype(np.intp)
        ranges, rows = self._range[kept], np.arange(kept.sum())[:, None]
        beams = np.stack([ranges[rows, (bin_ + shift) % _BINS] for shift in (-1, 0, 1)])
        with np.errstate(invalid="ignore"):
            gap = beams - away
            free = (gap > _PASSED_M).sum(axis=0) >= 2
            hit = (np.abs(gap) < _STANDS_M).any(axis=0)
        earlier = self._t[kept][:, None] < before_s
        return Looks((free & ~hit & earlier).sum(axis=0).astype(float), (hit & earlier).sum(axis=0).astype(float))

    def _put(self, row: int, t: float, pose: Array, bearings: Array, reach: Array) -> None:
        self._t[row], self._view[row] = t, inverse(pose)
        if bearings.size > 1:
            # each bin takes the beam nearest to its middle, the shorter of two; bins beyond the beams say nothing
            middle = np.arange(_BINS) * (2 * np.pi / _BINS)
            step = (bearings[-1] - bearings[0]) / (bearings.size - 1)
            beam = ((middle - bearings[0] + 0.5 * step) % (2 * np.pi) - 0.5 * step) / step
            near = np.stack([np.ceil(beam - _HALF), np.floor(beam + _HALF)]).astype(np.intp)
            inside = (near >= 0) & (near < bearings.size)
            self._range[row] = np.fmin.reduce(np.where(inside, reach[np.clip(near, 0, bearings.size - 1)], np.nan))
