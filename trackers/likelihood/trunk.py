"""Trunks at waist height: where a body's axis is, by a cluster of a scanner."""

from __future__ import annotations

from pydantic import Field

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
    gate_m: float = Field(default=1.0, gt=0, description="radius of the validation region of trunks [m] (the paper's)")


def trunk_likelihood(trunks: Detections, options: TrunkOptions) -> PositionLikelihood:
    """Return the likelihood of k trunks; one that is partly occluded has a variance of its own beside."""
    return PositionLikelihood(trunks.position, options.variance_m2 + trunks.variance_m2, options.gate_m)
