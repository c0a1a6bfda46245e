"""Minimum-jerk profiles: movements from one value to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array

PEAK_RATE = 1.875
"""Peak rate of a minimum-jerk movement relative to its mean rate."""


def minimum_jerk(progress: ArrayLike, begin: float | Array = 0.0, end: float | Array = 1.0) -> Array:
    """Return the share of the way, 0 to 1, at a progress from `begin` to `end`: 10 p³ - 15 p⁴ + 6 p⁵.

    Source: T. Flash and N. Hogan, "The coordination of arm movements: an experimentally confirmed mathematical model",
    Journal of Neuroscience 5, 1985.
    """
    p = np.minimum(np.maximum((np.asarray(progress, dtype=float) - begin) / (end - begin), 0.0), 1.0)
    return np.minimum(p * p * p * (10.0 + p * (6.0 * p - 15.0)), 1.0)  # rounding ends up to 7e-16 beyond


class MinimumJerkProfile:
    """Values (k, n) of n people that move to goals along minimum-jerk profiles."""

    def __init__(self, size: int, count: int) -> None:
        self.value = np.zeros((size, count))
        self.moving = np.zeros(count, dtype=bool)
        self._start = np.zeros((size, count))
        self._goal = np.zeros((size, count))
        self._progress = np.ones(count)
        self._duration = np.ones(count)

    def go(self, person: int, goal: ArrayLike, duration_s: float) -> None:
        """Send one person's values (k,) from the present to a goal."""
        self._start[:, person] = self.value[:, person]
        self._goal[:, person] = goal
        self._duration[person] = duration_s
        self._progress[person] = 0.0
        self.moving[person] = True

    def put(self, person: int, value: ArrayLike) -> None:
        """Set one person's values (k,) at once."""
        self.value[:, person] = self._start[:, person] = self._goal[:, person] = value
        self._progress[person] = 1.0
        self.moving[person] = False

    def goal(self, person: int) -> Array:
        """Return the goal of one person's values, (k,)."""
        return self._goal[:, person].copy()

    def step(self, dt: float) -> None:
        """Move by dt [s]."""
        if not self.moving.any():
            return
        self._progress = np.minimum(self._progress + dt / self._duration, 1.0)
        share = minimum_jerk(self._progress)
        # a reached goal is met to the bit
        self.value = np.where(self._progress >= 1.0, self._goal, self._start + share * (self._goal - self._start))
        self.moving = self._progress < 1.0
