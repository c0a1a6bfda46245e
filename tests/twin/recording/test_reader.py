"""Recordings come back as they went in, a robot's as a tracker needs them; bad ones are refused in one sentence."""

from __future__ import annotations

import gzip
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import MS, RIG, a_scan, a_truth, an_image, assert_same, scan_messages, write_ros2_bag
from rosbags import rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys.stores.ros2_humble import (
    sensor_msgs__msg__Image as RawImage,
    std_msgs__msg__Header as Header,
    std_msgs__msg__String as String,
)

from trackers.cameras import FisheyeIntrinsics
from trackers.errors import InputError
from trackers.observations import Image, LaserScan
from trackers.rig import FisheyeSensor, LaserSensor, Rig
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.rig_of_bag.rig_guess import describe_rig
from twin.recording.ros.message_types import typestore
from twin.recording.ros.ros_messages import RAW_IMAGE, STRING, encode, time_message
from twin.recording.tables import FrameText
from twin.recording.writer import BagWriter
from twin.truth.truth_types import TruthFrame

REAL_BAG = Path(__file__).parents[3].parent / "shared/data/lasers/demo_stationary_simple_environment.bag"
EPOCH_NS = 1_700_000_000_000_000_123
needs_real_bag = pytest.mark.skipif(not REAL_BAG.exists(), reason=f"the robot's bag {REAL_BAG.name} is not there")


@pytest.fixture(scope="module")
def twin_bag(tmp_path_factory) -> Path:
    """A twin's bag of several chunks: 700 scans and images, each image late and arriving with the next scan."""
    path = tmp_path_factory.mktemp("twin") / "recording.mcap"
    with BagWriter(path, RIG, scenario_yaml="name: lab\n") as writer:
        for k in range(2):
            writer.background(encode(an_image(k)))
            writer.background(encode(a_scan(k)))
        for observation, arrival_ns in twin_run():
            writer.observation(encode(observation), arrival_ns)
            if isinstance(observation, LaserScan):
                writer.truth(FrameText(a_truth(observation.stamp_ns, (1, 2) if observation.stamp_ns else ())))
    assert path.stat().st_size > 1.5 * 2**20
    return path


def twin_run() -> list[tuple[LaserScan | Image, int]]:
    run = []
    for stamp in range(0, 700 * 100 * MS, 100 * MS):
        run += [(a_scan(stamp), stamp), (an_image(stamp - 30 * MS), stamp)]
    return run


def test_a_replay_is_the_run_to_the_bit(twin_bag):
    recording = Recording(twin_bag)
    live = [encode(observation).observation for observation, _ in twin_run()]
    replayed = list(recording.observations())
    assert len(replayed) == len(live) == recording.observation_count
    for one, other in zip(live, replayed, strict=True):
        assert_same(one, other)


def test_what_else_a_twins_bag_holds(twin_bag):
    recording = Recording(twin_bag)
    assert recording.rig == RIG
    assert recording.scenario_yaml == "name: lab\n"
    assert (recording.is_twin, recording.start_ns) == (True, 0)
    assert recording.duration_s == pytest.approx(69.9, abs=1e-9)
    truth = list(recording.truth())
    assert truth == [a_truth(k * 100 * MS, (1, 2) if k else ()) for k in range(700)]
    for one, other in zip(recording.background, [an_image(0), a_scan(0), an_image(1), a_scan(1)], strict=True):
        assert_same(one, encode(other).observation)


def test_messages_of_one_moment_keep_their_order_over_chunks(tmp_path):
    path = tmp_path / "recording.mcap"
    wide = replace(a_scan(0), ranges_m=np.ones(2000, dtype=np.float32), angle_increment_rad=np.pi / 2000)
    with BagWriter(path, RIG) as writer:
        for k in range(300):
            writer.background(encode(replace(wide, stamp_ns=k)))
    assert path.stat().st_size > 2 * 2**20
    assert [o.stamp_ns for o in Recording(path).background] == list(range(300))


def test_iterators_are_independent_and_start_over(twin_bag):
    recording = Recording(twin_bag)
    first, second = recording.observations(), recording.observations()
    truth = recording.truth()
    for _ in range(5):
        assert_same(next(first), next(second))
        next(truth)
    assert next(recording.observations()).stamp_ns == 0


