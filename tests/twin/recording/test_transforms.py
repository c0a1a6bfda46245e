"""Poses of moving bases in bags: nav_msgs/Odometry, trees of transforms, and what is wrong with them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import cos, sin
from typing import Any

import numpy as np
import pytest
from benchmarks.bag_drill import EPOCH_NS
from recorded import MS, scan_messages, write_ros2_bag
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores.ros2_humble import tf2_msgs__msg__TFMessage as TFMessage

from trackers.area import Pose
from trackers.errors import InputError
from trackers.observations import Observation, Odometry
from trackers.rig import LaserSensor, OdometrySensor, Rig
from trackers.tracks import Track
from twin.recording.bags.bag import open_bag
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.rig_of_bag.transforms import Edge, TransformTree
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import ODOMETRY, encode
from twin.recording.writer import CAMERA_INFO, TF_MESSAGE, _camera_info, transform_message
from twin.run.replay import track_recording

STAMPS = [EPOCH_NS + k * 50 * MS for k in range(40)]
PERIOD_NS = 50 * MS


def at(x: float, yaw: float = 0.0, z: float = 0.0) -> np.ndarray:
    return Pose(xyz=(x, 0.0, z), rpy=(0.0, 0.0, np.remainder(yaw, 2 * np.pi))).matrix


def tf(stamp_ns: int, parent: str, child: str, pose: np.ndarray, topic: str = "/tf"):
    message = TFMessage([transform_message(child, pose, parent=parent, stamp_ns=stamp_ns)])
    return topic, TF_MESSAGE, stamp_ns + 5 * MS, message


def bag(folder, messages):
    scans = [(topic, kind, log, data) for topic, kind, log, data in scan_messages("/scan", STAMPS[::2])]
    write_ros2_bag(folder / "bag", sorted([*scans, *messages], key=lambda each: each[2]))
    return folder / "bag"


def ros1_bag(folder, messages, tf_type):
    """The same as a robot with ROS 1 records it; rosbags knows no transforms of ROS 1."""
    store, kinds = get_typestore(Stores.ROS1_NOETIC), {TF_MESSAGE: tf_type}
    for each in {TF_MESSAGE, tf_type}:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", each))
    with rosbag1.Writer(folder / "robot.bag") as writer:
        connections = {}
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kinds.get(kind, kind), typestore=store)
            data = message if isinstance(message, memoryview) else TYPESTORE.serialize_cdr(message, kind)
            writer.write(connections[topic], log_ns, TYPESTORE.cdr_to_ros1(data, kind))
    return folder / "robot.bag"


def driving(base: str = "base_link"):
    """A base that goes ahead at 1 m/s while it turns, seen every other stamp in front of a scanner on a mast."""
    moved = [tf(ns, "odom", base, at(0.05 * k, 0.02 * k)) for k, ns in enumerate(STAMPS)]
    return [*moved, tf(STAMPS[0], base, "mast", at(0.2, z=0.5), "/tf_static")]


def of_kind(recording, kind):
    return [each for each in recording.observations() if isinstance(each, kind)]


@pytest.mark.parametrize("ros1_type", [None, TF_MESSAGE, "tf/msg/tfMessage"])
def test_a_bag_with_a_tree_mounts_its_scanner_on_what_moves(tmp_path, ros1_type):
    messages = [*driving(), tf(STAMPS[0], "mast", "waist", at(0.1, 0.3), "/tf_static")]
    messages += [tf(ns, "base_link", "wheel", at(0.0, 0.3 * k)) for k, ns in enumerate(STAMPS)]
    messages += [tf(ns, "map", "odom", at(3.0)) for ns in STAMPS[::10]]
    if ros1_type is None:
        recording = Recording(bag(tmp_path, messages))
    else:
        recording = Recording(ros1_bag(tmp_path, [*scan_messages("/scan", STAMPS[::2]), *messages], ros1_type))
    scanner, base = recording.rig.sensors["scan"], recording.rig.sensors["odometry"]
    assert isinstance(scanner, LaserSensor) and isinstance(base, OdometrySensor)
    assert (scanner.mounted_on, base.frame, base.base_frame) == ("odometry", "odom", "base_link")
    assert np.allclose(scanner.room_from_sensor.matrix, at(0.2, z=0.5) @ at(0.1, 0.3))
    assert recording.moving == [] and lines(recording.losses) == []
    poses = of_kind(recording, Odometry)
    assert [each.stamp_ns for each in poses] == [k * PERIOD_NS for k in range(40)]
    for k, each in enumerate(poses):
        assert np.allclose(each.frame_from_base, at(0.05 * k, 0.02 * k), atol=1e-9)
    assert recording.observation_count == 60 and recording.counts == {"scan": 20, "odometry": 40}


def test_a_mast_that_tilts_is_a_base(tmp_path):
    """Between the transforms of the faster edge the slower one is interpolated."""
    tilts = [tf(ns + 25 * MS, "base_link", "waist", at(0.0, 0.1 * sin(k), 1.0)) for k, ns in enumerate(STAMPS)]
    tilts += [tf(ns, "base_link", "waist", at(0.0, 0.1 * cos(k), 1.0)) for k, ns in enumerate(STAMPS)]
    moved = [tf(ns, "odom", "base_link", at(0.05 * k)) for k, ns in enumerate(STAMPS)]
    recording = Recording(bag(tmp_path, [*tilts, *moved]))
    base = recording.rig.sensors["odometry"]
    assert isinstance(base, OdometrySensor) and (base.frame, base.base_frame) == ("odom", "waist")
    first, second, *_ = (each.frame_from_base for each in of_kind(recording, Odometry)[10:])
    assert np.allclose([first[0, 3], second[0, 3]], [0.25, 0.275], atol=1e-6)


RIG = Rig(
    sensors={
        "scan": LaserSensor(topic="/scan", mounted_on="robot"),
        "robot": OdometrySensor(topic="/tf", frame="odom", base_frame="mast"),
    }
)
BROKEN = {
    "a gap": ([*driving()[:-1], tf(STAMPS[0], "body", "mast", at(0.1))], "are in two trees, below 'odom' and 'body'"),
    "a circle": (
        [*driving(), tf(STAMPS[0], "mast", "odom", at(0.1))],
        "transforms go in a circle: (mast|odom|base_link) > ",
    ),
    "another name": (driving("base")[:-1], "no transform names a frame 'mast'; .* base, odom"),
    "nothing moves": (
        [tf(STAMPS[0], "odom", "mast", at(0.1), "/tf_static")],
        "all transforms are of /tf_static: the base never moves",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_tree_that_tells_no_pose_is_refused(tmp_path, name):
    messages, said = BROKEN[name]
    with pytest.raises(InputError, match=rf"the rig: sensors.robot.frame, base_frame: .*{said}"):
        Recording(bag(tmp_path, messages), RIG)


UNTOLD = {
    "no transform of the scanner": (driving()[:-1], "no transforms lead from its frame 'waist' to base_link"),
    "a gap": (
        [*driving()[:-1], tf(STAMPS[0], "body", "waist", at(0.1), "/tf_static")],
        "to base_link .in odom., which moves",
    ),
    "a circle": (
        [*driving(), *(tf(STAMPS[0], *each, at(0.1)) for each in (("mast", "waist"), ("waist", "odom")))],
        "scan may move: transforms go in a circle: waist > mast",
    ),
}


@pytest.mark.parametrize("name", UNTOLD)
def test_without_a_rig_a_tree_that_does_not_tell_on_what_the_scanner_stands_is_told(tmp_path, name):
    messages, said = UNTOLD[name]
    recording = Recording(bag(tmp_path, messages))
    assert recording.rig.mounted() == {} and re.search(said, recording.moving[0])


def test_a_scanner_that_stands_beside_a_robot_is_not_doubted(tmp_path):
    beside = [*driving(), tf(STAMPS[0], "odom", "waist", at(2.0), "/tf_static")]
    assert Recording(bag(tmp_path, beside)).moving == []


@pytest.mark.parametrize("child", ["base_footprint", "", "robot/base"])
@pytest.mark.parametrize("top", ["base_link", "chassis", "map", "robot/odom"])
def test_a_base_that_no_transform_names_carries_what_is_above_the_scanner_unless_that_stands(tmp_path, child, top):
    moved = [Odometry(child or "robot", ns, at(0.1 * k)) for k, ns in enumerate(STAMPS)]
    messages = [
        tf(STAMPS[0], top, "mast", at(0.2), "/tf_static"),
        tf(STAMPS[0], "mast", "waist", at(0.1), "/tf_static"),
    ]
    for each in moved:
        message: Any = TYPESTORE.deserialize_cdr(encode(each).data, ODOMETRY)
        messages.append(("/odom", ODOMETRY, each.stamp_ns + MS, replace(message, child_frame_id=child)))
    stands = top in ("map", "robot/odom")
    path = bag(tmp_path, messages)
    recording = Recording(path)
    assert recording.rig.mounted() == ({} if stands else {"scan": "odometry"})
    untold = [line for line in lines(recording.losses) if f"no transform tells where {top} sits on it" in line]
    assert len(untold) == (not stands)
    if not stands:
        pose = recording.rig.sensors["scan"].room_from_sensor.matrix
        assert np.allclose(pose, at(0.3), atol=1e-9)
    still = Recording(path, Rig(sensors={"scan": LaserSensor(topic="/scan")}))
    assert ["scan moves: by /odom" in each for each in still.moving] == [True] * (not stands)


def test_odometry_that_jumps_or_stops_and_a_second_parent_are_told(tmp_path):
    jumping = [tf(ns, "odom", "mast", at(0.05 * k + 3.0 * (k > 9))) for k, ns in enumerate(STAMPS[:14])]
    second = [tf(ns, "other/odom", "mast", at(0.1 * k)) for k, ns in enumerate(STAMPS[:5])]
    told = lines(Recording(bag(tmp_path, [*jumping, *second]), RIG).losses)
    assert len(told) == 3
    assert any("robot: 10 of 40 messages are missing" in each for each in told) or any(
        "silent" in each for each in told
    )
    assert any("jump, further than any base drives, at 0.50 s" in each for each in told)
    assert any("mast (of odom and other/odom)" in each for each in told)


def test_messages_of_odometry_keep_their_pose(tmp_path):
    truth = [Odometry("robot", ns, at(0.1 * k, 0.05 * k, 0.01)) for k, ns in enumerate(STAMPS)]
    messages = [
        ("/odom", each.msgtype, ns + MS, each.data) for ns, each in zip(STAMPS, map(encode, truth), strict=True)
    ]
    recording = Recording(bag(tmp_path, messages))
    assert recording.rig.mounted() == {"scan": "odometry"}
    for was, read in zip(truth, of_kind(recording, Odometry), strict=True):
        assert np.allclose(was.frame_from_base, read.frame_from_base, atol=1e-12)
    assert "no transform tells where it sits on it" in lines(recording.losses)[0]


def test_a_rig_mounts_on_odometry_alone():
    with pytest.raises(ValueError, match="mounted_on is 'base', which is no odometry; valid are robot"):
        Rig(sensors={**RIG.sensors, "low": LaserSensor(topic="/low", mounted_on="base")})
    with pytest.raises(ValueError, match="odometry alone"):
        Rig(sensors={"robot": RIG.sensors["robot"]})
    with pytest.raises(ValueError, match="one of frame and base_frame is missing"):
        OdometrySensor(topic="/tf", frame="odom")
    assert LaserSensor(topic="/scan", mounted_on="robot", room_from_sensor=Pose(xyz=(0, 0, -0.1))).mounted_on
    assert RIG.main_sensor == "scan"


def test_lenses_that_a_rig_leaves_out_are_those_of_the_bag(tmp_path):
    from recorded import RIG as CAMERAS, an_image

    camera = CAMERAS.cameras()["camera"]
    image = encode(an_image(STAMPS[0]))
    messages = [("/camera/image/compressed", image.msgtype, STAMPS[0], image.data)]
    info = [("/camera/camera_info", CAMERA_INFO, STAMPS[0], _camera_info("camera", camera.intrinsics))]
    rig = tmp_path / "rig.yaml"
    rig.write_text("sensors: {camera: {kind: fisheye, topic: /camera/image/compressed}}")
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    found = Recording(bag(tmp_path / "with", [*messages, *info]), rig).rig.cameras()["camera"].intrinsics
    assert found.model_dump(exclude={"field_of_view_rad"}) == camera.intrinsics.model_dump(
        exclude={"field_of_view_rad"}
    )
    with pytest.raises(InputError, match="sensors.camera.intrinsics is missing, and the bag has no sensor_msgs"):
        Recording(bag(tmp_path / "without", messages), rig)


def with_stamps(messages, stamp_ns):
    """The messages of `/tf` with another stamp each, logged as before."""
    changed = []
    for topic, kind, log_ns, message in messages:
        each = message.transforms[0]
        stamp = stamp_ns(log_ns) if topic == "/tf" else log_ns - 5 * MS
        other = transform_message(each.child_frame_id, np.eye(4), parent=each.header.frame_id, stamp_ns=stamp)
        changed.append((topic, kind, log_ns, TFMessage([replace(other, transform=each.transform)])))
    return changed


@pytest.mark.parametrize("stamp_ns", [lambda log: 0, lambda log: EPOCH_NS - 10**12], ids=["zero", "of another time"])
def test_transforms_whose_stamps_stand_still_are_taken_at_their_log_times(tmp_path, stamp_ns):
    tilts = [tf(ns + 25 * MS, "base_link", "mast", at(0.0, 0.1 * sin(k), 1.0)) for k, ns in enumerate(STAMPS)]
    messages = [*tilts, *driving()[:-1]]
    poses = []
    for name, each in (("right", messages), ("still", with_stamps(messages, stamp_ns))):
        (tmp_path / name).mkdir()
        recording = Recording(bag(tmp_path / name, each), RIG)
        poses.append([pose.frame_from_base for pose in of_kind(recording, Odometry)])
    assert np.allclose(*poses, atol=1e-9)
    assert any("robot: 40 of 40 messages have no stamp of their own" in each for each in lines(recording.losses))


@pytest.mark.parametrize("value", [0.0, np.nan])
@pytest.mark.parametrize("child", ["base_link", "mast", "gripper"])
def test_transforms_that_hold_no_pose_are_told_where_they_carry_a_sensor(tmp_path, child, value):
    messages = [
        *driving(),
        tf(STAMPS[0], "mast", "waist", at(0.1), "/tf_static"),
        tf(STAMPS[0], "mast", "gripper", at(0)),
    ]
    for _, _, _, message in messages:
        if (each := message.transforms[0]).child_frame_id == child:
            each.transform.rotation.z = each.transform.rotation.w = value
    told = [each for each in lines(Recording(bag(tmp_path, messages)).losses) if "hold no pose" in each]
    n = {"base_link": 40, "mast": 1}.get(child, 0)
    assert [each.split(" hold")[0] for each in told] == [
        f"transforms: {n} of {n} messages of {child!r} in {parent!r}"
        for parent in {"base_link": ["odom"], "mast": ["base_link"]}.get(child, [])
    ]


@pytest.mark.parametrize("ahead_m", [0.0, 3.0])
@pytest.mark.parametrize("mine", ["/a/tf", "/b/tf"])
def test_of_two_robots_with_the_same_frames_the_one_of_the_rig_is_taken(tmp_path, mine, ahead_m):
    """Poses of both were taken for those of one, in silence; a relay of the same poses is none of another robot."""
    messages = []
    for topic, kind, log_ns, message in driving():
        for name, x in (("/a", 0.0), ("/b", ahead_m)):
            (each,) = message.transforms
            other = tf(log_ns - 5 * MS, each.header.frame_id, each.child_frame_id, at(0.0))[3].transforms[0]
            place = replace(each.transform.translation, x=each.transform.translation.x + x * (topic == "/tf"))
            other = replace(other, transform=replace(each.transform, translation=place))
            messages.append((name + topic, kind, log_ns, TFMessage([other])))
    rig = Rig(sensors={**RIG.sensors, "robot": OdometrySensor(topic=mine, frame="odom", base_frame="mast")})
    recording = Recording(bag(tmp_path, messages), rig)
    poses = of_kind(recording, Odometry)
    assert len(poses) == 40
    assert poses[0].frame_from_base[0, 3] == pytest.approx(0.2 + ahead_m * (mine == "/b/tf"))
    told = [each for each in lines(recording.losses) if "two places" in each]
    assert [re.sub(r".*places, ([^:]*):.*", r"\1", each) for each in told] == (
        [f"base_link (of odom by {mine} and by {'/a/tf' if mine == '/b/tf' else '/b/tf'})"] if ahead_m else []
    )


@pytest.mark.parametrize("yaw", [0.2, 1.2])
def test_a_static_transform_that_changes_is_told(tmp_path, yaw):
    again = tf(STAMPS[20], "mast", "waist", at(0.1, yaw), "/tf_static")
    recording = Recording(
        bag(tmp_path, [*driving(), tf(STAMPS[0], "mast", "waist", at(0.1, 0.2), "/tf_static"), again])
    )
    told = [each for each in lines(recording.losses) if "waist (of mast, which /tf_static changes)" in each]
    assert len(told) == (yaw != 0.2)


@pytest.mark.parametrize(
    ("kind", "every", "told"),
    [
        ("geometry_msgs/msg/PoseStamped", 1, ["scan moves if it is on it"]),
        ("geometry_msgs/msg/TransformStamped", 1, ["scan moves"]),
        ("geometry_msgs/msg/PoseStamped", 39, []),  # goals
    ],
)
def test_poses_of_motion_capture_are_told(tmp_path, kind, every, told):
    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = [tf(STAMPS[0], "base_link", "waist", at(0.1), "/tf_static")]
    for k, ns in list(enumerate(STAMPS))[::every]:
        each = tf(ns, "world", "base_link", at(0.1 * k))[3].transforms[0]
        place = each.transform.translation
        pose = store.types["geometry_msgs/msg/Pose"](
            store.types["geometry_msgs/msg/Point"](place.x, place.y, place.z), each.transform.rotation
        )
        is_transform = kind.endswith("TransformStamped")
        messages.append(("/pose", kind, ns, each if is_transform else store.types[kind](each.header, pose)))
    assert [each.split(":")[0] for each in Recording(bag(tmp_path, messages)).moving] == told


def test_transforms_that_are_none_by_their_bytes_are_told(tmp_path):
    messages = driving()
    for k in range(10):
        topic, kind, log_ns, _ = messages[k]
        messages[k] = (topic, kind, log_ns, memoryview(b"\0\1\0\0\xff"))
    told = [each for each in lines(Recording(bag(tmp_path, messages)).losses) if "are no transforms" in each]
    assert [each.split(" are")[0] for each in told] == ["/tf: 10 of 40 messages"]


@pytest.mark.parametrize("n_bad", [0, 1, 10, 40])
@pytest.mark.parametrize("rig", [None, "scan", "scan, robot"])
def test_odometry_that_holds_no_pose_is_told_or_refused(tmp_path, n_bad, rig):
    messages = []
    for k, ns in enumerate(STAMPS):
        message: Any = TYPESTORE.deserialize_cdr(encode(Odometry("robot", ns, at(0.1 * k))).data, ODOMETRY)
        if k < n_bad:
            message.pose.pose.orientation.w = message.pose.pose.orientation.z = 0.0
        messages.append(("/odom", ODOMETRY, ns + MS, message))
    sensors = {"scan": LaserSensor(topic="/scan"), "robot": OdometrySensor(topic="/odom")}
    own = None if rig is None else Rig(sensors={name: sensors[name] for name in rig.split(", ")})
    recording = Recording(bag(tmp_path, messages), own)
    used = "/odom" in recording.sensor_topics.sensors
    if used and n_bad == 40:
        with pytest.raises(InputError, match="topic /odom: odometry 'robot': the pose is no rigid transform"):
            list(recording.observations())
        return
    list(recording.observations())
    said = "the pose is no rigid transform" if used else f"/odom: {n_bad} of 40 messages hold no pose"
    assert any(said in each for each in lines(recording.losses)) == (n_bad > 0)


def test_poses_from_a_frame_on_another_branch_are_those_by_matrices() -> None:
    """Two transforms lead down to it: with turns their order counts."""
    names = {"mast": "map", "waist": "mast", "arm": "map", "hand": "arm"}
    placed = {name: at(0.3 * k + 0.2, 0.5 * k + 0.4, 0.1 * k) for k, name in enumerate(names)}
    stamps = np.arange(3) * PERIOD_NS
    edges = {
        name: Edge("/tf", parent, name, False, stamps, stamps, np.arange(3), np.stack([placed[name]] * 3))
        for name, parent in names.items()
    }
    tree = TransformTree(edges)
    map_from = {"waist": placed["mast"] @ placed["waist"], "hand": placed["arm"] @ placed["hand"]}
    expected = np.linalg.inv(map_from["hand"]) @ map_from["waist"]
    assert np.allclose(tree.static_pose("waist", "hand"), expected)
    assert np.allclose(tree.poses("hand", "waist")[1], expected)


class Standing:
    """Reports one track at the origin of its frame."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def update(self, observation: Observation) -> None:
        pass

    def tracks(self) -> list[Track]:
        return [Track(1, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("z", "named", "frame_id"),
    [(0.0, "waist", "waist"), (0.4, "room", "room"), (None, "odom", "odom")],
)
def test_markers_of_tracks_are_in_the_frame_that_is_named(tmp_path, z, named, frame_id):
    """A scanner is the rig's origin only where it is at no other height."""
    on_mast = [*driving(), tf(STAMPS[0], "mast", "waist", at(0.1), "/tf_static")]
    path, copy, rig = bag(tmp_path, on_mast if z is None else []), tmp_path / "copy.mcap", tmp_path / "rig.yaml"
    pose = Pose(xyz=(0, 0, z or 0.0))
    rig.write_text(Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=pose)}).dump_yaml())
    result = track_recording(
        path,
        rig_path=None if z is None else rig,
        trackers=[f"{__name__}:Standing"],
        out=tmp_path / "out",
        video=False,
        bag_copy=copy,
        on_warning=lambda warning: None,
    )
    with open_bag(copy) as held:
        (topic,) = [each for each in held.topics if each.endswith("/markers")]
        found = {each.header.frame_id for _, _, message in held.messages([topic]) for each in message.markers}
    assert list(result.frames.values()) == [named] and found == {frame_id}


