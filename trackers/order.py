"""Observations in order of their stamps, each once, whatever order they arrive in."""

from __future__ import annotations

import heapq
from collections import Counter

from trackers.observations import NS_PER_S, Observation

MAX_WAIT_S = 0.3
"""Time for which an observation waits for older ones [s]: two scans and a half at 10 Hz."""

LATE = "too late: newer ones had been worked"
TWICE = "twice under one stamp"
"""Reasons for which observations are dropped, see `trackers.tracks.Reporting.losses`."""


class StampOrder:
    """Takes observations in order of arrival, hands them on in order of their stamps.

    One is handed on when another at least `max_wait_s` newer has arrived: whatever overtook it by less comes behind it.
    Of one stamp they leave in order of arrival. What comes when a newer one has been handed on, or comes twice, is dropped
    and counted in `losses`, by sensor and reason.
    Stamps are on one clock: whoever decodes messages adds the rig's time offsets.
    """

    def __init__(self, max_wait_s: float = MAX_WAIT_S) -> None:
        self._max_wait_ns = round(max_wait_s * NS_PER_S)
        self._held: list[tuple[int, int, Observation]] = []  # a heap by stamp, then arrival
        self._arrived = 0
        self._newest_ns: int | None = None
        self._left_ns: int | None = None  # the stamp of what was handed on last
        self._known: set[tuple[int, str]] = set()  # stamps and sensors held, and those that left at the last stamp
        self.losses: Counter[tuple[str, str]] = Counter()

    @property
    def discarded(self) -> int:
        """Number of observations that were dropped."""
        return self.losses.total()

    def add(self, observation: Observation) -> list[Observation]:
        """Take an observation; return what may be handed on now, oldest first."""
        ns, key = observation.stamp_ns, (observation.stamp_ns, observation.sensor)
        is_late = self._left_ns is not None and ns < self._left_ns
        if is_late or key in self._known:
            self.losses[observation.sensor, LATE if is_late else TWICE] += 1
            return []
        self._known.add(key)
        heapq.heappush(self._held, (ns, self._arrived, observation))
        self._arrived += 1
        self._newest_ns = ns if self._newest_ns is None else max(ns, self._newest_ns)
        return self._leave(self._newest_ns - self._max_wait_ns)

    def finish(self) -> list[Observation]:
        """Return what still waits when the observations have ended, oldest first."""
        return self._leave(None)

    def _leave(self, until_ns: int | None) -> list[Observation]:
        """Hand on what waits of stamps up to this one [ns] (None: all of it)."""
        leaving = []
        while self._held and (until_ns is None or self._held[0][0] <= until_ns):
            leaving.append(heapq.heappop(self._held)[2])
        if leaving:
            left_ns = self._left_ns = leaving[-1].stamp_ns
            self._known = {key for key in self._known if key[0] >= left_ns}
        return leaving
