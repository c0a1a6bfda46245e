"""A scenario in motion: what its sensors report, in order of arrival, and the truth as the clock passes it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from operator import attrgetter
from types import TracebackType
from typing import Self

import numpy as np

from trackers.errors import InputError
from trackers.observations import NS_PER_S, Observation
from trackers.rig import Rig, RigSensor
from twin.mounts import check_mount
from twin.recording.messages import Encoded, encode
from twin.scenario import Scenario
from twin.scenario.floor import FloorDescription, check_floor
from twin.scenario.sensors import build_sensor
from twin.scene import foot_shapes
from twin.sensors.floor import Floor
from twin.sensors.render import GlInfo, RendererOnDemand
from twin.sensors.schedule import Schedule, Scheduled
from twin.sensors.sensor import Noisy, Reading, Sensor, State
from twin.snapshot import Snapshot
from twin.streams import stream
from twin.truth import TruthFrame
from twin.visibility import sensor_view
from twin.world import World


@dataclass(frozen=True, eq=False, slots=True)
class Delivered:
    """An observation as its message, when it arrives [ns], and what only the twin knows of it."""

    encoded: Encoded
    arrival_ns: int
    reading: Reading


@dataclass(eq=False)
class TimedSensor:
    """A sensor and what its observations cost."""

    sensor: Sensor
    frames: int = 0
    spent_s: float = 0.0

    @property
    def name(self) -> str:
        """Name on the rig."""
        return self.sensor.name

    @property
    def ideal(self) -> Sensor:
        """The sensor without its noise."""
        return self.sensor.ideal if isinstance(self.sensor, Noisy) else self.sensor

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
        """What a tracker is told of the sensor."""
        return self.sensor.rig_sensor()


class Simulation:
    """The observations of a scenario, decoded from their messages as a replay would give them; a context manager.

    Iterating yields them in order of arrival, once. `rig` is what a tracker may know of the sensors. `on_truth` is
    called with the truth at every stamp of every sensor, in order of time, before the observation of that stamp
    comes. With `images=False` the cameras are left out, and nothing is rendered.

    Raises InputError for a scenario that cannot be: a person or sensor in a wall, people in each other.
    """

    def __init__(
        self, scenario: Scenario, *, images: bool = True, on_truth: Callable[[TruthFrame], object] | None = None
    ) -> None:
        self.scenario = scenario
        self.world = World(scenario)
        self._renderer = RendererOnDemand(self.world.scene.model)
        self._descriptions = {
            name: description
            for name, description in scenario.sensors.items()
            if images or description.kind != "fisheye"
        }
        if not self._descriptions:
            raise InputError(
                f"scenario {scenario.name!r}: sensors: without images none of {', '.join(scenario.sensors)} is left; "
                "a laser or a floor, or a run with images, is expected"
            )
        shapes = partial(foot_shapes, self.world.scene)
        self._sensors = {
            name: TimedSensor(
                build_sensor(
                    name, description, self._renderer, shapes=shapes, device=stream(scenario.seed, "device", name)
                )
            )
            for name, description in self._descriptions.items()
        }
        area = tuple((float(x), float(y)) for x, y in self.world.scene.area)
        self.rig = Rig(sensors={name: sensor.rig_sensor() for name, sensor in self._sensors.items()}, area=area)
        self._check_mounts()
        self._on_truth = on_truth
        self.views = {
            name: view
            for name, sensor in self.rig.sensors.items()
            if (view := sensor_view(sensor, self._descriptions[name])) is not None
        }
        self._floors = {
            name: timed.ideal.cells_of_feet for name, timed in self._sensors.items() if isinstance(timed.ideal, Floor)
        }
        scheduled = [
            Scheduled(sensor, self._descriptions[name], stream(scenario.seed, "sensor", name))
            for name, sensor in self._sensors.items()
        ]
        self._schedule = Schedule(scheduled, scenario.duration_s)
        self._truth_stamps = groupby(self._schedule.events(), key=attrgetter("stamp_ns"))
        self._next_truth = self._following_truth()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def __iter__(self) -> Iterator[Observation]:
        return (delivered.encoded.observation for delivered in self.deliveries())

    def background(self) -> list[Observation]:
        """What each sensor sees of the empty room; nothing where the scenario's background is 'none'."""
        return [encoded.observation for encoded in self.background_messages()]

    def background_messages(self) -> Iterator[Encoded]:
        """The empty room as messages, sensor by sensor, stamped from 0 at the sensor's rate."""
        if self.scenario.background == "none":
            return
        for name, timed in self._sensors.items():
            rng, state = stream(self.scenario.seed, "background", name), None
            for k in range(self.scenario.background_frames):
                stamp_ns = round(k / self._descriptions[name].rate_hz * NS_PER_S)
                snapshots = (self.world.empty_snapshot(stamp_ns / NS_PER_S + offset) for offset in timed.instants_s)
                reading, state = timed.sensor.observe(stamp_ns, snapshots, state, rng)
                yield encode(reading.observation)

    def deliveries(self) -> Iterator[Delivered]:
        """Every observation with its message and its truth, in order of arrival, once."""
        for delivery in self._schedule.observe(self):
            yield Delivered(encode(delivery.reading.observation), delivery.arrival_ns, delivery.reading)
        self._tell_truth_until(self.scenario.duration_s)

    def look(self, stamp_ns: int) -> dict[str, Observation]:
        """What each sensor would report at one stamp, by name, outside its schedule."""
        looks = {}
        for name, timed in self._sensors.items():
            rng = stream(self.scenario.seed, "look", name)
            snapshots = (self.world.snapshot(stamp_ns / NS_PER_S + offset) for offset in timed.instants_s)
            reading, _ = timed.sensor.observe(stamp_ns, snapshots, None, rng)
            looks[name] = encode(reading.observation).observation
        return looks

    def snapshot(self, t: float) -> Snapshot:
        """The world at time t [s], after the truth of every stamp until then has been told."""
        self._tell_truth_until(t)
        return self.world.snapshot(t)

    def gl_info(self) -> GlInfo | None:
        """The OpenGL that renders; None in a run without cameras."""
        return self._renderer().gl_info() if self.rig.cameras() else None

    def sensor_costs(self) -> dict[str, dict[str, float | int | None]]:
        """By sensor, how many observations were made and what one cost [ms]."""
        return {
            name: {"frames": timed.frames, "ms_mean": 1e3 * timed.spent_s / timed.frames if timed.frames else None}
            for name, timed in self._sensors.items()
        }

    def _tell_truth_until(self, t: float) -> None:
        while self._next_truth is not None and self._next_truth[0] <= t * NS_PER_S:
            stamp_ns, sensors = self._next_truth
            if self._on_truth is not None:
                floors = {name: cells_of for name, cells_of in self._floors.items() if name in sensors}
                self._on_truth(self.world.truth(stamp_ns, self.views, floors))
            self._next_truth = self._following_truth()

    def _following_truth(self) -> tuple[int, set[str]] | None:
        """The next stamp at which a sensor looks, and which do."""
        stamp_ns, events = next(self._truth_stamps, (None, ()))
        return None if stamp_ns is None else (stamp_ns, {event.sensor for event in events})

    def _check_mounts(self) -> None:
        snapshot = self.world.empty_snapshot(0.0)
        for name, sensor in self.rig.sensors.items():
            field_name = f"scenario {self.scenario.name!r}: sensors.{name}"
            description = self._descriptions[name]
            if isinstance(description, FloorDescription):
                check_floor(description, self.world.scene.floor, field_name)
                continue
            check_mount(snapshot.model, snapshot.data, f"{field_name}.mount.xyz", sensor.room_from_sensor.translation)
