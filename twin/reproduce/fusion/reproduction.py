"""`twin reproduce fusion`: the tracker of all sensors beside the published systems, rig by rig, and with sensors taken away.

The grounds are the entries of the suite `fusion`, in tables by the prefix of their names; in each the best of the other
trackers is the one of the highest mean HOTA over the same recordings. Then recordings of a home of six sensors are tracked
again: by subsets of the sensors, and with each sensor silent for ten seconds. The best of the others is there that of the
entry's other trackers on the same subset; for a silent sensor, on the rig that never had it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.feeding import track_frames
from trackers.observations import NS_PER_S
from trackers.presets import available
from twin.evaluate.summary import evaluate_tracks
from twin.messages import OnProgress, no_progress
from twin.recording.tables import track_table
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import ResultRow, SystemValue, pivot_each, rows_of, write_reproduction
from twin.reproduce.suite_runs import (
    LoadedRecording,
    SuiteRuns,
    check_entries,
    load_seeded_suite,
    metric_arrays,
    run_conditions,
)
from twin.suites.expansion import Case
from twin.suites.metrics import flatten_metrics
from twin.suites.spec import Suite

OURS, HOME = "fusion", "home-six"
"""The tracker, and the entry of the suite whose recordings are tracked again."""
GROUNDS, DRAWN, DENSITY, FAULTS = "grounds", "drawn rooms", "density", "faults"
SUBSETS, SILENT = "subsets of sensors", "one sensor silent"
TABLES = (GROUNDS, DRAWN, DENSITY, FAULTS, SUBSETS, SILENT)
"""Tables of results, in the order of the page."""
_TABLE_OF_PREFIX = {"drawn-": DRAWN, "density-": DENSITY, "fault-": FAULTS}
_SILENT_S = (20.0, 30.0)
"""Between these times from the start on, one sensor says nothing [s]."""
COLUMNS = (
    ("hota", "HOTA", "1", 1.0),
    ("mota", "MOTA", "1", 1.0),
    ("idf1", "IDF1", "1", 1.0),
    ("id_switches", "id switches", "/run", 1.0),
    ("motp_m", "position", "m", 1.0),
    ("head_error_m.x", "head x", "m", 1.0),
    ("head_error_m.y", "head y", "m", 1.0),
    ("head_error_m.z", "head z", "m", 1.0),
    ("head_yaw_median_rad", "head yaw, median", "°", float(np.degrees(1.0))),
    ("disposal.merge_split.share", "merges right", "1", 1.0),
    ("ms_per_frame.mean", "CPU time per frame", "ms", 1.0),
)
"""Metric of `metrics.json`, its column, unit, and the factor to that unit."""
_STREAM = "fusion bootstrap"

Way = tuple[tuple[str, ...], str | None]
"""Sensors by which a recording is tracked, and the one of them that is silent for ten seconds, if any."""
ByTracker = dict[str, dict[str, Array]]
"""Metrics of n runs by tracker and name, (n,) each, NaN where one does not apply."""


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Run the suite, track the home's recordings again, and write results and the page into `folder`.

    `--runs`: how many subsets of the sensors are tracked: all, each left out and each alone first. Raises InputError for a
    suite without the home, with an entry without this tracker, or with another tracker of the home that is none of the
    presets; for a folder with another reproduction's runs (or the same one's, without `resume`), for conditions with fewer
    than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    runs = run_conditions(folder, suite, path, request, on_progress)
    cases = list(runs.by_condition[HOME].values())
    return write_all(folder, runs, replays(cases, runs, request.runs, on_progress), request.command)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the home of six sensors, with an entry without the tracker, or with a tracker of
    the home that the suite defines.
    """
    check_entries(suite, path, {HOME: "whose sensors are taken away"}, [OURS])
    home = next(entry for entry in suite.scenarios if (entry.name or entry.scenario) == HOME)
    for name in home.trackers or suite.trackers:
        if name not in available():
            raise InputError(
                f"{path}: scenarios: {HOME}: trackers: {name!r} is defined by the suite; presets are expected, by which "
                "the recordings are tracked again"
            )


def table_of(ground: str) -> str:
    """Return the table of an entry of the suite, by the prefix of its name."""
    return next((table for prefix, table in _TABLE_OF_PREFIX.items() if ground.startswith(prefix)), GROUNDS)


def write_all(folder: Path, runs: SuiteRuns, replayed: Sequence[ResultRow], command: str) -> Outputs:
    """Write results and page. Raises InputError where a file cannot be written."""
    found = [*ground_results(runs), *replayed]
    results = [each for table in TABLES for each in rows_of(found, table)]
    seeds = next(iter(runs.by_condition.values()))
    paths = write_reproduction(
        folder,
        command,
        "fusion/page.html.j2",
        results,
        {},
        grids=pivot_each(results, *TABLES),
        notes={
            table: {each.row: f"baseline: {each.baseline.tracker}" for each in rows_of(results, table) if each.baseline}
            for table in TABLES
        },
        n_run=len(seeds),
        seeds=f"{min(seeds)} to {max(seeds)}",
        not_done=runs.not_done,
    )
    return results, paths


def ground_results(runs: SuiteRuns) -> list[ResultRow]:
    """Compute each ground's metrics: ours, and those of the best of the other trackers there."""
    found = []
    for name, by_seed in runs.by_condition.items():
        metrics = metric_arrays(list(by_seed.values()), runs.metrics)
        others = {tracker: of for tracker, of in metrics.items() if tracker != OURS}
        found += results_beside(table_of(name), name, metrics[OURS], others, min(by_seed))
    return found


