"""Search for placements: exhaustive, greedy, exact, or by Optuna; trials race on the same seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice, product
from math import comb, prod
from typing import TYPE_CHECKING, Literal

import numpy as np

from trackers.user_input.text_file import refuse_unless_lifted
from twin.studies.candidate_set import BASELINE, CandidateSet, Placement
from twin.studies.coverage import PoseCoverage
from twin.studies.set_cover import Cover, CoverProblem, exact, greedy
from twin.studies.spec import Study
from twin.studies.trials import Trial, rank_trials

if TYPE_CHECKING:
    import optuna

MOST_CANDIDATES = 20_000
_MOST_ASKED = 20
"""Greatest number of requests to Optuna per place in a generation: small spaces run out of new candidates."""
_MOST_EXACT_OPTIONS = 2000


@dataclass
class Result:
    """All trials in order of the search, and the proven set covers."""

    trials: dict[Placement, Trial] = field(default_factory=dict)
    proven: list[tuple[dict[str, int], Cover, Cover | None]] = field(default_factory=list)
    """By number of devices: greedy's set cover, and the exact one if asked for."""


Evaluate = Callable[[Sequence[Trial], int], None]
"""Callback that evaluates trials on so many search seeds; failures get their reason in `failure`."""


def check_search_size(study: Study, candidate_set: CandidateSet, source: str) -> None:
    """Raise InputError, naming `source`, for too large a search, before evaluating anything."""
    method, number = study.search.method, len(candidate_set.poses)
    ways = n_placements(study, candidate_set)
    if method == "exhaustive" and ways > MOST_CANDIDATES:
        refuse_unless_lifted(
            f"{source}: search.method: 'exhaustive' would try {ways} placements",
            f"at most {MOST_CANDIDATES}, or another method",
        )
    if method in ("greedy", "exact") and number > _MOST_EXACT_OPTIONS:
        refuse_unless_lifted(
            f"{source}: search.method: {method!r} keeps the bits of every candidate pose, and there are {number}",
            f"at most {_MOST_EXACT_OPTIONS}, by larger steps",
        )


def n_placements(study: Study, candidate_set: CandidateSet) -> int:
    """Return the number of placements among which a search chooses, those against constraints too."""
    ways = product(*_counts_by_device(study, candidate_set))
    return sum(prod(comb(len(numbers), count) for numbers, count in each) for each in ways if any(n for _, n in each))


def _counts_by_device(study: Study, candidate_set: CandidateSet) -> list[list[tuple[list[int], int]]]:
    """Return the poses of each device with each allowed count."""
    return [
        [(numbers, count) for count in range(study.devices[name].counts[0], study.devices[name].counts[1] + 1)]
        for name, numbers in candidate_set.by_device.items()
    ]


