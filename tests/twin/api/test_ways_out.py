"""What a user types, and how it ends: one sentence on stderr, an exit code that says what it was, no traceback."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from command_line import Ended, twin

SUITE = """
name: tiny
description: "[/b] and [red]"
seeds: 1
trackers: [sort]
scenarios:
  - {scenario: lab-five-people, set: {duration_s: 1, background_frames: 2}, variants: [{people.ann.shirt: red}, {}]}
"""
NO_IMAGES = ["--no-images", "--no-video"]
PROGRAM = "import sys; sys.argv[0] = 'twin'; {prepare}; from twin.cli import main; main()"


def in_python(*arguments: str | Path, prepare: str = "pass", **environment: str | None) -> Ended:
    known = {name: value for name, value in {**os.environ, **environment}.items() if value is not None}
    known["PYTHONPATH"] = os.pathsep.join(filter(None, [str(Path(__file__).parents[3]), known.get("PYTHONPATH")]))
    command = [sys.executable, "-c", PROGRAM.format(prepare=prepare), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=200, env=known)


def said(found: Ended, code: int = 2) -> str:
    """The one sentence with which it ended."""
    assert found.returncode == code and "Traceback" not in found.stderr, found.stderr
    last = found.stderr.strip().splitlines()[-1]
    assert last.startswith("twin: "), found.stderr
    return last


def test_twin_alone_and_its_groups_print_help_and_version() -> None:
    for group in ([], ["suite"], ["study"]):
        found = twin(*group)
        assert found.returncode == 0 and "Usage:" in found.stdout and not found.stderr
    assert twin("--version").stdout.startswith("roomtwin ")
    assert "did you mean 'sort'?" in said(twin("run", "lab-five-people", "--tracker", "sotr"))
    assert "'run'" in said(twin("rnu")) and "Valid are run, render" in said(in_python("rnu"))


@pytest.mark.parametrize("command", ["list rooms", "check lab", "new room", "study run meeting-room-cameras"])
def test_current_folder_that_is_gone_ends_in_no_traceback(command: str, tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    twin_there = f"rmdir ../gone; exec {sys.executable} -m twin {command}"
    path = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(["sh", "-c", twin_there], cwd=tmp_path / "gone", env=path, capture_output=True, text=True)
    assert "Traceback" not in done.stderr and done.returncode in (0, 2)
    assert done.returncode == 0 or done.stderr.splitlines()[-1].startswith("twin: ")


@pytest.mark.parametrize("command", [["list"], ["schema"], ["--help"]])
def test_closed_pipe_is_quiet(command: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", "twin", *command], stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("width", [None, 50, 80, 200])
def test_list_keeps_its_columns_apart(
    width: int | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from twin.command_options import print_listed

    entries = {"short": "one", "a-name-that-is-longer-than-the-column-was": "two words " * 9}
    if width is not None:
        monkeypatch.setenv("COLUMNS", str(width))
        monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    print_listed("things", entries)
    lines = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()
    assert width is None or max(map(len, lines)) <= width
    assert not any("column-wastwo" in line for line in lines)
    assert width is not None or len(lines) == 3


def test_control_characters_are_escaped() -> None:
    message = said(twin("run", "\x1b[31mred\x07"))
    assert "\x1b" not in message and "\\x1b[31mred\\x07" in message


@pytest.mark.slow
def test_user_without_home_is_told_what_to_name(tmp_path: Path) -> None:
    prepare = "import pwd; pwd.getpwuid = lambda uid: {}[uid]"
    nobody = {"HOME": None, "XDG_CACHE_HOME": None, "ROOMTWIN_CACHE": None}
    assert "ROOMTWIN_CACHE" in said(in_python("suite", "cache", prepare=prepare, **nobody))
    named = nobody | {"ROOMTWIN_CACHE": str(tmp_path)}
    assert in_python("suite", "cache", prepare=prepare, **named).returncode == 0


ENDS = "typer.Typer.__call__ = lambda *_, **__: os.kill(os.getpid(), signal.{})"


@pytest.mark.parametrize("name", ["SIGABRT", "SIGSEGV", "SIGBUS"])
def test_library_that_ends_the_process_for_want_of_memory_is_put_in_words(name: str) -> None:
    prepare = "import os, resource, signal, typer; resource.setrlimit(resource.RLIMIT_CORE, (0, 0)); {}" + ENDS.format(
        name
    )
    limited = prepare.format("resource.setrlimit(resource.RLIMIT_AS, (2**31,) * 2); ")
    assert "(ulimit -v), which is not enough" in said(in_python("list", prepare=limited))
    without = in_python("list", prepare=prepare.format(""))  # no limit, no such excuse
    assert without.returncode == -getattr(signal, name)


@pytest.mark.slow
@pytest.mark.parametrize("limit_mb", [100, 400, 781])
def test_limit_of_memory_is_named(limit_mb: int, tmp_path: Path) -> None:
    prepare = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({limit_mb * 2**20},) * 2)"
    found = in_python("run", "lab-five-people", "--duration", "1", "--out", tmp_path / "out", prepare=prepare)
    assert "ulimit -v" in said(found)


@pytest.mark.slow
def test_suite_says_what_is_wrong_with_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    suite = tmp_path / "tiny.yaml"
    suite.write_text(SUITE.replace("people.ann.shirt: red", "duration_s: 0.5"))
    blocked = tmp_path / "file"
    blocked.write_text("")
    found = twin("suite", "run", suite, "--out", tmp_path / "none", ROOMTWIN_CACHE=str(blocked / "cache"))
    assert "ROOMTWIN_CACHE" in said(found) and not (tmp_path / "none").exists()

    out, cache = tmp_path / "out", str(tmp_path / "cache")
    found = twin("suite", "run", suite, "--jobs", "1", "--out", out, ROOMTWIN_CACHE=cache)
    assert found.returncode == 0, found.stderr
    table = twin("suite", "compare", out, out, "--markdown")
    assert table.returncode == 0 and "0 worse, 0 better" in table.stdout and "┃" not in table.stdout

    with closing(sqlite3.connect(out / "results.sqlite", isolation_level=None)) as connection:
        connection.execute("UPDATE cases SET status = 'failed', error = '[/b] [red] \x1b[2J'")
    shown = twin("suite", "show", out)
    assert shown.returncode == 0 and "[/b] [red] \\x1b[2J" in shown.stdout, shown.stderr

    holder = sqlite3.connect(out / "results.sqlite", isolation_level=None)
    holder.execute("PRAGMA locking_mode = EXCLUSIVE")
    holder.execute("BEGIN EXCLUSIVE")
    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda path, timeout=0, **more: connect(path, timeout=0.1, **more))
    message = said(twin("suite", "show", out))
    holder.close()
    assert "another process holds it" in message and "no file of results" not in message


@pytest.mark.nightly
@pytest.mark.slow
def test_class_in_a_suite_of_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "of_this_suite.py").write_text(
        "class Mine:\n    def __init__(self, rig, background, rng): pass\n"
        "    def update(self, observation): pass\n    def tracks(self): return []\n"
    )
    (tmp_path / "tiny.yaml").write_text(
        SUITE.replace("[sort]", '["of_this_suite:Mine"]').replace("{people.ann.shirt: red}, ", "")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    refused = said(twin("suite", "run", "tiny.yaml", "--out", "out"))
    assert "--allow-plugins" in refused and "--tracker" not in refused
    for jobs in ("1", "2"):  # two: in processes of their own, which have to find the class too
        run = ["suite", "run", "tiny.yaml", "--allow-plugins", "--jobs", jobs, "--out", f"out-{jobs}"]
        found = twin(*run, ROOMTWIN_CACHE=str(tmp_path / f"cache-{jobs}"))
        assert found.returncode == 0 and "failed" not in found.stdout, found.stdout + found.stderr


IDS = {
    "Largest": "2**63 - 1",
    "Large": "2**40",
    "TooLarge": "2**63",
    "Unique": "uuid.uuid4()",
    "Text": "'7'",
    "None_": "0",
}


@pytest.mark.slow
@pytest.mark.parametrize("good", [True, False])
def test_ids_of_a_plug_in_cost_nobody_else_anything(
    good: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = ["import uuid", "from trackers.tracks import Track", "class Mine:",
             "    def __init__(self, rig, background, rng): pass", "    def update(self, observation): pass"]  # fmt: skip
    for name, number in IDS.items():
        lines += [f"class {name}(Mine):", f"    def tracks(self): return [Track({number}, 0.0, 0.0)]"]
    module = f"mine_{good}".lower()  # each found once in this process
    (tmp_path / f"{module}.py").write_text("\n".join(lines))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    names = [name for name in IDS if name.startswith("Large") == good]
    run = ["run", "lab-five-people", "--duration", "1", *NO_IMAGES, "--tracker", "sort"]
    for name in names:
        run += ["--tracker", f"{module}:{name}"]
    found = twin(*run, "--out", "out")
    assert (tmp_path / "out/metrics.json").exists() and "MOTA" in found.stdout, found.stderr
    if good:
        assert found.returncode == 0, found.stderr
    else:
        said(found, 1)
        assert all(f"{module}:{name}" in found.stderr for name in names), found.stderr
        assert found.stderr.count("a whole number from 1 to 2**63 - 1") == len(names), found.stderr
