"""Likelihood of a position by a pressure floor: the share of a cluster's load there (Mori et al., eq. 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field
from scipy import ndimage

from trackers.arrays import Array
from trackers.configuration import Strict
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
