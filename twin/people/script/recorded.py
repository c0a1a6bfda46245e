"""Starts of people (place, heading, time), and recorded paths: positions and velocities at every tick of their clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Planar
from trackers.errors import InputError
from twin.people.crowd.ground import Ground
from twin.scenario.action import RecordedPath
from twin.scenario.behaviour import Action, Run, Walk
from twin.scenario.person import Person
from twin.tables.contents import WALKING_M_S, WALKING_WARNING, speed_along

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator


BODIES_NEED_M = 0.75
"""Distance between middles below which two bodies overlap at some phases of their steps: hands, shoes [m]."""
_LOOKS_EVERY_S = 0.1
_WINDOW = 400
"""Number of ticks for which all positions are computed at once."""
_XY = np.array([1, 1j])
"""Factors that turn x, y into a complex number."""


def curve_through(rows: Array) -> PchipInterpolator:
    """Fit the curve of positions over time through rows (k, 3) t [s], x, y [m]."""
    from scipy.interpolate import PchipInterpolator  # takes a while to load

    return PchipInterpolator(rows[:, 0], rows[:, 1:])


class RecordedPaths:
    """Paths of some people, interpolated by monotone cubics: positions and velocities are continuous.

    The curve passes through every row of the recording and stays, between two rows, in the rectangle that they span (F.
    Fritsch and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM Journal on
    Scientific and Statistical Computing 5, 1984).
    """

    def __init__(self, paths: Mapping[int, Action], tick_s: float) -> None:
        """paths: by a person's index; tick_s: the people's clock [s]."""
        self.numbers = np.array(sorted(paths), dtype=np.intp)  # (k,)
        self._tick_s = tick_s
        self._curves: list[PchipInterpolator] = []
        first, last = [], []
        for number in self.numbers:
            path = paths[int(number)]
            assert isinstance(path, RecordedPath)
            rows = np.array(path.points)
            self._curves.append(curve_through(rows))
            # present from the tick before the first row to the one after the last, and so at both
            first.append(max(0, int(np.floor(rows[0, 0] / tick_s + 1e-9))))
            last.append(max(first[-1], int(np.ceil(rows[-1, 0] / tick_s - 1e-9))))
        self.first = np.array(first, dtype=np.intp)
        """(k,) first tick of each person's presence."""
        self.last = np.array(last, dtype=np.intp)
        """(k,) last tick of each person's presence."""
        ends = [self._along(row, np.array([self.first[row], self.last[row]])) for row in range(len(self._curves))]
        self._ends: Planar = np.array(ends, dtype=complex).reshape(-1, 2, 2)  # (k, place and velocity, first and last)
        self._from = -_WINDOW  # the tick of the window's first row; none is computed yet
        self._window: Planar = np.zeros((0, 2, len(self._curves)), dtype=complex)  # (_WINDOW, place and velocity, k)

    def there(self, tick: int) -> NDArray[np.bool_]:
        """Return a mask (k,) of the people present at a tick."""
        return (self.first <= tick) & (tick <= self.last)

    def at(self, tick: int) -> tuple[Planar, Planar]:
        """Return positions [m] and velocities [m/s] (k,) at a tick, outside a path those of its ends."""
        if not self._from <= tick < self._from + _WINDOW:
            self._look_ahead(tick)
        place, velocity = self._window[tick - self._from]
        return place, velocity

    def _look_ahead(self, tick: int) -> None:
        """Compute the window that begins at a tick; memory does not grow with the path."""
        ticks = np.arange(tick, tick + _WINDOW)
        self._from = tick
        self._window = np.empty((_WINDOW, 2, len(self._curves)), dtype=complex)
        self._window[:] = np.where(self.last < tick, self._ends[:, :, 1].T, self._ends[:, :, 0].T)
        for row in map(int, np.flatnonzero((self.first < tick + _WINDOW) & (tick <= self.last))):
            self._window[:, :, row] = self._along(row, np.clip(ticks, self.first[row], self.last[row])).T

    def _along(self, row: int, ticks: NDArray[np.intp]) -> Planar:
        """Return positions and velocities (2, n) of one person at some ticks."""
        curve = self._curves[row]
        at = np.clip(ticks * self._tick_s, curve.x[0], curve.x[-1])
        return np.stack([curve(at) @ _XY, curve(at, 1) @ _XY])


@dataclass(frozen=True)
class CloseCall:
    """Two recorded paths closer than two bodies allow: both people, time [s] and distance of their middles [m]."""

    first: str
    second: str
    t: float
    apart_m: float


def close_calls(people: Mapping[str, Person], until_s: float = np.inf) -> list[CloseCall]:
    """Find the closest approach of each pair of recorded paths closer than `BODIES_NEED_M` before `until_s`, ordered by time."""
    names = sorted(
        name for name, person in people.items() if person.script and isinstance(person.script[0], RecordedPath)
    )
    paths = RecordedPaths({number: people[name].script[0] for number, name in enumerate(names)}, _LOOKS_EVERY_S)
    found: dict[tuple[int, int], tuple[float, float]] = {}
    last = int(min(paths.last.max(initial=-1), until_s / _LOOKS_EVERY_S))
    for tick in range(int(paths.first.min(initial=last)), last + 1):
        there = np.flatnonzero(paths.there(tick))
        if len(there) < 2:
            continue
        place = paths.at(tick)[0][there]
        apart = np.abs(place[:, None] - place)
        for one, other in zip(*np.nonzero(np.triu(apart < BODIES_NEED_M, 1)), strict=True):
            pair = int(there[one]), int(there[other])
            if apart[one, other] < found.get(pair, (np.inf, 0.0))[0]:
                found[pair] = float(apart[one, other]), tick * _LOOKS_EVERY_S
    calls = [CloseCall(names[one], names[other], t, apart) for (one, other), (apart, t) in found.items()]
    return sorted(calls, key=lambda call: call.t)


