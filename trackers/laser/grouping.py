"""One person, one measurement: arms go with their trunk, two legs become one person (ours; the paper is silent)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]


def distances(first: Array, second: Array) -> Array:
    """Distance between each of `first` (n, 2) and each of `second` (k, 2), (n, k) [m]."""
    difference = first[:, None] - second[None]
    return np.hypot(difference[..., 0], difference[..., 1])


def drop_satellites(position: Array, width_m: Array, satellite_width_m: float, reach_m: float) -> Mask:
    """Which of k clusters to keep, (k,): all but the narrow ones within reach of a wider one's axis.

    A hand or forearm at waist height is a narrow cluster beside, or in front of, its trunk. A person half hidden behind
    another is narrow too, but stands farther from the other's axis than an arm reaches.
    """
    narrow = width_m < satellite_width_m
    if not narrow.any() or narrow.all():
        return np.ones(len(width_m), np.bool_)
    near_trunk = (distances(position[narrow], position[~narrow]) < reach_m).any(axis=1)
    kept = np.ones(len(width_m), np.bool_)
    kept[np.flatnonzero(narrow)[near_trunk]] = False
    return kept


def group_legs(
    legs: Array, expected: Array, pair_m: float, stride_m: float, single_cost_m: float = 0.1
) -> tuple[Array, Mask]:
    """People (p, 2) from legs (k, 2), where people are expected at (n, 2) [m]; and who of them shows one leg only, (p,).

    Two legs up to `stride_m` apart (a full stride) become the middle between them, one leg may stand for a person whose other
    leg is hidden. Whoever is expected takes, nearest first, the pair or the single leg that puts them nearest to where they
    are expected, a single leg counting as `single_cost_m` farther. The legs that nobody expected pair off from the closest
    up, at most `pair_m` apart, so that two people side by side, whose own legs are closer to one another than to the
    neighbour's, stay two.
    """
    k = len(legs)
    if k == 0:
        return legs, np.empty(0, np.bool_)
    apart = distances(legs, legs)
    first, second = np.triu_indices(k, 1)
    stride = apart[first, second]
    within_stride = stride < stride_m
    first, second, stride = first[within_stride], second[within_stride], stride[within_stride]
    one, other = np.concatenate([np.arange(k), first]), np.concatenate([np.arange(k), second])
    middle = 0.5 * (legs[one] + legs[other])  # k single legs, then the pairs
    free = np.ones(k, np.bool_)
    people, single = [], []

    if len(expected):
        cost = distances(expected, middle)
        cost[:, :k] += single_cost_m
        waiting = np.ones(len(expected), np.bool_)
        who, what = np.nonzero(cost < 0.5 * stride_m + single_cost_m)
        nearest_first = np.argsort(cost[who, what], kind="stable")
        for person, choice in zip(who[nearest_first], what[nearest_first], strict=True):  # each choice depends on the last
            if waiting[person] and free[one[choice]] and free[other[choice]]:
                waiting[person] = free[one[choice]] = free[other[choice]] = False
                people.append(middle[choice])
                single.append(choice < k)

    closest_first = np.argsort(stride, kind="stable")
    for pair in closest_first[stride[closest_first] < pair_m]:
        if free[first[pair]] and free[second[pair]]:
            free[first[pair]] = free[second[pair]] = False
            people.append(middle[k + pair])
            single.append(False)
    one_legged = np.concatenate([np.array(single, np.bool_), np.ones(free.sum(), np.bool_)])
    return np.concatenate([np.reshape(people, (-1, 2)), legs[free]]), one_legged
