"""One measurement per person: arms are merged with their trunk, two legs with one another (ours; the paper is silent)."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, max_weight_assignment

STRIDE_M = 0.8
"""Greatest distance between the two legs of a tracked person [m]: a runner's, at knee height."""
PAIR_M = 0.5
"""Distance below which two legs without a track are one person's [m]."""


def trunks(
    position: Float[Array, "k 2"],
    width_m: Float[Array, "k"],
    hidden: Bool[Mask, "k"],
    satellite_width_m: float,
    reach_m: float,
    arm_reach_m: float,
    apart_m: float,
) -> Bool[Mask, "k"]:
    """Return a mask of the k clusters that are trunks: the widest part of every body.

    From the widest down, each remaining cluster is a trunk, and absorbs all within `apart_m`, where no other person can
    stand, and narrow ones about its axis: up to `arm_reach_m` those in full view, as a visible trunk is never so narrow; up
    to `reach_m` partly `hidden` ones, such as the far side of a trunk divided by its own arm. Beyond, a narrow hidden
    cluster is a person behind.
    """
    apart, kept = distances(position, position), np.ones(len(width_m), np.bool_)
    near = (apart < np.where(hidden, reach_m, arm_reach_m)) & (width_m < satellite_width_m)
    near |= apart < apart_m
    near &= width_m <= width_m[:, None]
    np.fill_diagonal(near, False)
    if not np.count_nonzero(near):
        return kept
    for one in (-width_m).argsort(kind="stable").tolist():  # each choice depends on those before it
        if kept[one]:
            kept &= ~near[one]
    return kept


def take_legs(
    legs: Float[Array, "k 2"],
    both_together: Bool[Mask, "k"],
    expected: Float[Array, "n 2"],
    reach_m: Float[Array, "n"] | float,
    stride_m: float,
    opposite: Float[Array, "n"] | float = 0.0,
    forbidden: Bool[Mask, "n k"] | None = None,
) -> tuple[Float[Array, "n 2"], Int[Index, "n"], Bool[Mask, "k"]]:
    """Assign legs to people expected at these places [m], two to each, by least squares.

    The two legs of a person are at most `reach_m` from it and `stride_m` apart; one cluster may be `both_together`. An
    unassigned leg costs as much as one at `reach_m`: the likeliest assignment for legs distributed as a Gaussian about
    bodies. So each leg goes to the nearest person, unless that one has two nearer legs. All but the nearest of each person
    are then assigned once more: as second legs by the distance from their position predicted by the first, and as first ones
    to a person without any. opposite: minus the correlation of a person's two legs about the place, below 1; 0 if both may
    be on one side, as of a sitting person. forbidden: impossible pairs.

    Returns the position of each person, the middle of their legs; the number of legs of each, 0 leaving the position as
    expected; and a mask of the unassigned legs.
    """
    n, k = len(expected), len(legs)
    position, n_leg, free = expected.copy(), np.zeros(n, np.intp), np.ones(k, np.bool_)
    if n == 0 or k == 0:
        return position, n_leg, free
    away = distances(expected, legs)
    if forbidden is not None:
        away[forbidden] = np.inf
    reach, against = ((np.zeros(n) + each)[:, None] for each in (reach_m, opposite))
    worth = reach**2 - away**2
    places, leg = max_weight_assignment(np.concatenate([worth, worth]))
    person = places % n
    farthest_first = away[person, leg].argsort(kind="stable")[::-1]
    nearest = np.full(n, -1)
    nearest[person[farthest_first]] = leg[farthest_first]  # the last written stays
    person = (nearest >= 0).nonzero()[0]
    first = nearest[person]
    position[person], n_leg[person], free[first] = legs[first], 1 + both_together[first], False

    others = free.nonzero()[0]
    place, spread, near = expected.copy(), np.ones((n, 1)), np.isfinite(away[:, others])
    place[person] += against[person] * (expected[person] - legs[first])
    spread[person] = np.sqrt(1 - against[person] ** 2)
    near[person] &= distances(legs[first], legs[others]) < stride_m
    off = distances(place, legs[others]) / spread
    person, column = max_weight_assignment(np.where(near, reach**2 - off**2, 0.0))
    also, had = others[column], n_leg[person] > 0
    position[person] = np.where(had[:, None], 0.5 * (position[person] + legs[also]), legs[also])
    n_leg[person], free[also] = 1 + (had | both_together[also]), False
    return position, n_leg, free


def pair_off(
    legs: Float[Array, "k 2"], pair_m: float, sufficient: Bool[Mask, "k"] | None = None
) -> tuple[Float[Array, "p 2"], Int[Index, "p"]]:
    """Return people from unassigned legs, and the number of legs of each.

    Legs are paired from the closest up, at most `pair_m` apart, so that two people side by side, whose own legs are closer
    than the neighbours', stay two. sufficient: legs that count as a person even alone (None: all).
    """
    if not len(legs):
        return legs, np.empty(0, np.intp)
    free = np.ones(len(legs), np.bool_)
    people = []
    first, second, apart = _pairs(legs, pair_m)
    closest_first = apart.argsort(kind="stable")
    for one, other in zip(first[closest_first].tolist(), second[closest_first].tolist(), strict=True):
        if free[one] and free[other]:
            free[one] = free[other] = False
            people.append(0.5 * (legs[one] + legs[other]))
    if sufficient is not None:
        free &= sufficient
    position = np.concatenate([np.reshape(people, (-1, 2)), legs[free]])
    return position, np.repeat(np.array([2, 1], np.intp), [len(people), free.sum()])


def _pairs(
    points: Float[Array, "k 2"], limit_m: float
) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"], Float[Array, "pairs"]]:
    """Return all pairs of points nearer than `limit_m`: first, second, distance."""
    apart = distances(points, points)
    first, second = (apart < limit_m).nonzero()
    once = first < second  # each pair once
    first, second = first[once], second[once]
    return first, second, apart[first, second]
