"""A rig against its bag: lenses from CameraInfo, also for rigs without; poses and motion from frames, odometry, transforms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations
from typing import Any

import numpy as np
from pydantic import ValidationError

from trackers.area import displacement
from trackers.arrays import Array
from trackers.cameras import FisheyeIntrinsics, Intrinsics, PinholeIntrinsics
from trackers.errors import InputError
from trackers.rig import CameraSensor, Pose, Rig, normal_topic
from twin.recording.bags.bag import Bag
from twin.recording.losses import Loss
from twin.recording.rig_of_bag.transforms import Poses, PoseTopic, TransformTree
from twin.recording.sensor_clock import topic_of_frame

_TYPE = "sensor_msgs/msg/CameraInfo"
_TRANSPORTS = ("compressed", "compressedDepth")
_PINHOLE, _FISHEYE = ("plumb_bob", "rational_polynomial", ""), ("equidistant", "fisheye")
_UNCALIBRATED = "is that of a camera that was never calibrated (its matrix is zero)"
_OFF = 0.01
"""Places that differ by more than this share of the picture's width are reported: at 5 m in a view of 60°, 6 cm."""
_GRID = 9


def compare_lenses(bag: Bag, rig: Rig, sensors: Mapping[str, str]) -> list[Loss]:
    """Return what the bag's CameraInfo contradicts in the rig; `sensors`: the sensor of each topic.

    The first message that holds a lens is taken (see `_infos`). Nothing is said of a camera without one.
    """
    cameras = {
        topic: sensor for topic, name in sensors.items() if isinstance(sensor := rig.sensors[name], CameraSensor)
    }
    losses = []
    for topic, message in _infos(bag, cameras).items():
        what, remedy = _contradiction(message, cameras[topic].intrinsics, is_rectified=_is_rectified(topic))
        if what:
            losses.append(Loss(sensors[topic], 0, 0, f"{_info_topic(topic)} {what}", remedy, always=True))
    return losses


def _infos(bag: Bag, topics: Iterable[str], *, by_frame: bool = False) -> dict[str, Any]:
    """Return the CameraInfo of each of these topics of images that has one: the first with a lens (a driver may publish zeros
    before), else the first. by_frame: one of the images' frame stands in for one in their namespace.
    """
    waiting: dict[str, list[str]] = {}
    owned = {_info_topic(name) for name, each in bag.topics.items() if "Image" in each.msgtype}
    for topic in topics:
        info = _info_topic(topic)
        info = topic_of_frame(bag, topic, _TYPE, owned) if by_frame and info not in bag.topics else info
        if info in bag.topics and bag.topics[info].msgtype == _TYPE:
            waiting.setdefault(info, []).append(topic)
    found: dict[str, Any] = {}
    for info, _, message in bag.messages(list(waiting)):
        for topic in list(waiting[info]):
            is_known = _projection(message, is_rectified=_is_rectified(topic))[0] is not None
            if is_known or topic not in found:
                found[topic] = message
            if is_known:
                waiting[info].remove(topic)
        if not any(waiting.values()):
            break
    return found


def _is_rectified(topic: str) -> bool:
    """Return True for a topic whose pictures are rectified, by its name."""
    return any("rect" in part for part in topic.split("/"))


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
    matrix, (width, height) = _projection(message, is_rectified=is_rectified)
    if matrix is None:
        return _UNCALIBRATED, stays
    bins, region = np.maximum([message.binning_x, message.binning_y], 1), message.roi
    if (width, height) != (lens.width, lens.height):
        how = ["binned"] * bool(bins.max() > 1) + ["a region of interest"] * bool(region.width)
        said = f"is for pictures of {width} x {height}" + f" ({', '.join(how)})" * bool(how)
        remedy = "intrinsics at the size of the pictures are expected"
        return f"{said}, the rig's intrinsics for {lens.width} x {lens.height}", remedy
    try:
        content = _lens_content(message, matrix, (width, height), is_rectified=is_rectified)
        own = None if content is None else _lens(content, lens)
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