def test_a_users_rig_goes_before_the_bags(twin_bag):
    mine = Rig(sensors={"front": LaserSensor(topic="waist/scan", time_offset_s=0.25)})
    observations = list(Recording(twin_bag, mine).observations())
    assert {o.sensor for o in observations} == {"front"}
    assert [o.stamp_ns for o in observations[:2]] == [250 * MS, 350 * MS]


@needs_real_bag
def test_a_robots_ros1_bag():
    recording = Recording(REAL_BAG)
    assert recording.rig == Rig(sensors={"scan": LaserSensor(topic="/scan")})
    assert recording.background == []
    assert list(recording.truth()) == []
    assert recording.scenario_yaml is None
    assert recording.start_ns == 1_403_201_183_698_857_000
    assert recording.observation_count == 1265
    observations = list(recording.observations())
    assert len(observations) == 1265
    stamps = np.array([o.stamp_ns for o in observations])
    assert stamps[0] == 0
    assert (np.diff(stamps) > 0).all()
    assert observations[-1].t == pytest.approx(125.989051)
    for scan in observations:
        assert isinstance(scan, LaserScan)
        assert scan.ranges_m.shape == (512,)
        returns = scan.ranges_m[np.isfinite(scan.ranges_m)]
        assert ((returns >= scan.range_min_m) & (returns < scan.range_max_m)).all()
    scan = observations[0]
    np.testing.assert_allclose(scan.angles_rad[[0, -1]], [-np.pi / 2, np.pi / 2 - np.pi / 512], atol=1e-5)


@needs_real_bag
@pytest.mark.parametrize("share", [0.0, 0.00001, 0.001, 0.3, 0.7, 0.95, 0.9999])
def test_a_cut_ros1_bag(tmp_path, share):
    whole = REAL_BAG.read_bytes()
    refuse_cut(tmp_path / "cut.bag", whole, share)


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.001, 0.1, 0.5, 0.9, 0.9999])
def test_a_cut_mcap(tmp_path, twin_bag, share):
    refuse_cut(tmp_path / "cut.mcap", twin_bag.read_bytes(), share)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.9])
def test_a_cut_sqlite_bag(tmp_path, share):
    write_ros2_bag(tmp_path / "bag", scan_messages("/scan", [k * 100 * MS for k in range(200)]))
    refuse_cut(tmp_path / "cut.db3", (tmp_path / "bag" / "bag.db3").read_bytes(), share)


def refuse_cut(path: Path, whole: bytes, share: float) -> None:
    path.write_bytes(whole[: int(len(whole) * share)])
    tool = {".bag": "rosbag reindex", ".mcap": "mcap recover", ".db3": "sqlite3"}[path.suffix]
    why = f"is empty, 0 bytes.*|.*`{tool} .*" if share else "is empty, 0 bytes.*"
    with pytest.raises(InputError, match=f"^{path}: ({why}); .* is expected$"):
        list(Recording(path).observations())


def is_whole(recording: Recording, scans: list[LaserScan], truth: list[TruthFrame]) -> bool:
    """Whether all scans, to the bit, and all truth is there."""
    found, frames = list(recording.observations()), list(recording.truth())
    if len(found) != len(scans) or frames != truth:
        return False
    return all(
        isinstance(one, LaserScan)
        and one.stamp_ns == other.stamp_ns
        and one.ranges_m.tobytes() == other.ranges_m.tobytes()
        for one, other in zip(found, scans, strict=True)
    )


def test_a_damaged_mcap_is_whole_or_told_of_or_refused_in_one_sentence_that_names_it(tmp_path):
    """Nothing is lost in silence, and nothing is a fault, wherever 64 bytes are others."""
    path, scans, truth = tmp_path / "damaged.mcap", [a_scan(k) for k in range(10)], [a_truth(k) for k in range(10)]
    with BagWriter(path, RIG) as writer:
        for k, scan in enumerate(scans):
            writer.observation(encode(scan), k)
            writer.truth(FrameText(truth[k]))
    whole = path.read_bytes()
    scans = [encode(scan).observation for scan in scans]
    ended = Counter()
    for start in np.linspace(8, len(whole) - 64, 120, dtype=int):
        path.write_bytes(whole[:start] + bytes(range(64, 128)) + whole[start + 64 :])
        refused = ""
        try:
            recording = Recording(path)
            is_all = is_whole(recording, scans, truth)
        except InputError as error:
            refused = str(error)
            ended["refused"] += 1
        else:
            assert is_all or lines(recording.losses), f"bytes {start} to {start + 64}: lost in silence"
            ended["whole" if is_all else "told"] += 1
        assert not refused or (refused.startswith(str(path)) and "\n" not in refused)
    assert min(ended[each] for each in ("whole", "told", "refused")) >= 10, ended


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_ros2_folder_of_a_robot(tmp_path, storage):
    stamps = [EPOCH_NS + k * 100 * MS for k in range(5)]
    write_ros2_bag(
        tmp_path / "bag", [("/odd", STRING, EPOCH_NS, String("x")), *scan_messages("/front/scan", stamps)], storage
    )
    recording = Recording(tmp_path / "bag")
    assert recording.start_ns == EPOCH_NS
    assert list(recording.rig.sensors) == ["front_scan"]
    for stamp, got in zip(stamps, recording.observations(), strict=True):
        assert got.stamp_ns == stamp - EPOCH_NS
        assert isinstance(got, LaserScan)
        np.testing.assert_array_equal(got.ranges_m, a_scan(stamp).ranges_m)


