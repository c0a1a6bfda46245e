"""The last seconds of everybody's poses, between whose ticks any moment is found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.gait.pose import FLOOR_ROWS, ROWS, Moment
from twin.people.posture.rows import POSTURE_ROWS

TICK_S = 0.025
"""The people's clock [s]; between ticks poses are interpolated."""

HISTORY_S = 3.0
"""How far back poses can be asked for [s]."""


class Memory:
    """What was at each of the last ticks, `HISTORY_S` of them, of n people; its size does not grow with time."""

    def __init__(self, count: int) -> None:
        size = round(HISTORY_S / TICK_S) + 1
        self.tick = -1
        self._floor = np.zeros((size, FLOOR_ROWS, count), dtype=complex)
        self._rows = np.zeros((size, ROWS, count))
        self._posture = np.zeros((size, POSTURE_ROWS, count))
        self._present = np.zeros((size, count), dtype=bool)

    def __len__(self) -> int:
        """How many ticks are kept."""
        return len(self._rows)

    def remember(self, moment: Moment, posture: Array, present: NDArray[np.bool_]) -> None:
        """Keep what is at the next tick: who is how, in which posture (POSTURE_ROWS, n), and who is in the room (n,)."""
        self.tick += 1
        slot = self.tick % len(self)
        self._floor[slot], self._rows[slot] = moment.floor, moment.rows
        self._posture[slot], self._present[slot] = posture, present

    def last(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """What was remembered at the last tick: floor, rows, posture, present; copies."""
        slot = self.tick % len(self)
        return tuple(each[slot].copy() for each in (self._floor, self._rows, self._posture, self._present))  # pyright: ignore[reportReturnType]

    def present(self, t: float) -> NDArray[np.bool_]:
        """Who was in the room at time t [s], (n,)."""
        return self._present[self._slots(t)[0]].copy()

    def at(self, t: float) -> tuple[Moment, Array]:
        """The moment and the posture at time t [s], between the two ticks around it; ValueError for one not kept."""
        early, late, share = self._slots(t)
        floor, rows, posture = self._floor, self._rows, self._posture
        return Moment(
            floor[early] + share * (floor[late] - floor[early]), rows[early] + share * (rows[late] - rows[early])
        ), posture[early] + share * (posture[late] - posture[early])

    def ticks_around(self, t: float) -> list[tuple[Moment, Array]]:
        """Moment and posture at the two ticks around time t [s], the earlier first; nothing before the second tick."""
        if self.tick == 0:
            return []
        late = max(min(int(t / TICK_S + 1e-9) + 1, self.tick), 1)
        slots = [(late - 1) % len(self), late % len(self)]
        return [(Moment(self._floor[slot], self._rows[slot]), self._posture[slot]) for slot in slots]

    def _slots(self, t: float) -> tuple[int, int, float]:
        """The two remembered ticks around time t [s], and the share of the later one."""
        size = len(self)
        oldest = max(0, self.tick - size + 1)
        place = t / TICK_S
        if not oldest <= place <= self.tick + 1e-6:
            raise ValueError(
                f"t = {t} s is not between {oldest * TICK_S:.2f} and {self.tick * TICK_S:.2f} s: advance(t) first, and "
                f"look back by at most {HISTORY_S} s"
            )
        before = min(int(place + 1e-9), self.tick)
        share = max(place - before, 0.0)  # a time rounded to just before its tick is at it: no load is below 0
        return before % size, min(before + 1, self.tick) % size, share
