"""Appearance of tracks: a reference histogram each, learned from clear looks, and doubtful looks left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.rows import Rows, written
from trackers.vision.histogram import chi_squared_distance, updated_reference


@dataclass(frozen=True, eq=False)
class Appearance(Rows):
    """The appearance memory of n tracks."""

    reference: Float[Array, "n bins"]  # colour histogram
    n_look: Int[Index, "n"]  # how often the reference was learned from; 0: there is none
    n_refused: Int[Index, "n"]  # how many looks in a row it was not learned from, as doubtful

    @classmethod
    def started(cls, reference: Float[Array, "n bins"], n_look: Int[Index, "n"]) -> Self:
        """Of tracks that start, with a first look (n_look 1) or none (0)."""
        return cls(reference, n_look, np.zeros(len(reference), np.int64))

    @property
    def known(self) -> Bool[Mask, "n"]:
        """The tracks that have been seen clearly at least once."""
        return self.n_look > 0

    def learned(
        self,
        track: Int[Index, "p"],
        histogram: Float[Array, "p bins"],
        doubtful: Bool[Mask, "p"],
        patience: int,
        memory: float,
    ) -> Self:
        """After clear looks upon those at `track`, which showed these histograms.

        A `doubtful` look, which may be of somebody else, teaches nothing; but after `patience` of them in a row it is
        the clothes that look otherwise now, or the light. memory: the share of the old reference that is kept.
        """
        refused = doubtful & (self.n_refused[track] < patience)
        n_refused = written(self.n_refused, track, np.where(refused, self.n_refused[track] + 1, 0))
        if refused.any():
            track, histogram = track[~refused], histogram[~refused]
        blended = updated_reference(self.reference[track], histogram, memory)
        return type(self)(
            reference=written(self.reference, track, np.where(self.known[track, None], blended, histogram)),
            n_look=written(self.n_look, track, self.n_look[track] + 1),
            n_refused=n_refused,
        )

    def distance(self, histograms: Float[Array, "k bins"], comparable: Bool[Mask, "k"]) -> Float[Array, "n k"] | None:
        """χ² distance of every track and each of k looks, in [0, 1], NaN where either has no colours; None: all are."""
        known = self.known
        if not known.any() or not comparable.any():
            return None
        distance = np.full((known.size, comparable.size), np.nan)
        distance[np.ix_(known, comparable)] = chi_squared_distance(self.reference[known], histograms[comparable])
        return distance
