"""Data names no code: whatever a scenario, a suite or a bag says, nothing is imported that the user did not name."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import twin

from trackers.errors import InputError
from twin.run.inputs import TrustedClasses, choose, listed, typed_classes, typed_schedulers, unused_changes
from twin.run.live import run_scenario
from twin.run.replay import track_recording
from twin.scenario import TrackerChoice, load_scenario
from twin.suites.expansion import expand
from twin.suites.spec import load_suite

pytestmark = pytest.mark.slow

EVIL = """
from pathlib import Path
Path(__file__).with_name("ran").touch()
class X:
    def __init__(self, rig, background, rng, **options): ...
    def update(self, observation): return []
    def tracks(self): return []
"""
EVERY = TrustedClasses(every=True)
SHORT = ["duration_s=0.3"]


@pytest.fixture
def evil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module `evil` on the path; the file that it leaves when it is imported."""
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "evil.py").write_text(EVIL)
    monkeypatch.syspath_prepend(tmp_path / "code")
    monkeypatch.delitem(sys.modules, "evil", raising=False)
    return tmp_path / "code" / "ran"


def scenario_file(folder: Path, trackers: str, extends: str = "lab-five-people") -> Path:
    path = folder / "own.yaml"
    path.write_text(f"extends: {extends}\nname: own\nduration_s: 0.3\ntrackers: {trackers}\n")
    return path


def run(path: Path, out: Path, *changes: str, **more: object):
    return run_scenario(load_scenario(path, changes), out=out, video=False, images=False, **more)


@pytest.mark.parametrize("trackers", ['{mine: {preset: "evil:X"}}', '{mine: {preset: "evil:X", knee: {kind: a}}}'])
def test_a_scenario_that_names_a_class_does_not_have_it_run(evil: Path, tmp_path: Path, trackers: str) -> None:
    for path in (scenario_file(tmp_path, trackers), tmp_path / "heir.yaml"):
        if not path.exists():
            path.write_text("extends: own.yaml\nname: heir\n")
        for names in (None, ["mine"]):
            said = r"(own|heir)\.yaml: trackers.mine.preset: 'evil:X' is a class, and a file names no code"
            with pytest.raises(InputError, match=said):
                run(path, tmp_path / "out", trackers=names)
    assert not evil.exists() and not (tmp_path / "out").exists()
    assert run(tmp_path / "own.yaml", tmp_path / "out", trackers=["laser-imm"]).metrics  # nobody asked for it
    assert not evil.exists()


