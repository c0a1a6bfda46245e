"""Readings that say nothing: of sensors that hang, and of scanners that read nothing.

A driver may hand out its last reading again and again, under new stamps. Readings with noise never come twice: one that is bit
for bit the one before it says nothing new, neither where somebody is nor where nobody is: as if the sensor were silent.

So does a scan without beams, or with invalid ones (NaN) alone. One that meets nothing at all (+inf throughout) is a look into
open space, where somebody would be seen, unless the scan before it met something in many beams: a room does not vanish between
two scans, but a scanner that starts, stops or is covered reports so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.observations import DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry

_ROWS = 8
"""Of a picture, each so many rows are compared."""
_LEAST = 20
"""Readings of which each is as likely as not to differ: all of them agree by chance once in a million times.

Likewise returns, each as likely as not to be lost.
"""


class StaleFrameDetector:
    """Tells which readings say no more than the one before; asked once for each, a sensor's in order of time.

    A sensor is taken to have noise while its last two different readings differ in at least half of their values. Without
    noise it repeats itself in all honesty where nobody moves, and is believed; so is one with hardly a return.
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
        """Return whether a scan has no reading, or has lost all the returns that the last one with a reading had."""
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
    """Return enough of a reading to recognise it; below 0 where the sensor measured nothing."""
    match observation:
        case LaserScan():
            return np.where(np.isfinite(observation.ranges_m), observation.ranges_m, -1.0)
        case Image() | DepthImage():
            return observation.rgb[::_ROWS]
        case FloorFrame():
            return observation.values
        case Odometry():  # one that stands says the same again and again, and is believed: fewer values than _LEAST
            return observation.frame_from_base[:3]
    raise TypeError(f"no reading of a sensor: {type(observation).__name__}")
