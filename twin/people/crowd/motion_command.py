"""A command to one person's body on the floor, which holds until the next: go, stand, turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Literal

End = Literal["arrived", "time", "done", "taken", "blocked"]
"""Reason for which a command ended: the goal is reached, its time is over, its own condition holds, somebody else is at the
goal, or the way is blocked."""


@dataclass(frozen=True)
class MotionCommand:
    """Walk or run to `goal` [m] at `speed_m_s`, or stand (goal None), until time `until` [s], arrival, or what `done` tells.

    `arrive_m`: how near counts as having arrived; `halt`: slow down to stop at the goal instead of passing it; `heading`:
    where to face meanwhile [rad], None: where one goes. Who goes and holds a heading steps sideways and backwards; who
    stands turns on the spot. `near`: furniture by name that may be come up to closely, for the last steps to a seat, a bed
    or a shelf; `immovable`: do not give way to others, as people who sit, lie or bend do not; `companions`: the numbers of
    those whom one walks with: they and the person do not feel each other's repulsion, and abreast they may come as near as
    `companion_m` [m], with their arms held in; `keeps_step`: the person counts on companions to walk on, and follows as
    closely as they stand.
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
