"""A study from its file to its answers: searched, judged by what nothing was chosen by, written for people and programs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackers.errors import InputError
from twin.models import cache_folder
from twin.run.chosen_trackers import NONE_TRUSTED, TrustedClasses
from twin.scenario import Scenario
from twin.studies.aftermath import Beside, alike, what_moved
from twin.studies.coverage import Seen
from twin.studies.description import Objective
from twin.studies.evaluations import FILE, open_evaluations
from twin.studies.judging import held_out, hung_beside, with_one_fewer
from twin.studies.layout import OWN, Candidate
from twin.studies.placed import placed
from twin.studies.prepare import Prepared, prepare
from twin.studies.search import Result, Searcher
from twin.studies.trial import Trial, fronts, losses
from twin.studies.trying import Trying
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.cluster import Place
from twin.suites.progress import Watcher


@dataclass(frozen=True, eq=False)
class Answers:
    """What a study found: see the fields of the report."""

    prepared: Prepared
    seen: Seen
    result: Result
    own: Trial
    best: Trial
    front: tuple[Trial, ...]
    alike: tuple[tuple[Trial, Beside], ...]
    held_out: tuple[Beside, ...]
    fewer: tuple[tuple[Candidate, float], ...]
    misplaced: tuple[Beside, ...]
    moved_by: tuple[tuple[str, float, int], ...]
    evaluated: int
    spent_s: float
    cache: RecordingCache

    @property
    def objective(self) -> Objective:
        """The first objective."""
        return self.prepared.study.objectives[0]

    def placed(self, candidate: Candidate) -> Scenario:
        """The study's first scenario with a candidate's sensors."""
        options = [self.prepared.layout.options[each] for each in candidate]
        return placed(self.prepared.study, self.prepared.scenario, options)


@contextmanager
def run_study(
    name: str | Path,
    out: Path | None,
    place: Place,
    *,
    resume: bool = False,
    seed_offset: int = 0,
    trusted: TrustedClasses = NONE_TRUSTED,
) -> Iterator[tuple[Answers, Path]]:
    """Search and judge: the answers, and the folder (default: out/study-<name>), which is held while the block runs.

    Raises InputError for bad input, before anything is written.
    """
    start = time.perf_counter()
    prepared = prepare(name, seed_offset=seed_offset, trusted=trusted)
    study = prepared.study
    folder = out if out is not None else Path("out") / f"study-{study.name}"
    cache = RecordingCache(cache_folder(), cache_limit_bytes())
    run = Trying(prepared, cache)
    Searcher(study, prepared.layout, None, run.fill).check(str(prepared.path))
    seen = Seen(study, prepared.layout, cache)
    run.searcher = Searcher(study, prepared.layout, seen, run.fill)
    first = None if resume and (folder / FILE).exists() else run.first_look()
    facts = study.model_dump(mode="json", by_alias=True)
    watcher = Watcher(warned=_warn)
    with open_evaluations(folder, facts, place, resume, watcher, run.progress) as evaluations:
        run.evaluations = evaluations
        if first is not None:
            evaluations.hold(*first)
        result = run.searcher.run()
        answers = _answers(run, seen, result, start)
        for trial in answers.front:
            if trial.coverage is None:
                trial.coverage, trial.coverage_worst = seen.share(trial.candidate), seen.worst(trial.candidate)
        yield answers, folder


def _warn(message: str) -> None:
    sys.stderr.write(f"twin: warning: {message}\n")


def _answers(run: Trying, seen: Seen, result: Result, start_s: float) -> Answers:
    study, layout = run.study, run.layout
    objective, own = study.objectives[0], result.trials[OWN]
    tried = [each for each in result.trials.values() if not each.why]
    whole = [each for each in tried if not run.prepared.trackers or len(each.seeds) >= study.search.replicates[-1]]
    budget = study.constraints.budget
    mine = [each for each in whole if each is not own or budget is None or own.price <= budget]
    if not mine or all(each is own for each in whole):
        why = next((each.why for each in result.trials.values() if each.why), "none was found")
        raise InputError(
            f"{run.prepared.path}: no placement could be tried on all seeds ({why}); other places or weaker constraints are "
            "expected"
        )
    loss = losses(mine, study.objectives, study.scenarios)
    front = [each for each, number in zip(mine, fronts(loss), strict=True) if number == 0]
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
        best.coverage, best.coverage_worst = seen.share(best.candidate), seen.worst(best.candidate)
    held = [row for each in study.judged for row in held_out(run, best, each)]
    less = with_one_fewer(run, seen, best)
    off = hung_beside(run, best, study.judged[0]) if study.judged else []
    return Answers(
        run.prepared, seen, result, own, best, tuple(sorted(front, key=lambda each: each.price)),
        tuple(alike(tried, best, objective, study)), tuple(held), tuple(less), tuple(off),
        tuple(what_moved(tried, layout, objective, study)),
        run.evaluations.evaluated if run.evaluations is not None else 0, time.perf_counter() - start_s, run.cache,
    )  # fmt: skip
