"""Placements tried: each with each seed once, kept in the study's file, and told of as it goes."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.scenario import Scenario
from twin.studies.description import Objective
from twin.studies.evaluations import Evaluations, Job, Outcome
from twin.studies.layout import OWN, Candidate
from twin.studies.placed import placed
from twin.studies.prepare import Prepared
from twin.studies.scoring import DETAILED, Score, score
from twin.studies.search import Searcher
from twin.studies.trial import Trial, key_of
from twin.suites.cache import RecordingCache
from twin.suites.cache_keys import made_from, room_digest, whole_code
from twin.suites.tasks import State

_LINE_EVERY_S = 15.0


class Trying:
    """One run of a prepared study, its evaluations open."""

    def __init__(self, prepared: Prepared, cache: RecordingCache) -> None:
        self.prepared, self.cache = prepared, cache
        self.study, self.layout = prepared.study, prepared.layout
        self._details = any((each.metric or "").startswith(DETAILED) for each in self.study.objectives)
        self._code = whole_code()
        self._room = room_digest(prepared.scenario.room)  # one in all scenarios
        self._knowledge: dict[str, str] = {}
        self.evaluations: Evaluations | None = None
        self.searcher: Searcher | None = None
        self._started_s = time.perf_counter()
        self._told_s = self._started_s

    # ------------------------------------------------------------------------------------------------- evaluating

    def job(self, name: str, key: str, scenario: Scenario, seed: int) -> Job:
        """The evaluation of a scenario as it stands, with a seed."""
        seeded = scenario.model_copy(update={"seed": seed, "trackers": {}})
        files = scenario.knowledge.model_dump_json()
        if files not in self._knowledge:
            self._knowledge[files] = scenario.knowledge.digest()
        trackers = [(each.target, each.options) for each in self.prepared.trackers]
        made = made_from(seeded.model_dump_json(), self._room, trackers, self._knowledge[files])
        work = Score(seeded, self.prepared.trackers, self.cache, self._code, self._details, made)
        return Job(name, key, seed, work, made)

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
        self,
        objective: Objective,
        name: str,
        weights: Mapping[str, float],
        place: Callable[[str, int], Scenario],
        seeds: Sequence[int],
    ) -> Array:
        """A tracker's figure at each seed (n,), weighted over scenarios by key; NaN where one failed.

        name: what the evaluations are kept under; place: the scenario of a key and a seed.
        """
        assert self.evaluations is not None
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
