"""Pairs of people, by their ids: all of them, and those who are near each other."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Pair = tuple[int, int]


@lru_cache(maxsize=256)
def every_pair(count: int) -> NDArray[np.intp]:
    """The pairs of `count` people, (count · (count - 1) / 2, 2) of their places, first < second; not to be written to."""
    pairs = np.stack(np.triu_indices(count, k=1), axis=1)
    pairs.flags.writeable = False
    return pairs


def ordered_pairs(first: NDArray[np.integer], second: NDArray[np.integer]) -> list[Pair]:
    """Pairs of ids (m,), the smaller first."""
    return list(zip(np.minimum(first, second).tolist(), np.maximum(first, second).tolist(), strict=True))


def pairs_within(ids: NDArray[np.integer], place_m: NDArray[np.float64], limit_m: float) -> dict[Pair, float]:
    """Distance [m] of the pairs of people, by ids (n,) at places (n, 2) [m], that are less than `limit_m` apart."""
    first, second = every_pair(len(ids)).T
    apart = np.hypot(*(place_m[first] - place_m[second]).T)
    near = np.flatnonzero(apart < limit_m)
    return dict(zip(ordered_pairs(ids[first[near]], ids[second[near]]), apart[near].tolist(), strict=True))
