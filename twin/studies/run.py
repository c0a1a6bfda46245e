"""A study from its file to its answers: searched, judged by what nothing was chosen by, written for people and programs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.run.chosen_trackers import NONE_TRUSTED, TrustedClasses
from twin.scenario import Scenario
from twin.studies.aftermath import (
    MISPLACED,
    NOISE_M,
    Beside,
    alike,
    beside,
    fewer,
    misplaced,
    moved_sensors,
    what_moved,
)
from twin.studies.coverage import Seen
from twin.studies.description import Objective
from twin.studies.evaluations import FILE, Evaluations, Job, Outcome, open_evaluations
from twin.studies.layout import OWN, Candidate
from twin.studies.placed import placed
from twin.studies.prepare import Prepared, prepare
from twin.studies.scoring import DETAILED, Score, score
from twin.studies.search import Result, Searcher
from twin.studies.trial import Trial, fronts, key_of, losses
from twin.suites.cache import RecordingCache, cache_folder, cache_limit_bytes
from twin.suites.fingerprint import whole_code
from twin.suites.run import Place, Watcher
from twin.suites.tasks import State

_LINE_EVERY_S = 15.0


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


class StudyRun:
    """One run of a prepared study, its evaluations open."""

    def __init__(self, prepared: Prepared, cache: RecordingCache) -> None:
        self.prepared, self.cache = prepared, cache
        self.study, self.layout = prepared.study, prepared.layout
        self._details = any((each.metric or "").startswith(DETAILED) for each in self.study.objectives)
        self._code = whole_code()
        self.evaluations: Evaluations | None = None
        self.searcher: Searcher | None = None
        self._started_s = time.perf_counter()
        self._told_s = self._started_s

    # ------------------------------------------------------------------------------------------------- evaluating

    def job(self, name: str, key: str, scenario: Scenario, seed: int) -> Job:
        """The evaluation of a scenario as it stands, with a seed."""
        seeded = scenario.model_copy(update={"seed": seed, "trackers": {}})
        return Job(name, key, seed, Score(seeded, self.prepared.trackers, self.cache, self._code, self._details))

    def fill(self, trials: Sequence[Trial], number: int) -> None:
        """Try trials on the first so many search seeds, all scenarios."""
        if not self.prepared.trackers:
            return
        assert self.evaluations is not None
        jobs: list[Job] = []
        owners: list[tuple[Trial, str, int]] = []
        for seed in self.study.seeds[:number]:  # by seed: a worker keeps the scene of one
            for place, entry in enumerate(self.study.scenarios):
                key = key_of(place, entry)
                for trial in trials:
                    if trial.why or (key, seed) in trial.figures:
                        continue
                    try:
                        scenario = self.scenario(trial.candidate, key)
                    except InputError as error:
                        trial.why = str(error).splitlines()[0]
                        continue
                    jobs.append(self.job(name_of(trial.candidate), key, scenario, seed))
                    owners.append((trial, key, seed))
        for (trial, key, seed), outcome in zip(owners, self.evaluations.outcomes(jobs), strict=True):
            self._take(trial, key, seed, outcome)

    def _take(self, trial: Trial, key: str, seed: int, outcome: Outcome) -> None:
        if outcome.error:
            trial.why = trial.why or f"{key}, seed {seed}: {outcome.error}"
            return
        trial.figures[key, seed] = outcome.figures
        for each in self.study.objectives:
            if each.kind == "metric" and outcome.figures[each.tracker or ""].get(each.metric or "") is None:
                trial.why = trial.why or f"{key}, seed {seed}: {each.tracker} gives no {each.metric}"

    def scenario(self, candidate: Candidate, key: str) -> Scenario:
        """A scenario of the study, held-out ones too, with a candidate's sensors."""
        scenarios = self.prepared.scenarios | self.prepared.held_out
        return placed(self.study, scenarios[key], [self.layout.options[each] for each in candidate])

    def first_look(self) -> tuple[Job, Outcome] | None:
        """The scenario's own placement with the first seed, before anything is written: whether all figures are given."""
        metrics = [each for each in self.study.objectives if each.kind == "metric"]
        if not metrics:
            return None
        key, scenario = next(iter(self.prepared.scenarios.items()))
        job = self.job(name_of(OWN), key, scenario, self.study.seeds[0])
        figures = score(job.work)
        for each in metrics:
            held = figures[each.tracker or ""]
            if held.get(each.metric or "") is None:
                valid = ", ".join(
                    name for name, value in held.items() if value is not None and "ms_per_frame" not in name
                )
                raise InputError(
                    f"{self.prepared.path}: objectives.{self.study.objectives.index(each)}.metric: {each.tracker} gives no "
                    f"{each.metric} on {scenario.name}; valid are {valid}"
                )
        return job, Outcome(figures)

    def values(
        self, name: str, weights: Mapping[str, float], place: Callable[[str, int], Scenario], seeds: Sequence[int]
    ) -> Array:
        """The first objective's figure at each seed (n,), weighted over scenarios by key; NaN where one failed.

        name: what the evaluations are kept under; place: the scenario of a key and a seed.
        """
        assert self.evaluations is not None
        objective = self.study.objectives[0]
        jobs = [self.job(name, key, place(key, seed), seed) for seed in seeds for key in weights]
        found = [
            np.nan if each.error else each.figures[objective.tracker or ""].get(objective.metric or "")
            for each in self.evaluations.outcomes(jobs)
        ]
        table = np.array(found, dtype=float).reshape(len(seeds), len(weights))
        weight = np.array(list(weights.values()))
        return table @ weight / weight.sum()

    # ---------------------------------------------------------------------------------------------------- telling

    def progress(self, total: int, now: State) -> None:
        """A line on stderr now and then: what is done, the best so far, the time left."""
        time_s = time.perf_counter()
        if time_s - self._told_s < _LINE_EVERY_S:
            return
        self._told_s = time_s
        done = now.done + now.failed
        trials = self.searcher.result.trials.values() if self.searcher is not None else ()
        objective = self.study.objectives[0]
        known = [each for each in trials if not each.why and (each.figures or objective.kind != "metric")]
        best = ""
        if known:
            values = [
                each.value(objective, self.study.scenarios)
                for each in known
                if each.seeds or objective.kind != "metric"
            ]
            if values:
                best = f", best {objective.column} {max(values) if objective.more_is_better else min(values):.3f}"
        asked = self.study.search.candidates if self.study.search.method == "optuna" else max(len(trials) - 1, 1)
        share = min(1.0, max(len(trials) - 1, 0) / asked)
        spent_s = time_s - self._started_s
        left = f", about {spent_s * (1 - share) / share / 60:.0f} min left" if 0 < share < 1 else ""
        sys.stderr.write(f"twin: {len(trials)} candidates, {done} of {total} evaluations of this round{best}{left}\n")


