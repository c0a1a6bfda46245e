"""The shipped suites hold what they promise: every room, tracker and fault, people from 2 to 20, changing light."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from trackers.presets import PRESETS
from trackers.user_input.plain_data import parse_yaml
from twin import models
from twin.scenario import Scenario, load_scenario
from twin.scenario.housings import driven
from twin.sensors.fault_kinds import FAULT_KINDS
from twin.suites.expansion import Case, expand
from twin.suites.result_files import read_baseline
from twin.suites.spec import load_suite
from twin.suites.worker import resolved_scenario


@cache
def cases_of(name: str) -> list[Case]:
    return expand(*load_suite(name))


def scenarios_of(cases: list[Case]) -> dict[str, Scenario]:
    """A scenario of each name, of one of its seeds."""
    return {name: resolved_scenario(case) for name, case in {case.scenario: case for case in cases}.items()}


IN_REPRODUCTIONS_ALONE = {
    *("laser-imm-paper", "laser-kalman-paper", "laser-fisheye-kalman-paper"),
    *("waist-fisheye-imm-paper", "waist-fisheye-kalman-paper"),
    *("laser-vision-learning-paper-laser", "laser-vision-learning-paper-vision"),
}
"""The papers' systems on other sensor sets: `twin reproduce` compares them, no gate does."""


def seeds_of(cases: list[Case]) -> dict[tuple[str, str], set[int]]:
    found: dict[tuple[str, str], set[int]] = {}
    for case in cases:
        found.setdefault((case.scenario, case.tracker), set()).add(case.seed)
    return found


def test_regression_has_every_room_every_tracker_and_all_of_smoke_with_three_seeds_or_more() -> None:
    cases = cases_of("regression")
    assert {scenario.room for scenario in scenarios_of(cases).values()} == set(models.names("rooms"))
    assert {case.tracker for case in cases} == set(PRESETS) - IN_REPRODUCTIONS_ALONE
    assert all(len(seeds) >= 3 for seeds in seeds_of(cases).values())
    assert seeds_of(cases_of("smoke")).keys() <= seeds_of(cases).keys()


def test_faults_has_every_fault_on_every_sensor_of_the_lab_that_can_have_it() -> None:
    scenarios = scenarios_of(cases_of("faults"))
    hit = {
        (name, fault.kind)
        for scenario in scenarios.values()
        if scenario.name != "lab-faults"
        for fault in scenario.faults.values()
        for name in fault.sensor
    }
    lab = scenarios["healthy"]
    assert not lab.faults
    possible = {
        (name, kind)
        for name, each in lab.sensors.items()
        for kind, fault in FAULT_KINDS.items()
        if each.kind in fault.fits
    }
    assert possible <= hit and {kind for _, kind in hit} == set(FAULT_KINDS)


def test_smoke_has_the_own_system_of_each_paper() -> None:
    """A change of shared rules may break what nobody looks at: that of Bai lost half of its MOTA so."""
    own = {"laser-fisheye-imm-paper", "camera-floor-particle-paper", "rgbd-head-paper", "laser-vision-learning-paper"}
    required = {name for scenario in load_suite("smoke")[0].scenarios for name in scenario.require}
    assert own <= {case.tracker for case in cases_of("smoke")} & required


def test_density_goes_from_two_people_to_twenty() -> None:
    numbers = {name: len(scenario.people) for name, scenario in scenarios_of(cases_of("density")).items()}
    assert min(numbers.values()) == 2 and max(numbers.values()) == 20
    assert all(int(name.rpartition("-")[2]) == number for name, number in numbers.items())


def test_looks_has_like_shirts_skins_and_light_that_changes() -> None:
    scenarios = scenarios_of(cases_of("looks")).values()
    shirts = [{person.shirt for person in scenario.people.values()} for scenario in scenarios]
    assert {1, 5} <= {len(each) for each in shirts}
    assert {"dark", "porcelain"} <= {person.skin for scenario in scenarios for person in scenario.people.values()}
    lights = [{change.name for change in scenario.lights} for scenario in scenarios if scenario.lights]
    assert len(lights) >= 2 and any("all" not in names for names in lights)  # some are uneven


@pytest.mark.parametrize(
    "path", sorted((models.MODELS / "suites" / "baselines").glob("*.json")), ids=lambda path: path.stem
)
def test_a_committed_baseline_is_of_the_suite_as_it_is(path: Path) -> None:
    baseline = read_baseline(path)
    assert baseline.suite == path.stem and baseline.renderers and baseline.versions["mujoco"]
    expected = {(case.scenario, json.dumps(case.overrides), case.tracker, case.seed) for case in cases_of(path.stem)}
    held = {
        (key.scenario, key.overrides, key.tracker, seed)
        for key, group in baseline.groups.items()
        for seed in group.seeds
    }
    assert held == expected


@pytest.mark.parametrize("name", ["smoke", "regression"])
def test_what_changes_are_held_against_is_committed(name: str) -> None:
    assert (models.MODELS / "suites" / "baselines" / f"{name}.json").is_file()


@pytest.mark.parametrize("name", models.names("suites"))
def test_a_suite_says_what_it_is_for(name: str) -> None:
    path = models.find("suites", name)
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# ") and parse_yaml(text, str(path), "a suite")["description"]


def test_baseline_sets_every_scenario_with_a_scanner_beside_sort_on_seeds_of_its_own() -> None:
    cases = cases_of("baseline")
    scanned = {  # drawn rooms have a suite of their own
        name
        for name in models.names("scenarios")
        if name not in ("drawn", "drawn-groups")
        and not driven(load_scenario(name))  # sort and most others take sensors to stand
        and any(sensor.kind == "laser" for sensor in load_scenario(name).sensors.values())
    }
    assert {case.scenario for case in cases} >= scanned
    trackers = {name: {case.tracker for case in cases if case.scenario == name} for name in scanned}
    assert all(found >= {"sort", "laser-imm", "laser-kalman"} for found in trackers.values())
    assert all(min(seeds) >= 2000 and len(seeds) >= 3 for seeds in seeds_of(cases).values())