def describe_speeds(people: Mapping[str, Person]) -> list[str]:
    """Return one sentence per person whose recorded path is slower or faster than people walk."""
    messages, (slowest, fastest) = [], WALKING_M_S
    for name, person in people.items():
        for place, action in enumerate(person.script):
            speed = speed_along(*np.array(action.points).T) if isinstance(action, RecordedPath) else None
            if speed is not None and not slowest <= speed <= fastest:
                messages.append(
                    f"people.{name}.script.{place}.points: {name} moves at {speed:.3g} m/s {WALKING_WARNING} {slowest:g} to "
                    f"{fastest:g} m/s are usual; t in s, and x and y in m, are expected"
                )
    return messages


def describe_close_calls(calls: Sequence[CloseCall]) -> str:
    """Describe impossible approaches of recorded paths in one sentence; empty without calls."""
    if not calls:
        return ""
    worst = min(calls, key=lambda call: call.apart_m)
    pairs = "1 pair" if len(calls) == 1 else f"{len(calls)} pairs"
    return (
        f"{pairs} of recorded paths come closer than the {BODIES_NEED_M:g} m that bodies need, nearest {worst.first} and "
        f"{worst.second} with {worst.apart_m:.2f} m at {worst.t:.1f} s: the bodies overlap there, as the recording has it"
    )


Point = tuple[float, float]

_CANDIDATES = 200
_APART_M = 0.75
"""Least distance between the middles of two people at the start."""
_ROUNDS = 100
"""Draws of all places: those drawn first may leave no room for the last, though there is room for all."""


def known_start(person: Person) -> Point | None:
    """Return the described start x, y [m]; None: a place is drawn.

    As given, the beginning of a recorded path, or the first waypoint of a walk.
    """
    if person.start is not None or not person.script:
        return person.start
    match person.script[0]:
        case RecordedPath() as path:
            return path.points[0][1:]
        case Walk(waypoints=waypoints) | Run(waypoints=waypoints):
            return waypoints[0]
        case _:
            return None


def start_places(
    names: Sequence[str], people: Sequence[Person], ground: Ground, random: Sequence[np.random.Generator], source: str
) -> Array:
    """Return the starts of all people, (n, 2) [m]: as described, or drawn in the area, clear of furniture and of those
    placed.

    Raises InputError where the area has no room left.
    """
    known = {
        number: np.array(start) for number, person in enumerate(people) if (start := known_start(person)) is not None
    }
    stuck = ""
    for _ in range(_ROUNDS):
        places = dict(known)
        for number in range(len(people)):
            if number in places:
                continue
            candidates = ground.free_places(_CANDIDATES, random[number])
            # people on recorded paths and later arrivals are avoided when they come
            taken = [place for other, place in places.items() if comes_at(people[other]) <= comes_at(people[number])]
            if taken:
                clear = np.linalg.norm(candidates[:, None] - np.array(taken), axis=-1).min(axis=1) >= _APART_M
                candidates = candidates[clear]
            if not len(candidates):
                stuck = names[number]
                break
            places[number] = candidates[0]
        else:
            return np.array([places[number] for number in range(len(people))], dtype=float).reshape(-1, 2)
        if not set(places) - set(known):  # nobody drawn stands in the way
            break
    raise InputError(
        f"{source}: people.{stuck}: no place in the area is {_APART_M} m from everybody else; "
        f"fewer people than {len(people)}, or a larger area, are expected"
    )


def comes_at(person: Person) -> float:
    """Return the time at which a person enters the room [s]."""
    if person.script and isinstance(person.script[0], RecordedPath):
        return max(0.0, person.script[0].points[0][0])
    return person.arrive_s


def describe_late_actions(people: Mapping[str, Person], duration_s: float) -> list[str]:
    """Return one sentence per person and action that does not begin before the end of the run at `duration_s` [s]."""
    messages = []
    never = [name for name, person in people.items() if comes_at(person) >= duration_s]
    if len(never) > 1:
        messages.append(
            f"people: {len(never)} never come, as the end at {duration_s:g} s is before: {', '.join(never)}"
        )
    for name, person in people.items():
        if name in never:
            if len(never) == 1:
                messages.append(
                    f"people.{name}.arrive_s: {comes_at(person):g} s is after the end at {duration_s:g} s: never comes"
                )
            continue
        messages += [
            f"people.{name}.script.{place}.at_s: {action.at_s:g} s is after the end at {duration_s:g} s: never done"
            for place, action in enumerate(person.script)
            if action.at_s is not None and action.at_s >= duration_s
        ]
    return messages


def first_heading(person: Person, start: Array, rng: np.random.Generator) -> float:
    """Return a person's initial heading [rad]: as given, towards the first waypoint elsewhere, or random."""
    drawn = float(rng.uniform(-np.pi, np.pi))
    if person.heading_deg is not None:
        return float(np.deg2rad(person.heading_deg))
    match person.script[0] if person.script else None:
        case RecordedPath(points=points):
            waypoints = [point[1:] for point in points]
        case Walk(waypoints=waypoints) | Run(waypoints=waypoints):
            pass
        case _:
            return drawn
    for x, y in waypoints:
        if hypot(x - start[0], y - start[1]) > 0.3:
            return float(np.arctan2(y - start[1], x - start[0]))
    return drawn
