"""Gathering what several sensors report of one moment, before a tracker works it.

Scanners open an epoch; every other sensor joins the nearest one within half a period. An epoch is whole when every awaited
sensor has reported, and is given up waiting for when an observation at least `max_wait_s` newer has arrived; epochs leave in
order of time. So a silent sensor delays a tracker by little more than `max_wait_s`, never for ever.

What comes too late (its epoch has left) or twice is dropped and counted.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, field

from trackers.observations import NS_PER_S, LaserScan, Observation


@dataclass
class Epoch:
    """The observations of one moment, by sensor.

    ns: that moment, the main sensor's stamp, or that of the scanner that opened it where it is missing [ns].
    """

    ns: int
    observations: dict[str, Observation] = field(default_factory=dict)

    @property
    def t(self) -> float:
        """The moment [s]."""
        return self.ns / NS_PER_S


class EpochGatherer:
    """Takes observations in order of arrival, hands back epochs in order of time.

    awaited: the sensors used; main: the sensor whose stamp an epoch takes (the opener's where it is missing). Stamps are
    on one clock: whoever decodes messages adds the rig's time offsets.
    """

    def __init__(self, awaited: Set[str], main: str, period_s: float, max_wait_s: float) -> None:
        self._awaited = awaited
        self._main = main
        self._half_period_ns = round(0.5 * period_s * NS_PER_S)
        self._max_wait_ns = round(max_wait_s * NS_PER_S)
        self._pending: list[Epoch] = []
        self._images: list[tuple[int, Observation]] = []  # wait for a scan to open their epoch
        self._worked: Epoch | None = None
        self.discarded = 0

    def add(self, observation: Observation) -> list[Epoch]:
        """The epochs that are ready now that `observation` has arrived, oldest first."""
        if observation.sensor not in self._awaited:
            return []
        ns = observation.stamp_ns
        if self._came_too_late(observation.sensor, ns) or self._holds(observation.sensor, ns):
            self.discarded += 1
            return []
        if isinstance(observation, LaserScan):
            self._add_scan(observation, ns)
        else:
            self._images.append((ns, observation))
        self._join_images()
        return self._ready(ns)

    def finish(self) -> list[Epoch]:
        """The epochs still waiting, oldest first; images that no scan claimed are dropped."""
        epochs, self._pending = self._pending, []
        self.discarded += len(self._images)
        self._images = []
        return epochs

    def _came_too_late(self, sensor: str, ns: int) -> bool:
        if self._worked is None:
            return False
        if ns <= self._worked.ns:
            return True
        # within half a period after an epoch that left without this sensor: it belonged there
        return sensor not in self._worked.observations and ns - self._worked.ns <= self._half_period_ns

    def _add_scan(self, scan: LaserScan, ns: int) -> None:
        epoch = self._nearest(ns, without=scan.sensor)
        if epoch is None:
            epoch = Epoch(ns)
            self._pending.append(epoch)
        epoch.observations[scan.sensor] = scan
        if scan.sensor == self._main:
            epoch.ns = ns
        self._pending.sort(key=lambda pending: pending.ns)

    def _join_images(self) -> None:
        waiting = []
        for ns, image in self._images:
            epoch = self._nearest(ns, without=image.sensor)
            if epoch is None:
                waiting.append((ns, image))
            else:
                epoch.observations[image.sensor] = image
        self._images = waiting

    def _nearest(self, ns: int, without: str) -> Epoch | None:
        """The pending epoch nearest to `ns` within half a period that lacks the sensor."""
        near = [
            (abs(epoch.ns - ns), epoch.ns, epoch)
            for epoch in self._pending
            if without not in epoch.observations and abs(epoch.ns - ns) <= self._half_period_ns
        ]
        return min(near, key=lambda entry: entry[:2])[2] if near else None

    def _holds(self, sensor: str, ns: int) -> bool:
        """Whether an observation of that sensor and moment is already waiting."""
        waiting = [epoch.observations[sensor] for epoch in self._pending if sensor in epoch.observations]
        waiting += [image for _, image in self._images if image.sensor == sensor]
        return any(other.stamp_ns == ns for other in waiting)

    def _ready(self, newest_ns: int) -> list[Epoch]:
        ready = []
        while self._pending:
            head = self._pending[0]
            whole = self._awaited <= head.observations.keys()
            if not whole and newest_ns - head.ns < self._max_wait_ns:
                break
            ready.append(self._pending.pop(0))
            self._worked = head
        kept = [(ns, image) for ns, image in self._images if newest_ns - ns < self._max_wait_ns]
        self.discarded += len(self._images) - len(kept)
        self._images = kept
        return ready
