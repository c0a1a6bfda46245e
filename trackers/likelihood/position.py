"""Likelihood of measured positions about predicted ones: a Gaussian about each mode of a filter."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.filters.gating import mahalanobis_distances, validation_region
from trackers.filters.imm import ImmState


@dataclass(frozen=True, eq=False)
class PositionLikelihood:
    """k measured positions, each with a variance on each axis, and the radius of their validation regions."""

    position: Float[Array, "k 2"]  # [m]
    variance_m2: Float[Array, "k"]
    gate_m: float

    def log_likelihood(self, state: ImmState) -> Float[Array, "n k"]:
        """Return ln p of each measurement [ln 1/m²] about the likeliest mode of each of n predicted tracks."""
        return self.evaluated(state)[1]

    def evaluated(self, state: ImmState) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
        """Return N, the smallest Mahalanobis distance over the modes (Bai and Takahashi, eq. 5), and `log_likelihood`."""
        covariance = state.covariance[:2, :2].T
        distance, cost = mahalanobis_distances(state.positions, covariance, self.position, self.variance_m2)
        return distance, -0.5 * cost

    def in_gate(self, state: ImmState) -> Bool[Mask, "n k"]:
        """Return a mask of pairs whose measurement lies in the validation region: circles about the modes (section IV)."""
        return validation_region(state.positions, self.position, self.gate_m)
