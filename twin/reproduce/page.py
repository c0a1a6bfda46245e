"""The page of a reproduction: one HTML file that needs nothing but itself."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from numpy.typing import NDArray

from twin.recording.atomic_file import open_atomic
from twin.reproduce.results import Result

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

Row = tuple[Result, str, str, str]
"""A result, and the paper's figure, ours and its interval as written."""


def write_page(path: Path, template_name: str, command: str, drawn: Mapping[str, str], **content: Any) -> None:
    """Write a page from a template of this package; it takes its name when it is whole.

    command: how to get the same again; drawn: plots as SVG by name, `plots` in the template. Raises InputError where the
    file cannot be written.
    """
    plots = {name: source_of(svg) for name, svg in drawn.items()}
    page = template(template_name).render(command=command, plots=plots, **content)
    with open_atomic(path) as stream:
        stream.write(page)


def write_plots(folder: Path, drawn: Mapping[str, str]) -> dict[str, Path]:
    """Write plots as SVG under their names; their paths. Raises InputError where a file cannot be written."""
    paths = {name: folder / f"{name}.svg" for name in drawn}
    for name, svg in drawn.items():
        with open_atomic(paths[name]) as stream:
            stream.write(svg)
    return paths


def rows_of(results: Sequence[Result]) -> list[Row]:
    """Results as `rows.html.j2` shows them."""
    return [(result, *text_of(result)) for result in results]


def grid_of(results: Sequence[Result], intervals: bool = True) -> Mapping[str, object] | None:
    """Results as a table, a row a condition and tracker, a column a figure: of rows named "CONDITION, FIGURE", or of choices."""
    found: dict[str, dict[str, tuple[str, str, str]]] = {}
    for result, paper, ours, spread in rows_of(results):
        condition, _, figure = result.row.partition(", ")
        row, column = (f"{condition}: {result.column}", figure) if figure else (result.row, result.column)
        found.setdefault(row, {})[column] = (ours, spread if intervals else "", "" if result.paper is None else paper)
    columns = list(dict.fromkeys(column for row in found.values() for column in row))
    rows = [(row, [cells.get(column) for column in columns]) for row, cells in found.items()]
    return {"columns": columns, "rows": rows} if found else None


def text_of(result: Result) -> tuple[str, str, str]:
    """The paper's figure, ours, and its interval, as written."""
    paper = "–" if result.paper is None else written(result.paper, result.unit)
    low, high = result.ci95
    unit = _unit(result.unit)
    return (
        paper,
        written(result.ours, result.unit),
        f"{_number(low, result.unit)} to {_number(high, result.unit)}{unit}",
    )


def written(value: float, unit: str) -> str:
    """A figure with its unit."""
    return _number(value, unit) + _unit(unit)


def _number(value: float, unit: str) -> str:
    return f"{value:.{_DECIMALS[unit]}f}".replace("-", "−")


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def spans_text(scans: NDArray[np.intp]) -> str:
    """Ascending scans in words, neighbours together: "3, 7–9"; "none" without any."""
    if len(scans) == 0:
        return "none"
    runs = np.split(scans, np.flatnonzero(np.diff(scans) > 1) + 1)
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)


def source_of(svg: str) -> str:
    """An SVG document as the source of an image within the page."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()


@cache
def template(name: str) -> Template:
    """A page of this package, on the base that all share."""
    environment = Environment(
        loader=PackageLoader("twin.reproduce", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
