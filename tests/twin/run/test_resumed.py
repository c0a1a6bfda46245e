"""A suite and a study that go on after anything they are made from was edited: as if they had been started then.

Every kind of file is edited in turn: the scenario, its room, a file that the room includes, a texture, recorded pedestrians,
a prior file, a tracker's own source and what that imports. Nothing of before the edit may be left in the results.
"""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from twin.models import MODELS
from twin.run.inputs import TrustedClasses
from twin.studies.run import run_study, write_results
from twin.suites.cache import RecordingCache
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener
from twin.suites.run import run_suite
from twin.suites.spec import load_suite

pytestmark = pytest.mark.slow

EVERY = TrustedClasses(every=True)

TRACKER = """
from helping import SHIFT_M
from trackers.sort import Sort

class Mine(Sort):
    shift_m = SHIFT_M
    def tracks(self):
        from dataclasses import replace
        return [replace(each, x=each.x + self.shift_m) for each in super().tracks()]
"""
SCENARIO = """
name: own
extends: lab-five-people
room: room.xml
seed: 5
duration_s: 1.0
background_frames: 3
prior: {learned: {spare: spare.txt}}
pedestrians: {file: walkers.csv}
sensors: {fisheye: null}
"""
SUITE = """
name: mine
description: One of everything that can be edited.
seeds: 1
reports: false
trackers: ["sort", "mine_of_resumed:Mine"]
scenarios: [{scenario: own.yaml}]
"""
STUDY = {
    "name": "mine",
    "scenarios": [{"scenario": "own.yaml"}],
    "trackers": ["mine_of_resumed:Mine"],
    "seeds": [1000],
    "devices": {
        "waist": {
            "sensors": ["waist"],
            "places": [{"xyz": [0, 3.6, 0.95], "yaw_deg": -90}, {"xyz": [0, -3.6, 0.95], "yaw_deg": 90}],
        }
    },
    "objectives": [{"kind": "metric", "metric": "motp_m"}],
    "coverage": {"samples": 2, "seeds": [1950]},
    "search": {"method": "exhaustive", "replicates": [1]},
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of everything that a suite and a study can be made from."""
    lab = (MODELS / "rooms" / "lab.xml").read_text()
    (tmp_path / "room.xml").write_text(lab.replace("<worldbody>", '<include file="part.xml"/><worldbody>', 1))
    (tmp_path / "part.xml").write_text(part())
    cv2.imwrite(str(tmp_path / "paper.png"), np.full((4, 4, 3), 90, np.uint8))
    rows = [f"{n / 5:.1f},1,{-1 + n / 10:.2f},1.0" for n in range(20)]
    (tmp_path / "walkers.csv").write_text("\n".join(["t,id,x,y", *rows]) + "\n")
    (tmp_path / "spare.txt").write_text("oval")
    (tmp_path / "helping.py").write_text("SHIFT_M = 0.0\n")
    (tmp_path / "mine_of_resumed.py").write_text(TRACKER)
    (tmp_path / "own.yaml").write_text(SCENARIO)
    (tmp_path / "suite.yaml").write_text(SUITE)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY))
    monkeypatch.setenv("ROOMTWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(str(tmp_path))
    forget(monkeypatch)
    return tmp_path


def part(size_m: float = 0.15) -> str:
    return (
        '<mujoco><asset><texture name="pasted" type="2d" file="paper.png"/><material name="pasted" texture="pasted"/></asset>'
        f'<worldbody><geom type="box" size="{size_m} {size_m} 0.6" pos="-2.2 1.9 0.6" material="pasted"/></worldbody></mujoco>'
    )


def forget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Import the tracker anew, as another process would."""
    for name in ("mine_of_resumed", "helping"):
        monkeypatch.delitem(sys.modules, name, raising=False)


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    def edited(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return edited


def repaint(folder: Path) -> None:
    cv2.imwrite(str(folder / "paper.png"), np.full((4, 4, 3), 200, np.uint8))


EDITS: dict[str, tuple[Callable[[Path], object], str]] = {
    "scenario": (edit("own.yaml", "duration_s: 1.0", "duration_s: 0.8"), "scenario"),
    "room": (edit("room.xml", "<worldbody>", "<worldbody><site name='new'/>"), "room"),
    "included": (lambda folder: (folder / "part.xml").write_text(part(0.3)), "room"),
    "texture": (repaint, "room"),
    "pedestrians": (edit("walkers.csv", ",1.0\n", ",1.3\n"), "scenario"),
    "prior": (edit("spare.txt", "oval", "round"), "prior"),
    "tracker": (edit("mine_of_resumed.py", "+ self.shift_m", "+ self.shift_m + 0.1"), "tracker"),
    "imported": (edit("helping.py", "0.0", "0.2"), "tracker"),
}


def suite_run(folder: Path, out: str, *, resume: bool = False) -> list[str]:
    told: list[str] = []
    suite, path = load_suite(folder / "suite.yaml")
    cache = RecordingCache(folder / "cache", 10**9)
    watcher = ProgressListener(warned=told.append, failed=lambda case_id, error: pytest.fail(error))
    run_suite(suite, path, folder / out, cache, Workers(jobs=1), trusted=EVERY, progress=watcher, resume=resume)
    return told


def suite_results(folder: Path, out: str) -> list[tuple]:
    with sqlite3.connect(folder / out / "results.sqlite") as connection:
        query = (
            "SELECT case_id, metric, value, digest FROM results JOIN recordings USING (case_id) "
            "WHERE metric NOT LIKE 'ms_per_frame%' ORDER BY case_id, metric"
        )
        return connection.execute(query).fetchall()


@pytest.mark.sample(2)
@pytest.mark.parametrize("what", EDITS)
def test_a_suite_goes_on_as_if_begun_after_the_edit(folder: Path, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    change, part_named = EDITS[what]
    suite_run(folder, "out")
    before = suite_results(folder, "out")
    assert before
    change(folder)
    forget(monkeypatch)
    told = suite_run(folder, "out", resume=True)
    n_again = 1 if part_named == "tracker" else 2  # sort is none of the user's trackers
    assert [each for each in told if each.startswith("--resume")] and f"{n_again} of 2 results" in told[0]
    assert told[0].endswith(f": {part_named} changed since")
    forget(monkeypatch)
    suite_run(folder, "anew")
    assert suite_results(folder, "out") == suite_results(folder, "anew")
    if what not in ("prior", "texture", "room"):  # which no figure depends on here
        assert suite_results(folder, "out") != before
    assert not suite_run(folder, "out", resume=True)  # and then nothing more


def study_run(folder: Path, out: str, **more: bool) -> None:
    with run_study(folder / "study.yaml", folder / out, Workers(jobs=1), trusted=EVERY, **more) as (answers, where):
        write_results(where, answers)


def study_results(folder: Path, out: str) -> list[bytes]:
    return [(folder / out / name).read_bytes() for name in ("candidates.csv", "pareto.csv")]


@pytest.mark.sample(1)
@pytest.mark.parametrize("what", ["included", "imported"])
def test_a_study_goes_on_as_if_begun_after_the_edit(
    folder: Path, what: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change, part_named = EDITS[what]
    study_run(folder, "out")
    before = study_results(folder, "out")
    change(folder)
    forget(monkeypatch)
    capsys.readouterr()
    study_run(folder, "out", resume=True)
    assert f"{part_named} changed since" in capsys.readouterr().err
    forget(monkeypatch)
    study_run(folder, "anew")
    assert study_results(folder, "out") == study_results(folder, "anew")
    assert study_results(folder, "out") != before


@pytest.mark.nightly
def test_sigkill_at_any_time_and_resume_give_the_bits_of_an_undisturbed_study(folder: Path) -> None:
    """Killed twice at moments drawn with a seed."""
    study_run(folder, "whole")
    command = [sys.executable, "-m", "twin", "study", "run", str(folder / "study.yaml"), "--allow-plugins"]
    command += ["--jobs", "1", "--out", str(folder / "out")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])}
    file = folder / "out" / "evaluations.jsonl"
    rng = np.random.default_rng(3)
    for lines in (1, 2):
        resume = ["--resume"] if file.exists() else []
        process = subprocess.Popen([*command, *resume], env=environment, stderr=subprocess.DEVNULL)
        while process.poll() is None and (not file.exists() or file.read_text().count("\n") < lines):
            time.sleep(0.005)
        time.sleep(float(rng.uniform(0, 0.2)))
        process.send_signal(signal.SIGKILL)
        process.wait()
    done = subprocess.run([*command, "--resume"], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert study_results(folder, "out") == study_results(folder, "whole")
