"""Observations as ROS 2 messages and back.

A tracker gets, live, what a replay would give it: `encode` returns the observation as its message carries it (float32 angles
and limits, the decoded JPEG) with the message's bytes, and `decode` of those bytes gives the same to the bit.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import quaternion_of, rotation_of
from trackers.errors import InputError
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry
from trackers.rig import CameraSensor, FloorSensor, RigSensor
from twin.recording.ros import topics
from twin.recording.ros.colour_images import decode_compressed, decode_raw, raw_pixels
from twin.recording.ros.depth_images import PNG_FORMAT, encode_png
from twin.recording.ros.message_types import (
    TYPESTORE,
    CompressedImage,
    Header,
    Image as RawImageMessage,
    LaserScan as LaserScanMessage,
    Odometry as OdometryMessage,
    Point,
    Pose as PoseMessage,
    PoseWithCovariance,
    Quaternion,
    Time,
    Twist,
    TwistWithCovariance,
    Vector3,
)

LASER_SCAN = "sensor_msgs/msg/LaserScan"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
RAW_IMAGE = "sensor_msgs/msg/Image"
ODOMETRY = "nav_msgs/msg/Odometry"
STRING = "std_msgs/msg/String"

PICTURES = (COMPRESSED_IMAGE, RAW_IMAGE)
MSGTYPES = {
    "laser": (LASER_SCAN,),
    "fisheye": PICTURES,
    "camera": PICTURES,
    "stereo": PICTURES,
    "floor": (RAW_IMAGE,),
    "odometry": (ODOMETRY,),
}
"""Types of the messages of a sensor, by its kind on the rig, the twin's own first."""

_FLOOR_ENCODINGS = ("mono8", "8UC1")
_FARTHEST_M = 500.0
"""Range of no scanner: half of a scan beyond it says another unit."""
_NO_INTENSITIES = np.zeros(0, dtype=np.float32)
_JSON = json.JSONEncoder(allow_nan=False)
_LITTLE_ENDIAN_CDR = b"\0\1\0\0"


@dataclass(frozen=True, eq=False, slots=True)
class ExtraMessage:
    """A further message (CDR) of one observation."""

    msgtype: str
    topic_suffix: str
    data: memoryview


@dataclass(frozen=True, eq=False, slots=True)
class Encoded:
    """An observation's message (CDR), and the observation as a replay of the message gives it.

    `more`: further messages of the same observation: a DepthImage's depth, its colour being the first.
    """

    observation: Observation
    msgtype: str
    topic_suffix: str
    data: memoryview
    more: tuple[ExtraMessage, ...] = ()


def encode(observation: Observation, *, jpeg_quality: int = 90) -> Encoded:
    """Encode an observation as a message; give trackers `.observation` of the result, never the one that went in.

    Ranges are brought to REP 117 (`LaserScan`); images go through JPEG of this quality (1–100); a floor's frame is an Image in
    mono8, one pixel per element, the first row first; a depth image is a colour JPEG and a 16-bit PNG of millimetres. The
    frame_id is the sensor's name, the header's stamp the observation's. Raises ValueError for arrays of another type or shape.
    """
    match observation:
        case LaserScan():
            return _encode_scan(observation)
        case FloorFrame():
            return _encode_floor(observation)
        case Image():
            return _encode_image(observation, jpeg_quality)
        case DepthImage():
            return _encode_depth_image(observation, jpeg_quality)
        case Odometry():
            return _encode_odometry(observation)


def from_message(message: Any, sensor: str, *, kind: str | None = None, offset_ns: int = 0) -> Observation:
    """Convert a ROS 1 or ROS 2 message to an observation: LaserScan, CompressedImage, Image, or Odometry.

    An Image's encoding is one of `twin.recording.ros.colour_images.CHANNELS`.

    `kind` is that of the sensor on the rig: an Image of a 'floor' is a FloorFrame, of any other an Image. `offset_ns` is added
    to the header's stamp. Ranges at or beyond range_max become +inf, those below range_min or not above 0 become NaN (REP
    117). Raises InputError for a message that cannot be used.
    """
    stamp_ns = stamp_of(message) + offset_ns
    if kind == "floor":
        return _floor(message, sensor, stamp_ns)
    if message.__msgtype__ == ODOMETRY:
        pose = message.pose.pose
        return Odometry(sensor, stamp_ns, matrix_of(pose.position, pose.orientation))
    if message.__msgtype__ == LASER_SCAN:
        scan = _scan(
            sensor,
            stamp_ns,
            np.array(message.ranges, dtype=np.float32),
            message.angle_min,
            message.angle_increment,
            message.range_min,
            message.range_max,
            message.time_increment,
        )
        returned_m = scan.ranges_m[np.isfinite(scan.ranges_m)]
        if returned_m.size and (middle_m := float(np.median(returned_m))) > _FARTHEST_M:
            raise InputError(
                f"scan of {sensor!r}: the median range is {middle_m:g} m; ranges and limits in m are expected"
            )
        return scan
    if message.__msgtype__ == COMPRESSED_IMAGE:
        return Image(sensor, stamp_ns, decode_compressed(message, f"image of {sensor!r}"))
    if message.__msgtype__ == RAW_IMAGE:
        return Image(sensor, stamp_ns, decode_raw(message, f"image of {sensor!r}"))
    raise InputError(
        f"message of {sensor!r}: type is {message.__msgtype__}; "
        f"{LASER_SCAN}, {COMPRESSED_IMAGE}, {RAW_IMAGE} or {ODOMETRY} is expected"
    )


