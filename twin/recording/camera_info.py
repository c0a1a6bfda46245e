"""What a bag says of its cameras' lenses (CameraInfo), held against the rig, which is what trackers go by."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from trackers.arrays import Array
from trackers.cameras import FisheyeIntrinsics, Intrinsics, PinholeIntrinsics
from trackers.rig import CameraSensor, Rig
from twin.recording.bag import Bag
from twin.recording.losses import Loss

_TYPE = "sensor_msgs/msg/CameraInfo"
_TRANSPORTS = ("compressed", "compressedDepth")
_PINHOLE, _FISHEYE = ("plumb_bob", "rational_polynomial", ""), ("equidistant", "fisheye")
_OFF = 0.01
"""Places that differ by more than this share of the picture's width are told: at 5 m in a view of 60°, 6 cm."""
_GRID = 9


def lenses_held_against(bag: Bag, rig: Rig, sensors: Mapping[str, str]) -> list[Loss]:
    """Return what the bag's CameraInfo contradicts in the rig; `sensors`: the sensor of each topic.

    The first message of a camera's topic is taken: lenses seldom change. Nothing is said of a camera without one.
    """
    cameras = {
        topic: sensor for topic, name in sensors.items() if isinstance(sensor := rig.sensors[name], CameraSensor)
    }
    told = {
        info: topic for topic in cameras if (info := _beside(topic)) in bag.topics and bag.topics[info].msgtype == _TYPE
    }
    losses = []
    for info, _, message in bag.messages(list(told)):
        topic = told.pop(info, None)
        if topic is None:
            continue
        is_rectified = any("rect" in part for part in topic.split("/"))
        what, remedy = _contradiction(message, cameras[topic].intrinsics, is_rectified=is_rectified)
        if what:
            losses.append(Loss(sensors[topic], 0, 0, f"{info} {what}", remedy, always=True))
        if not told:
            break
    return losses


def _beside(topic: str) -> str:
    """Return the CameraInfo topic of a topic of pictures: beside it, whatever transport the pictures take."""
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
