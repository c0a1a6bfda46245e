"""What a sensor's observations cost, and whoever wants to know of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from trackers.rig import RigSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.faults import Faulty
from twin.sensors.sensor import Noisy, Reading, Sensor, State


@dataclass(eq=False)
class TimedSensor:
    """A sensor and what its observations cost."""

    sensor: Sensor
    frames: int = 0
    spent_s: float = 0.0
    on_reading: Callable[[str, int, Reading], object] = lambda sensor, stamp_ns, reading: None

    @property
    def name(self) -> str:
        """Name on the rig."""
        return self.sensor.name

    @property
    def ideal(self) -> Sensor:
        """The sensor without its noise and faults."""
        return self.sensor.ideal if isinstance(self.sensor, Noisy | Faulty) else self.sensor

    @property
    def healthy(self) -> Sensor:
        """The sensor without its faults."""
        return self.sensor.healthy if isinstance(self.sensor, Faulty) else self.sensor

    @property
    def instants_s(self) -> tuple[float, ...]:
        """When it looks, as offsets from the stamp [s]."""
        return self.sensor.instants_s

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The sensor's reading, timed."""
        start = time.perf_counter()
        result = self.sensor.observe(stamp_ns, self._without_the_world(snapshots), state, rng)
        self.spent_s += time.perf_counter() - start
        self.frames += 1
        self.on_reading(self.name, stamp_ns, result[0])
        return result

    def _without_the_world(self, snapshots: Iterable[Snapshot]) -> Iterator[Snapshot]:
        """The snapshots; what moving the world to them costs is not the sensor's."""
        start = time.perf_counter()
        for snapshot in snapshots:
            self.spent_s -= time.perf_counter() - start
            yield snapshot
            start = time.perf_counter()
        self.spent_s -= time.perf_counter() - start

    def rig_sensor(self) -> RigSensor:
        """Where the sensor is and how it projects, in truth."""
        return self.sensor.rig_sensor()
