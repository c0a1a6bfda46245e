"""Whether a sensor moves while it is recorded, as a robot's odometry and transforms say. Tracks need a sensor that stands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import acos, degrees, dist, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from trackers.errors import InputError
from twin.recording.bag import Bag, decoded
from twin.recording.topics import TF_STATIC

_ODOMETRY = "nav_msgs/msg/Odometry"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MOVED_M = 0.1
_TURNED_DEG = 2.0
"""What odometry may make up of a robot that stands; a person at 5 m is then off by less than the width of a body."""
_MOST_STEPS = 100  # from a frame to the root: a tree with a circle in it has none


@dataclass
class _Motion:
    """How far something has come from its first pose at most."""

    first: tuple[Any, Any] | None = None
    moved_m: float = 0.0
    turned_deg: float = 0.0

    def add(self, place: Any, turn: Any) -> None:
        here = (place.x, place.y, place.z)
        length = sqrt(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2)
        if not length:
            return
        facing = tuple(each / length for each in (turn.x, turn.y, turn.z, turn.w))
        if self.first is None:
            self.first = here, facing
        self.moved_m = max(self.moved_m, dist(here, self.first[0]))
        cosine = abs(sum(a * b for a, b in zip(facing, self.first[1], strict=True)))
        self.turned_deg = max(self.turned_deg, degrees(2 * acos(min(cosine, 1.0))))

    @property
    def moves(self) -> bool:
        return self.moved_m > _MOVED_M or self.turned_deg > _TURNED_DEG


def motions(bag: Bag, frames: Mapping[str, Iterable[str]]) -> list[str]:
    """A warning for the sensors that something in the bag says to move; `frames`: the frame_ids of each sensor's messages.

    A transform moves a sensor if it lies between the sensor's frame and the root of the tree. A robot's odometry, or pose,
    moves those sensors that stand on it, and all where no transform says what stands where.
    """
    poses, edges, parents = _read(bag)
    chains = {name: _ancestors(own, parents) for name, own in frames.items()}
    moved: dict[str, list[str]] = {}
    for topic, (child, motion) in poses.items():
        for name, chain in chains.items():
            stands_on_it = child in chain or not parents or not any(each in parents for each in chain)
            if motion.moves and stands_on_it:
                moved.setdefault(_said(topic, motion), []).append(name)
    for (topic, parent, child), motion in edges.items():
        if motion.moves:
            on_it = [name for name, chain in chains.items() if child in chain]
            if on_it:
                moved.setdefault(_said(f"{topic} ({parent} to {child})", motion), []).extend(on_it)
    return [
        f"{', '.join(names)} moves: {said}; tracks are in the sensor's own moving frame, in which things that stand look like "
        "people. Poses of moving sensors are not used yet: record with the robot standing"
        for said, names in moved.items()
    ]


def _said(what: str, motion: _Motion) -> str:
    return f"by {what} it turned by up to {motion.turned_deg:.0f}° and went up to {motion.moved_m:.2f} m"


def _read(
    bag: Bag,
) -> tuple[dict[str, tuple[str, _Motion]], dict[tuple[str, str, str], _Motion], dict[str, str]]:
    """Motion by topic of poses with the frame that moves, motion by transform, and the parent of each frame."""
    poses: dict[str, tuple[str, _Motion]] = {}
    edges: dict[tuple[str, str, str], _Motion] = {}
    parents: dict[str, str] = {}
    valid = (_ODOMETRY, _POSE, *_TRANSFORMS)
    types = {name: kind for name, topic in bag.topics.items() if (kind := topic.type_among(valid)) is not None}
    for topic, _, data, is_ros1 in bag.encoded_messages(types):
        try:
            message = decoded(data, types[topic], is_ros1)
        except InputError:
            continue
        if types[topic] in _TRANSFORMS:
            for each in message.transforms:
                parent, child = (name.strip("/") for name in (each.header.frame_id, each.child_frame_id))
                parents[child] = parent
                if topic != TF_STATIC:
                    motion = edges.setdefault((topic, parent, child), _Motion())
                    motion.add(each.transform.translation, each.transform.rotation)
        else:
            child = getattr(message, "child_frame_id", "").strip("/")
            _, motion = poses.setdefault(topic, (child, _Motion()))
            motion.add(message.pose.pose.position, message.pose.pose.orientation)
    return poses, edges, parents


def first_transforms(bag: Bag) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """The parent of each frame, and the transform (4, 4) of its points to the parent's, as it is said first."""
    types = {name: kind for name, topic in bag.topics.items() if (kind := topic.type_among(_TRANSFORMS)) is not None}
    found: dict[str, tuple[str, NDArray[np.float64]]] = {}
    for topic, _, data, is_ros1 in bag.encoded_messages(types):
        try:
            message = decoded(data, types[topic], is_ros1)
        except InputError:
            continue
        for each in message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
            if each.child_frame_id.strip("/") in found or not quaternion.any():
                continue
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
            matrix[:3, 3] = place.x, place.y, place.z
            found[each.child_frame_id.strip("/")] = each.header.frame_id.strip("/"), matrix
    return found


def _ancestors(frames: Iterable[str], parents: Mapping[str, str]) -> set[str]:
    """The frames and all that they stand on."""
    found: set[str] = set()
    for frame in frames:
        here: str | None = frame.strip("/")
        for _ in range(_MOST_STEPS):
            if here is None or here in found:
                break
            found.add(here)
            here = parents.get(here)
    return found
