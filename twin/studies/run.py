"""Run a study: search placements, validate the recommended one, and write the results."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from trackers.errors import InputError
from trackers.plain_data import dump_yaml
from twin.models import cache_folder
from twin.recording.atomic_file import open_atomic
from twin.run.inputs import NONE_TRUSTED, TrustedClasses
from twin.scenario import load_scenario
from twin.studies.apply_placement import write_scenario
from twin.studies.candidate_set import BASELINE
from twin.studies.coverage import PoseCoverage
from twin.studies.page import write_page
from twin.studies.preflight import prepare
from twin.studies.results import StudyResults, summarize, write_table
from twin.studies.search import Result, Searcher
from twin.studies.store import FILE, open_store
from twin.studies.trials import TrialRunner, losses, pareto_fronts
from twin.studies.validation import (
    displaced_differences,
    held_out_differences,
    indistinguishable,
    rank_correlations,
    values_with_one_fewer,
)
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Workers
from twin.suites.progress import ProgressListener


@contextmanager
def run_study(
    name: str | Path,
    out: Path | None,
    place: Workers,
    *,
    resume: bool = False,
    seed_offset: int = 0,
    trusted: TrustedClasses = NONE_TRUSTED,
) -> Iterator[tuple[StudyResults, Path]]:
    """Search and validate; yield the results and the folder (default: out/study-<name>), locked during the block.

    Raises InputError for bad input, before anything is written.
    """
    start = time.perf_counter()
    prepared = prepare(name, seed_offset=seed_offset, trusted=trusted)
    study = prepared.study
    folder = out if out is not None else Path("out") / f"study-{study.name}"
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    run = TrialRunner(prepared, cache)
    Searcher(study, prepared.candidate_set, None, run.evaluate).check(str(prepared.path))
    coverage = PoseCoverage(study, prepared.candidate_set, cache)
    searcher = Searcher(study, prepared.candidate_set, coverage, run.evaluate)
    run.trials = searcher.result.trials
    first = None if resume and (folder / FILE).exists() else run.check_metrics()
    facts = study.model_dump(mode="json", by_alias=True)
    listener = ProgressListener(warned=_warn)
    with open_store(folder, facts, place, resume, listener, run.progress) as evaluations:
        run.evaluations = evaluations
        if first is not None:
            evaluations.record(*first)
        result = searcher.run()
        results = _results(run, coverage, result, start)
        for trial in results.front:
            if trial.coverage is None:
                trial.coverage, trial.coverage_worst = coverage.share(trial.placement), coverage.worst(trial.placement)
        yield results, folder


def _warn(message: str) -> None:
    sys.stderr.write(f"twin: warning: {message}\n")


def _results(run: TrialRunner, coverage: PoseCoverage, result: Result, start_s: float) -> StudyResults:
    study, candidate_set = run.study, run.candidate_set
    objective, baseline = study.objectives[0], result.trials[BASELINE]
    tried = [each for each in result.trials.values() if not each.failure]
    whole = [each for each in tried if not run.prepared.trackers or len(each.seeds) >= study.search.replicates[-1]]
    budget = study.constraints.budget
    mine = [each for each in whole if each is not baseline or budget is None or baseline.price <= budget]
    if not mine or all(each is baseline for each in whole):
        failure = next((each.failure for each in result.trials.values() if each.failure), "none was found")
        raise InputError(
            f"{run.prepared.path}: no placement could be tried on all seeds ({failure}); other places or weaker constraints are "
            "expected"
        )
    loss = losses(mine, study.objectives, study.scenarios)
    front = [each for each, number in zip(mine, pareto_fronts(loss), strict=True) if number == 0]
    best = mine[int(np.lexsort((np.arange(len(mine)), loss[:, 0]))[0])]
    if study.cheapest_within is not None:
        near = [
            each
            for each, row in zip(mine, loss, strict=True)
            if row[0] <= loss[:, 0].min() + study.cheapest_within + 1e-12
        ]
        best = min(
            near,
            key=lambda each: (
                each.price,
                each.value(objective, study.scenarios) * (-1 if objective.more_is_better else 1),
            ),
        )
    if best.coverage is None:
        best.coverage, best.coverage_worst = coverage.share(best.placement), coverage.worst(best.placement)
    held = [row for each in study.validated for row in held_out_differences(run, best, each)]
    less = values_with_one_fewer(run, coverage, best)
    off = displaced_differences(run, best, study.validated[0]) if study.validated else []
    return StudyResults(
        run.prepared, coverage, result, baseline, best, tuple(sorted(front, key=lambda each: each.price)),
        tuple(indistinguishable(tried, best, objective, study)), tuple(held), tuple(less), tuple(off),
        tuple(rank_correlations(tried, candidate_set, objective, study)),
        run.evaluations.n_evaluated if run.evaluations is not None else 0, time.perf_counter() - start_s, run.cache,
    )  # fmt: skip


def write_results(folder: Path, results: StudyResults) -> dict[str, Path]:
    """Write every file except the evaluations, each under its name when complete; return their paths."""
    files = {
        "candidates": folder / "candidates.csv",
        "pareto": folder / "pareto.csv",
        "recommended": folder / "recommended.yaml",
        "study": folder / "study.yaml",
        "summary": folder / "summary.json",
        "report": folder / "report.html",
    }
    study = results.prepared.study
    trials = list(results.result.trials.values())
    write_table(files["candidates"], trials, results)
    write_table(files["pareto"], results.front, results)
    file = next(iter(results.prepared.files.values()))
    moved = results.scenario_with(results.best.placement)
    write_scenario(
        files["recommended"], load_scenario(file), moved, file, f"{moved.name}-recommended",
        f"{moved.name} with its sensors as the study {study.name} recommends.",
    )  # fmt: skip
    with open_atomic(files["study"]) as stream:
        stream.write(dump_yaml(study.model_dump(mode="json", exclude_none=True, by_alias=True)))
    with open_atomic(files["summary"]) as stream:
        json.dump(summarize(results), stream, indent=2, ensure_ascii=False)
        stream.write("\n")
    write_page(files["report"], results)
    return files