def stamp_of(message: Any) -> int:
    """Return the stamp in a message's header [ns]."""
    stamp = message.header.stamp
    return stamp.sec * NS_PER_S + stamp.nanosec


def check_fits(name: str, sensor: RigSensor, observation: Observation | None) -> None:
    """Raise InputError for an observation of another size than the rig says."""
    if isinstance(observation, LaserScan) and not observation.ranges_m.size:
        raise InputError(f"scan of {name!r}: has no ranges; one for each beam is expected")
    if isinstance(observation, Image | DepthImage) and isinstance(sensor, CameraSensor):
        height, width, _ = observation.rgb.shape
        lens = sensor.intrinsics
        if (width, height) != (lens.width, lens.height):
            raise InputError(
                f"image is {width} x {height}; sensors.{name}.intrinsics, of the rig or else from the bag's CameraInfo, "
                f"say {lens.width} x {lens.height}, the size of the images is expected there"
            )
    if isinstance(observation, FloorFrame) and isinstance(sensor, FloorSensor):
        rows, columns = observation.values.shape
        if (rows, columns) != (sensor.rows, sensor.columns):
            raise InputError(
                f"frame is {rows} rows x {columns} columns; sensors.{name} of the rig says "
                f"{sensor.rows} x {sensor.columns}, the size of the frames is expected there"
            )


