"""Contracts of a sensor and of noise, and layers around an ideal sensor: noise, faults, and the measurement of its cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from trackers.observations import Observation
from trackers.rig import RigSensor
from twin.instant.snapshot import Snapshot
from twin.sensors.fault_effects import DeadBeamMask, DeadCellMask, LensCover, SectorBlock
from twin.sensors.fault_kinds import BlockedSector, DeadBeams, DeadCells, Fault, Freeze, LensOcclusion
from twin.streams import stream

State = Any
"""State of a sensor between observations, private to it; None before the first."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Observation and its truth, which is never given to a tracker.

    A scanner's truth holds `person_of_ray` (n_beam,) int16: id of the person met by the ideal ray within range, 0 for the
    room or nothing, and `range_m` (n_beam,) float32: the ideal ranges. A floor's truth: see `twin.sensors.floor.Floor`.
    """

    observation: Observation  # what a tracker is given
    truth: dict[str, NDArray] = field(default_factory=dict)  # arrays by name


@runtime_checkable
class Sensor(Protocol):
    """A sensor observes the world at declared instants and reports one reading; it has no clock and no delay."""

    @property
    def name(self) -> str:
        """Name on the rig."""
        ...

    @property
    def instants_s(self) -> tuple[float, ...]:
        """Instants of an observation, as offsets from the stamp [s], ascending from 0 or later: one, or many over a sweep."""
        ...

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the reading stamped `stamp_ns`, from one snapshot per instant, in order; and the new state.

        Each snapshot is used up before the next is taken. All randomness comes from `rng`. The arrays of a reading are its
        own: later observations do not change them.
        """
        ...

    def rig_sensor(self) -> RigSensor:
        """Return the tracker's view of this sensor."""
        ...


class Noise(Protocol):
    """Layer that turns the ideal observation into a real device's."""

    def corrupt(self, observation: Any, state: State, rng: np.random.Generator) -> tuple[Observation, State]:
        """Return the noisy observation (the ideal one stays untouched), and the noise's state after it (None at first)."""
        ...


class Layer:
    """A sensor around another, the `inner` one, whose name, instants and rig entry it has."""

    inner: Sensor

    @property
    def name(self) -> str:
        """Name on the rig."""
        return self.inner.name

    @property
    def instants_s(self) -> tuple[float, ...]:
        """Instants of the inner sensor, as offsets from the stamp [s]."""
        return self.inner.instants_s

    @property
    def ideal(self) -> Sensor:
        """The sensor without any layer, so without noise and faults."""
        return self.inner.ideal if isinstance(self.inner, Layer) else self.inner

    def rig_sensor(self) -> RigSensor:
        """Return the tracker's view of the inner sensor: noise, faults and cost do not show in it."""
        return self.inner.rig_sensor()


@dataclass(frozen=True, eq=False)
class Noisy(Layer):
    """A sensor with a layer of noise around its ideal readings; the truth stays that of the ideal reading."""

    inner: Sensor
    noise: Noise

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the ideal reading with noise on its observation; the state is the sensor's and the noise's."""
        sensor_state, noise_state = state if state is not None else (None, None)
        reading, sensor_state = self.inner.observe(stamp_ns, snapshots, sensor_state, rng)
        observation, noise_state = self.noise.corrupt(reading.observation, noise_state, rng)
        return Reading(observation, reading.truth), (sensor_state, noise_state)


class Effect(Protocol):
    """The effect of a fault on observations while it is present."""

    def apply(self, observation: Any) -> Observation:
        """Return the observation of the faulty sensor; the given one stays untouched."""
        ...


@dataclass(frozen=True, eq=False)
class _FaultyState:
    """State of a faulty sensor: the sensor's own, and its last observation if it may freeze."""

    inner: State = None
    held: Observation | None = None


