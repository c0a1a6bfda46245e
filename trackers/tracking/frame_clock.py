"""Frames that are owed though their observations were lost, as another sensor's clock tells.

A tracker with one scanner reports once a scan. Where a scan is lost, whoever follows the tracks still wants to know where people
are by then. Another sensor of the same machine, such as odometry, tells that the time of the scan has passed.
"""

from __future__ import annotations

from collections import deque
from statistics import median_low

from trackers.observations import NS_PER_S

_GAPS = 9
"""Number of the last frames whose gaps and delays tell the next ones."""
_LEAST = 3
_MARGIN = 0.25
"""Share of a period by which a frame may come later than any of the last ones."""


class FrameClock:
    """The stamps of a tracker's frames, and those of frames that should have come; stamps [ns] of one clock."""

    def __init__(self, longest_s: float) -> None:
        """longest_s: time after the last frame for which others are owed [s]."""
        self._longest_ns = round(longest_s * NS_PER_S)
        self._gaps_ns: deque[int] = deque(maxlen=_GAPS)
        self._late_ns: deque[int] = deque(maxlen=_GAPS)
        self._frame_ns: int | None = None  # of the last frame
        self._owed_ns: int | None = None  # of the last one that was owed, after that frame
        self._newest_ns: int | None = None

    def owed(self, ns: int) -> list[int]:
        """Take the stamp of another sensor's observation; return the stamps of the frames that did not come, each once."""
        self._newest_ns = ns if self._newest_ns is None else max(ns, self._newest_ns)
        if self._frame_ns is None or len(self._gaps_ns) < _LEAST:
            return []
        period_ns, owed = median_low(self._gaps_ns), []
        while True:
            due_ns = (self._frame_ns if self._owed_ns is None else self._owed_ns) + period_ns
            is_late = self._newest_ns - due_ns >= max(self._late_ns) + _MARGIN * period_ns
            if not is_late or due_ns - self._frame_ns > self._longest_ns:
                return owed
            self._owed_ns = due_ns
            owed.append(due_ns)

    def take(self, ns: int) -> bool:
        """Take the stamp of a frame that came; tell whether it is to be reported: no owed frame stands in its place."""
        is_new = self._owed_ns is None or ns - self._owed_ns >= median_low(self._gaps_ns) / 2
        if self._frame_ns is not None and ns > self._frame_ns:
            self._gaps_ns.append(ns - self._frame_ns)
        self._late_ns.append(0 if self._newest_ns is None else max(self._newest_ns - ns, 0))
        self._frame_ns, self._owed_ns = ns, None if is_new else self._owed_ns
        return is_new
