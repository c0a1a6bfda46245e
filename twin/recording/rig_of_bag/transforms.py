"""Transforms of a bag (`/tf`, `/tf_static`): the tree of frames, who moves in it, and a frame's pose over time.

Conventions of ROS (REP 103, REP 105): a message gives the pose of a child frame in its parent's; each frame has one parent.
Poses between two messages are interpolated: places linearly, rotations along the shortest arc (slerp).
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trackers.area import displacement
from trackers.arrays import Nanoseconds
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.recording.bags.bag import Bag, decoded
from twin.recording.ros.message_types import TRANSFORM_MESSAGES
from twin.recording.ros.ros_messages import ODOMETRY, matrix_of, stamp_of
from twin.recording.ros.topics import TF_STATIC

_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_OF_ANYTHING = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
"""Types of poses of a base, as of motion capture, or of a person, a goal or a thing."""
MOVED_M, TURNED_DEG = 0.1, 2.0
"""Error of odometry on a robot that stands; a person at 5 m is then off by less than the width of a body."""

Poses = NDArray[np.float64]  # (n, 4, 4)


def moves(poses: Poses) -> bool:
    """Return True where poses leave the first one by more than the noise of odometry."""
    moved_m, turned_deg = displacement(poses)
    return moved_m > MOVED_M or turned_deg > TURNED_DEG


@dataclass(frozen=True, eq=False)
class Edge:
    """The poses of a frame in its parent's, over time: stamps_ns, parent_from_child, and the message that brought each.

    number: of the message among those of its topic, in the order read; a message may hold many transforms. log_ns: when each
    was logged. is_static: read from `/tf_static`. copied_ns: how much later each left out copy was logged [ns].
    """

    topic: str
    parent: str
    child: str
    is_static: bool
    stamps_ns: Nanoseconds
    log_ns: Nanoseconds
    number: NDArray[np.int64]
    parent_from_child: Poses
    copied_ns: Nanoseconds = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @cached_property
    def moves(self) -> bool:
        """True where the child moves in its parent's frame."""
        return not self.is_static and moves(self.parent_from_child)

    def contradicts(self, other: Edge) -> bool:
        """Return True where another edge of the same frames tells other poses."""
        steps = np.linalg.inv(self.at(other.times_ns)) @ other.parent_from_child
        return moves(np.concatenate([np.eye(4)[None], steps]))

    @cached_property
    def times_ns(self) -> Nanoseconds:
        """Times of the poses [ns]: the stamps, or where these are all the same (0, as a rule) the log times."""
        return self.stamps_ns if np.ptp(self.stamps_ns) else self.log_ns

    def at(self, times_ns: Nanoseconds) -> Poses:
        """Interpolate the poses (n, 4, 4) at these times [ns]; before the first and after the last it stays there."""
        times, first = np.unique(self.times_ns, return_index=True)
        poses = self.parent_from_child[first]
        if len(times) == 1 or self.is_static:
            return np.broadcast_to(poses[-1], (len(times_ns), 4, 4))
        from scipy.spatial.transform import Rotation, Slerp

        since = np.clip(times_ns, times[0], times[-1]) - times[0]
        known = (times - times[0]).astype(float)
        found = np.tile(np.eye(4), (len(since), 1, 1))
        found[:, :3, :3] = Slerp(known, Rotation.from_matrix(poses[:, :3, :3]))(since).as_matrix()
        found[:, :3, 3] = np.column_stack([np.interp(since, known, poses[:, k, 3]) for k in range(3)])
        return found


_STANDING = ("map", "odom", "world", "earth", "room")
"""Names of frames that stand (REP 105, and the twin's own)."""