def _projection(message: Any, *, is_rectified: bool) -> tuple[Array | None, tuple[int, int]]:
    """Return the camera matrix (3, 3) of the pictures and their size [px]; no matrix for a camera never calibrated."""
    matrix = np.array(_field(message, "p" if is_rectified else "k"), dtype=float).reshape(3, -1)[:, :3]
    bins, region = np.maximum([message.binning_x, message.binning_y], 1), message.roi
    width, height = (np.array([region.width or message.width, region.height or message.height]) // bins).tolist()
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        return None, (width, height)
    matrix[:2] = (matrix[:2] - [[0, 0, region.x_offset], [0, 0, region.y_offset]]) / bins[:, None]
    return matrix, (width, height)


def _lens_content(message: Any, matrix: Array, size: tuple[int, int], *, is_rectified: bool) -> dict[str, Any] | None:
    """Return a CameraInfo's lens as the plain content of a rig's intrinsics; None for a model that is not supported."""
    (fx, _, cx), (_, fy, cy) = matrix[:2].tolist()
    model = "plumb_bob" if is_rectified else message.distortion_model
    given = [] if is_rectified else [float(each) for each in _field(message, "d")]
    common = {"width": size[0], "height": size[1], "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    if model in _PINHOLE:
        return common | {"distortion": given}
    if model in _FISHEYE:
        return common | {"k": (given + [0.0] * 4)[:4]}
    return None


def _lens(content: Mapping[str, Any], lens: Intrinsics) -> Intrinsics:
    """Return the lens of a CameraInfo; a fisheye's field of view is that of the other lens, as no message has it."""
    if "k" not in content:
        return PinholeIntrinsics.model_validate(content)
    field_rad = lens.field_of_view_rad if isinstance(lens, FisheyeIntrinsics) else np.pi
    return FisheyeIntrinsics.model_validate({**content, "field_of_view_rad": field_rad})


def kind_of_lens(bag: Bag, topic: str) -> str:
    """Return the kind of camera that the CameraInfo beside a topic of images tells: camera, fisheye, or '' for none."""
    message, is_rectified = _infos(bag, [topic], by_frame=True).get(topic), _is_rectified(topic)
    if message is None or _projection(message, is_rectified=is_rectified)[0] is None:
        return ""
    model = "" if is_rectified else message.distortion_model
    return "fisheye" if model in _FISHEYE else "camera" if model in _PINHOLE else ""


def with_intrinsics(bag: Bag, content: Any) -> Any:
    """Return the content of a `rig.yaml`, in which cameras without intrinsics have those of the bag's CameraInfo.

    The field of view of a fisheye, which no CameraInfo has, is taken for 180°. Raises InputError for a camera without either,
    and for a CameraInfo that is of no use.
    """
    sensors = content.get("sensors") if isinstance(content, dict) else None
    if not isinstance(sensors, dict):
        return content
    lacking = {
        name: normal_topic(each["topic"])
        for name, each in sensors.items()
        if isinstance(each, dict)
        and each.get("kind") in ("camera", "fisheye", "stereo")
        and each.get("intrinsics") is None
        and isinstance(each.get("topic"), str)
    }
    infos = _infos(bag, lacking.values(), by_frame=True)
    filled = dict(sensors)
    for name, topic in lacking.items():
        found = _intrinsics_of(infos.get(topic), _info_topic(topic), name, sensors[name])
        filled[name] = sensors[name] | {"intrinsics": found}
    return content | {"sensors": filled}


def _intrinsics_of(message: Any, info: str, name: str, sensor: Mapping[str, Any]) -> dict[str, Any]:
    """Return the intrinsics that a CameraInfo tells of a camera; raises InputError where it tells none."""
    field = f"sensors.{name}.intrinsics is missing"
    if message is None:
        raise InputError(f"{field}, and the bag has no {_TYPE} on {info}; either is expected")
    is_rectified = _is_rectified(sensor["topic"])
    matrix, size = _projection(message, is_rectified=is_rectified)
    if matrix is None:
        raise InputError(f"{field}, and {info} {_UNCALIBRATED}; intrinsics are expected")
    found = _lens_content(message, matrix, size, is_rectified=is_rectified)
    is_fisheye = sensor["kind"] == "fisheye"
    if found is None or ("k" in found) != is_fisheye:
        valid = _FISHEYE if is_fisheye else _PINHOLE[:2]
        raise InputError(
            f"{field}, and {info} has a lens of the model {message.distortion_model!r}; for kind {sensor['kind']} "
            f"{' or '.join(valid)} is expected"
        )
    return found | {"field_of_view_rad": np.pi} if is_fisheye else found


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


_APART_M = 0.15
"""A pose that puts people this far from where the bag's transforms do is reported: HOTA falls by .1, MOTA from .3 m on."""
_FAR_M, _LEAST_TURN_DEG = 5.0, 1.0
"""Distance of people from a scanner without an area, and the turn that is never reported."""
_ON_THE_FLOOR = ("map", "world", "room", "base_footprint")
"""Names of frames whose origin is on the floor (REP 105, REP 120)."""
_CHECK = "the rig is taken as it is; check topic and room_from_sensor in rig.yaml and the driver's frame_id"


def compare_poses(
    rig: Rig, tree: TransformTree, poses: Mapping[str, PoseTopic], frames: Mapping[str, Iterable[str]]
) -> list[Loss]:
    """Return what the bag contradicts in the rig by transforms, poses of bases, and `frames`, the frame_ids of each sensor.

    Scanners, and the base that carries them, are compared with all on the same base, or that stand, as transforms need not
    know the rig's room; else heights with a frame on the floor, or names. Nothing is said twice of a sensor.
    """
    bases, lasers, carried = rig.odometry(), rig.lasers(), rig.mounted()
    own = {name: next(iter(each)) for name, each in frames.items() if len(set(each)) == 1 and name not in bases}
    children = {topic: each.child for topic, each in poses.items()}
    own = {name: each.base_frame or children.get(normal_topic(each.topic), "") for name, each in bases.items()} | own
    frame_of = {name: frame.strip("/") for name, frame in own.items() if frame}
    placed = {name: np.eye(4) if name in bases else rig.sensors[name].room_from_sensor.matrix for name in frame_of}
    names = sorted(placed, key=lambda name: (name not in bases, name not in lasers))
    found: dict[str, tuple[str, str]] = {}
    for first, name in combinations(names, 2):
        least_deg = _turn_deg(rig, name) if name in lasers else np.inf  # the frame of a camera may be that of its body
        pose = tree.standing_pose(frame_of[name], frame_of[first])
        is_apart = carried.get(first, first if first in bases else None) != carried.get(name)
        if pose is None or is_apart or first not in (*bases, *lasers) or {first, name} & found.keys():
            continue
        if said := _differ(placed[first], placed[name], pose, least_deg):
            is_one = frame_of[name] == frame_of[first]
            one = f"messages of both are of frame {frame_of[name]!r}, which would hide exchanged topics"
            by_bag = one if is_one else f"transforms {said[1]} {first}"
            is_swapped = not is_one and _differ(placed[name], placed[first], pose, least_deg) is None
            guess = f": those of {first} and {name} seem to be exchanged" * is_swapped
            words = f"the rig has it {said[0]} {first}, and in the bag {by_bag}", _CHECK + guess
            found |= {first: ("", ""), name: words}
    for name in [each for each in names if each not in (*bases, *found)]:
        tops = [each for each in sorted(tree.ancestors([frame_of[name]])) if each.split("/")[-1] in _ON_THE_FLOOR]
        pose = tree.standing_pose(frame_of[name], tops[0]) if tops and name not in carried else None
        bare, own_m = frame_of[name].split("/")[-1].removesuffix("_link"), placed[name][2, 3]
        if pose is not None and abs(own_m - pose[2, 3]) > _APART_M:
            by_bag = f"transforms {pose[2, 3]:.2f} m above {tops[0]!r}"
            found[name] = f"the rig has it {own_m:.2f} m above the floor, and in the bag {by_bag}", _CHECK
        elif bare not in (name, *found) and frame_of.get(bare, frame_of[name]) != frame_of[name]:
            what = f"its messages are of the frame {frame_of[name]!r}, and those of {bare} of {frame_of[bare]!r}"
            found[name] = what, "the rig is taken as it is; their topics in it may be exchanged"
    return [Loss(name, 0, 0, *words, always=True) for name, words in found.items() if words[0]]


def _turn_deg(rig: Rig, name: str) -> float:
    """Return the turn of a scanner that moves people by `_APART_M`, at the mean distance of the area's corners [degrees]."""
    sensor, corners = rig.sensors[name], np.array(rig.area or [], dtype=float).reshape(-1, 2)
    from_it = np.hypot(*(corners - sensor.room_from_sensor.xyz[:2]).T) if name not in rig.mounted() else corners[:0]
    return max(np.degrees(_APART_M / (from_it.mean() if from_it.size else _FAR_M)), _LEAST_TURN_DEG)


def _differ(pose: Array, other: Array, said: Array, least_deg: float) -> tuple[str, str] | None:
    """Return the rig's and the bag's (`said`, (4, 4)) words for another pose seen from a pose; None where they agree."""
    own = np.linalg.inv(pose) @ other
    here, there = (pose[:3, :3] @ each[:3, 3] for each in (own, said))
    if abs(here[2] - there[2]) > _APART_M:
        first, second = (f"{abs(z):.2f} m {'above' if z > 0 else 'below'}" for z in (here[2], there[2]))
    elif np.linalg.norm(here - there) > _APART_M:
        first, second = (f"[{x:.2f}, {y:.2f}, {z:.2f}] m from" for x, y, z in (here, there))
    elif displacement(np.stack([own, said]))[1] > least_deg:
        rolled = (np.degrees(Pose.from_transform(each).rpy) for each in (own, said))
        first, second = (f"turned by roll {x:.3g}°, pitch {y:.3g}°, yaw {z:.3g}° to" for x, y, z in rolled)
    else:
        return None
    return first, second


def motion_warnings(
    tree: TransformTree, poses: Mapping[str, PoseTopic], frames: Mapping[str, Iterable[str]]
) -> list[str]:
    """Return one warning per cause that moves sensors; `frames`: the frame_ids of each sensor's messages.

    A transform moves a sensor if it lies between the sensor's frame and the root of the tree. A robot's odometry, or pose,
    moves those sensors that stand on it, and those of which no transform tells. A tree that does not tell on
    what a sensor stands, for a gap or a circle, while something in it moves, is a cause, too.
    """
    chains = {name: tree.ancestors(own) for name, own in frames.items()}
    moved: dict[tuple[str, str], list[str]] = {}
    for topic, each in poses.items():
        for name, chain in chains.items():
            if each.moves and (each.child in chain or tree.may_carry(each.child, chain)):
                verb = "moves if it is on it" if each.is_of_anything and each.child not in chain else "moves"
                moved.setdefault((verb, _said(topic, each.poses)), []).append(name)
    for child, edge in tree.edges.items():
        on_it = [name for name, chain in chains.items() if child in chain]
        if on_it and edge.moves:
            said = _said(f"{edge.topic} ({edge.parent} to {child})", edge.parent_from_child)
            moved.setdefault(("moves", said), []).extend(on_it)
    unmoved = {name: own for name, own in frames.items() if not any(name in each for each in moved.values())}
    return [*_circles(tree, frames), *_untold(tree, unmoved)] + [
        f"{', '.join(names)} {verb}: {said}; tracks are in the sensor's own moving frame, in which things that stand look like "
        "people. A rig.yaml with odometry (`kind: odometry`), on which the sensor is `mounted_on`, is expected"
        for (verb, said), names in moved.items()
    ]


def _circles(tree: TransformTree, frames: Mapping[str, Iterable[str]]) -> Iterator[str]:
    """Yield a warning for each sensor above which transforms go in a circle."""
    for name, own in frames.items():
        try:
            for frame in own:
                tree.chain(frame)
        except InputError as error:
            yield f"{name} may move: {error}; it is taken to stand"


def _untold(tree: TransformTree, frames: Mapping[str, Iterable[str]]) -> Iterator[str]:
    """Yield a warning for each sensor that may move, since between it and what moves the tree has a gap."""
    moving = [edge for edge in tree.edges.values() if edge.moves]
    with_them = tree.ancestors(edge.child for edge in moving)
    bases = ", ".join(f"{edge.child} (in {edge.parent})" for edge in moving[:5])
    for name, own in frames.items():
        if moving and not tree.ancestors(own) & with_them:
            frame = ", ".join(map(repr, sorted(own)))
            yield (
                f"{name} may move: no transforms lead from its frame {frame} to {bases}, which moves; it is taken to stand. "
                "A bag with the whole of /tf_static, or a rig.yaml in which it is `mounted_on` odometry, is expected"
            )


def _said(what: str, poses: Poses) -> str:
    moved_m, turned_deg = displacement(poses)
    return f"by {what} it turned by up to {turned_deg:.0f}° and went up to {moved_m:.2f} m"
