"""Likelihoods of a position by the room and its floor.

By a pressure floor: the share of a cluster's load there (Mori et al., eq. 3). By the room: a head is in free space, at
plausible heights (Suzuki et al., eq. 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, FiniteFloat
from scipy import ndimage

from trackers.arrays import Array, Float
from trackers.configuration import Strict
from trackers.environment.model import Environment
from trackers.floor.clusters import FloorClusters
from trackers.rig import FloorSensor


class FloorLikelihoodOptions(Strict):
    """Options of the floor's likelihood."""

    no_load: float | Literal["drop"] = Field(
        default=-7.0,
        description='log-likelihood over an element without load (ours); "drop": the place is impossible (the paper)',
    )
    smoothing_m: float = Field(
        default=0.12,
        ge=0,
        description="standard deviation by which a cluster's load is smoothed over the floor (ours) [m]; 0: as measured (eq. 3)",
    )


@dataclass(frozen=True, eq=False)
class FloorLikelihood:
    """Shares of the clusters' load in one frame, over the grid."""

    options: FloorLikelihoodOptions
    floor: FloorSensor
    share: Float[Array, "rows columns"]

    @classmethod
    def of(cls, clusters: FloorClusters, floor: FloorSensor, options: FloorLikelihoodOptions) -> FloorLikelihood:
        """Make the likelihood of one frame's clusters, smoothed by the options."""
        share = clusters.share_of_cell()
        if options.smoothing_m:
            share = ndimage.gaussian_filter(share, options.smoothing_m / floor.pitch_m, mode="constant")
        return cls(options, floor, share)

    def log_likelihood(self, places: Float[Array, "2 k"]) -> Float[Array, "k"]:
        """Return log π_f (eq. 3) at x, y [m]: f(x, y) is interpolated between the middles of elements."""
        pose = self.floor.room_from_sensor
        local = (places.T - pose.translation[:2]) @ np.linalg.inv(pose.rotation[:2, :2]).T / self.floor.pitch_m - 0.5
        share = ndimage.map_coordinates(self.share, local.T[::-1], order=1, mode="constant")
        if self.options.no_load == "drop":
            with np.errstate(divide="ignore"):
                return np.log(share)
        return np.log(share + np.exp(self.options.no_load))


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
