"""People and tracks made at random, small enough that other people's programs say at once what they are worth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array

Ids = NDArray[np.int64]

ORDERS_AND_CUTOFFS = ((1.0, 1.0), (2.0, 0.7))
"""Of OSPA and GOSPA: the order, and the cut-off [m]."""


def sets() -> list[tuple[Array, Array]]:
    """40 pairs of people (n, 2) and tracks (m, 2) on the floor [m], some without people."""
    rng = np.random.default_rng(14)
    pairs = []
    for _ in range(40):
        n, m = rng.integers(0, 7), rng.integers(1, 7)
        people = rng.uniform(-2, 2, (n, 2))
        near = people[:m] + rng.normal(0, 0.3, (min(n, m), 2))
        pairs.append((people, np.concatenate([near, rng.uniform(-2, 2, (m - len(near), 2))])))
    return pairs


def similarities() -> list[tuple[Ids, Ids, Array]]:
    """80 frames of people's ids (n,), tracks' ids (m,) and similarities (n, m): tracks are missing, swap, and are renamed."""
    rng = np.random.default_rng(15)
    swapped = np.array([1, 0, 2, 3, 5, 4])
    frames = []
    for k in range(80):
        there = np.flatnonzero(rng.random(6) < 0.9)
        followed = np.flatnonzero(rng.random(6) < 0.85)
        who = swapped[followed] if k >= 40 else followed
        apart = (there[:, None] != who[None, :]) * rng.uniform(0.2, 2, (there.size, followed.size))
        distance = np.abs(rng.normal(0, 0.25, apart.shape)) + apart
        track_ids = followed + 10 + 10 * (followed == 3) * (k >= 60)
        frames.append((there + 1, track_ids, np.maximum(0, 1 - distance)))
    return frames