def test_a_refused_scenario_is_named_by_its_file(tmp_path: Path) -> None:
    path = scenario_file(tmp_path, '{mine: {preset: "evil:X"}}')
    done = twin("run", path, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert f"twin: {path}: trackers.mine.preset: 'evil:X' is a class" in done.stderr


def test_a_scenario_with_a_class_runs_where_the_user_says_so(evil: Path, tmp_path: Path) -> None:
    path = scenario_file(tmp_path, '{mine: {preset: "evil:X"}}')
    result = run(path, tmp_path / "out", trusted=EVERY)
    assert evil.exists() and result.metrics is not None and "mine" in result.metrics["trackers"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "--tracker mine --set trackers.mine.preset=evil:X" in page  # the line that runs it again


def test_what_is_typed_is_trusted_and_nothing_else(evil: Path, tmp_path: Path) -> None:
    assert typed_classes(["trackers.a.preset=m:A", "trackers.b={preset: m:B}", "duration_s=1"]) == {"m:A", "m:B"}
    assert typed_classes(["trackers={c: {preset: m:C}}", "trackers.d.speed=m:D"]) == {"m:C"}
    path = scenario_file(tmp_path, '{mine: {preset: "evil:X"}}')
    with pytest.raises(InputError, match="trackers.mine.preset: 'evil:X' is a class"):
        run(path, tmp_path / "out", "trackers.mine.speed=2", trusted=TrustedClasses(typed_classes(["a=1"])))
    assert not evil.exists()


@pytest.mark.parametrize("target", ["evil:X", "laser-kalman"])
def test_no_scenario_gives_a_shipped_name_to_another_tracker(target: str, evil: Path, tmp_path: Path) -> None:
    path = scenario_file(tmp_path, f'{{laser-imm: {{preset: "{target}"}}}}')
    for names in ([], ["laser-imm"], ["laser-kalman"], None):
        with pytest.raises(InputError, match=f"trackers.laser-imm.preset: '{target}' would go by the name of another"):
            run(path, tmp_path / "out", trackers=names, trusted=EVERY)
    assert not evil.exists()
    own = {"laser-imm": TrackerChoice.model_validate({"preset": "laser-imm", "camera": False})}
    assert choose(["laser-imm"], own, "scenario x")[0].options == {"camera": False}


def test_a_bag_has_no_code_run(evil: Path, tmp_path: Path) -> None:
    loaded = load_scenario(scenario_file(tmp_path, '{mine: {preset: "evil:X"}}'))
    for name, preset in (("laser-imm", "evil:X"), ("other", "not-here")):  # as no scenario's file may have it
        loaded = loaded.model_copy(
            update={"trackers": {**loaded.trackers, name: TrackerChoice.model_validate({"preset": preset})}}
        )
    bag = record_unchecked(loaded, tmp_path)

    def track(name: str, *changes: str):
        return track_recording(bag, trackers=[name], changes=changes, out=tmp_path / "tracked", video=False)

    with pytest.raises(InputError, match=r"topic /scenario: trackers.mine.preset: 'evil:X' is a class"):
        track("mine")
    with pytest.raises(InputError, match=r"topic /scenario: trackers.laser-imm.preset: 'evil:X' would go by the name"):
        track("laser-imm")
    assert track("laser-kalman").metrics  # whatever the bag defines besides
    assert not evil.exists()
    assert track("mine", "trackers.mine.preset=evil:X").metrics and evil.exists()  # typed by the user


def record_unchecked(scenario, folder: Path) -> Path:
    """A bag that carries the scenario as it is, as somebody else's may."""
    from twin.run import live as twin_run

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(twin_run, "choose", lambda *arguments: [])
        run_scenario(scenario, trackers=[], out=folder / "bag", video=False, images=False)
    return folder / "bag" / "recording.mcap"


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("trackers: ['evil:X']\nscenarios: [{scenario: lab-five-people}]\n", "trackers.0"),
        ("scenarios: [{scenario: lab-five-people, trackers: ['evil:X']}]\n", "scenarios.0.trackers.0"),
        (
            "trackers: [mine]\nset: {trackers.mine: {preset: 'evil:X'}}\nscenarios: [{scenario: lab-five-people}]\n",
            "set.trackers.mine.preset",
        ),
        (
            "trackers: [mine]\nscenarios: [{scenario: lab-five-people, grid: {trackers.mine.preset: ['evil:X']}}]\n",
            "scenarios.0.grid.trackers.mine.preset",
        ),
        (
            "trackers: [mine]\nscenarios: [{scenario: lab-five-people, variants: [{trackers.mine.preset: 'evil:X'}]}]\n",
            "scenarios.0.variants.0.trackers.mine.preset",
        ),
        ("trackers: [mine]\nscenarios: [{scenario: own.yaml}]\n", "own.yaml: trackers.mine.preset"),
    ],
)
def test_a_suite_has_no_code_run_unless_it_is_trusted(evil: Path, tmp_path: Path, text: str, where: str) -> None:
    scenario_file(tmp_path, '{mine: {preset: "evil:X"}}')
    path = tmp_path / "suite.yaml"
    path.write_text(f"name: s\nseeds: 1\n{text}")
    with pytest.raises(InputError, match="'evil:X' is a class, and a file names no code") as refused:
        expand(*load_suite(path))
    assert where in str(refused.value) and not evil.exists()
    assert len(expand(*load_suite(path), trusted=EVERY)) == 1
    assert evil.exists()


