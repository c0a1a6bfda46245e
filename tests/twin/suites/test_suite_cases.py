"""Which cases a suite has, and what of the code and the models a recording depends on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin import models
from twin.suites import fingerprint
from twin.suites.cases import Case, expand
from twin.suites.description import load_suite

HEAD = "name: s\ntrackers: [laser-imm]\nseeds: 2\n"


def cases_of(tmp_path: Path, text: str) -> list[Case]:
    path = tmp_path / "s.yaml"
    path.write_text(HEAD + text)
    return expand(*load_suite(path))


@pytest.mark.parametrize("name", models.names("suites"))
def test_shipped_suites_can_be_run(name: str) -> None:
    suite, path = load_suite(name)
    assert suite.name == name and suite.description
    cases = expand(suite, path)
    assert len({case.id for case in cases}) == len(cases) >= 2


def test_scenarios_times_seeds_times_overrides_times_trackers(tmp_path: Path) -> None:
    cases = cases_of(
        tmp_path,
        """
scenarios:
  - scenario: lab-five-people
    trackers: [laser-imm, laser-fisheye-imm, mine]
    set: {duration_s: 5, trackers.mine: {preset: laser-kalman, camera: false}}
    grid: {people.white.shirt: [red, blue], background_frames: [5, 10]}
    variants: [{}, {people.pink: null}]
  - scenario: lab-five-people
    name: other
    seeds: [7]
    limit_s: 30
""",
    )
    assert len(cases) == 3 * 2 * (2 * 2 * 2) + 1
    assert cases[0].seed == 0 and "seed: 0" in cases[0].resolved and "duration_s: 5" in cases[0].resolved
    assert cases[0].variant == "people.white.shirt=red, background_frames=5"
    assert cases[0].overrides[0] == "duration_s=5"
    assert [case.image_based for case in cases[:3]] == [False, True, False]
    assert cases[-1].limit_s == 30 and cases[-1].scenario == "other" and cases[0].limit_s == 600
    assert "trackers: {}" in cases[0].resolved and cases[0].resolved == cases[2].resolved
    assert any(change.startswith("trackers.mine={") for change in cases[0].tracker_changes)
    without_pink = [case for case in cases if "people.pink" in case.variant]
    assert len(without_pink) == 24 and all("pink" not in case.resolved for case in without_pink)


def test_ids_stay_the_same_whatever_else_is_in_the_suite(tmp_path: Path) -> None:
    one = cases_of(tmp_path, "scenarios: [{scenario: lab-five-people}]")
    two = cases_of(
        tmp_path, "scenarios: [{scenario: lab-five-people, name: first}, {scenario: lab-five-people, seeds: [1, 0]}]"
    )
    assert {case.id for case in one} <= {case.id for case in two}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scenarios: [{scenario: lab}]", r"s.yaml: scenarios: there is no scenario 'lab'; "),
        ("scenarios: [{scenario: lab-five-people, seed: 1}]", r"scenarios.0.seed: unknown key; did you mean 'seeds'"),
        ("scenarios: []", r"scenarios: List should have at least 1"),
        ("scenarios: [{scenario: lab-five-people, seeds: 0}]", r"scenarios.0.seeds: "),
        ("scenarios: [{scenario: lab-five-people, trackers: [none]}]", r"there is no tracker 'none'; valid are laser-"),
        ("scenarios: [{scenario: lab-five-people, set: {people.white.shirt: mauve}}]", r"no shirt colour 'mauve'"),
        ("scenarios: [{scenario: lab-five-people, grid: {seed: [1, 2]}}]", r"seed is set; `seeds:` beside it"),
        ("scenarios: [{scenario: lab-five-people}, {scenario: lab-five-people}]", r"seed 0, laser-imm is there twice"),
        (
            "scenarios: [{scenario: lab-five-people}]\ntolerances: {mata: {absolute: 1}}",
            r"no figure 'mata'; valid are mota",
        ),
    ],
)
def test_bad_suites_are_told_with_the_field(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        cases_of(tmp_path, text)


def test_the_code_that_records_is_all_that_is_loaded_to_record_and_no_tracker() -> None:
    code = (
        "import sys\nfrom pathlib import Path\nimport twin.simulation, twin.recording.writer\n"
        "ours = [m for n, m in sys.modules.items() if n.split('.')[0] in ('twin', 'trackers') and m.__file__]\n"
        "print('\\n'.join(str(Path(m.__file__)) for m in ours))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {Path(line) for line in done.stdout.splitlines() if line}
    found = fingerprint._modules(fingerprint._SIMULATING)
    roots = {package / "__init__.py" for package in fingerprint._PACKAGES.values()}
    assert loaded - roots <= found
    assert {"fisheye.py", "laser.py", "render.py"} <= {path.name for path in found}  # loaded when a sensor is made
    parts = {f"{path.parent.name}/{path.name}" for path in found}
    assert "sensors/laser.py" in parts
    judging = {"trackers/laser_fisheye_imm.py", "trackers/presets.py", "report/page.py", "evaluate/summary.py"}
    assert not (judging | {"evaluate/clear.py", "suites/engine.py"}) & parts


def test_the_key_of_a_recording_follows_scenario_seed_renderer_and_room(tmp_path: Path) -> None:
    room = tmp_path / "room.xml"
    room.write_text('<mujoco><asset><mesh file="chair.obj"/></asset></mujoco>')
    (tmp_path / "chair.obj").write_text("v 0 0 0")
    resolved = f"room: {room}\nseed: 1\n"
    key = fingerprint.recording_key(resolved, "llvmpipe")
    assert key == fingerprint.recording_key(resolved, "llvmpipe")
    assert key != fingerprint.recording_key(resolved, "NVIDIA")
    assert key != fingerprint.recording_key(resolved.replace("1", "2"), "llvmpipe")
    (tmp_path / "chair.obj").write_text("v 0 0 1")
    changed = fingerprint.recording_key(resolved, "llvmpipe")
    assert changed != key
    room.write_text(room.read_text() + " ")
    assert fingerprint.recording_key(resolved, "llvmpipe") not in (key, changed)
