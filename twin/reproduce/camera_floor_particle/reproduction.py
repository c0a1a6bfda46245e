"""Everything `twin reproduce camera-floor-particle` leaves behind."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from trackers.errors import InputError
from twin.recording.tables import TrackTable, TruthTable, read_tracks, read_truth
from twin.recording.whole_file import whole_path
from twin.reproduce.camera_floor_particle.plots import course_svg, head_errors, heads_svg
from twin.reproduce.camera_floor_particle.replays import CHOICE, SEED, choices, closest_s, lowest_s, moment_picture
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
from twin.reproduce.page import rows_of, write_page, write_plots
from twin.reproduce.registry import Asked, Found, OnProgress
from twin.reproduce.results import Result, write_results
from twin.reproduce.suite_runs import SUITE_FOLDER, SuiteRuns, read_runs, run_in, suite_of
from twin.suites.cases import Case
from twin.suites.description import Suite
from twin.suites.fingerprint import recording_key
from twin.suites.run import Place
from twin.suites.worker import TRUTH, record, renderer_of, resolved_scenario

_SHOWN = (("crossing", "figure 4"), ("going-back", "figure 4"), (PAIR, "one cluster"), (HOME, "figure 5"))
"""Conditions of which a moment is drawn, and what it stands for."""


def reproduce(folder: Path, asked: Asked, on_progress: OnProgress | None = None) -> Found:
    """Run the suite and write results, plots, pictures of moments and the page into `folder`.

    Raises InputError for a suite without the paper's experiments, for a folder that holds another reproduction's runs (or the
    same one's, without `resume`), for conditions with fewer than two whole runs, and where a file cannot be written.
    """
    suite, path = suite_of(asked.suite or asked.name, asked.seed_range)
    check_suite(suite, path)
    cache = run_in(folder, suite, path, Place(asked.jobs), asked.resume, on_progress)
    runs = read_runs(suite, path, folder, cache)
    command = asked.command + (f" --suite {shlex.quote(asked.suite)}" if asked.suite else "")
    return write_all(folder, runs, choices(cache, on_progress), command)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without one of the paper's experiments, or with one that the tracker is not run in."""
    entries = {entry.name or entry.scenario: entry for entry in suite.scenarios}
    for name in NEEDED:
        if name not in entries:
            raise InputError(f"{path}: scenarios: none is named {name}; one, an experiment of the paper, is expected")
    for name, entry in entries.items():
        if OURS not in (entry.trackers or suite.trackers):
            raise InputError(f"{path}: scenarios: {name} is run without {OURS}; it is expected among the trackers")


def write_all(folder: Path, runs: SuiteRuns, chosen: Sequence[Result], command: str) -> Found:
    """Write what was found: results, plots, pictures, page. Raises InputError as files do."""
    conditions = conditions_of(runs)
    results = [*results_of(conditions), *chosen]
    cases = {name: next(iter(runs.by_condition[name].values())) for name in NEEDED}
    course = {called(name): _tracks(case, runs) for name, case in cases[COURSE].items()}
    errors = [head_errors(_truth(cases[name][OURS], runs), _tracks(cases[name][OURS], runs)) for name in MOVEMENTS]
    drawn = {"figure6": course_svg(_truth(cases[COURSE][OURS], runs), course), "heads": heads_svg(errors)}
    pictures = {}
    for name, what in _SHOWN:
        case = cases[name][OURS]
        truth = _truth(case, runs)
        at_s = lowest_s(truth) if name == HOME else closest_s(truth)
        pictures[f"{name}, seed {case.seed}, {at_s:.2f} s ({what})"] = moment_picture(case, runs.cache, at_s)
    paths = {"results": folder / "results.json", "page": folder / "report.html"}
    paths |= {name: folder / f"{name}.svg" for name in drawn}
    write_results(paths["results"], results)
    write_plots(folder, drawn)
    for said, jpeg in pictures.items():
        with whole_path(folder / f"moment-{said.split(',')[0]}.jpg") as partial:
            partial.write_bytes(jpeg)
    write_page(
        paths["page"],
        "camera_floor_particle/page.html.j2",
        command,
        drawn,
        grids={where: grid for where in (EXPERIMENTS, BEYOND, CHOICE) if (grid := _grid(results, where))},
        ablations=rows_of([each for each in results if each.where == ABLATION]),
        pictures={said: "data:image/jpeg;base64," + base64.b64encode(jpeg).decode() for said, jpeg in pictures.items()},
        n_run=len(conditions[HOME].seeds),
        seeds=f"{conditions[HOME].seeds[0]} to {conditions[HOME].seeds[-1]}",
        not_done=runs.not_done,
        choice_seed=SEED,
    )
    return results, paths


def _truth(case: Case, runs: SuiteRuns) -> TruthTable:
    """The truth of a case's recording, made again where it has left the cache."""
    scenario = resolved_scenario(case)
    key = recording_key(case.resolved, renderer_of(scenario))
    with runs.cache.recording(key, lambda folder: record(scenario, folder)) as (entry, _):
        return read_truth(entry / TRUTH)


def _tracks(case: Case, runs: SuiteRuns) -> TrackTable:
    return read_tracks(runs.folder / SUITE_FOLDER / "cases" / case.id / "tracks" / f"{case.tracker}.csv")


def _grid(results: Sequence[Result], where: str) -> Mapping[str, object] | None:
    """Results of one kind as a table: a row a condition and tracker, or a choice; a column a figure."""
    found: dict[str, dict[str, tuple[str, str, str]]] = {}
    for result, paper, ours, spread in rows_of([each for each in results if each.where == where]):
        condition, _, figure = result.row.partition(", ")
        row, column = (f"{condition}: {result.column}", figure) if figure else (result.row, result.column)
        shown = "" if where == CHOICE else spread
        found.setdefault(row, {})[column] = (ours, shown, "" if result.paper is None else paper)
    columns = list(dict.fromkeys(column for row in found.values() for column in row))
    rows = [(row, [cells.get(column) for column in columns]) for row, cells in found.items()]
    return {"columns": columns, "rows": rows} if found else None
