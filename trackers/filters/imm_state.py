"""The state of an interacting multiple model estimator: the arrays that `Imm` takes and hands back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.rows import Selection


@dataclass(frozen=True, eq=False)
class ImmState:
    """n tracks with m modes each; the tracks stand in the last axis, so that every operation runs along them."""

    mean: Float[Array, "s m n"]  # position first [m]
    covariance: Float[Array, "s s m n"]
    probability: Float[Array, "m n"]  # each column sums to 1

    def __len__(self) -> int:
        return self.mean.shape[-1]

    @property
    def positions(self) -> Float[Array, "n m 2"]:
        """Position of each track in each mode [m]."""
        return self.mean[:2].T

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
