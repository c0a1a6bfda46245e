"""Cameras as a scenario says them: every way to give a focal length, and what is refused, in one sentence."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from twin.scenario.sensor_descriptions import SensorDescription
from twin.sensors.camera import CAMERA_NOISE, STEREO_NOISE

CAMERA = {"kind": "camera", "mount": {"xyz": [0, 0, 2]}, "rate_hz": 20, "size": [320, 240], "field_of_view_deg": 70}
STEREO = CAMERA | {"kind": "stereo"}


class _Sensors(Strict):
    sensors: dict[str, SensorDescription]


def describe(content: dict):
    return TypeAdapter(SensorDescription).validate_python(content)


def refused(content: dict) -> str:
    with pytest.raises(InputError) as caught:
        validate(_Sensors, {"sensors": {"one": content}}, "scenario.yaml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith("scenario.yaml: sensors.one")
    return line


def without(content: dict, *names: str) -> dict:
    return {name: value for name, value in content.items() if name not in names}


def test_every_way_to_say_a_focal_length():
    by_field = describe(CAMERA).intrinsics()
    assert by_field.fx == by_field.fy == pytest.approx(160 / np.tan(np.deg2rad(35)))
    assert (by_field.cx, by_field.cy) == (159.5, 119.5)
    edges = by_field.unproject(np.array([[-0.5, 119.5], [319.5, 119.5]]))
    assert np.rad2deg(np.arctan(edges[:, 0])).tolist() == pytest.approx([-35, 35])
    by_height = describe(without(CAMERA, "field_of_view_deg") | {"vertical_field_of_view_deg": 59}).intrinsics()
    assert by_height.fx == pytest.approx(120 / np.tan(np.deg2rad(29.5)))
    given = describe(without(CAMERA, "field_of_view_deg") | {"fx": 300, "fy": 310, "cx": 100, "cy": 90}).intrinsics()
    assert (given.fx, given.fy, given.cx, given.cy) == (300, 310, 100, 90)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (without(CAMERA, "field_of_view_deg"), "none is given; one of field_of_view_deg"),
        (CAMERA | {"fx": 300}, "field_of_view_deg and fx are given"),
        (CAMERA | {"fy": 300}, "fy 300 is given without fx"),
        (CAMERA | {"size": [9000, 100]}, "a number less than or equal to 8192"),
        (CAMERA | {"distortion": {"k1": -0.9}}, "folds back inside the 320 x 240 picture"),
        (CAMERA | {"distortion": {"k4": 0.1}}, "valid here: k1, k2, k3, p1, p2"),
        (CAMERA | {"field_of_view_deg": 175}, "a fisheye sees farther"),
        (CAMERA | {"noise": "loud"}, "valid are off, default, worse"),
        (CAMERA | {"white_balance": [1, 0, 1]}, "greater than 0"),
        (CAMERA | {"motion_blur": {"exposure_s": 0.0}}, "greater than 0"),
        (STEREO | {"baseline_m": 0}, "greater than 0 is expected (got 0)"),
        (STEREO | {"baseline_m": -0.1}, "greater than 0 is expected (got -0.1)"),
        (STEREO | {"range_min_m": 3, "range_max_m": 2}, "range_min_m 3 must be below range_max_m 2"),
        (STEREO | {"range_min_m": 0.05}, r"range_min_m 0.05 is too near to be in both views; from 0.086 on is valid"),
        (STEREO | {"range_max_m": 80}, "less than or equal to 65"),
        (STEREO | {"matching": {"block_px": 4}}, "block_px 4 has no middle"),
        (STEREO | {"matching": {"smooth": 40}}, "jump 32 is not above smooth 40"),
        (STEREO | {"mode": "magic"}, "'matched', 'ideal' or 'disparity-noise'"),
        (STEREO | {"distortion": {"k1": 0.1}}, "unknown key"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(content: dict, said: str):
    assert said in refused(content)


def test_exposure_and_white_balance_come_on_top_of_the_noises():
    camera = describe(CAMERA | {"noise": "worse", "exposure": 0.5, "white_balance": [2, 1, 1]})
    assert camera.electronics.exposure_gain == pytest.approx(0.35)
    assert camera.electronics.white_balance == (2, 1, 1)
    assert camera.electronics.shot == CAMERA_NOISE["worse"].shot
    deep = describe(STEREO | {"noise": "default", "exposure": 2})
    assert deep.electronics.exposure_gain == 2
    assert deep.electronics.disparity_sigma_px == STEREO_NOISE["default"].disparity_sigma_px
