"""Order of arrival and order of stamps: how long observations wait for older ones, and which sensors keep arriving behind."""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Iterable

from trackers.observations import NS_PER_S, Observation

MAX_WAIT_S = 0.3
"""Greatest time that an observation waits for older ones [s]: two and a half scans at 10 Hz."""

LATE = "too late: newer ones had been worked"
TWICE = "twice under one stamp"
"""Reasons for which observations are dropped, see `trackers.tracks.Reporting.losses`."""

_MOST_LAG_NS, _LAST = NS_PER_S, 10
"""Lag of a sensor up to which it is waited for [ns], and of how many of its last observations the second largest tells it."""
_SILENT_NS = 3 * NS_PER_S
"""A sensor is waited for no more once another has reported for so long without it [ns]."""


class ArrivalLags:
    """Lag of each sensor: by how much its observations keep arriving after newer ones of others [ns].

    It is slow, or another one's clock is ahead. Once late is no lag, and stamps of another day are none that one could wait for.
    """

    def __init__(self) -> None:
        self._heard_ns: dict[str, int] = {}  # newest stamp of each sensor
        self._heard_before_ns: dict[str, dict[str, int]] = {}  # the same, as of each sensor's last observation
        self._behind_ns: dict[str, deque[int]] = {}

    def add(self, sensor: str, ns: int) -> None:
        """Take in the stamp of an observation that arrives."""
        before_ns = self._heard_ns.get(sensor, ns)
        self._heard_ns[sensor] = ns if before_ns - ns > _MOST_LAG_NS else max(ns, before_ns)
        ahead_ns = [newest_ns - ns for name, newest_ns in self._heard_ns.items() if name != sensor]
        if ahead_ns:
            behind_ns = max((each for each in ahead_ns if 0 < each <= _MOST_LAG_NS), default=0)
            self._behind_ns.setdefault(sensor, deque(maxlen=_LAST)).append(behind_ns)
        self._heard_before_ns[sensor] = dict(self._heard_ns)

    def beyond(self, wait_ns: int, sensors: Iterable[str] | None = None) -> int:
        """Return the longest lag of some sensors (None: of any) [ns]; 0 if no longer than a wait [ns]."""
        lag_ns = max(map(self._of, self._behind_ns if sensors is None else sensors), default=0)
        return lag_ns if lag_ns > wait_ns else 0

    def _of(self, sensor: str) -> int:
        behind_ns = self._behind_ns.get(sensor, ())
        if len(behind_ns) < 2:
            return 0
        earlier_ns = self._heard_before_ns[sensor]
        silent = any(ns - earlier_ns.get(name, ns) > _SILENT_NS for name, ns in self._heard_ns.items())
        return 0 if silent else sorted(behind_ns)[-2]


class StampOrder:
    """Sorter of observations from order of arrival to order of stamps.

    An observation leaves when another at least `MAX_WAIT_S` newer has arrived, and by as much more as a sensor lags; equal stamps
    leave in order of arrival. One that arrives after a newer one has left, or twice, is dropped and counted in `losses`, by
    sensor and reason. Stamps are on one clock: the decoder of messages adds the rig's time offsets.
    """

    def __init__(self) -> None:
        self._held: list[tuple[int, int, Observation]] = []  # a heap by stamp, then arrival
        self._arrived = 0
        self._newest_ns: int | None = None
        self._left_ns: int | None = None  # stamp of the last one that left
        self._lags = ArrivalLags()
        self._known: set[tuple[int, str]] = set()  # stamps and sensors waiting, and those that left at the last stamp
        self.losses: Counter[tuple[str, str]] = Counter()

    @property
    def discarded(self) -> int:
        """Number of dropped observations."""
        return self.losses.total()

    def add(self, observation: Observation) -> list[Observation]:
        """Add an observation; return those that may leave now, oldest first."""
        ns, key = observation.stamp_ns, (observation.stamp_ns, observation.sensor)
        self._lags.add(observation.sensor, ns)
        is_late = self._left_ns is not None and ns < self._left_ns
        if is_late or key in self._known:
            self.losses[observation.sensor, LATE if is_late else TWICE] += 1
            return []
        self._known.add(key)
        heapq.heappush(self._held, (ns, self._arrived, observation))
        self._arrived += 1
        wait_ns = round(MAX_WAIT_S * NS_PER_S)
        newest_ns = ns if self._newest_ns is None else self._newest_ns
        self._newest_ns = ns if newest_ns - ns > wait_ns + _MOST_LAG_NS else max(ns, newest_ns)  # else another day's
        return self._leave(self._newest_ns - wait_ns - self._lags.beyond(wait_ns))

    def finish(self) -> list[Observation]:
        """Return the waiting observations at the end, oldest first."""
        return self._leave(None)

    def _leave(self, until_ns: int | None) -> list[Observation]:
        """Release waiting observations of stamps up to this one [ns] (None: all)."""
        leaving = []
        while self._held and (until_ns is None or self._held[0][0] <= until_ns):
            leaving.append(heapq.heappop(self._held)[2])
        if leaving:
            left_ns = self._left_ns = leaving[-1].stamp_ns
            self._known = {key for key in self._known if key[0] >= left_ns}
        return leaving
