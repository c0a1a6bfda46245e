"""Likelihoods of trunks at waist height and of legs at knee height, about the positions that the modes of a filter predict.

A trunk is a body's axis from a scanner's cluster. Legs are jointly assigned to the trunks above them and to people without a
trunk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.gating import distances, mahalanobis_distances, validation_region
from trackers.filters.imm import ImmState
from trackers.laser.clusters import PAIR_M, STRIDE_M, Detections, pair_off, take_legs
from trackers.tracking.track_manager import clear_of


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


BOTH_LEGS_M = 0.18
"""Width above which a cluster is both legs, side by side [m]: twice a leg, measured in the twin."""
_TRUNK_GATE_M = 0.5
"""Distance of a leg from where a trunk's legs were before, up to which it may belong to it [m]: half a stride."""
_OPPOSITE = 0.3
"""Minus the correlation of the places of a person's two legs about the prediction, where no trunk is seen: a stride puts one
before it and one behind, an error of the prediction both on one side. Measured in the twin."""

_BEHIND_M = 0.045
"""Distance of the middle of the legs behind a single leg, seen from its scanner: a leg hides what is behind it [m]. Measured in
the twin."""

_LEAN, _UPRIGHT_M = 0.43, 0.26
"""Lean of the shanks of who walks, and the height at which they are under the body's axis [m].

Measured in the twin at 0.7 to 1.5 m/s, from 0.25 to 0.45 m: the mean of both legs over the gait.
"""
_STANDS_LEAN = 0.08
"""Lean of the shanks of who stands, from the floor up, on the way walked last: knees are bent a little, and people turn on the
spot. Measured in the twin."""
_WALK_M_S = 0.8
"""Speed from which people walk at full stride [m/s]."""


class LegOptions(Strict):
    """Options of how exactly legs show their person, and which legs are one person's."""

    assignment: Literal["joint", "nearest"] = Field(
        default="joint",
        description="legs are shared out, two to each person, in one assignment (ours); or each group of knees is one person's, "
        "the nearest to it by the global nearest neighbour (the paper)",
    )
    variance_m2: float = Field(
        default=0.0045,
        gt=0,
        description="variance of the middle of two legs about the body, on each axis, since a trunk sways over them [m²] (ours, "
        "measured; the paper: 0.01)",
    )
    single_leg_variance_m2: float = Field(
        default=0.007,
        ge=0,
        description="variance added for a single leg, which is up to half a stride from the body [m²] (ours, measured)",
    )
    shanks_lean: bool = Field(
        default=True,
        description="whether the middle of the legs is before the body's axis, on the way that the person walked last, the more "
        "the higher the scanner looks: shanks lean forward (ours, measured)",
    )
    pair_m: float = Field(
        default=PAIR_M,
        ge=0,
        description="distance below which two legs that no track takes are one person, and then a single leg initiates no track "
        "where waists are scanned [m]; 0: each leg is a person (ours)",
    )
    single_leg_s: float = Field(
        default=0.3,
        gt=0,
        description="without a waist scanner, time in which all looks upon a single leg together tell what one tells: it stays "
        "behind the body or before it while it stands [s] (ours)",
    )
    start_apart_m: float = Field(
        default=STRIDE_M,
        ge=0,
        description="a leg, or knees without a trunk where waists are scanned, nearer than this to a track initiates none [m]: "
        "they may be its person's: a stride (the paper is silent)",
    )
    gate_m: float = Field(default=0.5, gt=0, description="radius of the validation region of legs [m] (the paper's)")
    gate_alone_m: float = Field(
        default=0.65,
        gt=0,
        description="the same without a waist scanner, where a single leg may be half a runner's stride from the body [m] (ours)",
    )


@dataclass(frozen=True, eq=False)
class LegPairs:
    """People as their legs alone show them, and the middle of the legs under each of k trunks."""

    position: Float[Array, "p 2"]  # [m]
    n_leg: Int[Index, "p"]
    under_trunk: Float[Array, "k 2"]  # [m], NaN where not both are seen
    owner: Int[Index, "p"]  # the person without a trunk whose legs were expected there, −1 of new ones
    n_sample: Int[Index, "p"]  # of the better seen leg of a new one; 0 of known ones, and where legs are grouped

    @property
    def of_known(self) -> Bool[Mask, "p"]:
        """Mask of the legs that were expected, of a person who is known."""
        return self.owner >= 0

    def likelihood(self, options: LegOptions, gate_m: float) -> PositionLikelihood:
        """Return the likelihood of these people's positions, in validation regions of this radius [m]."""
        return PositionLikelihood(self.position, options.variance_m2 + self._single_m2(options), gate_m)

    def _single_m2(self, options: LegOptions) -> Float[Array, "p"]:
        return np.where(self.n_leg == 1, options.single_leg_variance_m2, 0.0)


