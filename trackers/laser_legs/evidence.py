"""Evidence that a track is a person: of its legs, of the map, of its motion, of its misses; and the existence that follows.

Each track carries fading sums of what its scans showed. Of these a forest (`trackers.laser.legs.classifier.Forest`) makes the
logarithm of the odds that a person is there [nat]. It was taught on tracks in drawn rooms, by scanners that stand and that drive
(`scripts/learn-legs`). One scan after the other shows nearly the same, so that their evidence cannot be added up; what a longer
look is worth is learned as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm import ImmState
from trackers.filters.rows import Rows, written

TRACK_FEATURES = (
    "legs", "second_leg", "best_leg", "both", "looks_s", "missed", "farthest", "speed", "age", "range",
    "driven", "free_share", "free", "hit", "spread", "beside",
)  # fmt: skip
"""Names of what the forest is shown of a track, in their order."""
_BESIDE_M = 2.0


@dataclass(frozen=True, eq=False)
class LegTracks(Rows):
    """State of n tracks: the filter's, and the sums of evidence; positions are in the fixed frame."""

    filter: ImmState
    sums: Float[Array, "n 4"]  # fading sums over time [s]: of looks, best leg's evidence, second leg's, share with two
    missed: Float[Array, "n"]  # fading mean of the detection probability of misses
    best: Float[Array, "n"]  # highest evidence of a leg [nat]
    born_at: Float[Array, "n 2"]  # first position [m]
    seen_from: Float[Array, "n 2"]  # where the scanner was then [m]
    farthest: Float[Array, "n"]  # greatest distance from the first position [m]
    free: Float[Array, "n"]  # looks before it that saw its place free
    hit: Float[Array, "n"]  # looks before it that saw something there
    log_odds: Float[Array, "n"]  # of existence [nat]

    def __len__(self) -> int:
        return len(self.missed)

    @classmethod
    def started(cls, state: ImmState, evidence: Float[Array, "n"], scanner: Float[Array, "2"], log_odds: float) -> Self:
        """Return new tracks whose clusters have this evidence [nat]."""
        n = len(state)
        place = state.mean[:2, 0].T.copy()
        zeros = np.zeros(n)
        return cls(
            state, np.zeros((n, 4)), zeros, evidence, place, np.tile(scanner, (n, 1)), zeros, zeros, zeros,
            np.full(n, log_odds),
        )  # fmt: skip

    def faded(self, elapsed_s: float, memory_s: float) -> Self:
        """Return the tracks with what they were shown `elapsed_s` older."""
        keep = np.exp(-elapsed_s / memory_s)
        return self.changed(sums=self.sums * keep)

    def looked(
        self,
        track: Int[Index, "p"],
        first: Float[Array, "p"],
        second: Float[Array, "p"],
        both: Bool[Mask, "p"],
        p_detect: Float[Array, "n"],
        elapsed_s: float,
        memory_s: float,
    ) -> Self:
        """Return the tracks after a scan in which those at `track` were measured; p_detect: of all of them."""
        weight = min(elapsed_s, memory_s)
        shown = np.zeros((len(self), 4))
        shown[track] = np.column_stack([np.ones(len(track)), first, second, both]) * weight
        share = 1 - np.exp(-elapsed_s / memory_s)
        missed = p_detect.copy()
        missed[track] = 0.0
        # a track that could not be seen is shown nothing
        certain = np.maximum(p_detect, 0.0)
        certain[track] = 1.0
        mean = self.missed + share * certain * (missed - self.missed)
        return self.changed(
            sums=self.sums + shown,
            missed=mean,
            best=written(self.best, track, np.maximum(self.best[track], first)),
        )

    def features(
        self, places: Float[Array, "n 2"], speed: Float[Array, "n"], spread: Float[Array, "n"], age: Float[Array, "n"],
        scanner: Float[Array, "2"],
    ) -> Float[Array, "n features"]:  # fmt: skip
        """Return `TRACK_FEATURES` of the tracks at these places [m]; scanner: where it is [m]."""
        looked = np.maximum(self.sums[:, 0], 1e-6)
        means = self.sums[:, 1:] / looked[:, None]
        off = places[:, None] - places
        apart = np.hypot(off[..., 0], off[..., 1])
        better = (self.log_odds > self.log_odds[:, None]) | (
            (self.log_odds == self.log_odds[:, None]) & (age > age[:, None])
        )
        beside = np.where(better, apart, _BESIDE_M).min(axis=1, initial=_BESIDE_M)
        return np.column_stack([
            means[:, 0], means[:, 1], self.best, means[:, 2], self.sums[:, 0], self.missed, self.farthest, speed,
            np.minimum(age, 10.0), np.hypot(*(places - scanner).T), np.hypot(*(self.seen_from - scanner).T),
            (self.free + 0.5) / (self.free + self.hit + 1), np.log1p(self.free), np.log1p(self.hit), spread, beside,
        ])  # fmt: skip
