"""Random streams: one per person, sensor and tracker, all from the scenario's seed."""

from __future__ import annotations

import hashlib
from operator import index

import numpy as np

from trackers.errors import InputError


def stream(seed: int, kind: str, name: str) -> np.random.Generator:
    """Make the generator of a person, sensor or tracker in a run with this seed.

    Its key is a stable hash of kind and name, so an added sensor or person changes no other stream. Raises InputError for
    a seed that is no whole number from 0 on: numpy would draw one for None.
    """
    if not (hasattr(seed, "__index__") and index(seed) >= 0):
        raise InputError(f"seed is {seed!r}; a whole number from 0 on is expected")
    seed = index(seed)
    digest = hashlib.sha256(f"{kind}/{name}".encode()).digest()
    key = tuple(int.from_bytes(digest[place : place + 4], "little") for place in range(0, 16, 4))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
