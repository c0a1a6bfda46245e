"""A rig guessed from a bag: its one scanner without a `rig.yaml`, or a commented `rig.yaml` of all its sensors."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from trackers.errors import InputError
from trackers.rig import LaserSensor, OdometrySensor, Pose, Rig
from trackers.rig_sensors import WAIST_FROM_M
from trackers.user_input.text_file import AnyPath, read_text
from twin.recording.bags.bag import Bag, Topic, decoded, open_bag
from twin.recording.losses import Loss
from twin.recording.rig_of_bag.rig_checks import kind_of_lens, with_intrinsics
from twin.recording.rig_of_bag.sensor_topics import absent, conversion, topics_of
from twin.recording.rig_of_bag.transforms import Edge, PoseTopic, TransformTree, read_poses
from twin.recording.ros import topics as names
from twin.recording.ros.ros_messages import LASER_SCAN, ODOMETRY, PICTURES, RAW_IMAGE
from twin.recording.sensor_clock import first_frame


def guess_rig(
    path: Path,
    topics: Mapping[str, Topic],
    tree: TransformTree,
    poses: Mapping[str, PoseTopic],
    frame: Callable[[str], str],
) -> tuple[Rig, list[Loss]]:
    """Return a rig of the bag's one scanner, named after its topic, and scanners without a message as losses.

    It is at the origin, or mounted on a base that moves, where the bag tells of one; `frame` tells the frame_id on a topic.
    Raises InputError for a bag with another number of scanners that have messages.
    """
    scans, images = topics_of(topics, LASER_SCAN), topics_of(topics, *PICTURES)
    said = [topic for topic in scans if topics[topic].count_of(LASER_SCAN)]
    if len(said) == 1 or len(scans) == 1:
        (topic,) = said or scans
        silent = [absent(each, each, "it is empty") for each in scans if each != topic]
        name = _name_of(topic)
        base = "odometry" if name != "odometry" else "base"
        odometry, pose, assumed = _guess_base(frame(topic), tree, poses)
        if odometry is None:
            silent += _unused_place(path, name, frame(topic), tree)
            return Rig(sensors={name: LaserSensor(topic=topic)}), silent
        scanner = LaserSensor(topic=topic, mounted_on=base, room_from_sensor=pose)
        silent += [Loss(name, 0, 0, assumed, "a rig.yaml that says where it sits is expected", always=True)] * bool(
            assumed
        )
        return Rig(sensors={name: scanner, base: odometry}), silent
    if scans:
        raise InputError(
            f"{path}: has {len(scans)} LaserScan topics ({', '.join(scans)}); "
            f"a rig.yaml (--rig) that says which sensor each is and where it stands is expected; `twin new rig {path}` writes one"
        )
    if images:
        raise InputError(
            f"{path}: has no LaserScan topic, only images ({', '.join(images)}); "
            f"a rig.yaml (--rig) with the place and the lens of each camera is expected; `twin new rig {path}` writes one"
        )
    have = ", ".join(f"{name} ({topic.msgtype})" for name, topic in sorted(topics.items())) or "none"
    raise InputError(
        f"{path}: has no usable topic, its topics are: {have}; a {LASER_SCAN} topic is expected{conversion(topics.values())}"
    )


def _guess_base(
    frame: str, tree: TransformTree, poses: Mapping[str, PoseTopic]
) -> tuple[OdometrySensor | None, Pose, str]:
    """Return the odometry of the base that moves a frame, the frame's pose on it, and what had to be assumed.

    The base is the first frame above that moves against its parent; the frame that stands is one called odom (REP 105, it
    never jumps), else the highest whose child moves. Where transforms do not tell, the only Odometry that moves:
    what is highest above the frame is at its base.
    """
    chain = _chain(tree, frame)
    moving = [number for number, edge in enumerate(chain) if edge.moves]
    if moving:
        base = chain[moving[0]].child
        above = chain[moving[0] : moving[-1] + 1]
        stands = next((edge.parent for edge in above if edge.parent.split("/")[-1] == "odom"), above[-1].parent)
        odometry = OdometrySensor(topic=above[0].topic, frame=stands, base_frame=base)
        return odometry, _pose_on(tree, frame, base), ""
    on_it = tree.ancestors([frame])
    found = {topic: each for topic, each in poses.items() if each.msgtype == ODOMETRY and each.moves}
    for topic, each in found.items():
        if each.child in on_it:
            return OdometrySensor(topic=topic), _pose_on(tree, frame, each.child), ""
    untold = {topic: each for topic, each in found.items() if tree.may_carry(each.child, on_it)}
    if len(untold) == 1:
        ((topic, each),) = untold.items()
        above = chain[-1].parent if chain else ""
        on = f"{each.child or 'the base'} of {topic}"
        assumed = f"moves with {on}, and no transform tells where {above or 'it'} sits on it: at its origin"
        return OdometrySensor(topic=topic), _pose_on(tree, frame, above or frame), assumed
    return None, Pose(), ""


def _chain(tree: TransformTree, frame: str) -> list[Edge]:
    """Return the edges from a frame up to its root, none where the tree goes in a circle there."""
    try:
        return tree.chain(frame)
    except InputError:
        return []


def _unused_place(path: Path, name: str, frame: str, tree: TransformTree) -> list[Loss]:
    """Tell of a scanner that transforms place in another frame, where its tracks leave in its own."""
    above = _chain(tree, frame)[-1:]
    if not above or np.allclose(tree.static_pose(frame, above[0].parent), np.eye(4)):
        return []
    what = f"transforms place its frame {frame} in {above[0].parent}, and without a rig its tracks leave in {frame}"
    return [Loss(name, 0, 0, what, f"`twin new rig {path}` writes a rig with that place", always=True)]


def _pose_on(tree: TransformTree, frame: str, base: str) -> Pose:
    return Pose.from_transform(np.eye(4) if frame.strip("/") == base else tree.static_pose(frame, base))


def _name_of(topic: str) -> str:
    """Return a topic as the name of a sensor."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", topic.strip("/"))[:90]
    return name if name[:1].isalpha() else f"scan_{name}"


