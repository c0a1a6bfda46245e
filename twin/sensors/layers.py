"""Layers around an ideal sensor: noise, faults of the sensor itself, and the measurement of its cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from trackers.observations import Observation
from trackers.rig import RigSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.fault_effects import Blob, BrokenBeams, BrokenCells, Sector
from twin.sensors.fault_kinds import BlockedSector, DeadBeams, DeadCells, Fault, Freeze, Occlusion
from twin.sensors.sensor import Noise, Reading, Sensor, State
from twin.streams import stream


@dataclass(frozen=True, eq=False)
class Noisy:
    """A sensor with a layer of noise around its ideal readings; the truth stays that of the ideal reading."""

    ideal: Sensor
    noise: Noise

    @property
    def name(self) -> str:
        """Name on the rig."""
        return self.ideal.name

    @property
    def instants_s(self) -> tuple[float, ...]:
        """When the ideal sensor looks, as offsets from the stamp [s]."""
        return self.ideal.instants_s

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The ideal reading with noise on its observation; the state is the sensor's and the noise's."""
        sensor_state, noise_state = state if state is not None else (None, None)
        reading, sensor_state = self.ideal.observe(stamp_ns, snapshots, sensor_state, rng)
        observation, noise_state = self.noise.corrupt(reading.observation, noise_state, rng)
        return Reading(observation, reading.truth), (sensor_state, noise_state)

    def rig_sensor(self) -> RigSensor:
        """What a tracker is told of the sensor; of its noise it is told nothing."""
        return self.ideal.rig_sensor()


class Effect(Protocol):
    """What a fault does to an observation while it is there."""

    def spoil(self, observation: Any) -> Observation:
        """The observation as the faulty sensor has it; the one given stays untouched."""
        ...


@dataclass(frozen=True, eq=False)
class _Timed:
    """An effect, and the fault that says when it is there."""

    fault: Fault
    effect: Effect


@dataclass(frozen=True, eq=False)
class _FaultyState:
    """What is carried: the sensor's own state, and what it last reported, where it may freeze."""

    inner: State = None
    held: Observation | None = None


class Faulty:
    """A sensor with faults; its truth, its place on the rig and all it does outside their times are the healthy one's.

    What lies before the sensor (a blob on the lens, a thing before the scanner) comes before its noise, what is broken in
    it after, and a frozen one repeats all of it. The sensor goes on measuring and drawing its noise during every fault, so
    that it is afterwards as if there had been none; the noise on what a fault changed is drawn from a stream of its own.
    """

    def __init__(self, healthy: Sensor, faults: Mapping[str, Fault], seed: int) -> None:
        """`faults`: by name, those of this sensor; those of its messages alone are left to the schedule."""
        self.healthy = healthy
        self._seed = seed
        self._before: list[_Timed] = []
        self._within: list[_Timed] = []
        self._freezes = [fault for fault in faults.values() if isinstance(fault, Freeze)]
        for name, fault in faults.items():
            rng = stream(seed, "fault", f"{name}/{healthy.name}")
            match fault:
                case Occlusion():
                    self._before.append(_Timed(fault, Blob(fault, healthy.rig_sensor(), rng)))
                case BlockedSector():
                    self._before.append(_Timed(fault, Sector(fault)))
                case DeadBeams():
                    self._within.append(_Timed(fault, BrokenBeams(fault, rng)))
                case DeadCells():
                    self._within.append(_Timed(fault, BrokenCells(fault, rng)))
                case _:
                    pass

    @property
    def name(self) -> str:
        """Name on the rig."""
        return self.healthy.name

    @property
    def ideal(self) -> Sensor:
        """The sensor without faults and noise."""
        return self.healthy.ideal if isinstance(self.healthy, Noisy) else self.healthy

    @property
    def instants_s(self) -> tuple[float, ...]:
        """When it looks, as offsets from the stamp [s]."""
        return self.healthy.instants_s

    def rig_sensor(self) -> RigSensor:
        """What a tracker is told of the sensor; of its faults it is told nothing."""
        return self.healthy.rig_sensor()

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """The reading with the faults of this stamp in it; the state is the healthy sensor's and the last report."""
        carried: _FaultyState = state if state is not None else _FaultyState()
        before = [each.effect for each in self._before if each.fault.holds(stamp_ns)]
        if before:
            reading, inner = self._obstructed(before, stamp_ns, snapshots, carried.inner, rng)
        else:
            reading, inner = self.healthy.observe(stamp_ns, snapshots, carried.inner, rng)
        observation = reading.observation
        for each in self._within:
            if each.fault.holds(stamp_ns):
                observation = each.effect.spoil(observation)
        held = None
        if self._freezes:
            held = carried.held
            if held is None or not any(fault.holds(stamp_ns) for fault in self._freezes):
                held = observation
            observation = held if held is observation else replace(held, stamp_ns=stamp_ns)
        return Reading(observation, reading.truth), _FaultyState(inner, held)

    def _obstructed(
        self,
        effects: list[Effect],
        stamp_ns: int,
        snapshots: Iterable[Snapshot],
        state: State,
        rng: np.random.Generator,
    ) -> tuple[Reading, State]:
        """The reading with something before the sensor: under its noise where it has some."""
        if not isinstance(self.healthy, Noisy):
            reading, state = self.healthy.observe(stamp_ns, snapshots, state, rng)
            return Reading(_spoilt(effects, reading.observation), reading.truth), state
        sensor_state, noise_state = state if state is not None else (None, None)
        reading, sensor_state = self.healthy.ideal.observe(stamp_ns, snapshots, sensor_state, rng)
        noise = self.healthy.noise
        # Drawn as without the fault: what noise draws may depend on what it sees.
        _, noise_state = noise.corrupt(reading.observation, noise_state, rng)
        own = stream(self._seed, "fault noise", f"{self.name}/{stamp_ns}")
        observation, _ = noise.corrupt(_spoilt(effects, reading.observation), noise_state, own)
        return Reading(observation, reading.truth), (sensor_state, noise_state)


def with_faults(healthy: Sensor, faults: Mapping[str, Fault], seed: int) -> Sensor:
    """The sensor with those of the faults that are its own; itself where there are none but of its messages."""
    own = {name: fault for name, fault in faults.items() if healthy.name in fault.sensor}
    if any(isinstance(fault, Freeze | Occlusion | BlockedSector | DeadBeams | DeadCells) for fault in own.values()):
        return Faulty(healthy, own, seed)
    return healthy


def _spoilt(effects: list[Effect], observation: Observation) -> Observation:
    for effect in effects:
        observation = effect.spoil(observation)
    return observation


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
