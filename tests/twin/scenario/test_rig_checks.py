"""A rig is held to every check of a scenario that speaks of what a rig says: each bad value is refused on both paths."""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
import yaml

from trackers.errors import InputError
from trackers.rig import Rig
from twin.scenario import load_scenario
from twin.scenario.housings import assumed_rig

SCENARIO = """
name: all-kinds
room: lab
duration_s: 1
area: [[-1, 0.6], [1, 0.6], [1, 2.8], [-1, 2.8]]
people: {}
main_sensor: waist
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, 0, 0.95], yaw_deg: 90}}
  eye: {kind: fisheye, rate_hz: 10, mount: {xyz: [0, 0, 1], yaw_deg: 90}, size: [300, 300],
        lens: {width: 300, height: 300, fx: 95, fy: 95, field_of_view_deg: 185, k: [0, 0, 0, 0]}}
  cam: {kind: camera, rate_hz: 10, mount: {xyz: [0, 0, 2], yaw_deg: 90}, size: [64, 48], fx: 60, fy: 60, cx: 32, cy: 24,
        distortion: {k1: 0.1, k2: 0, p1: 0, p2: 0, k3: 0}}
  deep: {kind: stereo, rate_hz: 10, mount: {xyz: [0, 0, 2], yaw_deg: 90}, size: [64, 48], fx: 60, baseline_m: 0.12}
  floor: {kind: floor, rate_hz: 10, mount: {xyz: [-1, 0.6, 0]}, rows: 4, columns: 5, pitch_m: 0.2,
          curve: {half_scale_n: 200, exponent: 0.9, threshold_n: 5, saturation_n: 1422}}
"""
Change = tuple[str, Any]
"""A field by its path, and what it is set to; None takes it out."""


def alike(path: str, value: Any, said: str) -> tuple[Change, Change, str]:
    """Return a change that is said in the same words on both paths."""
    return (path, value), (path, value), said


