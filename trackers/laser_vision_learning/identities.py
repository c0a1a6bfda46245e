"""Identities after a split: people seen as one body by the scanners are separate bodies again.

The bodies of a group are assigned to its members one to one with the largest total score over a few pictures. The margin of
an identity is the loss by the best assignment that changes it (after Murty's ranking of assignments, 1968). With a smaller
margin, or without a classifier, motion assigns one of the remaining members, and `by_looks` is False.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field, PositiveInt
from scipy.optimize import linear_sum_assignment

from trackers.arrays import Array, Index, Mask
from trackers.configuration import Strict

_NONE = -1


class IdentityOptions(Strict):
    """Options of the decision after a split."""

    pictures: PositiveInt = Field(
        default=5, description="pictures over which scores are summed before it is decided (ours)"
    )
    margin: float = Field(
        default=0.1,
        ge=0,
        description="mean score that the next best must lose, from 0 to 4, for looks to decide; else motion does (ours)",
    )


@dataclass(frozen=True, eq=False)
class Identities:
    """Identities of q bodies of a group of m members."""

    member: Int[Index, "q"]  # −1: no member, as more bodies came out than went in
    by_looks: Bool[Mask, "q"]  # else by motion
    margin: Float[Array, "q"]  # loss by the next best assignment; 0 without appearance


def decided(
    scores: Float[Array, "q m"], motion_cost: Float[Array, "q m"], options: IdentityOptions | None = None
) -> Identities:
    """Return the identities by the mean score of each body by each member's classifier and the cost of its motion.

    Scores are NaN for an unknown classifier or body: without effect. Costs are −log of likelihoods, infinite if impossible.
    """
    options = options or IdentityOptions()
    q, m = scores.shape
    said = np.where(np.isfinite(scores), scores, 0.0)
    body, member = linear_sum_assignment(said, maximize=True)
    margin = np.zeros(q)
    best = said[body, member].sum()
    for each, of in zip(body, member, strict=True):  # few: as many as in the group
        without = said.copy()
        without[each, of] = -1e6
        margin[each] = (
            min(best - without[linear_sum_assignment(without, maximize=True)].sum(), 1e3) if m * q > 1 else 0.0
        )
    assigned = np.full(q, _NONE)
    assigned[body] = member
    sure = (assigned != _NONE) & (margin > 0) & (margin >= options.margin)
    found = np.where(sure, assigned, _NONE)
    left, free = np.flatnonzero(~sure), np.setdiff1d(np.arange(m), found)
    cost = np.where(np.isfinite(motion_cost), motion_cost, 1e6)[np.ix_(left, free)]
    by_motion, of = linear_sum_assignment(cost)
    found[left[by_motion]] = free[of]
    return Identities(found, sure, margin)
