"""What of a bag does not reach a tracker is counted, and told with the sensor's name."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin
from typing import Any

import numpy as np
import pytest
from benchmarks.bag_drill import EPOCH_NS, Content, Logged, clean_recording, write
from recorded import MS, a_scan, scan_messages, write_ros2_bag
from rosbags.typesys.stores.ros2_humble import (
    geometry_msgs__msg__Point as Point,
    geometry_msgs__msg__Pose as RosPose,
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    geometry_msgs__msg__Quaternion as Quaternion,
    geometry_msgs__msg__Transform as Transform,
    geometry_msgs__msg__TransformStamped as TransformStamped,
    geometry_msgs__msg__Twist as Twist,
    geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    geometry_msgs__msg__Vector3 as Vector3,
    nav_msgs__msg__Odometry as Odometry,
    std_msgs__msg__Header as Header,
    tf2_msgs__msg__TFMessage as TFMessage,
)

from trackers.errors import InputError
from trackers.observations import DepthImage, Image, LaserScan
from trackers.rig import LaserSensor, Rig
from twin.recording.bags.bag import open_bag
from twin.recording.losses import ObservationLog, crowded, lines, missing
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import LASER_SCAN, encode, time_message
from twin.recording.track_topics import START
from twin.run.replay import track_recording

STAMPS = [EPOCH_NS + k * 100 * MS for k in range(60)]
RIG = Rig(sensors={"waist": LaserSensor(topic="/high", role="waist"), "knee": LaserSensor(topic="/low", role="knee")})
ODOMETRY, TF = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"


def turned(angle: float) -> Quaternion:
    return Quaternion(0.0, 0.0, sin(angle / 2), cos(angle / 2))


def odometry(stamp_ns: int, x: float, angle: float) -> tuple[str, str, int, Odometry]:
    still = TwistWithCovariance(Twist(Vector3(0, 0, 0), Vector3(0, 0, 0)), np.zeros(36))
    pose = PoseWithCovariance(RosPose(Point(x, 0.0, 0.0), turned(angle)), np.zeros(36))
    return "/odom", ODOMETRY, stamp_ns, Odometry(Header(time_message(stamp_ns), "odom"), "base_link", pose, still)


def transform(
    stamp_ns: int, parent: str, child: str, angle: float, topic: str = "/tf"
) -> tuple[str, str, int, TFMessage]:
    place = Transform(Vector3(0.1, 0.0, 0.0), turned(angle))
    return topic, TF, stamp_ns, TFMessage([TransformStamped(Header(time_message(stamp_ns), parent), child, place)])


def of_waist_and_knee(change):
    """Scans of both, those of the waist scanner as `change` has them by number (None: none)."""
    messages = []
    for k, stamp_ns in enumerate(STAMPS):
        scan: Any = TYPESTORE.deserialize_cdr(encode(a_scan(stamp_ns)).data, LASER_SCAN)
        messages.append(("/low", LASER_SCAN, stamp_ns, scan))
        if (changed := change(k, scan)) is not None:
            messages.append(("/high", LASER_SCAN, stamp_ns, changed))
    return messages


@pytest.mark.parametrize("n_bad", [1, 10, 29, 31, 60])
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"angle_increment": np.inf}, "angle_increment is inf"),
        ({"ranges": np.zeros(0, np.float32)}, "has no ranges"),
        ({"range_max": 0.01}, "range_max 0.01 m"),
    ],
)
def test_messages_that_cannot_be_used_are_left_out_and_told_and_most_of_them_are_refused(tmp_path, n_bad, fault, said):
    bad = set(np.random.default_rng(n_bad).choice(60, n_bad, replace=False).tolist())
    write_ros2_bag(tmp_path / "bag", of_waist_and_knee(lambda k, scan: replace(scan, **fault) if k in bad else scan))
    recording = Recording(tmp_path / "bag", RIG)
    if n_bad > 30:
        with pytest.raises(InputError, match=f"bag: topic /high: .*{said}"):
            list(recording.observations())
        return
    assert sum(each.sensor == "waist" for each in recording.observations()) == 60 - n_bad
    (line,) = lines(recording.losses)
    assert line.startswith(f"waist: {n_bad} of 60 messages cannot be used and were left out, the first at ")
    assert said in line
    list(recording.observations())
    assert lines(recording.losses) == [line], "counted anew each time"


def test_bytes_that_are_no_message_are_left_out_and_told(tmp_path):
    messages = scan_messages("/high", STAMPS)
    messages[7] = (*messages[7][:3], memoryview(bytes(messages[7][3])[:60]))
    write_ros2_bag(tmp_path / "bag", messages)
    recording = Recording(tmp_path / "bag", Rig(sensors={"waist": RIG.sensors["waist"]}))
    assert len(list(recording.observations())) == 59
    (line,) = lines(recording.losses)
    assert line.startswith("waist: 1 of 60 messages cannot be used") and "bytes that are no sensor_msgs" in line


def test_a_sensor_that_stops_and_one_without_a_message_are_named(tmp_path):
    write_ros2_bag(tmp_path / "stops", of_waist_and_knee(lambda k, scan: scan if k < 40 else None))
    (line,) = lines(Recording(tmp_path / "stops", RIG).losses)
    assert line.startswith("waist: 19 of 59 messages are missing") and "silent for up to 2 s, from 3.90 s on" in line
    write_ros2_bag(tmp_path / "none", of_waist_and_knee(lambda k, scan: None))
    (line,) = lines(Recording(tmp_path / "none", RIG).losses)
    assert line.startswith("waist: no message on /high (the bag has no such topic)")
    several = {name: LaserSensor(topic=f"/{name}") for name in ("high", "left", "right")}
    (line,) = lines(Recording(tmp_path / "none", Rig(sensors={"knee": RIG.sensors["knee"], **several})).losses)
    assert line.startswith("high, left, right: no message on /high, /left, /right (the bag has no such topic)")
    alone = Recording(tmp_path / "none", Rig(sensors={"knee": RIG.sensors["knee"]}))
    assert lines(alone.losses) == []


@pytest.mark.parametrize("lost", [2, 10, 24])
@pytest.mark.parametrize("rate_hz", [5, 7.5, 40])
def test_messages_that_are_missing_are_counted_by_the_rhythm_of_the_rest(lost, rate_hz):
    rng = np.random.default_rng(lost)
    stamps = np.rint((np.arange(60) + rng.uniform(-0.05, 0.05, 60)) / rate_hz * 1e9).astype(np.int64)
    kept = np.delete(stamps, 1 + rng.choice(58, lost, replace=False))
    loss = missing("waist", kept, int(stamps[0]), int(stamps[-1]))
    assert loss is not None and (loss.count, loss.total) == (lost, 60)
    assert missing("waist", stamps, int(stamps[0]), int(stamps[-1])) is None


@pytest.mark.parametrize("n", [2, 3])
def test_messages_in_bursts_are_not_taken_to_lack_those_between(n: int) -> None:
    stamps = (np.arange(60)[:, None] * 10**8 + np.arange(n) * 10**6).ravel()
    assert missing("waist", stamps, 0, int(stamps[-1])) is None


@pytest.mark.parametrize("n", [150, 1500])
@pytest.mark.parametrize("lost", [0.1, 0.3, 0.5, 0.6])
def test_messages_lost_at_random_are_counted_and_not_taken_for_two_streams(n: int, lost: float) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        stamps = np.rint((np.arange(n) + rng.normal(0, 0.03, n)) * 1e8).astype(np.int64)
        kept = rng.random(n) >= lost
        found = missing("scan", stamps[kept], int(stamps[0]), int(stamps[-1]))
        assert found is not None and found.count == pytest.approx(n - kept.sum(), abs=0.1 * n)
        assert crowded("scan", stamps[kept]) is None


@pytest.mark.parametrize("pattern", [(3, 3, 1), (2, 2, 1), (1, 2), (1, 1, 8), (1, 5, 2)])
def test_gaps_that_repeat_themselves_are_a_rhythm_without_losses(pattern: tuple[int, ...]) -> None:
    stamps = np.cumsum(np.tile(pattern, 60)) * 10**7
    assert missing("scan", stamps, int(stamps[0]), int(stamps[-1])) is None


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_two_streams_over_one_another_are_told_of_any_length(share: float) -> None:
    stamps = np.arange(300) * 10**8
    second = stamps[int(300 * (1 - share)) :] + 2 * 10**7
    found = crowded("scan", np.concatenate([stamps, second]))
    assert found is not None and found.count == pytest.approx(2 * second.size, abs=3)


def test_scans_that_see_less_than_usual_are_told():
    heard = ObservationLog()
    for k, stamp_ns in enumerate(STAMPS):
        ranges = np.full(100, np.nan if k in (4, 5, 6) else 2.0, np.float32)
        heard.add(LaserScan("waist", stamp_ns, ranges, 0.0, 0.01, 0.1, 10.0))
    (line,) = lines(heard.blind())
    assert line.startswith("waist: 3 of 60 messages have returns in less than half of the 100 beams")


@pytest.mark.parametrize("shown", ["nothing", "one pixel", "noise", "the noise of a covered lens"])
@pytest.mark.parametrize("n", [1, 2, 30, 60])
def test_pictures_of_nothing_are_told(shown, n):
    heard, rng = ObservationLog(), np.random.default_rng(n)
    for k, stamp_ns in enumerate(STAMPS):
        rgb, depth_m = np.full((48, 64, 3), (3, 5, 7), np.uint8), np.zeros((48, 64), np.float32)
        if k >= n or shown == "one pixel":
            place = rng.integers(0, 48, 2)
            rgb[*place], depth_m[*place] = 200, 2.0
        elif shown == "the noise of a covered lens":
            rgb = rgb + rng.integers(0, 12, rgb.shape, dtype=np.uint8)
        elif shown == "noise":
            rgb, depth_m = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8), rng.random((48, 64)).astype(np.float32)
        heard.add(Image("camera", stamp_ns, rgb))
        heard.add(DepthImage("stereo", stamp_ns, rgb, depth_m))
    told = ["camera", "stereo", "stereo"] * (
        shown.endswith(("nothing", "lens")) and n > 1
    )  # one of 60 is less than 2 %
    found = lines(heard.blind())
    assert [line.partition(":")[0] for line in found] == told
    assert all(f"{n} of 60 messages " in line for line in found)


MOVES = {
    "odometry turns": [odometry(each, 0.0, 0.05 * k) for k, each in enumerate(STAMPS)],
    "odometry goes": [odometry(each, 0.02 * k, 0.0) for k, each in enumerate(STAMPS)],
    "transform": [
        transform(STAMPS[0], "base_link", "waist", 0.0, "/tf_static"),
        *(transform(each, "odom", "base_link", 0.05 * k) for k, each in enumerate(STAMPS)),
    ],
}
STANDS = {
    "odometry that is noisy": [odometry(each, 0.001 * (k % 3), 0.001 * (k % 5)) for k, each in enumerate(STAMPS)],
    "a wheel turns": [
        transform(STAMPS[0], "base_link", "waist", 0.0, "/tf_static"),
        *(transform(each, "base_link", "wheel", 0.3 * k) for k, each in enumerate(STAMPS)),
    ],
    "another robot": [
        transform(STAMPS[0], "map", "waist", 0.0, "/tf_static"),
        *(odometry(each, 0.1 * k, 0.0) for k, each in enumerate(STAMPS)),
    ],
}


@pytest.mark.parametrize("name", [*MOVES, *STANDS])
def test_a_sensor_that_moves_is_told(tmp_path, name):
    messages = (MOVES | STANDS)[name]
    write_ros2_bag(tmp_path / "bag", sorted([*scan_messages("/scan", STAMPS), *messages], key=lambda each: each[2]))
    told = Recording(tmp_path / "bag", Rig(sensors={"scan": LaserSensor(topic="/scan")})).moving
    assert [line.startswith("scan moves: by /") for line in told] == [True] * (name in MOVES)


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_a_copy_of_a_robots_bag_holds_tracks_where_the_scans_are(tmp_path, suffix):
    clean = clean_recording()
    content = Content([replace(each) for each in clean.messages[:100]], suffix)
    if suffix == ".mcap":
        content.messages += [Logged(*transform(EPOCH_NS, "base_link", "waist", 0.5, "/tf_static"))]
    source, copy, rig = tmp_path / f"robot{suffix}", tmp_path / "copy.mcap", tmp_path / "rig.yaml"
    write(content, source)
    rig.write_text(clean.rig.dump_yaml())
    track_recording(
        source, trackers=["sort"], rig_path=rig, out=tmp_path / "out", video=False, report=False, bag_copy=copy
    )
    one, other = Recording(source, rig), Recording(copy, rig)
    for scan, again in zip(one.observations(), other.observations(), strict=True):
        assert (scan.sensor, scan.stamp_ns) == (again.sensor, again.stamp_ns)
        assert isinstance(scan, LaserScan) and isinstance(again, LaserScan)
        assert scan.ranges_m.tobytes() == again.ranges_m.tobytes()
    with open_bag(copy) as bag:
        (start,) = [message.data for _, _, message in bag.messages([START])]
        frames = [each for _, _, message in bag.messages(["/tf_static"]) for each in message.transforms]
        markers = [message for _, _, message in bag.messages(["/tracks/sort/markers"])]
    assert start == f'{{"start_stamp_ns": {one.start_ns}}}'
    assert len(markers) > 40
    below = {each.child_frame_id: each for each in frames if each.header.frame_id == "room"}
    assert set(below) == ({"waist", "knee"} if suffix == ".bag" else {"base_link", "knee"})
    assert below["knee"].transform.translation.z == pytest.approx(clean.rig.sensors["knee"].room_from_sensor.xyz[2])
    if suffix == ".mcap":  # waist stands 0.1 m before base_link, turned by half a radian
        turn = clean.rig.sensors["waist"].room_from_sensor.rpy[2] - 0.5
        place = below["base_link"].transform
        assert 2 * np.arctan2(place.rotation.z, place.rotation.w) == pytest.approx(turn)
        there = np.array(clean.rig.sensors["waist"].room_from_sensor.xyz[:2]) - 0.1 * np.array([cos(turn), sin(turn)])
        assert (place.translation.x, place.translation.y) == pytest.approx(tuple(there))


def test_scans_that_the_rig_does_not_use_are_named(tmp_path):
    messages = [*scan_messages("/scan", STAMPS), *scan_messages("/other", STAMPS)]
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))
    recording = Recording(tmp_path / "bag", Rig(sensors={"low": LaserSensor(topic="/scan")}))
    assert lines(recording.losses) == ["the rig: does not use /other of the bag"]


@pytest.mark.parametrize(("n", "n_other", "is_told"), [(1, 60, True), (2, 60, True), (3, 3, False), (2, 20, False)])
def test_a_topic_of_too_few_messages_for_a_rhythm_is_told(tmp_path, n, n_other, is_told) -> None:
    messages = [*scan_messages("/high", STAMPS[:n]), *scan_messages("/low", STAMPS[:n_other])]
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))
    told = lines(Recording(tmp_path / "bag", RIG).losses)
    assert any(f"waist: has {n} message" in each for each in told) == is_told
