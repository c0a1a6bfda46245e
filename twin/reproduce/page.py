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

from twin.recording.whole_file import whole_file
from twin.reproduce.figure7 import FIRST_SCAN, MEAN_MAGNITUDE, N_PARTICLE, START_SPEED_M_S, MonteCarlo
from twin.reproduce.results import NPE, NVE, Curves, Result
from twin.reproduce.walk import PERIOD_S

_DECIMALS = {"1": 3, "%": 1, "BW": 3, "m": 3, "m/s": 2, "s": 3, "steps/min": 1, "/run": 2, "/person-min": 2}


def write_page(
    path: Path,
    *,
    results: Sequence[Result],
    command: str,
    drawn: Mapping[str, str],
    figure7: Mapping[str, Any],
    lab: Mapping[str, Any],
) -> None:
    """Write the page of `laser-fisheye-imm`; it takes its name when it is whole.

    command: how to get the same again; drawn: plots as SVG by name; figure7, lab: what `figure7_content` and
    `lab_content` give. Raises InputError where the file cannot be written.
    """
    shown = [(result, *text_of(result)) for result in results]
    page = template("page.html.j2").render(
        figure7_rows=[row for row in shown if row[0].where in (NPE, NVE)],
        lab_rows=[row for row in shown if row[0].where not in (NPE, NVE)],
        plots={name: source_of(svg) for name, svg in drawn.items()},
        figure7=figure7,
        lab=lab,
        command=command,
    )
    with whole_file(path) as stream:
        stream.write(page)


def figure7_content(runs: MonteCarlo, found: Sequence[Curves]) -> dict[str, Any]:
    """What the page says of figure 7 and the walk of figure 6."""
    return {
        "n_run": len(runs.seeds),
        "seeds": f"{runs.seeds.start} to {runs.seeds[-1]}",
        "n_scan": len(runs.walk),
        "period_s": PERIOD_S,
        "top_speed": float(runs.walk.speed.max()),
        "maneuvers": [
            f"{maneuver.kind} {maneuver.start_t / PERIOD_S:.0f}–{maneuver.end_t / PERIOD_S:.0f}"
            for maneuver in runs.walk.maneuvers
        ],
        "behind": [(curves.name, spans_text(runs.scans[~curves.lowest()[0]])) for curves in found],
        "reading": MEAN_MAGNITUDE,
        "n_particle": N_PARTICLE,
        "first_scan": FIRST_SCAN,
        "start_speed": START_SPEED_M_S,
    }


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