_UNDECIDED = "CHECK"
"""Marks the lines of a written rig.yaml that the bag does not decide."""
_HEIGHT_DECIDES = (
    f"# The height of a scanner (z of xyz) decides its role: waist (trunks) from {WAIST_FROM_M:g} m on, knee (legs) below. z = 0",
    "# means knee too, but waist to a tracker of trunks alone. `role: waist` or `role: knee` beside the pose decides instead.",
)
_DEPTHS = ("16UC1", "32FC1", "mono16", "compressedDepth")
"""Encodings of depth pictures, whole or as part of a compressed picture's format."""


def undecided_lines(path: AnyPath) -> list[Loss]:
    """Tell of the lines of a written `rig.yaml` that are still marked as not decided by the bag, each with its number."""
    mark = f"# {_UNDECIDED}: "
    return [
        Loss(f"{path}, line {number}", 0, 0, line.partition(mark)[2], "correct it, and delete the mark", always=True)
        for number, line in enumerate(read_text(path, "rig").splitlines(), 1)
        if mark in line
    ]


def describe_rig(path: AnyPath, standing: str | None = None) -> tuple[str, list[str]]:
    """Describe all sensors of a bag as the text of a commented `rig.yaml`, and list what is left to fill in.

    Scanners, cameras with the lens of their CameraInfo, depth beside colour of one frame, and bases that move are found by
    types of topics; poses by the bag's transforms, in the frame `standing` (None: the highest above each sensor, or that of
    the odometry). A bag of the twin has a rig of its own. Raises InputError for a bag without scans and pictures, and for an
    unknown frame.
    """
    path = Path(path)
    with open_bag(path) as bag:
        if names.RIG in bag.topics:
            for _, _, message in bag.messages([names.RIG]):
                own = Rig.parse(message.data, f"{path}, topic {names.RIG}")
                return f"# The rig of {path.name}, as the twin recorded it.\n{own.dump_yaml()}", []
        found = _SensorsOfBag(bag, standing)
        if not found.lines:
            raise InputError(
                f"{path}: has neither scans nor pictures; a bag with a topic of {LASER_SCAN} or {RAW_IMAGE} is expected"
                f"{conversion(bag.topics.values())}"
            )
        head = [
            f"# Sensors of {path.name} ({bag.duration_s:.0f} s), as its messages tell them. {_UNDECIDED}: they do not.",
            "# Lengths in metres; rpy: roll, pitch, yaw about fixed axes, in radians. `twin schema rig` lists all fields.",
            *(_HEIGHT_DECIDES if "    kind: laser" in found.lines else ()),
            "sensors:",
        ]
        area = "# area: [[-2, -2], [2, -2], [2, 2], [-2, 2]]  # polygon in which people are tracked; none: everywhere"
        text = "\n".join([*head, *found.lines, area, ""])
        undecided = list(found.undecided)
        for topic, each in bag.topics.items():
            if hint := conversion([each]):
                undecided.append(
                    f"{topic}: no sensor reads {each.msgtype}; {LASER_SCAN} or {RAW_IMAGE} is expected{hint}"
                )
        try:
            Rig.parse(text, "the rig")
        except InputError as error:
            undecided += str(error).splitlines()
    return text, undecided