def test_no_file_has_a_dask_scheduler_asked(tmp_path: Path) -> None:
    """Whoever is one runs code."""
    words = "'tcp://evil:1' is a Dask scheduler, .* and a file names none"
    mine = '{mine: {preset: rgbd-head, scheduler: "tcp://evil:1"}}'
    with pytest.raises(InputError, match=rf"own\.yaml: trackers.mine.scheduler: {words}"):
        run(scenario_file(tmp_path, mine), tmp_path / "out", trackers=["mine"])
    path = tmp_path / "suite.yaml"
    path.write_text(
        f"name: s\nseeds: 1\ntrackers: [mine]\nset: {{trackers.mine: {mine[7:-1]}}}\n"
        "scenarios: [{scenario: head-trap}]\n"
    )
    with pytest.raises(InputError, match=f"set.trackers.mine.scheduler: {words}"):
        expand(*load_suite(path))
    bag = tmp_path / "bag" / "recording.mcap"
    run(scenario_file(tmp_path, mine), bag.parent, trackers=["sort"])
    with pytest.raises(InputError, match=f"topic /scenario: trackers.mine.scheduler: {words}"):
        track_recording(bag, trackers=["mine"], out=tmp_path / "again")
    assert typed_schedulers(["trackers.mine.scheduler=tcp://ours:1", "duration_s=3"]) == {"tcp://ours:1"}


def test_a_suite_gives_no_shipped_name_to_another_tracker(tmp_path: Path) -> None:
    path = tmp_path / "suite.yaml"
    text = "trackers: [laser-imm]\nset: {trackers.laser-imm.preset: laser-kalman}\n"
    path.write_text(f"name: s\nseeds: 1\n{text}scenarios: [{{scenario: lab-five-people}}]\n")
    with pytest.raises(
        InputError, match="set.trackers.laser-imm.preset: 'laser-kalman' would go by the name of another"
    ):
        expand(*load_suite(path), trusted=EVERY)


def test_the_current_folder_is_looked_at_for_a_typed_name_or_a_trusted_file(tmp_path: Path) -> None:
    for name in ("evil", "yaml", "numpy"):  # nor does it take the place of what is installed
        (tmp_path / f"{name}.py").write_text(EVIL)
    scenario_file(tmp_path, '{mine: {preset: "evil:X"}}')
    quick = ["--no-images", "--no-video", "--out", "out"]

    def in_folder(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "twin", *arguments, *quick]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False, env=os.environ)

    done = in_folder("run", "own.yaml", "--allow-plugins")
    assert done.returncode == 0 and (tmp_path / "ran").exists(), done.stderr
    (tmp_path / "ran").unlink()
    done = in_folder("run", "own.yaml")
    assert done.returncode == 2 and "--allow-plugins" in done.stderr and not (tmp_path / "ran").exists()
    done = in_folder("run", "own.yaml", "--set", "trackers.mine.preset=evil:X")
    assert done.returncode == 0 and (tmp_path / "ran").exists(), done.stderr


def test_a_change_of_a_tracker_that_is_not_run_is_told() -> None:
    said = "--set trackers.laser-imm: changes nothing, as laser-imm is not run, but sort"
    assert unused_changes(["trackers.laser-imm.coast_s=1", "trackers.sort.gate=2", "duration_s=1"], ["sort"]) == [said]
    assert unused_changes(["trackers.mine={preset: sort}"], ["mine", "sort"]) == []


@pytest.mark.parametrize("command", ["run", "track"])
def test_commands_warn_of_a_change_that_changes_nothing(command: str, tmp_path: Path) -> None:
    run = twin("run", "lab-five-people", "--duration", "1", "--no-images", "--no-video", "--tracker", "sort",
               "--set", "trackers.laser-imm.coast_s=1", "--out", tmp_path / "run")  # fmt: skip
    bag = tmp_path / "run" / "recording.mcap"
    track = [
        "track",
        bag,
        "--no-video",
        "--tracker",
        "sort",
        "--set",
        "trackers.laser-imm.coast_s=1",
        "--out",
        tmp_path / "t",
    ]
    done = run if command == "run" else twin(*track)
    assert done.returncode == 0 and "--set trackers.laser-imm: changes nothing" in done.stderr


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("sort", "a list of names is expected, as ['sort']"),
        ([Path], "is a class; its name as 'pathlib:Path' is expected"),
        (["sort", None], "None is no name; a text is expected, as 'sort' or 'module:Class'"),
    ],
)
def test_trackers_are_given_by_name(given: Any, said: str) -> None:
    with pytest.raises(InputError) as told:
        listed(given)
    assert said in str(told.value)
