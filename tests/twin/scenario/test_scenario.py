"""Scenarios: what a user may write, and what they are told when it is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario

SMALL = """
name: small
room: lab
duration_s: 1.0
people:
  ann: {start: [0.0, 1.5], script: {kind: stand}}
sensors:
  waist: {kind: laser, role: waist, rate_hz: 10, mount: {xyz: [0, 0, 0.95], yaw_deg: 90}}
"""


def write(folder: Path, text: str, name: str = "small.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_resolved_scenario_reads_back_to_the_same(tmp_path: Path) -> None:
    scenario = load_scenario("lab-five-people")
    again = load_scenario(write(tmp_path, dump_scenario(scenario)))
    assert again == scenario


def test_overrides_go_through_the_same_checks(tmp_path: Path) -> None:
    path = write(tmp_path, SMALL)
    assert load_scenario(path, ["sensors.waist.rate_hz=20", "seed=7"]).sensors["waist"].rate_hz == 20
    assert load_scenario(path, ["people.ann.start=[0.5, 1.0]"]).people["ann"].start == (0.5, 1.0)
    with pytest.raises(InputError, match=r"sensors\.waist\.rate_hz"):
        load_scenario(path, ["sensors.waist.rate_hz=-1"])
    with pytest.raises(InputError, match=r"form path\.to\.field=value"):
        load_scenario(path, ["sensors.waist.rate_hz"])
    with pytest.raises(InputError, match="did you mean 'duration_s'"):
        load_scenario(path, ["duraton_s=3"])


def test_every_error_at_once_with_its_path(tmp_path: Path) -> None:
    path = write(tmp_path, SMALL.replace("duration_s: 1.0", "duration_s: -1").replace("rate_hz", "rate_herz"))
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert "duration_s" in message
    assert "rate_herz" in message
    assert "did you mean 'rate_hz'" in message
    assert str(path) in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: [", "not valid YAML"),
        ("- a list", "not a mapping"),
        ("name: a\nname: b\n", "stands twice"),
        ("extends: nowhere\n", "no scenario 'nowhere'"),
        ("extends: small.yaml\n", "extends itself"),
        ("extends: 3\n", "is not a name"),
        (SMALL.replace("room: lab", "room: labb"), "did you mean 'lab'"),
        (SMALL.replace("waist: {", "'wa ist': {"), "wa ist"),
        (SMALL.replace("kind: laser", "kind: sonar"), "sonar"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_scenario(write(tmp_path, text))


def test_a_chain_of_scenarios_without_end_is_refused(tmp_path: Path) -> None:
    for number in range(2000):
        write(tmp_path, f"extends: {number + 1}.yaml\n", f"{number}.yaml")
    with pytest.raises(InputError, match=r"20\.yaml: extends: '21\.yaml' is the parent of 20 in turn; a shorter chain"):
        load_scenario(tmp_path / "0.yaml")


def test_missing_scenario_lists_what_is_shipped() -> None:
    with pytest.raises(InputError, match="lab-five-people"):
        load_scenario("lab-five-peple")


def test_extends_merges_and_null_removes(tmp_path: Path) -> None:
    write(tmp_path, SMALL + "description: ann alone\n")
    child = write(
        tmp_path,
        "extends: small.yaml\nname: child\npeople: {ann: null, bob: {start: [1, 2], script: {kind: stand}}}\n",
        "child.yaml",
    )
    scenario = load_scenario(child)
    assert list(scenario.people) == ["bob"]
    assert scenario.duration_s == 1.0
    assert scenario.description == ""  # the parent's tells of the parent


def test_null_among_a_trackers_options_is_a_value(tmp_path: Path) -> None:
    mine = "trackers: {mine: {preset: laser-imm, waist: {body_width_m: null}, own: null}, other: {preset: laser-imm}}\n"
    scenario = load_scenario(
        write(tmp_path, SMALL + mine), ["trackers.mine.waist.satellite_width_m=null", "trackers.other=null"]
    )
    again = load_scenario(write(tmp_path, dump_scenario(scenario), "again.yaml"))
    for each in (scenario, again):
        assert list(each.trackers) == ["mine"] and each.trackers["mine"].preset == "laser-imm"
        assert each.trackers["mine"].options == {
            "waist": {"body_width_m": None, "satellite_width_m": None},
            "own": None,
        }
