"""Output that is not UTF-8 neither ends a command nor loses its results, whatever names files have."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ASCII = {"LC_ALL": "C", "LANG": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
SCENARIO = "name: two\ndescription: Zwei gehen – „Büro“ 人 😀\nextends: lab-five-people\nduration_s: 1\n"


def twin(folder: Path, environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[bytes]:
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "twin", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path} | environment,
        capture_output=True,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a run, whose files have names beyond ASCII, was made with LANG=C."""
    folder = tmp_path_factory.mktemp("aus")
    (folder / "büro.yaml").write_text(SCENARIO, encoding="utf-8")
    done = twin(folder, ASCII, "run", "büro.yaml", "--no-images", "--no-video", "--tracker", "sort", "--out", "ört")
    assert done.returncode == 0, done.stderr
    assert b"MOTA" in done.stdout
    return folder


def test_a_run_with_names_beyond_ascii_is_whole_where_python_cannot_decode_them(ran: Path) -> None:
    page = (ran / "ört" / "report.html").read_text(encoding="utf-8")
    assert "ört" in page or "büro" in page
    for path in (ran / "ört").rglob("*"):
        if path.suffix in (".html", ".json", ".csv", ".yaml"):
            path.read_text(encoding="utf-8")


@pytest.mark.sample(4)
@pytest.mark.parametrize(
    "arguments",
    [
        ("list",),
        ("schema", "scenario"),
        ("run", "--help"),
        ("run", "fehlt-ö"),
        ("evaluate", "ört/truth.csv", "ört/tracks/sort.csv"),
        ("track", "ört/recording.mcap", "--tracker", "sort", "--no-video", "--out", "wieder-ö"),
        ("suite", "run", "fehlt-人"),
        ("study", "run", "fehlt-人"),
    ],
    ids=" ".join,
)
def test_no_command_ends_or_loses_its_result(ran: Path, arguments: tuple[str, ...]) -> None:
    done = twin(ran, ASCII, *arguments)
    wrong = any("fehlt" in each for each in arguments)
    assert done.returncode == (2 if wrong else 0), done.stderr
    assert b"Traceback" not in done.stderr
    assert done.stderr.strip().startswith(b"twin: ") if wrong else done.stdout.strip()


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
def test_a_stream_shows_what_it_lacks_as_escapes(ran: Path, encoding: str) -> None:
    done = twin(ran, {"PYTHONIOENCODING": encoding}, "run", "fehlt-人")
    assert done.returncode == 2 and done.stderr.startswith(b"twin: there is no scenario 'fehlt-\\u4eba'"), done.stderr


@pytest.mark.sample(9)
@pytest.mark.parametrize(
    ("streams", "is_lost"),
    [
        (">&-", True),
        ("1</dev/null", True),
        pytest.param(
            ">/dev/full", True, marks=pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
        ),
        ("<&-", False),
        ("2>&-", False),
        ("2</dev/null", False),
        ("| head -1", False),
        ("<&- >&- 2>&-", None),
    ],
)
@pytest.mark.parametrize("arguments", ["list trackers", "new room --out new.xml"])
def test_an_output_that_is_lost_is_said(tmp_path: Path, arguments: str, streams: str, is_lost: bool | None) -> None:
    """None: nothing can be said either, and only the exit code is left."""
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        ["sh", "-c", f'"$0" -m twin {arguments} {streams}', sys.executable],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path, "PYTHONUNBUFFERED": ""},
        capture_output=True,
        timeout=300,
        check=False,
    )
    said = done.stderr.decode()
    assert done.returncode == (0 if is_lost is False else 2)
    assert (said.startswith("twin: output: ") and said.endswith("is expected\n")) if is_lost else not said
    assert said.count("\n") == (1 if is_lost else 0)
    assert (tmp_path / "new.xml").exists() == ("room" in arguments)