def full_stride(speed_m_s: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return the share of a full stride at these speeds."""
    return np.minimum(speed_m_s / _WALK_M_S, 1.0)


def legs_ahead_m(speed_m_s: Float[Array, "n"], height_m: float, options: LegOptions) -> Float[Array, "n"]:
    """Return how far the middle of the legs of n upright people is before the body's axis [m], scanned at this height [m]."""
    if not options.shanks_lean:
        return np.zeros_like(speed_m_s)
    lean_m = max(_LEAN * (height_m - _UPRIGHT_M), 0.0)
    walks = full_stride(speed_m_s)
    return walks * lean_m + (1 - walks) * _STANDS_LEAN * height_m


def pair_legs(
    legs: Detections,
    sufficient: Bool[Mask, "l"],
    under_trunks: Float[Array, "k 2"],
    expected: Float[Array, "h 2"],
    knees: Float[Array, "h 2"],
    apart_m: float,
    gate_m: float,
    options: LegOptions,
    lines: Float[Array, "l s 2"] | None = None,
    shown: Bool[Mask, "h"] | None = None,
) -> LegPairs:
    """Share l legs out, two to each, among k trunks and h people that no trunk shows, in one assignment.

    sufficient: the legs that enough samples show to initiate a track; under_trunks: where each trunk's legs are expected [m];
    expected: where the people are, and knees: where their legs are from there [m]; apart_m: a third leg so near to a trunk's is
    a bag, and no other person's; gate_m: how far from there the people's legs may be; lines: unit vectors to the legs from the
    scanners that see each, 0 from others, behind which the other leg of a single one is; shown: of the people, those of whom
    a trunk was measured lately, to whom the same holds. Legs that neither takes pair off.
    """
    place, wide = legs.position, legs.width_m > BOTH_LEGS_M
    n_trunk, n_person = len(under_trunks), len(expected)
    shown = np.zeros(n_person, np.bool_) if shown is None else shown
    bodies = np.concatenate([under_trunks, (expected + knees)[shown]])
    at_trunks = distances(bodies, place).min(axis=0, initial=np.inf) <= apart_m
    forbidden = np.zeros((n_trunk + n_person, len(place)), np.bool_)
    forbidden[n_trunk:][~shown] = at_trunks
    counts = [n_trunk, n_person]
    reach_m, opposite = (np.array(each).repeat(counts) for each in ([_TRUNK_GATE_M, gate_m], [0.0, _OPPOSITE]))
    position, n_leg, free = take_legs(
        place, wide, np.concatenate([under_trunks, expected + knees]), reach_m, STRIDE_M, opposite, forbidden
    )
    # one leg is up to half a stride from the middle
    under = np.where(n_leg[:n_trunk, None] == 2, position[:n_trunk], np.nan)
    taking = n_leg[n_trunk:] > 0
    free &= ~at_trunks
    new, n_leg_of_new = pair_off(place[free], options.pair_m, sufficient[free])
    middle, n_leg_of_known = position[n_trunk:][taking] - knees[taking], n_leg[n_trunk:][taking]
    single = n_leg_of_known == 1
    if lines is not None and np.count_nonzero(single):
        leg = distances(position[n_trunk:][taking][single], place).argmin(axis=1)
        middle[single] += _BEHIND_M * mean_line(lines[leg])
    owner = np.concatenate([taking.nonzero()[0], np.full(len(new), -1)])
    own = distances(new, place) <= 0.5 * options.pair_m
    n_sample = np.concatenate([np.zeros_like(n_leg_of_known), (own * legs.n_sample).max(axis=1, initial=0)])
    n_leg = np.concatenate([n_leg_of_known, n_leg_of_new])
    return LegPairs(np.concatenate([middle, new]), n_leg, under, owner, n_sample)


def may_be_new(
    position: Float[Array, "k 2"],
    is_part: Bool[Mask, "k"],
    free: Bool[Mask, "k"],
    known: Float[Array, "n 2"],
    apart_m: float,
) -> Bool[Mask, "k"]:
    """Return which of the `free` positions [m] may initiate a track.

    Parts of people, as single legs, are likelier one's who is known or starts in the same frame: two scanners may show one
    leg twice. known: where people are known to be [m]; apart_m: how far from them and from others who start parts are.
    """
    free = free & (~is_part | clear_of(position, known, apart_m))
    for one in np.flatnonzero(free & is_part):
        earlier = free & (~is_part | (np.arange(free.size) < one))
        free[one] = clear_of(position[one, None], position[earlier], apart_m)[0]
    return free


def mean_line(lines: Float[Array, "k s 2"]) -> Float[Array, "k 2"]:
    """Return the mean of unit vectors from the scanners that see a thing, 0 from others (`Detections.sight_lines`)."""
    return lines.sum(axis=1) / np.maximum(lines.any(axis=2).sum(axis=1), 1)[:, None]


class TrunkOptions(Strict):
    """Options of the accuracy of trunks, and their greatest distance from a prediction."""

    variance_m2: float = Field(
        default=0.0001,
        gt=0,
        description="variance of a trunk's place on each axis, beside that of its outline [m²] (ours, measured; the paper: 0.01)",
    )
    gate_m: float = Field(default=1.0, gt=0, description="radius of the validation region of trunks [m] (the paper's)")
    standing_m: ClassVar[float] = 0.012
    """Standard deviation, on each axis, of an error that trunks of who stands keep, beyond the filter's: the outline stays the
    same [m]. Measured in the twin."""


def trunk_likelihood(trunks: Detections, options: TrunkOptions) -> PositionLikelihood:
    """Return the likelihood of k trunks, each with the variance of its outline too."""
    return PositionLikelihood(trunks.position, options.variance_m2 + trunks.variance_m2, options.gate_m)
