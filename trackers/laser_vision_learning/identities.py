"""Identities of tracks by appearance and continuity: one assignment of all tracks to all people known.

Each track that was never confused keeps its identity unless appearance contradicts it strongly; tracks that were merged
share their possible identities until appearance tells them apart. An assignment has the log-odds Σ w(track, identity), w the
log-likelihood ratio of the track's mean score by the identity's classifier, "this person" against "somebody else", plus the
log prior of the continuity. The best assignment stands for a track if every one that gives it another identity has less by
`margin` (after Murty's ranking of assignments, 1968); with less, motion decides: the track keeps its own, or what is left.
After the identity management of Schumitsch, Thrun, Bradski and Olukotun ("The information-form data association filter",
NIPS 2005), with all links kept open.

Scores become likelihood ratios by two normal distributions of common variance: those of own people's and of other people's
scores, in pictures before they were learned from, of tracks whose identity is certain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.scipy_functions import linear_sum_assignment

_IMPOSSIBLE = -1e6


class IdentityOptions(Strict):
    """Options of the decision on identities."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"unnoticed": None, "unknown_log_odds": 5.0}

    pictures: PositiveInt = Field(
        default=2, description="pictures over which a body's scores are averaged before they count (ours)"
    )
    margin: float = Field(
        default=3.0,
        ge=0,
        description="log-odds that the next best assignment must lose for looks to decide; else motion does (ours)",
    )
    jointly: bool = Field(
        default=False,
        description="a verdict stays open until all who may have its identities were scored (paper, V.B); no: it is final "
        "at once (ours)",
    )
    memory: ClassVar[int] = 25
    """Largest number of pictures that a mean score stands for: older ones fade (ours)."""


@dataclass(frozen=True, eq=False)
class Identities:
    """Identities of q bodies, columns of the assignment's m."""

    column: Int[Index, "q"]
    by_looks: Bool[Mask, "q"]  # else by motion
    margin: Float[Array, "q"]  # log-odds lost by the next best assignment


def decided(log_odds: Float[Array, "q m"], own: Int[Index, "q"], margin: float) -> Identities:
    """Assign bodies to identities, at least as many, with the largest total log-odds; `own`: columns by motion."""
    q = len(log_odds)
    body, column = linear_sum_assignment(log_odds, maximize=True)
    best, lost = log_odds[body, column].sum(), np.zeros(q)
    for each, of in zip(body, column, strict=True):
        without = log_odds.copy()
        without[each, of] = _IMPOSSIBLE
        lost[each] = min(best - without[linear_sum_assignment(without, maximize=True)].sum(), 1e3)
    sure = (lost > 0) & (lost >= margin)
    found = np.where(sure, column, -1)
    left, free = np.flatnonzero(~sure), np.setdiff1d(np.arange(log_odds.shape[1]), found)
    stays = free == own[left, None]
    rest, of = linear_sum_assignment(log_odds[np.ix_(left, free)] - _IMPOSSIBLE * stays, maximize=True)
    found[left[rest]] = free[of]
    return Identities(found, sure, lost)


@dataclass(frozen=True)
class Calibration:
    """Distributions of mean scores of own people and of others: counts, sums and sums of squares."""

    own: tuple[float, float, float] = (10.0, 12.0, 17.0)
    other: tuple[float, float, float] = (10.0, -15.0, 27.0)

    def updated(self, own: Float[Array, "k"], other: Float[Array, "l"]) -> Calibration:
        """Return the distributions with more scores of tracks whose identity is certain."""
        statistics = [
            (n + each.size, total + each.sum(), square + (each**2).sum())
            for (n, total, square), each in ((self.own, own), (self.other, other))
        ]
        return Calibration(*statistics)

    def log_ratio(self, score: Float[Array, "..."]) -> Float[Array, "..."]:
        """Return the log-likelihood ratios of mean scores; 0 for NaN."""
        (n, total, square), (n_other, total_other, square_other) = self.own, self.other
        mean, mean_other = total / n, total_other / n_other
        variance = 0.5 * (square / n - mean**2 + square_other / n_other - mean_other**2)
        slope = max(mean - mean_other, 0.0) / max(variance, 1e-3)
        return np.nan_to_num(slope * (score - 0.5 * (mean + mean_other)))


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Possible identities of n tracks among m, and the tracks' scores by the identities' classifiers."""

    serial: Int[Index, "n"]  # ascending
    number: Int[Index, "m"]  # ids, ascending
    possible: Bool[Mask, "n m"]
    total: Float[Array, "n m"]  # sum of scores
    count: Float[Array, "n m"]  # of pictures

    @classmethod
    def none(cls) -> Self:
        """Make beliefs of no track."""
        empty = np.zeros(0, np.int64)
        return cls(empty, empty, np.zeros((0, 0), np.bool_), *np.zeros((2, 0, 0)))

    def of(self, serial: Int[Index, "k"], number: Int[Index, "l"]) -> Beliefs:
        """Return the beliefs of these tracks about these identities, both ascending; new ones without anything."""
        if np.array_equal(serial, self.serial) and np.array_equal(number, self.number):
            return self
        _, row, old_row = np.intersect1d(serial, self.serial, assume_unique=True, return_indices=True)
        _, column, old_column = np.intersect1d(number, self.number, assume_unique=True, return_indices=True)

        def carried(table: NDArray[Any]) -> NDArray[Any]:
            whole = np.zeros((serial.size, number.size), table.dtype)
            whole[np.ix_(row, column)] = table[np.ix_(old_row, old_column)]
            return whole

        return Beliefs(serial, number, *map(carried, (self.possible, self.total, self.count)))

    @property
    def doubtful(self) -> Bool[Mask, "n"]:
        """Mask of the tracks with more than one possible identity."""
        return self.possible.sum(axis=1) > 1

    def compared(self, scored: Bool[Mask, "n"]) -> Bool[Mask, "n"]:
        """Return a mask of the tracks that no doubtful track without scores shares a possible identity with."""
        rivals = self.possible.astype(float) @ self.possible.T > 0
        return ~np.logical_or.reduce(rivals & self.doubtful & ~scored, axis=1)

    def shared(self, confused: Bool[Mask, "n n"]) -> Beliefs:
        """Return the beliefs after a frame in which pairs of tracks could be exchanged: earlier scores are void."""
        mixed = confused.any(axis=1)
        if not mixed.any():
            return self
        possible = self.possible | (confused.astype(float) @ self.possible > 0)
        total, count = (np.where(mixed.reshape(-1, 1), 0.0, each) for each in (self.total, self.count))
        return replace(self, possible=possible, total=total, count=count)

    def resolved(self, certain: Bool[Mask, "n"], own: Int[Index, "n"]) -> Beliefs:
        """Return the beliefs with the identities `own`, those of `certain` tracks no others' any more."""
        possible = self.possible & ~certain[:, None]
        possible[:, own[certain]] = False
        possible[np.arange(own.size), own] = True
        return replace(self, possible=possible)

    def scored(self, score: Float[Array, "n m"], memory: int) -> Beliefs:
        """Return the beliefs with the scores in one more picture, NaN without effect."""
        scored = np.isfinite(score)
        fade = np.where(scored & (self.count >= memory), 1 - 1 / memory, 1.0)
        return replace(
            self, total=self.total * fade + np.where(scored, score, 0.0), count=self.count * fade + scored.astype(float)
        )

    def mean(self, pictures: int) -> Float[Array, "n m"]:
        """Return the mean scores, NaN with fewer pictures."""
        return np.where(self.count >= pictures - 1e-6, self.total / np.maximum(self.count, 1), np.nan)
