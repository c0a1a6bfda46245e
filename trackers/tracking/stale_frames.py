"""Stale readings: of hanging sensors, and of scanners without data.

A driver may repeat its last reading under new stamps. Noisy readings never repeat bit for bit: a repetition is as
uninformative as silence.

So is a scan without beams, or with invalid ones (NaN) only. A scan without any return (+inf throughout) shows open space, in
which a person would be detected, unless the scan before it had many returns: a room does not vanish between two scans, but a
scanner that starts, stops or is covered reports so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.observations import DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry

_ROWS = 8
"""Spacing of the compared rows of a picture."""
_LEAST = 20
"""Number of readings, each equally likely to differ or not, that agree by chance once in a million times.

Likewise for returns, each equally likely to be lost or not.
"""


class StaleFrameDetector:
    """Detector of readings that repeat the one before; called once for each, a sensor's in order of time.

    A sensor counts as noisy while its last two different readings differ in at least half of their values. One without noise
    legitimately repeats itself when nothing moves, and is believed, as is one with few returns.
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
        n = int(np.count_nonzero((before >= 0) | (values >= 0)))
        if n_changed:
            self._noisy[sensor] = n >= _LEAST and 2 * n_changed >= n
        return n_changed == 0 and n >= _LEAST and self._noisy.get(sensor, False)

    def is_blank(self, observation: Observation) -> bool:
        """Return whether a scan has no reading, or has lost all returns of the last one with a reading."""
        if not isinstance(observation, LaserScan):
            return False
        ranges = observation.ranges_m
        if np.isnan(ranges).all():
            return True
        limited = (ranges >= observation.range_min_m) & (ranges <= observation.range_max_m)
        n_return = int((limited & (ranges < np.inf)).sum())
        if n_return == 0 and self._n_return.get(observation.sensor, 0) >= _LEAST:
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
        case Odometry():  # one at rest repeats itself legitimately, and is believed: fewer values than _LEAST
            return observation.frame_from_base[:3]
    raise TypeError(f"no reading of a sensor: {type(observation).__name__}")
