"""The lens that a bag states for a camera is held against that of the rig."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recorded import MS, write_ros2_bag
from rosbags import rosbag1
from rosbags.typesys import Stores, get_typestore

from trackers.cameras import FisheyeIntrinsics, PinholeIntrinsics
from trackers.errors import InputError
from trackers.observations import Image
from trackers.rig import FisheyeSensor, PinholeSensor, Rig
from twin.recording.losses import lines
from twin.recording.reader import Recording
from twin.recording.rig_of_bag.rig_guess import describe_rig
from twin.recording.ros.message_types import TYPESTORE
from twin.recording.ros.ros_messages import COMPRESSED_IMAGE, encode
from twin.recording.writer import CAMERA_INFO

T = TYPESTORE.types
LENS = PinholeIntrinsics(width=48, height=32, fx=40, fy=41, cx=23, cy=16, distortion=(0.1, -0.02, 0.001, 0.0, 0.0))
ROUND = FisheyeIntrinsics(width=48, height=32, fx=14, fy=14, cx=23.5, cy=15.5, k=(0.01, 0, 0, 0), field_of_view_rad=3.0)
EPOCH_NS = 1_700_000_000 * 10**9


def info(**changes: Any) -> Any:
    """The CameraInfo of LENS, with changes."""
    k = [LENS.fx, 0, LENS.cx, 0, LENS.fy, LENS.cy, 0, 0, 1]
    said = {
        "header": T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](0, 0), "camera"),
        "height": 32,
        "width": 48,
        "distortion_model": "plumb_bob",
        "d": list(LENS.distortion),
        "k": k,
        "r": np.eye(3).ravel(),
        "p": [*k[:3], 0, *k[3:6], 0, *k[6:], 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    } | changes
    arrays = {each: np.asarray(said[each], dtype=np.float64) for each in "dkrp"}
    return T[CAMERA_INFO](**(said | arrays))


def region(x: int, y: int, width: int, height: int) -> Any:
    return T["sensor_msgs/msg/RegionOfInterest"](x, y, height, width, False)


def a_bag(
    folder: Path,
    message: Any,
    pictures: str = "/cam/image_raw/compressed",
    said_on: str = "/cam/camera_info",
    then: Any = None,
) -> Path:
    encoded = encode(Image("cam", EPOCH_NS, np.zeros((32, 48, 3), np.uint8)))
    messages: list[tuple[str, str, int, Any]] = [
        (pictures, encoded.msgtype, EPOCH_NS + k * 100 * MS, encoded.data) for k in range(3)
    ]
    infos = [(said_on, CAMERA_INFO, EPOCH_NS, message), (said_on, CAMERA_INFO, EPOCH_NS + 250 * MS, then or message)]
    write_ros2_bag(folder / "bag", [infos[0], *messages, infos[1]])
    return folder / "bag"


def told(bag: Path, lens: Any = LENS, topic: str = "/cam/image_raw/compressed") -> list[str]:
    kind = PinholeSensor if isinstance(lens, PinholeIntrinsics) else FisheyeSensor
    rig = Rig(sensors={"cam": kind(topic=topic, intrinsics=lens)})  # pyright: ignore[reportArgumentType]
    return [line for line in lines(Recording(bag, rig).losses) if "camera_info" in line]


@pytest.mark.parametrize(("frame", "known"), [("cam", True), ("another", False)])
def test_a_camera_info_under_any_name_is_that_of_the_pictures_of_its_frame(
    tmp_path: Path, frame: str, known: bool
) -> None:
    message = info()
    message.header.frame_id = frame
    text, undecided = describe_rig(a_bag(tmp_path, message, said_on="/drivers/calibration"))
    assert any("the bag does not tell its lens" in each for each in undecided) != known
    if known:
        camera = Rig.parse(text, "text").sensors["cam_image_raw_compressed"]
        assert isinstance(camera, PinholeSensor) and camera.intrinsics == LENS


SAME = {
    "as the rig says": info(),
    "zeros at the end of the coefficients": info(d=[*LENS.distortion, 0, 0, 0], distortion_model="rational_polynomial"),
    "four coefficients": info(d=list(LENS.distortion)[:4]),
    "binned": info(width=96, height=64, binning_x=2, binning_y=2, k=[80, 0, 46, 0, 82, 32, 0, 0, 1]),
    "a region of interest": info(
        width=640, height=480, roi=region(100, 50, 48, 32), k=[40, 0, 123, 0, 41, 66, 0, 0, 1]
    ),
    "a region of interest, binned": info(
        width=640, height=480, roi=region(100, 50, 96, 64), binning_x=2, binning_y=2, k=[80, 0, 146, 0, 82, 82, 0, 0, 1]
    ),
    "a little another": info(k=[40.1, 0, 23.1, 0, 41, 16, 0, 0, 1]),
}
OTHER = {
    "never calibrated": (info(k=[0] * 9), r"never calibrated .*; the rig's intrinsics are taken"),
    "of another size": (info(width=96, height=64), "is for pictures of 96 x 64, the rig's intrinsics for 48 x 32"),
    "binned to another size": (
        info(width=48, height=32, binning_x=2, binning_y=2),
        r"is for pictures of 24 x 16 \(binned\), the rig's intrinsics for 48 x 32",
    ),
    "of another region": (
        info(width=640, height=480, roi=region(0, 0, 320, 240)),
        r"is for pictures of 320 x 240 \(a region of interest\)",
    ),
    "of another focal length": (
        info(k=[60, 0, 23, 0, 61, 16, 0, 0, 1]),
        r"up to \d+ px apart; `intrinsics: {width: 48,height: 32,fx: 60.0,fy: 61.0,cx: 23.0,cy: 16.0,distortion: \[0.1",
    ),
    "of another principal point": (info(k=[40, 0, 43, 0, 41, 16, 0, 0, 1]), "up to 20 px apart"),
    "of another distortion": (info(d=[-0.4, 0, 0, 0, 0]), r"up to \d+ px apart"),
    "a rational one": (
        info(d=[0.3, -2.6, 0, 0, 1.5, 0.2, -2.4, 1.4], distortion_model="rational_polynomial"),
        "8 coefficients of the model rational_polynomial, which is not supported",
    ),
    "of another model": (info(distortion_model="omni"), "the model 'omni', which is not supported"),
    "a fisheye": (info(d=[0, 0, 0, 0], distortion_model="equidistant"), "px apart"),
}


@pytest.mark.parametrize("message", SAME.values(), ids=SAME.keys())
def test_a_lens_that_is_the_rigs_is_not_spoken_of(tmp_path, message):
    assert told(a_bag(tmp_path, message)) == []


@pytest.mark.parametrize(("message", "said"), OTHER.values(), ids=OTHER.keys())
def test_a_lens_that_is_another_is_told_with_sensor_and_remedy(tmp_path, message, said):
    (line,) = told(a_bag(tmp_path, message))
    assert line.startswith("cam: /cam/camera_info ")
    assert re.search(said, line), line


@pytest.mark.parametrize("topic", ["/cam/image_raw/compressed", "/cam/image_rect"])
def test_the_first_lens_that_was_calibrated_is_taken(tmp_path: Path, topic: str) -> None:
    zeros = info(k=[0] * 9, p=[0] * 12, d=[])
    bag = a_bag(tmp_path / "later", zeros, topic, then=info())
    rig = tmp_path / "rig.yaml"
    rig.write_text(f"sensors: {{cam: {{kind: camera, topic: {topic}}}}}\n")
    lens = Recording(bag, rig).rig.sensors["cam"].intrinsics  # pyright: ignore[reportAttributeAccessIssue]
    assert lens == (LENS if "raw" in topic else LENS.model_copy(update={"distortion": (0.0,) * 5}))
    assert told(bag, lens, topic) == []
    text, undecided = describe_rig(bag)
    assert "fx: 40" in text and not any("lens" in each for each in undecided)
    with pytest.raises(InputError, match="was never calibrated .its matrix is zero.; intrinsics are expected"):
        Recording(a_bag(tmp_path / "never", zeros, topic), rig)
    assert any("lens" in each for each in describe_rig(tmp_path / "never" / "bag")[1])


def test_a_fisheye_is_held_against_its_own_model(tmp_path):
    k = [14, 0, 23.5, 0, 14, 15.5, 0, 0, 1]
    bag = a_bag(tmp_path, info(k=k, d=[0.01, 0, 0, 0], distortion_model="equidistant"))
    assert told(bag, ROUND) == []
    (line,) = told(bag, ROUND.model_copy(update={"k": (0.2, 0.0, 0.0, 0.0)}))
    assert "px apart" in line
    (line,) = told(bag, LENS)
    assert "px apart" in line


def test_a_rectified_picture_has_the_projection_and_no_distortion(tmp_path):
    plain = LENS.model_copy(update={"distortion": (0.0,) * 5, "fx": 35.0})
    message = info(p=[35, 0, 23, 0, 0, 41, 16, 0, 0, 0, 1, 0])
    bag = a_bag(tmp_path, message, "/cam/image_rect_color", "/cam/camera_info")
    assert told(bag, plain, "/cam/image_rect_color") == []
    assert len(told(bag, LENS, "/cam/image_rect_color")) == 1


def test_other_cameras_and_other_types_say_nothing_of_this_one(tmp_path):
    assert told(a_bag(tmp_path, info(k=[0] * 9), said_on="/other/camera_info")) == []


def test_a_ros1_bag_is_read_alike(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    header = types["std_msgs/msg/Header"](0, types["builtin_interfaces/msg/Time"](0, 0), "camera")
    zero = types[CAMERA_INFO](
        header, 32, 48, "plumb_bob", np.zeros(5), np.zeros(9), np.zeros(9), np.zeros(12), 0, 0,
        types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    )  # fmt: skip
    picture = types[COMPRESSED_IMAGE](header, "png", cv2.imencode(".png", np.zeros((32, 48, 3), np.uint8))[1].ravel())
    with rosbag1.Writer(tmp_path / "one.bag") as writer:
        pictures = writer.add_connection("/cam/image_raw/compressed", COMPRESSED_IMAGE, typestore=store)
        said = writer.add_connection("/cam/camera_info", CAMERA_INFO, typestore=store)
        writer.write(said, EPOCH_NS, store.serialize_ros1(zero, CAMERA_INFO))
        writer.write(pictures, EPOCH_NS, store.serialize_ros1(picture, COMPRESSED_IMAGE))
    (line,) = told(tmp_path / "one.bag")
    assert "never calibrated" in line
