"""The page of a reproduction: one HTML file that needs nothing but itself."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from numpy.typing import NDArray

from twin.recording.whole_file import whole_file
from twin.reproduce.figure7 import FIRST_SCAN, MEAN_MAGNITUDE, N_PARTICLE, START_SPEED_M_S, MonteCarlo
from twin.reproduce.results import Curves, Result
from twin.reproduce.walk import PERIOD_S

_DECIMALS = {"1": 3, "%": 1, "BW": 3, "m": 3, "m/s": 2, "s": 3, "steps/min": 1}


def write_page(
    path: Path,
    runs: MonteCarlo,
    results: Sequence[Result],
    found: Sequence[Curves],
    figure6_svg: str,
    figure7_svg: str,
    command: str,
) -> None:
    """Write the page; it takes its name when it is whole. `command` is how to get the same again.

    Raises InputError where the file cannot be written.
    """
    page = template("page.html.j2").render(
        n_run=len(runs.seeds),
        seeds=f"{runs.seeds.start} to {runs.seeds[-1]}",
        n_scan=len(runs.walk),
        period_s=PERIOD_S,
        top_speed=float(runs.walk.speed.max()),
        maneuvers=[
            f"{maneuver.kind} {maneuver.start_t / PERIOD_S:.0f}–{maneuver.end_t / PERIOD_S:.0f}"
            for maneuver in runs.walk.maneuvers
        ],
        rows=[(result, *text_of(result)) for result in results],
        behind=[(curves.name, spans_text(runs.scans[~curves.lowest()[0]])) for curves in found],
        reading=MEAN_MAGNITUDE,
        n_particle=N_PARTICLE,
        first_scan=FIRST_SCAN,
        start_speed=START_SPEED_M_S,
        figure6=source_of(figure6_svg),
        figure7=source_of(figure7_svg),
        command=command,
    )
    with whole_file(path) as stream:
        stream.write(page)


def text_of(result: Result) -> tuple[str, str, str]:
    """The paper's figure, ours, and its interval, as written."""
    decimals = _DECIMALS[result.unit]
    unit = "" if result.unit == "1" else f" {result.unit}"

    def written(value: float) -> str:
        return f"{value:.{decimals}f}".replace("-", "−")

    paper = "–" if result.paper is None else written(result.paper) + unit
    low, high = result.ci95
    return paper, written(result.ours) + unit, f"{written(low)} to {written(high)}{unit}"


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