def camera(topic: str, width: int = 48) -> FisheyeSensor:
    lens = FisheyeIntrinsics(width=width, height=32, fx=14, fy=14, cx=24, cy=16, field_of_view_rad=3.0)
    return FisheyeSensor(topic=topic, intrinsics=lens)


@pytest.fixture
def robot_bag(tmp_path) -> Path:
    """Two scanners, a raw camera and a string, the camera first and 20 ms ahead in its stamps."""
    raw = RawImage(
        Header(time_message(EPOCH_NS - 20 * MS), "optical"), 32, 48, "bgr8", 0, 144, an_image(0).rgb[..., ::-1].ravel()
    )
    write_ros2_bag(
        tmp_path / "robot",
        [
            ("/camera/image_raw", RAW_IMAGE, EPOCH_NS + 1 * MS, raw),
            *scan_messages("/low", [EPOCH_NS, EPOCH_NS + 100 * MS]),
            *scan_messages("/high", [EPOCH_NS + 50 * MS]),
            ("/chatter", STRING, EPOCH_NS, String("hello")),
        ],
        StoragePlugin.MCAP,
    )
    return tmp_path / "robot"


def test_a_rig_yaml_maps_topics_to_sensors(tmp_path, robot_bag):
    rig = Rig(
        sensors={
            "knee": LaserSensor(topic="/low", role="knee"),
            "eye": camera("camera/image_raw"),
            "waist": LaserSensor(topic="/high", role="waist", time_offset_s=-0.01),
        }
    )
    (tmp_path / "rig.yaml").write_text(rig.dump_yaml())
    recording = Recording(robot_bag, tmp_path / "rig.yaml")
    assert recording.rig == rig
    assert recording.start_ns == EPOCH_NS - 20 * MS
    observations = list(recording.observations())
    assert [(o.sensor, o.stamp_ns // MS) for o in observations] == [
        ("eye", 0),
        ("knee", 20),
        ("waist", 60),
        ("knee", 120),
    ]
    assert isinstance(observations[0], Image)
    np.testing.assert_array_equal(observations[0].rgb, an_image(0).rgb)


@pytest.mark.parametrize(
    ("sensors", "complaint"),
    [
        ({"a": LaserSensor(topic="/lwo")}, r"sensors\.a\.topic is '/lwo', which .* does not have; .* /high, /low$"),
        ({"a": LaserSensor(topic="/chatter")}, r"which is std_msgs/msg/String in .* of which the bag has /high, /low$"),
        ({"a": camera("/low")}, r"sensor_msgs/msg/Image, of which the bag has /camera/image_raw$"),
        (
            {"a": camera("/camera/image_raw", width=64)},
            r"image is 48 x 32; sensors\.a\.intrinsics, .* CameraInfo, say 64 x 32",
        ),
    ],
)
def test_rigs_that_do_not_fit_the_bag(robot_bag, sensors, complaint):
    with pytest.raises(InputError, match=complaint):
        list(Recording(robot_bag, Rig(sensors=sensors)).observations())


def test_two_scanners_need_a_rig(robot_bag):
    with pytest.raises(InputError, match=r"2 LaserScan topics \(/high, /low\); a rig\.yaml"):
        Recording(robot_bag)


def test_a_camera_alone_needs_a_rig(tmp_path):
    encoded = encode(an_image(EPOCH_NS))
    write_ros2_bag(tmp_path / "bag", [("/eye", encoded.msgtype, EPOCH_NS, encoded.data)])
    with pytest.raises(InputError, match=r"only images \(/eye\); a rig\.yaml \(--rig\) with the place and the lens"):
        Recording(tmp_path / "bag")


def test_no_usable_topic(tmp_path):
    write_ros2_bag(tmp_path / "bag", [("/chatter", STRING, 0, String("hello"))])
    with pytest.raises(InputError, match=r"no usable topic, its topics are: /chatter \(std_msgs/msg/String\)"):
        Recording(tmp_path / "bag")
    write_ros2_bag(tmp_path / "empty", [])
    with pytest.raises(InputError, match="no usable topic, its topics are: none"):
        Recording(tmp_path / "empty")


def test_a_message_that_cannot_be_used_is_named_by_its_topic(tmp_path):
    raw = RawImage(Header(time_message(0), ""), 1, 1, "32FC1", 0, 4, np.zeros(4, np.uint8))
    write_ros2_bag(tmp_path / "bag", [("/eye", RAW_IMAGE, 0, raw)])
    recording = Recording(tmp_path / "bag", Rig(sensors={"eye": camera("/eye")}))
    with pytest.raises(InputError, match="topic /eye: image of 'eye': encoding is '32FC1'"):
        list(recording.observations())


def test_truth_that_is_something_else(tmp_path):
    write_ros2_bag(tmp_path / "bag", [*scan_messages("/scan", [0]), ("/truth/people", STRING, 0, String("nobody"))])
    with pytest.raises(InputError, match="topic /truth/people: holds 'nobody'; a JSON list"):
        list(Recording(tmp_path / "bag").truth())


def test_files_that_are_no_bags(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "notes.bag").write_text("hello")
    (tmp_path / "walk.bag.gz").write_bytes(gzip.compress(b"#ROSBAG V2.0"))
    (tmp_path / "walk").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "notes.mcap").write_text("hello, this is text and longer than a footer of a bag would be")
    for folder, names in {
        "folder": (),
        "run": ("recording.mcap", "scenario.yaml"),
        "killed": ("killed_0.mcap",),
    }.items():
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).touch()
    for name, complaint in {
        "missing.bag": "does not exist",
        "notes.txt": "is not named like a bag",
        "notes.bag": "is no ROS 1 bag",
        "walk.bag.gz": "is a packed file: `gunzip` gives the bag in it",
        "walk": "is a ROS 1 bag: a name that ends in .bag makes it one that is read",
        "notes.mcap": "is no MCAP file",
        "folder": "is a folder without metadata.yaml",
        "run": "is the folder of a run, whose bag is .*run/recording.mcap",
        "killed": "is a folder without metadata.yaml, as a recorder that was killed leaves it",
    }.items():
        with pytest.raises(InputError, match=f"{name}: {complaint}.* is expected$"):
            Recording(tmp_path / name)