def time_message(stamp_ns: int) -> Time:
    """Convert a stamp to ROS's Time: whole seconds, and nanoseconds (never negative)."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return Time(seconds, nanoseconds)


def matrix_of(place: Any, turn: Any) -> NDArray[np.float64]:
    """Return the transform (4, 4) of a message's point or vector and quaternion, of which only the direction counts.

    NaN throughout where the quaternion is zero or not finite.
    """
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=float)
    matrix = np.eye(4)
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0):
        return np.full((4, 4), np.nan)
    matrix[:3, :3] = rotation_of((quaternion / length).tolist())
    matrix[:3, 3] = place.x, place.y, place.z
    return matrix


def string_message(content: object) -> memoryview:
    """Encode JSON as a `std_msgs/String` (CDR); raises ValueError for a number that is not finite."""
    return _text_message(_JSON.encode(content))


def rows_message(rows: Iterable[str]) -> memoryview:
    """Encode the rows of a table (`json_object`) as a `std_msgs/String` (CDR): a JSON list."""
    return _text_message(f"[{', '.join(rows)}]")


def json_object(columns: tuple[str, ...], stamp_ns: int, cells: list[str]) -> str:
    """Return a row of cells after t as a JSON object, null for an empty cell; words have their quotes."""
    filled = [each or "null" for each in cells] if "" in cells else cells
    return _json_object(columns) % (float.__repr__(stamp_ns / NS_PER_S), *filled)


@lru_cache(maxsize=256)
def _json_object(columns: tuple[str, ...]) -> str:
    """Return an object with these names as a format of its values."""
    return "{" + ", ".join(json.dumps(name).replace("%", "%%") + ": %s" for name in columns) + "}"


def _text_message(text: str) -> memoryview:
    encoded = text.encode()
    return memoryview(struct.pack("<4sI", _LITTLE_ENDIAN_CDR, len(encoded) + 1) + encoded + b"\0")


def _scan(
    sensor: str,
    stamp_ns: int,
    ranges_m: NDArray[np.float32],  # its own copy
    angle_min_rad: float,
    angle_increment_rad: float,
    range_min_m: float,
    range_max_m: float,
    time_increment_s: float,
) -> LaserScan:
    ranges_m[(ranges_m < range_min_m) | (ranges_m <= 0)] = np.nan
    ranges_m[ranges_m >= range_max_m] = np.inf
    sweep_time_s = time_increment_s * max(ranges_m.size - 1, 0)
    return LaserScan(
        sensor, stamp_ns, ranges_m, angle_min_rad, angle_increment_rad, range_min_m, range_max_m, sweep_time_s
    )


def _encode_scan(scan: LaserScan) -> Encoded:
    gaps = scan.ranges_m.size - 1
    if gaps <= 0 < scan.sweep_time_s:
        raise ValueError(f"scan of {scan.sensor!r}: {gaps + 1} beam(s) cannot take {scan.sweep_time_s} s to sweep")
    time_increment_s = _float32(scan.sweep_time_s / gaps) if gaps > 0 else 0.0
    observation = _scan(
        scan.sensor,
        scan.stamp_ns,
        np.array(scan.ranges_m, dtype=np.float32),
        _float32(scan.angle_min_rad),
        _float32(scan.angle_increment_rad),
        _float32(scan.range_min_m),
        _float32(scan.range_max_m),
        time_increment_s,
    )
    message = LaserScanMessage(
        header=Header(time_message(scan.stamp_ns), scan.sensor),
        angle_min=observation.angle_min_rad,
        angle_max=observation.angle_min_rad + max(gaps, 0) * observation.angle_increment_rad,
        angle_increment=observation.angle_increment_rad,
        time_increment=time_increment_s,
        scan_time=0.0,  # the period is the schedule's affair, 0 is ROS's "not known"
        range_min=observation.range_min_m,
        range_max=observation.range_max_m,
        ranges=observation.ranges_m,
        intensities=_NO_INTENSITIES,
    )
    return Encoded(observation, LASER_SCAN, topics.SCAN, TYPESTORE.serialize_cdr(message, LASER_SCAN))


def _float32(value: float) -> float:
    return float(np.float32(value))


def _encode_image(image: Image, jpeg_quality: int) -> Encoded:
    if image.rgb.dtype != np.uint8 or image.rgb.ndim != 3 or image.rgb.shape[2] != 3:
        raise ValueError(f"image of {image.sensor!r}: {image.rgb.dtype} {image.rgb.shape}; uint8 (h, w, 3) is needed")
    bgr = cv2.cvtColor(image.rgb, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    message = CompressedImage(
        header=Header(time_message(image.stamp_ns), image.sensor),
        format="rgb8; jpeg compressed bgr8",  # as image_transport writes it
        data=jpeg.ravel(),
    )
    observation = Image(image.sensor, image.stamp_ns, decode_compressed(message, f"image of {image.sensor!r}"))
    return Encoded(observation, COMPRESSED_IMAGE, topics.IMAGE, TYPESTORE.serialize_cdr(message, COMPRESSED_IMAGE))


def _encode_depth_image(image: DepthImage, jpeg_quality: int) -> Encoded:
    colour = _encode_image(Image(image.sensor, image.stamp_ns, image.rgb), jpeg_quality)
    assert isinstance(colour.observation, Image)
    png, depth_m = encode_png(image.depth_m)
    message = CompressedImage(header=Header(time_message(image.stamp_ns), image.sensor), format=PNG_FORMAT, data=png)
    depth = ExtraMessage(COMPRESSED_IMAGE, topics.DEPTH, TYPESTORE.serialize_cdr(message, COMPRESSED_IMAGE))
    observation = DepthImage(image.sensor, image.stamp_ns, colour.observation.rgb, depth_m)
    return Encoded(observation, colour.msgtype, colour.topic_suffix, colour.data, (depth,))


def _encode_floor(frame: FloorFrame) -> Encoded:
    if frame.values.dtype != np.uint8:
        raise ValueError(f"floor {frame.sensor!r}: {frame.values.dtype} values; uint8 is needed")
    rows, columns = frame.values.shape
    # A copy: the sensor may reuse its array.
    observation = FloorFrame(frame.sensor, frame.stamp_ns, np.array(frame.values, order="C"))
    message = RawImageMessage(
        header=Header(time_message(frame.stamp_ns), frame.sensor),
        height=rows,
        width=columns,
        encoding="mono8",
        is_bigendian=0,
        step=columns,
        data=observation.values.ravel(),
    )
    return Encoded(observation, RAW_IMAGE, topics.FLOOR, TYPESTORE.serialize_cdr(message, RAW_IMAGE))


def _encode_odometry(odometry: Odometry) -> Encoded:
    """Encode a pose; covariances and velocities stay 0, ROS's "not known"."""
    matrix = odometry.frame_from_base
    x, y, z, w = quaternion_of(matrix[:3, :3])
    place = Point(*(float(each) for each in matrix[:3, 3]))
    nothing = Vector3(0.0, 0.0, 0.0)
    message = OdometryMessage(
        header=Header(time_message(odometry.stamp_ns), topics.odometry_frame(odometry.sensor)),
        child_frame_id=odometry.sensor,
        pose=PoseWithCovariance(PoseMessage(place, Quaternion(x, y, z, w)), np.zeros(36)),
        twist=TwistWithCovariance(Twist(nothing, nothing), np.zeros(36)),
    )
    observation = Odometry(
        odometry.sensor, odometry.stamp_ns, matrix_of(message.pose.pose.position, message.pose.pose.orientation)
    )
    return Encoded(observation, ODOMETRY, topics.ODOMETRY, TYPESTORE.serialize_cdr(message, ODOMETRY))


def _floor(message: Any, sensor: str, stamp_ns: int) -> FloorFrame:
    if message.__msgtype__ != RAW_IMAGE:
        raise InputError(f"message of floor {sensor!r}: type is {message.__msgtype__}; {RAW_IMAGE} is expected")
    if message.encoding not in _FLOOR_ENCODINGS:
        valid = " or ".join(_FLOOR_ENCODINGS)
        raise InputError(f"image of floor {sensor!r}: encoding is {message.encoding!r}; {valid} is expected")
    return FloorFrame(
        sensor, stamp_ns, np.ascontiguousarray(raw_pixels(message, f"image of {sensor!r}", message.height)[:, :, 0])
    )