SIZE = [9000, 48]
TILTED_RAD = float(np.deg2rad(80))
BOTH: dict[str, tuple[Change, Change, str]] = {
    **{
        f"{name} below the floor": (
            (f"sensors.{name}.mount.xyz", [0, 0, -1]),
            (f"sensors.{name}.room_from_sensor.xyz", [0, 0, -1]),
            "hangs 1 m below the floor",
        )
        for name in ("waist", "eye", "cam", "deep")
    },
    **{
        f"{name} far away": (
            (f"sensors.{name}.mount.xyz", [0, 1e9, 0]),
            (f"sensors.{name}.room_from_sensor.xyz", [0, 1e9, 0]),
            "xyz.1: .*less than or equal to 100000000",
        )
        for name in ("waist", "eye", "cam", "deep", "floor")
    },
    **{
        f"{name} turned without end": (
            (f"sensors.{name}.mount.yaw_deg", turn),
            (f"sensors.{name}.room_from_sensor.rpy", [0, 0, turn]),
            "less than or equal to (360|100000000)|more than one turn",
        )
        for name, turn in (("waist", 1e300), ("eye", 540.0), ("cam", 1e300), ("deep", 1e6), ("floor", 400.0))
    },
    "an angle in degrees": (
        ("sensors.waist.mount.yaw_deg", 5400.0),
        ("sensors.waist.room_from_sensor.rpy", [0, 0, -90]),
        "less than or equal to 360|-90 rad is more than one turn; in degrees it would be -1.571 rad",
    ),
    "ten degrees as radians": (
        ("sensors.waist.mount.yaw_deg", -361.0),
        ("sensors.waist.room_from_sensor.rpy", [0, 10.0, 0]),
        "greater than or equal to -360|10 rad is more than one turn; in degrees it would be 0.1745 rad",
    ),
    "a tilted scanner": (
        ("sensors.waist.mount.pitch_deg", 80),
        ("sensors.waist.room_from_sensor.rpy", [0, TILTED_RAD, 0]),
        "role: a waist scanner scans level, and this one is tilted by 80°",
    ),
    "a role that is none": (("sensors.waist.role", "hip"), ("sensors.waist.role", "hip"), "'waist' or 'knee'"),
    "a kind that is none": (("sensors.waist.kind", "radar"), ("sensors.waist.kind", "radar"), "'radar' is not known"),
    "an unknown key": (("sensors.waist.colour", 1), ("sensors.waist.colour", 1), "unknown key"),
    **{
        f"a sensor called {name!r}": (
            (f"sensors|{name}", "waist"),
            (f"sensors|{name}", "waist"),
            "a letter first, is expected|at most 100",
        )
        for name in ("", "two words", "a,b", "a+b", "a/b", "1", "ä", "x" * 101)
    },
    "no sensors": (("sensors", {}), ("sensors", {}), "sensors is empty"),
    "a main sensor that is none": (("main_sensor", "top"), ("main", "top"), "'top'.* is no sensor"),
    "a fisheye that folds": (
        ("sensors.eye.lens.k", [-0.3, 0, 0, 0]),
        ("sensors.eye.intrinsics.k", [-0.3, 0, 0, 0]),
        "the picture folds back 60.4° from the axis",
    ),
    "a fisheye beside its picture": (
        ("sensors.eye.lens.cx", 900),
        ("sensors.eye.intrinsics.cx", 900),
        r"no light falls on the 300 x 300 picture with the principal point \[900, 149.5\]",
    ),
    "a fisheye of more than a turn": (
        ("sensors.eye.lens.field_of_view_deg", 400),
        ("sensors.eye.intrinsics.field_of_view_rad", 7),
        "field_of_view",
    ),
    "a fisheye without a field": (
        ("sensors.eye.lens.field_of_view_deg", 0),
        ("sensors.eye.intrinsics.field_of_view_rad", 0),
        "field_of_view.*: .*greater than 0",
    ),
    "a pinhole that folds": (
        ("sensors.cam.distortion.k1", -5),
        ("sensors.cam.intrinsics.distortion", [-5, 0, 0, 0, 0]),
        "folds back inside the 64 x 48 picture",
    ),
    **{
        f"{name} of far too wide a view": (
            (f"sensors.{name}.fx", 0.3),
            (f"sensors.{name}.intrinsics.fx", 0.3),
            "from the camera's axis; at most 82.875° is valid, a fisheye sees farther",
        )
        for name in ("cam", "deep")
    },
    **{
        f"{name} with its principal point elsewhere": (
            (f"sensors.{name}.cx", 1e6),
            (f"sensors.{name}.intrinsics.cx", 1e6),
            "from the camera's axis|folds back",
        )
        for name in ("cam", "deep")
    },
    **{
        f"{name} of a picture too large": (
            (f"sensors.{name}.size", SIZE),
            (f"sensors.{name}.intrinsics.width", 9000),
            "8192",
        )
        for name in ("eye", "cam", "deep")
    },
    **{
        f"{name} without a picture": (
            (f"sensors.{name}.size", [0, 48]),
            (f"sensors.{name}.intrinsics.width", 0),
            "greater than 0",
        )
        for name in ("eye", "cam", "deep")
    },
    **{
        f"{name} of focal length {value}": (
            (f"sensors.{name}.{lens}fx", value),
            (f"sensors.{name}.intrinsics.fx", value),
            "fx: .*(greater than 0|finite number)",
        )
        for name, lens in (("eye", "lens."), ("cam", ""), ("deep", ""))
        for value in (0, -60, float("inf"), float("nan"))
    },
    **{
        f"a baseline of {value} m": alike(
            "sensors.deep.baseline_m",
            value,
            "baseline_m: .*(than|finite)",
        )
        for value in (0, -0.1, 120, float("inf"))
    },
    "a mode that is none": alike(
        "sensors.deep.mode",
        "magic",
        "'matched', 'ideal' or 'disparity-noise'",
    ),
    **{
        f"{rows} rows and {columns} columns": (
            ("sensors.floor", {"rows": rows, "columns": columns}),
            ("sensors.floor", {"rows": rows, "columns": columns}),
            "greater than 0|40000 are valid|integer",
        )
        for rows, columns in ((0, 5), (4, -1), (4, 100_000), (2.5, 4))
    },
    **{
        f"elements of {value} m": alike(
            "sensors.floor.pitch_m",
            value,
            "pitch_m: .*(than|finite)",
        )
        for value in (0, 0.001, 200, float("nan"))
    },
    "a floor in the air": (
        ("sensors.floor.mount.xyz", [0, 0, 1]),
        ("sensors.floor.room_from_sensor.xyz", [0, 0, 1]),
        "floor.*z = 0",
    ),
    "a force curve without a rise": (
        ("sensors.floor.curve.threshold_n", 2000),
        ("sensors.floor.curve.threshold_n", 2000),
        "threshold_n 2000 must be below saturation_n",
    ),
    "a force curve of no exponent": alike(
        "sensors.floor.curve.exponent",
        0,
        "exponent: .*greater than 0",
    ),
    "an area of two corners": alike(
        "area",
        [[0, 0], [1, 1]],
        "area: has 2 corners; a polygon needs at least 3",
    ),
    "an area that crosses itself": (
        ("area", [[-1, 0.6], [1, 0.6], [-1, 2.8], [1, 2.8]]),
        ("area", [[-1, 0.6], [1, 0.6], [-1, 2.8], [1, 2.8]]),
        r"area: .* crosses or touches itself at \[0, 1\.7\]; .* are expected",
    ),
    "an area with a corner twice": (
        ("area", [[-1, 0.6], [1, 0.6], [1, 2.8], [-1, 0.6]]),
        ("area", [[-1, 0.6], [1, 0.6], [1, 2.8], [-1, 0.6]]),
        r"area: .* crosses or touches itself at \[-1, 0\.6\]",
    ),
    "an area on a line": alike(
        "area",
        [[0, 0], [1, 1], [2, 2]],
        "area: .* crosses or touches itself",
    ),
    "an area of too many corners": (
        ("area", [[float(np.cos(a)), float(np.sin(a)) + 2] for a in np.linspace(0, 6, 600)]),
        ("area", [[float(np.cos(a)), float(np.sin(a)) + 2] for a in np.linspace(0, 6, 600)]),
        "area: a length of 500 or less is expected",
    ),
}

