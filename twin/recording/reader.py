"""Read a recording, of the twin or of a robot, as observations for trackers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from trackers.arrays import Nanoseconds
from trackers.errors import InputError, valid_names
from trackers.observations import NS_PER_S, Observation
from trackers.rig import Rig, RigSensor, StereoSensor
from trackers.user_input.text_file import AnyPath, as_path
from twin.recording.bags.bag import Bag, Topic, open_bag
from twin.recording.clock_correction import OF_NO_ORDER, CorrectedClocks, correct_clocks
from twin.recording.decoding import ObservationReader
from twin.recording.losses import Loss, crowded
from twin.recording.rig_of_bag.rig_checks import compare_lenses, compare_poses, motion_warnings, with_intrinsics
from twin.recording.rig_of_bag.rig_guess import guess_rig, undecided_lines
from twin.recording.rig_of_bag.sensor_topics import (
    LeftOut,
    SensorTopics,
    absent_messages,
    add_transforms,
    odometry_losses,
    sensor_topics,
    times_of,
    topics_of,
    unnamed_frames,
    unusable_poses,
    unused_topics,
)
from twin.recording.rig_of_bag.transforms import PoseTopic, TransformTree, read_poses
from twin.recording.ros import topics
from twin.recording.ros.ros_messages import LASER_SCAN, MSGTYPES, STRING
from twin.recording.sensor_clock import MessageTimes, Unwound, all_pause, first_frame, read_times
from twin.recording.situation_table import decode_situation
from twin.recording.truth_messages import decode_people
from twin.truth.truth_types import Situation, TruthFrame

_Decoded = TypeVar("_Decoded")


class Recording:
    """A bag as observations: a twin's `.mcap`, or a robot's ROS 1 `.bag`, ROS 2 folder, `.mcap` or `.db3`.

    A twin's bag keeps its stamps, which count from the start of the run. A robot's are corrected where clocks were wrong
    (`twin.recording.clock_correction`) and shifted by `start_ns`, the earliest first stamp of its sensors, so that they count
    from the start too. A sensor's `time_offset_s` is added to its stamps. The file is open only while it is read; every
    iterator starts over.

    Attributes: `path`; `rig`; `topics` by name; `scenario_yaml` (None in a robot's bag); `is_twin`; `start_ns`, the
    header stamp [ns] that became 0 (0 in a twin's bag); `duration_s`, first to last message; `ahead_s`, how far each
    sensor's stamps are ahead of the others' logged at the same time [s]; `jumps_ns`, the stamps at which trackers restart;
    `stamps_ns`, of each message of a topic in the order in which they are read (`is_as_written`: that of the file).
    """

    def __init__(self, path: AnyPath, rig: Rig | AnyPath | None = None) -> None:
        """Open and check a bag; `rig` (a `rig.yaml` or its content) maps topics to sensors and overrides a rig in the bag.

        Without either, a bag with one LaserScan topic is taken as one scanner at the origin, named after the topic. Raises
        InputError for a file that is missing, no bag or damaged, and for a bag that lacks what the rig says or has nothing
        that can be used.
        """
        self.path = path = as_path(path, "recording")
        with open_bag(path) as bag:
            self.topics: dict[str, Topic] = bag.topics
            self.duration_s = bag.duration_s
            carried = self._text(bag, topics.RIG)
            self.is_twin = carried is not None
            self.scenario_yaml = self._text(bag, topics.SCENARIO)
            is_its_own = self.is_twin and rig is None
            given = None if rig is None and carried is None else self._given_rig(bag, rig, carried)
            near = topics_of(self.topics, LASER_SCAN) if given is None else given[0].topics()
            tree = TransformTree({}) if is_its_own else TransformTree.read(bag, near)
            poses = {} if self.is_twin else read_poses(bag)
            silent: list[Loss] = []
            if given is None:
                guessed, silent = guess_rig(path, self.topics, tree, poses, partial(first_frame, bag))
                given = guessed, "the rig"
            self.rig, source = given
            if rig is not None and not isinstance(rig, Rig):
                silent += undecided_lines(rig)
            self.sensor_topics = sensor_topics(path, self.topics, self.rig, source)
            if rig is not None and not self.is_twin:
                used = self.sensor_topics.sensors | self.sensor_topics.depths
                silent += unused_topics(self.topics, used)
            add_transforms(self.sensor_topics, tree, self.rig, source)
            times = read_times(bag, self.sensor_topics.types)
            self._check_has_messages(times)
            written = self._as_written(bag, times, source)
            self.is_as_written = written is not None
            if written is not None:
                times, set_back = written
                silent += set_back
            times |= {
                key: times_of(edge, self.rig, self.sensor_topics.sensors[key])
                for key, (edge, _) in self.sensor_topics.transforms.items()
            }
            right, label = self._corrected_clocks(times), self.sensor_topics.label
            self.ahead_s, self._times = right.ahead_s, times
            by_name = {label(topic): each for topic, each in times.items()}
            self._in_stamp_order = not (self.is_twin or self.is_as_written) and right.is_log_of_no_order(by_name)
            self.start_ns = 0 if self.is_twin else self._first_stamp_ns(right)
            self.jumps_ns = tuple(each - self.start_ns for each in right.jumps_ns)
            self.stamps_ns = {topic: right.stamps_ns[label(topic)] - self.start_ns for topic in times}
            silent += [*bag.unread, *[OF_NO_ORDER] * self._in_stamp_order, *self.sensor_topics.losses, *right.losses]
            absent = absent_messages(self.sensor_topics, self.topics, times, self.stamps_ns, bag.end_ns)
            self._found = [*silent, *absent, *self._against_rig(bag, tree, poses, is_given=rig is not None)]
            self.logged_after_ns = self._logged_after_ns()
            mounted = {*self.rig.mounted(), *self.rig.odometry()}
            standing = {name: each for name, each in self.frames.items() if name not in mounted}
            self.moving: list[str] = [] if self.is_twin else motion_warnings(tree, poses, standing)
            """Warnings of sensors that move, a clause each; none in a twin's bag."""
        self._reading = LeftOut()

    def _against_rig(
        self, bag: Bag, tree: TransformTree, poses: Mapping[str, PoseTopic], *, is_given: bool
    ) -> Iterator[Loss]:
        """Yield what the bag says otherwise than the rig, and what it lacks of it."""
        sensors, frames = self.sensor_topics.sensors, self.frames
        if is_given:
            yield from compare_poses(self.rig, tree, poses, frames)
        if not self.is_twin:
            yield from compare_lenses(bag, self.rig, sensors)
            yield from odometry_losses(self.rig, self.sensor_topics, tree, poses)
            yield from unnamed_frames(self.rig, tree, frames, is_given=is_given)
            bases = (each.base_frame for each in self.rig.odometry().values() if each.base_frame is not None)
            yield from unusable_poses(tree, {*bases, *chain(*frames.values())}, poses, sensors)

    def _given_rig(self, bag: Bag, rig: Rig | AnyPath | None, carried: str | None) -> tuple[Rig, str]:
        """Return the given rig, else the one that the bag carries, and its source in errors."""
        if isinstance(rig, Rig):
            return rig, "the rig"
        if rig is not None:
            return Rig.load(rig, partial(self._complete, bag, str(rig))), str(Path(rig))
        assert carried is not None
        source = f"{self.path}, topic {topics.RIG}"
        return Rig.parse(carried, source), source

    def _as_written(
        self, bag: Bag, times: Mapping[str, MessageTimes], source: str
    ) -> tuple[dict[str, MessageTimes], list[Loss]] | None:
        """Return the messages' times in the order of the file, and the losses, where the recorder's clock was set back.

        If both are possible, that messages stand otherwise in the file decides.
        """
        overlaps = (each.falls_back or crowded(topic, each.stamp_ns, usual=0.9) for topic, each in times.items())
        if not (all_pause(times) or any(overlaps)):
            return None
        unwound = Unwound()
        written = read_times(bag, self.sensor_topics.types, unwound)
        if not unwound.set_back_ns:
            return None
        if self.sensor_topics.transforms:
            tree = TransformTree.read(bag, self.rig.topics(), in_file_order=True)
            add_transforms(self.sensor_topics, tree, self.rig, source)
        return written, list(self._set_back(written, unwound.set_back_ns))

    @staticmethod
    def _complete(bag: Bag, source: str, content: Any) -> Any:
        """Return the content of a rig.yaml with the lenses that it leaves out."""
        try:
            return with_intrinsics(bag, content)
        except InputError as error:
            raise InputError(f"{source}: {error}") from error

    @property
    def observation_count(self) -> int:
        """Number of observations, all sensors together."""
        return sum(len(self._times[topic]) for topic in self.sensor_topics.sensors)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each sensor."""
        return {name: len(self._times[topic]) for topic, name in self.sensor_topics.sensors.items()}

    @property
    def losses(self) -> list[Loss]:
        """Losses of the recording, corrected stamps included; complete when `observations` has come to its end."""
        return [*self._found, *self._reading.losses(self.sensor_topics, self._times)]

    @cached_property
    def background(self) -> list[Observation]:
        """The observations of the empty room, in the order they were taken; none in most robots' bags."""
        sensors, depths = {}, {}
        for name, sensor in self.rig.sensors.items():
            topic = topics.background_topic(name, topics.SUFFIXES[sensor.kind])
            if topic in self.topics and self.topics[topic].msgtype in MSGTYPES[sensor.kind]:
                sensors[topic] = name
            depth_topic = topics.background_topic(name, topics.DEPTH)
            if isinstance(sensor, StereoSensor) and depth_topic in self.topics:
                depths[depth_topic] = name
        types = {topic: self.topics[topic].msgtype for topic in (*sensors, *depths)}
        with open_bag(self.path) as bag:
            times = read_times(bag, types)
        names = sensors | depths
        stamps = {
            topic: each.stamp_ns + _offset_ns(self.rig.sensors[names[topic]]) - self.start_ns
            for topic, each in times.items()
        }
        found = SensorTopics(sensors, depths, types)
        return list(self._reader(found, times, stamps).read(LeftOut()))

    def observations(self, only: Collection[str] | None = None) -> Iterator[Observation]:
        """Yield the observations, of `only` these sensors if given, in order of arrival (log time), read one at a time.

        Messages that cannot be used are left out and counted (`losses`). Raises InputError where the bag is damaged, most
        of a sensor's messages cannot be used, or the rig has no such sensor.
        """
        if only is not None:
            only = [only] if isinstance(only, str) else list(only)
            if unknown := [name for name in only if name not in self.rig.sensors]:
                raise InputError(
                    f"only: {unknown[0]!r} is no sensor of the rig; {valid_names(unknown[0], self.rig.sensors)}"
                )
        self._reading = LeftOut()
        found = self.sensor_topics if only is None else self.sensor_topics.of(only)
        reader = replace(
            self._reader(found, self._times, self.stamps_ns),
            as_written=self.is_as_written,
            in_stamp_order=self._in_stamp_order,
        )
        return reader.read(self._reading)

    def stamps_of(self, sensor: str) -> Nanoseconds:
        """Return the stamps of a sensor's messages in order of arrival [ns]."""
        topic = {name: topic for topic, name in self.sensor_topics.sensors.items()}.get(sensor)
        return np.zeros(0, dtype=np.int64) if topic is None else self.stamps_ns[topic]

    def all_stamps_ns(self) -> Nanoseconds:
        """Return the stamps of all messages of sensors, ascending, each once [ns]."""
        stamps = [self.stamps_ns[topic] for topic in self.sensor_topics.sensors]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *stamps]))

    def truth(self) -> Iterator[TruthFrame]:
        """Yield the truth in order of time; nothing where the bag has none.

        Raises InputError where the topic holds something else.
        """
        last_text, last_ns = "", None
        decoded_texts = self._strings(topics.TRUTH_PEOPLE, lambda text, stamp_ns: (text, decode_people(text, stamp_ns)))
        for text, frame in decoded_texts:
            if frame.stamp_ns != last_ns:
                yield frame
            elif text != last_text:
                raise InputError(
                    f"{self.path}: topic {topics.TRUTH_PEOPLE}: has two messages at {frame.stamp_ns / NS_PER_S:.3f} s that "
                    "differ; one message a stamp is expected"
                )
            last_text, last_ns = text, frame.stamp_ns

    def situations(self) -> Iterator[Situation]:
        """Yield the situations of two people, in the order in which they end; nothing in a robot's bag. Raises as `truth`."""
        return self._strings(topics.TRUTH_SITUATIONS, lambda text, _: decode_situation(text))

    @property
    def has_situations(self) -> bool:
        """True where situations were looked for, found or not."""
        return topics.TRUTH_SITUATIONS in self.topics

    def _strings(self, topic: str, decode: Callable[[str, int], _Decoded]) -> Iterator[_Decoded]:
        """Decode the strings on a topic with their stamps [ns], by their log times; yield nothing where the bag has none."""
        if topic not in self.topics:
            return
        if (msgtype := self.topics[topic].msgtype) != STRING:
            raise InputError(f"{self.path}: topic {topic} is {msgtype}; {STRING} is expected")
        to_own_clock_ns = 0 if self.is_twin else self.start_ns + self.logged_after_ns
        with open_bag(self.path) as bag:
            for _, log_time_ns, message in bag.messages([topic]):
                try:
                    yield decode(message.data, log_time_ns - to_own_clock_ns)
                except InputError as error:
                    raise InputError(f"{self.path}: topic {topic}: {error}") from error

    def _reader(
        self, found: SensorTopics, times: Mapping[str, MessageTimes], stamps: Mapping[str, Nanoseconds]
    ) -> ObservationReader:
        return ObservationReader(self.path, self.topics, self.rig, found, times, stamps)

    def _text(self, bag: Bag, topic: str) -> str | None:
        if topic not in self.topics or self.topics[topic].msgtype != STRING:
            return None
        for _, _, message in bag.messages([topic]):
            return message.data
        return None

    def _check_has_messages(self, times: Mapping[str, MessageTimes]) -> None:
        if any(len(times[topic]) for topic in self.sensor_topics.sensors):
            return
        if any(self.topics[topic].message_count for topic in self.sensor_topics.sensors):
            raise InputError(
                f"{self.path}: is damaged, its index counts messages that are not there; a whole bag is expected"
            )
        if self.is_twin:
            return
        named = ", ".join(self.sensor_topics.sensors) or "no topic at all"
        raise InputError(f"{self.path}: holds no message on {named}; a recording of the rig's sensors is expected")

    def _corrected_clocks(self, times: Mapping[str, MessageTimes]) -> CorrectedClocks:
        labels = {self.sensor_topics.label(topic): each for topic, each in times.items()}
        names = self.sensor_topics.sensors | self.sensor_topics.depths
        offsets = {self.sensor_topics.label(topic): _offset_ns(self.rig.sensors[name]) for topic, name in names.items()}
        try:
            return correct_clocks(labels, offsets, keeps_stamps=self.is_twin)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error

    def _set_back(self, times: Mapping[str, MessageTimes], by_ns: list[int]) -> list[Loss]:
        by = ", ".join(f"{each / NS_PER_S:.3f} s" for each in by_ns[:5])
        what = f"were logged by a recorder whose clock was set back by {by}"
        remedy = "they are taken in the order of the file"
        return [
            Loss(self.sensor_topics.label(topic), len(each), len(each), what, remedy, always=True)
            for topic, each in times.items()
        ]

    def _first_stamp_ns(self, right: CorrectedClocks) -> int:
        firsts = (right.stamps_ns[name] for name in self.sensor_topics.sensors.values())
        return min(int(stamps.min() if self._in_stamp_order else stamps[0]) for stamps in firsts if stamps.size)

    def _logged_after_ns(self) -> int:
        """Return the lag of log times after stamps [ns] where that is another clock and no delay; else 0.

        What is logged by it from the start on is not logged before 0.
        """
        ages = [
            self._times[topic].log_ns - stamps - self.start_ns
            for topic, stamps in self.stamps_ns.items()
            if stamps.size
        ]
        age_ns = round(float(np.median(np.concatenate(ages)))) if ages else 0
        return max(age_ns, -self.start_ns) if abs(age_ns) > NS_PER_S and not self.is_twin else 0

    @property
    def frames(self) -> dict[str, set[str]]:
        """The frames that each sensor's headers name."""
        return {name: set(self._times[topic].frames) for topic, name in self.sensor_topics.sensors.items()}


def _offset_ns(sensor: RigSensor) -> int:
    return round(sensor.time_offset_s * NS_PER_S)
