"""The search for placements: all, greedy, exact, or by Optuna, each candidate raced against the others on the same seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice, product
from math import comb, prod
from typing import TYPE_CHECKING, Literal

import numpy as np

from trackers.errors import InputError
from twin.studies.coverage import Seen
from twin.studies.description import Study
from twin.studies.layout import OWN, Candidate, Layout
from twin.studies.sets import Choice, Found, exact, greedy
from twin.studies.trial import Trial, ranked

if TYPE_CHECKING:
    import optuna

MOST_CANDIDATES = 20_000
_MOST_ASKED = 20
"""Optuna is asked at most so many times as there are places in a generation: small spaces run out of new candidates."""
_MOST_EXACT_OPTIONS = 2000


@dataclass
class Result:
    """All that was tried, what was proven, in the order of the search."""

    trials: dict[Candidate, Trial] = field(default_factory=dict)
    proven: list[tuple[dict[str, int], Found, Found | None]] = field(default_factory=list)
    """By number of devices: what greedy found, and what is exact, where it was asked for."""


Fill = Callable[[Sequence[Trial], int], None]
"""Has trials tried on so many of the search seeds; what fails gets its `why`."""


class Searcher:
    """Searches a layout, by the coverage in `seen` and whatever figures `fill` brings in."""

    def __init__(self, study: Study, layout: Layout, seen: Seen | None, fill: Fill) -> None:
        self.study, self.layout, self._seen, self._fill = study, layout, seen, fill
        self.result = Result()
        self._covers = seen is not None and any(each.kind == "coverage" for each in study.objectives)

    def check(self, source: str) -> None:
        """Raise InputError, naming `source`, for a search that cannot be, before anything is evaluated."""
        method = self.study.search.method
        ways = [prod(comb(len(numbers), count) for numbers, count in each) for each in product(*self._ways())]
        if method == "exhaustive" and sum(ways) > MOST_CANDIDATES:
            raise InputError(
                f"{source}: search.method: 'exhaustive' would try {sum(ways)} placements; at most {MOST_CANDIDATES}, or another "
                "method, is expected"
            )
        number = len(self.layout.options)
        if method in ("greedy", "exact") and number > _MOST_EXACT_OPTIONS:
            raise InputError(
                f"{source}: search.method: {method!r} keeps what every option sees, and there are {number}; at most "
                f"{_MOST_EXACT_OPTIONS}, by larger steps, are expected"
            )

    def run(self) -> Result:
        """Search by the study's method."""
        own = self._trial(OWN)
        self._fill([own], self.study.search.replicates[-1])
        method = self.study.search.method
        if method == "exhaustive":
            self._race([self._trial(each) for each in self._all()])
        elif method == "optuna":
            self._optuna()
        else:
            self._by_coverage(prove=method == "exact")
            self._race([each for each in self.result.trials.values() if each.candidate != OWN])
        return self.result

    def _trial(self, candidate: Candidate) -> Trial:
        if candidate not in self.result.trials:
            trial = Trial(candidate, self.layout.price(candidate))
            trial.why = "" if candidate == OWN else self.layout.against(candidate)
            if self._seen is not None and (self._covers or candidate == OWN) and not trial.why:
                trial.coverage, trial.coverage_worst = self._seen.share(candidate), self._seen.worst(candidate)
            self.result.trials[candidate] = trial
        return self.result.trials[candidate]

    def _race(self, trials: Sequence[Trial]) -> None:
        """Few seeds for all, more for the better half, by domination where there are several objectives."""
        running = [each for each in trials if not each.why]
        for number in self.study.search.replicates:
            self._fill(running, number)
            running = [each for each in running if not each.why]
            if not any(each.kind == "metric" for each in self.study.objectives):
                return
            running = ranked(running, self.study.objectives, self.study.scenarios)[: -(-len(running) // 2)]

    def _ways(self) -> list[list[tuple[list[int], int]]]:
        """Of each device, its options and each number of them that may be taken."""
        moves = self.study.move
        return [
            [(numbers, count) for count in range(moves[name].counts[0], moves[name].counts[1] + 1)]
            for name, numbers in self.layout.of_device.items()
        ]

    def _all(self) -> Iterator[Candidate]:
        """Every set that keeps the constraints."""
        for each in product(*self._ways()):
            for parts in product(*(combinations(numbers, count) for numbers, count in each)):
                candidate = tuple(sorted(number for part in parts for number in part))
                if candidate and not self.layout.against(candidate):
                    yield candidate

    def numbers(self) -> Iterator[dict[str, int]]:
        """Every number of devices that the study allows, but none at all."""
        ranges = [range(move.counts[0], move.counts[1] + 1) for move in self.study.move.values()]
        for each in islice(product(*ranges), 64):
            if sum(each):
                yield dict(zip(self.study.move, each, strict=True))

    def choice(self) -> Choice:
        """What greedy and exact choose from."""
        assert self._seen is not None
        counts, stay, weight = self._seen.counts(range(len(self.layout.options)))
        device = [option.device for option in self.layout.options]
        return Choice(
            counts, stay, weight, self.study.coverage.at_least, device, lambda chosen: not self.layout.conflict(chosen)
        )

    def _by_coverage(self, *, prove: bool) -> None:
        choice = self.choice()
        for number in self.numbers():
            first = greedy(choice, number)
            best = exact(choice, number, self.study.search.limit_s) if prove else None
            self.result.proven.append((number, first, best))
            for found in (first, best):
                if found is not None and found.chosen:
                    self._trial(found.chosen)

    # ------------------------------------------------------------------------------------------------ Optuna

    def _optuna(self) -> None:
        """Generations of fixed size: asked for one by one, raced, told in order; the sampler is seeded anew for each.

        So what is asked depends on what was told before and on nothing else: neither on how many workers there are nor on
        where a run was cut off. A resumed run asks all again, and finds what was evaluated before: nothing that
        Optuna holds has to outlive the process, and no lock of its can be left behind.
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
        tried: set[Candidate] = set()
        generation = 0
        while len(tried) < search.candidates:
            seed = int(np.random.SeedSequence([search.seed, generation]).generate_state(1)[0])
            asked.sampler = self._sampler(seed)
            size = min(search.generation, search.candidates - len(tried))
            trials: list[tuple[optuna.trial.Trial, Trial]] = []
            new: set[Candidate] = set()
            for _ in range(_MOST_ASKED * search.generation):
                if len(new) == size:
                    break
                one = asked.ask()
                candidate = self._candidate(one)
                if candidate is None or candidate in tried or candidate in new:
                    # a known one adds nothing: it is told as failed, which samplers pass over
                    asked.tell(one, state=optuna.trial.TrialState.FAIL)
                    continue
                new.add(candidate)
                trials.append((one, self._trial(candidate)))
            if not new:
                return
            self._race([each for _, each in trials])
            for one, trial in trials:
                if trial.why:
                    asked.tell(one, state=optuna.trial.TrialState.FAIL)
                else:
                    asked.tell(one, [trial.value(each, self.study.scenarios) for each in objectives])
            tried |= new
            generation += 1
        leaders = ranked(
            [each for each in self.result.trials.values() if not each.why and each.candidate in tried],
            objectives,
            self.study.scenarios,
        )
        self._race(leaders[: search.generation])

    def _sampler(self, seed: int) -> optuna.samplers.BaseSampler:
        import optuna

        if len(self.study.objectives) > 1:
            return optuna.samplers.NSGAIISampler(population_size=self.study.search.generation, seed=seed)
        return optuna.samplers.TPESampler(seed=seed, n_startup_trials=self.study.search.generation, multivariate=False)

    def _candidate(self, trial: optuna.trial.Trial) -> Candidate | None:
        """The options nearest to where a trial has the devices, of those that the constraints leave; None: there are none."""
        chosen: list[int] = []
        for name, move in self.study.move.items():
            least, most = move.counts
            count = trial.suggest_int(f"{name}.count", least, most) if most > least else most
            numbers = np.array(self.layout.of_device[name])
            features, low, high = self._features(name)
            for slot in range(count):
                kinds = len(move.kinds)
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
                gap[[self.layout.options[each].kind != kind for each in numbers]] = np.inf
                order = [
                    int(each)
                    for each in numbers[np.argsort(gap, kind="stable")]
                    if np.isfinite(gap[np.searchsorted(numbers, each)])
                ]
                found = next(
                    (each for each in order if each not in chosen and not self.layout.conflict([*chosen, each])), None
                )
                if found is None:
                    return None
                chosen.append(found)
        candidate = tuple(sorted(chosen))
        return candidate if candidate and not self.layout.against(candidate) else None

    def _features(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place and direction of each option of a device (n, 6), and their lowest and highest (6,)."""
        rows = []
        for number in self.layout.of_device[name]:
            mount = self.layout.options[number].mounts[0]
            yaw = np.deg2rad(mount.yaw_deg)
            rows.append([*mount.xyz, np.cos(yaw), np.sin(yaw), mount.pitch_deg])
        features = np.array(rows)
        return features, features.min(axis=0), features.max(axis=0)

    def _starts(self) -> Iterable[dict[str, float]]:
        """What greedy finds by coverage for each number of devices: a good first guess, where its bits can be kept."""
        if self._seen is None or len(self.layout.options) > _MOST_EXACT_OPTIONS:
            return
        choice = self.choice()
        for number in self.numbers():
            found = greedy(choice, number)
            self.result.proven.append((number, found, None))
            start: dict[str, float] = {}
            for name, move in self.study.move.items():
                mine = [each for each in found.chosen if self.layout.options[each].device == name]
                if move.counts[1] > move.counts[0]:
                    start[f"{name}.count"] = len(mine)
                features, low, high = self._features(name)
                for slot, each in enumerate(mine):
                    if len(move.kinds) > 1:
                        start[f"{name}.{slot}.kind"] = self.layout.options[each].kind
                    row = features[self.layout.of_device[name].index(each)]
                    start |= {
                        f"{name}.{slot}.{axis}": float(value)
                        for axis, value, a, b in zip(_AXES, row, low, high, strict=True)
                        if b > a
                    }
            yield start


_AXES = ("x", "y", "z", "cos_yaw", "sin_yaw", "tilt")