def results_beside(where: str, row: str, ours: Mapping[str, Array], others: ByTracker, seed: int) -> list[ResultRow]:
    """Compute the results of a row: our mean of each metric, and that of the other tracker with the highest mean HOTA."""
    hota = {tracker: np.nan_to_num(of["hota"]).mean() for tracker, of in others.items()}
    best = max(hota, key=lambda tracker: hota[tracker], default=None)
    found = []
    for metric, label, unit, factor in COLUMNS:
        theirs = others[best].get(metric) if best else None
        value = None if best is None or theirs is None else SystemValue.mean(best, factor * theirs, seed, _STREAM)
        values = factor * ours.get(metric, np.array([np.nan]))
        found += ResultRow.of_runs(where, row, label, values, unit, seed, _STREAM, baseline=value)
    return found


def metrics_of_way(seen: LoadedRecording, seed: int, tracker: str, way: Way) -> dict[str, float] | None:
    """Track a recording by some of its sensors, and evaluate; None where the tracker cannot use such a rig."""
    sensors, silent = way
    main = seen.rig.main if seen.rig.main in sensors else None
    rig = seen.rig.model_copy(update={"sensors": {name: seen.rig.sensors[name] for name in sensors}, "main": main})
    background = [each for each in seen.background if each.sensor in sensors]
    low, high = (seen.observations[0].stamp_ns + round(t_s * NS_PER_S) for t_s in _SILENT_S)
    heard = [
        each
        for each in seen.observations
        if each.sensor in sensors and not (each.sensor == silent and low <= each.stamp_ns < high)
    ]
    try:
        made = replace(seen, rig=rig, background=background).tracker(tracker, seed)
    except InputError:
        if tracker == OURS:
            raise
        return None
    found = flatten_metrics(evaluate_tracks(seen.truth, track_table(track_frames(made, rig, heard))))
    return {name: np.nan if (value := found.get(name)) is None else value for name, *_ in COLUMNS}


def subsets(names: Sequence[str], most: int | None) -> Iterator[tuple[str, ...]]:
    """Yield subsets of sensors: all, each left out, each alone, then the rest, the larger ones first; at most so many.

    most: None: all, each left out and each alone.
    """
    n = len(names)
    sizes = list(dict.fromkeys([n, n - 1, 1, *range(n - 2, 1, -1)]))
    every = [each for size in sizes if size for each in combinations(names, size)]
    first = sum(len(each) in (n, n - 1, 1) for each in every)
    yield from every[: first if most is None else most]


def rows_of_ways(names: Sequence[str], most: int | None) -> dict[tuple[str, str], tuple[Way, Way]]:
    """Return our way to track and that of the other trackers by table and row: at most so many subsets, and each sensor
    silent, beside the others on the rig that never had it.
    """
    found: dict[tuple[str, str], tuple[Way, Way]] = {}
    for each in subsets(names, most):
        found[SUBSETS, " + ".join(each) if len(each) < len(names) else "all"] = (each, None), (each, None)
    for name in names:
        without = tuple(each for each in names if each != name)
        found[SILENT, name] = (tuple(names), name), (without, None)
    return found


def replays(
    runs_of_home: Sequence[Mapping[str, Case]], runs: SuiteRuns, most: int | None, on_progress: OnProgress
) -> list[ResultRow]:
    """Track the home's recordings again, by subsets of their sensors and with each sensor silent.

    runs_of_home: cases of each run by tracker; most: how many subsets, as in `subsets`.
    """
    first = runs_of_home[0][OURS]
    others = [name for name in runs_of_home[0] if name != OURS]
    tracked: dict[tuple[str, Way], list[dict[str, float] | None]] = {}
    rows: dict[tuple[str, str], tuple[Way, Way]] = {}
    for number, by_tracker in enumerate(runs_of_home):
        seen = LoadedRecording.of(by_tracker[OURS], runs)
        rows = rows_of_ways(list(seen.rig.sensors), most)
        ways = {(OURS, way): None for way, _ in rows.values()}
        ways |= {(name, way): None for _, way in rows.values() if way[0] for name in others}
        for step, (tracker, way) in enumerate(ways):
            on_progress("recordings tracked again", number * len(ways) + step, len(runs_of_home) * len(ways))
            found = metrics_of_way(seen, by_tracker[OURS].seed, tracker, way)
            tracked.setdefault((tracker, way), []).append(found)
    return replay_results(rows, tracked, first.seed)


def replay_results(
    rows: Mapping[tuple[str, str], tuple[Way, Way]],
    tracked: Mapping[tuple[str, Way], Sequence[Mapping[str, float] | None]],
    seed: int,
) -> list[ResultRow]:
    """Compute the results of rows: ours, and those of the best of the others that can use the rig.

    tracked: metrics of each run by tracker and way, None where the tracker cannot use the rig.
    """
    found = []
    for (where, row), (our_way, their_way) in rows.items():
        arrays = {
            tracker: {name: np.array([run[name] for run in known]) for name in known[0]}
            for (tracker, way), each in tracked.items()
            if way == (our_way if tracker == OURS else their_way)
            and len(known := [run for run in each if run is not None]) == len(each)
        }
        ours = arrays.pop(OURS)
        found += results_beside(where, row, ours, arrays, seed)
    return found
