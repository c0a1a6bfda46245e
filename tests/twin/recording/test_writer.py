"""The bag that a run writes: whole or not there, and what the contract says is in it."""

from __future__ import annotations

import resource
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from recorded import MS, RIG, a_scan, a_truth, an_image
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from scipy.spatial.transform import Rotation

from trackers.errors import InputError
from twin.recording.ros.ros_messages import encode
from twin.recording.tables import FrameText
from twin.recording.writer import BagWriter


def write(path: Path, frames: int = 3) -> None:
    with BagWriter(path, RIG, scenario_yaml="name: lab\n", names={1: "ada"}) as writer:
        writer.background(encode(a_scan(0)))
        writer.background(encode(an_image(0)))
        for stamp in range(0, frames * 100 * MS, 100 * MS):
            writer.truth(FrameText(a_truth(stamp)))
            writer.observation(encode(a_scan(stamp)), stamp + 5 * MS)
            writer.observation(encode(an_image(stamp)), stamp + 40 * MS)


def messages(path: Path) -> dict[str, list]:
    """By topic: (log time, message), read by rosbags through the definitions that the bag carries."""
    found: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, log_time_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((log_time_ns, reader.deserialize(data, connection.msgtype)))
    return found


def test_topics_types_and_log_times(tmp_path):
    path = tmp_path / "out" / "recording.mcap"
    write(path)
    with AnyReader([path]) as reader:
        assert {(c.topic, c.msgtype, c.msgcount) for c in reader.connections} == {
            ("/rig", "std_msgs/msg/String", 1),
            ("/scenario", "std_msgs/msg/String", 1),
            ("/tf_static", "tf2_msgs/msg/TFMessage", 1),
            ("/waist/scan", "sensor_msgs/msg/LaserScan", 3),
            ("/waist/background/scan", "sensor_msgs/msg/LaserScan", 1),
            ("/camera/image/compressed", "sensor_msgs/msg/CompressedImage", 3),
            ("/camera/background/image/compressed", "sensor_msgs/msg/CompressedImage", 1),
            ("/camera/camera_info", "sensor_msgs/msg/CameraInfo", 3),
            ("/truth/people", "std_msgs/msg/String", 3),
            ("/truth/feet", "std_msgs/msg/String", 3),
            ("/truth/markers", "visualization_msgs/msg/MarkerArray", 3),
            ("/truth/boxes", "std_msgs/msg/String", 0),
            ("/truth/rays", "std_msgs/msg/String", 0),
            ("/truth/situations", "std_msgs/msg/String", 0),
        }
        latched = {
            c.topic
            for c in reader.connections
            if c.ext.offered_qos_profiles  # type: ignore[union-attr]
            and c.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL  # type: ignore[union-attr]
        }
        assert latched == {
            "/rig",
            "/scenario",
            "/tf_static",
            "/waist/background/scan",
            "/camera/background/image/compressed",
        }
    found = messages(path)
    assert [time for time, _ in found["/waist/scan"]] == [5 * MS, 105 * MS, 205 * MS]
    assert [message.header.stamp.nanosec for _, message in found["/waist/scan"]] == [0, 100 * MS, 200 * MS]
    assert [time for time, _ in found["/truth/people"]] == [0, 100 * MS, 200 * MS]
    assert found["/rig"][0][1].data == RIG.dump_yaml()
    assert found["/scenario"][0][1].data == "name: lab\n"


