"""Reads a recording, the twin's or a robot's, as the observations a tracker takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, Observation
from trackers.rig import CameraSensor, FloorSensor, LaserSensor, Rig, RigSensor, StereoSensor
from twin.recording import topics
from twin.recording.bag import Bag, Topic, normal_topic, open_bag
from twin.recording.depth_pairs import DepthPairs
from twin.recording.depth_picture import decode_depth
from twin.recording.messages import COMPRESSED_IMAGE, LASER_SCAN, RAW_IMAGE, STRING, from_message, stamp_of
from twin.recording.situations import decode_situation
from twin.recording.tables import TruthFrame
from twin.recording.truth_messages import decode_people
from twin.truth.frames import Situation

_Told = TypeVar("_Told")
_PICTURES = (COMPRESSED_IMAGE, RAW_IMAGE)
_MSGTYPES = {
    "laser": (LASER_SCAN,),
    "fisheye": _PICTURES,
    "camera": _PICTURES,
    "stereo": _PICTURES,
    "floor": (RAW_IMAGE,),
}


class Recording:
    """A bag as observations: a twin's `.mcap`, or a robot's ROS 1 `.bag`, ROS 2 folder, `.mcap` or `.db3`.

    A twin's bag keeps its stamps, which count from the start of the run. A robot's are shifted by `start_ns`, the
    earliest first stamp of its sensors, so that they count from the start too. A sensor's `time_offset_s` is added to
    its stamps. The file is open only while something is read from it; every iterator starts over.

    Attributes: `path`; `rig`; `topics` by name; `scenario_yaml` (None in a robot's bag); `is_twin`; `start_ns`, the
    header stamp [ns] that became 0 (0 in a twin's bag); `duration_s`, first to last message.
    """

    def __init__(self, path: Path, rig: Rig | Path | None = None) -> None:
        """`rig` (a `rig.yaml` or its content) says what the bag's topics are; it goes before a rig in the bag.

        Without either, a bag with one LaserScan topic is taken as one scanner at the origin, named after the topic.
        Raises InputError, in one sentence, for a file that is missing, no bag or damaged, and where the bag lacks what
        the rig says or has nothing that can be used.
        """
        self.path = path
        with open_bag(path) as bag:
            self.topics: dict[str, Topic] = bag.topics
            self.duration_s = bag.duration_s
            carried = self._text(bag, topics.RIG)
            self.is_twin = carried is not None
            self.scenario_yaml = self._text(bag, topics.SCENARIO)
            if isinstance(rig, Path):
                self.rig, source = Rig.load(rig), str(rig)
            elif rig is not None:
                self.rig, source = rig, "the rig"
            elif carried is not None:
                source = f"{path}, topic {topics.RIG}"
                self.rig = Rig.parse(carried, source)
            else:
                self.rig, source = self._guessed_rig(), "the rig"
            self._sensors = self._sensors_by_topic(source)
            self._depths = self._depths_by_topic(source)
            self.start_ns = 0 if self.is_twin else self._first_stamp_ns(bag)

    @property
    def observation_count(self) -> int:
        """How many observations there are, all sensors together."""
        return sum(self.topics[topic].message_count for topic in self._sensors)

    @cached_property
    def background(self) -> list[Observation]:
        """The observations of the empty room, in the order they were taken; none in most robots' bags."""
        sensors, depths = {}, {}
        for name, sensor in self.rig.sensors.items():
            topic = topics.background_topic(name, topics.SUFFIXES[sensor.kind])
            if topic in self.topics and self.topics[topic].msgtype in _MSGTYPES[sensor.kind]:
                sensors[topic] = name
            depth_topic = topics.background_topic(name, topics.DEPTH)
            if isinstance(sensor, StereoSensor) and depth_topic in self.topics:
                depths[depth_topic] = name
        return list(self._decoded(sensors, depths))

    def observations(self) -> Iterator[Observation]:
        """The observations in order of arrival (log time), read as they are asked for.

        Raises InputError where the bag is damaged or a message cannot be used.
        """
        return self._decoded(self._sensors, self._depths)

    def truth(self) -> Iterator[TruthFrame]:
        """The truth in order of time; nothing in a robot's bag. Raises InputError where it is something else."""
        return self._told(topics.TRUTH_PEOPLE, decode_people)

    def situations(self) -> Iterator[Situation]:
        """The situations of two people, in the order in which they end; nothing in a robot's bag. Raises as `truth`."""
        return self._told(topics.TRUTH_SITUATIONS, lambda text, _: decode_situation(text))

    def _told(self, topic: str, decode: Callable[[str, int], _Told]) -> Iterator[_Told]:
        """What the strings on a topic and their log times say; nothing where the bag has none."""
        if topic not in self.topics:
            return
        self._require_string(topic)
        with open_bag(self.path) as bag:
            for _, log_time_ns, message in bag.messages([topic]):
                try:
                    yield decode(message.data, log_time_ns)
                except InputError as error:
                    raise InputError(f"{self.path}: topic {topic}: {error}") from error

    def _decoded(self, sensors: dict[str, str], depths: dict[str, str]) -> Iterator[Observation]:
        pairs = {name: DepthPairs() for name in depths.values()}
        with open_bag(self.path) as bag:
            for topic, _, message in bag.messages({*sensors, *depths}):
                name = sensors.get(topic) or depths[topic]
                sensor = self.rig.sensors[name]
                try:
                    offset_ns = _offset_ns(sensor) - self.start_ns
                    if topic in depths:
                        stamp_ns = stamp_of(message) + offset_ns
                        observation = pairs[name].depth(stamp_ns, decode_depth(message, name))
                    else:
                        observation = from_message(message, name, kind=sensor.kind, offset_ns=offset_ns)
                        if name in pairs and isinstance(observation, Image):
                            observation = pairs[name].colour(observation)
                except InputError as error:
                    raise InputError(f"{self.path}: topic {topic}: {error}") from error
                if observation is None:
                    continue
                if isinstance(observation, Image | DepthImage) and isinstance(sensor, CameraSensor):
                    self._check_size(topic, name, observation, sensor)
                if isinstance(observation, FloorFrame) and isinstance(sensor, FloorSensor):
                    self._check_grid(topic, name, observation, sensor)
                yield observation

    def _check_size(self, topic: str, name: str, image: Image | DepthImage, camera: CameraSensor) -> None:
        height, width, _ = image.rgb.shape
        lens = camera.intrinsics
        if (width, height) != (lens.width, lens.height):
            raise InputError(
                f"{self.path}: topic {topic}: image is {width} x {height}; sensors.{name}.intrinsics of the rig "
                f"say {lens.width} x {lens.height}, the size of the images is expected there"
            )

    def _check_grid(self, topic: str, name: str, frame: FloorFrame, floor: FloorSensor) -> None:
        rows, columns = frame.values.shape
        if (rows, columns) != (floor.rows, floor.columns):
            raise InputError(
                f"{self.path}: topic {topic}: frame is {rows} rows x {columns} columns; sensors.{name} of the rig says "
                f"{floor.rows} x {floor.columns}, the size of the frames is expected there"
            )

    def _text(self, bag: Bag, topic: str) -> str | None:
        if topic not in self.topics or self.topics[topic].msgtype != STRING:
            return None
        for _, _, message in bag.messages([topic]):
            return message.data
        return None

    def _require_string(self, topic: str) -> None:
        msgtype = self.topics[topic].msgtype
        if msgtype != STRING:
            raise InputError(f"{self.path}: topic {topic} is {msgtype}; {STRING} is expected")

    def _first_stamp_ns(self, bag: Bag) -> int:
        firsts = []
        for topic, name in self._sensors.items():
            for _, _, message in bag.messages([topic]):
                firsts.append(stamp_of(message) + _offset_ns(self.rig.sensors[name]))
                break
        if not firsts:
            raise InputError(
                f"{self.path}: is damaged, its index counts messages that are not there; a whole bag is expected"
            )
        return min(firsts)

    def _sensors_by_topic(self, source: str) -> dict[str, str]:
        sensors: dict[str, str] = {}
        for name, sensor in self.rig.sensors.items():
            topic, valid = normal_topic(sensor.topic), _MSGTYPES[sensor.kind]
            where = f"{source}: sensors.{name}.topic is {sensor.topic!r}"
            if topic not in self.topics:
                raise InputError(f"{where}, which {self.path} does not have; {self._usable(*valid)}")
            if self.topics[topic].msgtype not in valid:
                raise InputError(
                    f"{where}, which is {self.topics[topic].msgtype} in {self.path}; {self._usable(*valid)}"
                )
            if topic in sensors:
                raise InputError(f"{where}, as is that of {sensors[topic]!r}; a topic of its own is expected")
            sensors[topic] = name
        if not self.is_twin and not any(self.topics[topic].message_count for topic in sensors):
            named = ", ".join(sensors) or "no topic at all"
            raise InputError(f"{self.path}: holds no message on {named}; a recording of the rig's sensors is expected")
        return sensors

    def _depths_by_topic(self, source: str) -> dict[str, str]:
        """The topics of depth, each with the sensor that it belongs to."""
        depths: dict[str, str] = {}
        for name, sensor in self.rig.sensors.items():
            if not isinstance(sensor, StereoSensor):
                continue
            topic = normal_topic(sensor.depth_topic)
            where = f"{source}: sensors.{name}.depth_topic is {sensor.depth_topic!r}"
            if topic not in self.topics:
                raise InputError(f"{where}, which {self.path} does not have; {self._usable(*_PICTURES)}")
            if self.topics[topic].msgtype not in _PICTURES:
                raise InputError(
                    f"{where}, which is {self.topics[topic].msgtype} in {self.path}; {self._usable(*_PICTURES)}"
                )
            if topic in self._sensors or topic in depths:
                raise InputError(f"{where}, as is that of another; a topic of its own is expected")
            depths[topic] = name
        return depths

    def _guessed_rig(self) -> Rig:
        scans = self._topics_of(LASER_SCAN)
        images = self._topics_of(COMPRESSED_IMAGE, RAW_IMAGE)
        if len(scans) == 1:
            name = scans[0].strip("/").replace("/", "_")
            return Rig(sensors={name: LaserSensor(topic=scans[0])})
        if scans:
            raise InputError(
                f"{self.path}: has {len(scans)} LaserScan topics ({', '.join(scans)}); "
                f"a rig.yaml that says which sensor each is and where it stands is expected"
            )
        if images:
            raise InputError(
                f"{self.path}: has no LaserScan topic, only images ({', '.join(images)}); "
                f"a rig.yaml with the place and the lens of each camera is expected"
            )
        have = ", ".join(f"{name} ({topic.msgtype})" for name, topic in sorted(self.topics.items())) or "none"
        raise InputError(f"{self.path}: has no usable topic, its topics are: {have}; a {LASER_SCAN} topic is expected")

    def _usable(self, *msgtypes: str) -> str:
        """'expected is one of ...': the topics of these types."""
        have = self._topics_of(*msgtypes)
        kinds = " or ".join(msgtypes)
        return f"expected is a topic of {kinds}, of which the bag has {', '.join(have) if have else 'none'}"

    def _topics_of(self, *msgtypes: str) -> list[str]:
        background = "/background/"
        return sorted(
            name for name, topic in self.topics.items() if topic.msgtype in msgtypes and background not in name
        )


def _offset_ns(sensor: RigSensor) -> int:
    return round(sensor.time_offset_s * NS_PER_S)
