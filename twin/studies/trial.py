"""A candidate as it stands: how many seeds it was tried on, its figures, and what they make of the study's objectives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from trackers.arrays import Array
from twin.studies.description import Objective, StudyScenario
from twin.studies.layout import Candidate


@dataclass
class Trial:
    """A candidate: by scenario, seed, tracker and figure what it gave, beside its price and coverage.

    why: what is against it: it breaks a constraint, or could not be simulated or tracked; "" where nothing is.
    """

    candidate: Candidate
    price: float
    figures: dict[tuple[str, int], Mapping[str, Mapping[str, float | None]]] = field(default_factory=dict)
    coverage: float | None = None
    coverage_worst: float | None = None
    why: str = ""

    @property
    def seeds(self) -> list[int]:
        """The seeds it was tried on."""
        return list(dict.fromkeys(seed for _, seed in self.figures))

    def by_seed(self, objective: Objective, scenarios: Sequence[StudyScenario], seeds: Sequence[int]) -> Array:
        """The figure at each seed (n,): the weighted mean over scenarios. KeyError at a seed it was not tried on."""
        assert objective.tracker is not None
        assert objective.metric is not None
        weight = np.array([each.weight for each in scenarios])
        rows = [
            [
                self.figures[key_of(number, each), seed][objective.tracker][objective.metric]
                for number, each in enumerate(scenarios)
            ]
            for seed in seeds
        ]
        return np.array(rows, dtype=float) @ weight / weight.sum()

    def value(
        self, objective: Objective, scenarios: Sequence[StudyScenario], seeds: Sequence[int] | None = None
    ) -> float:
        """What the objective is worth, over all seeds it was tried on, or some."""
        if objective.kind == "price":
            return self.price
        if objective.kind == "coverage":
            found = self.coverage if objective.form == "share" else self.coverage_worst
            assert found is not None
            return found
        return over_seeds(self.by_seed(objective, scenarios, seeds if seeds is not None else self.seeds), objective)


def key_of(number: int, scenario: StudyScenario) -> str:
    """What a scenario of a study is called among its evaluations: two may be of one name."""
    return f"{number}:{scenario.scenario}"


def over_seeds(values: Array, objective: Objective) -> float:
    """The mean, the worst, or the quantile from the worst side."""
    worse_first = values if objective.more_is_better else -values
    if objective.over == "worst":
        found = worse_first.min()
    elif objective.over == "quantile":
        found = np.quantile(worse_first, objective.quantile)
    else:
        found = worse_first.mean()
    return float(found if objective.more_is_better else -found)


def losses(trials: Sequence[Trial], objectives: Sequence[Objective], scenarios: Sequence[StudyScenario]) -> Array:
    """What each trial (n, m) has of each objective, smaller the better."""
    rows = [[each.value(one, scenarios) * (-1 if one.more_is_better else 1) for one in objectives] for each in trials]
    return np.array(rows, dtype=float).reshape(len(trials), len(objectives))


def fronts(loss: Array) -> Array:
    """The number of the front each row (n, m) is in, 0: no other is at least as good in all and better in one."""
    front = np.full(len(loss), -1)
    number = 0
    while (front < 0).any():
        left = np.flatnonzero(front < 0)
        less = (loss[left][:, None] <= loss[left]).all(axis=2) & (loss[left][:, None] < loss[left]).any(axis=2)
        front[left[~less.any(axis=0)]] = number
        number += 1
    return front


def ranked(trials: Sequence[Trial], objectives: Sequence[Objective], scenarios: Sequence[StudyScenario]) -> list[Trial]:
    """The trials, the best first: by front, then by the first objective, then by number."""
    loss = losses(trials, objectives, scenarios)
    front = fronts(loss)
    order = sorted(range(len(trials)), key=lambda each: (front[each], loss[each].tolist(), trials[each].candidate))
    return [trials[each] for each in order]
