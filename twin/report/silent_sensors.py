"""Silent sensors: those whose last report is too old to show their view."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from statistics import median

from trackers.observations import NS_PER_S, Observation

_GAPS = 3.0
"""Number of usual gaps that is a silence, at least half a second: one message may be lost or late."""
_LEAST_NS = NS_PER_S // 2
_UNKNOWN_NS = NS_PER_S
"""Gap of a sensor that has not reported twice."""
_REMEMBERED = 16


class SilenceMonitor:
    """Monitor of silent sensors, fed with observations in order of arrival.

    Time is the newest stamp of any sensor on arrival, so that a sensor with a wrong clock or late messages is not silent.
    """

    def __init__(self, sensors: Iterable[str]) -> None:
        self._heard_ns: dict[str, int | None] = dict.fromkeys(sensors)
        self._last_ns: dict[str, int] = {}
        self._gaps_ns: dict[str, deque[int]] = {}
        self._first_ns: int | None = None
        self._now_ns = 0

    def add(self, observation: Observation) -> None:
        """Add an observation on arrival."""
        name, ns = observation.sensor, observation.stamp_ns
        if self._first_ns is None:
            self._first_ns = self._now_ns = ns
        self._now_ns = max(self._now_ns, ns)
        self._heard_ns[name] = self._now_ns
        if name in self._last_ns and ns > self._last_ns[name]:
            self._gaps_ns.setdefault(name, deque(maxlen=_REMEMBERED)).append(ns - self._last_ns[name])
        self._last_ns[name] = ns

    def silent(self, now_ns: int | None = None) -> frozenset[str]:
        """Return the sensors that are silent at the newest stamp, or at this later time [ns]."""
        if self._first_ns is None:
            return frozenset()
        if now_ns is not None:
            self._now_ns = max(self._now_ns, now_ns)
        return frozenset(
            name
            for name, heard_ns in self._heard_ns.items()
            if self._now_ns - (self._first_ns if heard_ns is None else heard_ns) > self._patience_ns(name)
        )

    def _patience_ns(self, name: str) -> float:
        gaps_ns = self._gaps_ns.get(name)
        return max(_GAPS * median(gaps_ns), _LEAST_NS) if gaps_ns else _UNKNOWN_NS
