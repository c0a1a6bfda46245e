"""A scenario in motion: the sensors' observations in order of arrival, and the truth as time passes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import tee
from typing import NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError, valid_names
from trackers.observations import NS_PER_S, Observation
from trackers.rig import OdometrySensor, Rig
from twin.geometry.geom_hull import unlikely_meshes
from twin.instant.snapshot import FootShapes, Snapshot
from twin.people.population import randomized
from twin.people.posture.posture_rows import AHEAD_S
from twin.people.script.recorded import (
    WALKING_WARNING,
    close_calls,
    describe_close_calls,
    describe_late_actions,
    describe_speeds,
)
from twin.recording.ros.ros_messages import Encoded, encode
from twin.room.building import check_mounts
from twin.room.mjcf import DARK_LIGHT, light_of
from twin.scenario import Scenario
from twin.scenario.housings import assumed_sensor, base_of, driven, held_sensor, odometry_sensor
from twin.scenario.load import check_scenario
from twin.scenario.scenario import describe_circles, describe_late_starts
from twin.scenario.sensor_descriptions import CAMERA_KINDS, build_sensor
from twin.sensors.floor import Floor
from twin.sensors.gl_context import GlInfo
from twin.sensors.odometry import BaseOdometry
from twin.sensors.render import RendererOnDemand
from twin.sensors.schedule import ComingStamp, ComingStamps, MessageFaults, Schedule, Scheduled, Timing
from twin.sensors.sensor import Reading, Sensor, TimedSensor, with_faults
from twin.streams import stream
from twin.truth.situations import Pair, PairState
from twin.truth.truth_types import Box, TruthDetail, TruthFrame
from twin.truth.visibility import PersonImaging, person_boxes, sees_any_of, sensor_view
from twin.world.scene import foot_shapes
from twin.world.truth_details import TruthDetails
from twin.world.world import LONGEST_LOOK_S, PrecomputedScene, World, trim_heap


@dataclass(frozen=True, eq=False, slots=True)
class Delivered:
    """Observation as its message, its time of arrival [ns], and truths about it.

    `observation`: as a tracker decodes it, with a stamp on the rig's clock. `stamp_ns`: when it was truly made.
    """

    encoded: Encoded
    arrival_ns: int
    reading: Reading
    observation: Observation
    stamp_ns: int


class Simulation:
    """The observations of a scenario, decoded from their messages as a replay would give them; a context manager.

    Iterating yields them in order of arrival, once: like a file, a simulation goes on where it was left, by whatever loop,
    and one that has ended or failed refuses another loop. Make another for another look; of the same scenario it is the
    same to the bit. `rig` is what trackers assume of the sensors, calibration errors included; `true_rig` is the truth.
    `on_truth` is called with the truth at every stamp of every sensor, in order of time, before the observation of that
    stamp comes. `on_detail` is called with what goes with pictures, scans and situations (`twin.world.truth_details`) as they
    are measured; without it none of that is found out. With `images=False` cameras are left out, and nothing is rendered.

    `precomputed`: its people as they have moved before, with their bodies, whatever sensors looked then: nothing of them is done
    again, and every bit is the same. Without `shares` the truth does not say how much of whom a sensor sees, without
    `feet` nothing of feet. `drawn`: others than its cameras draw the world: people need faces, and do what is shown.

    `warnings`: what can be, but is hardly meant, one sentence each.

    Raises InputError for a scenario that cannot be: a person or sensor in a wall, people in each other; and RuntimeError
    for iterating after the end, after an error, or once it is closed.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        images: bool = True,
        on_truth: Callable[[TruthFrame], object] | None = None,
        on_detail: Callable[[TruthDetail], object] | None = None,
        precomputed: PrecomputedScene | None = None,
        shares: bool = True,
        feet: bool = True,
        drawn: bool = False,
    ) -> None:
        check_scenario(scenario)
        self.scenario = scenario = randomized(scenario)
        self._descriptions = {
            name: held_sensor(scenario, name)
            for name, description in scenario.sensors.items()
            if images or description.kind not in CAMERA_KINDS
        }
        photographed = any(each.kind in CAMERA_KINDS for each in self._descriptions.values())
        self.world = world = World(scenario, precomputed, pictures=drawn or photographed)
        self._renderer = RendererOnDemand(
            lambda: world.scene.model, shadows=scenario.rendering.shadows, samples=scenario.rendering.samples
        )
        if not self._descriptions:
            raise InputError(
                f"{scenario.source}: sensors: without images none of {', '.join(scenario.sensors)} is left; "
                "a laser or a floor, or a run with images, is expected"
            )
        shapes = partial(foot_shapes, self.world.scene)
        self._sensors = {
            name: TimedSensor(with_faults(self._healthy(name, shapes), scenario.faults, scenario.seed))
            for name in self._descriptions
        }
        self._timing: dict[str, Timing] = dict(self._descriptions)
        for name, housing in driven(scenario).items():
            odometry = BaseOdometry(name, odometry_sensor(scenario, name), housing.odometry)
            self._sensors[name], self._timing[name] = TimedSensor(odometry), housing.odometry
        self.true_rig, self.rig = self._rigs()
        check_mounts(scenario, self._descriptions, world.empty_snapshot(0.0), world.scene.floor)
        self._on_truth, self._shares, self._feet = on_truth, shares, feet
        self.views = {
            name: view
            for name, sensor in self.true_rig.sensors.items()
            if not isinstance(sensor, OdometrySensor)
            and (view := sensor_view(sensor, self._descriptions[name])) is not None
        }
        self.warnings = self._warnings()
        floors = {name: each.ideal for name, each in self._sensors.items() if isinstance(each.ideal, Floor)}
        self._floors = {name: each.cells_of_feet for name, each in floors.items()}
        self._is_asked = on_truth is not None or on_detail is not None
        self._details = self._truth_details(on_detail) if on_detail is not None else None
        self._schedule = Schedule([self._scheduled(name) for name in self._sensors], scenario.duration_s)
        self._ordered, ahead = tee(self._schedule.ordered())
        by_turns = drawn or driven(scenario) or any(each.instants_s != (0.0,) for each in self._sensors.values())
        self._stamps = ComingStamps(ahead, 0.0 if by_turns else AHEAD_S)
        self._truth_ahead: dict[int, tuple[TruthFrame, dict[Pair, PairState]]] = {}
        self._coming: Generator[Delivered] | None = None
        self._over = ""  # reason why it has ended

    def _rigs(self) -> tuple[Rig, Rig]:
        """Return the rig as it is, and as trackers have it."""
        area = tuple((float(x), float(y)) for x, y in self.world.scene.area)
        true = {name: sensor.rig_sensor() for name, sensor in self._sensors.items()}
        main = self.scenario.main_sensor if self.scenario.main_sensor in true else None  # else a camera, left out
        assumed = true | {name: assumed_sensor(each, true[name]) for name, each in self._descriptions.items()}
        rig_of = partial(Rig, area=area, room=self.scenario.room_name, main=main)
        return rig_of(sensors=true), rig_of(sensors=assumed)

    def _scheduled(self, name: str) -> Scheduled:
        """Return a sensor with its schedule, its random stream and the faults of its messages."""
        rng = stream(self.scenario.seed, "sensor", name)
        faults = MessageFaults(name, self.scenario.faults, self.scenario.seed)
        return Scheduled(self._sensors[name], self._timing[name], rng, faults)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the renderer, end the simulation and let go of its listeners, which may refer to it."""
        self._renderer.close()
        self._on_truth = self._details = None
        for timed in self._sensors.values():
            timed.on_reading = TimedSensor.on_reading
        self._over = self._over or "is closed"
        self._coming = None
        trim_heap()

    def __reduce__(self) -> NoReturn:
        named = f"the simulation of {self.scenario.name!r}"
        raise TypeError(f"{named} cannot be copied or pickled; copy its scenario, and make another Simulation of that")

    def __iter__(self) -> Iterator[Observation]:
        return (delivered.observation for delivered in self.deliveries())

    def background(self) -> list[Observation]:
        """Observe the empty room with each sensor; empty if the scenario's background is 'none'."""
        return [self.as_read(encoded) for encoded in self.background_messages()]

    def background_messages(self) -> Iterator[Encoded]:
        """Return the empty room as messages, sensor by sensor, stamped from 0 at the sensor's rate, without faults."""
        if self.scenario.background == "none":
            return
        moving = {*self.rig.mounted(), *self.rig.odometry()}
        for name, timed in self._sensors.items():
            if name in moving:
                continue  # what they see of the empty room depends on where they are
            rng, state = stream(self.scenario.seed, "background", name), None
            for k in range(self.scenario.background_frames):
                stamp_ns = round(k / self._descriptions[name].rate_hz * NS_PER_S)
                snapshots = (self.world.empty_snapshot(stamp_ns / NS_PER_S + offset) for offset in timed.instants_s)
                reading, state = timed.healthy.observe(stamp_ns, snapshots, state, rng)
                yield encode(reading.observation)

    def deliveries(self) -> Iterator[Delivered]:
        """Yield every observation with message and truth, in order of arrival, from where the last loop stopped."""
        self._check_going("is in the loop of another thread" if self._coming and self._coming.gi_running else "")
        if self._coming is None:
            self._coming = self._deliver()
        return (delivered for delivered in self._coming)  # a loop that is left closes its own iterator, not this one

    def _check_going(self, why: str = "") -> None:
        """Raise RuntimeError where the simulation has ended, or for another reason."""
        if why := why or self._over:
            instead = "make another Simulation to iterate again, of the same bits, or keep its observations in a list"
            raise RuntimeError(f"the simulation of {self.scenario.name!r} {why}; {instead}")

    def _deliver(self) -> Generator[Delivered]:
        self._over = stopped = "was stopped by an error"
        for delivery in self._schedule.observe(self, self._ordered):
            reading, encoded = delivery.reading, encode(delivery.reading.observation)
            self._over = ""
            yield Delivered(encoded, delivery.arrival_ns, reading, self.as_read(encoded), delivery.stamp_ns)
            self._check_going()  # closed meanwhile
            self._over = stopped
        self._tell_truth_until(self.scenario.duration_s)
        if self._details is not None:
            self._details.finish(round(self.scenario.duration_s * NS_PER_S))
        self._over = "has come to its end"

    def as_read(self, encoded: Encoded) -> Observation:
        """Return the observation as a tracker decodes its message, on the rig's clock."""
        observation = encoded.observation
        offset_ns = round(self.rig.sensors[observation.sensor].time_offset_s * NS_PER_S)
        return replace(observation, stamp_ns=observation.stamp_ns + offset_ns) if offset_ns else observation

    def look(self, stamp_ns: int, sensors: Iterable[str] | None = None) -> dict[str, Observation]:
        """Return observations at one stamp, by sensor (None: all), outside their schedule; without those of silent ones.

        Raises InputError for an unknown sensor, and for a time after the end.
        """
        looks = {}
        self._check_time(stamp_ns / NS_PER_S)
        for name in self._sensors if sensors is None else [sensors] if isinstance(sensors, str) else sensors:
            if name not in self._sensors:
                raise InputError(f"there is no sensor {name!r}; {valid_names(name, self._sensors)}")
            timed = self._sensors[name]
            if self._timing[name].dropout == 1 or MessageFaults(name, self.scenario.faults, 0).loses_all(stamp_ns):
                continue
            snapshots = (self.world.snapshot(stamp_ns / NS_PER_S + offset) for offset in timed.instants_s)
            reading, _ = timed.inner.observe(stamp_ns, snapshots, None, stream(self.scenario.seed, "look", name))
            looks[name] = encode(reading.observation).observation
        return looks

    def boxes(self, t: float) -> dict[str, tuple[Box, ...]]:
        """Return the pixel boxes of the people in each camera's picture at time t [s], by name."""
        return {name: person_boxes(people) for name, people in self.person_images(t).items()}

    def person_images(self, t: float, cameras: Collection[str] | None = None) -> dict[str, NDArray[np.int16]]:
        """Return the person that each pixel shows at time t [s], by camera (`PersonImaging.person_image`); of `cameras` alone
        if given."""
        self._check_time(t)
        snapshot = self.world.snapshot(t)
        found = self._cameras().items()
        return {name: each.person_image(snapshot) for name, each in found if cameras is None or name in cameras}

    def snapshot(self, t: float) -> Snapshot:
        """Return the world at time t [s], after reporting the truth of every stamp until then."""
        self._check_time(t)
        self._tell_truth_until(t)
        return self.world.snapshot(t)

    def _check_time(self, t: float) -> None:
        """Raise InputError for a time [s] after the end, beyond what a sensor may look past it."""
        if not t <= self.scenario.duration_s + LONGEST_LOOK_S:
            end = f"the end of {self.scenario.name!r} at {self.scenario.duration_s:g} s"
            raise InputError(f"t = {t:g} s: is after {end}; a time before, or a longer duration_s, is expected")

    def gl_info(self) -> GlInfo | None:
        """OpenGL of the renderer; None in a run without cameras."""
        return self._renderer().gl_info() if self.rig.cameras() else None

    def drawing_notes(self) -> list[str]:
        """Describe how many pictures, parts of a camera's message, were drawn completely and why; other rooms were cached."""
        return self._renderer.notes()

    def sensor_costs(self) -> dict[str, dict[str, float | int | None]]:
        """Return by sensor the number of observations and the cost of one [ms]."""
        return {
            name: {"frames": timed.frames, "ms_mean": 1e3 * timed.spent_s / timed.frames if timed.frames else None}
            for name, timed in self._sensors.items()
        }

    def _tell_truth_until(self, t: float) -> None:
        for stamp_ns, sensors in self._stamps.until(t, self._prepare):
            if not self._is_asked:
                continue
            frame, correlated = self._truth_ahead.pop(stamp_ns, None) or self._truth_at(stamp_ns, sensors)
            if self._on_truth is not None:
                self._on_truth(frame)
            if self._details is not None:
                self._details.people(frame, self.world.snapshot(stamp_ns / NS_PER_S), correlated)

    def _prepare(self, coming: list[ComingStamp]) -> None:
        """Work out the people at the coming stamps, and the truth about them, in a row, which costs less than one by one."""
        if self.world.prepare([stamp_ns / NS_PER_S for stamp_ns, _ in coming]) and self._is_asked:
            self._truth_ahead = {stamp_ns: self._truth_at(stamp_ns, sensors) for stamp_ns, sensors in coming}

    def _truth_at(self, stamp_ns: int, sensors: Collection[str]) -> tuple[TruthFrame, dict[Pair, PairState]]:
        """Return the truth of a stamp of some sensors, and its correlated pairs if details are reported."""
        floors = {name: cells_of for name, cells_of in self._floors.items() if name in sensors}
        frame = self.world.truth(stamp_ns, self.views if self._shares else {}, floors, with_feet=self._feet)
        return frame, {} if self._details is None else self._details.correlated(frame)

    def _healthy(self, name: str, shapes: Callable[[], FootShapes]) -> Sensor:
        device, base = stream(self.scenario.seed, "device", name), base_of(self.scenario, name)
        described, renderer = self._descriptions[name], self._renderer
        return build_sensor(name, described, renderer, shapes=shapes, device=device, mounted_on=base)

    def _cameras(self) -> dict[str, PersonImaging]:
        """Return the cameras without their noise, by name."""
        return {name: timed.ideal for name, timed in self._sensors.items() if isinstance(timed.ideal, PersonImaging)}

    def _truth_details(self, tell: Callable[[TruthDetail], object]) -> TruthDetails:
        details = TruthDetails(self.world, self.views, self._cameras(), self.scenario.truth.boxes_hz, tell)
        for timed in self._sensors.values():
            timed.on_reading = details.look
        return details

    def late(self) -> list[str]:
        """Describe people who have not arrived in twice the time that their way takes, at the latest time shown."""
        return [f"people: {each}" for each in self.world.late()]

    def _warnings(self) -> tuple[str, ...]:
        empty, scene = self.world.empty_snapshot(0.0), self.world.scene
        area = scene.walkable
        blind = [
            f"sensors.{name}.mount: it sees nothing of the walkable area; another place or direction is expected"
            for name, view in self.views.items()
            if view.base is None and not sees_any_of(view, empty, area)
        ]
        dark = [
            f"room: {scene.room_file.name} is dark at the start, so that cameras see next to nothing; a <light> that shines, "
            "or --no-images, is expected"
            for _ in range(bool(self._cameras()) and light_of(empty.model) < DARK_LIGHT)
        ]
        close = describe_close_calls(close_calls(self.scenario.people, self.scenario.duration_s))
        late = [*describe_late_starts(self.scenario, self._sensors), *describe_circles(self.scenario)]
        late += describe_late_actions(self.scenario.people, self.scenario.duration_s) + unlikely_meshes(empty.model)
        if not any(WALKING_WARNING in each for each in self.scenario.warnings):  # a file of paths was judged as a whole
            late += describe_speeds(self.scenario.people)
        messages = [*self.scenario.warnings, *blind, *dark, *late, *([f"people: {close}"] if close else [])]
        return tuple(f"scenario {self.scenario.name!r}: {each}" for each in messages)