class TransformTree:
    """The frames of a bag, each with the edge to its parent, by the child's name.

    A frame with two parents, or on two topics, keeps one; `doubled` names the others. `unusable`: number of transforms by child
    and parent that hold no pose, as a quaternion of length 0. `undecodable`: how many messages of how many, by topic.
    """

    def __init__(
        self,
        edges: Mapping[str, Edge],
        doubled: Iterable[str] = (),
        unusable: Mapping[tuple[str, str], int] | None = None,
        undecodable: Mapping[str, tuple[int, int]] | None = None,
    ) -> None:
        self.edges = dict(edges)
        self.doubled = tuple(doubled)
        self.unusable = dict(unusable or {})
        self.undecodable = dict(undecodable or {})

    @classmethod
    def read(cls, bag: Bag, near: Collection[str] = (), *, in_file_order: bool = False) -> TransformTree:
        """Read all transforms of a bag; messages and transforms that cannot be used are counted.

        near: topics of sensors; of two robots with the same frames, transforms in the namespace of these are preferred.
        """
        types = {
            name: kind
            for name, topic in bag.topics.items()
            if (kind := topic.type_among(TRANSFORM_MESSAGES)) is not None
        }
        found: dict[tuple[str, str, str], _Growing] = {}
        unusable: Counter[tuple[str, str]] = Counter()
        undecodable: Counter[str] = Counter()
        numbers = dict.fromkeys(types, -1)
        for topic, log_ns, data, is_ros1 in bag.encoded_messages(types, in_file_order=in_file_order):
            numbers[topic] += 1
            try:
                message = decoded(data, types[topic], is_ros1)
            except InputError:
                undecodable[topic] += 1
                continue
            for each in message.transforms:
                parent, child = each.header.frame_id.strip("/"), each.child_frame_id.strip("/")
                matrix = matrix_of(each.transform.translation, each.transform.rotation)
                if not np.isfinite(matrix).all():
                    unusable[child, parent] += 1
                elif parent != child:
                    growing = found.setdefault((child, parent, topic), _Growing(topic))
                    growing.add(stamp_of(each), log_ns, numbers[topic], matrix)
        edges: dict[str, Edge] = {}
        doubled = []
        best_first = sorted(found.items(), key=lambda item: (_remoteness(item[0][2], near), -len(item[1].stamps)))
        for (child, parent, topic), growing in best_first:
            edge = growing.edge(parent, child)
            kept = edges.setdefault(child, edge)
            if kept.parent != parent:
                doubled.append(f"{child} (of {kept.parent} and {parent})")
            elif kept is not edge and kept.contradicts(edge):
                doubled.append(f"{child} (of {parent} by {kept.topic} and by {topic})")
            elif edge.is_static and moves(edge.parent_from_child):
                doubled.append(f"{child} (of {parent}, which {topic} changes)")
        return cls(edges, doubled, unusable, {topic: (n, numbers[topic] + 1) for topic, n in undecodable.items()})

    def chain(self, frame: str) -> list[Edge]:
        """Return the edges from a frame up to its root; raises InputError for a tree that goes in a circle there."""
        here, passed, edges = frame.strip("/"), [frame.strip("/")], []
        while here in self.edges:
            edges.append(self.edges[here])
            here = edges[-1].parent
            if here in passed:
                circle = " > ".join([*passed[passed.index(here) :], here])
                raise InputError(
                    f"transforms go in a circle: {circle}; a tree, in which no frame is above itself, is expected"
                )
            passed.append(here)
        return edges

    def standing_pose(self, frame: str, base: str) -> Poses | None:
        """Return the pose (4, 4) of a frame in another; None where transforms do not tell it, or it moves there."""
        if frame == base:
            return np.eye(4)
        try:
            edges = [edge for way in self.path(frame, base) for edge in way]
        except InputError:
            return None
        return None if any(edge.moves for edge in edges) else self.static_pose(frame, base)

    def may_carry(self, base: str, frames: Collection[str]) -> bool:
        """Return whether a base may carry frames that are not below it; `frames`: with all above them.

        It may where no transform tells of the frames; else where none tells of the base, and what is above the frames has no
        name of a frame that stands.
        """
        if not any(each in self.edges for each in frames):
            return True
        tops = {each for each in frames if each not in self.edges}
        known = {*self.edges, *(edge.parent for edge in self.edges.values())}
        return base not in known and bool(tops) and all(each.split("/")[-1] not in _STANDING for each in tops)

    def ancestors(self, frames: Iterable[str]) -> set[str]:
        """Return the frames and all above them; of a circle, all that are in it."""
        found: set[str] = set()
        for frame in frames:
            here: str | None = frame.strip("/")
            while here is not None and here not in found:
                found.add(here)
                here = self.edges[here].parent if here in self.edges else None
        return found

    def path(self, frame: str, base: str) -> tuple[list[Edge], list[Edge]]:
        """Return the edges that lead from the base, and those that lead from the frame, up to their common ancestor.

        Raises InputError for frames that are not there, not in one tree, or in a circle.
        """
        frame, base = frame.strip("/"), base.strip("/")
        known = {*self.edges, *(edge.parent for edge in self.edges.values())}
        for each in (frame, base):
            if each not in known:
                have = ", ".join(sorted(known)[:20]) or "none"
                raise InputError(f"no transform names a frame {each!r}; one of those of the bag is expected: {have}")
        above_base, above_frame = self.chain(base), self.chain(frame)
        frames_up = [frame, *(edge.parent for edge in above_frame)]
        reached = [base, *(edge.parent for edge in above_base)]
        common = next((each for each in reached if each in frames_up), None)
        if common is None:
            raise InputError(
                f"frames {frame!r} and {base!r} are in two trees, below {frames_up[-1]!r} and {reached[-1]!r}: the transform "
                "between them is missing; record /tf and /tf_static whole, or name two frames of one tree"
            )
        return above_base[: reached.index(common)], above_frame[: frames_up.index(common)]

    def static_pose(self, frame: str, base: str) -> NDArray[np.float64]:
        """Return the pose (4, 4) of `frame` in that of `base` at first, by their path."""
        up, down = self.path(base, frame)  # up: from the frame, down: from the base
        base_from_frame = np.eye(4)
        for edge in reversed(up):
            base_from_frame = base_from_frame @ edge.parent_from_child[0]
        for edge in reversed(down):
            base_from_frame = np.linalg.inv(edge.parent_from_child[0]) @ base_from_frame
        return base_from_frame

    def poses(self, frame: str, base: str) -> tuple[Edge, Poses]:
        """Return the poses (n, 4, 4) of the base in a frame, and the edge at whose stamps they are: the one of most messages.

        Raises InputError as `path`, and where no transform between the two moves with time.
        """
        up, down = self.path(frame, base)
        timed = [edge for edge in (*up, *down) if not edge.is_static]
        if not timed:
            raise InputError(
                f"between frames {frame!r} and {base!r} all transforms are of {TF_STATIC}: the base never moves; frames with a "
                "transform of /tf between them are expected"
            )
        main = max(timed, key=lambda edge: len(edge.stamps_ns))
        whole = np.broadcast_to(np.eye(4), (len(main.stamps_ns), 4, 4))
        for edge in reversed(up):
            whole = whole @ edge.at(main.times_ns)
        for edge in reversed(down):
            whole = np.linalg.inv(edge.at(main.times_ns)) @ whole
        return main, np.ascontiguousarray(whole)


