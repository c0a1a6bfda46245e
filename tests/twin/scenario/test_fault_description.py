"""Faults, housings and beliefs as written in a scenario, and what is said of those that cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin import models
from twin.scenario import Scenario, load_scenario
from twin.scenario.load import dump_scenario
from twin.sensors.fault_kinds import FAULT_KINDS, DeadBeams, Dropout


def lab(*changes: str) -> Scenario:
    return load_scenario("lab-five-people", changes)


def test_a_fault_names_one_sensor_or_several() -> None:
    faults = lab(
        "faults.one={sensor: waist, kind: dropout}", "faults.two={sensor: [waist, knee], kind: dead_beams, share: 0.1}"
    ).faults
    one, two = faults["one"], faults["two"]
    assert isinstance(one, Dropout)
    assert (one.sensor, one.probability, one.from_s, one.to_s) == (("waist",), 1.0, 0.0, None)
    assert isinstance(two, DeadBeams)
    assert two.sensor == ("waist", "knee")


def test_it_holds_from_its_first_moment_up_to_its_last() -> None:
    fault = lab("faults.a={sensor: waist, kind: freeze, from_s: 0.3, to_s: 0.6}").faults["a"]
    assert [fault.holds(k * 100_000_000) for k in range(8)] == [False] * 3 + [True] * 3 + [False] * 2
    assert lab("faults.a={sensor: waist, kind: freeze}").faults["a"].holds(10**15)


def test_faults_of_a_parent_are_changed_and_removed_by_name(tmp_path: Path) -> None:
    child = tmp_path / "child.yaml"
    child.write_text("extends: lab-faults\nname: child\nfaults:\n  knee_frozen: {to_s: 12.5}\n  dirt: null\n")
    parent, own = load_scenario("lab-faults"), load_scenario(child)
    assert own.faults["knee_frozen"].to_s == 12.5
    assert own.faults["knee_frozen"].from_s == parent.faults["knee_frozen"].from_s
    assert parent.faults.keys() - own.faults.keys() == {"dirt"}


def test_the_shipped_scenario_resolves_and_has_a_fault_of_every_kind_for_its_sensors(tmp_path: Path) -> None:
    shipped = load_scenario("lab-faults")
    assert {fault.kind for fault in shipped.faults.values()} == FAULT_KINDS.keys() - {"dead_cells"}
    (tmp_path / "again.yaml").write_text(dump_scenario(shipped))
    assert load_scenario(tmp_path / "again.yaml") == shipped


def test_every_kind_is_listed_and_in_the_schema() -> None:
    assert models.FAULTS.keys() == FAULT_KINDS.keys()
    schema = json.dumps(Scenario.model_json_schema())
    assert all(kind in schema for kind in FAULT_KINDS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "faults.a={sensor: wasit, kind: freeze}",
            "faults.a.sensor: 'wasit' is not one of the sensors; did you mean 'waist'\\? valid are waist, ",
        ),
        ("faults.a={sensor: [waist, nose], kind: freeze}", "faults.a.sensor: 'nose' is not one of the sensors"),
        (
            "faults.a={sensor: waist, kind: occlusion}",
            "faults.a.kind: 'occlusion' does not fit sensor 'waist', a laser; valid for it are dropout, freeze, delay, "
            "clock, blocked_sector, dead_beams",
        ),
        ("faults.a={sensor: fisheye, kind: dead_beams, share: 0.1}", "does not fit sensor 'fisheye', a fisheye"),
        ("faults.a={sensor: knee, kind: dead_cells, share: 0.1}", "does not fit sensor 'knee', a laser"),
        ("faults.a={sensor: waist, kind: melt}", "faults.a.kind: 'melt' is not known; valid are dropout, freeze"),
        ("faults.a={sensor: waist, kind: freeze, from_s: 5, to_s: 2}", "to_s 2 is not after from_s 5; a later time"),
        ("faults.a={sensor: waist, kind: freeze, from_s: 5, to_s: 5}", "to_s 5 is not after from_s 5"),
        ("faults.a={sensor: waist, kind: freeze, from_s: -1}", "from_s: .*greater than or equal to 0"),
        ("faults.a={sensor: waist, kind: freeze, from: 1}", "from: unknown key; did you mean 'from_s'"),
        ("faults.a={sensor: [], kind: freeze}", "sensor: .*a length of 1 or more"),
        ("faults.a={kind: freeze}", r"sensor: is missing \(name of the sensor at fault"),
        ("faults.a={sensor: waist, kind: dropout, probability: 1.5}", "probability: .*less than or equal to 1"),
        ("faults.a={sensor: waist, kind: dropout, probability: 0}", "probability: .*greater than 0"),
        ("faults.a={sensor: waist, kind: delay}", "delay_s and jitter_s are both 0"),
        ("faults.a={sensor: waist, kind: clock}", "offset_s and drift_ppm are both 0"),
        ("faults.a={sensor: waist, kind: clock, drift_ppm: -2e6}", "drift_ppm: .*greater than or equal to -100000"),
        ("faults.a={sensor: fisheye, kind: occlusion, at: [0.5, 1.5]}", "at.1: .*less than or equal to 1"),
        ("faults.a={sensor: fisheye, kind: occlusion, size: 0}", "size: .*greater than 0"),
        ("faults.a={sensor: waist, kind: blocked_sector, bearings_deg: [20, 10]}", r"\[20.0, 10.0\] do not rise"),
        ("faults.a={sensor: waist, kind: blocked_sector, bearings_deg: [95, 99]}", "outside .*; -90 to 90 is valid"),
        ("faults.a={sensor: waist, kind: blocked_sector, bearings_deg: [0, 9], at_m: 8}", "below 8 is valid"),
        ("faults.a={sensor: waist, kind: dead_beams}", r"names no beam; beams: \[\[40, 44\]\]"),
        (
            "faults.a={sensor: waist, kind: dead_beams, beams: [[350, 361]]}",
            r"\[350, 361\]; the scanner's are 0 to 360",
        ),
        ("faults.a={sensor: waist, kind: dead_beams, beams: [[5, 2]]}", r"\[5, 2\], which goes down"),
        ("sensors.waist.housing=rig", "sensors.waist.housing: 'rig' is no housing; there is none under housings"),
        (
            "sensors.waist.calibration_error.focal_scale=1.1",
            "sensors.waist.calibration_error: focal_scale and principal_px are of cameras",
        ),
        (
            "sensors.fisheye.calibration_error.focal_scale=0",
            r"focal_scale: a number greater than or equal to 0\.1 is expected",
        ),
        ("sensors.waist.calibration_error.xzy=[1, 0, 0]", "calibration_error.xzy: unknown key; did you mean 'xyz'"),
        ("sensors.waist.calibration_error.xyz=[.inf, 0, 0]", "calibration_error.xyz.0: .*finite"),
        ("housings.rig.mount.yaw_deg=3", r"housings.rig.mount.xyz: is missing \(place"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(change: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        lab(change)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("faults.a={sensor: floor, kind: dead_cells}", "names no element"),
        (
            "faults.a={sensor: floor, kind: dead_cells, cells: [[14, 0]]}",
            r"cells has \[14, 0\]; .*\[13, 17\] are valid",
        ),
        ("faults.a={sensor: floor, kind: dead_cells, rows: [14]}", "rows has 14; the floor's are 0 to 13"),
        ("faults.a={sensor: floor, kind: dead_cells, columns: [18]}", "columns has 18; the floor's are 0 to 17"),
        ("faults.a={sensor: floor, kind: dead_cells, share: 0.1, reads: 300}", "reads: .*less than or equal to 255"),
        ("sensors.floor.housing=rig", "sensors.floor.housing: unknown key"),
        ("sensors.floor.calibration_error.xyz=[0, 0, 0.1]", "sensors.floor.calibration_error: a floor lies level"),
    ],
)
def test_what_a_floor_cannot_have(change: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_scenario("home-three-people", [change])


def test_an_unknown_housing_lists_those_there_are() -> None:
    with pytest.raises(
        InputError, match="sensors.waist.housing: 'rgi' is no housing; did you mean 'rig'\\? valid are rig, or none"
    ):
        lab("housings.rig.mount.xyz=[0, 0, 0]", "sensors.waist.housing=rgi")
