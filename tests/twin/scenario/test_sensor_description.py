"""Sensors as written in a scenario: presets, mounts, and errors that name field and value."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from pydantic import TypeAdapter

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.rig import FisheyeSensor, LaserSensor
from twin.scenario.mount import Mount
from twin.scenario.sensor_descriptions import FisheyeDescription, LaserDescription, SensorDescription
from twin.sensors.camera import CAMERA_NOISE, LENSES
from twin.sensors.laser_noise import LASER_NOISE, LaserNoise


class Sensors(Strict):
    sensors: dict[str, SensorDescription]


def read(text: str) -> LaserDescription | FisheyeDescription:
    return validate(Sensors, {"sensors": {"one": yaml.safe_load(text)}}, "test.yaml").sensors["one"]


LASER = "kind: laser\nmount: {xyz: [0, 0, 0.95], yaw_deg: 90}\nrate_hz: 10\n"
FISHEYE = "kind: fisheye\nmount: {xyz: [0, 0, 1.2], yaw_deg: 90}\nrate_hz: 10\n"


def test_a_scanner_by_default():
    laser = read(LASER + "role: waist\n")
    assert isinstance(laser, LaserDescription)
    assert (laser.n_beam, laser.noise) == (361, LASER_NOISE["default"])
    rig = laser.rig_sensor("waist")
    assert isinstance(rig, LaserSensor)
    assert (rig.topic, rig.role) == ("/waist/scan", "waist")


@pytest.mark.parametrize(
    ("text", "beams"),
    [("resolution_deg: 1", 181), ("beams: 512", 512), ("field_of_view_deg: 270\nresolution_deg: 0.25", 1081)],
)
def test_beams(text: str, beams: int):
    laser = read(LASER + text)
    assert isinstance(laser, LaserDescription)
    assert laser.n_beam == beams


def test_noise_by_name_by_parameters_and_off():
    assert read(LASER + "noise: worse").noise == LASER_NOISE["worse"]
    assert read(LASER + "noise: {sigma_m: 0.03}").noise == LaserNoise(sigma_m=0.03)
    assert read(LASER + "noise: off").noise.is_off  # YAML reads this as false
    assert read(LASER + "noise: 'off'").noise.is_off
    assert read(FISHEYE + "noise: worse").noise == CAMERA_NOISE["worse"]


def test_a_resolved_description_reads_back_the_same():
    for text in (LASER + "noise: off", LASER, FISHEYE, FISHEYE + "lens: opencv_test_lens\nnoise: worse"):
        description = read(text)
        dumped = yaml.safe_dump(description.model_dump(mode="json", exclude_none=True))
        assert read(dumped) == description


def test_lenses():
    camera = read(FISHEYE + "size: [640, 640]")
    assert isinstance(camera, FisheyeDescription)
    assert camera.intrinsics() == LENSES["equidistant_185"].intrinsics((640, 640))
    own = read(FISHEYE + "lens: {width: 100, height: 80, fx: 30, field_of_view_deg: 150}")
    assert isinstance(own, FisheyeDescription)
    intrinsics = own.intrinsics()
    assert (intrinsics.fy, intrinsics.cx, intrinsics.cy, intrinsics.k) == (30, 49.5, 39.5, (0, 0, 0, 0))
    rig = own.rig_sensor("cam")
    assert isinstance(rig, FisheyeSensor)
    assert rig.topic == "/cam/image/compressed"


def test_a_camera_that_looks_along_y():
    pose = Mount(xyz=(1, 2, 3), yaw_deg=90).room_from_optical()
    np.testing.assert_allclose(pose.rotation, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    np.testing.assert_array_equal(pose.translation, [1, 2, 3])


def test_angles_turn_the_way_they_say():
    np.testing.assert_allclose(
        Mount(xyz=(0, 0, 0), yaw_deg=90).room_from_housing().rotation[:, 0], [0, 1, 0], atol=1e-12
    )
    down = Mount(xyz=(0, 0, 0), yaw_deg=90, pitch_deg=30).room_from_housing().rotation[:, 0]
    np.testing.assert_allclose(down, [0, np.cos(np.pi / 6), -0.5], atol=1e-12)
    rolled = Mount(xyz=(0, 0, 0), roll_deg=90).room_from_housing().rotation
    np.testing.assert_allclose(rolled[:, 1], [0, 0, 1], atol=1e-12)  # y left turns up
    straight_down = Mount(xyz=(0, 0, 3), yaw_deg=90, pitch_deg=90).room_from_optical().rotation
    np.testing.assert_allclose(straight_down, [[1, 0, 0], [0, -1, 0], [0, 0, -1]], atol=1e-9)


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize("angles", [(0, 0, 90), (37, 0, -90), (10, 20, 30), (90, 90, 0), (200, -50, 170)])
def test_the_optical_frame_is_the_housing_s_seen_otherwise(angles: tuple[float, float, float]):
    yaw, pitch, roll = angles
    mount = Mount(xyz=(0, 0, 0), yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
    housing, optical = mount.room_from_housing().rotation, mount.room_from_optical().rotation
    np.testing.assert_allclose(optical[:, 2], housing[:, 0], atol=1e-7)
    np.testing.assert_allclose(optical[:, 0], -housing[:, 1], atol=1e-7)
    np.testing.assert_allclose(optical[:, 1], -housing[:, 2], atol=1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LASER.replace("10", "-10"), r"sensors.one.rate_hz: .*greater than or equal to 0.001 is expected \(got -10\)"),
        (
            LASER + "noise: wrose",
            r"noise: no preset of this name; did you mean 'worse'\? valid are off, default, worse, hokuyo .* \(got 'wrose'\)",
        ),
        (LASER + "noise: on", "noise: a mapping with "),
        (LASER + "noise: {sigma: 1}", "noise.sigma: unknown key; did you mean 'sigma_m'"),
        (LASER + "range_min_m: 9", "range_min_m 9 must be below range_max_m 8"),
        (LASER + "resolution_deg: 0.7", "resolution_deg 0.7 does not divide field_of_view_deg 180"),
        (LASER + "resolution_deg: 1\nbeams: 181", "both given"),
        (LASER + "sweep_time_s: 0.2", "sweep_time_s 0.2 is longer than the period"),
        (LASER + "dropout: 1.5", "dropout: .*less than or equal to 1"),
        (LASER + "size: [3, 3]", "sensors.one.size: unknown key"),
        (LASER + "role: ankle", "role: 'waist' or 'knee' is expected"),
        ("rate_hz: 10", "sensors.one.kind: is missing; one of laser, fisheye"),
        ("kind: radar", "sensors.one.kind: 'radar' is not known; valid are laser, fisheye"),
        (FISHEYE + "lens: fisheye_eye", "lens: no preset of this name; valid are equidistant_185, opencv_test_lens"),
        (FISHEYE + "lens: {width: 9, height: 9, fx: 4, field_of_view_deg: 300}", "less than or equal to 240"),
        (
            FISHEYE + "lens: {width: 9, height: 9, fx: 4, k: [-0.3, 0, 0, 0], field_of_view_deg: 180}",
            r"folds back 60\.\d° from the axis; a field of view below 120\.\d+° is valid",
        ),
        (FISHEYE + "lens: {width: 9, height: 9, fx: 0, field_of_view_deg: 90}", "lens.fx: .*greater than 0"),
        (FISHEYE + "size: [0, 600]", "size.0: .*greater than 0"),
        (FISHEYE + "size: [9000, 600]", r"size\.0: .*less than or equal to 8192"),
        (FISHEYE.replace("xyz", "xzy"), "mount.xzy: unknown key; did you mean 'xyz'"),
        (FISHEYE.replace("1.2", ".nan"), "mount.xyz.2: .*finite number"),
    ],
)
def test_errors_name_the_field_and_what_would_be_valid(text: str, message: str):
    with pytest.raises(InputError, match=message):
        read(text)


def test_the_schema_offers_the_names():
    schema = str(TypeAdapter(SensorDescription).json_schema())
    for name in ("worse", "opencv_test_lens", "sigma_m", "field_of_view_deg"):
        assert name in schema
