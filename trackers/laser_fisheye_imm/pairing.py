"""What it costs to take a measurement for a track's: how much likelier it is theirs than anything else.

Costs are −2 ln of likelihood ratios (S. Blackman and R. Popoli, "Design and Analysis of Modern Tracking Systems", 1999,
chapter 6). A measurement at z is a track's by e p(z), with e how probably the track still exists and p the density of its
prediction; or it is somebody new's, or nobody's, by their density λ. The track without it was not shown, by 1 − e + e m, with
m how probably the moment would not show them (D. Mušicki, R. Evans and S. Stanković, "Integrated probabilistic data
association", IEEE Trans. Automatic Control 39, 1994). So who is hidden is not dragged along by what others leave, and who stands
in plain sight takes what is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.filters.gating import mahalanobis_distances, validation_region
from trackers.filters.negative_information import existence_after_detection
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People

_LEAST_UNSEEN, _LEAST_EXISTENCE = 1e-3, 1e-4
"""Nobody is missed less often than this: the model of what is seen is no better. Nobody is gone for sure."""


@dataclass(frozen=True, eq=False)
class Costs:
    """What pairs of n tracks and k measurements cost, and which cannot be."""

    deviations: Float[Array, "n k"]  # N, the Mahalanobis distance
    pair: Float[Array, "n k"]  # −2 ln p(z) / λ; by the paper N
    out_of_gate: Bool[Mask, "n k"]

    def beside(self, other: Costs) -> Costs:
        """These measurements, and behind them the others."""
        return Costs(
            np.concatenate([self.deviations, other.deviations], axis=1),
            np.concatenate([self.pair, other.pair], axis=1),
            np.concatenate([self.out_of_gate, other.out_of_gate], axis=1),
        )


def costs(
    people: People,
    position: Float[Array, "k 2"],
    variance_m2: Float[Array, "k"],
    radius_m: Float[Array, "k"] | float,
    alone: Bool[Mask, "k"] | bool,
    options: LaserFisheyeImmOptions,
) -> Costs:
    """Costs of measurements at `position` [m] with a variance on each axis, in validation regions of this radius.

    alone: which are a single leg in a rig that sees waists, where there are many that are nobody's.
    """
    modes = people.state.positions
    covariance = people.state.covariance[:2, :2].T
    N, unlikely = mahalanobis_distances(modes, covariance, position, variance_m2, options.degrees_of_freedom)
    out_of_gate = ~validation_region(modes, position, radius_m)
    if options.max_deviations is not None:
        # so near there is nobody else: whoever stood starts to walk
        theirs = validation_region(modes, position, options.track_management.apart_m)
        out_of_gate |= (options.max_deviations < N) & ~theirs
    if options.new_density_m2 is None:
        return Costs(N, N, out_of_gate)
    density_m2 = np.where(alone, options.lone_leg_density_m2, options.new_density_m2)
    return Costs(N, unlikely + 2 * np.log(density_m2), out_of_gate)


def unpaired(people: People, unseen: Float[Array, "n"], options: LaserFisheyeImmOptions) -> Float[Array, "n"] | None:
    """What each track costs without a measurement, −2 ln (1 − e + e m) / e; None: by the paper all are paired that can be.

    unseen: m, how probably the moment would not show them.
    """
    if options.new_density_m2 is None:
        return None
    e = np.maximum(people.existence, _LEAST_EXISTENCE)
    return -2 * np.log((1 - e + e * np.maximum(unseen, _LEAST_UNSEEN)) / e)


def existence_paired(
    existence: Float[Array, "p"], cost: Float[Array, "p"], options: LaserFisheyeImmOptions
) -> Float[Array, "p"]:
    """How probably tracks still exist, with a measurement at that cost; 1 by the paper."""
    if options.new_density_m2 is None or options.track_management.survival_s is None:
        return np.ones_like(existence)
    return existence_after_detection(np.maximum(existence, _LEAST_EXISTENCE), np.exp(-0.5 * cost))
