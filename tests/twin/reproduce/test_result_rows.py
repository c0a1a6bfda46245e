"""Rows of results: four columns, in the file, on the page and on the terminal."""

from __future__ import annotations

import json

from twin.reproduce.registry import template
from twin.reproduce.results import (
    Interval,
    ResultRow,
    SystemValue,
    format_rows,
    pivot_rows,
    print_results,
    write_results,
)

FULL = ResultRow.of(
    "table", "home, lost", "both", Interval(1.0, 0.5, 1.5), "/run", 4, 8.0,
    SystemValue.of("mine-paper", Interval(7.25, 6.0, 9.0)), SystemValue("sort", 12.5, (11.0, 14.0)),
)  # fmt: skip
BARE = ResultRow.of("table", "hall, lost", "both", Interval(2.0, 2.0, 2.0), "/run", 4)


def rows_page(rows: list[ResultRow]) -> str:
    return template("rows.html.j2").module.rows_table(format_rows(rows))  # pyright: ignore[reportAttributeAccessIssue]


def test_results_are_read_back_as_they_were_written(tmp_path):
    write_results(tmp_path / "results.json", [FULL, BARE])
    fields = json.loads((tmp_path / "results.json").read_text())
    assert fields[0]["paper_system"] == {"tracker": "mine-paper", "value": 7.25, "ci95": [6.0, 9.0]}
    assert fields[1]["paper_system"] is fields[1]["baseline"] is None
    assert [ResultRow.from_json(each) for each in fields] == [FULL, BARE]


def test_tables_show_the_systems_that_were_run(capsys):
    page, grid = rows_page([FULL, BARE]), pivot_rows([FULL])
    for text in ("The paper’s system here", "7.25 /run", "6.00 to 9.00 /run", "12.50 /run", "Baseline"):
        assert text in page
    assert "Baseline" not in rows_page([BARE])
    assert grid is not None and "the paper’s system here 7.25 /run" in str(grid["rows"])
    print_results("made up", [FULL, BARE])
    printed = capsys.readouterr().out
    assert "baseline" in printed and "12.50 /run" in printed
    print_results("made up", [BARE])
    assert "baseline" not in capsys.readouterr().out
