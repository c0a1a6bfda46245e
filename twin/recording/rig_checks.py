"""Compare a rig with what the bag itself says of its sensors: lenses (CameraInfo), and motion (odometry and transforms).

Trackers use the rig, and need sensors that stand still.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import acos, degrees, dist, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from trackers.arrays import Array
from trackers.cameras import FisheyeIntrinsics, Intrinsics, PinholeIntrinsics
from trackers.errors import InputError
from trackers.rig import CameraSensor, Rig
from twin.recording.bag import Bag, decoded
from twin.recording.losses import Loss
from twin.recording.topics import TF_STATIC

_TYPE = "sensor_msgs/msg/CameraInfo"
_TRANSPORTS = ("compressed", "compressedDepth")
_PINHOLE, _FISHEYE = ("plumb_bob", "rational_polynomial", ""), ("equidistant", "fisheye")
_OFF = 0.01
"""Places that differ by more than this share of the picture's width are reported: at 5 m in a view of 60°, 6 cm."""
_GRID = 9


def compare_lenses(bag: Bag, rig: Rig, sensors: Mapping[str, str]) -> list[Loss]:
    """Return what the bag's CameraInfo contradicts in the rig; `sensors`: the sensor of each topic.

    The first message of a camera's topic is taken: lenses seldom change. Nothing is said of a camera without one.
    """
    cameras = {
        topic: sensor for topic, name in sensors.items() if isinstance(sensor := rig.sensors[name], CameraSensor)
    }
    waiting = {
        info: topic
        for topic in cameras
        if (info := _info_topic(topic)) in bag.topics and bag.topics[info].msgtype == _TYPE
    }
    losses = []
    for info, _, message in bag.messages(list(waiting)):
        topic = waiting.pop(info, None)
        if topic is None:
            continue
        is_rectified = any("rect" in part for part in topic.split("/"))
        what, remedy = _contradiction(message, cameras[topic].intrinsics, is_rectified=is_rectified)
        if what:
            losses.append(Loss(sensors[topic], 0, 0, f"{info} {what}", remedy, always=True))
        if not waiting:
            break
    return losses


def _info_topic(topic: str) -> str:
    """Return the CameraInfo topic of a topic of images: in the same namespace, whatever transport the images take."""
    parts = topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts.pop()
    return "/".join([*parts[:-1], "camera_info"])


def _contradiction(message: Any, lens: Intrinsics, *, is_rectified: bool) -> tuple[str, str]:
    """Return what of a CameraInfo a lens contradicts, and what to do; two empty words where they agree.

    A CameraInfo speaks of the whole sensor; its region of interest is cut out of that, then pixels are binned (REP 104).
    """
    stays = "the rig's intrinsics are taken as they are"
    matrix = np.array(_field(message, "p" if is_rectified else "k"), dtype=float).reshape(3, -1)[:, :3]
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        return "is that of a camera that was never calibrated (its matrix is zero)", stays
    bins = np.maximum([message.binning_x, message.binning_y], 1)
    region = message.roi
    width, height = np.array([region.width or message.width, region.height or message.height]) // bins
    if (width, height) != (lens.width, lens.height):
        how = ["binned"] * bool(bins.max() > 1) + ["a region of interest"] * bool(region.width)
        said = f"is for pictures of {width} x {height}" + f" ({', '.join(how)})" * bool(how)
        remedy = "intrinsics at the size of the pictures are expected"
        return f"{said}, the rig's intrinsics for {lens.width} x {lens.height}", remedy
    matrix[:2] = (matrix[:2] - [[0, 0, region.x_offset], [0, 0, region.y_offset]]) / bins[:, None]
    try:
        own = _lens(
            lens, matrix, "plumb_bob" if is_rectified else message.distortion_model, _field(message, "d"), is_rectified
        )
    except ValidationError as error:
        why = error.errors()[0]["msg"].removeprefix("Value error, ")
        return f"has a lens that cannot be compared: {why}", stays
    if own is None:
        return f"has a lens of the model {message.distortion_model!r}, which is not supported", stays
    off_px = _apart(lens, own)
    if off_px <= _OFF * lens.width:
        return "", ""
    typed = own.model_dump_json(exclude={"field_of_view_rad"}).replace('"', "").replace(":", ": ")
    far = f"up to {off_px:.0f} px apart" if np.isfinite(off_px) else "in no common place"
    return (
        f"and the rig's intrinsics have what they see {far}",
        f"`intrinsics: {typed}` in rig.yaml, if the bag is right",
    )


