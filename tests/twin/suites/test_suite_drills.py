"""Fault drills of a whole run, from the command to the file of results: what is not to blame is there, and none twice."""

from __future__ import annotations

import errno
import os
import re
import signal
import sqlite3
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from synthetic_cases import result_of

from twin import cli
from twin.suites import dask_runner, run as suite_run, tasks
from twin.suites.cache import RecordingCache
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener
from twin.suites.run import run_suite
from twin.suites.spec import load_suite
from twin.suites.tasks import State

pytestmark = pytest.mark.slow

SUITE = """
name: drill
seeds: 6
trackers: [laser-imm, laser-kalman]
limit_s: 60
scenarios:
  - scenario: lab-five-people
    name: plain
    set: {duration_s: 2}
"""
N_CASE = 6 * 2


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    path = tmp_path / "drill.yaml"
    path.write_text(SUITE)
    return path


def rows(folder: Path, query: str) -> list[tuple]:
    with sqlite3.connect(folder / "results.sqlite") as connection:
        return connection.execute(query).fetchall()


def assert_there_once(folder: Path, n_done: int) -> None:
    """So many cases have all their figures, none of them twice, and no other case has any."""
    per_case = rows(folder, "SELECT case_id, COUNT(*), COUNT(DISTINCT metric) FROM results GROUP BY case_id")
    assert len(per_case) == n_done and {(n, distinct) for _, n, distinct in per_case} == {(9, 9)}
    done = rows(folder, "SELECT case_id FROM cases WHERE status = 'done'")
    assert {case_id for (case_id,) in done} == {case_id for case_id, _, _ in per_case}
    assert {path.parent.name for path in (folder / "cases").glob("*/report.html")} >= {case_id for (case_id,) in done}


def twin(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code and stderr of the command `twin`, cases made up, its workers processes as ever."""
    monkeypatch.setattr(suite_run, "run_case", result_of)
    monkeypatch.setattr(suite_run, "_draw_filmstrips", lambda *arguments: None)  # there are no recordings
    monkeypatch.setattr(sys, "argv", ["twin", *arguments])
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))
    capsys.readouterr()
    with pytest.raises(SystemExit) as way_out:
        cli.main()
    return int(way_out.value.code or 0), capsys.readouterr().err


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("limit_s", "faults"),
    [
        (
            60,
            {
                "raise": (1, r"RuntimeError: nothing works today(.|\n)*about to raise"),
                "bad input": (1, r"^sensors.waist: is no good"),
                "die": (3, r"^its worker died after .* s, after 2 of 2 retries(.|\n)*about to die"),
                "leave": (1, r"SystemExit: 0"),
            },
        ),
        (2, {"hang": (2, r"^did not end within its time limit of 2 s, after 1 of 1 retries(.|\n)*synthetic_cases.py")}),
    ],
    ids=["bad cases", "a case that hangs"],
)
def test_bad_cases_are_exit_1_with_their_logs_and_every_other_result_is_there(
    limit_s: int,
    faults: dict[str, tuple[int, str]],
    suite: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "hang" in faults:  # each retry is a worker that begins anew, as for one that died
        monkeypatch.setattr(tasks, "MAX_RETRIES", 1)
        monkeypatch.setattr(dask_runner, "MAX_RETRIES", 1)
    monkeypatch.setenv("SYNTHETIC_FAULT", ",".join(f"plain-{seed}-={kind}" for seed, kind in enumerate(faults)))
    suite.write_text(SUITE.replace("limit_s: 60", f"limit_s: {limit_s}"))
    folder = tmp_path / "out"
    code, told = twin(monkeypatch, capsys, "suite", "run", str(suite), "--jobs", "2", "--out", str(folder))
    assert code == 1
    assert_there_once(folder, N_CASE - len(faults))
    failed = rows(folder, "SELECT case_id, attempts, error FROM cases WHERE status = 'failed' ORDER BY case_id")
    assert len(failed) == len(faults)
    for seed, ((case_id, tried, error), (attempts, said)) in enumerate(zip(failed, faults.values(), strict=True)):
        assert case_id.startswith(f"plain-{seed}-laser-kalman-") and tried == attempts and re.search(said, error), error
        assert f"failed: {case_id}: " in told


@pytest.mark.nightly
def test_workers_killed_at_random_cost_a_run_no_result(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SYNTHETIC_CASE_S", "0.2")
    rng = np.random.default_rng(3)
    killed = []

    def state(now: State) -> None:
        if now.running and len(killed) < 3 and now.done > 3 * len(killed):
            workers = [each for each in psutil.Process().children() if "spawn_main" in " ".join(each.cmdline())]
            killed.append(rng.choice([each.pid for each in workers]))
            os.kill(int(killed[-1]), signal.SIGKILL)

    loaded, path = load_suite(suite)
    folder = tmp_path / "out"
    cache = RecordingCache(tmp_path / "cache", 10**6)
    run_suite(loaded, path, folder, cache, Workers(jobs=2), progress=ProgressListener(state=state), function=result_of)
    assert len(killed) == 3
    assert_there_once(folder, N_CASE)


def test_a_disk_that_fills_up_is_exit_2_in_one_sentence_and_the_rest_is_done_with_resume(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    arguments = ["suite", "run", str(suite), "--jobs", "1", "--out", str(folder)]
    write_bytes, written = Path.write_bytes, []

    def full(path: Path, content: bytes) -> int:
        written.append(path)
        if len(written) > 11:  # two files a case
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return write_bytes(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        code, told = twin(patch, capsys, *arguments)
    assert code == 2
    *planned, sentence = [line for line in told.splitlines() if line.startswith("twin: ")]
    assert all(line.startswith(("twin: planned: ", "twin: warning: ")) for line in planned)
    assert "report.html" in sentence and "No space left on device" in sentence and "Traceback" not in told
    assert_there_once(folder, 5)
    code, _ = twin(monkeypatch, capsys, *arguments, "--resume")
    assert code == 0
    assert_there_once(folder, N_CASE)


def test_a_disk_too_full_for_a_recording_ends_the_run_and_is_no_case_s_fault(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SYNTHETIC_FAULT", "full")
    folder = tmp_path / "out"
    arguments = ["suite", "run", str(suite), "--jobs", "2", "--out", str(folder)]
    code, told = twin(monkeypatch, capsys, *arguments)
    assert code == 2 and re.search(r"^twin: /full/disk: cannot be written .*--resume then does the rest$", told, re.M)
    assert rows(folder, "SELECT COUNT(*) FROM cases WHERE status = 'failed'") == [(0,)]
    monkeypatch.delenv("SYNTHETIC_FAULT")
    here = [*arguments, "--resume", "--jobs", "1"]
    assert twin(monkeypatch, capsys, *here)[0] == 0
    assert_there_once(folder, N_CASE)
