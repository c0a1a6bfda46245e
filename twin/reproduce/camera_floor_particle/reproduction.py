"""Everything `twin reproduce camera-floor-particle` leaves behind."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Sequence
from pathlib import Path

from trackers.errors import InputError
from twin.recording.atomic_file import atomic_path
from twin.reproduce.camera_floor_particle.masks import mask_results
from twin.reproduce.camera_floor_particle.plots import course_svg, head_errors, heads_svg
from twin.reproduce.camera_floor_particle.replays import (
    CHOICE,
    SEED,
    TIME,
    choices,
    closest_s,
    lowest_s,
    moment_picture,
)
from twin.reproduce.camera_floor_particle.tables import (
    ABLATION,
    BEYOND,
    COURSE,
    EXPERIMENTS,
    HOME,
    MOVEMENTS,
    NEEDED,
    OURS,
    PAIR,
    called,
    conditions_of,
    results_of,
)
from twin.reproduce.page import grid_of, rows_of, write_page, write_plots
from twin.reproduce.registry import Asked, Found, OnProgress
from twin.reproduce.results import Result, write_results
from twin.reproduce.suite_runs import SuiteRuns, read_runs, run_in, suite_of, tracks_of, truth_of
from twin.suites.cluster import Workers
from twin.suites.spec import Suite

_SHOWN = (("crossing", "figure 4"), ("going-back", "figure 4"), (PAIR, "one cluster"), (HOME, "figure 5"))
"""Conditions of which a moment is drawn, and what it stands for."""


def reproduce(folder: Path, asked: Asked, on_progress: OnProgress | None = None) -> Found:
    """Run the suite and write results, plots, pictures of moments and the page into `folder`.

    Raises InputError for a suite without the paper's experiments, for a folder that holds another reproduction's runs (or the
    same one's, without `resume`), for conditions with fewer than two whole runs, and where a file cannot be written.
    """
    suite, path = suite_of(asked.suite or asked.name, asked.seed_range)
    check_suite(suite, path)
    cache = run_in(folder, suite, path, Workers(asked.jobs), asked.resume, on_progress)
    runs = read_runs(suite, path, folder, cache)
    command = asked.command + (f" --suite {shlex.quote(asked.suite)}" if asked.suite else "")
    return write_all(folder, runs, [*mask_results(runs), *choices(cache, on_progress)], command)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without one of the paper's experiments, or with one that the tracker is not run in."""
    entries = {entry.name or entry.scenario: entry for entry in suite.scenarios}
    for name in NEEDED:
        if name not in entries:
            raise InputError(f"{path}: scenarios: none is named {name}; one, an experiment of the paper, is expected")
    for name, entry in entries.items():
        if OURS not in (entry.trackers or suite.trackers):
            raise InputError(f"{path}: scenarios: {name} is run without {OURS}; it is expected among the trackers")


def write_all(folder: Path, runs: SuiteRuns, more: Sequence[Result], command: str) -> Found:
    """Write what was found: results, plots, pictures, page. Raises InputError as files do."""
    conditions = conditions_of(runs)
    results = [*results_of(conditions), *more]
    cases = {name: next(iter(runs.by_condition[name].values())) for name in NEEDED}
    course = {called(name): tracks_of(case, runs) for name, case in cases[COURSE].items()}
    errors = [head_errors(truth_of(cases[name][OURS], runs), tracks_of(cases[name][OURS], runs)) for name in MOVEMENTS]
    drawn = {"figure6": course_svg(truth_of(cases[COURSE][OURS], runs), course), "heads": heads_svg(errors)}
    pictures = {}
    for name, what in _SHOWN:
        case = cases[name][OURS]
        truth = truth_of(case, runs)
        at_s = lowest_s(truth) if name == HOME else closest_s(truth)
        pictures[f"{name}, seed {case.seed}, {at_s:.2f} s ({what})"] = moment_picture(case, runs.cache, at_s)
    paths = {"results": folder / "results.json", "page": folder / "report.html"}
    paths |= {name: folder / f"{name}.svg" for name in drawn}
    write_results(paths["results"], results)
    write_plots(folder, drawn)
    for said, jpeg in pictures.items():
        with atomic_path(folder / f"moment-{said.split(',')[0]}.jpg") as partial:
            partial.write_bytes(jpeg)
    write_page(
        paths["page"],
        "camera_floor_particle/page.html.j2",
        command,
        drawn,
        grids={
            where: grid
            for where in (EXPERIMENTS, BEYOND, CHOICE, TIME)
            if (
                grid := grid_of(
                    [each for each in results if each.where == where], intervals=where not in (CHOICE, TIME)
                )
            )
        },
        ablations=rows_of([each for each in results if each.where == ABLATION]),
        pictures={said: "data:image/jpeg;base64," + base64.b64encode(jpeg).decode() for said, jpeg in pictures.items()},
        n_run=len(conditions[HOME].seeds),
        seeds=f"{conditions[HOME].seeds[0]} to {conditions[HOME].seeds[-1]}",
        not_done=runs.not_done,
        choice_seed=SEED,
    )
    return results, paths
