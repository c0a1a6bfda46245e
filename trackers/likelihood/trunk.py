"""Trunks at waist height: where a body's axis is, by a cluster of a scanner."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from pydantic import Field

from trackers.arrays import Array
from trackers.configuration import Strict
from trackers.laser.detections import Detections
from trackers.likelihood.position import PositionLikelihood


class TrunkOptions(Strict):
    """Options of how exactly a trunk shows its person, and how far from a prediction it may be."""

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
    """Return the variance on each axis of what stays of the error of k trunks [m²], see `TrunkOptions.offset_m`."""
    return options.offset_m**2 * (1 + 1 / np.maximum(trunks.scanner.sum(axis=1), 1))


def trunk_likelihood(trunks: Detections, options: TrunkOptions) -> PositionLikelihood:
    """Return the likelihood of k trunks; one that is partly occluded has a variance of its own beside."""
    return PositionLikelihood(trunks.position, options.variance_m2 + trunks.variance_m2, options.gate_m)
