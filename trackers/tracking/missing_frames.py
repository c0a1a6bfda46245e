"""Readings that say nothing, of hanging sensors and of scanners without data; and frames whose observations were lost.

A driver may repeat its last reading under new stamps. Noisy readings never repeat bit for bit: a repetition is as
uninformative as silence.

So is a scan without beams, or with invalid ones (NaN) only. A scan without any return (+inf throughout) shows open space, in
which a person would be detected, unless the scan before it had many returns: a room does not vanish between two scans, but a
scanner that starts, stops or is covered reports so.

A tracker with one scanner reports once a scan. Where a scan is lost, a reader of the tracks still wants to know where people
are by then. Another sensor of the same machine, such as odometry, tells that the time of the scan has passed.
"""

from __future__ import annotations

from collections import deque
from statistics import median_low

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry

_ROWS = 8
"""Spacing of the compared rows of a picture."""
_LEAST = 20
"""Number of readings, each equally likely to differ or not, that agree by chance once in a million times.

Likewise for returns, each equally likely to be lost or not.
"""
GAPS = 9
"""Number of the last frames, or of a sensor's readings, whose gaps and delays tell the next ones."""
_FEWEST = 3
_MARGIN = 0.25
"""Share of a period by which a frame may come later than any of the last ones."""


class StaleFrameDetector:
    """Detector of readings that repeat the one before; called once for each, a sensor's in order of time.

    A sensor counts as noisy while its last two different readings differ in at least half of their values. One without noise
    legitimately repeats itself when nothing moves, and is used, as is one with few returns.
    """

    def __init__(self) -> None:
        self._last: dict[str, NDArray] = {}
        self._noisy: dict[str, bool] = {}
        self._n_return: dict[str, int] = {}

    def repeats(self, observation: Observation) -> bool:
        """Return whether the reading repeats the sensor's last one."""
        sensor, values = observation.sensor, _values(observation)
        before = self._last.get(sensor)
        self._last[sensor] = values
        if before is None or before.shape != values.shape:
            return False
        n_changed = int(np.count_nonzero(before != values))
        n = values.size if values.dtype == np.uint8 else int(np.count_nonzero((before >= 0) | (values >= 0)))
        if n_changed:
            self._noisy[sensor] = n >= _LEAST and 2 * n_changed >= n
        return n_changed == 0 and n >= _LEAST and self._noisy.get(sensor, False)

    def is_blank(self, observation: Observation) -> bool:
        """Return whether a scan has no reading, or has lost all returns of the last one with a reading."""
        if not isinstance(observation, LaserScan):
            return False
        ranges = observation.ranges_m
        limited = (ranges >= observation.range_min_m) & (ranges <= observation.range_max_m)
        n_return = int(np.count_nonzero(limited & (ranges < np.inf)))
        if n_return == 0 and (self._n_return.get(observation.sensor, 0) >= _LEAST or np.isnan(ranges).all()):
            return True
        self._n_return[observation.sensor] = n_return
        return False


def _values(observation: Observation) -> NDArray:
    """Return enough of a reading to identify it; below 0 without a measurement."""
    match observation:
        case LaserScan():
            return np.where(np.isfinite(observation.ranges_m), observation.ranges_m, -1.0)
        case Image() | DepthImage():
            return observation.rgb[::_ROWS]
        case FloorFrame():
            return observation.values
        case Odometry():  # one at rest repeats itself legitimately, and is used: fewer values than _LEAST
            return observation.frame_from_base[:3]
    raise TypeError(f"no reading of a sensor: {type(observation).__name__}")


class FrameClock:
    """The stamps of a tracker's frames, and those of frames that should have come; stamps [ns] of one clock."""

    def __init__(self, longest_s: float) -> None:
        """longest_s: time after the last frame for which others are owed [s]."""
        self._longest_ns = round(longest_s * NS_PER_S)
        self._gaps_ns: deque[int] = deque(maxlen=GAPS)
        self._late_ns: deque[int] = deque(maxlen=GAPS)
        self._frame_ns: int | None = None  # of the last frame
        self._owed_ns: int | None = None  # of the last one that was owed, after that frame
        self._newest_ns: int | None = None

    def owed(self, ns: int) -> list[int]:
        """Take the stamp of another sensor's observation; return the stamps of the frames that did not come, each once."""
        self._newest_ns = ns if self._newest_ns is None else max(ns, self._newest_ns)
        if self._frame_ns is None or len(self._gaps_ns) < _FEWEST:
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