@pytest.mark.parametrize("changes", [False, True])
def test_a_driving_scanners_copy_names_frames_tells_drift_and_has_one_channel_of_what_stands(tmp_path, changes):
    messages = [*driving(), tf(STAMPS[0], "mast", "waist", at(0.1, 0.3), "/tf_static")]
    messages += [tf(ns, "map", "odom", at(3.0 + 0.02 * k)) for k, ns in enumerate(STAMPS)]
    messages += [tf(STAMPS[9], "mast", "waist", at(0.1, 0.9), "/tf_static")] * changes
    told, copy = [], tmp_path / "copy.mcap"
    result = track_recording(
        bag(tmp_path, messages),
        trackers=["laser-legs", "laser-imm", "laser-vision-learning-laser"],
        out=tmp_path / "out",
        video=False,
        bag_copy=copy,
        on_warning=told.append,
    )
    frames = {"laser-legs": "odom", "laser-imm": "odom", "laser-vision-learning-laser": "base_link (which moves)"}
    assert result.frames == frames == json.loads((tmp_path / "out/recording.json").read_text())["frames"]
    page = (tmp_path / "out/report.html").read_text()
    assert "Tracks of laser-legs are in the frame odom" in page
    assert page.count('class="drive"') == 3
    assert page.count("<strong>Note:</strong> laser-vision-learning-laser takes scan to stand") == 1
    (drift,) = [each for each in told if "odom moves in map" in each]
    assert "by up to 0.78 m and 0.0°; room is placed in map by the first; `frame: map` of odo" in drift
    with open_bag(copy) as held:
        assert [each.topic for each in held.connections].count("/tf_static") == 1 + changes
        of_children = {
            each.child_frame_id: (each.header.frame_id, each.transform.translation.x)
            for _, _, message in held.messages(["/tf_static"])
            for each in message.transforms
        }
    assert of_children == {"map": ("room", -3.0), "mast": ("base_link", 0.2), "waist": ("mast", 0.1)}
    assert any("/tf_static has two channels" in each for each in told) == changes
