"""Identities after a split: people that the scanners saw as one body are separate bodies again.

What comes out of a group is given to its members one to one, so that the scores of all, summed over a few pictures, are
highest together. How sure each is, is what the next best assignment that gives it to somebody else would lose (after Murty's
ranking of assignments, 1968). Who is less sure than that, or has no classifier, is given by motion to a member that is left,
and that is told.
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
    """Identities of q bodies that came out of a group of m."""

    member: Int[Index, "q"]  # −1: nobody of the group, as more came out than went in
    by_looks: Bool[Mask, "q"]  # else by motion
    margin: Float[Array, "q"]  # what the next best assignment loses; 0 where looks say nothing


def decided(
    scores: Float[Array, "q m"], motion_cost: Float[Array, "q m"], options: IdentityOptions | None = None
) -> Identities:
    """The identities, from the mean score of each body by each member's classifier and the cost of its motion.

    Scores are NaN where a classifier or a body is unknown: such an entry speaks neither for nor against. Costs are −log of
    likelihoods, infinite where it cannot be.
    """
    options = options or IdentityOptions()
    q, m = scores.shape
    said = np.where(np.isfinite(scores), scores, 0.0)
    body, member = linear_sum_assignment(said, maximize=True)
    margin = np.zeros(q)
    best = said[body, member].sum()
    for each, of in zip(body, member, strict=True):  # few: as many as are in the group
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
