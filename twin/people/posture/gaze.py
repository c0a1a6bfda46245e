"""Heads that look about freely: now here, now there, a little into turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers.arrays import Array

_SPREAD_RAD = 0.3
_MOST_RAD = 0.8
_LOOKS_FOR_S = (0.8, 3.0)


class FreeGaze:
    """Where n people look who look at nothing in particular, as an angle from their heading, each by a generator of their own."""

    def __init__(self, random: Sequence[np.random.Generator]) -> None:
        self._random = random
        self._angle = np.zeros(len(random))
        self._until = np.zeros(len(random))

    def at(self, t: float) -> Array:
        """The angles (n,) [rad] at time t [s]; times must grow."""
        over = t >= self._until
        if over.any():
            for place in np.flatnonzero(over).tolist():
                rng = self._random[place]
                self._angle[place] = np.clip(rng.normal(0.0, _SPREAD_RAD), -_MOST_RAD, _MOST_RAD)
                self._until[place] = t + rng.uniform(*_LOOKS_FOR_S)
        return self._angle