class _SensorsOfBag:
    """Lines of a rig.yaml for each sensor of an open bag, and what is left to do about them."""

    def __init__(self, bag: Bag, standing: str | None) -> None:
        self._bag, self._topics = bag, bag.topics
        self._tree, self._poses = TransformTree.read(bag), read_poses(bag)
        self._standing = None if standing is None else standing.strip("/")
        self._bases: dict[str, OdometrySensor] = {}
        self._names: dict[str, str] = {}
        self.lines: list[str] = []
        self.undecided = [
            f"transforms give a frame two places, {each}: two robots or two drivers; a bag of each, or frames of their own, is "
            "expected"
            for each in self._tree.doubled
        ]
        for topic in self._with_messages(LASER_SCAN):
            self._add(topic, first_frame(bag, topic), "laser", [])
        pictures = {topic: first_frame(bag, topic) for topic in self._with_messages(*PICTURES)}
        depths = {topic: frame for topic, frame in pictures.items() if self._is_depth(topic)}
        beside = {topic: self._depth_beside(frame, depths) for topic, frame in pictures.items() if topic not in depths}
        for topic, depth in beside.items():
            self._add_camera(topic, pictures[topic], depth)
        for topic, frame in depths.items():
            if topic not in beside.values():
                self.undecided.append(
                    f"{topic}: distances of frame {frame!r}, in which no colour picture is, are left out; a stereo camera's "
                    "depth_topic, aligned to its colour, is expected for them"
                )
        for name, base in self._bases.items():
            fields = {"topic": base.topic, "frame": base.frame, "base_frame": base.base_frame}
            lines = [f"    {field}: {_plain(text)}" for field, text in fields.items() if text]
            self.lines += [f"  {name}:", "    kind: odometry", *lines]

    def _with_messages(self, *msgtypes: str) -> list[str]:
        """Return the topics of these types that have messages."""
        return [topic for topic in topics_of(self._topics, *msgtypes) if self._topics[topic].message_count]

    def _is_depth(self, topic: str) -> bool:
        """Return True for a topic whose first message has an encoding of depth."""
        msgtype = self._topics[topic].msgtype
        for _, _, data, is_ros1 in self._bag.encoded_messages({topic: msgtype}):
            message = decoded(data, msgtype, is_ros1)
            return any(each in getattr(message, "format", getattr(message, "encoding", "")) for each in _DEPTHS)
        return False

    def _depth_beside(self, frame: str, depths: Mapping[str, str]) -> str | None:
        """Return the topic of depth pictures in the frame of a colour picture."""
        return next((topic for topic in depths if frame and depths[topic] == frame), None)

    def _name(self, topic: str) -> str:
        """Return the name of a topic's sensor, its own among all."""
        if topic not in self._names:
            name, taken = _name_of(topic), self._names.values()
            self._names[topic] = name if name not in taken else f"{name}_{len(self._names) + 1}"
        return self._names[topic]

    def _add_camera(self, topic: str, frame: str, depth: str | None) -> None:
        lens = kind_of_lens(self._bag, topic)
        kind = "stereo" if depth and lens != "fisheye" else lens or "camera"
        fields = [f"    depth_topic: {_plain(depth)}"] if depth and kind == "stereo" else []
        if not lens:
            self.undecided.append(f"{self._name(topic)}: the bag does not tell its lens; intrinsics are expected")
            sizes = "{width: 640, height: 480, fx: 500, fy: 500, cx: 319.5, cy: 239.5}"
            fields.append(
                f"    # intrinsics: {sizes}  # {_UNDECIDED}: the bag has no CameraInfo of it that tells its lens"
            )
        else:
            sensor = {"kind": kind, "topic": topic}
            intrinsics = with_intrinsics(self._bag, {"sensors": {"it": sensor}})["sensors"]["it"]["intrinsics"]
            typed = ", ".join(f"{field}: {value}" for field, value in intrinsics.items())
            remark = ""
            if kind == "fisheye":
                self.undecided.append(
                    f"{self._name(topic)}: no CameraInfo tells a field of view; field_of_view_rad is expected"
                )
                remark = f"  # {_UNDECIDED}: no CameraInfo tells a field of view"
            fields.append(f"    intrinsics: {{{typed}}}{remark}")
        self._add(topic, frame, kind, fields)

    def _add(self, topic: str, frame: str, kind: str, fields: list[str]) -> None:
        """Add the lines of a sensor: topic, further fields, and where it is."""
        count, took_s = self._topics[topic].message_count, self._bag.duration_s
        rate = f", {(count - 1) / took_s:.3g} Hz" if took_s > 0 else ""
        self.lines += [
            f"  {self._name(topic)}:",
            f"    kind: {kind}",
            f"    topic: {_plain(topic)}  # {count} messages{rate}, frame {_plain(frame) or 'not named'}",
            *fields,
            *self._where(topic, frame),
        ]

    def _where(self, topic: str, frame: str) -> list[str]:
        """Return the lines that tell a sensor's pose, on its base if it has one that moves."""
        base, pose, assumed = _guess_base(frame, self._tree, self._poses)
        if base is not None and self._standing is not None:
            base = self._standing_in(self._standing, frame, base)
        if base is not None:
            name = next((name for name, each in self._bases.items() if each == base), None)
            name = name or f"odometry_{len(self._bases) + 1}"
            self._bases[name] = base
            if assumed:
                self.undecided.append(f"{self._name(topic)}: {assumed}")
            where = (
                f"{_UNDECIDED}: {assumed}"
                if assumed
                else f"of {_plain(frame)} on {_plain(base.base_frame or 'the base')}"
            )
            return [f"    mounted_on: {name}", f"    {_yaml(pose)}  # {where}"]
        edges = self._chain(frame)
        if not edges and frame != self._standing:
            self.undecided.append(
                f"{self._name(topic)}: no transform of the bag tells where it is; room_from_sensor is expected"
            )
            return [f"    {_yaml(Pose())}  # {_UNDECIDED}: no transform of the bag tells where it is"]
        stands = self._standing or edges[-1].parent
        return [f"    {_yaml(_pose_on(self._tree, frame, stands))}  # of {_plain(frame)} in {_plain(stands)}"]

    def _standing_in(self, standing: str, frame: str, base: OdometrySensor) -> OdometrySensor | None:
        """Return the base's odometry in the frame that is to stand; None where the sensor's frame does not move in it.

        Raises InputError where no transform leads there.
        """
        up, down = self._tree.path(standing, frame)
        if not any(edge.moves for edge in (*up, *down)):
            return None
        moves = base.base_frame or self._poses[base.topic].child
        edge, _ = self._tree.poses(standing, moves)
        return OdometrySensor(topic=edge.topic, frame=standing, base_frame=moves)

    def _chain(self, frame: str) -> list[Edge]:
        try:
            return self._tree.chain(frame)
        except InputError as error:
            self.undecided.append(str(error))
            return []


def _plain(text: str) -> str:
    """Quote a name that YAML would not read unquoted."""
    return text if re.fullmatch(r"[\w/][\w/.-]*|", text) else json.dumps(text)


def _yaml(pose: Pose) -> str:
    xyz, rpy = ([round(each, 5) + 0.0 for each in part] for part in (pose.xyz, pose.rpy))
    return f"room_from_sensor: {{xyz: {xyz}, rpy: {rpy}}}"