BELIEVED: dict[str, tuple[str, dict[str, Any], str]] = {
    "a scanner below the floor": ("waist", {"xyz": [0, 0, -2]}, "hangs 1.05 m below the floor"),
    "a camera below the floor": ("cam", {"xyz": [0, 0, -3]}, "hangs 1 m below the floor"),
    "a scanner that is tilted": ("waist", {"rpy_deg": [0, 80, 0]}, "tilted by 80°"),
    "a view far too wide": ("deep", {"focal_scale": 0.1, "principal_px": [20, 0]}, "from the camera's axis"),
    "a fisheye beside its picture": ("eye", {"principal_px": [900, 0]}, "no light falls on the 300 x 300 picture"),
}
"""What a scenario may not have trackers believe, as no rig could say it."""


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], dict[str, Any]]:
    path = tmp_path_factory.mktemp("scenario") / "all-kinds.yaml"
    path.write_text(SCENARIO)
    scenario = load_scenario(path)
    area = scenario.area
    assert area is not None
    return yaml.safe_load(SCENARIO), yaml.safe_load(assumed_rig(scenario, area).dump_yaml())


def changed(content: dict[str, Any], change: Change) -> str:
    path, value = change
    content = deepcopy(content)
    if "|" in path:  # another name for a sensor
        content["sensors"][path.partition("|")[2]] = content["sensors"].pop(value)
        content = {key: each for key, each in content.items() if each != value}  # the main sensor
        return yaml.safe_dump(content)
    *above, last = path.split(".")
    at = content
    for part in above:
        at = at[part]
    at[last] = at.get(last, {}) | value if isinstance(value, dict) and value else value
    return yaml.safe_dump(content)


def refusal(call: Any) -> str:
    with pytest.raises(InputError) as caught:
        call()
    told = str(caught.value)
    for line in told.splitlines():
        assert "yaml: " in line and "pydantic" not in line and "Traceback" not in line, told
    return told


@pytest.mark.parametrize(("in_scenario", "in_rig", "said"), BOTH.values(), ids=BOTH.keys())
def test_what_a_scenario_refuses_a_rig_refuses_too(contents, tmp_path, in_scenario, in_rig, said):
    scenario, rig = contents
    path = tmp_path / "scenario.yaml"
    path.write_text(changed(scenario, in_scenario))
    assert_said(refusal(lambda: load_scenario(path)), said)
    assert_said(refusal(lambda: Rig.parse(changed(rig, in_rig), "rig.yaml")), said)


def assert_said(told: str, said: str) -> None:
    assert any(re.search(said, line) for line in told.splitlines()), told


