"""Topics of a bag by sensor, from a rig."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trackers.arrays import Nanoseconds
from trackers.errors import InputError, valid_names
from trackers.observations import NS_PER_S, Odometry
from trackers.rig import OdometrySensor, Rig, RigSensor, StereoSensor, normal_topic
from twin.recording.bags.bag import Topic
from twin.recording.losses import Loss, crowded, missing, pose_jumps
from twin.recording.rig_of_bag.transforms import Edge, Poses, PoseTopic, TransformTree
from twin.recording.ros.depth_images import DepthPairs, tolerance_ns
from twin.recording.ros.ros_messages import LASER_SCAN, MSGTYPES, PICTURES
from twin.recording.sensor_clock import MessageTimes

_BACKGROUND = "/background/"
_FEW = 3
"""Fewer messages have no usual gap; sensors that follow people send one a second or more."""


@dataclass(frozen=True)
class SensorTopics:
    """sensors, depths: the sensor of each topic, and of each topic of depth; types: of the messages that are used of it.

    losses: sensors without a topic, and messages of another type on a topic. transforms: poses of bases from there, by a
    key of their own in `sensors`: the edge at whose messages they come, and the poses (n, 4, 4).
    """

    sensors: dict[str, str] = field(default_factory=dict)
    depths: dict[str, str] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    losses: list[Loss] = field(default_factory=list)
    transforms: dict[str, tuple[Edge, Poses]] = field(default_factory=dict)

    def of(self, names: Collection[str]) -> SensorTopics:
        """Return the topics of these sensors."""
        sensors, depths = (
            {topic: name for topic, name in each.items() if name in names} for each in (self.sensors, self.depths)
        )
        types = {topic: each for topic, each in self.types.items() if topic in sensors or topic in depths}
        transforms = {key: each for key, each in self.transforms.items() if key in sensors}
        return SensorTopics(sensors, depths, types, transforms=transforms)

    def label(self, topic: str) -> str:
        """Return the topic's name in warnings: its sensor."""
        return self.sensors[topic] if topic in self.sensors else f"{self.depths[topic]} (depth)"


