"""Differences of the places that sources show of people: from what others show now, and from what they showed some time before.

Places are interpolated at ticks, so that sources of different rates are compared at the same times, down to about one look a
second: slower ones are not compared. At each tick and for each shift the difference of two sources on a person is predicted by
its mean lately, and its error counts by the log-likelihood of a Student's t distribution, so that a wrong association counts
little. The sums are prequential likelihoods (Dawid 1984) of the shifts. What stays alike of a person's differences is in the
mean, and so is all that a delay makes on a straight and steady way: only walks that bend, start or stop say how late a source is,
whatever the constant and radial errors are. Of a longer delay than the longest shift, that shift fits best: it is at least as
long. Longer shifts would be fitted by radial errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.rows import Rows
from trackers.fusion.person_tracks import People
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS

TICK_S = 0.1
"""Time between two ticks [s]."""
_TICK_NS = round(TICK_S * NS_PER_S)
_SHIFTS = np.arange(6)
"""Shifts that are compared [ticks]."""
LONGEST_S = float(_SHIFTS[-1] * TICK_S)
"""Longest shift [s]."""
_LEAST_WAIT, _MOST_WAIT = 5, 15
"""Ticks until one is compared, by the slowest source: two measurements are interpolated over no longer."""
_PERIODS, _SHARE_OF_PERIOD = 1.25, 0.1
"""Periods of a source over which its measurements are interpolated at least, and share of the last in the mean period."""
_KEPT = int(2 * _MOST_WAIT + _SHIFTS[-1] + 1)
"""Ticks kept: the slowest sources may look at once, so that all that waits is compared after one more period."""
_MEMORY_S = 3.0
"""Time constant of forgetting [s]."""
_ALIKE_S = 0.5
"""Correlation time of what does not stay alike of differences, or a period: all looks in it together count as one [s]."""
_SCALE_M, _ROBUST_M = 0.05, 0.3
"""Scale of the t distribution, and error from which a difference hardly changes the mean [m]."""
_NATS = 1.5
"""Log-likelihood of a look per log(1 + squared error): a t distribution of one degree of freedom in the plane."""
_EXISTS = 0.9
"""Existence of tracks on which sources are compared."""
_FRESH, _FEWEST, _FEWEST_IN_MEANS = 3.0, 20.0, 10.0
"""Ticks from which on a mean predicts, and ticks of people from which on two sources' predictions and means are compared."""


@dataclass(frozen=True, eq=False)
class _Compared(Rows):
    """n tracks as s sources show them, with k shifts; written in place."""

    id: Int[Index, "n"]
    last_ns: Int[Index, "n s"]
    last: Float[Array, "n s 2"]  # place at the last measurement [m]
    at: Float[Array, "n t s 2"]  # at the ticks kept, in turn, NaN: not known
    mean: Float[Array, "n k s s 2"]  # of the differences, of the second source from the first [m]
    weight: Float[Array, "n k s s"]  # ticks in it
    scatter_m2: Float[Array, "n s s"]  # mean squared error of its predictions at no shift

    def of(self, id: Int[Index, "k"], known: Bool[Mask, "k"]) -> Self:
        """Return them in the order of the known tracks of these numbers: those that are not here yet new, others dropped."""
        id = id[known]
        if np.array_equal(id, self.id):
            return self
        new = id[~np.isin(id, self.id)]
        each = self.joined(self.started(new, self.last_ns.shape[1]))
        return each.select((id[:, None] == each.id).argmax(axis=1))

    @classmethod
    def started(cls, id: Int[Index, "n"], n_source: int) -> Self:
        """Make tracks of which nothing is known."""
        n, pairs, k = len(id), (n_source, n_source), len(_SHIFTS)
        return cls(
            id=id,
            last_ns=np.full((n, n_source), NEVER_NS),
            last=np.full((n, n_source, 2), np.nan),
            at=np.full((n, _KEPT, n_source, 2), np.nan),
            mean=np.zeros((n, k, *pairs, 2)),
            weight=np.zeros((n, k, *pairs)),
            scatter_m2=np.zeros((n, *pairs)),
        )


