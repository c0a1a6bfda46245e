"""A folder of results: one run at a time, nothing of the user's touched, nothing of a killed run left."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trackers.errors import InputError
from twin.recording.atomic_file import open_atomic
from twin.run import live as twin_run, outcome as twin_results
from twin.run.live import run_scenario
from twin.run.out_folder import LOCK, MADE, locked_folder, out_folder
from twin.scenario import load_scenario

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
