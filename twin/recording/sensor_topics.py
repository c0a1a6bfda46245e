"""Topics of a bag by sensor, from a rig, or for a single scanner without one."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from trackers.errors import InputError
from trackers.rig import LaserSensor, Rig, StereoSensor, normal_topic
from twin.recording.bag import Topic
from twin.recording.losses import Loss
from twin.recording.ros_messages import COMPRESSED_IMAGE, LASER_SCAN, ODOMETRY, RAW_IMAGE

_PICTURES = (COMPRESSED_IMAGE, RAW_IMAGE)
MSGTYPES = {
    "laser": (LASER_SCAN,),
    "fisheye": _PICTURES,
    "camera": _PICTURES,
    "stereo": _PICTURES,
    "floor": (RAW_IMAGE,),
    "odometry": (ODOMETRY,),
}
_BACKGROUND = "/background/"


@dataclass(frozen=True)
class SensorTopics:
    """sensors, depths: the sensor of each topic, and of each topic of depth; types: of the messages that are used of it.

    losses: sensors without a topic, and messages of another type on a topic.
    """

    sensors: dict[str, str] = field(default_factory=dict)
    depths: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)

    def of(self, names: Collection[str]) -> SensorTopics:
        """Return the topics of these sensors."""
        sensors, depths = (
            {topic: name for topic, name in each.items() if name in names} for each in (self.sensors, self.depths)
        )
        return SensorTopics(sensors, depths, {topic: self.types[topic] for topic in (*sensors, *depths)})

    def label(self, topic: str) -> str:
        """Return the topic's name in warnings: its sensor."""
        return self.sensors[topic] if topic in self.sensors else f"{self.depths[topic]} (depth)"


def sensor_topics(path: Path, topics: Mapping[str, Topic], rig: Rig, source: str) -> SensorTopics:
    """Find the topics of the rig's sensors; raises InputError for one that is missing or of another type.

    `source` names the rig in errors. A sensor whose topic is missing is left out, and reported, where every topic that fits it
    belongs to another sensor: it was not recorded. Else its name is taken for a typing error.
    """
    found = SensorTopics()
    wanted = [(name, "topic", sensor.topic, MSGTYPES[sensor.kind]) for name, sensor in rig.sensors.items()]
    wanted += [
        (name, "depth_topic", sensor.depth_topic, _PICTURES)
        for name, sensor in rig.sensors.items()
        if isinstance(sensor, StereoSensor)
    ]
    claimed = {normal_topic(topic) for _, _, topic, _ in wanted}
    for name, part, said, valid in wanted:
        topic, where = normal_topic(said), f"{source}: sensors.{name}.{part} is {said!r}"
        usable = topics_of(topics, *valid)
        if topic not in topics:
            is_half = isinstance(rig.sensors[name], StereoSensor)  # of a pair of topics
            if is_half or set(usable) - claimed or not claimed & set(topics):
                raise InputError(f"{where}, which {path} does not have; {_expected(usable, valid)}")
            found.losses.append(absent(name, topic, "the bag has no such topic"))
            continue
        msgtype = topics[topic].type_among(valid)
        if msgtype is None:
            raise InputError(f"{where}, which is {topics[topic].msgtype} in {path}; {_expected(usable, valid)}")
        (found.depths if part == "depth_topic" else found.sensors)[topic] = name
        found.types[topic] = msgtype
        other = topics[topic].message_count - topics[topic].count_of(msgtype)
        if other:
            have = sorted({topics[topic].msgtype, *topics[topic].others} - {msgtype})
            what = f"on {topic} are not {msgtype} but {', '.join(have)}, and were left out"
            found.losses.append(Loss(found.label(topic), other, topics[topic].message_count, what))
    return found


def absent(sensor: str, topic: str, why: str) -> Loss:
    """Return the loss of a sensor without any message."""
    remedy = "see whether its driver ran and its topic was recorded, or take it from rig.yaml"
    return Loss(sensor, 0, 0, f"no message on {topic} ({why}): tracked without it", remedy, always=True)


def guess_rig(path: Path, topics: Mapping[str, Topic]) -> tuple[Rig, list[Loss]]:
    """Return a rig of the bag's one scanner at the origin, named after its topic, and scanners without a message as losses.

    Raises InputError for a bag with another number of scanners that have messages.
    """
    scans, images = topics_of(topics, LASER_SCAN), topics_of(topics, *_PICTURES)
    said = [topic for topic in scans if topics[topic].count_of(LASER_SCAN)]
    if len(said) == 1 or len(scans) == 1:
        (topic,) = said or scans
        silent = [absent(each, each, "it is empty") for each in scans if each != topic]
        return Rig(sensors={_name_of(topic): LaserSensor(topic=topic)}), silent
    if scans:
        raise InputError(
            f"{path}: has {len(scans)} LaserScan topics ({', '.join(scans)}); "
            f"a rig.yaml that says which sensor each is and where it stands is expected"
        )
    if images:
        raise InputError(
            f"{path}: has no LaserScan topic, only images ({', '.join(images)}); "
            f"a rig.yaml with the place and the lens of each camera is expected"
        )
    have = ", ".join(f"{name} ({topic.msgtype})" for name, topic in sorted(topics.items())) or "none"
    raise InputError(f"{path}: has no usable topic, its topics are: {have}; a {LASER_SCAN} topic is expected")


def _name_of(topic: str) -> str:
    """Return a topic as the name of a sensor."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", topic.strip("/"))[:90]
    return name if name[:1].isalpha() else f"scan_{name}"


def topics_of(topics: Mapping[str, Topic], *msgtypes: str) -> list[str]:
    """Return the topics of these types, those of empty rooms left out."""
    return sorted(name for name, topic in topics.items() if topic.type_among(msgtypes) and _BACKGROUND not in name)


def _expected(usable: list[str], valid: tuple[str, ...]) -> str:
    have = ", ".join(usable) if usable else "none"
    return f"expected is a topic of {' or '.join(valid)}, of which the bag has {have}"
