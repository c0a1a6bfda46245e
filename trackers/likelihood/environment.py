"""Likelihood of a head's position by the room: in free space, at plausible heights (Suzuki et al., eq. 8)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from pydantic import Field, FiniteFloat

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.environment.model import Environment


class EnvironmentLikelihoodOptions(Strict):
    """Weights of a head's position (eq. 8), if the environment is known."""

    above_furniture: float = Field(
        default=0.5, ge=0, le=1, description="weight over furniture, region B; over chairs, where people sit, too"
    )
    odd_height: float = Field(default=0.2, ge=0, le=1, description="weight too low and too high, region C")
    low_m: FiniteFloat = Field(default=0.8, description="what is lower is too low (the paper gives no height) [m]")
    high_m: FiniteFloat = Field(default=1.9, description="what is higher is too high (the paper gives no height) [m]")
    radius_m: float = Field(
        default=0.08,
        ge=0,
        description="a head's middle is at least so far from what region A holds (ours); 0: the paper [m]",
    )


class EnvironmentLikelihood:
    """Likelihood of heads by one room; environment: None if unknown, with no effect."""

    def __init__(self, environment: Environment | None, options: EnvironmentLikelihoodOptions) -> None:
        self._environment, self._options = environment, options

    def log_likelihood(self, places: Float[Array, "k 3"]) -> Float[Array, "k"]:
        """Return the logarithm of the weight e (eq. 8) of heads at positions [m]; 0 for an unknown environment."""
        if self._environment is None:
            return np.zeros(len(places))
        options = self._options
        weight = self._environment.head_weight(
            places,
            above_furniture=options.above_furniture,
            odd_height=options.odd_height,
            low_m=options.low_m,
            high_m=options.high_m,
        )
        if options.radius_m:
            weight = weight * ~(self._environment.distance_to_surface(places) < options.radius_m)
        with np.errstate(divide="ignore"):
            return np.log(weight)
