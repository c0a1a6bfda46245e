"""Numbers that a field's type allows and no room does: refused in one sentence, or made sense of."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackers.errors import InputError
from trackers.rig import Rig
from twin.scenario import load_scenario
from twin.world.simulation import Simulation

SCENARIO = """
name: small
room: sensing_room
duration_s: 0.3
people: {ann: {start: [0, 0.5], script: {kind: stand}}}
housings: {deep: {mount: {xyz: [0, 0, -2]}}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [-2.3, -1.9, 0.95], yaw_deg: 40}}
  eye: {kind: camera, rate_hz: 10, size: [64, 48], field_of_view_deg: 60, mount: {xyz: [-2.3, -1.9, 2], yaw_deg: 40}}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("sensors.waist.mount.xyz=[0, 0, -3]", "sensors.waist.mount.xyz: hangs 3 m below the floor of the room"),
        ("sensors.eye.mount.xyz=[0, 0, -3]", "sensors.eye.mount.xyz: hangs 3 m below the floor of the room"),
        ("sensors.waist.housing=deep", "sensors.waist.mount.xyz: hangs 1.05 m below the floor"),
        ("sensors.waist.mount.pitch_deg=90", "sensors.waist.role: a waist scanner scans level, and this one is tilted by 90°"),
        ("sensors.waist.mount.roll_deg=60", "tilted by 60°; at most 45°, or no role, is valid"),
        ("sensors.waist.calibration_error={rpy_deg: [0, 80, 0]}", "sensors.waist.calibration_error: role: .*tilted by 80°"),
        ("sensors.waist.calibration_error={xyz: [0, 0, -2]}", r"room_from_sensor: hangs 1\.05 m below the floor"),
        ("sensors.waist.calibration_error={xyz: [1e308, 0, 0]}", "calibration_error.xyz.0: .*less than or equal to 1000 is"),
        ("sensors.waist.calibration_error={xyz: [1e5, 0, 0]}", r"error\.xyz\.0: a number less than or equal to 1000 is expected"),
        ("sensors.waist.mount.xyz=[1e200, 0, 1]", "mount.xyz.0: .*less than or equal to 100000000"),
        ("sensors.waist.rate_hz=1e-9", "rate_hz: .*greater than or equal to 0.001"),
        ("sensors.waist.resolution_deg=1e-320", "does not divide field_of_view_deg 180"),
        ("people.ann.start=[1e308, 0]", "people.ann.start.0: .*less than or equal to 100000000"),
        ("people.ann.script={kind: path, points: [[0, 0, 0], [1e300, 0, 0]]}", "points.1.0: .*less than or equal to"),
    ],
)  # fmt: skip
def test_nonsense_is_refused_by_its_field(path: Path, override: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        load_scenario(path, [override])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "overrides",
    [
        ["sensors.waist.mount.pitch_deg=90", "sensors.waist.role=null"],
        ["sensors.waist.mount.pitch_deg=30"],
        ["sensors.waist.mount.roll_deg=180"],  # upside down is level too
        ["sensors.waist.mount.xyz=[0, 0, 0]"],
    ],
)
def test_what_a_room_allows_stays_allowed(path: Path, overrides: list[str]) -> None:
    assert load_scenario(path, overrides).sensors["waist"]


@pytest.mark.parametrize("field_of_view_deg", [0.24, 0.2, 1e-9])
def test_a_scanner_of_a_tiny_field_of_view_has_two_beams(path: Path, field_of_view_deg: float) -> None:
    scenario = load_scenario(path, [f"sensors.waist.field_of_view_deg={field_of_view_deg}", "sensors.eye=null"])
    with Simulation(scenario) as simulation:
        scans = [delivered.observation for delivered in simulation.deliveries()]
    assert [len(scan.ranges_m) for scan in scans] == [2, 2, 2]  # pyright: ignore[reportAttributeAccessIssue]


def test_a_rig_is_held_to_the_same() -> None:
    rig = (
        "sensors: {low: {topic: /scan, kind: laser, role: knee, room_from_sensor: {xyz: [0, 0, %s], rpy: [0, %s, 0]}}}"
    )
    assert Rig.parse(rig % (0.4, 0.1), "rig.yaml").sensors
    with pytest.raises(InputError, match=r"rig\.yaml: sensors\.low: role: a knee scanner scans level"):
        Rig.parse(rig % (0.4, 1.5), "rig.yaml")
    with pytest.raises(InputError, match="room_from_sensor: hangs 3 m below the floor"):
        Rig.parse(rig % (-3, 0), "rig.yaml")
    with pytest.raises(InputError, match=r"room_from_sensor\.xyz\.2: .*finite number"):
        Rig.parse(rig % (".inf", 0), "rig.yaml")