def numbers(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths of all numbers."""
    for key, each in content.items() if isinstance(content, dict) else enumerate(content):
        if isinstance(each, dict | list):
            yield from numbers(each, (*path, key))
        elif isinstance(each, int | float):
            yield (*path, key)


@pytest.mark.sample(4)
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), "many", [1, 2]], ids=str)
@pytest.mark.parametrize("which", ["scenario", "rig"])
def test_no_number_may_be_anything_but_a_number(contents, tmp_path, which, value):
    content = contents[which == "rig"]
    paths = list(numbers(content))
    assert len(paths) > 30
    for path in paths:
        spoiled = deepcopy(content)
        at = spoiled
        for part in path[:-1]:
            at = at[part]
        at[path[-1]] = value
        file = tmp_path / f"{which}.yaml"
        file.write_text(yaml.safe_dump(spoiled))
        told = refusal(lambda file=file: load_scenario(file) if which == "scenario" else Rig.load(file))
        assert str(path[0]) in told, (path, told)


@pytest.mark.parametrize(("sensor", "believed", "said"), BELIEVED.values(), ids=BELIEVED.keys())
def test_trackers_are_told_nothing_that_a_rig_cannot_say(contents, tmp_path, sensor, believed, said):
    path = tmp_path / "scenario.yaml"
    path.write_text(changed(contents[0], (f"sensors.{sensor}.calibration_error", believed)))
    assert_said(refusal(lambda: load_scenario(path)), rf"sensors\.{sensor}\.calibration_error: .*({said})")


@pytest.mark.parametrize("topic", ["/waist/scan", "waist/scan", "waist/scan/"])
@pytest.mark.parametrize("field", ["floor.topic", "deep.topic", "deep.depth_topic"])
def test_two_sensors_on_one_topic_are_refused(contents, topic, field):
    told = refusal(lambda: Rig.parse(changed(contents[1], (f"sensors.{field}", topic)), "rig.yaml"))
    assert_said(told, r"rig\.yaml: sensors\.\w+\.(depth_)?topic is '.*', as is that of '\w+'; a topic of its own")


@pytest.mark.parametrize("topic", ["", "/", " ", "/two words"])
def test_a_topic_needs_a_name(contents, topic):
    refusal(lambda: Rig.parse(changed(contents[1], ("sensors.waist.topic", topic)), "rig.yaml"))


@pytest.mark.parametrize("offset_s", [1.7e9, -1.7e9])
def test_clocks_may_differ_by_epochs_and_no_more(contents, offset_s):
    rig = Rig.parse(changed(contents[1], ("sensors.waist.time_offset_s", offset_s)), "rig.yaml")
    assert rig.sensors["waist"].time_offset_s == offset_s
    refusal(lambda: Rig.parse(changed(contents[1], ("sensors.waist.time_offset_s", 9 * offset_s)), "rig.yaml"))


@pytest.mark.parametrize("rpy", [[0.3, 0, 0], [0, -0.3, 0], [1.5, 0, 2]])
def test_a_floor_lies_level(contents, rpy):
    told = refusal(lambda: Rig.parse(changed(contents[1], ("sensors.floor.room_from_sensor.rpy", rpy)), "rig.yaml"))
    assert "does not lie in the room's floor" in told


def test_a_floor_may_count_its_rows_the_other_way(contents):
    rig = Rig.parse(changed(contents[1], ("sensors.floor.room_from_sensor.rpy", [3.1415926536, 0, 0])), "rig.yaml")
    (x, y), (_, other_y) = rig.floors()["floor"].centres[:2, 0]
    assert (x, y) == (pytest.approx(-0.9), pytest.approx(0.5)) and other_y < y


@pytest.mark.parametrize("angle_rad", [6.283, 6.2832, 6.28319, 2 * np.pi])
def test_a_full_turn_may_be_rounded(contents, angle_rad):
    text = changed(contents[1], ("sensors.eye.intrinsics.field_of_view_rad", angle_rad))
    lens = Rig.parse(text, "rig.yaml").sensors["eye"].intrinsics  # pyright: ignore[reportAttributeAccessIssue]
    assert lens.field_of_view_rad == 2 * np.pi
    behind = np.array([[0.0, 0.0, -1.0], [1e-6, 0.0, -1.0]])
    assert not np.isnan(lens.project(behind)[0]).any()


@pytest.mark.parametrize("angle_rad", [6.2843, 7, 185])
def test_more_than_a_turn_is_refused(contents, angle_rad):
    text = changed(contents[1], ("sensors.eye.intrinsics.field_of_view_rad", angle_rad))
    assert_said(refusal(lambda: Rig.parse(text, "rig.yaml")), "field_of_view_rad: more than a full turn; .* radians")


def test_the_rig_of_a_scenario_is_a_rig(contents):
    rig = Rig.parse(yaml.safe_dump(contents[1]), "rig.yaml")  # so that each refusal is of its change alone
    assert yaml.safe_load(rig.dump_yaml()) == contents[1]