def name_of(candidate: Candidate) -> str:
    """What a candidate is called in files: its options, or 'own'."""
    return "-".join(map(str, candidate)) or "own"


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
    run = StudyRun(prepared, cache)
    Searcher(study, prepared.layout, None, run.fill).check(str(prepared.path))
    seen = Seen(study, prepared.layout, cache)
    run.searcher = Searcher(study, prepared.layout, seen, run.fill)
    first = None if resume and (folder / FILE).exists() else run.first_look()
    facts = {
        **study.model_dump(mode="json", by_alias=True),
        "scenarios resolved": {
            key: each.model_dump(mode="json") for key, each in (prepared.scenarios | prepared.held_out).items()
        },
    }
    watcher = Watcher()
    with open_evaluations(folder, facts, place, resume, watcher, run.progress) as evaluations:
        run.evaluations = evaluations
        if first is not None:
            evaluations.hold(*first)
        result = run.searcher.run(folder / "search.journal")
        answers = _answers(run, seen, result, start)
        for trial in answers.front:
            if trial.coverage is None:
                trial.coverage, trial.coverage_worst = seen.share(trial.candidate), seen.worst(trial.candidate)
        yield answers, folder


def _answers(run: StudyRun, seen: Seen, result: Result, start_s: float) -> Answers:
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
    is_metric = objective.kind == "metric"
    held = _held_out(run, best) if is_metric and study.held_out is not None else []
    less = _fewer(run, seen, best)
    off = _misplaced(run, best) if is_metric else []
    return Answers(
        run.prepared, seen, result, own, best, tuple(sorted(front, key=lambda each: each.price)),
        tuple(alike(tried, best, objective, study)), tuple(held), tuple(less), tuple(off),
        tuple(what_moved(tried, layout, objective, study)),
        run.evaluations.evaluated if run.evaluations is not None else 0, time.perf_counter() - start_s, run.cache,
    )  # fmt: skip


def _held_out(run: StudyRun, best: Trial) -> list[Beside]:
    """The recommendation beside the scenario's own placement, on seeds that nothing was chosen by."""
    held = run.study.held_out
    assert held is not None
    rows = []
    groups = [("the study's scenarios", _weights(run))]
    groups += [(each.scenario, {f"held-out {key_of(number, each)}": 1.0}) for number, each in enumerate(held.scenarios)]
    for what, weights in groups:
        both = [
            run.values(
                name_of(candidate), weights, lambda key, _, which=candidate: run.scenario(which, key), held.seeds
            )
            for candidate in (OWN, best.candidate)
        ]
        rows.append(beside(what, *both))
    return rows


def _weights(run: StudyRun) -> dict[str, float]:
    return {key: each.weight for each, key in zip(run.study.scenarios, run.prepared.scenarios, strict=True)}


def _fewer(run: StudyRun, seen: Seen, best: Trial) -> list[tuple[Candidate, float]]:
    """What each device is worth: the first objective without it, on the search seeds."""
    objective, rows = run.study.objectives[0], []
    for candidate in fewer(run.layout, best.candidate):
        trial = Trial(candidate, run.layout.price(candidate))
        if objective.kind == "metric":
            run.fill([trial], len(best.seeds))
        else:
            trial.coverage, trial.coverage_worst = seen.share(candidate), seen.worst(candidate)
        if not trial.why:
            rows.append((candidate, trial.value(objective, run.study.scenarios)))
    return rows


def _misplaced(run: StudyRun, best: Trial) -> list[Beside]:
    """The recommendation hung beside its place, told and not, beside the effect of a millimetre."""
    study = run.study
    seeds = study.held_out.seeds if study.held_out is not None else best.seeds
    own = {key: run.scenario(best.candidate, key) for key in run.prepared.scenarios}
    names = moved_sensors(study, run.prepared.scenario, next(iter(own.values())))
    if not names:
        return []
    base = run.values(name_of(best.candidate), _weights(run), lambda key, _: own[key], seeds)
    wanted = [("1 mm, told: the noise", NOISE_M, 0.0, True)]
    wanted += [
        (f"{what}, {'' if told else 'not '}told", off, turn, told)
        for what, off, turn in MISPLACED
        for told in (True, False)
    ]
    rows = []
    for what, off_m, turn_deg, told in wanted:

        def hung(key: str, seed: int, how: tuple[float, float, bool] = (off_m, turn_deg, told)) -> Scenario:
            return misplaced(own[key], names, *how, seed)

        rows.append(beside(what, base, run.values(f"{name_of(best.candidate)} {what}", _weights(run), hung, seeds)))
    return rows
