"""What an interacting multiple model estimator knows of its tracks: the arrays that `Imm` takes and hands back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.motion import HEADING, nearest_turn
from trackers.filters.rows import Selection


@dataclass(frozen=True, eq=False)
class ImmState:
    """n tracks with m modes each; the tracks stand in the last axis, so that every operation runs along them."""

    mean: Float[Array, "5 m n"]
    covariance: Float[Array, "5 5 m n"]
    probability: Float[Array, "m n"]  # each column sums to 1

    def __len__(self) -> int:
        return self.mean.shape[-1]

    @property
    def positions(self) -> Float[Array, "n m 2"]:
        """Position of each track in each mode [m]."""
        return self.mean[:2].T

    @property
    def aligned_mean(self) -> Float[Array, "5 m n"]:
        """Means with headings within half a turn of the most probable mode's."""
        if len(self.probability) == 1:
            return self.mean
        headings = self.mean[HEADING]  # (m, n)
        likeliest = headings[self.probability.argmax(axis=0), np.arange(len(self))]
        means = self.mean.copy()
        means[HEADING] = nearest_turn(headings, likeliest)
        return means

    @property
    def mode_average(self) -> Float[Array, "5 n"]:
        """Mean of each track over its modes."""
        return (self.aligned_mean * self.probability).sum(axis=1)

    def select(self, index: Selection) -> ImmState:
        """The tracks at `index`."""
        return ImmState(self.mean[..., index], self.covariance[..., index], self.probability[..., index])

    def joined(self, other: ImmState) -> ImmState:
        """These tracks followed by `other`."""
        return ImmState(
            np.concatenate([self.mean, other.mean], axis=-1),
            np.concatenate([self.covariance, other.covariance], axis=-1),
            np.concatenate([self.probability, other.probability], axis=-1),
        )

    def replaced(self, index: Selection, other: ImmState) -> ImmState:
        """These tracks with those at `index` exchanged for `other`."""
        mean, covariance, probability = self.mean.copy(), self.covariance.copy(), self.probability.copy()
        mean[..., index], covariance[..., index], probability[..., index] = (
            other.mean,
            other.covariance,
            other.probability,
        )
        return ImmState(mean, covariance, probability)
