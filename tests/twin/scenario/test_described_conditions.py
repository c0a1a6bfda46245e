"""What a report says of what a scenario did to its sensors and its light."""

from __future__ import annotations

import signal
import sys
from html import unescape
from pathlib import Path

import pytest

from twin import Simulation, cli, run_scenario
from twin.run.outcome import simplifications
from twin.scenario import load_scenario
from twin.scenario.load import dump_scenario
from twin.scenario.scenario import describe_conditions, describe_late_starts
from twin.suites.worker import renderer_of

pytestmark = pytest.mark.slow

TOO_LATE = [
    "duration_s=2",
    "people={}",
    "faults={late: {sensor: waist, kind: dropout, from_s: 2}, now: {sensor: [waist, knee], kind: freeze, from_s: 1.9, to_s: 9}}",
    "lights=[{at_s: 1, brightness: 0.5}, {at_s: 7.5, brightness: 0}]",
    "sensors.knee.phase_s=3",
]
NEVER = [
    "sensors.knee.phase_s: 3 s is not before the end at 2 s: never looks",
    "faults.late.from_s: 2 s is not before the end at 2 s: never begins",
    "lights.1.at_s: 7.5 s is not before the end at 2 s: never comes",
]


def test_a_scenario_that_does_nothing_to_them_is_passed_over() -> None:
    assert describe_conditions(load_scenario("lab-five-people")) == []


def test_how_pictures_are_drawn_is_named() -> None:
    home = load_scenario("home-cameras", ["rendering={shadows: true, samples: 4}"])
    assert describe_conditions(home) == ["Pictures are drawn with shadows and 4 samples a pixel."]
    assert describe_conditions(load_scenario("home-cameras", ["rendering.shadows=false"])) == []
    assert "no shadows" in simplifications(None)[-1] and "no shadows" not in simplifications(home)[-1]
    assert renderer_of(home).endswith(", with shadows and 4 samples a pixel")
    assert "rendering" in dump_scenario(home) and "rendering" not in dump_scenario(load_scenario("home-cameras"))


def test_faults_and_beliefs_are_named_with_their_times() -> None:
    faults, misled = describe_conditions(load_scenario("lab-faults"))
    assert faults.startswith("Faults: dead beams of waist throughout; dropout of knee from 3 to 6 s; ")
    assert "delay of knee and fisheye from 7 to 9 s" in faults and "occlusion of fisheye from 19 s on" in faults
    assert misled == "Trackers assume another pose, lens or clock than the true one of: fisheye."


def test_changes_of_the_light_are_named_with_their_times() -> None:
    dim = load_scenario("lab-five-people", ['lights=[{"at_s": 5, "brightness": 0.1, "over_s": 2}]'])
    assert describe_conditions(dim) == ["Light: all to 0.1 from 5 s."]


def test_what_would_begin_after_the_end_is_told_and_nothing_else() -> None:
    late, faults = load_scenario("lab-five-people", TOO_LATE), load_scenario("lab-faults")
    assert describe_late_starts(late, late.sensors) == NEVER
    assert describe_late_starts(faults, faults.sensors) == []


def test_faults_of_a_sensor_that_is_left_out_are_told():
    told = describe_late_starts(load_scenario("lab-faults"), ["waist", "knee"])
    assert [each.partition(":")[0] for each in told] == [
        f"faults.{name}" for name in ("congested", "thumb", "dirt", "camera_clock")
    ]
    assert all(each.endswith("does not show in fisheye, which the run leaves out") for each in told)


def test_what_would_begin_after_the_end_is_a_warning_of_a_run_its_report_and_a_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    warnings = tuple(f"scenario 'lab-five-people': {each}" for each in NEVER)
    scenario = load_scenario("lab-five-people", TOO_LATE)
    with Simulation(scenario, images=False) as simulation:
        assert simulation.warnings == warnings
    result = run_scenario(scenario, trackers=["laser-imm"], out=tmp_path / "run", video=False, images=False)
    assert [each for each in result.warnings if each.startswith("scenario ")] == list(warnings)
    page = unescape((tmp_path / "run" / "report.html").read_text())
    assert all(each in page for each in warnings)
    small = [*TOO_LATE, "sensors.fisheye.size=[64, 64]"]
    sets = [part for change in small for part in ("--set", change)]
    picture = str(tmp_path / "view.png")
    monkeypatch.setattr(sys, "argv", ["twin", "view", "lab-five-people", "--at", "1", "--out", picture, *sets])
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    with pytest.raises(SystemExit):
        cli.main()
    said = capsys.readouterr().err
    assert all(f"twin: warning: {each}" in said for each in warnings)