def test_places_and_lens(tmp_path):
    write(tmp_path / "recording.mcap")
    found = messages(tmp_path / "recording.mcap")
    (_, tf_static), *_ = found["/tf_static"]
    assert [(t.header.frame_id, t.child_frame_id) for t in tf_static.transforms] == [
        ("room", "waist"),
        ("room", "camera"),
    ]
    for transform, sensor in zip(tf_static.transforms, RIG.sensors.values(), strict=True):
        place, turn = transform.transform.translation, transform.transform.rotation
        assert (place.x, place.y, place.z) == sensor.room_from_sensor.xyz
        rotation = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        np.testing.assert_allclose(rotation, sensor.room_from_sensor.rotation, atol=1e-12)
    for (info_time, info), (image_time, image) in zip(
        found["/camera/camera_info"], found["/camera/image/compressed"], strict=True
    ):
        assert (info_time, info.header.stamp) == (image_time, image.header.stamp)
        assert info.header.frame_id == image.header.frame_id == "camera"
        assert (info.width, info.height, info.distortion_model) == (48, 32, "equidistant")
        np.testing.assert_array_equal(info.d, (0.1, 0.02, 0.0, -0.001))
        np.testing.assert_array_equal(info.k.reshape(3, 3), [[14.5, 0, 23.5], [0, 14, 15.5], [0, 0, 1]])
        np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))


def test_the_same_run_gives_the_same_bytes(tmp_path):
    write(tmp_path / "a" / "recording.mcap")
    write(tmp_path / "b" / "recording.mcap")
    assert (tmp_path / "a" / "recording.mcap").read_bytes() == (tmp_path / "b" / "recording.mcap").read_bytes()


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_exception_leaves_nothing(tmp_path, error):
    path = tmp_path / "recording.mcap"

    def interrupted_run() -> None:
        with BagWriter(path, RIG) as writer:
            writer.observation(encode(a_scan(0)), 0)
            raise error

    with pytest.raises(error):
        interrupted_run()
    assert list(tmp_path.iterdir()) == []
    path.write_text("an older recording")
    with pytest.raises(error):
        interrupted_run()
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "an older recording"


def test_an_older_recording_is_replaced_when_the_new_one_is_whole(tmp_path):
    path = tmp_path / "recording.mcap"
    path.write_text("an older recording")
    with BagWriter(path, RIG) as writer:
        writer.observation(encode(a_scan(0)), 0)
        assert path.read_text() == "an older recording"
    assert list(tmp_path.iterdir()) == [path]
    assert len(messages(path)["/waist/scan"]) == 1


@pytest.fixture
def small_files():
    """No file grows beyond 1.5 MB: writing fails as on a full disk, after some chunks have gone well."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("small_files")
@pytest.mark.parametrize("count", [100_000, 8_000])  # fails while writing; fails in the last chunk
def test_a_full_disk(tmp_path, count):
    path = tmp_path / "recording.mcap"
    encoded = encode(a_scan(0))

    def run() -> None:
        with BagWriter(path, RIG) as writer:
            for _ in range(count):
                writer.observation(encoded, 0)

    with pytest.raises(InputError, match=r"recording\.mcap: cannot be written \(File too large\)"):
        run()
    assert list(tmp_path.iterdir()) == []


def test_unwritable_places(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.mcap").mkdir()
    for path in (tmp_path / "file" / "recording.mcap", tmp_path / "folder.mcap", Path("/proc/recording.mcap")):
        with pytest.raises(InputError, match=f"^{path}: "), BagWriter(path, RIG):
            pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.mcap"]


def test_memory_does_not_grow_with_the_recording(tmp_path):
    encoded = encode(a_scan(0))
    tracemalloc.start()
    with BagWriter(tmp_path / "recording.mcap", RIG) as writer:
        for _ in range(30_000):
            writer.observation(encoded, 0)
        _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (tmp_path / "recording.mcap").stat().st_size > 6e6
    assert peak < 4e6


def test_order_of_arrival_is_needed(tmp_path):
    with BagWriter(tmp_path / "recording.mcap", RIG) as writer:
        writer.observation(encode(a_scan(100)), 200)
        with pytest.raises(ValueError, match="order of arrival"):
            writer.observation(encode(a_scan(50)), 199)


def test_mistakes_of_the_caller(tmp_path):
    with pytest.raises(ValueError, match=r"ends with \.mcap"):
        BagWriter(tmp_path / "recording.bag", RIG)
