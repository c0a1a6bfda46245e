"""`twin reproduce fusion`: the tracker of all sensors beside the published systems, rig by rig, and with sensors taken away.

The grounds are the entries of the suite `fusion`; in each the best of the other trackers is the one of the highest mean HOTA
over the same recordings. Then recordings of a home of six sensors are tracked again: by subsets of the sensors, and with each
sensor silent for ten seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.evaluate.summary import evaluate_tracks
from twin.messages import OnProgress, no_progress
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import ResultRow, SystemValue, format_rows, pivot_rows, rows_of, write_reproduction
from twin.reproduce.suite_runs import (
    LoadedRecording,
    SuiteRuns,
    check_entries,
    load_seeded_suite,
    metric_arrays,
    run_conditions,
)
from twin.suites.expansion import Case
from twin.suites.spec import Suite

OURS, HOME = "fusion", "home-six"
"""The tracker, and the entry of the suite whose recordings are tracked again."""
GROUNDS, SUBSETS, SILENT = "grounds", "subsets of sensors", "one sensor silent"
_SILENT_S = (20.0, 30.0)
"""Between these times from the start on, one sensor says nothing [s]."""
_METRICS = (("hota", "HOTA", "1"), ("mota", "MOTA", "1"), ("idf1", "IDF1", "1"), ("motp_m", "position", "m"))
_TIME = "ms_per_frame.mean"
_STREAM = "fusion bootstrap"


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Run the suite, track the home's recordings again, and write results and the page into `folder`.

    `--runs`: how many subsets of the sensors are tracked: each alone, each left out and all first. Raises InputError for a suite
    without the home, or with an entry without this tracker, for a folder with another reproduction's runs (or the same one's,
    without `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    runs = run_conditions(folder, suite, path, request, on_progress)
    cases = [by_tracker[OURS] for by_tracker in runs.by_condition[HOME].values()]
    return write_all(folder, runs, replays(cases, runs, request.runs, on_progress), request.command)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the home of six sensors, or with an entry without the tracker."""
    check_entries(suite, path, {HOME: "whose sensors are taken away"}, [OURS])


def write_all(folder: Path, runs: SuiteRuns, replayed: Sequence[ResultRow], command: str) -> Outputs:
    """Write results and page. Raises InputError where a file cannot be written."""
    results = [*ground_results(runs), *replayed]
    seeds = next(iter(runs.by_condition.values()))
    paths = write_reproduction(
        folder,
        command,
        "fusion/page.html.j2",
        results,
        {},
        grounds=format_rows(rows_of(results, GROUNDS)),
        grids={name: pivot_rows(rows_of(results, name)) for name in (SUBSETS, SILENT)},
        n_run=len(seeds),
        seeds=f"{min(seeds)} to {max(seeds)}",
        not_done=runs.not_done,
    )
    return results, paths


def ground_results(runs: SuiteRuns) -> list[ResultRow]:
    """Compute each ground's metrics: ours, and those of the other tracker with the highest mean HOTA there."""
    found = []
    for name, by_seed in runs.by_condition.items():
        metrics, seed = metric_arrays(list(by_seed.values()), runs.metrics), min(by_seed)
        others = {tracker: of["hota"].mean() for tracker, of in metrics.items() if tracker != OURS}
        best = max(others, key=lambda tracker: others[tracker], default=None)
        for metric, label, unit in (*_METRICS, (_TIME, "CPU time per frame", "ms")):
            values = metrics[OURS].get(metric, np.full(len(by_seed), np.nan))
            other = metrics[best].get(metric) if best else None
            value = None if best is None or other is None else SystemValue.mean(best, other, seed, _STREAM)
            found += ResultRow.of_runs(GROUNDS, name, label, values, unit, seed, _STREAM, baseline=value)
    return found


def metrics_of_subset(
    seen: LoadedRecording, seed: int, sensors: Sequence[str], silent: str | None = None
) -> dict[str, float]:
    """Track a recording by these of its sensors, one of them silent for ten seconds, and evaluate."""
    main = seen.rig.main if seen.rig.main in sensors else None
    rig = seen.rig.model_copy(update={"sensors": {name: seen.rig.sensors[name] for name in sensors}, "main": main})
    low, high = (seen.observations[0].stamp_ns + round(t_s * NS_PER_S) for t_s in _SILENT_S)
    heard = replace(
        seen,
        rig=rig,
        background=[each for each in seen.background if each.sensor in sensors],
        observations=[
            each
            for each in seen.observations
            if each.sensor in sensors and not (each.sensor == silent and low <= each.stamp_ns < high)
        ],
    )
    metrics = evaluate_tracks(seen.truth, heard.track(OURS, seed))
    return {name: np.nan if metrics[name] is None else metrics[name] for name, *_ in _METRICS}


def subsets(names: Sequence[str], most: int | None) -> Iterator[tuple[str, ...]]:
    """Yield subsets of sensors: all, each left out, each alone, then the rest, the larger ones first; at most so many.

    most: None: all, each left out and each alone.
    """
    n = len(names)
    sizes = list(dict.fromkeys([n, n - 1, 1, *range(n - 2, 1, -1)]))
    every = [each for size in sizes if size for each in combinations(names, size)]
    first = sum(len(each) in (n, n - 1, 1) for each in every)
    yield from every[: first if most is None else most]


def replays(cases: Sequence[Case], runs: SuiteRuns, most: int | None, on_progress: OnProgress) -> list[ResultRow]:
    """Track the recordings of these cases again, by subsets of their sensors and with each sensor silent."""
    by_way: dict[tuple[str, str], list[Mapping[str, float]]] = {}
    for number, case in enumerate(cases):
        seen = LoadedRecording.of(case, runs)
        names = list(seen.rig.sensors)
        ways = [
            (SUBSETS, " + ".join(each) if len(each) < len(names) else "all", each, None)
            for each in subsets(names, most)
        ]
        ways += [(SILENT, name, tuple(names), name) for name in names]
        for step, (where, row, sensors, silent) in enumerate(ways):
            on_progress("recordings tracked again", number * len(ways) + step, len(cases) * len(ways))
            by_way.setdefault((where, row), []).append(metrics_of_subset(seen, case.seed, sensors, silent))
    return list(_replay_results(by_way, cases[0].seed))


def _replay_results(by_way: Mapping[tuple[str, str], Sequence[Mapping[str, float]]], seed: int) -> Iterator[ResultRow]:
    for (where, row), found in by_way.items():
        for metric, label, unit in _METRICS:
            values: Array = np.array([each[metric] for each in found])
            yield from ResultRow.of_runs(where, row, label, values, unit, seed, _STREAM)
