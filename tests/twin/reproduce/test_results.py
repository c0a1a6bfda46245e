"""Results of reproductions: rows of four columns, in the file, on the page and on the terminal; bootstrap intervals."""

from __future__ import annotations

import json

import numpy as np
from pydantic import TypeAdapter

from twin.report.palette import page_template
from twin.reproduce.results import (
    Bootstrap,
    Interval,
    ResultRow,
    SystemValue,
    band,
    format_rows,
    interval,
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
    return page_template("twin.reproduce", "rows.html.j2").module.rows_table(format_rows(rows))  # pyright: ignore[reportAttributeAccessIssue]


def test_results_are_read_back_as_they_were_written(tmp_path):
    write_results(tmp_path / "results.json", [FULL, BARE])
    fields = json.loads((tmp_path / "results.json").read_text())
    assert fields[0]["paper_system"] == {"tracker": "mine-paper", "value": 7.25, "ci95": [6.0, 9.0]}
    assert fields[1]["paper_system"] is fields[1]["baseline"] is None
    assert TypeAdapter(list[ResultRow]).validate_python(fields) == [FULL, BARE]


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


def test_the_runs_as_they_are_come_first():
    rng = np.random.default_rng(0)
    above, below = rng.random((30, 4)), rng.random((30, 4)) + 1
    replicates = Bootstrap(30, rng, 50)
    ratio = replicates.ratio(above, below)
    assert ratio.shape == (51, 4)
    np.testing.assert_allclose(ratio[0], above.sum(axis=0) / below.sum(axis=0))
    np.testing.assert_array_equal(replicates.counts.sum(axis=1), 30)
    middle, low, high = band(ratio)
    np.testing.assert_array_equal(middle, ratio[0])
    assert (low < high).all()
    assert interval(ratio[:, 2]).value == ratio[0, 2] and interval(ratio[:, 2]).low == low[2]


def test_an_interval_of_95_percent_holds_the_truth_about_as_often():
    rng, held = np.random.default_rng(1), 0
    for _ in range(300):
        above, below = rng.normal(2.0, 0.5, (60, 1)), rng.normal(4.0, 0.5, (60, 1))
        found = interval(Bootstrap(60, rng, 400).ratio(above, below)[:, 0])
        held += found.low <= 0.5 <= found.high
    assert 0.90 <= held / 300 <= 0.98


def test_runs_that_agree_have_an_interval_of_no_width():
    found = interval(Bootstrap(5, np.random.default_rng(2)).ratio(np.full((5, 1), 3.0), np.full((5, 1), 4.0))[:, 0])
    np.testing.assert_allclose((found.value, found.low, found.high), 0.75)


def test_a_run_without_events_leaves_the_interval_of_a_share_to_the_others():
    found = interval(
        Bootstrap(2, np.random.default_rng(2)).ratio(np.array([[0.0], [3.0]]), np.array([[0.0], [4.0]]))[:, 0]
    )
    assert found.value == found.low == found.high == 0.75
