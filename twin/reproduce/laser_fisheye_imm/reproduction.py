"""Everything `twin reproduce laser-fisheye-imm` leaves behind."""

from __future__ import annotations

import shlex
from pathlib import Path

from twin.reproduce.laser_fisheye_imm.conditions import NAMES, LabRuns
from twin.reproduce.laser_fisheye_imm.figure7 import MonteCarlo, simulate
from twin.reproduce.laser_fisheye_imm.figure7_plots import errors_svg, walk_svg
from twin.reproduce.laser_fisheye_imm.figure7_results import NPE, NVE, curves, figure7_results
from twin.reproduce.laser_fisheye_imm.figure9 import figure9_svg
from twin.reproduce.laser_fisheye_imm.page_content import figure7_content, lab_content
from twin.reproduce.laser_fisheye_imm.run_tables import chosen_moments, write_runs
from twin.reproduce.laser_fisheye_imm.runs import check_suite, read_lab
from twin.reproduce.laser_fisheye_imm.table_one import lab_results
from twin.reproduce.laser_fisheye_imm.table_one_plots import conditions_svg, densities_svg, table_one_svg
from twin.reproduce.laser_fisheye_imm.walk import maneuvering_walk
from twin.reproduce.moments import Strip, draw_strips, write_moments, write_strips
from twin.reproduce.page import rows_of, write_page, write_plots
from twin.reproduce.registry import Asked, Found, OnProgress
from twin.reproduce.results import write_results
from twin.reproduce.suite_runs import read_runs, run_in, suite_of, tell_failure
from twin.suites.cluster import Workers

N_RUN = 100
"""Monte-Carlo runs of figure 7, the paper's."""


def reproduce(folder: Path, asked: Asked, on_progress: OnProgress | None = None) -> Found:
    """Run figure 7 and the suite and write results, plots, strips and page into `folder`.

    Raises InputError for a suite that cannot be, for a folder that holds another reproduction's runs (or the same one's,
    without `resume`), for conditions with fewer than two whole runs, and where a file cannot be written.
    """
    name, n_run = asked.suite or asked.name, asked.runs or N_RUN
    suite, path = suite_of(name, asked.seed_range)
    check_suite(suite, path)
    place = Workers(asked.jobs)
    cache = run_in(folder, suite, path, place, asked.resume, on_progress)
    lab = read_lab(read_runs(suite, path, folder, cache, list(NAMES)))
    runs = simulate(maneuvering_walk(), range(asked.seed, asked.seed + n_run), on_progress)
    strips = draw_strips(
        chosen_moments(lab), NAMES, cache, place, on_progress, lambda what: tell_failure("strip", what)
    )
    command = asked.command + f" --runs {n_run}" + (f" --suite {shlex.quote(asked.suite)}" if asked.suite else "")
    return write_all(folder, runs, lab, strips, command)


def write_all(folder: Path, runs: MonteCarlo, lab: LabRuns, strips: list[Strip], command: str) -> Found:
    """Write what was found: results, tables of runs and moments, plots, strips, page. Raises InputError as files do."""
    found = curves(runs)
    results = [*figure7_results(runs), *lab_results(lab)]
    drawn = {
        "figure6": walk_svg(runs.walk),
        "figure7": errors_svg(runs.walk, runs.scans, found),
        "figure9": figure9_svg(lab.first, lab.area),
        "table1": table_one_svg(lab.papers),
    }
    if len(lab.densities) > 1:
        drawn["densities"] = densities_svg(lab.densities, lab.area_m2)
    if lab.others:
        drawn["conditions"] = conditions_svg([lab.papers, *lab.others])
    paths = {"results": folder / "results.json", "runs": folder / "runs.csv", "moments": folder / "moments.csv"}
    paths |= {name: folder / f"{name}.svg" for name in drawn} | {"page": folder / "report.html"}
    write_results(paths["results"], results)
    write_runs(paths["runs"], lab)
    write_moments(paths["moments"], (each for condition in lab.conditions for each in condition.moments), NAMES)
    write_strips(folder / "strips", strips)
    write_plots(folder, drawn)
    write_page(
        paths["page"],
        "laser_fisheye_imm/page.html.j2",
        command,
        drawn,
        figure7_rows=rows_of([each for each in results if each.where in (NPE, NVE)]),
        lab_rows=rows_of([each for each in results if each.where not in (NPE, NVE)]),
        figure7=figure7_content(runs, found),
        lab=lab_content(lab, strips),
    )
    return results, paths
