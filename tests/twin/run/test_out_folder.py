"""A folder of results: one run at a time, nothing of the user's touched, nothing of a killed run left."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.environment.run import write_environment
from twin.recording.atomic_file import open_atomic
from twin.run import live as twin_run, outcome as twin_results
from twin.run.live import run_scenario
from twin.run.out_folder import LOCK, MADE, locked_folder, out_folder, whole_folder
from twin.scenario import load_scenario
from twin.studies import store as study_store
from twin.studies.run import write_coverage
from twin.studies.spec import Coverage
from twin.suites import result_files
from twin.suites.cluster import Workers
from twin.suites.dask_runner import ProgressListener

pytestmark = pytest.mark.slow


def write(folder: Path, *names: str) -> list[str]:
    with out_folder(folder, names) as out:
        out.announce()
        for name in names:
            with open_atomic(folder / name) as stream:
                stream.write("x")
        return out.finish([folder / name for name in names])


@pytest.mark.parametrize(
    "name",
    ["../victim.txt", "sub/../../victim.txt", "/etc/victim", "sub/file", "..", ".", "", "tracks", "tracks/../victim.txt",
     "tracks//a.csv", "tracks/sub/a.csv", "a\\b", "a\0b", "a" * 300, "folder"],
)  # fmt: skip
def test_a_list_that_names_anything_but_files_of_the_folder_is_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (folder / "folder").mkdir(parents=True)
    (folder / "tracks").mkdir()
    (tmp_path / "victim.txt").write_text("mine")
    (folder / "mine.txt").write_text("mine")
    (folder / MADE).write_text(json.dumps(["mine.txt", name]))
    with pytest.raises(InputError, match="is no name of a file in this folder; the list of files that twin wrote"):
        write(folder, "metrics.json")
    assert (tmp_path / "victim.txt").exists() and (folder / "mine.txt").exists()
    assert sorted(path.name for path in folder.iterdir()) == [MADE, "folder", "mine.txt", "tracks"]


@pytest.mark.parametrize("text", ["", "{", "[1]", "[null]", '{"a": 1}', '"a"', "3", "[" * 100_000, "\x00", "[[]]"])
def test_a_list_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / MADE).write_text(text)
    with pytest.raises(InputError, match=f"{MADE}: .* is expected"):
        write(tmp_path, "metrics.json")
    assert [path.name for path in tmp_path.iterdir()] == [MADE]


def test_a_list_that_is_a_link_or_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / MADE).symlink_to("/dev/zero")
    with pytest.raises(InputError, match="it is no short file"):
        write(tmp_path, "metrics.json")
    (tmp_path / MADE).unlink()
    (tmp_path / MADE).write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="cannot be read"):
        write(tmp_path, "metrics.json")


def test_nothing_is_removed_through_a_link_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "a.csv").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "tracks").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "out" / MADE).write_text('["tracks/a.csv"]')
    with pytest.raises(InputError, match="'tracks/a.csv' is no name of a file in this folder"):
        write(tmp_path / "out", "metrics.json")
    assert (tmp_path / "elsewhere" / "a.csv").exists()


def test_a_whole_run_removes_what_an_earlier_one_made_and_nothing_else(tmp_path: Path) -> None:
    assert write(tmp_path, "metrics.json", "tracks/a.csv") == []
    (tmp_path / "tracks" / "mine.csv").write_text("mine")
    assert write(tmp_path, "metrics.json", "tracks/a.csv") == []
    assert write(tmp_path, "metrics.json", "tracks/b.csv") == [
        f"{tmp_path}: removed from the earlier run: tracks/a.csv"
    ]
    assert sorted(path.name for path in (tmp_path / "tracks").iterdir()) == ["b.csv", "mine.csv"]
    assert json.loads((tmp_path / MADE).read_text()) == ["metrics.json", "tracks/b.csv"]
    with pytest.raises(InputError, match="holds tracks/mine.csv, which twin did not write"):
        write(tmp_path, "tracks/mine.csv")


@pytest.mark.parametrize("error", [RuntimeError("a fault"), InputError("full disk")])
def test_a_run_that_failed_late_does_not_block_its_own_folder(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=0.3"])

    def run() -> None:
        run_scenario(scenario, trackers=["laser-imm"], out=tmp_path / "out", video=False, images=False)

    def fail(*arguments: object, **options: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(twin_results, "write_report", fail)
        with pytest.raises(type(error)):
            run()
    assert (tmp_path / "out" / "recording.mcap").exists() and not (tmp_path / "out" / "report.html").exists()
    run()
    assert (tmp_path / "out" / "report.html").exists()


def test_bad_input_and_a_failure_before_the_first_file_leave_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario("lab-five-people", ["duration_s=0.3"])
    with pytest.raises(InputError, match="unknown"):
        run_scenario(scenario, trackers=["nobody"], out=tmp_path / "a" / "b", video=False, images=False)

    def fail(*arguments: object, **options: object) -> None:
        raise RuntimeError("a fault")

    monkeypatch.setattr(twin_run.Simulation, "deliveries", fail)
    with pytest.raises(RuntimeError, match="a fault"):
        run_scenario(scenario, trackers=[], out=tmp_path / "a" / "b", video=False, images=False)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not files


HOLDER = (
    "import sys, time\nfrom pathlib import Path\nfrom twin.run.out_folder import out_folder\n"
    "with out_folder(Path(sys.argv[1]), ['metrics.json']):\n"
    "    Path(sys.argv[1], '.metrics.json.1.partial').touch()\n"
    "    Path(sys.argv[1], '.recording.mcap.abc.partial').mkdir()\n"
    "    print('held', flush=True)\n    time.sleep(60)\n"
)


def test_two_runs_into_one_folder_cannot_be_and_a_killed_one_leaves_nothing(tmp_path: Path) -> None:
    out = tmp_path / "out"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(out)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None and holder.stdout.readline() == "held\n"
        scenario = load_scenario("lab-five-people", ["duration_s=0.3"])
        said = rf"--out {out}: process {holder.pid} on .* is writing there; another folder is expected"
        with pytest.raises(InputError, match=said):
            run_scenario(scenario, trackers=[], out=out, video=False, images=False)
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.communicate()
    (out / ".mine.partial").write_text("mine")
    assert {path.name for path in out.iterdir()} >= {LOCK, ".metrics.json.1.partial"}
    write(out, "metrics.json", "recording.mcap")
    assert sorted(path.name for path in out.iterdir()) == [MADE, ".mine.partial", "metrics.json", "recording.mcap"]


def test_a_lock_is_no_way_to_another_file(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / LOCK).symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="cannot be written"), locked_folder(tmp_path):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


def exported(path: Path) -> None:
    with whole_folder(path) as partial:
        (partial / "gt").mkdir()
        (partial / "gt" / "gt.txt").write_text("1,1")


def test_an_export_replaces_its_own_folder_and_no_other(tmp_path: Path) -> None:
    """`twin export RUN --out RUN` removed the run."""
    exported(tmp_path / "mot")
    exported(tmp_path / "mot")
    (tmp_path / "mot" / "gt" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds gt/notes.txt, which `twin export` did not write"):
        exported(tmp_path / "mot")
    write(tmp_path / "run", "metrics.json")
    with pytest.raises(InputError, match=r"run: exists and was not made by `twin export`; the name of a new folder"):
        exported(tmp_path / "run")
    assert (tmp_path / "run" / "metrics.json").exists() and (tmp_path / "mot" / "gt" / "notes.txt").exists()
    assert not [each.name for each in tmp_path.iterdir() if each.name not in ("mot", "run")]


def _suite(folder: Path) -> None:
    with result_files.open_store(folder, [], {}, resume=False):
        pass


def _study(folder: Path) -> None:
    with study_store.open_store(folder, {}, Workers(jobs=1), False, ProgressListener(), lambda n, now: None):
        pass


def _coverage(folder: Path) -> None:
    write_coverage(load_scenario("lab-five-people", ["duration_s=0.1"]), folder, Coverage(samples=1))


def _environment(folder: Path) -> None:
    write_environment(load_scenario("lab-five-people"), [(0.0, 1.5)], out=folder / "empty.npz")


@pytest.mark.parametrize(
    ("begin", "name"),
    [
        (_environment, "empty.png"),
        (_suite, "report.html"),
        (_suite, "summary.json"),
        (_study, "study.yaml"),
        (_coverage, "scenario.yaml"),
    ],
)
def test_no_file_that_twin_did_not_write_is_written_over(
    begin: Callable[[Path], None], name: str, tmp_path: Path
) -> None:
    """`twin study coverage scenario.yaml --out .` replaced the scenario by its resolved form, a study its own file."""
    (tmp_path / name).write_text("mine")
    with pytest.raises(
        InputError, match=f"holds {name}, which twin did not write; an empty folder, or one of an earlier"
    ):
        begin(tmp_path)
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [(name, "mine")]
    begin(tmp_path / "new")
