"""Reproduction of published gait for `twin reproduce gait`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twin.reproduce.gait.comparison import STATURE_M, STATURE_SPREAD_M, GaitRuns, gait_results, simulate_gait
from twin.reproduce.gait.plots import loads_svg, speeds_svg, stance_svg
from twin.reproduce.gait.published import (
    PERSON_SPEED_M_S,
    PERSON_STATURE_M,
    PERSON_STEPS_APART,
    SOURCES,
    SUBJECT_FILE,
    SUBJECT_MASS_KG,
    read_subject,
)
from twin.reproduce.page import write_page, write_plots
from twin.reproduce.registry import OnProgress, Outputs, Request
from twin.reproduce.results import ResultRow, format_rows, write_results


def reproduce(folder: Path, request: Request, on_progress: OnProgress | None = None) -> Outputs:
    """Let one body per seed walk and run; write results, plots and page into `folder`.

    `request.data`: folder of the subject's recording (None: published data only). Raises InputError for a missing or invalid
    recording, and where a file cannot be written.
    """
    seeds, data = request.seed_range, request.data
    subject = None if data is None else read_subject(data)
    runs = simulate_gait(seeds, subject, on_progress)
    results = gait_results(runs)
    drawn = {"stance": stance_svg(runs), "loads": loads_svg(runs), "speeds": speeds_svg(runs)}
    paths = {"results": folder / "results.json", "page": folder / "report.html"}
    write_results(paths["results"], results)
    paths |= write_plots(folder, drawn)
    command = request.command + ("" if data is None else f" --data {data}")
    write_page(paths["page"], "gait/page.html.j2", command, drawn, **_content(runs, results))
    return results, paths


def _content(runs: GaitRuns, results: list[ResultRow]) -> dict[str, Any]:
    seeds, compared = runs.seeds, runs.compared
    return {
        "n_run": len(seeds),
        "seeds": f"{seeds.start} to {seeds[-1]}",
        "rows": format_rows(results),
        "apart": None if compared is None else f"{compared.apart:.3f}",
        "feet_apart": None if compared is None else f"{compared.feet_apart:.3f}",
        "stature": f"{STATURE_M:.2f} ± {STATURE_SPREAD_M:.2f} m",
        "person": f"{PERSON_SPEED_M_S:g} m/s, {PERSON_STATURE_M:g} m tall",
        "steps_apart": f"{PERSON_STEPS_APART:g}",
        "subject_file": SUBJECT_FILE,
        "subject_mass": f"{SUBJECT_MASS_KG:g} kg",
        "sources": SOURCES,
    }
