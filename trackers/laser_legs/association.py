"""Association of legs with people: two legs to each, by likelihood, and the places that they measure."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser.grouping import STRIDE_M

_LEG_M = 0.2
"""Standard deviation of a leg about its person, on each axis [m]."""
_OTHERS_PER_M2 = 0.1
"""Density of clusters that are not this person's legs."""
_MOST = 2.0
"""More evidence says nothing about whose leg it is: another person's leg has it as well [nat]."""


def assigned(
    expected: Float[Array, "n 2"], spread_m: Float[Array, "n"], reach_m: Float[Array, "n"], legs: Float[Array, "k 2"],
    evidence: Float[Array, "k"],
) -> Int[Index, "k"]:  # fmt: skip
    """Assign legs to people by likelihood, two to each; return the person of each leg, −1: nobody's.

    A leg is worth ln p(place | this person's) / p(place | anything else's), and its evidence. spread_m: standard deviation of the
    expected places, on each axis: who was not seen for a while takes no leg from one who is known to stand there. Worth nothing,
    or out of reach, a leg is nobody's. Of two legs farther apart than a stride the one worth less is set free.
    """
    n, owner = len(expected), np.full(len(legs), -1)
    if n == 0 or len(legs) == 0:
        return owner
    away = distances(expected, legs)
    variance = _LEG_M**2 + spread_m[:, None] ** 2
    worth = -0.5 * away**2 / variance - np.log(2 * np.pi * variance * _OTHERS_PER_M2) + np.minimum(evidence, _MOST)
    worth = np.where(away < reach_m[:, None], np.maximum(worth, 0.0), 0.0)
    slot, leg = max_weight_assignment(np.tile(worth, (2, 1)))
    owner[leg] = slot % n
    for person in np.flatnonzero(np.bincount(owner[leg], minlength=n) == 2):
        one, other = np.flatnonzero(owner == person)
        if np.hypot(*(legs[one] - legs[other])) > STRIDE_M:
            owner[one if worth[person, one] < worth[person, other] else other] = -1
    return owner


def measured_places(
    owner: Int[Index, "k"], places: Float[Array, "k 2"], evidence: Float[Array, "k"]
) -> tuple[Int[Index, "p"], Float[Array, "p 2"], Int[Index, "p"], Int[Index, "p"], Bool[Mask, "p"]]:
    """Return the people with legs, their places by evidence, the better leg of each, the other one, and who has both."""
    legs = np.flatnonzero(owner >= 0)
    legs = legs[np.lexsort((-evidence[legs], owner[legs]))]
    track, index, count = np.unique(owner[legs], return_index=True, return_counts=True)
    both = count == 2
    first = legs[index]
    other = legs[np.minimum(index + both, len(legs) - 1)] if len(legs) else legs
    weight = 1 / (1 + np.exp(-evidence))
    share = np.where(both, weight[other] / (weight[first] + weight[other]), 0.0)[:, None]
    position = (1 - share) * places[first] + share * places[other]
    return track, position, first, other, both
