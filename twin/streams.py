"""Random streams: one per person, sensor and tracker, all from the scenario's seed."""

from __future__ import annotations

import hashlib
from operator import index

import numpy as np


def stream(seed: int, kind: str, name: str) -> np.random.Generator:
    """Make the generator of a person, sensor or tracker in a run with this seed.

    Its key is a stable hash of kind and name, so an added sensor or person changes no other stream. Raises TypeError for a
    seed that is no whole number: numpy would draw one for None.
    """
    seed = index(seed)
    digest = hashlib.sha256(f"{kind}/{name}".encode()).digest()
    key = tuple(int.from_bytes(digest[place : place + 4], "little") for place in range(0, 16, 4))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
