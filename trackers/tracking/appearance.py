"""Appearance of tracks: a reference histogram each, learned from clear views, without doubtful ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.rows import Rows, written
from trackers.vision.histogram import chi_squared_distance, updated_reference


@dataclass(frozen=True, eq=False)
class Appearance(Rows):
    """The appearance memory of n tracks."""

    reference: Float[Array, "n bins"]  # colour histogram
    n_look: Int[Index, "n"]  # number of views learned; 0: no reference
    n_refused: Int[Index, "n"]  # number of consecutive doubtful views, not learned

    @classmethod
    def started(cls, reference: Float[Array, "n bins"], n_look: Int[Index, "n"]) -> Self:
        """Make appearances of new tracks, with a first view (n_look 1) or none (0)."""
        return cls(reference, n_look, np.zeros(len(reference), np.int64))

    @property
    def known(self) -> Bool[Mask, "n"]:
        """Mask of tracks with at least one clear view."""
        return self.n_look > 0

    def learned(
        self,
        track: Int[Index, "p"],
        histogram: Float[Array, "p bins"],
        doubtful: Bool[Mask, "p"],
        patience: int,
        memory: float,
    ) -> Self:
        """Return the appearances after clear views with these histograms of the tracks at `track`.

        A `doubtful` view, possibly of another person, is not learned; but after `patience` of them in a row the clothes, or
        the light, have changed. memory: retained share of the old reference.
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
        """Return the χ² distance of every track and each of k views, in [0, 1], NaN where either has no colours; None: all
        have none.
        """
        known = self.known
        if not known.any() or not comparable.any():
            return None
        distance = np.full((known.size, comparable.size), np.nan)
        distance[np.ix_(known, comparable)] = chi_squared_distance(self.reference[known], histograms[comparable])
        return distance
