"""Reproduction of Bai and Takahashi for `twin reproduce laser-fisheye-imm`."""

from __future__ import annotations

import csv
import shlex
from pathlib import Path

from twin.recording.atomic_file import open_atomic
from twin.reproduce.incidents import FilmStrip, draw_film_strips, write_film_strips, write_incidents
from twin.reproduce.laser_fisheye_imm.figure7 import NPE, NVE, MonteCarlo, curves, figure7_results, simulate
from twin.reproduce.laser_fisheye_imm.page_content import choose_incidents, figure7_content, lab_content
from twin.reproduce.laser_fisheye_imm.plots import (
    conditions_svg,
    densities_svg,
    errors_svg,
    figure9_svg,
    table_one_svg,
    walk_svg,
)
from twin.reproduce.laser_fisheye_imm.runs import COLUMNS, NAMES, LabRuns, check_suite, read_lab
from twin.reproduce.laser_fisheye_imm.table_one import lab_results
from twin.reproduce.laser_fisheye_imm.walk import maneuvering_walk
from twin.reproduce.page import write_page, write_plots
from twin.reproduce.registry import OnProgress, Outputs, Request
from twin.reproduce.results import format_rows, write_results
from twin.reproduce.suite_runs import load_seeded_suite, read_runs, run_conditions, warn_of_failure
from twin.suites.cluster import Workers

N_RUN = 100
"""Monte-Carlo runs of figure 7, as in the paper."""


def reproduce(folder: Path, request: Request, on_progress: OnProgress | None = None) -> Outputs:
    """Run figure 7 and the suite and write results, plots, film strips and page into `folder`.

    Raises InputError for an invalid suite, for a folder with another reproduction's runs (or the same one's, without
    `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    name, n_run = request.suite or request.name, request.runs or N_RUN
    suite, path = load_seeded_suite(name, request.seed_range)
    check_suite(suite, path)
    place = Workers(request.jobs)
    cache = run_conditions(folder, suite, path, place, request.resume, on_progress)
    lab = read_lab(read_runs(suite, path, folder, cache, list(NAMES)))
    runs = simulate(maneuvering_walk(), range(request.seed, request.seed + n_run), on_progress)
    strips = draw_film_strips(
        choose_incidents(lab), NAMES, cache, place, on_progress, lambda what: warn_of_failure("strip", what)
    )
    command = request.command + f" --runs {n_run}" + (f" --suite {shlex.quote(request.suite)}" if request.suite else "")
    return write_all(folder, runs, lab, strips, command)


def write_all(folder: Path, runs: MonteCarlo, lab: LabRuns, strips: list[FilmStrip], command: str) -> Outputs:
    """Write results, tables of runs and incidents, plots, film strips and page. Raises InputError where a file cannot
    be written.
    """
    found = curves(runs)
    results = [*figure7_results(runs), *lab_results(lab)]
    drawn = {
        "figure6": walk_svg(runs.walk),
        "figure7": errors_svg(runs.walk, runs.scans, found),
        "figure9": figure9_svg(lab.first, lab.area),
        "table1": table_one_svg(lab.paper_condition),
    }
    if len(lab.densities) > 1:
        drawn["densities"] = densities_svg(lab.densities, lab.area_m2)
    if lab.others:
        drawn["conditions"] = conditions_svg([lab.paper_condition, *lab.others])
    paths = {"results": folder / "results.json", "runs": folder / "runs.csv", "incidents": folder / "incidents.csv"}
    paths |= {name: folder / f"{name}.svg" for name in drawn} | {"page": folder / "report.html"}
    write_results(paths["results"], results)
    write_runs(paths["runs"], lab)
    write_incidents(paths["incidents"], (each for condition in lab.conditions for each in condition.incidents), NAMES)
    write_film_strips(folder / "strips", strips)
    write_plots(folder, drawn)
    write_page(
        paths["page"],
        "laser_fisheye_imm/page.html.j2",
        command,
        drawn,
        figure7_rows=format_rows([each for each in results if each.where in (NPE, NVE)]),
        lab_rows=format_rows([each for each in results if each.where not in (NPE, NVE)]),
        figure7=figure7_content(runs, found),
        lab=lab_content(lab, strips),
    )
    return results, paths


def write_runs(path: Path, lab: LabRuns) -> None:
    """Write every run as a row: condition, seed, column, people, person_minutes, long_occlusions, and its metrics."""
    metrics = ("misidentifications", "lost_tracks", "id_switches", "mota", "idf1", "motp_m")
    with open_atomic(path) as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(("condition", "seed", "column", "people", "person_minutes", "long_occlusions", *metrics))
        for condition in lab.conditions:
            for column in COLUMNS:
                found = condition.metrics[column.tracker]
                for place, seed in enumerate(condition.seeds):
                    hidden = sum(each.seed == seed for each in condition.long_occlusions)
                    minutes = f"{condition.person_minutes[place]:.4f}"
                    own = (f"{found[name][place]:g}" for name in metrics)
                    rows.writerow((condition.name, seed, column.name, condition.n_person, minutes, hidden, *own))