def sensor_topics(path: Path, topics: Mapping[str, Topic], rig: Rig, source: str) -> SensorTopics:
    """Find the topics of the rig's sensors; raises InputError for one that is missing or of another type.

    `source` names the rig in errors. A sensor whose topic is missing is left out, and reported, where every topic that fits it
    belongs to another sensor: it was not recorded. Else its name is taken for a typing error.
    """
    found = SensorTopics()
    wanted = [
        (name, "topic", sensor.topic, MSGTYPES[sensor.kind])
        for name, sensor in rig.sensors.items()
        if not is_of_transforms(sensor)
    ]
    wanted += [
        (name, "depth_topic", sensor.depth_topic, PICTURES)
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
            other = conversion([topics[topic]]) if LASER_SCAN in valid else ""
            raise InputError(f"{where}, which is {topics[topic].msgtype} in {path}; {_expected(usable, valid)}{other}")
        (found.depths if part == "depth_topic" else found.sensors)[topic] = name
        found.types[topic] = msgtype
        other = topics[topic].message_count - topics[topic].count_of(msgtype)
        if other:
            have = sorted({topics[topic].msgtype, *topics[topic].others} - {msgtype})
            what = f"on {topic} are not {msgtype} but {', '.join(have)}, and were left out"
            found.losses.append(Loss(found.label(topic), other, topics[topic].message_count, what))
    return found


def is_of_transforms(sensor: RigSensor) -> bool:
    """Return True for odometry that transforms tell."""
    return isinstance(sensor, OdometrySensor) and sensor.frame is not None


def add_transforms(found: SensorTopics, tree: TransformTree, rig: Rig, source: str) -> None:
    """Add the odometry that transforms tell; raises InputError where they do not, naming the field in `source`."""
    for name, sensor in rig.odometry().items():
        if sensor.frame is not None and sensor.base_frame is not None:
            try:
                edge, poses = tree.poses(sensor.frame, sensor.base_frame)
            except InputError as error:
                raise InputError(f"{source}: sensors.{name}.frame, base_frame: {error}") from error
            key = f"{edge.topic}, {sensor.frame} to {sensor.base_frame}"
            found.sensors[key] = name
            found.transforms[key] = edge, poses


def absent(sensor: str, topic: str, why: str) -> Loss:
    """Return the loss of a sensor without any message."""
    remedy = "see whether its driver ran and its topic was recorded, or leave it out of rig.yaml"
    what = f"no message on {{topic}} ({why}): tracked without"
    return Loss(sensor, 0, 0, what, remedy, always=True, topic=topic)


def absent_messages(
    found: SensorTopics,
    topics: Mapping[str, Topic],
    times: Mapping[str, MessageTimes],
    stamps_ns: Mapping[str, Nanoseconds],
    end_ns: int,
) -> Iterator[Loss]:
    """Yield losses of messages that the bag's index counts or the sensors' own rhythm expects; `end_ns`: the bag's last."""
    stamps = [stamps for stamps in stamps_ns.values() if stamps.size]
    if not stamps:
        return
    from_ns = min(int(each.min()) for each in stamps)
    last_ns = max(int(each.log_ns.max() + each.copied_ns.max(initial=0)) for each in times.values() if len(each))
    logged_on_ns = max(end_ns - last_ns, 0)
    to_ns = max(int(each.max()) for each in stamps) + logged_on_ns
    for topic, each in times.items():
        label, counted, n = found.label(topic), 0, each.n_message
        if topic in found.types:
            counted = topics[topic].count_of(found.types[topic])
        if not n:
            yield absent(label, topic, "it is empty")
        elif n < _FEW and to_ns - from_ns > _FEW * NS_PER_S:
            what = f"has {n} {'message' if n == 1 else 'messages'} on {topic} in {(to_ns - from_ns) / NS_PER_S:.3g} s"
            yield Loss(
                label, 0, 0, what, "see whether its driver stopped, or its topic was recorded whole", always=True
            )
        elif (loss := missing(label, stamps_ns[topic], from_ns, to_ns)) is not None:
            yield loss
        if (loss := crowded(label, stamps_ns[topic])) is not None:
            yield loss
        if n_copy := each.copied_ns.size:
            what = (
                f"came again with the stamp and the content of an earlier one, {np.median(each.copied_ns) / NS_PER_S:.3g} s "
                "after it: the first of each is used"
            )
            remedy = "see whether two drivers, relays or recorders wrote the topic"
            yield Loss(label, n_copy, n + n_copy, what, remedy, always=True)
        if each.restamped is not None:
            n_again = int(np.count_nonzero(each.restamped))
            apart_s = each.restamped_ns / NS_PER_S
            what = f"repeat an earlier one under a stamp {apart_s:.3g} s later: the first of each is used"
            remedy = "see whether a relay, or a second driver, writes on the topic"
            yield Loss(label, n_again, n + n_again, what, remedy, always=True)
            n_copy += n_again
        if counted > n + n_copy:
            what = f"that the bag's index counts on {topic} are not there"
            yield Loss(label, counted - n - n_copy, counted, what, "the bag is damaged, or was cut")
        (frame, most), *_ = each.frames.most_common(1) or [("", n)]
        if most < n:
            others = [repr(other) for other in each.frames if other != frame]
            more = f" and {len(others) - 5} more" * (len(others) > 5)
            what = f"are of frame {', '.join(others[:5])}{more}, the others of {frame!r}: two sensors on one topic"
            yield Loss(label, n - most, n, what, "a topic for each sensor is expected")


def unused_topics(topics: Mapping[str, Topic], used: Collection[str]) -> list[Loss]:
    """Return one loss that names the bag's scans and pictures that no sensor of a rig uses; none where all are used."""
    unused = sorted(set(topics_of(topics, LASER_SCAN, *PICTURES)) - set(used))
    what = f"does not use {', '.join(unused)} of the bag"
    return [Loss("the rig", 0, 0, what, always=True)] if unused else []


def topics_of(topics: Mapping[str, Topic], *msgtypes: str) -> list[str]:
    """Return the topics of these types, those of empty rooms left out."""
    return sorted(name for name, topic in topics.items() if topic.type_among(msgtypes) and _BACKGROUND not in name)


_CONVERTERS = {
    "sensor_msgs/msg/PointCloud2": "pointcloud_to_laserscan",
    "sensor_msgs/msg/MultiEchoLaserScan": "laser_proc",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "image_transport",
    "foxglove_msgs/msg/CompressedVideo": "foxglove_compressed_video_transport",
    "theora_image_transport/msg/Packet": "image_transport",
}
"""ROS package that makes a LaserScan, or pictures, of a type that is not read."""


def conversion(topics: Iterable[Topic]) -> str:
    """Name the package that makes scans or pictures of what these topics hold; "" where none does."""
    known = {each.msgtype: _CONVERTERS[each.msgtype] for each in topics if each.msgtype in _CONVERTERS}
    return "".join(f"; `{package}` makes one of {kind}" for kind, package in known.items())


def _expected(usable: list[str], valid: tuple[str, ...]) -> str:
    have = ", ".join(usable) if usable else "none"
    return f"expected is a topic of {' or '.join(valid)}, of which the bag has {have}"


class LeftOut:
    """Messages left out while observations are read, by topic."""

    def __init__(self) -> None:
        self.left_out: dict[str, int] = {}
        self.first: dict[str, tuple[int, str]] = {}
        self.completed: dict[str, tuple[int, int, str]] = {}
        self.pairs: dict[str, DepthPairs] = {}
        self.is_done = False

    def leave_out(self, topic: str, stamp_ns: int, why: str) -> None:
        """Count a message that cannot be used."""
        self.left_out[topic] = self.left_out.get(topic, 0) + 1
        self.first.setdefault(topic, (stamp_ns, why))

    def complete(self, topic: str, stamp_ns: int, said: str) -> None:
        """Count a message that lacks a field's value."""
        count, first_ns, first = self.completed.get(topic, (0, stamp_ns, said))
        self.completed[topic] = count + 1, first_ns, first

    def losses(self, found: SensorTopics, times: Mapping[str, MessageTimes]) -> list[Loss]:
        """Return what was left out, as losses."""
        losses = []
        for topic, count in self.left_out.items():
            stamp_ns, why = self.first[topic]
            what = f"cannot be used and were left out, the first at {stamp_ns / NS_PER_S:.2f} s: {why}"
            losses.append(Loss(found.label(topic), count, times[topic].n_message, what, always=True))
        for topic, (count, stamp_ns, said) in self.completed.items():
            what = f"have fields without a usable value, the first at {stamp_ns / NS_PER_S:.2f} s: {said}"
            remedy = "see the driver's settings"
            losses.append(Loss(found.label(topic), count, times[topic].n_message, what, remedy, always=True))
        topic_of = {name: topic for topic, name in found.sensors.items()}
        depth_of = {name: topic for topic, name in found.depths.items()}
        for name, each in self.pairs.items() if self.is_done else ():
            colour, depth = times[topic_of[name]], times[depth_of[name]]
            if (alone := len(colour) - each.paired - self.left_out.get(topic_of[name], 0)) > 0:
                within_ms = tolerance_ns(colour.stamp_ns, depth.stamp_ns) / 1e6
                what = f"are colour pictures without one of depth within half a period ({within_ms:.0f} ms)"
                remedy = f"see whether {depth_of[name]} comes as often and from the same clock"
                losses.append(Loss(name, alone, len(colour), what, remedy))
        return losses


def times_of(edge: Edge, rig: Rig, name: str) -> MessageTimes:
    """Return the times of the transforms that tell a base's poses, as of messages of their own."""
    sensor = rig.sensors[name]
    frame = (sensor.frame or "") if isinstance(sensor, OdometrySensor) else ""
    is_set = np.ones(len(edge.stamps_ns), dtype=bool)
    frames = Counter({frame: len(edge.stamps_ns)})
    return MessageTimes(edge.log_ns, edge.stamps_ns, is_set, frames, copied_ns=edge.copied_ns)


def poses_of(found: SensorTopics, stamps: Mapping[str, Nanoseconds], topic: str, number: int) -> Iterator[Odometry]:
    """Yield the poses that come with the message of this number on a topic of transforms."""
    for key, (edge, poses) in found.transforms.items():
        first, last = np.searchsorted(edge.number, (number, number + 1)) if edge.topic == topic else (0, 0)
        for k in range(first, last):
            yield Odometry(found.sensors[key], int(stamps[key][k]), poses[k])


def odometry_losses(
    rig: Rig, found: SensorTopics, tree: TransformTree, poses: Mapping[str, PoseTopic]
) -> Iterator[Loss]:
    """Yield what is wrong with the poses of each base: that they jump, and frames that have two places."""
    for topic, name in found.sensors.items():
        if topic in found.transforms:
            edge, moved = found.transforms[topic]
            yield from pose_jumps(name, edge.times_ns, moved)
            if tree.doubled:
                what = f"transforms give a frame two places, {', '.join(tree.doubled[:5])}: two robots or two drivers"
                yield Loss(
                    name,
                    0,
                    0,
                    what,
                    "the one in the sensor's namespace, of most messages, or the first, is taken",
                    always=True,
                )
        elif isinstance(rig.sensors[name], OdometrySensor) and topic in poses:
            yield from pose_jumps(name, poses[topic].stamps_ns, poses[topic].poses)


def unusable_poses(
    tree: TransformTree, frames: Iterable[str], poses: Mapping[str, PoseTopic], used: Collection[str]
) -> Iterator[Loss]:
    """Yield the transforms at or above these frames, and the odometry of no sensor, that were left out, as they hold no pose.

    used: topics of sensors, of which the same is reported as they are read.
    """
    no_pose, remedy = (
        "hold no pose (a quaternion of length 0, NaN, damaged bytes) and were left out",
        "see what publishes them",
    )
    for topic, (count, total) in tree.undecodable.items():
        yield Loss(topic, count, total, "are no transforms, by their bytes, and were left out", remedy)
    for topic, each in poses.items():
        if each.unusable and topic not in used:
            yield Loss(topic, each.unusable, each.unusable + len(each.poses), no_pose, remedy)
    above = tree.ancestors(frames)
    for (child, parent), count in tree.unusable.items():
        if child in above:
            edge = tree.edges.get(child)
            n_read = len(edge.stamps_ns) if edge is not None and edge.parent == parent else 0
            yield Loss("transforms", count, count + n_read, f"of {child!r} in {parent!r} {no_pose}", remedy)


def unnamed_frames(
    rig: Rig, tree: TransformTree, frames: Mapping[str, Collection[str]], *, is_given: bool
) -> Iterator[Loss]:
    """Yield the sensors whose frames no transform names, in a bag whose transforms name others; `frames`: of each sensor.

    is_given: True for a rig of the user's. That may be of sensors that are in no tree at all: then nothing is reported. Nor is it
    where something in the tree moves, which `motion_warnings` tells.
    """
    known = {frame for edge in tree.edges.values() for frame in (edge.child, edge.parent)}
    bases = rig.odometry()
    own = {name: {frame.strip("/") for frame in each} for name, each in frames.items() if each and name not in bases}
    strange = {name: each for name, each in own.items() if not each & known}
    if not known or any(edge.moves for edge in tree.edges.values()) or (is_given and len(strange) == len(own)):
        return
    for name, each in strange.items():
        frame = sorted(each)[0]
        what = (
            f"its frame {frame!r} is in no transform of the bag; {valid_names(frame, sorted(known), start='they name')}"
        )
        remedy = "its pose in the rig is taken as it is" if is_given else "its tracks leave in its own frame"
        yield Loss(name, 0, 0, what, f"{remedy}; see the driver's frame_id", always=True)