@dataclass(frozen=True, eq=False)
class Offsets:
    """Means of the differences of each two sources: of all people together, and of one person on average."""

    together_m: Float[Array, "s s"]  # length of the mean over people [m]
    each_m: Float[Array, "s s"]  # mean length over people [m]
    n_people: Float[Array, "s s"]  # as many as count alike
    between_m2: Float[Array, "s s"]  # variances on each axis of people's means
    within_m2: Float[Array, "s s"]  # and of one person's differences
    known: Bool[Mask, "s s"]


class ShiftedDifferences:
    """Differences between n sources of people."""

    def __init__(self, n_source: int) -> None:
        self._tracks = _Compared.started(np.zeros(0, np.int64), n_source)
        self._start_ns, self._tick, self._compared = NEVER_NS, 0, 0  # stamp of tick 0, the last one, the last compared
        self._looked_ns, self._period_s = np.full(n_source, NEVER_NS), np.zeros(n_source)
        self._others = ~np.eye(n_source, dtype=np.bool_)
        self._loss = np.zeros((len(_SHIFTS), n_source, n_source))
        self._ticks = np.zeros((n_source, n_source))

    def looked(self, number: int, ns: int) -> None:
        """Learn the period of source `number` by a look of stamp ns; a time too long to interpolate over is a silence."""
        since_s = (ns - int(self._looked_ns[number])) / NS_PER_S if self._looked_ns[number] != NEVER_NS else 0.0
        self._looked_ns[number] = ns
        if 0 < since_s <= _MOST_WAIT * TICK_S:
            share = _SHARE_OF_PERIOD if self._period_s[number] else 1.0
            self._period_s[number] += share * (since_s - self._period_s[number])

    def advance(self, people: People, ns: int) -> bool:
        """Take in what sources have shown of people until stamp ns and compare all ticks that are due; return True if any are."""
        if self._start_ns == NEVER_NS:
            self._start_ns = ns
        whole = (ns - self._start_ns) // _TICK_NS
        if whole <= self._tick:
            return False
        kept = np.exp(-(whole - self._tick) * TICK_S / _MEMORY_S)
        tracks = self._tracks = self._tracks.of(people.roster.id, people.confirmed)
        for sums in (self._loss, self._ticks, tracks.weight):
            sums *= kept
        wait = np.clip(np.ceil(_PERIODS * self._period_s / TICK_S), _LEAST_WAIT, _MOST_WAIT).astype(np.int64)
        if whole - self._tick > _KEPT:
            tracks.at[...] = np.nan
        tracks.at[:, np.arange(max(self._tick + 1, whole - _KEPT), whole + 1) % _KEPT] = np.nan
        self._tick = whole
        known = people.confirmed
        upright = (people.existence > _EXISTS) & ~people.posture.rests  # each kind shows another part of who rests
        self._interpolate(people.seen_ns[known], people.seen_at[known], upright[known], wait)
        for due in range(max(self._compared + 1, whole - 2 * _MOST_WAIT), whole - int(wait.max()) + 1):
            self._compare(due)
            self._compared = due
        return True

    def _interpolate(
        self, seen_ns: Int[Index, "n s"], seen: Float[Array, "n s 2"], compared: Bool[Mask, "n"], wait: Int[Index, "s"]
    ) -> None:
        """Write places at the ticks between the measurements that were the last ones before and those since then.

        wait: the longest time between two of each source [ticks].
        """
        tracks, last, last_ns = self._tracks, self._tracks.last, self._tracks.last_ns
        since_ns = seen_ns - last_ns
        follows = (since_ns > 0) & (since_ns <= wait * _TICK_NS) & compared[:, None]
        ticks = self._tick - np.arange(2 * wait.max())
        share = (self._start_ns + ticks * _TICK_NS - last_ns[..., None]) / np.maximum(since_ns, 1)[..., None]
        row, source, tick = np.nonzero(follows[..., None] & (share >= 0) & (share <= 1))
        moved = share[row, source, tick, None] * (seen - last)[row, source]
        tracks.at[row, ticks[tick] % _KEPT, source] = last[row, source] + moved
        self._tracks = tracks.changed(last=seen, last_ns=seen_ns)

    def _compare(self, tick: int) -> None:
        """Compare what sources show at a tick with what others showed up to then."""
        tracks = self._tracks
        if not len(tracks):
            return
        then = tracks.at[:, (tick - _SHIFTS) % _KEPT]
        off = then[:, 0, :, None][:, None] - then[:, :, None]  # (n, k, s, s, 2)
        known = np.isfinite(off[..., 0]).all(axis=1) & self._others
        if not known.any():
            return
        error = np.where(known[:, None, :, :, None], off - tracks.mean, 0.0)
        error_m2 = (error**2).sum(axis=-1)
        predicted = known & (tracks.weight.min(axis=1) >= _FRESH)
        self._loss += (np.log1p(error_m2 / _SCALE_M**2) * predicted[:, None]).sum(axis=0)
        self._ticks += predicted.sum(axis=0)
        weight = known[:, None] / (1 + error_m2 / _ROBUST_M**2)
        tracks.weight[...] += weight
        share = weight / np.maximum(tracks.weight, 1e-9)
        tracks.mean[...] += share[..., None] * error
        tracks.scatter_m2[...] += share[:, 0] * (error_m2[:, 0] - tracks.scatter_m2)

    def lags(self, least_s: float) -> tuple[Float[Array, "s s"], Float[Array, "s s"]]:
        """Return evidence [nat] that each source shows people as another did at least a time before, and that time [s].

        Evidence is the logarithm of the likelihood ratio of the best such shift against the best smaller one.
        """
        first = int(np.searchsorted(_SHIFTS * TICK_S, least_s))
        alike_s = np.maximum(np.maximum(self._period_s[:, None], self._period_s), _ALIKE_S)
        evidence = _NATS * TICK_S / alike_s * (self._loss[:first].min(axis=0) - self._loss[first:].min(axis=0))
        best = first + self._loss[first:].argmin(axis=0)
        around = np.clip(best + np.array([-1, 0, 1])[:, None, None], 0, len(_SHIFTS) - 1)
        before, least, after = np.take_along_axis(self._loss, around, axis=0)
        from_s, at_s, to_s = TICK_S * _SHIFTS[around]
        falls, rises = (
            (before - least) / np.maximum(at_s - from_s, TICK_S),
            (after - least) / np.maximum(to_s - at_s, TICK_S),
        )
        share = falls / np.maximum(
            falls + rises, 1e-9
        )  # of the way between the middles: a parabola has its minimum there
        lag_s = np.where((least < after) & (least < before), (from_s + at_s + share * (to_s - from_s)) / 2, at_s)
        return evidence, lag_s

    @property
    def known(self) -> Bool[Mask, "s s"]:
        """Mark the pairs of sources whose delays are known."""
        return np.minimum(self._ticks, self._ticks.T) >= _FEWEST

    @property
    def compared(self) -> Bool[Mask, "s s"]:
        """Mark the pairs of sources of which so much is known that delays and offsets will soon be known, or are."""
        return np.maximum(self._ticks, self._ticks.T) >= _FEWEST_IN_MEANS / 2

    def offsets(self) -> Offsets:
        """Return the means over people of the differences of each two sources."""
        tracks = self._tracks
        weight = np.where(tracks.weight[:, 0] >= _FRESH, tracks.weight[:, 0], 0.0)  # (n, s, s)
        total = np.maximum(weight.sum(axis=0), 1e-9)
        share, means = weight / total, tracks.mean[:, 0]
        mean = (share[..., None] * means).sum(axis=0)
        known = (
            np.minimum(total, np.maximum(self._ticks, self._ticks.T)) >= _FEWEST_IN_MEANS
        )  # a delay shows by then, too
        return Offsets(
            together_m=np.hypot(mean[..., 0], mean[..., 1]),
            each_m=(share * np.hypot(means[..., 0], means[..., 1])).sum(axis=0),
            n_people=1 / np.maximum((share**2).sum(axis=0), 1e-9),
            between_m2=(share * ((means - mean) ** 2).sum(axis=-1)).sum(axis=0) / 2,
            within_m2=(share * tracks.scatter_m2).sum(axis=0) / 2,
            known=known & known.T,
        )
