"""What a person wants next: the scripts of a scenario as sequences of orders."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.rig import Point2
from twin.scenario.people import Person, Stand, Walk, Wander

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Order:
    """Walk to `goal` [m] at `speed_m_s`, or stand still (goal None), until time `until` [s] or arrival.

    `arrive_m`: how near counts as having arrived; `halt`: slow down to stop at the goal instead of passing it.
    """

    goal: tuple[float, float] | None
    speed_m_s: float = 0.0
    until: float = inf
    arrive_m: float = 0.25
    halt: bool = False


class Script(Protocol):
    """A person's intentions; `next_order` is asked at the start, when an order ends, and when the way is blocked."""

    def next_order(self, t: float, here: Array, others: Array) -> Order:
        """The order from time t [s] on, for a person at `here` (2,) with the others at (k, 2) [m]."""
        ...


def script_of(person: Person, area: Array, rng: np.random.Generator) -> Script:
    """The script a scenario gives a person; `area` (k, 2) [m] is where a wanderer's goals lie."""
    match person.script:
        case Wander() as wander:
            return WanderScript(wander, area, rng)
        case Walk() as walk:
            return WalkScript(walk)
        case Stand():
            return StandScript()


class StandScript:
    """Stand still for ever."""

    def next_order(self, t: float, here: Array, others: Array) -> Order:
        """Stand."""
        return Order(None)


class WalkScript:
    """From waypoint to waypoint; the last one is stood at, unless the walk repeats."""

    _PASS_M = 0.2
    _HALT_M = 0.05

    def __init__(self, walk: Walk) -> None:
        self._walk = walk
        self._next = 0

    def next_order(self, t: float, here: Array, others: Array) -> Order:
        """To the next waypoint, or stand."""
        walk, place = self._walk, self._next
        if place >= len(walk.waypoints):
            return Order(None)
        last = place == len(walk.waypoints) - 1
        self._next = 0 if last and walk.repeat and len(walk.waypoints) > 1 else place + 1
        halt = last and not walk.repeat
        return Order(walk.waypoints[place], walk.speed_m_s, inf, self._HALT_M if halt else self._PASS_M, halt)


class WanderScript:
    """Random places one after another, with sudden stops between (see `twin.scenario.people.Wander`).

    Of a few random goals the person takes the one whose first metre is freest of others: people do not set out into
    somebody's back.
    """

    _CANDIDATES = 6
    _LEAST_WAY_M = 0.8
    _LOOK_AHEAD_M = 1.0

    def __init__(self, wander: Wander, area: Array, rng: np.random.Generator) -> None:
        self._wander = wander
        self._area = area
        self._rng = rng
        self._walking = False

    def next_order(self, t: float, here: Array, others: Array) -> Order:
        """A sudden stop, or a turn to a new goal at a new speed."""
        rng, wander = self._rng, self._wander
        if self._walking and rng.random() < wander.stop_share:
            self._walking = False
            return Order(None, until=t + rng.uniform(*wander.stop_s))
        self._walking = True
        goal = self._goal(here, others)
        return Order(goal, rng.uniform(*wander.speed_m_s), t + 0.3 + rng.exponential(wander.stretch_s))

    def _goal(self, here: Array, others: Array) -> tuple[float, float]:
        goals = random_places(self._area, self._CANDIDATES, self._rng)
        way = goals - here
        length = np.hypot(way[:, 0], way[:, 1])
        direction = way / np.maximum(length, 1e-9)[:, None]
        free = np.minimum(length / self._LEAST_WAY_M, 1.0)
        if len(others):
            ahead = here + direction * np.minimum(length, self._LOOK_AHEAD_M)[:, None]
            to_others = others - here
            along = np.clip(direction @ to_others.T, 0.0, self._LOOK_AHEAD_M)  # (goals, others)
            nearest = np.linalg.norm(to_others - along[..., None] * direction[:, None], axis=-1).min(axis=1)
            crowded = np.linalg.norm(others - ahead[:, None], axis=-1).min(axis=1)
            free = free + np.minimum(nearest, 0.7) + np.minimum(crowded, 0.7)
        best = goals[int(np.argmax(free))]
        return float(best[0]), float(best[1])


def random_places(area: Array, count: int, rng: np.random.Generator) -> Array:
    """Places (count, 2) uniform in a polygon (k, 2) [m]."""
    low, high = area.min(axis=0), area.max(axis=0)
    inside, found = Area(area), np.empty((0, 2))
    while len(found) < count:
        places = rng.uniform(low, high, (2 * count, 2))
        found = np.concatenate([found, places[inside.contains(places)]])
    return found[:count]


def known_start(person: Person) -> Point2 | None:
    """Where a person's description says they start [m]: as asked, or at the first waypoint; None: a place is drawn."""
    if person.start is None and isinstance(person.script, Walk):
        return person.script.waypoints[0]
    return person.start


def first_heading(person: Person, start: Array, rng: np.random.Generator) -> float:
    """Where a person faces at the start [rad]: as asked, towards the first waypoint that is not here, or at random."""
    drawn = float(rng.uniform(-np.pi, np.pi))
    if person.heading_deg is not None:
        return float(np.deg2rad(person.heading_deg))
    if isinstance(person.script, Walk):
        for x, y in person.script.waypoints:
            if hypot(x - start[0], y - start[1]) > 0.3:
                return float(np.arctan2(y - start[1], x - start[0]))
    return drawn