def test_truth_that_came_twice_is_read_once_and_refused_where_it_differs(tmp_path: Path) -> None:
    for again, is_same in ((a_truth(1), True), (a_truth(1, (1,)), False)):
        path = tmp_path / f"{is_same}.mcap"
        with BagWriter(path, RIG) as writer:
            for k in range(3):
                writer.observation(encode(a_scan(k)), k)
                writer.truth(FrameText(a_truth(k)))
                if k == 1:
                    writer.truth(FrameText(again))
        if is_same:
            assert [frame.stamp_ns for frame in Recording(path).truth()] == [0, 1, 2]
        else:
            with pytest.raises(InputError, match="has two messages at 0.000 s that differ; one message a stamp"):
                list(Recording(path).truth())


@pytest.mark.parametrize(
    ("kind", "package"), [("PointCloud2", "pointcloud_to_laserscan"), ("MultiEchoLaserScan", "laser_proc")]
)
def test_a_bag_of_scans_of_another_type_names_what_converts_them(tmp_path: Path, kind: str, package: str) -> None:
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        writer.add_connection("/scan", f"sensor_msgs/msg/{kind}", typestore=typestore(f"sensor_msgs/msg/{kind}"))
    rig = Rig(sensors={"a": LaserSensor(topic="/scan")})
    for given in (None, rig):
        with pytest.raises(
            InputError, match=rf"sensor_msgs/msg/{kind}.*; `{package}` makes one of sensor_msgs/msg/{kind}$"
        ):
            Recording(tmp_path / "bag", given)
    with pytest.raises(InputError, match=rf"neither scans nor pictures; .* is expected; `{package}` makes one of"):
        describe_rig(tmp_path / "bag")
