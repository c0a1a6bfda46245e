"""`twin new rig`: a rig.yaml of a bag's sensors, as its topics, CameraInfo and transforms tell them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import MS, a_scan, write_ros2_bag
from scipy.spatial.transform import Rotation
from test_recorded_rigs import EPOCH_NS, LENS, info
from typer.testing import CliRunner

from trackers.errors import InputError
from trackers.observations import Image, Odometry
from trackers.rig import LaserSensor, OdometrySensor, PinholeSensor, Pose, Rig
from twin.cli import app
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.rig_of_bag.rig_guess import describe_rig
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import ODOMETRY, encode

T = TYPESTORE.types
STAMPS_NS = [EPOCH_NS + k * 100 * MS for k in range(20)]
SCAN = "sensor_msgs/msg/LaserScan"
TF = "tf2_msgs/msg/TFMessage"
RAW_IMAGE = "sensor_msgs/msg/Image"


def _transform(parent: str, child: str, pose: Pose, stamp_ns: int) -> Any:
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), parent)
    quaternion = Rotation.from_matrix(pose.rotation).as_quat()
    transform = T["geometry_msgs/msg/Transform"](
        T["geometry_msgs/msg/Vector3"](*pose.xyz), T["geometry_msgs/msg/Quaternion"](*quaternion)
    )
    return T[TF]([T["geometry_msgs/msg/TransformStamped"](header, child, transform)])


def _scans(topic: str, frame: str) -> list[tuple[str, str, int, Any]]:
    return [(topic, SCAN, stamp + 5 * MS, encode(a_scan(stamp, frame)).data) for stamp in STAMPS_NS]


def _is_near(pose: Pose, other: Pose) -> bool:
    return bool(np.allclose(pose.matrix, other.matrix, atol=2e-5))


@pytest.mark.parametrize("seed", range(4))
def test_a_still_rig_is_found_whole(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = {
        name: Pose(
            xyz=(*rng.uniform(-5, 5, 2), rng.uniform(2, 3)), rpy=(*rng.uniform(-0.05, 0.05, 2), rng.uniform(-3, 3))
        )
        for name in ("mast", "waist", "knee", "cam")
    }
    messages = [*_scans("/front/scan", "waist"), *_scans("/low/scan", "knee")]
    messages += [("/cam/image_raw/compressed", e.msgtype, s, e.data) for s, e in _pictures()]
    messages += [("/cam/camera_info", "sensor_msgs/msg/CameraInfo", STAMPS_NS[0], info())]
    poses["mast"] = poses["mast"].model_copy(update={"xyz": (1.0, -2.0, 0.1)})
    parents: dict[str, str] = {"mast": "map", "waist": "mast", "knee": "mast", "camera": "map"}
    for child, parent in parents.items():
        message = _transform(parent, child, poses[child[:3] if child == "camera" else child], STAMPS_NS[0])
        messages.append(("/tf_static", TF, STAMPS_NS[0], message))
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))

    (tmp_path / "rig.yaml").write_text(describe_rig(tmp_path / "bag")[0])
    recording = Recording(tmp_path / "bag", tmp_path / "rig.yaml")
    assert lines(recording.losses) == []  # nothing of the bag contradicts it
    rig = recording.rig
    front, low, camera = (rig.sensors[name] for name in ("front_scan", "low_scan", "cam_image_raw_compressed"))
    assert isinstance(front, LaserSensor) and isinstance(low, LaserSensor) and isinstance(camera, PinholeSensor)
    mast = poses["mast"].matrix
    assert _is_near(front.room_from_sensor, Pose.from_transform(mast @ poses["waist"].matrix))
    assert _is_near(low.room_from_sensor, Pose.from_transform(mast @ poses["knee"].matrix))
    assert _is_near(camera.room_from_sensor, poses["cam"])
    assert camera.intrinsics == LENS

    on_mast = Rig.parse(describe_rig(tmp_path / "bag", "mast")[0], "text").sensors["low_scan"].room_from_sensor
    assert _is_near(on_mast, poses["knee"])
    with pytest.raises(InputError, match="no transform names a frame 'attic'.*map"):
        describe_rig(tmp_path / "bag", "attic")


def _pictures() -> list[tuple[int, Any]]:
    rgb = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    return [(stamp, encode(Image("camera", stamp, rgb))) for stamp in STAMPS_NS[::5]]


def test_sensors_of_a_robot_are_mounted_on_its_base(tmp_path: Path) -> None:
    on_base = {"knee": Pose(xyz=(0.2, 0, 0.3)), "waist": Pose(xyz=(-0.1, 0, 0.9), rpy=(0, 0, 1))}
    messages = [*_scans("/scan", "knee"), *_scans("/high", "waist")]
    for number, stamp in enumerate(STAMPS_NS):
        messages.append(("/tf", TF, stamp, _transform("odom", "base", Pose(xyz=(0.05 * number, 0, 0)), stamp)))
    messages.append(("/tf_static", TF, STAMPS_NS[0], _transform("map", "odom", Pose(xyz=(3, 0, 0)), STAMPS_NS[0])))
    for frame, pose in on_base.items():
        messages.append(("/tf_static", TF, STAMPS_NS[0], _transform("base", frame, pose, STAMPS_NS[0])))
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))

    text, todo = describe_rig(tmp_path / "bag")
    assert not todo
    rig = Rig.parse(text, "text")
    (base,) = rig.odometry()
    assert rig.sensors[base] == OdometrySensor(topic="/tf", frame="odom", base_frame="base")
    assert rig.mounted() == {"scan": base, "high": base}
    assert _is_near(rig.sensors["scan"].room_from_sensor, on_base["knee"])
    assert _is_near(rig.sensors["high"].room_from_sensor, on_base["waist"])

    in_map = Rig.parse(describe_rig(tmp_path / "bag", "map")[0], "text")
    assert in_map.sensors[base] == OdometrySensor(topic="/tf", frame="map", base_frame="base")
    assert in_map.mounted() == rig.mounted()
    with pytest.raises(InputError, match="no transform names a frame 'attic'.*map"):
        describe_rig(tmp_path / "bag", "attic")
    on_robot = Rig.parse(describe_rig(tmp_path / "bag", "base")[0], "text").sensors  # a base that stands
    assert set(on_robot) == {"scan", "high"}
    assert _is_near(on_robot["high"].room_from_sensor, on_base["waist"])


def test_a_place_that_transforms_tell_of_a_lone_scanner_is_not_left_unsaid(tmp_path: Path) -> None:
    placed = [("/tf_static", TF, STAMPS_NS[0], _transform("room", "laser", Pose(xyz=(2, 1, 0.3)), STAMPS_NS[0]))]
    path = tmp_path / "placed"
    write_ros2_bag(path, placed + _scans("/scan", "laser"))
    (line,) = [each for each in lines(Recording(path).losses) if "transforms" in each]
    assert "place its frame laser in room" in line and f"`twin new rig {path}`" in line
    for name, others in {
        "alone": [],
        "there": [("/tf_static", TF, STAMPS_NS[0], _transform("room", "laser", Pose(), STAMPS_NS[0]))],
    }.items():
        write_ros2_bag(tmp_path / name, others + _scans("/scan", "laser"))
        assert not any("transforms" in each for each in lines(Recording(tmp_path / name).losses))


_HEIGHTS_M = {"low_laser": 0.3, "high_laser": 1.0}


def _against(folder: Path, sensors: dict[str, tuple[str, float]], parent: str, **frames: str) -> list[str]:
    """Warnings of a rig, by sensor its topic and height [m], on a bag with two scanners; frames: of their messages."""
    messages = [*_scans("/low", frames.get("low", "low_laser")), *_scans("/high", frames.get("high", "high_laser"))]
    for frame, height_m in _HEIGHTS_M.items() if parent else ():
        pose = Pose(xyz=(0.5 if frame == "low_laser" else 0.0, 0, height_m), rpy=(0, 0, 1))
        messages.append(("/tf_static", TF, STAMPS_NS[0], _transform(parent, frame, pose, STAMPS_NS[0])))
    folder = folder / f"bag{len(list(folder.iterdir()))}"
    write_ros2_bag(folder, sorted(messages, key=lambda each: each[2]))
    x_m = {"/low": 0.5, "/high": 0.0}
    rig = Rig(
        sensors={
            name: LaserSensor(
                topic=topic,
                room_from_sensor=Pose(xyz=(0, 4 + x_m.get(name, x_m[topic]), height_m), rpy=(0, 0, 1 + np.pi / 2)),
            )
            for name, (topic, height_m) in sensors.items()
        }
    )
    return lines(Recording(folder, rig).losses)


def test_a_rig_that_frames_and_transforms_of_the_bag_contradict_is_told_with_both_values(tmp_path: Path) -> None:
    right = {"front": ("/low", 0.3), "back": ("/high", 1.0)}
    for parent in ("map", "base_link", ""):
        assert _against(tmp_path, right, parent) == []
    (line,) = _against(tmp_path, {"front": ("/low", 1.0), "back": ("/high", 0.3)}, "base_link")
    assert line.startswith(
        "back: the rig has it 0.70 m below front, and in the bag transforms 0.70 m above front; the rig is"
    )
    (line,) = _against(tmp_path, {"front": ("/low", 0.3)}, "base_link") or [""]
    assert "does not use /high" in line  # one alone has nothing to be compared with
    _, line = _against(tmp_path, {"front": ("/low", 0.9)}, "map")
    assert line.startswith(
        "front: the rig has it 0.90 m above the floor, and in the bag transforms 0.30 m above 'map'; "
    )
    (line,) = _against(tmp_path, right, "base_link", high="low_laser")
    assert line.startswith(
        "back: the rig has it 0.70 m above front, and in the bag messages of both are of frame 'low_laser'"
    )
    assert "which would hide exchanged topics" in line
    (line,) = _against(tmp_path, right, "base_link", high="high_lase")
    assert line.startswith(
        "back: its frame 'high_lase' is in no transform of the bag; did you mean 'high_laser'? they name "
    )
    assert _against(tmp_path, right, "base_link", low="", high="other") == []  # a tree of other things
    named = {"low_laser": ("/high", 1.0), "high_laser": ("/low", 0.3)}
    (first,) = _against(tmp_path, named, "")
    assert first.startswith(
        "low_laser: its messages are of the frame 'high_laser', and those of high_laser of 'low_laser'; "
    )
    assert _against(tmp_path, {"high_laser": ("/high", 1.0), "low_laser": ("/low", 0.3)}, "") == []


@pytest.mark.parametrize("odometry", [{"topic": "/odom"}, {"topic": "/tf", "frame": "odom", "base_frame": "base"}])
def test_a_scanner_on_a_base_is_held_against_the_transforms_of_the_base(
    tmp_path: Path, odometry: dict[str, str]
) -> None:
    on_base = Pose(xyz=(0.2, 0, 0.3), rpy=(0, 0, 0.5))
    messages = [
        *_scans("/scan", "laser"),
        ("/tf_static", TF, STAMPS_NS[0], _transform("base", "laser", on_base, STAMPS_NS[0])),
    ]
    for number, stamp in enumerate(STAMPS_NS):
        pose = Pose(xyz=(0.05 * number, 0, 0))
        message: Any = TYPESTORE.deserialize_cdr(encode(Odometry("odom", stamp, pose.matrix)).data, ODOMETRY)
        message = replace(message, child_frame_id="base")
        messages += [("/tf", TF, stamp, _transform("odom", "base", pose, stamp)), ("/odom", ODOMETRY, stamp, message)]
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))

    def lines_of(pose: Pose) -> list[str]:
        scanner = LaserSensor(topic="/scan", mounted_on="base", room_from_sensor=pose)
        rig = Rig(sensors={"scan": scanner, "base": OdometrySensor.model_validate({"kind": "odometry", **odometry})})
        return lines(Recording(tmp_path / "bag", rig).losses)

    assert lines_of(on_base) == []
    (line,) = lines_of(Pose(xyz=(0.2, 0, 0.9), rpy=(0, 0, 0.5)))
    assert line.startswith("scan: the rig has it 0.90 m above base, and in the bag transforms 0.30 m above base; ")
    (line,) = lines_of(Pose(xyz=(0.2, 0, 0.3), rpy=(0, 0, 0.5 + np.pi / 2)))
    assert (
        "turned by roll 0°, pitch 0°, yaw 119° to base, and in the bag transforms turned by roll 0°, pitch 0°, yaw 28.6°"
        in line
    )


@pytest.mark.parametrize(("x_m", "least_deg"), [(None, 1.7), (2.0, 3.0), (20.0, 1.0)])
def test_a_turn_is_told_where_it_moves_people_by_as_much_as_another_place_would(
    tmp_path: Path, x_m: float | None, least_deg: float
) -> None:
    """Measured: 2° leave MOTA as it is in the lab, 2 m off, and cost .1 to .45 in the hall, whose people are 10 m off."""
    messages = [*_scans("/low", "low_laser"), *_scans("/high", "high_laser")]
    for frame, height_m in _HEIGHTS_M.items():
        messages.append(
            ("/tf_static", TF, STAMPS_NS[0], _transform("base_link", frame, Pose(xyz=(0, 0, height_m)), STAMPS_NS[0]))
        )
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))
    area = None if x_m is None else ((x_m, -2.0), (x_m, 2.0), (x_m + 0.5, 2.0), (x_m + 0.5, -2.0))
    for factor in (0.9, 1.1):
        high = Pose(xyz=(0, 0, 1.0), rpy=(0, 0, factor * np.radians(least_deg)))
        low = LaserSensor(topic="/low", room_from_sensor=Pose(xyz=(0, 0, 0.3)))
        rig = Rig(sensors={"low": low, "high": LaserSensor(topic="/high", room_from_sensor=high)}, area=area)
        turned = [each for each in lines(Recording(tmp_path / "bag", rig).losses) if "turned by" in each]
        assert bool(turned) == (factor > 1)


def _depth(frame: str) -> Any:
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](EPOCH_NS // 10**9, 0), frame)
    return T[RAW_IMAGE](header, 2, 2, "16UC1", 0, 4, np.full(8, 1, np.uint8))


def test_what_the_bag_does_not_tell_is_marked(tmp_path: Path) -> None:
    messages = [*_scans("/a/scan", "a"), *_scans("/a_scan", "b")]  # of one name but for the slash
    messages += [("/cam/image_raw/compressed", e.msgtype, s, e.data) for s, e in _pictures()]
    messages += [("/round/image_raw/compressed", e.msgtype, s, e.data) for s, e in _pictures()]
    fisheye = info(distortion_model="equidistant", d=np.zeros(4))
    messages.append(("/round/camera_info", "sensor_msgs/msg/CameraInfo", STAMPS_NS[0], fisheye))
    messages.append(("/depth", RAW_IMAGE, STAMPS_NS[0], _depth("elsewhere")))
    cloud = T["sensor_msgs/msg/PointCloud2"](_depth("a").header, 0, 0, [], False, 0, 0, np.zeros(0, np.uint8), True)
    messages.append(("/points", "sensor_msgs/msg/PointCloud2", STAMPS_NS[0], cloud))
    write_ros2_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[2]))
    out = tmp_path / "rig.yaml"
    result = CliRunner().invoke(app, ["new", "rig", str(tmp_path / "bag"), "--out", str(out)])
    assert result.exit_code == 0
    assert result.stdout.split() == ["rig", str(out), "next", "twin", "check", str(out)]
    assert out.read_text().count("CHECK: no transform") == 4
    assert "waist (trunks) from 0.7 m on, knee (legs) below. z = 0\n# means knee" in out.read_text()
    assert "round_image_raw_compressed: no CameraInfo tells a field of view" in result.stderr
    assert "/points: no sensor reads sensor_msgs/msg/PointCloud2" in result.stderr
    assert "`pointcloud_to_laserscan` makes one" in result.stderr
    assert "/depth: distances of frame 'elsewhere', in which no colour picture is, are left out" in result.stderr
    assert "cam_image_raw_compressed: the bag does not tell its lens" in result.stderr
    with pytest.raises(InputError, match=r"sensors.cam_image_raw_compressed.intrinsics is missing"):
        Recording(tmp_path / "bag", out)
    again = CliRunner().invoke(app, ["new", "rig", str(tmp_path / "bag"), "--out", str(out)])
    assert isinstance(again.exception, InputError) and "is there already" in str(again.exception)


def test_marks_that_are_left_in_a_written_rig_are_told_by_all_that_read_it(tmp_path: Path) -> None:
    bag, rig = tmp_path / "bag", tmp_path / "rig.yaml"
    write_ros2_bag(bag, _scans("/scan", "laser"))
    rig.write_text(describe_rig(bag)[0])
    (number,) = (n for n, line in enumerate(rig.read_text().splitlines(), 1) if "# CHECK" in line)
    checked = CliRunner().invoke(app, ["check", str(rig)])
    for said in (checked.stderr, "\n".join(lines(Recording(bag, rig).losses))):
        assert f"line {number}: no transform of the bag tells where it is; correct it, and delete the mark" in said
    rig.write_text(rig.read_text().replace("# CHECK: ", "# "))
    checked = CliRunner().invoke(app, ["check", str(rig)])
    assert not checked.stderr and not any("mark" in each for each in lines(Recording(bag, rig).losses))


def test_a_bag_without_sensors_is_refused(tmp_path: Path) -> None:
    write_ros2_bag(tmp_path / "bag", [("/tf", TF, 0, _transform("a", "b", Pose(), 0))])
    with pytest.raises(InputError, match="neither scans nor pictures"):
        describe_rig(tmp_path / "bag")
