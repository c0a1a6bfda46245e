"""Trials: candidate placements evaluated on seeds, their metrics, and their ranking by the objectives of a study."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError, valid_names
from twin.scenario import Scenario
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import BASELINE, Placement
from twin.studies.coverage import PoseCoverage
from twin.studies.preflight import PreparedStudy
from twin.studies.spec import Objective, StudyScenario, scenario_key
from twin.studies.store import EvaluationStore, Job
from twin.studies.worker import DETAILED, EvaluationTask, Outcome, evaluate_task
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import provenance_of, room_digest, whole_code
from twin.suites.tasks import State


@dataclass
class Trial:
    """A placement with its metrics by scenario, seed and tracker, its price and its coverage.

    failure: the constraint it violates, or the error of its simulation or tracking; "" for none.
    """

    placement: Placement
    price: float
    metrics: dict[tuple[str, int], Mapping[str, Mapping[str, float | None]]] = field(default_factory=dict)
    coverage: float | None = None
    coverage_worst: float | None = None
    failure: str = ""

    def measure_coverage(self, coverage: PoseCoverage) -> None:
        """Measure the share of rows that the placement covers, overall and at the worst position."""
        self.coverage, self.coverage_worst = coverage.share(self.placement), coverage.worst(self.placement)

    @property
    def seeds(self) -> list[int]:
        """The seeds with metrics."""
        return list(dict.fromkeys(seed for _, seed in self.metrics))

    def values_by_seed(self, objective: Objective, scenarios: Sequence[StudyScenario], seeds: Sequence[int]) -> Array:
        """Return the metric at each seed (n,), the weighted mean over scenarios. KeyError at a seed without one."""
        assert objective.tracker is not None
        assert objective.metric is not None
        weight = np.array([each.weight for each in scenarios])
        rows = [
            [
                self.metrics[scenario_key(number, each), seed][objective.tracker][objective.metric]
                for number, each in enumerate(scenarios)
            ]
            for seed in seeds
        ]
        return np.array(rows, dtype=float) @ weight / weight.sum()

    def value(self, objective: Objective, scenarios: Sequence[StudyScenario]) -> float:
        """Return the value of an objective over all evaluated seeds."""
        if objective.kind == "price":
            return self.price
        if objective.kind == "coverage":
            found = self.coverage if objective.form == "share" else self.coverage_worst
            assert found is not None
            return found
        return aggregate(self.values_by_seed(objective, scenarios, self.seeds), objective)


def aggregate(values: Array, objective: Objective) -> float:
    """Return the mean, the worst, or the quantile from the worst side."""
    worse_first = values if objective.more_is_better else -values
    if objective.over == "worst":
        found = worse_first.min()
    elif objective.over == "quantile":
        found = np.quantile(worse_first, objective.quantile)
    else:
        found = worse_first.mean()
    return float(found if objective.more_is_better else -found)


def losses(trials: Sequence[Trial], objectives: Sequence[Objective], scenarios: Sequence[StudyScenario]) -> Array:
    """Return the value of each objective of each trial (n, m), smaller the better."""
    rows = [[each.value(one, scenarios) * (-1 if one.more_is_better else 1) for one in objectives] for each in trials]
    return np.array(rows, dtype=float).reshape(len(trials), len(objectives))


def pareto_fronts(loss: Array) -> Array:
    """Return the index of the Pareto front of each row (n, m); 0: no other is as good in all and better in one."""
    front = np.full(len(loss), -1)
    number = 0
    while (front < 0).any():
        left = np.flatnonzero(front < 0)
        less = (loss[left][:, None] <= loss[left]).all(axis=2) & (loss[left][:, None] < loss[left]).any(axis=2)
        front[left[~less.any(axis=0)]] = number
        number += 1
    return front


def rank_trials(
    trials: Sequence[Trial], objectives: Sequence[Objective], scenarios: Sequence[StudyScenario]
) -> list[Trial]:
    """Sort trials, best first: by front, then by the first objective, then by number."""
    loss = losses(trials, objectives, scenarios)
    front = pareto_fronts(loss)
    order = sorted(range(len(trials)), key=lambda each: (front[each], loss[each].tolist(), trials[each].placement))
    return [trials[each] for each in order]


_LINE_EVERY_S = 15.0


class TrialRunner:
    """Evaluates the trials of a prepared study."""

    def __init__(self, prepared: PreparedStudy, cache: RecordingCache) -> None:
        self.prepared, self.cache = prepared, cache
        self.study, self.candidate_set = prepared.study, prepared.candidate_set
        self._details = any((each.metric or "").startswith(DETAILED) for each in self.study.objectives)
        self._code = whole_code()
        self._room = room_digest(prepared.scenario.room)  # the same in all scenarios
        self._prior: dict[str, str] = {}
        self.evaluations: EvaluationStore | None = None
        self.trials: Mapping[Placement, Trial] = {}
        self._started_s = time.perf_counter()
        self._reported_s = self._started_s

    # ------------------------------------------------------------------------------------------------- evaluating

    def job(self, name: str, key: str, scenario: Scenario, seed: int) -> Job:
        """Return the evaluation of a scenario with a seed."""
        seeded = scenario.model_copy(update={"seed": seed, "trackers": {}})
        files = scenario.prior.model_dump_json()
        if files not in self._prior:
            self._prior[files] = scenario.prior.digest()
        trackers = [(each.target, each.options) for each in self.prepared.trackers]
        made = provenance_of(seeded.model_dump_json(), self._room, trackers, self._prior[files])
        work = EvaluationTask(seeded, self.prepared.trackers, self.cache, self._code, self._details, made)
        return Job(name, key, seed, work, made)

    def evaluate(self, trials: Sequence[Trial], number: int) -> None:
        """Evaluate trials on the first `number` search seeds, in all scenarios."""
        if not self.prepared.trackers:
            return
        assert self.evaluations is not None
        jobs: list[Job] = []
        owners: list[tuple[Trial, str, int]] = []
        for seed in self.study.seeds[:number]:  # by seed: a worker keeps the scene of one
            for place, entry in enumerate(self.study.scenarios):
                key = scenario_key(place, entry)
                for trial in trials:
                    if trial.failure or (key, seed) in trial.metrics:
                        continue
                    try:
                        scenario = self.scenario(trial.placement, key)
                    except InputError as error:
                        trial.failure = str(error).splitlines()[0]
                        continue
                    jobs.append(self.job(placement_id(trial.placement), key, scenario, seed))
                    owners.append((trial, key, seed))
        for (trial, key, seed), outcome in zip(owners, self.evaluations.outcomes(jobs), strict=True):
            self._take(trial, key, seed, outcome)

    def _take(self, trial: Trial, key: str, seed: int, outcome: Outcome) -> None:
        if outcome.error:
            trial.failure = trial.failure or f"{key}, seed {seed}: {outcome.error}"
            return
        trial.metrics[key, seed] = outcome.metrics
        for each in self.study.objectives:
            if each.kind == "metric" and outcome.metrics[each.tracker or ""].get(each.metric or "") is None:
                trial.failure = trial.failure or f"{key}, seed {seed}: {each.tracker} gives no {each.metric}"

    def scenario(self, placement: Placement, key: str) -> Scenario:
        """Return a scenario of the study, held-out ones too, with a placement applied."""
        scenarios = self.prepared.scenarios | self.prepared.held_out
        return apply_placement(self.study, scenarios[key], [self.candidate_set.poses[each] for each in placement])

    def check_metrics(self) -> tuple[Job, Outcome] | None:
        """Evaluate the baseline on the first seed, before anything is written. Raises InputError for a missing metric."""
        objectives = [each for each in self.study.objectives if each.kind == "metric"]
        if not objectives:
            return None
        key, scenario = next(iter(self.prepared.scenarios.items()))
        job = self.job(placement_id(BASELINE), key, scenario, self.study.seeds[0])
        outcome = evaluate_task(job.work)
        for each in objectives:
            of_tracker = outcome.metrics[each.tracker or ""]
            if of_tracker.get(each.metric or "") is None:
                valid = [name for name, value in of_tracker.items() if value is not None and "ms_per_frame" not in name]
                raise InputError(
                    f"{self.prepared.path}: objectives.{self.study.objectives.index(each)}.metric: {each.tracker} gives no "
                    f"{each.metric} on {scenario.name}; {valid_names(each.metric, valid)}"
                )
        return job, outcome

    def metric_by_seed(
        self,
        objective: Objective,
        name: str,
        weights: Mapping[str, float],
        placed: Mapping[tuple[int, str], Scenario],
    ) -> Array:
        """Return a tracker's metric at each seed (n,), weighted over scenarios by key; NaN where one failed.

        name: key of the evaluations; placed: the scenarios by seed and key, seed by seed in the order of `weights`.
        """
        assert self.evaluations is not None
        jobs = [self.job(name, key, scenario, seed) for (seed, key), scenario in placed.items()]
        found = [
            np.nan if each.error else each.metrics[objective.tracker or ""].get(objective.metric or "")
            for each in self.evaluations.outcomes(jobs)
        ]
        table = np.array(found, dtype=float).reshape(-1, len(weights))
        weight = np.array(list(weights.values()))
        return table @ weight / weight.sum()

    # ---------------------------------------------------------------------------------------------------- telling

    def progress(self, total: int, now: State) -> None:
        """Write a line to stderr every 15 s: evaluations done, the best so far, the remaining time."""
        time_s = time.perf_counter()
        if time_s - self._reported_s < _LINE_EVERY_S:
            return
        self._reported_s = time_s
        done = now.done + now.failed
        trials = self.trials.values()
        objective = self.study.objectives[0]
        known = [each for each in trials if not each.failure and (each.metrics or objective.kind != "metric")]
        values = [each.value(objective, self.study.scenarios) for each in known]
        best = ""
        if values:
            best = f", best {objective.column} {max(values) if objective.more_is_better else min(values):.3f}"
        asked = self.study.search.candidates if self.study.search.method == "optuna" else max(len(trials) - 1, 1)
        share = min(1.0, max(len(trials) - 1, 0) / asked)
        spent_s = time_s - self._started_s
        left = f", about {spent_s * (1 - share) / share / 60:.0f} min left" if 0 < share < 1 else ""
        sys.stderr.write(f"twin: {len(trials)} placements, {done} of {total} evaluations of this round{best}{left}\n")


def placement_id(placement: Placement) -> str:
    """Return the name of a placement in files: indices of its poses, or 'baseline'."""
    return "-".join(map(str, placement)) or "baseline"
