"""Points of low scanners: their soft shares among people, the likelihood of predicted legs, and points that no person explains.

A point belongs to the nearest of the predicted people, softly: with d the distance to a person's nearer expected leg, its share
in person p is exp(−½ d_p² / s²) / (Σ_q exp(−½ d_q² / s²) + exp(−½ g² / s²)), the last term standing for an unknown person at the
gate g. A particle's likelihood is the similarity of its two legs with the points of its person,

    log L = − k/2 Σ_i w_i min(d_i², c²) / σ²

d_i the distance of point i to the nearer leg, w_i its share times the width of the leg that its beam covers (in legs): a leg
near by is met by many beams and tells no more than a far one; what lies farther than c is another's or no person's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Float, Index, Int
from trackers.configuration import Strict
from trackers.filters.gating import distances, linked
from trackers.laser.group import Points


class PointOptions(Strict):
    """Options of the comparison of laser points with predicted legs."""

    sigma_m: float = Field(
        default=0.06, gt=0, description="standard deviation of a point about its leg's axis [m] (ours)"
    )
    cut_m: float = Field(
        default=0.25, gt=0, description="distance from a leg beyond which a point tells nothing more [m] (ours)"
    )
    weight: float = Field(
        default=2.0, gt=0, description="how many independent measurements a whole leg counts for (ours)"
    )
    gate_m: float = Field(
        default=0.45,
        gt=0,
        description="distance from every expected leg at which a point is as likely no known person's [m] (ours)",
    )
    own_m: float = Field(
        default=0.3,
        ge=0,
        description="points this near to a surer person are no other one's [m]; 0: they are shared (ours)",
    )
    link_m: ClassVar[float] = 0.4
    """Distance by which unexplained points are linked to one new person [m] (ours)."""
    leg_m: ClassVar[float] = 0.1
    """Width of a leg at the scanner's height [m]."""
    soft_m: ClassVar[float] = 0.12
    """Standard deviation by which points are shared between two nearby people [m]."""
    most: ClassVar[int] = 32
    """Greatest number of points per person, by weight."""
    new_points: ClassVar[int] = 2
    """Number of points of a new person: a beam on an edge may lie behind a known one."""


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of the points of a frame among people."""

    share: Float[Array, "n k"]  # of each point in each person, sums over people to at most 1
    weight: Float[Array, "k"]  # share of a leg's width that each beam covers
    legs: Float[Array, "n"]  # leg widths of the points nearest to each person, without a surer person there

    @property
    def owner(self) -> Int[Index, "k"]:
        """Index of the person with the largest share of each point, −1 if an unknown person's is larger."""
        if len(self.share) == 0:
            return np.full(self.weight.size, -1)
        return np.where(self.unknown < 0.5, self.share.argmax(axis=0), -1)

    @property
    def unknown(self) -> Float[Array, "k"]:
        """Share of each point that belongs to no known person."""
        return 1 - self.share.sum(axis=0)


def shares(
    points: Points, legs: Float[Array, "2 2 n"], options: PointOptions, missing_s: Float[Array, "n"] | None = None
) -> Shares:
    """Share the points among people, by their expected legs (side, x or y, person) [m].

    missing_s: time without measurement of each [s], infinite for unconfirmed ones (None: all equal). A person has no share
    in points near another who is missing for less: a hidden person's particles would otherwise follow passers-by.
    """
    off = points.place[:, :, None] - legs[:, None]  # (side, k, xy, n)
    square = (off**2).sum(axis=2).min(axis=0).T
    likeness = np.exp(-square / (2 * options.soft_m**2))
    unknown = np.exp(-(options.gate_m**2) / (2 * options.soft_m**2))
    weight = np.minimum(points.width_m / options.leg_m, 1.0)
    if likeness.size == 0:
        return Shares(likeness, weight, np.zeros(len(likeness)))
    missing_s = np.zeros(len(likeness)) if missing_s is None else missing_s
    off = points.place.T[:, None] - legs.mean(axis=0)[:, :, None]  # (xy, n, k): bodies keep apart, legs do not
    beside = (off**2).sum(axis=0) < options.own_m**2
    likeness[(missing_s[:, None] > missing_s) @ beside] = 0.0
    share = likeness / (likeness.sum(axis=0) + unknown)
    first = missing_s.argsort(kind="stable")
    own = (share == share.max(axis=0)) & (square < options.gate_m**2)
    own[first[1:]] &= ~np.logical_or.accumulate(beside[first], axis=0)[:-1]
    return Shares(share, weight, own @ weight)


def log_likelihood(
    points: Points, whose: Shares, legs: Float[Array, "2 2 n p"], options: PointOptions
) -> Float[Array, "n p"]:
    """Return ln L of each particle's legs (side, x or y, person, particle) [m], up to a constant per person."""
    weight = whose.share * whose.weight
    count = min(int((weight > 0.01).sum(axis=1).max(initial=0)), options.most)
    if count == 0:
        return np.zeros(legs.shape[2:])
    chosen = np.argpartition(-weight, min(count, weight.shape[1]) - 1, axis=1)[:, :count]  # (n, k)
    weight = np.take_along_axis(weight, chosen, axis=1).astype(np.float32)
    origin = legs[:, :, :, :1].mean(axis=0)  # (xy, n, 1): small numbers keep single precision far below a millimetre
    place = (points.place.T[:, chosen] - origin).astype(np.float32)  # (xy, n, k)
    near = (legs - origin).astype(np.float32)
    # d² = |leg|² + |point|² − 2 leg·point, as one product of matrices
    of_legs = np.stack([near[:, 0], near[:, 1], (near**2).sum(axis=1), np.ones_like(near[:, 0])], axis=-1)
    of_points = np.stack([-2 * place[0], -2 * place[1], np.ones_like(place[0]), (place**2).sum(axis=0)], axis=1)
    left, right = of_legs @ of_points  # (n, p, k) each
    square = np.minimum(np.minimum(left, right, out=left), np.float32(options.cut_m**2), out=left)
    scale = -options.weight / (2 * options.sigma_m**2)
    return scale * (square @ weight[..., None])[..., 0].astype(float)


def unexplained_people(points: Points, unknown: Float[Array, "k"], options: PointOptions) -> tuple[Array, Array]:
    """Return positions (m, 2) [m] formed by unexplained points of all scanners, and their leg widths of points, (m,).

    Points that are all `alone` form nobody: none of them tells its range.
    """
    free = points.select(unknown > 0.5)
    place, weight = free.place, np.minimum(free.width_m / options.leg_m, 1.0)
    if len(place) == 0:
        return place, weight
    points_of = linked(distances(place, place) < options.link_m) == np.arange(len(place))[:, None]
    is_person = (points_of.sum(axis=1) >= options.new_points) & (points_of & ~free.alone).any(axis=1)
    points_of = points_of[is_person].astype(float)
    total = points_of @ weight
    return points_of @ (weight[:, None] * place) / total[:, None], total
