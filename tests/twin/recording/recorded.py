"""What the recording tests record: a rig, a scan, an image, a truth frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from trackers.cameras import FisheyeIntrinsics
from trackers.observations import Image, LaserScan, Observation
from trackers.rig import FisheyeSensor, LaserSensor, Pose, Rig
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import encode
from twin.truth.truth_types import PersonTruth, TruthFrame

MS = 1_000_000

RIG = Rig(
    sensors={
        "waist": LaserSensor(
            topic="/waist/scan", role="waist", room_from_sensor=Pose(xyz=(0.1, 0.0, 0.95), rpy=(0.0, 0.0, np.pi / 2))
        ),
        "camera": FisheyeSensor(
            topic="/camera/image/compressed",
            room_from_sensor=Pose(xyz=(0.0, 0.0, 1.1), rpy=(-np.pi / 2, 0.0, 0.0)),
            intrinsics=FisheyeIntrinsics(
                width=48,
                height=32,
                fx=14.5,
                fy=14.0,
                cx=23.5,
                cy=15.5,
                k=(0.1, 0.02, 0.0, -0.001),
                field_of_view_rad=3.2,
            ),
        ),
    },
    area=((-2.0, 0.6), (2.0, 0.6), (2.0, 2.8)),
)


def a_scan(stamp_ns: int, sensor: str = "waist", seed: int = 0) -> LaserScan:
    """A scan whose numbers are no float32 and which has each kind of reading."""
    ranges = np.random.default_rng((seed, stamp_ns)).uniform(0.1, 5.0, 31).astype(np.float32)
    ranges[[3, 4]] = np.inf, np.nan
    return LaserScan(sensor, stamp_ns, ranges, -np.pi / 2, np.pi / 30, 0.02, 5.6, 0.025)


def an_image(stamp_ns: int, sensor: str = "camera") -> Image:
    """An image with an orange corner, so that red and blue cannot be mistaken, and some noise below."""
    rgb = np.full((32, 48, 3), 90, dtype=np.uint8)
    rgb[:16, :24] = 250, 120, 10
    rgb[16:] += np.random.default_rng(abs(stamp_ns)).integers(0, 30, (16, 48, 3), dtype=np.uint8)
    return Image(sensor, stamp_ns, rgb)


def a_truth(stamp_ns: int, ids: tuple[int, ...] = (1, 2)) -> TruthFrame:
    """People in a row."""
    return TruthFrame(
        stamp_ns,
        tuple(
            PersonTruth(id_, 0.1 * id_, 1 / 3, 0.9, 0.3, 0.2 * id_, 0.4, 1.6, 0.5, -0.1, 0.7, id_ != 2, {"waist": 0.5})
            for id_ in ids
        ),
    )


def assert_same(one: Observation, other: Observation) -> None:
    """Equal to the bit, types of the numbers included."""
    assert type(one) is type(other)
    for name, value in vars(one).items():
        another = getattr(other, name)
        assert type(value) is type(another)
        if isinstance(value, np.ndarray):
            assert (value.dtype, value.shape) == (another.dtype, another.shape)
            assert value.tobytes() == another.tobytes()
        else:
            assert value == another


def write_ros2_bag(
    path: Path,
    messages: list[tuple[str, str, int, object]],
    storage: StoragePlugin = StoragePlugin.SQLITE3,
) -> None:
    """A robot's bag folder, by rosbags alone, of (topic, type, log time [ns], message or serialized message)."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = {}
        for topic, msgtype, log_time_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=TYPESTORE)
            data = message if isinstance(message, memoryview) else TYPESTORE.serialize_cdr(message, msgtype)
            writer.write(connections[topic], log_time_ns, data)


def scan_messages(topic: str, stamps_ns: list[int]) -> list[tuple[str, str, int, object]]:
    """Scans for `write_ros2_bag`, logged 5 ms after their stamps."""
    encoded = [encode(a_scan(stamp)) for stamp in stamps_ns]
    return [(topic, e.msgtype, e.observation.stamp_ns + 5 * MS, e.data) for e in encoded]
