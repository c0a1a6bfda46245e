"""One person, one measurement: arms go with their trunk, two legs become one person (ours; the paper is silent)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import distances


def trunks(
    position: Float[Array, "k 2"],
    width_m: Float[Array, "k"],
    hidden: Bool[Mask, "k"],
    satellite_width_m: float,
    reach_m: float,
    arm_reach_m: float,
) -> Bool[Mask, "k"]:
    """Which of k clusters are trunks: the widest of every body's pieces.

    From the widest down, each cluster that is left is a trunk, and takes with it the narrow ones about its axis: up to
    `arm_reach_m` those that nothing hides, for a trunk in full view is never that narrow; up to `reach_m` those that are
    partly `hidden`, as the far side of a trunk is that the own arm cuts in two. Beyond, a narrow hidden cluster is
    somebody standing behind.
    """
    narrow = width_m < satellite_width_m
    kept = np.ones(len(width_m), np.bool_)
    if not narrow.any():
        return kept
    near = (distances(position, position) < np.where(hidden, reach_m, arm_reach_m)) & narrow
    near &= width_m <= width_m[:, None]
    np.fill_diagonal(near, False)
    for one in (-width_m).argsort(kind="stable").tolist():  # each choice depends on those before it
        if kept[one]:
            kept &= ~near[one]
    return kept


def take_legs(
    legs: Float[Array, "k 2"],
    expected: Float[Array, "n 2"],
    stride_m: float,
    reach_m: float,
    single_cost_m: float,
    wide_above_m: float = np.inf,
    wide_cost: float = 0.0,
) -> tuple[Float[Array, "n 2"], Int[Index, "n"], Bool[Mask, "k"]]:
    """Which legs are those of people expected at these places [m].

    Two legs up to `stride_m` apart (a full stride) stand for the middle between them; one leg may stand for a person whose
    other leg is hidden. Nearest first, everybody takes the pair or the single leg that puts them nearest to where they are
    expected, at most `reach_m` off, a single leg counting as `single_cost_m` farther, and a pair as `wide_cost` times what its
    legs are farther apart than `wide_above_m`: the wider, the likelier they are two people's.

    Returns the position of each person, how many legs each took, 0 leaving the position as expected, and which legs nobody
    took.
    """
    n, k = len(expected), len(legs)
    if n == 0 or k == 0:
        return expected.copy(), np.zeros(n, np.intp), np.ones(k, np.bool_)
    first, second, apart = _pairs(legs, stride_m)
    one, other = np.concatenate([np.arange(k), first]), np.concatenate([np.arange(k), second])
    middle = 0.5 * (legs[one] + legs[other])  # k single legs, then the pairs
    cost = distances(expected, middle)
    cost[:, :k] += single_cost_m
    cost[:, k:] += wide_cost * np.maximum(apart - wide_above_m, 0)
    who, what = (cost < reach_m).nonzero()
    nearest_first = cost[who, what].argsort(kind="stable")
    who, what = who[nearest_first], what[nearest_first]
    chosen, n_leg, free = {}, [0] * n, [True] * k
    rows = zip(who.tolist(), what.tolist(), one[what].tolist(), other[what].tolist(), strict=True)
    for person, choice, leg, other_leg in rows:  # each choice depends on those before it
        if person not in chosen and free[leg] and free[other_leg]:
            free[leg] = free[other_leg] = False
            chosen[person], n_leg[person] = choice, 1 if leg == other_leg else 2
    position = expected.copy()
    position[list(chosen)] = middle[list(chosen.values())]
    return position, np.array(n_leg), np.array(free)


def pair_off(legs: Float[Array, "k 2"], pair_m: float) -> tuple[Float[Array, "p 2"], Int[Index, "p"]]:
    """People from legs that nobody expected, and how many legs each has.

    Legs pair off from the closest up, at most `pair_m` apart, so that two people side by side, whose own legs are closer to
    one another than to the neighbour's, stay two.
    """
    if len(legs) < 2:
        return legs, np.ones(len(legs), np.intp)
    free = np.ones(len(legs), np.bool_)
    people = []
    first, second, apart = _pairs(legs, pair_m)
    closest_first = apart.argsort(kind="stable")
    for one, other in zip(first[closest_first].tolist(), second[closest_first].tolist(), strict=True):
        if free[one] and free[other]:
            free[one] = free[other] = False
            people.append(0.5 * (legs[one] + legs[other]))
    position = np.concatenate([np.reshape(people, (-1, 2)), legs[free]])
    return position, np.repeat(np.array([2, 1], np.intp), [len(people), free.sum()])


def _pairs(
    points: Float[Array, "k 2"], limit_m: float
) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"], Float[Array, "pairs"]]:
    """All pairs of points nearer than `limit_m`: first, second, distance."""
    apart = distances(points, points)
    first, second = (apart < limit_m).nonzero()
    once = first < second  # each pair once, nobody with themselves
    first, second = first[once], second[once]
    return first, second, apart[first, second]