class Faulty(Layer):
    """Sensor with faults; its truth, its rig entry and its behaviour outside their times are the healthy one's.

    An obstruction (a cover on the lens, an obstacle before the scanner) comes before the noise, a defect after it, and
    freezing repeats all of it. The sensor continues to measure and draw noise during a fault, so that afterwards nothing has
    changed; the noise of changed values has its own stream.
    """

    def __init__(self, healthy: Sensor, faults: Mapping[str, Fault], seed: int) -> None:
        """Prepare the effects; `faults`: by name, those of this sensor; those of its messages are left to the schedule."""
        self.inner = healthy
        self._seed = seed
        self._before: list[tuple[Fault, Effect]] = []
        self._within: list[tuple[Fault, Effect]] = []
        self._freezes = [fault for fault in faults.values() if isinstance(fault, Freeze)]
        for name, fault in faults.items():
            rng = stream(seed, "fault", f"{name}/{healthy.name}")
            match fault:
                case LensOcclusion():
                    self._before.append((fault, LensCover(fault, healthy.rig_sensor(), rng)))
                case BlockedSector():
                    self._before.append((fault, SectorBlock(fault)))
                case DeadBeams():
                    self._within.append((fault, DeadBeamMask(fault, rng)))
                case DeadCells():
                    self._within.append((fault, DeadCellMask(fault, rng)))
                case _:
                    pass

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the reading with the faults of this stamp in it; the state is the healthy sensor's and the last observation."""
        carried: _FaultyState = state if state is not None else _FaultyState()
        before = [effect for fault, effect in self._before if fault.holds(stamp_ns)]
        if before:
            reading, inner = self._obstructed(before, stamp_ns, snapshots, carried.inner, rng)
        else:
            reading, inner = self.inner.observe(stamp_ns, snapshots, carried.inner, rng)
        within = [effect for fault, effect in self._within if fault.holds(stamp_ns)]
        observation = _applied(within, reading.observation)
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
        """Return the reading with an obstruction before the sensor: under its noise where it has some."""
        if not isinstance(self.inner, Noisy):
            reading, state = self.inner.observe(stamp_ns, snapshots, state, rng)
            return Reading(_applied(effects, reading.observation), reading.truth), state
        sensor_state, noise_state = state if state is not None else (None, None)
        reading, sensor_state = self.inner.inner.observe(stamp_ns, snapshots, sensor_state, rng)
        noise = self.inner.noise
        # Drawn as without the fault: noise may draw by its input.
        _, noise_state = noise.corrupt(reading.observation, noise_state, rng)
        own = stream(self._seed, "fault noise", f"{self.name}/{stamp_ns}")
        observation, _ = noise.corrupt(_applied(effects, reading.observation), noise_state, own)
        return Reading(observation, reading.truth), (sensor_state, noise_state)


def with_faults(healthy: Sensor, faults: Mapping[str, Fault], seed: int) -> Sensor:
    """Wrap a sensor in those of the faults that are its own; returns it unchanged where only its messages have faults."""
    own = {name: fault for name, fault in faults.items() if healthy.name in fault.sensor}
    if any(isinstance(fault, Freeze | LensOcclusion | BlockedSector | DeadBeams | DeadCells) for fault in own.values()):
        return Faulty(healthy, own, seed)
    return healthy


def _applied(effects: list[Effect], observation: Observation) -> Observation:
    for effect in effects:
        observation = effect.apply(observation)
    return observation


@dataclass(eq=False)
class TimedSensor(Layer):
    """A sensor and the measured cost of its observations."""

    inner: Sensor
    frames: int = 0
    spent_s: float = 0.0
    on_reading: Callable[[str, int, Reading], object] = lambda sensor, stamp_ns, reading: None

    @property
    def healthy(self) -> Sensor:
        """The sensor without its faults."""
        return self.inner.inner if isinstance(self.inner, Faulty) else self.inner

    def observe(
        self, stamp_ns: int, snapshots: Iterable[Snapshot], state: State, rng: np.random.Generator
    ) -> tuple[Reading, State]:
        """Return the sensor's reading, and measure its time."""
        start = time.perf_counter()
        result = self.inner.observe(stamp_ns, self._without_the_world(snapshots), state, rng)
        self.spent_s += time.perf_counter() - start
        self.frames += 1
        self.on_reading(self.name, stamp_ns, result[0])
        return result

    def _without_the_world(self, snapshots: Iterable[Snapshot]) -> Iterator[Snapshot]:
        """Yield the snapshots, excluding the time of moving the world to them."""
        start = time.perf_counter()
        for snapshot in snapshots:
            self.spent_s -= time.perf_counter() - start
            yield snapshot
            start = time.perf_counter()
        self.spent_s -= time.perf_counter() - start
