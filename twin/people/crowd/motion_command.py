"""Command to one person's body on the floor, valid until the next: go, stand, turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array

End = Literal["arrived", "time", "done", "taken", "blocked"]
"""Reason for which a command ended: goal reached, time over, its own condition met, goal occupied by another, or way
blocked.
"""


@dataclass(frozen=True)
class MotionCommand:
    """Walk or run to `goal` [m] at `speed_m_s`, or stand (goal None), until time `until` [s], arrival, or `done()`.

    `arrive_m`: distance that counts as arrival; `halt`: slow down to stop at the goal instead of passing it; `heading`:
    direction to face [rad], None: that of motion. A walker with a heading steps sideways and backwards; a standing person
    turns on the spot. `near`: names of furniture that may be approached closely, for the last steps to a seat, bed or shelf;
    `immovable`: do not give way, as people who sit, lie or bend; `companions`: indices of people without mutual repulsion,
    who may come as near abreast as `companion_m` [m] with arms held in; `keeps_step`: count on companions to walk on, and
    follow as closely as they stand.
    """

    goal: tuple[float, float] | None
    speed_m_s: float = 0.0
    until: float = inf
    arrive_m: float = 0.25
    halt: bool = False
    heading: float | None = None
    near: frozenset[str] = frozenset()
    immovable: bool = False
    companions: tuple[int, ...] = ()
    companion_m: float = inf
    keeps_step: bool = False
    done: Callable[[], bool] | None = None


@dataclass(frozen=True, eq=False)
class SeenBases:
    """Influence of m bases on n people: push (n,) [m/s²] and directions (n, m), complex; limits of approach (n, m) [m/s]."""

    push: NDArray[np.complex128]
    towards: NDArray[np.complex128]
    limit: Array


class Bases(Protocol):
    """Bases that drive among people (`twin.people.crowd.bases.MovingBases`)."""

    def seen_from(self, place: NDArray[np.complex128], braking: Array) -> SeenBases:
        """Return the influence of the bases on people at these places (n,), who brake at most by `braking` (n,) [m/s²]."""
        ...
