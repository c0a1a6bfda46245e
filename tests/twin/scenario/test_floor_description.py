"""A floor as written in a scenario, and what is said of one that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from trackers.configuration import Strict, validate
from trackers.errors import InputError
from trackers.rig import FloorSensor
from twin.scenario.sensor_descriptions import FloorDescription, SensorDescription, check_floor
from twin.sensors.floor_electronics import FLOOR_ELECTRONICS, FloorElectronics


class Sensors(Strict):
    sensors: dict[str, SensorDescription]


def read(text: str = "") -> FloorDescription:
    content = {"kind": "floor", **(yaml.safe_load(text) or {})}
    floor = validate(Sensors, {"sensors": {"one": content}}, "test.yaml").sensors["one"]
    assert isinstance(floor, FloorDescription)
    return floor


def test_the_papers_floor_by_default():
    floor = read()
    assert floor.rows * floor.columns == 252 and floor.pitch_m == 0.2 and floor.rate_hz == 10
    assert floor.noise == FLOOR_ELECTRONICS["default"]
    rig = floor.rig_sensor("floor")
    assert isinstance(rig, FloorSensor) and rig.topic == "/floor/floor"
    np.testing.assert_allclose(rig.corners, [(0, 0), (3.6, 0), (3.6, 2.8), (0, 2.8)])
    assert rig.curve.saturation_n == pytest.approx(10 * 9.80665 * 14.5, rel=1e-3)  # 10 kg/cm² on 14.5 cm²


def test_noise_by_name_by_parameters_and_off():
    assert read("noise: worse").noise == FLOOR_ELECTRONICS["worse"]
    assert read("noise: {crosstalk: 0.3}").noise == FloorElectronics(crosstalk=0.3)
    assert read("noise: off").noise.is_off
    assert read("noise: {dead_cells: [[0, 1], [13, 17]]}").noise.dead_cells == ((0, 1), (13, 17))


def test_a_resolved_floor_reads_back_the_same():
    for text in (
        "",
        "noise: off",
        "mount: {xyz: [-1, 2, 0], yaw_deg: 30}\nnoise: {stuck_cells: [[0, 1, 200]]}\ncurve: {exponent: 1}",
    ):
        floor = read(text)
        assert read(yaml.safe_dump(floor.model_dump(mode="json", exclude_none=True))) == floor


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pitch_m: 0", r"one.pitch_m: .*greater than or equal to 0.01 is expected \(got 0\)"),
        ("pitch_m: -0.2", "pitch_m: .*greater than or equal to 0.01"),
        ("pitch_m: .nan", "pitch_m"),
        ("rows: 0", "rows: .*greater than 0"),
        ("rows: 300\ncolumns: 200", "rows 300 x columns 200 are 60000 elements; at most 40000 are valid"),
        ("mount: {xyz: [0, 0, 0.1]}", "xyz has z = 0.1; the sensing elements lie in the room's floor, z = 0 is valid"),
        ("mount: {xyz: [0, 0, 0], pitch_deg: 3}", "mount.pitch_deg: unknown key"),
        ("noise: wrose", "noise: no preset of this name; did you mean 'worse'\\? valid are off, default, worse"),
        ("noise: {crosstalk: 2}", "noise.crosstalk: .*less than or equal to 0.8"),
        ("noise: {cross_talk: 0.1}", "noise.cross_talk: unknown key; did you mean 'crosstalk'"),
        ("noise: {dead_cells: [[14, 0]]}", r"\[14, 0\] of a grid of 14 rows and 18 columns"),
        ("noise: {stuck_cells: [[0, 0, 300]]}", "stuck at 300; 0 to 255 is valid"),
        ("curve: {threshold_n: 5000}", "threshold_n 5000 must be below saturation_n 1422"),
        ("beams: 3", "one.beams: unknown key"),
    ],
)
def test_errors_name_the_field_and_what_would_be_valid(text: str, message: str):
    with pytest.raises(InputError, match=message):
        read(text)


ROOM = np.array([(-0.5, -0.5), (4.0, -0.5), (4.0, 3.0), (-0.5, 3.0)])


def test_a_grid_in_the_room():
    check_floor(read(), ROOM, "sensors.floor")
    check_floor(
        read("rows: 15\ncolumns: 20"), np.array([(0, 0), (4, 0), (4, 3), (0, 3)]), "sensors.floor"
    )  # to the walls


@pytest.mark.parametrize(
    "text", ["columns: 24", "rows: 20", "mount: {xyz: [1, 0, 0]}", "mount: {xyz: [0, 0, 0], yaw_deg: 30}", "pitch_m: 1"]
)
def test_a_grid_larger_than_the_room(text: str):
    with pytest.raises(
        InputError, match=r"^sensors\.floor: a grid of .* is outside the room at \[.*\]; .* is valid.* x -0\.5 to 4 m"
    ):
        check_floor(read(text), ROOM, "sensors.floor")


def test_a_room_with_a_corner_cut_out():
    bent = np.array([(0, 0), (4, 0), (4, 1), (3, 1), (3, 3), (0, 3)])
    with pytest.raises(InputError, match="outside the room"):
        check_floor(read(), bent, "sensors.floor")
