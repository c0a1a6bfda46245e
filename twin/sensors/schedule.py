"""One scheduler around all sensors: when each looks, how late its observations arrive, and whether at all."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from pydantic import Field

from trackers.configuration import Strict
from trackers.observations import NS_PER_S
from twin.instant.snapshot import SnapshotSource
from twin.sensors.sensor import Reading, Sensor, State


class Timing(Strict):
    """When a sensor looks, and when and whether its observations arrive.

    Stamps are phase_s + k / rate_hz. An observation arrives `delay_s` after its last instant (the end of a sweep), and
    up to `jitter_s` later still, drawn evenly: with jitter beyond a period, one may overtake another. It is lost with
    probability `dropout`.
    """

    rate_hz: float = Field(ge=0.001, le=1000, description="looks a second [Hz]")
    phase_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        description="time of the first look since the start; later ones follow every 1 / rate_hz [s]",
    )
    delay_s: float = Field(
        default=0.0, ge=0, le=60, description="how long after its last instant an observation arrives [s]"
    )
    jitter_s: float = Field(
        default=0.0, ge=0, le=60, description="longest further delay, drawn evenly from 0 up for each observation [s]"
    )
    dropout: float = Field(
        default=0.0, ge=0, le=1, description="probability that an observation is lost on the way, 0 to 1"
    )


class MessageFaults(Protocol):
    """What goes wrong with a sensor's messages, asked by the true stamp [ns]; draws from streams of its own."""

    def lost(self, stamp_ns: int) -> bool:
        """Whether the observation is lost on its way, though it was made."""
        ...

    def silent(self, stamp_ns: int) -> bool:
        """Whether this observation and all after it are lost: they need not be made."""
        ...

    def late_ns(self, stamp_ns: int) -> int:
        """How much later the observation arrives than it would without faults [ns]."""
        ...

    def said_ns(self, stamp_ns: int) -> int:
        """What the observation gives as its stamp [ns]."""
        ...


class NoMessageFaults:
    """Every message comes in time, rightly stamped."""

    def lost(self, stamp_ns: int) -> bool:
        """No."""
        return False

    def silent(self, stamp_ns: int) -> bool:
        """No."""
        return False

    def late_ns(self, stamp_ns: int) -> int:
        """0."""
        return 0

    def said_ns(self, stamp_ns: int) -> int:
        """The true stamp [ns]."""
        return stamp_ns


@dataclass(frozen=True, eq=False)
class Scheduled:
    """A sensor, its timing, and the generator from which its timing and its noise draw, each a stream of its own."""

    sensor: Sensor
    timing: Timing
    rng: np.random.Generator
    faults: MessageFaults = field(default_factory=NoMessageFaults)


@dataclass(frozen=True)
class Event:
    """One look of a sensor at the world; `dropped`: its observation never arrives."""

    sensor: str
    stamp_ns: int
    arrival_ns: int
    dropped: bool


@dataclass(frozen=True, eq=False)
class Delivery:
    """A reading that arrives; `stamp_ns` is when it was truly made, whatever the clock that stamped it said."""

    stamp_ns: int
    arrival_ns: int
    reading: Reading


@dataclass(order=True)
class _Waiting:
    """A reading on its way; of two that arrive together the one measured first comes first."""

    arrival_ns: int
    number: int
    delivery: Delivery = field(compare=False)


class Schedule:
    """The looks of all sensors at a world over `duration_s`, and their readings in order of arrival.

    The same at every iteration. Timing and noise draw from separate streams: a change of noise moves no arrival. Stamps
    lie in [0, duration_s); two at the same moment are taken in the order of `sensors`.
    """

    def __init__(self, sensors: Sequence[Scheduled], duration_s: float) -> None:
        names = [scheduled.sensor.name for scheduled in sensors]
        if len(set(names)) < len(names):
            raise ValueError(f"sensor names {names} repeat; each must be there once")
        self._sensors = tuple(sensors)
        self._end_ns = round(duration_s * NS_PER_S)
        self._seeds = [scheduled.rng.bit_generator.seed_seq.spawn(2) for scheduled in sensors]

    def events(self) -> Iterator[Event]:
        """All looks in order of their stamps, those whose observation is lost included."""
        return (event for _, _, event, _ in self._ordered())

    def observe(self, world: SnapshotSource) -> Iterator[Delivery]:
        """What arrives, in order of arrival; the world is asked for snapshots in order of stamps.

        Only what is on its way is held: memory does not grow with the duration. The world must be able to go back by
        the longest sweep.
        """
        noise = [np.random.default_rng(noise_seed) for _, noise_seed in self._seeds]
        states: list[State] = [None] * len(self._sensors)
        waiting: list[_Waiting] = []
        for number, (_, place, event, made) in enumerate(self._ordered()):
            # Whatever is measured from here on arrives no earlier than its stamp.
            while waiting and waiting[0].arrival_ns <= event.stamp_ns:
                yield heapq.heappop(waiting).delivery
            if not made:
                continue
            sensor = self._sensors[place].sensor
            snapshots = (world.snapshot(event.stamp_ns / NS_PER_S + offset) for offset in sensor.instants_s)
            reading, states[place] = sensor.observe(event.stamp_ns, snapshots, states[place], noise[place])
            if event.dropped:
                continue
            said_ns = self._sensors[place].faults.said_ns(event.stamp_ns)
            if said_ns != event.stamp_ns:
                reading = replace(reading, observation=replace(reading.observation, stamp_ns=said_ns))
            delivery = Delivery(event.stamp_ns, event.arrival_ns, reading)
            heapq.heappush(waiting, _Waiting(event.arrival_ns, number, delivery))
        while waiting:
            yield heapq.heappop(waiting).delivery

    def _ordered(self) -> Iterator[tuple[int, int, Event, bool]]:
        """(stamp, place of the sensor, event, whether an observation is made) in order."""
        return heapq.merge(*(self._looks(place) for place in range(len(self._sensors))), key=lambda look: look[:2])

    def _looks(self, place: int) -> Iterator[tuple[int, int, Event, bool]]:
        """The looks of one sensor."""
        scheduled = self._sensors[place]
        timing, sensor, faults = scheduled.timing, scheduled.sensor, scheduled.faults
        rng = np.random.default_rng(self._seeds[place][0])
        complete_s = sensor.instants_s[-1] + timing.delay_s
        number = 0
        while (stamp_ns := round((timing.phase_s + number / timing.rate_hz) * NS_PER_S)) < self._end_ns:
            # Both are drawn whether needed or not, so that jitter does not move drop-outs, nor the other way round.
            late, lost = rng.random(2)
            arrival_ns = stamp_ns + round((complete_s + timing.jitter_s * late) * NS_PER_S) + faults.late_ns(stamp_ns)
            dropped = bool(lost < timing.dropout)
            # What a fault loses is made all the same, so that noise goes on after it as if there had been none.
            made = not dropped and not faults.silent(stamp_ns)
            event = Event(sensor.name, stamp_ns, arrival_ns, dropped or faults.lost(stamp_ns))
            yield stamp_ns, place, event, made
            number += 1