def _remoteness(topic: str, near: Collection[str]) -> int:
    """Return 0 for a topic in a namespace of others, 1 for one in none, 2 for one in another."""
    namespace = topic[: topic.rindex("/") + 1]
    return 1 if namespace == "/" else 0 if any(each.startswith(namespace) for each in near) else 2


class _Growing:
    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.stamps, self.log, self.number = array("q"), array("q"), array("q")
        self.values = array("d")

    def add(self, stamp_ns: int, log_ns: int, number: int, matrix: NDArray[np.float64]) -> None:
        self.stamps.append(stamp_ns)
        self.log.append(log_ns)
        self.number.append(number)
        self.values.extend(matrix.ravel().tolist())

    def edge(self, parent: str, child: str) -> Edge:
        stamps, log, number = (np.array(each, dtype=np.int64) for each in (self.stamps, self.log, self.number))
        poses = np.array(self.values).reshape(-1, 4, 4)
        kept, copied_ns = self._firsts(stamps, log, poses)
        rows = stamps[kept], log[kept], number[kept], poses[kept]
        return Edge(self.topic, parent, child, self.topic.endswith(TF_STATIC), *rows, copied_ns)

    @staticmethod
    def _firsts(stamps: Nanoseconds, log: Nanoseconds, poses: Poses) -> tuple[NDArray[np.intp], Nanoseconds]:
        """Return the rows that are no copies of an earlier one, of one stamp (not 0) and pose, and how much later copies came."""
        if np.unique(stamps).size == stamps.size:
            return np.arange(stamps.size), np.empty(0, dtype=np.int64)
        first: dict[tuple[int, bytes], int] = {}
        of = [
            first.setdefault((stamp, pose.tobytes()), k)
            for k, (stamp, pose) in enumerate(zip(stamps.tolist(), poses, strict=True))
        ]
        is_copy = (np.array(of) < np.arange(stamps.size)) & (stamps != 0)
        return np.flatnonzero(~is_copy), (log - log[of])[is_copy]


