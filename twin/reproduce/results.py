"""Results of a reproduction, row by row: the paper's value, ours and its interval; `results.json` and their texts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from twin.console import PlainConsole
from twin.recording.atomic_file import open_atomic
from twin.reproduce.bootstrap import Interval


@dataclass(frozen=True)
class ResultRow:
    """One value. paper: None where the paper prints none; ci95: over `runs` runs."""

    where: str
    row: str
    column: str
    paper: float | None
    ours: float
    ci95: tuple[float, float]
    unit: str
    runs: int

    @classmethod
    def of(
        cls, where: str, row: str, column: str, ours: Interval, unit: str, runs: int, paper: float | None = None
    ) -> ResultRow:
        """Make a result from a value with its interval."""
        return cls(where, row, column, paper, ours.value, (ours.low, ours.high), unit, runs)


_DECIMALS = {
    "1": 3,
    "%": 1,
    "BW": 3,
    "m": 3,
    "cm": 2,
    "m/s": 2,
    "s": 3,
    "steps/min": 1,
    "/run": 2,
    "/person-min": 2,
    "/min": 1,
    "ms": 2,
    "°": 0,
}

Row = tuple[ResultRow, str, str, str]
"""A result, and the texts of the paper's value, ours and its interval."""


def write_results(path: Path, results: Sequence[ResultRow]) -> None:
    """Write `results.json`: a list of objects with the fields of `ResultRow`. Raises InputError where it cannot be written."""
    with open_atomic(path) as stream_:
        json.dump([asdict(result) for result in results], stream_, indent=2)
        stream_.write("\n")


def format_rows(results: Sequence[ResultRow]) -> list[Row]:
    """Format results as `rows.html.j2` shows them."""
    return [(result, *format_result(result)) for result in results]


def pivot_rows(results: Sequence[ResultRow], intervals: bool = True) -> Mapping[str, object] | None:
    """Pivot results: a row per condition and tracker, a column per metric; of rows named "CONDITION, METRIC", or of
    choices.
    """
    found: dict[str, dict[str, tuple[str, str, str]]] = {}
    for result, paper, ours, spread in format_rows(results):
        condition, _, metric = result.row.partition(", ")
        row, column = (f"{condition}: {result.column}", metric) if metric else (result.row, result.column)
        found.setdefault(row, {})[column] = (ours, spread if intervals else "", "" if result.paper is None else paper)
    columns = list(dict.fromkeys(column for row in found.values() for column in row))
    rows = [(row, [cells.get(column) for column in columns]) for row, cells in found.items()]
    return {"columns": columns, "rows": rows} if found else None


def format_result(result: ResultRow) -> tuple[str, str, str]:
    """Format the paper's value, ours, and its interval."""
    paper = "–" if result.paper is None else format_value(result.paper, result.unit)
    low, high = result.ci95
    unit = _unit(result.unit)
    return (
        paper,
        format_value(result.ours, result.unit),
        f"{_number(low, result.unit)} to {_number(high, result.unit)}{unit}",
    )


def format_value(value: float, unit: str) -> str:
    """Format a value with its unit."""
    return _number(value, unit) + _unit(unit)


def _number(value: float, unit: str) -> str:
    return f"{value:.{_DECIMALS[unit]}f}".replace("-", "−")


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def format_ranges(scans: NDArray[np.intp]) -> str:
    """Format ascending scans, neighbours together: "3, 7–9"; "none" without any."""
    if len(scans) == 0:
        return "none"
    runs = np.split(scans, np.flatnonzero(np.diff(scans) > 1) + 1)
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)


def print_results(title: str, results: Sequence[ResultRow]) -> None:
    """Print a table on stdout, the paper's values beside ours."""
    table = Table(title=title)
    for heading in ("where", "row", "metric"):
        table.add_column(heading)
    for heading in ("paper", "ours", "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for result in results:
        table.add_row(result.where, result.row, result.column, *format_result(result))
    PlainConsole(width_of_file=150).print(table)
