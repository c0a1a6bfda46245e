"""Trunks at waist height: a body's axis from a scanner's cluster."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from pydantic import Field

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.laser.detections import Detections
from trackers.likelihood.position import PositionLikelihood


class TrunkOptions(Strict):
    """Options of the accuracy of trunks, and their greatest distance from a prediction."""

    variance_m2: float = Field(
        default=0.0015,
        gt=0,
        description="variance of the place of a trunk in full view, on each axis [m²] (ours, measured; the paper: 0.01)",
    )
    offset_m: float = Field(
        default=0.03,
        ge=0,
        description="standard deviation, on each axis, of how far a trunk is off the person's place as long as it is held so, "
        "and as much again, by its depth, arms and clothes, as long as it is seen from one side. Scanners on several sides "
        "average the latter out, measurements neither, so that they count in the stated radius [m] (ours, measured)",
    )
    gate_m: float = Field(default=1.0, gt=0, description="radius of the validation region of trunks [m] (the paper's)")


def offset_variance_m2(trunks: Detections, options: TrunkOptions) -> Float[Array, "k"]:
    """Return the variance on each axis of the persistent error of k trunks [m²], see `TrunkOptions.offset_m`."""
    return options.offset_m**2 * (1 + 1 / np.maximum(trunks.scanner.sum(axis=1), 1))


def trunk_likelihood(trunks: Detections, options: TrunkOptions) -> PositionLikelihood:
    """Return the likelihood of k trunks; partly occluded ones have an additional variance."""
    return PositionLikelihood(trunks.position, options.variance_m2 + trunks.variance_m2, options.gate_m)
