"""A floor's frames survive their messages and bags to the bit, the twin's and a robot's."""

from __future__ import annotations

import numpy as np
import pytest
from decoded import decode
from recorded import MS, a_scan, assert_same, write_ros2_bag
from rosbags.highlevel import AnyReader
from rosbags.typesys.stores.ros2_humble import sensor_msgs__msg__Image as RawImage, std_msgs__msg__Header as Header

from trackers.errors import InputError
from trackers.observations import FloorFrame, ForceCurve, Image
from trackers.rig import FloorSensor, LaserSensor, Pose, Rig
from twin.recording.reader import Recording
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import RAW_IMAGE, encode, from_message, time_message
from twin.recording.writer import BagWriter
from twin.sensors.floor_electronics import LoadFrame

RIG = Rig(
    sensors={
        "floor": FloorSensor(
            topic="/floor/floor", rows=3, columns=5, pitch_m=0.2, room_from_sensor=Pose(xyz=(-1.0, 0.5, 0.0))
        ),
        "waist": LaserSensor(topic="/waist/scan", role="waist"),
    }
)


def a_frame(stamp_ns: int) -> FloorFrame:
    values = np.random.default_rng(abs(stamp_ns)).integers(0, 256, (3, 5), dtype=np.uint8)
    return FloorFrame("floor", stamp_ns, values)


def test_a_frame_is_handed_on_as_a_replay_gives_it():
    encoded = encode(a_frame(3_000_000_005))
    assert encoded.topic_suffix == "floor"
    assert_same(encoded.observation, decode(encoded.data, encoded.msgtype, "floor", kind="floor"))
    assert_same(encoded.observation, a_frame(3_000_000_005))
    assert bytes(encode(encoded.observation).data) == bytes(encoded.data)


def test_what_the_twin_knows_does_not_travel():
    load_n = np.full((3, 5), 100.0)
    curve = ForceCurve()
    encoded = encode(LoadFrame("floor", 7, curve.values(load_n), load_n, curve))
    assert type(encoded.observation) is FloorFrame
    assert_same(encoded.observation, decode(encoded.data, encoded.msgtype, "floor", kind="floor"))


def test_what_is_handed_on_does_not_change_with_the_sensors_array():
    frame = a_frame(1)
    encoded = encode(frame)
    before = frame.values.copy()
    frame.values[:] = 0
    assert isinstance(encoded.observation, FloorFrame)
    np.testing.assert_array_equal(encoded.observation.values, before)


def test_the_message_as_ros_reads_it():
    message = TYPESTORE.deserialize_cdr(encode(a_frame(3_000_000_005)).data, RAW_IMAGE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (3, 5, "floor")
    assert (message.height, message.width, message.step, message.encoding) == (3, 5, 5, "mono8")
    np.testing.assert_array_equal(message.data.reshape(3, 5), a_frame(3_000_000_005).values)


def test_the_kind_on_the_rig_decides():
    message = RawImage(Header(time_message(7), ""), 2, 3, "mono8", 0, 4, np.arange(8, dtype=np.uint8))
    frame = from_message(message, "floor", kind="floor", offset_ns=-2)
    assert isinstance(frame, FloorFrame) and frame.stamp_ns == 5
    np.testing.assert_array_equal(frame.values, [[0, 1, 2], [4, 5, 6]])
    assert isinstance(from_message(message, "eye", kind="fisheye"), Image)
    assert isinstance(from_message(message, "eye"), Image)


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (RawImage(Header(time_message(0), ""), 2, 2, "rgb8", 0, 6, np.zeros(12, np.uint8)), "'rgb8'; mono8 or 8UC1"),
        (RawImage(Header(time_message(0), ""), 2, 2, "mono8", 0, 1, np.zeros(2, np.uint8)), "height x step bytes"),
        (
            TYPESTORE.deserialize_cdr(encode(a_scan(0)).data, "sensor_msgs/msg/LaserScan"),
            "LaserScan; .*Image is expected",
        ),
    ],
)
def test_messages_that_cannot_be_used(message, complaint):
    with pytest.raises(InputError, match=complaint):
        from_message(message, "floor", kind="floor")


def test_encode_refuses_what_is_no_frame():
    with pytest.raises(ValueError, match="uint8 is needed"):
        encode(FloorFrame("floor", 0, np.zeros((2, 2))))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="rows and columns are expected"):
        FloorFrame("floor", 0, np.zeros(4, dtype=np.uint8))


def test_a_twins_bag(tmp_path):
    path = tmp_path / "recording.mcap"
    with BagWriter(path, RIG) as writer:
        for k in range(3):
            writer.background(encode(a_frame(k)))
        writer.background(encode(a_scan(0)))
        for stamp in range(0, 500 * MS, 100 * MS):
            writer.observation(encode(a_scan(stamp)), stamp)
            writer.observation(encode(a_frame(stamp)), stamp + 5 * MS)
    with AnyReader([path]) as reader:
        found = {connection.topic: (connection.msgtype, connection.msgcount) for connection in reader.connections}
    assert found["/floor/floor"] == (RAW_IMAGE, 5)
    assert found["/floor/background/floor"] == (RAW_IMAGE, 3)
    recording = Recording(path)
    assert recording.rig == RIG
    frames = [each for each in recording.observations() if each.sensor == "floor"]
    for got, stamp in zip(frames, range(0, 500 * MS, 100 * MS), strict=True):
        assert_same(got, a_frame(stamp))
    empty = [each for each in recording.background if each.sensor == "floor"]
    for got, stamp in zip(empty, range(3), strict=True):
        assert_same(got, a_frame(stamp))


def robot_bag(path, encoding: str = "mono8") -> None:
    raw = RawImage(Header(time_message(10**18), "mat"), 3, 5, encoding, 0, 5, a_frame(4).values.ravel())
    write_ros2_bag(path, [("/mat", RAW_IMAGE, 10**18, raw)])


def test_a_robots_bag_and_a_rig_yaml(tmp_path):
    robot_bag(tmp_path / "bag")
    (tmp_path / "rig.yaml").write_text(
        "sensors:\n  mat: {kind: floor, topic: /mat, rows: 3, columns: 5, pitch_m: 0.1, curve: {exponent: 1},\n"
        "        room_from_sensor: {xyz: [1, 2, 0], rpy: [0, 0, 0.5]}}\n"
    )
    recording = Recording(tmp_path / "bag", tmp_path / "rig.yaml")
    (frame,) = recording.observations()
    assert_same(frame, FloorFrame("mat", 0, a_frame(4).values))


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [(4, r"topic /mat: frame is 3 rows x 5 columns; sensors\.mat of the rig says 4 x 5")],
)
def test_a_rig_with_another_grid(tmp_path, rows, complaint):
    robot_bag(tmp_path / "bag")
    rig = Rig(sensors={"mat": FloorSensor(topic="/mat", rows=rows, columns=5, pitch_m=0.1)})
    with pytest.raises(InputError, match=complaint):
        list(Recording(tmp_path / "bag", rig).observations())


def test_a_floors_topic_that_holds_something_else(tmp_path):
    encoded = encode(a_scan(0))
    write_ros2_bag(tmp_path / "bag", [("/mat", encoded.msgtype, 0, encoded.data)])
    rig = Rig(sensors={"mat": FloorSensor(topic="/mat", rows=3, columns=5, pitch_m=0.1)})
    with pytest.raises(
        InputError, match="which is sensor_msgs/msg/LaserScan .* expected is a topic of sensor_msgs/msg/Image"
    ):
        Recording(tmp_path / "bag", rig)