class Searcher:
    """Search of a candidate set by coverage and by the metrics that `evaluate` adds."""

    def __init__(self, study: Study, candidate_set: CandidateSet, coverage: PoseCoverage, evaluate: Evaluate) -> None:
        self.study, self.candidate_set, self._coverage, self._evaluate = study, candidate_set, coverage, evaluate
        self.result = Result()
        self._covers = any(each.kind == "coverage" for each in study.objectives)

    def run(self) -> Result:
        """Search by the study's method."""
        own = self._trial(BASELINE)
        self._evaluate([own], self.study.search.replicates[-1])
        method = self.study.search.method
        if method == "exhaustive":
            self._race([self._trial(each) for each in self._all()])
        elif method == "optuna":
            self._optuna()
        else:
            self._by_coverage(prove=method == "exact")
            self._race([each for each in self.result.trials.values() if each.placement != BASELINE])
        return self.result

    def _trial(self, placement: Placement) -> Trial:
        if placement not in self.result.trials:
            trial = Trial(placement, self.candidate_set.price(placement))
            trial.failure = "" if placement == BASELINE else self.candidate_set.violation(placement)
            if (self._covers or placement == BASELINE) and not trial.failure:
                trial.measure_coverage(self._coverage)
            self.result.trials[placement] = trial
        return self.result.trials[placement]

    def _race(self, trials: Sequence[Trial]) -> None:
        """Evaluate all trials on few seeds, the better half on more; by Pareto fronts with several objectives."""
        running = [each for each in trials if not each.failure]
        for number in self.study.search.replicates:
            self._evaluate(running, number)
            running = [each for each in running if not each.failure]
            if not any(each.kind == "metric" for each in self.study.objectives):
                return
            running = rank_trials(running, self.study.objectives, self.study.scenarios)[: -(-len(running) // 2)]

    def _all(self) -> Iterator[Placement]:
        """Yield every placement that keeps the constraints."""
        for each in product(*_counts_by_device(self.study, self.candidate_set)):
            for parts in product(*(combinations(numbers, count) for numbers, count in each)):
                placement = tuple(sorted(number for part in parts for number in part))
                if placement and not self.candidate_set.violation(placement):
                    yield placement

    def numbers(self) -> Iterator[dict[str, int]]:
        """Yield every allowed combination of device counts, except none at all."""
        ranges = [range(device.counts[0], device.counts[1] + 1) for device in self.study.devices.values()]
        for each in islice(product(*ranges), 64):
            if sum(each):
                yield dict(zip(self.study.devices, each, strict=True))

    def cover_problem(self) -> CoverProblem:
        """Return the set cover problem of greedy and exact."""
        counts, stay, weight = self._coverage.counts(range(len(self.candidate_set.poses)))
        device = [pose.device for pose in self.candidate_set.poses]
        return CoverProblem(
            counts,
            stay,
            weight,
            self.study.coverage.at_least,
            device,
            lambda chosen: not self.candidate_set.conflict(chosen),
        )

    def _by_coverage(self, *, prove: bool) -> None:
        choice = self.cover_problem()
        for number in self.numbers():
            if refused := self.candidate_set.over_budget(number):
                none = Cover((), 0.0, 0.0, sum(number.values()), refused)
                self.result.proven.append((number, none, none if prove else None))
                continue
            first = greedy(choice, number)
            best = exact(choice, number, self.study.search.limit_s) if prove else None
            self.result.proven.append((number, first, best))
            for found in (first, best):
                if found is not None and found.chosen and found.complete:
                    self._trial(found.chosen)

    # ------------------------------------------------------------------------------------------------ Optuna

    def _optuna(self) -> None:
        """Search by generations of fixed size: asked one by one, raced, reported in order; the sampler is seeded anew for each.

        Requests depend only on earlier results, not on the number of workers or on where a run stopped. A resumed run asks
        all again, and finds earlier evaluations in the store: no state or lock of Optuna has to outlive the process.
        """
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        search, objectives = self.study.search, self.study.objectives
        directions: list[Literal["maximize", "minimize"]] = [
            "maximize" if each.more_is_better else "minimize" for each in objectives
        ]
        asked = optuna.create_study(study_name=self.study.name, directions=directions)
        for start in self._starts():
            asked.enqueue_trial(start)
        tried: set[Placement] = set()
        generation = 0
        while len(tried) < search.candidates:
            seed = int(np.random.SeedSequence([search.seed, generation]).generate_state(1)[0])
            asked.sampler = self._sampler(seed)
            size = min(search.generation, search.candidates - len(tried))
            trials: list[tuple[optuna.trial.Trial, Trial]] = []
            new: set[Placement] = set()
            for _ in range(_MOST_ASKED * search.generation):
                if len(new) == size:
                    break
                one = asked.ask()
                placement = self._placement(one)
                if placement is None or placement in tried or placement in new:
                    # a known one is reported as failed, which samplers ignore
                    asked.tell(one, state=optuna.trial.TrialState.FAIL)
                    continue
                new.add(placement)
                trials.append((one, self._trial(placement)))
            if not new:
                return
            self._race([each for _, each in trials])
            for one, trial in trials:
                if trial.failure:
                    asked.tell(one, state=optuna.trial.TrialState.FAIL)
                else:
                    asked.tell(one, [trial.value(each, self.study.scenarios) for each in objectives])
            tried |= new
            generation += 1
        leaders = rank_trials(
            [each for each in self.result.trials.values() if not each.failure and each.placement in tried],
            objectives,
            self.study.scenarios,
        )
        self._race(leaders[: search.generation])

    def _sampler(self, seed: int) -> optuna.samplers.BaseSampler:
        import optuna

        if len(self.study.objectives) > 1:
            return optuna.samplers.NSGAIISampler(population_size=self.study.search.generation, seed=seed)
        return optuna.samplers.TPESampler(seed=seed, n_startup_trials=self.study.search.generation, multivariate=False)

    def _placement(self, trial: optuna.trial.Trial) -> Placement | None:
        """Return the poses nearest to a trial's parameters that keep the constraints; None without any."""
        chosen: list[int] = []
        for name, device in self.study.devices.items():
            least, most = device.counts
            count = trial.suggest_int(f"{name}.count", least, most) if most > least else most
            numbers = np.array(self.candidate_set.by_device[name])
            features, low, high = self._features(name)
            for slot in range(count):
                kinds = len(device.kinds)
                kind = trial.suggest_categorical(f"{name}.{slot}.kind", list(range(kinds))) if kinds > 1 else 0
                wanted = np.array(
                    [
                        trial.suggest_float(f"{name}.{slot}.{axis}", low[place], high[place])
                        if high[place] > low[place]
                        else low[place]
                        for place, axis in enumerate(_AXES)
                    ]
                )
                gap = (((features - wanted) / np.maximum(high - low, 1e-9)) ** 2).sum(axis=1)
                gap[[self.candidate_set.poses[each].kind != kind for each in numbers]] = np.inf
                order = [
                    int(each)
                    for each in numbers[np.argsort(gap, kind="stable")]
                    if np.isfinite(gap[np.searchsorted(numbers, each)])
                ]
                found = next(
                    (each for each in order if each not in chosen and not self.candidate_set.conflict([*chosen, each])),
                    None,
                )
                if found is None:
                    return None
                chosen.append(found)
        placement = tuple(sorted(chosen))
        return placement if placement and not self.candidate_set.violation(placement) else None

    def _features(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position and direction of each pose of a device (n, 6), and their lowest and highest (6,)."""
        rows = []
        for number in self.candidate_set.by_device[name]:
            mount = self.candidate_set.poses[number].mounts[0]
            yaw = np.deg2rad(mount.yaw_deg)
            rows.append([*mount.xyz, np.cos(yaw), np.sin(yaw), mount.pitch_deg])
        features = np.array(rows)
        return features, features.min(axis=0), features.max(axis=0)

    def _starts(self) -> Iterable[dict[str, float]]:
        """Yield the greedy set cover for each number of devices, as first guesses, where its bits fit in memory."""
        if len(self.candidate_set.poses) > _MOST_EXACT_OPTIONS:
            return
        choice = self.cover_problem()
        for number in self.numbers():
            if self.candidate_set.over_budget(number):
                continue
            found = greedy(choice, number)
            self.result.proven.append((number, found, None))
            start: dict[str, float] = {}
            for name, device in self.study.devices.items():
                mine = [each for each in found.chosen if self.candidate_set.poses[each].device == name]
                if device.counts[1] > device.counts[0]:
                    start[f"{name}.count"] = len(mine)
                features, low, high = self._features(name)
                for slot, each in enumerate(mine):
                    if len(device.kinds) > 1:
                        start[f"{name}.{slot}.kind"] = self.candidate_set.poses[each].kind
                    row = features[self.candidate_set.by_device[name].index(each)]
                    start |= {
                        f"{name}.{slot}.{axis}": float(value)
                        for axis, value, a, b in zip(_AXES, row, low, high, strict=True)
                        if b > a
                    }
            yield start


_AXES = ("x", "y", "z", "cos_yaw", "sin_yaw", "tilt")
