"""What a person at a terminal sees."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import pytest

from twin.console import PlainConsole, print_metrics, print_paths, print_table, print_warning, without_empty
from twin.messages import TrackerLog, at_work, short_path


def test_paths_stand_in_one_column(capsys: pytest.CaptureFixture[str]) -> None:
    print_paths({"truth": Path("out/truth.csv"), "truth_situations": Path("out/truth_situations.csv")})
    lines = capsys.readouterr().out.splitlines()
    assert [line.index("out/") for line in lines] == [len("truth_situations") + 2] * 2


@pytest.mark.parametrize("width", [24, 60, 100, 200])
def test_tables_cut_nothing_on_terminals_of_any_width(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Values that do not fit beside the names follow in further tables; a value stays on one line."""
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr(PlainConsole, "is_terminal", True)
    heads = ["scenario", "tracker", "HOTA", "Misidentified", "behind by > 0.01"]
    rows = [
        ["lab-five-people, dark", "laser-imm", "+0.024 (0.1 to 0.2)", "0.3", "12.0%"],
        None,
        ["all", "sort", *"123"],
    ]
    print_table(heads, rows, names=2)
    text = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out)
    values = {word for row in rows if row is not None for cell in (*row[:2], *heads) for word in cell.split()}
    values |= {"+0.024 (0.1 to 0.2)", "0.3", "12.0%", "1", "2", "3"}
    assert [each for each in values if each not in text] == [] and "…" not in text
    assert text.count("sort") == {24: 3, 60: 2, 100: 1, 200: 1}[width]
    assert max(map(len, text.splitlines())) <= max(width, 54)


@pytest.mark.parametrize("width", [60, 100])
def test_a_file_is_as_wide_as_columns_says(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    heads, rows = ["tracker", *(f"metric number {n}" for n in range(12))], [["sort", *["0.123"] * 12]]
    monkeypatch.setenv("COLUMNS", str(width))
    print_table(heads, rows)
    narrow = capsys.readouterr().out
    assert max(map(len, narrow.splitlines())) <= width and narrow.count("0.123") == 12
    monkeypatch.delenv("COLUMNS")
    print_table(heads, rows)
    assert capsys.readouterr().out.count("sort") == 1


def test_columns_without_a_value_are_left_out_and_names_never() -> None:
    rows = [["a", "–", "0.1", "–"], None, ["b", "–", "–", "–"]]
    assert without_empty(["name", "x", "y", "z"], rows, 1) == (["name", "y"], [["a", "0.1"], None, ["b", "–"]])
    assert without_empty(["name", "also", "y", "z"], rows, 2)[0] == ["name", "also", "y"]


def test_a_table_without_rows_has_its_headings(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(["tracker", "HOTA"], [])
    assert "tracker" in capsys.readouterr().out


def test_metrics_of_three_trackers_fit_a_terminal_without_a_break(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(PlainConsole, "is_terminal", True)
    judged = {"frames": 299, "frames_total": 300, "share": 299 / 300, "person_frames": 299}
    own = {"mota": 0.9, "id_switches": 1, "judged": judged, "ms_per_frame": {"mean": 3.1}}
    trackers = {name: own for name in ("laser-legs", "laser-imm", "sort")}
    print_metrics({"trackers": trackers, "scenario": "own", "seed": 0, "duration_s": 20, "realtime_factor": 4.8})
    text = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out)
    rows = [
        [cell.strip() for cell in line.strip("│┃").split("│")] for line in text.splitlines() if line.startswith("│")
    ]
    assert all(row[0] and len(row) == 4 and all(row) for row in rows)
    assert ["Identity switches", "1", "1", "1"] in rows and text.count("299 of 300 frames") == 1


def test_what_a_tracker_logs_is_printed_once_as_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    TrackerLog.install()
    TrackerLog.install()  # as where one process calls the command line twice
    logging.getLogger("trackers.fusion.tracker").warning("camera_2 hardly shows the people")
    print_warning("fusion: camera_2 hardly shows the people")
    print_warning("fusion: another")
    TrackerLog.printed.clear()
    said = capsys.readouterr().err.splitlines()
    assert said == ["twin: warning: fusion: camera_2 hardly shows the people", "twin: warning: fusion: another"]


def test_what_a_tracker_logs_begins_with_the_name_that_was_typed(capsys: pytest.CaptureFixture[str]) -> None:
    TrackerLog.install()
    log = logging.getLogger("trackers.laser_fisheye_imm.tracker")
    with at_work("laser-imm"):
        log.warning("one")
        with at_work("mine"):
            log.warning("one")
    log.warning("one")
    TrackerLog.printed.clear()
    said = [line.removeprefix("twin: warning: ") for line in capsys.readouterr().err.splitlines()]
    assert said == ["laser-imm: one", "mine: one", "laser-fisheye-imm: one"]


def test_a_path_below_the_working_folder_is_named_from_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any other stays as it was given: one with `..` would lead elsewhere from elsewhere."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert short_path(tmp_path / "here" / "out" / "report.html") == str(Path("out", "report.html"))
    for path in (str(tmp_path / "baseline.json"), "../baseline.json", "out/report.html"):
        assert short_path(path) == path
