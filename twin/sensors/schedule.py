"""Schedule of all sensors: stamps, delays and losses of their observations."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from operator import attrgetter

import numpy as np
from pydantic import Field

from trackers.configuration import Strict
from trackers.observations import NS_PER_S
from twin.instant.snapshot import SnapshotSource
from twin.sensors.fault_kinds import ClockError, Delay, Dropout, Fault
from twin.sensors.sensor import Reading, Sensor, State
from twin.streams import stream

_PPM = 1e-6


class Timing(Strict):
    """Timing of a sensor: stamps, delays and losses of its observations.

    Stamps are phase_s + k / rate_hz. An observation arrives `delay_s` after its last instant (the end of a sweep), and a
    uniform draw from [0, `jitter_s`] later: with jitter beyond a period, observations may overtake each other. It is lost with
    probability `dropout`. The stamp of its message has a Gaussian error of `stamp_jitter_s`.
    """

    rate_hz: float = Field(ge=0.001, le=1000, description="observations per second [Hz]")
    phase_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        description="time of the first observation since the start; later ones follow every 1 / rate_hz [s]",
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
    stamp_jitter_s: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="standard deviation of the stamp in a message about the true one [s]; 0: exact",
        exclude_if=lambda jitter_s: jitter_s == 0,
    )


class MessageFaults:
    """Faults of one sensor's messages by name: lost, late, or stamped by a wrong clock.

    Every method takes the true stamp [ns]. Each draw for a stamp has its own stream: faults do not change each other's draws,
    and a fault cut short keeps the draws of the rest.
    """

    def __init__(self, sensor: str, faults: Mapping[str, Fault], seed: int) -> None:
        self._sensor, self._seed = sensor, seed
        own = {name: fault for name, fault in faults.items() if sensor in fault.sensor}
        self._dropouts = {name: fault for name, fault in own.items() if isinstance(fault, Dropout)}
        self._delays = {name: fault for name, fault in own.items() if isinstance(fault, Delay)}
        self._clocks = [fault for fault in own.values() if isinstance(fault, ClockError)]
        silences = [fault for fault in self._dropouts.values() if fault.to_s is None and fault.probability == 1]
        self._silent_from_ns = min((fault.from_ns for fault in silences), default=None)

    def is_lost(self, stamp_ns: int) -> bool:
        """Draw whether the observation is lost after it was made."""
        return any(
            fault.holds(stamp_ns) and self._generator(name, stamp_ns).random() < fault.probability
            for name, fault in self._dropouts.items()
        )

    def loses_all(self, stamp_ns: int) -> bool:
        """Return whether all observations at this time are lost."""
        return any(fault.probability == 1 and fault.holds(stamp_ns) for fault in self._dropouts.values())

    def is_silent_from(self, stamp_ns: int) -> bool:
        """Return whether this and all later observations are lost, so that none needs to be made."""
        return self._silent_from_ns is not None and stamp_ns >= self._silent_from_ns

    def extra_delay_ns(self, stamp_ns: int) -> int:
        """Draw the additional delay of the observation [ns]."""
        late_s = 0.0
        for name, fault in self._delays.items():
            if fault.holds(stamp_ns):
                late_s += fault.delay_s + fault.jitter_s * self._generator(name, stamp_ns).random()
        return round(late_s * NS_PER_S)

    def reported_stamp_ns(self, stamp_ns: int, jitter_s: float = 0.0) -> int:
        """Return the stamp in the message [ns]; below 0 for a clock that is behind the start of the run.

        jitter_s: standard deviation of the stamp [s]; jitter alone takes no stamp below 0.
        """
        reported_ns = stamp_ns
        if jitter_s:
            reported_ns += round(jitter_s * NS_PER_S * self._generator("stamp jitter", stamp_ns).normal())
            reported_ns = max(reported_ns, 0)
        for fault in self._clocks:
            if fault.holds(stamp_ns):
                gained_ns = fault.drift_ppm * _PPM * (stamp_ns - fault.from_ns)
                reported_ns += round(fault.offset_s * NS_PER_S + gained_ns)
        return reported_ns

    def _generator(self, fault: str, stamp_ns: int) -> np.random.Generator:
        return stream(self._seed, "fault", f"{fault}/{self._sensor}/{stamp_ns}")


@dataclass(frozen=True, eq=False)
class Scheduled:
    """A sensor, its timing, and a generator with separate streams for timing and noise."""

    sensor: Sensor
    timing: Timing
    rng: np.random.Generator
    faults: MessageFaults = field(default_factory=lambda: MessageFaults("", {}, 0))


@dataclass(frozen=True)
class SensorEvent:
    """One observation of a sensor in the schedule; `dropped`: it never arrives."""

    sensor: str
    stamp_ns: int
    arrival_ns: int
    dropped: bool


_Look = tuple[int, int, SensorEvent, bool]
"""Stamp [ns], index of the sensor, event, and is_made."""


@dataclass(frozen=True, eq=False)
class Delivery:
    """A reading on arrival; `stamp_ns` is the true time of the measurement, whatever the message says."""

    stamp_ns: int
    arrival_ns: int
    reading: Reading


class Schedule:
    """Observations of all sensors of a world over `duration_s`, and their readings in order of arrival.

    Every iteration is the same. Timing and noise draw from separate streams, so that noise does not change arrivals. Stamps lie
    in [0, duration_s); equal stamps are taken in the order of `sensors`.
    """

    def __init__(self, sensors: Sequence[Scheduled], duration_s: float) -> None:
        names = [scheduled.sensor.name for scheduled in sensors]
        if len(set(names)) < len(names):
            raise ValueError(f"sensor names {names} repeat; each must be there once")
        self._sensors = tuple(sensors)
        self._end_ns = round(duration_s * NS_PER_S)
        self._seeds = [scheduled.rng.bit_generator.seed_seq.spawn(2) for scheduled in sensors]

    def observe(self, world: SnapshotSource, ordered: Iterator[_Look] | None = None) -> Iterator[Delivery]:
        """Yield deliveries in order of arrival; snapshots of the world are taken in order of stamps.

        `ordered`: what `ordered` gives, if it was called before.

        Only readings that have not arrived are held, so memory does not grow with the duration. The world must be able to go
        back by the longest sweep.
        """
        noise = [np.random.default_rng(noise_seed) for _, noise_seed in self._seeds]
        states: list[State] = [None] * len(self._sensors)
        waiting: list[tuple[int, int, Delivery]] = []  # by arrival, those that arrive together by their measurement
        for number, (_, place, event, made) in enumerate(ordered or self.ordered()):
            # Whatever is measured from here on arrives no earlier than its stamp.
            while waiting and waiting[0][0] <= event.stamp_ns:
                yield heapq.heappop(waiting)[2]
            if not made:
                continue
            sensor = self._sensors[place].sensor
            snapshots = (world.snapshot(event.stamp_ns / NS_PER_S + offset) for offset in sensor.instants_s)
            reading, states[place] = sensor.observe(event.stamp_ns, snapshots, states[place], noise[place])
            if event.dropped:
                continue
            scheduled = self._sensors[place]
            reported_ns = scheduled.faults.reported_stamp_ns(event.stamp_ns, scheduled.timing.stamp_jitter_s)
            if reported_ns != event.stamp_ns:
                reading = replace(reading, observation=replace(reading.observation, stamp_ns=reported_ns))
            delivery = Delivery(event.stamp_ns, event.arrival_ns, reading)
            heapq.heappush(waiting, (event.arrival_ns, number, delivery))
        while waiting:
            yield heapq.heappop(waiting)[2]

    def ordered(self) -> Iterator[_Look]:
        """Yield stamp [ns], index of the sensor, event, and is_made (the observation is made), in order of stamps."""
        return heapq.merge(*(self._looks(place) for place in range(len(self._sensors))), key=lambda look: look[:2])

    def _looks(self, place: int) -> Iterator[_Look]:
        """Yield the events of one sensor."""
        scheduled = self._sensors[place]
        timing, sensor, faults = scheduled.timing, scheduled.sensor, scheduled.faults
        rng = np.random.default_rng(self._seeds[place][0])
        complete_s = sensor.instants_s[-1] + timing.delay_s
        number = 0
        while (stamp_ns := round((timing.phase_s + number / timing.rate_hz) * NS_PER_S)) < self._end_ns:
            # Both are drawn whether needed or not, so that jitter does not move drop-outs, nor the other way round.
            late, lost = rng.random(2).tolist()
            arrival_ns = (
                stamp_ns + round((complete_s + timing.jitter_s * late) * NS_PER_S) + faults.extra_delay_ns(stamp_ns)
            )
            dropped = bool(lost < timing.dropout)
            # What a fault loses is made all the same, so that noise goes on after it as if there had been none.
            made = not dropped and not faults.is_silent_from(stamp_ns)
            event = SensorEvent(sensor.name, stamp_ns, arrival_ns, dropped or faults.is_lost(stamp_ns))
            yield stamp_ns, place, event, made
            number += 1


ComingStamp = tuple[int, set[str]]
"""A stamp [ns], and the names of its sensors."""


class ComingStamps:
    """Stamps of the observations of a schedule, and the sensors of each, read some time ahead."""

    def __init__(self, looks: Iterator[_Look], ahead_s: float) -> None:
        """looks: as `Schedule.ordered` gives them."""
        by_stamp = groupby((event for _, _, event, _ in looks), key=attrgetter("stamp_ns"))
        self._rest = ((stamp_ns, {event.sensor for event in events}) for stamp_ns, events in by_stamp)
        self._coming: deque[ComingStamp] = deque()
        self._beyond: ComingStamp | None = None  # read, but too far ahead of those coming
        self._ahead_ns = round(ahead_s * NS_PER_S)
        self._prepared_ns = -1

    def until(self, t: float, prepare: Callable[[list[ComingStamp]], object]) -> Iterator[ComingStamp]:
        """Yield the stamps until time t [s] that were not yielded before.

        prepare: called with all stamps within `ahead_s`, if there are several, before the first of them is yielded.
        """
        while (coming := self._coming or self._read()) and coming[0][0] <= t * NS_PER_S:
            if coming[0][0] > self._prepared_ns:
                self._prepared_ns = coming[-1][0]
                if len(coming) > 1:
                    prepare(list(coming))
            yield coming.popleft()

    def _read(self) -> deque[ComingStamp]:
        """Read the next stamps; one alone at the start, so that the first observation need not wait for more."""
        while each := self._beyond or next(self._rest, None):
            self._beyond = None
            if self._coming and each[0] - self._coming[0][0] > self._ahead_ns:
                self._beyond = each
                break
            self._coming.append(each)
            if self._prepared_ns < 0:
                break
        return self._coming
