"""What is wrong with a suite's trackers is told before any case starts, where the user wrote it."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin import cli, models
from twin.run.inputs import TrustedClasses
from twin.scenario import load_scenario
from twin.scenario.housings import assumed_rig
from twin.suites import run as suite_run
from twin.suites.expansion import expand
from twin.suites.spec import load_suite
from twin.world.empty_room import empty_room
from twin.world.simulation import Simulation

PLUG_IN = """
import sys

class Mine:
    def __init__(self, rig, background, rng, *, speed=1.0):
        if not rig.lasers():
            raise ValueError("I break")
        if not speed > 0:
            from trackers.errors import InputError
            raise InputError(f"speed: {speed} is not above 0")
    def update(self, observation): ...
    def tracks(self): return []

class NeedsTheEmptyRoom(Mine):
    def __init__(self, rig, background, rng):
        if not list(background):
            from trackers.errors import InputError
            raise InputError("observations of the empty room are expected")

class Leaves(Mine):
    def __init__(self, rig, background, rng):
        sys.exit(3)

class NoTracker:
    def __init__(self, rig, background, rng): ...
"""


def told(tmp_path: Path, text: str, *changes: str, plug_ins: bool = True) -> list[str]:
    """What is said of a suite, a line a fault, without the name of its file; nothing where it can be."""
    path = tmp_path / "s.yaml"
    path.write_text("name: s\nseeds: 1\n" + text)
    try:
        expand(*load_suite(path), changes, plug_ins=plug_ins, trusted=TrustedClasses(every=True), scenes=True)
    except InputError as error:
        lines = str(error).splitlines()
        assert all(line.startswith(f"{path}: ") for line in lines), lines
        return [line.removeprefix(f"{path}: ") for line in lines]
    return []


LAB = "scenarios: [{scenario: lab-five-people, %s}]\n"
FAR = "[[0, 1], [30, 1], [30, 2], [0, 2]]"
TOO_FAR = (
    "the edge from [0, 1] to [30, 1] is outside the room's walkable area at [16.15, 1]; x -2.3 to 2.3 m, y 0.35 to "
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        # where an option was written: the suite's own set, an entry's, a grid, a variant
        (
            "trackers: [mine]\nset: {trackers.mine: {preset: laser-imm, camra: false}}\n" + LAB % "name: a",
            "set.trackers.mine.camra: unknown key; did you mean 'camera'? valid here: appearance, camera, ",
        ),
        (
            "trackers: [mine]\n" + LAB % "set: {trackers.mine: {preset: laser-imm, legs: {gate_m: wide}}}",
            "scenarios.0.set.trackers.mine.legs.gate_m: a number is expected (got 'wide')",
        ),
        (
            "trackers: [laser-imm]\n" + LAB % "grid: {trackers.laser-imm.camera: [false, perhaps]}",
            "scenarios.0.grid.trackers.laser-imm.camera: true or false is expected (got 'perhaps')",
        ),
        (
            "trackers: [laser-imm]\n" + LAB % "variants: [{}, {trackers.laser-imm.legs.par_m: 1}]",
            "scenarios.0.variants.1.trackers.laser-imm.legs.par_m: unknown key; did you mean 'pair_m'?",
        ),
        # where a preset or name was written
        (
            "trackers: [mine]\n" + LAB % "set: {trackers.mine.preset: lasr-imm}",
            "scenarios.0.set.trackers.mine.preset: there is no tracker 'lasr-imm'; did you mean 'laser-imm'? valid are ",
        ),
        ("trackers: [laser-imm, none]\n" + LAB % "name: a", "trackers.1: there is no tracker 'none'; valid are "),
        (LAB % "trackers: [none]", "scenarios.0.trackers.0: there is no tracker 'none'; valid are "),
        (
            "trackers: [laser-imm]\n" + LAB % "set: {trackers.other: {camera: false}}",
            "scenarios.0.set.trackers.other: there is no tracker 'other'; valid are ",
        ),
        # what a rig does not have
        (
            "trackers: [laser-kalman, laser-imm]\n" + LAB % "variants: [{}, {sensors.waist: null, sensors.knee: null}]",
            "trackers.0: 'laser-kalman' cannot work on lab-five-people (sensors.waist=null, sensors.knee=null): the rig has "
            "no laser scanner for waist or knee height: no laser at all; a sensor of kind 'laser' with role waist or knee "
            "is needed",
        ),
        (
            LAB % "trackers: [waist-fisheye-imm], name: a, grid: {sensors.waist: [null], duration_s: [1, 2, 3]}",
            "scenarios.0.trackers.0: 'waist-fisheye-imm' cannot work on a (sensors.waist=null, duration_s=1) and 2 more like "
            "it: the rig has no laser scanner for waist height: knee (knee); a sensor",
        ),
    ],
)
def test_a_wrong_tracker_is_told_where_it_was_written(tmp_path: Path, text: str, said: str) -> None:
    assert told(tmp_path, text)[0].startswith(said)


@pytest.mark.parametrize(
    ("text", "change", "said"),
    [
        (f"set: {{area: {FAR}}}\n" + LAB % "name: a", "", f"set.area: {TOO_FAR}"),
        (LAB % f"set: {{area: {FAR}}}", "", f"scenarios.0.set.area: {TOO_FAR}"),
        (LAB % f"grid: {{area: [null, {FAR}]}}", "", f"scenarios.0.grid.area: {TOO_FAR}"),
        (LAB % "name: a", f"area={FAR}", f"--set area={FAR}: area: {TOO_FAR}"),
        (
            LAB % "variants: [{}, {sensors.waist.mount.xyz: [0, 9, 1]}]",
            "",
            "scenarios.0.variants.1.sensors.waist.mount.xyz: [0, 9, 1] is inside 'wall_far' of",
        ),
        (
            LAB % "set: {people.white.script: {kind: sit, seat: throne}}",
            "",
            "scenarios.0.set.people.white.script.0.seat: lab has no seat 'throne'; ",
        ),
        (
            LAB
            % "seeds: 9, set: {people.white.start: [0, 1], people.white.script: {kind: stand}, randomize.start_m: 2}",
            "",
            "scenarios.0.set.people.white.start: with seed 1, and ",
        ),
    ],
)
def test_a_scenario_that_cannot_begin_is_told_before_any_case(
    tmp_path: Path, text: str, change: str, said: str
) -> None:
    (line,) = told(tmp_path, "trackers: [sort]\n" + text, *([change] if change else []))
    assert line.startswith(said)


def test_every_fault_of_every_scenario_is_told_once(tmp_path: Path) -> None:
    text = "trackers: [mine, none]\nset: {trackers.mine: {preset: laser-imm, camra: 1}}\n"
    lines = told(tmp_path, text + "scenarios: [{scenario: lab-five-people}, {scenario: meeting-three-people}]\n")
    assert [line.split(": ")[0] for line in lines] == ["set.trackers.mine.camra", "trackers.1", "trackers.1"]


def test_an_option_of_the_scenario_s_file_is_told_with_that_file(tmp_path: Path) -> None:
    scenario = tmp_path / "own.yaml"
    scenario.write_text(
        "extends: lab-five-people\nname: own\ntrackers: {mine: {preset: laser-imm, waist: {p_detect: 2}}}\n"
    )
    (line,) = told(tmp_path, "trackers: [mine]\nscenarios: [{scenario: own.yaml}]\n")
    assert line == (
        f"scenarios.0.scenario: {scenario}: trackers.mine.waist.p_detect: a number less than 1 is expected (got 2)"
    )


def test_an_option_of_the_command_line_is_told_with_it(tmp_path: Path) -> None:
    (line,) = told(tmp_path, "trackers: [laser-imm]\n" + LAB % "name: a", "trackers.laser-imm.legs.gate_m=0")
    assert line == (
        "--set trackers.laser-imm.legs.gate_m=0: trackers.laser-imm.legs.gate_m: a number greater than 0 is expected (got 0)"
    )


def test_a_class_of_the_user_s_own_is_looked_at_as_far_as_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own_lab.py").write_text(PLUG_IN)
    monkeypatch.syspath_prepend(tmp_path)

    def mine(options: str) -> list[str]:
        return told(tmp_path, "trackers: [x]\n" + LAB % f"set: {{trackers.x: {{preset: 'own_lab:Mine', {options}}}}}")

    assert mine("speed: 2") == []
    assert mine("sped: 2") == ["scenarios.0.set.trackers.x.sped: unknown key; did you mean 'speed'? valid here: speed"]
    assert mine("speed: 0") == ["scenarios.0.set.trackers.x.speed: 0 is not above 0"]
    nowhere = "trackers: ['own_lab:Nobody', 'no_lab:Mine', 'own_lab:NoTracker']\n" + LAB % "name: a"
    said = told(tmp_path, nowhere)
    assert said[0].startswith("trackers.0: 'own_lab:Nobody' cannot work on a: ") and "no class 'Nobody'" in said[0]
    assert "there is no module 'no_lab', installed or in " in said[1] and "NoTracker has not both update" in said[2]
    # What a run alone can tell is left to it: a cluster's own classes, one that needs the empty room or breaks by itself.
    assert told(tmp_path, "trackers: ['no_lab:Mine']\n" + LAB % "name: a", plug_ins=False) == []
    for name in ("NeedsTheEmptyRoom", "Leaves"):
        assert told(tmp_path, f"trackers: ['own_lab:{name}']\n" + LAB % "name: a") == []
    without = LAB % "set: {background: none}"
    assert "empty room are expected" in told(tmp_path, "trackers: ['own_lab:NeedsTheEmptyRoom']\n" + without)[0]


@pytest.mark.parametrize("change", ["trackers.laser-imm.camra=false", "trackers.laser-imm.mode_stays=often", "seed=3"])
def test_bad_trackers_are_exit_2_before_any_case_and_leave_nothing(
    change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(suite_run, "run_case", lambda work: pytest.fail("a case was started"))
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    monkeypatch.setenv("ROOMTWIN_CACHE", str(tmp_path / "cache"))
    out = tmp_path / "out"
    monkeypatch.setattr(
        sys, "argv", ["twin", "suite", "run", "smoke", "--jobs", "1", "--out", str(out), "--set", change]
    )
    with pytest.raises(SystemExit) as way_out:
        cli.main()
    assert way_out.value.code == 2 and not out.exists()
    said = re.sub(r"^twin: planned: \d+ cases?\n", "", capsys.readouterr().err)
    assert said.count("\n") == 1 and f"--set {change}: " in said and "background" not in said


@pytest.mark.parametrize("name", models.names("scenarios"))
def test_the_rig_that_trackers_are_tried_on_is_the_one_they_get(name: str) -> None:
    scenario = load_scenario(name)
    if not scenario.housings:  # a robot may follow somebody; else people cost the most and change no rig
        scenario = scenario.model_copy(update={"people": {}})
    with Simulation(scenario) as simulation:
        area = scenario.area or tuple((float(x), float(y)) for x, y in empty_room(scenario).walkable)
        assert assumed_rig(scenario, area) == simulation.rig