def _lens(lens: Intrinsics, matrix: Array, model: str, coefficients: Any, is_rectified: bool) -> Intrinsics | None:
    """Return the lens of a CameraInfo at the size of another; None for a model that is not supported."""
    (fx, _, cx), (_, fy, cy) = matrix[:2].tolist()
    given = [] if is_rectified else [float(each) for each in coefficients]
    common = {"width": lens.width, "height": lens.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    if model in _PINHOLE:
        return PinholeIntrinsics.model_validate(common | {"distortion": given})
    if model in _FISHEYE:
        field_rad = lens.field_of_view_rad if isinstance(lens, FisheyeIntrinsics) else np.pi
        return FisheyeIntrinsics.model_validate(common | {"k": (given + [0.0] * 4)[:4], "field_of_view_rad": field_rad})
    return None


def _apart(lens: Intrinsics, other: Intrinsics) -> float:
    """Return how far apart two lenses put the same thing at most [px]; inf where they see nothing in common."""
    columns, rows = np.meshgrid(np.linspace(0, lens.width - 1, _GRID), np.linspace(0, lens.height - 1, _GRID))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    rays = lens.rays(pixels)
    sees = ~np.isnan(rays).any(axis=-1)
    off = np.hypot(*(other.project(rays[sees])[0] - pixels[sees]).T)
    off = off[np.isfinite(off)]
    return float(off.max()) if off.size else float("inf")


def _field(message: Any, name: str) -> Any:
    """Return a field that ROS 1 writes large and ROS 2 small."""
    return getattr(message, name, None) if hasattr(message, name) else getattr(message, name.upper())


_ODOMETRY = "nav_msgs/msg/Odometry"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MOVED_M = 0.1
_TURNED_DEG = 2.0
"""Error of odometry on a robot that stands; a person at 5 m is then off by less than the width of a body."""
_MOST_STEPS = 100  # from a frame to the root: a tree with a circle in it has none


@dataclass
class _Displacement:
    """Largest translation and rotation from a first pose."""

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


def motion_warnings(bag: Bag, frames: Mapping[str, Iterable[str]]) -> list[str]:
    """Return one warning per cause that moves sensors; `frames`: the frame_ids of each sensor's messages.

    A transform moves a sensor if it lies between the sensor's frame and the root of the tree. A robot's odometry, or pose,
    moves those sensors that stand on it, and all where no transform tells what stands on what.
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


def _said(what: str, motion: _Displacement) -> str:
    return f"by {what} it turned by up to {motion.turned_deg:.0f}° and went up to {motion.moved_m:.2f} m"


def _read(
    bag: Bag,
) -> tuple[dict[str, tuple[str, _Displacement]], dict[tuple[str, str, str], _Displacement], dict[str, str]]:
    """Return motion by topic of poses with the moving frame, motion by transform, and the parent of each frame."""
    poses: dict[str, tuple[str, _Displacement]] = {}
    edges: dict[tuple[str, str, str], _Displacement] = {}
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
                    motion = edges.setdefault((topic, parent, child), _Displacement())
                    motion.add(each.transform.translation, each.transform.rotation)
        else:
            child = getattr(message, "child_frame_id", "").strip("/")
            _, motion = poses.setdefault(topic, (child, _Displacement()))
            motion.add(message.pose.pose.position, message.pose.pose.orientation)
    return poses, edges, parents


def first_transforms(bag: Bag) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Return the parent of each frame, and the transform (4, 4) of its points to the parent's, by its first message."""
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
    """Return the frames and all their ancestors."""
    found: set[str] = set()
    for frame in frames:
        here: str | None = frame.strip("/")
        for _ in range(_MOST_STEPS):
            if here is None or here in found:
                break
            found.add(here)
            here = parents.get(here)
    return found