@dataclass(frozen=True, eq=False)
class PoseTopic:
    """Poses of a moving base on a topic: the frame that moves ('' where not said), and its poses in the one that stands.

    unusable: number of messages that hold no pose.
    """

    msgtype: str
    child: str
    stamps_ns: Nanoseconds
    poses: Poses
    unusable: int = 0

    @cached_property
    def moves(self) -> bool:
        """True where the base moves; goals, which come now and then, do not."""
        is_seldom = self.is_of_anything and (len(self.poses) < 2 or np.median(np.diff(self.stamps_ns)) > NS_PER_S)
        return len(self.poses) > 0 and not is_seldom and moves(self.poses)

    @property
    def is_of_anything(self) -> bool:
        """True for poses that may be of a person or a thing."""
        return self.msgtype in _OF_ANYTHING


def read_poses(bag: Bag) -> dict[str, PoseTopic]:
    """Read the topics of Odometry, PoseWithCovarianceStamped, and poses of anything; messages without a pose are counted."""
    valid = (ODOMETRY, _POSE, *_OF_ANYTHING)
    types = {name: kind for name, topic in bag.topics.items() if (kind := topic.type_among(valid)) is not None}
    found: dict[str, tuple[str, _Growing]] = {}
    unusable: Counter[str] = Counter()
    for topic, log_ns, data, is_ros1 in bag.encoded_messages(types):
        try:
            message = decoded(data, types[topic], is_ros1)
        except InputError:
            unusable[topic] += 1
            continue
        if types[topic] == _OF_ANYTHING[1]:
            matrix = matrix_of(message.transform.translation, message.transform.rotation)
        else:
            pose = message.pose if types[topic] == _OF_ANYTHING[0] else message.pose.pose
            matrix = matrix_of(pose.position, pose.orientation)
        child = getattr(message, "child_frame_id", "").strip("/")
        _, growing = found.setdefault(topic, (child, _Growing(topic)))
        if np.isfinite(matrix).all():
            growing.add(stamp_of(message), log_ns, 0, matrix)
        else:
            unusable[topic] += 1
    for topic in unusable:
        found.setdefault(topic, ("", _Growing(topic)))
    edges = {topic: (child, growing.edge("", child)) for topic, (child, growing) in found.items()}
    return {
        topic: PoseTopic(types[topic], child, edge.stamps_ns, edge.parent_from_child, unusable[topic])
        for topic, (child, edge) in edges.items()
    }
