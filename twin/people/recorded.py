"""People who keep a recorded path: where it has them at every tick of the people's clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from twin.scenario.behaviour import Action, Path
from twin.scenario.people import Person

Array = NDArray[np.float64]
Planar = NDArray[np.complex128]

BODIES_NEED_M = 0.75
"""Two people whose middles are closer than this overlap at some moments of their steps: hands, shoes [m]."""
_LOOKS_EVERY_S = 0.1


def curve_through(rows: Array) -> PchipInterpolator:
    """The curve of places over time through rows (k, 3) t [s], x, y [m]."""
    return PchipInterpolator(rows[:, 0], rows[:, 1:])


class RecordedPaths:
    """The paths of some people, interpolated by monotone cubics: places and velocities are continuous.

    The curve passes through every row of the recording and overshoots none: between two rows it stays in the rectangle
    that they span (F. Fritsch and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM
    Journal on Scientific and Statistical Computing 5, 1984).
    """

    def __init__(self, paths: Mapping[int, Action], tick_s: float) -> None:
        """paths: by a person's place in all arrays; tick_s: the people's clock [s]."""
        self.numbers = np.array(sorted(paths), dtype=np.intp)  # (k,)
        first, last, place, velocity = [], [], [], []
        for number in self.numbers:
            path = paths[int(number)]
            assert isinstance(path, Path)
            rows = np.array(path.points)
            spline = curve_through(rows)
            # there from the tick before the first row to the one after the last, and so at both
            enters = max(0, int(np.floor(rows[0, 0] / tick_s + 1e-9)))
            leaves = max(enters, int(np.ceil(rows[-1, 0] / tick_s - 1e-9)))
            t = np.arange(enters, leaves + 1) * tick_s
            first.append(enters)
            last.append(leaves)
            at = np.clip(t, rows[0, 0], rows[-1, 0])
            place.append(spline(at) @ np.array([1, 1j]))
            velocity.append(spline(at, 1) @ np.array([1, 1j]))
        self.first = np.array(first, dtype=np.intp)
        """(k,) the tick at which each enters."""
        self.last = np.array(last, dtype=np.intp)
        """(k,) the last tick at which each is there."""
        self._offset = np.concatenate([[0], np.cumsum(self.last - self.first + 1)[:-1]]).astype(np.intp)[: len(first)]
        self._place: Planar = np.concatenate([*place, np.zeros(0, dtype=complex)])
        self._velocity: Planar = np.concatenate([*velocity, np.zeros(0, dtype=complex)])

    def there(self, tick: int) -> NDArray[np.bool_]:
        """Who is there at a tick, (k,)."""
        return (self.first <= tick) & (tick <= self.last)

    def at(self, tick: int) -> tuple[Planar, Planar]:
        """Places [m] and velocities [m/s] (k,) at a tick; before and after a path its first and last."""
        row = self._offset + np.clip(tick, self.first, self.last) - self.first
        return self._place[row], self._velocity[row]


@dataclass(frozen=True)
class CloseCall:
    """Two recorded paths that come closer than two bodies can: who, when [s], and how close their middles are [m]."""

    first: str
    second: str
    t: float
    apart_m: float


def close_calls(people: Mapping[str, Person], within_m: float = BODIES_NEED_M) -> list[CloseCall]:
    """Where two recorded paths come closer than bodies allow, the closest moment of each pair, in order of time."""
    names = sorted(name for name, person in people.items() if person.script and isinstance(person.script[0], Path))
    paths = RecordedPaths({number: people[name].script[0] for number, name in enumerate(names)}, _LOOKS_EVERY_S)
    found: dict[tuple[int, int], tuple[float, float]] = {}
    for tick in range(int(paths.first.min(initial=0)), int(paths.last.max(initial=-1)) + 1):
        there = np.flatnonzero(paths.there(tick))
        if len(there) < 2:
            continue
        place = paths.at(tick)[0][there]
        apart = np.abs(place[:, None] - place)
        for one, other in zip(*np.nonzero(np.triu(apart < within_m, 1)), strict=True):
            pair = int(there[one]), int(there[other])
            if apart[one, other] < found.get(pair, (np.inf, 0.0))[0]:
                found[pair] = float(apart[one, other]), tick * _LOOKS_EVERY_S
    calls = [CloseCall(names[one], names[other], t, apart) for (one, other), (apart, t) in found.items()]
    return sorted(calls, key=lambda call: call.t)


def warning_of(calls: Sequence[CloseCall]) -> str:
    """One sentence that says where recorded paths ask of bodies what they cannot do; empty without calls."""
    if not calls:
        return ""
    worst = min(calls, key=lambda call: call.apart_m)
    pairs = "1 pair" if len(calls) == 1 else f"{len(calls)} pairs"
    return (
        f"{pairs} of recorded paths come closer than the {BODIES_NEED_M:g} m that bodies need, nearest {worst.first} and "
        f"{worst.second} with {worst.apart_m:.2f} m at {worst.t:.1f} s: the bodies overlap there, as the recording has it"
    )
