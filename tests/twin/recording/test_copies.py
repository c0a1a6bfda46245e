"""Bags in which messages come twice, as through a second relay or recorder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from benchmarks.bag_drill import EPOCH_NS
from recorded import MS, RIG as PICTURES, an_image, scan_messages, write_ros2_bag
from rosbags.typesys.stores.ros2_humble import tf2_msgs__msg__TFMessage as TFMessage

from trackers.area import Pose
from trackers.observations import Observation
from trackers.rig import LaserSensor, OdometrySensor, Rig
from twin.export.pictures import open_recorded, pictures
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import COMPRESSED_IMAGE, LASER_SCAN, encode, time_message
from twin.recording.writer import TF_MESSAGE, transform_message

STAMPS = [EPOCH_NS + k * 100 * MS for k in range(60)]
RIG = Rig(sensors={name: LaserSensor(topic=f"/{name}", role="waist") for name in ("one", "two")})
ROBOT = Rig(
    sensors={
        "one": LaserSensor(topic="/one", mounted_on="base"),
        "base": OdometrySensor(topic="/tf", frame="odom", base_frame="base"),
    }
)


def a_bag(folder: Path, messages: list[Any], copied: list[Any]) -> Path:
    write_ros2_bag(folder / "bag", sorted([*messages, *copied], key=lambda each: each[2]))
    return folder / "bag"


def later(messages: list[Any], by_ms: int) -> list[Any]:
    return [(topic, kind, log_ns + by_ms * MS, data) for topic, kind, log_ns, data in messages]


def said_of(recording: Recording, sensor: str, n: int, total: int, by_s: str) -> str:
    return f"{sensor}: {n} of {total} messages came again with the stamp and the content of an earlier one, {by_s} s after it"


@pytest.mark.parametrize("by_ms", [0, 5, 100, 250, 1000, 5000, 20000])
@pytest.mark.parametrize("which", [("one", "two"), ("one",)])
def test_copies_of_scans_are_told_and_left_out(tmp_path: Path, by_ms: int, which: tuple[str, ...]) -> None:
    scans = {name: scan_messages(f"/{name}", STAMPS) for name in ("one", "two")}
    copied = [each for name in which for each in later(scans[name], by_ms)]
    once = Recording(a_bag(tmp_path / "once", [*scans["one"], *scans["two"]], []), RIG)
    recording = Recording(a_bag(tmp_path / "twice", [*scans["one"], *scans["two"]], copied), RIG)

    def key(each: Observation) -> tuple[str, int]:
        return each.sensor, each.stamp_ns

    assert [key(each) for each in recording.observations()] == [key(each) for each in once.observations()]
    said = lines(recording.losses)
    of_copies = [said_of(recording, name, 60, 120, f"{by_ms / 1000:.3g}") for name in which]
    assert [line for line in said if "came again" in line] == [
        line for line in said if any(line.startswith(each) for each in of_copies)
    ]
    assert sum("came again" in line for line in said) == len(which)
    silent = [line for line in said if "came again" not in line]
    assert silent == [] or (which == ("one",) and by_ms >= 1000 and all("two: " in line for line in silent)), said


def restamped(messages: list[Any], by_ms: int, ranges_of: Any = lambda k, own: own) -> list[Any]:
    """Return scans with their stamps later, and other ranges if asked."""
    found = []
    for k, (topic, kind, log_ns, data) in enumerate(messages):
        message: Any = TYPESTORE.deserialize_cdr(cast("memoryview", data), LASER_SCAN)
        stamp = time_message(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec + by_ms * MS)
        header = replace(message.header, stamp=stamp)
        found.append((topic, kind, log_ns, replace(message, header=header, ranges=ranges_of(k, message.ranges))))
    return found


def noisy(k: int, own: Any) -> Any:
    return (own + np.random.default_rng(k).normal(0, 0.01, own.size)).astype(np.float32)


@pytest.mark.parametrize("by_ms", [50, 100, 150, 250])
@pytest.mark.parametrize("is_late", [False, True])
def test_copies_under_other_stamps_are_told_and_left_out(tmp_path: Path, by_ms: int, is_late: bool) -> None:
    scans = restamped(scan_messages("/one", STAMPS), 0, noisy)
    copied = later(restamped(scan_messages("/one", STAMPS), by_ms, noisy), by_ms * is_late)
    rig = Rig(sensors={"one": RIG.sensors["one"]})
    once = [each.stamp_ns for each in Recording(a_bag(tmp_path / "once", scans, []), rig).observations()]
    recording = Recording(a_bag(tmp_path / "twice", scans, copied), rig)
    assert [each.stamp_ns for each in recording.observations()] == once and recording.counts == {"one": 60}
    (line,) = lines(recording.losses)
    assert line.startswith(f"one: 60 of 120 messages repeat an earlier one under a stamp {by_ms / 1000:.3g} s later")


@pytest.mark.parametrize(
    "ranges_of",
    [
        lambda k, own: noisy(0, own),  # a still room without noise
        lambda k, own: noisy(k // 6, own),  # a scanner that hangs now and then
        lambda k, own: own * np.float32(np.nan) if k % 3 == 1 else noisy(k, own),  # empty scans
    ],
)
def test_scans_that_come_again_by_themselves_are_no_copies(tmp_path: Path, ranges_of: Any) -> None:
    messages = restamped(scan_messages("/one", STAMPS), 0, ranges_of)
    recording = Recording(a_bag(tmp_path, messages, []), Rig(sensors={"one": RIG.sensors["one"]}))
    assert len(list(recording.observations())) == 60
    assert not any("repeat an earlier one" in line for line in lines(recording.losses))


def test_equal_scans_without_stamps_are_no_copies(tmp_path: Path) -> None:
    messages = []
    for topic, kind, log_ns, data in scan_messages("/one", STAMPS):
        message: Any = TYPESTORE.deserialize_cdr(cast("memoryview", data), LASER_SCAN)
        header = replace(message.header, stamp=time_message(0))
        messages.append((topic, kind, log_ns, replace(message, header=header, ranges=np.ones(31, np.float32))))
    recording = Recording(a_bag(tmp_path, messages, []), Rig(sensors={"one": RIG.sensors["one"]}))
    assert len(list(recording.observations())) == 60
    assert not any("came again" in line for line in lines(recording.losses))


def test_copies_of_transforms_are_told_and_left_out(tmp_path: Path) -> None:
    moved = []
    for k, stamp_ns in enumerate(STAMPS):
        pose = Pose(xyz=(0.05 * k, 0.0, 0.0)).matrix
        message = TFMessage([transform_message("base", pose, parent="odom", stamp_ns=stamp_ns)])
        moved.append(("/tf", TF_MESSAGE, stamp_ns + 5 * MS, message))
    scans = scan_messages("/one", STAMPS)
    recording = Recording(a_bag(tmp_path, [*scans, *moved], later(moved, 250)), ROBOT)
    assert recording.counts == {"one": 60, "base": 60}
    assert [each.stamp_ns for each in recording.observations() if each.sensor == "base"] == [
        k * 100 * MS for k in range(60)
    ]
    (line,) = lines(recording.losses)
    assert line.startswith(said_of(recording, "base", 60, 120, "0.25"))


def test_copies_of_pictures_are_not_exported(tmp_path: Path) -> None:
    stamps = STAMPS[:20]
    shown = [encode(an_image(ns)) for ns in stamps]
    messages = [
        ("/camera/image/compressed", COMPRESSED_IMAGE, ns + 5 * MS, e.data) for ns, e in zip(stamps, shown, strict=True)
    ]
    rig = Rig(sensors={"camera": PICTURES.sensors["camera"]})
    path = tmp_path / "rig.yaml"
    path.write_text(rig.dump_yaml())
    recorded = open_recorded(a_bag(tmp_path, messages, later(messages, 250)), path, lambda warning: None)
    assert [(each.number, each.stamp_ns) for each in pictures(recorded, ["camera"])] == [
        (k + 1, k * 100 * MS) for k in range(20)
    ]
