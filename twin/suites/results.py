"""The results of a suite as they are compared and shown: a group a scenario, variant and tracker, its seeds in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from trackers.errors import InputError
from twin.streams import stream
from twin.suites.figures import GATED
from twin.suites.store import ResultStore
from twin.suites.stored import DONE, EXPECTED, FAILED, StoredCase
from twin.suites.worker import NO_RENDERER

_N_REPLICATE = 2000
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class GroupKey:
    """What is compared as one: a scenario with its overrides (JSON), and a tracker."""

    scenario: str
    overrides: str
    tracker: str


@dataclass(frozen=True)
class Group:
    """The figures of each seed, by name; None where a figure does not apply.

    cases: the case's id by seed, if known; recordings: the digest of its recording, if known; recipes: the digest of what it
    was made from, scenario, seed and code, if known: another processor or renderer makes other bits of the same.
    """

    variant: str
    seeds: Mapping[int, Mapping[str, float | None]]
    cases: Mapping[int, str] = field(default_factory=dict)
    recordings: Mapping[int, str] = field(default_factory=dict)
    recipes: Mapping[int, str] = field(default_factory=dict)

    def values(self, metric: str) -> list[float]:
        """The figure in each seed that has it."""
        values = (figures.get(metric) for figures in self.seeds.values())
        return [value for value in values if value is not None]


@dataclass(frozen=True)
class Results:
    """A run's results, or a baseline's. renderers: of all recordings with images; doubts: cases by what a tracker warns of."""

    suite: str
    versions: Mapping[str, str | None]
    renderers: tuple[str, ...]
    groups: Mapping[GroupKey, Group]
    failed: tuple[StoredCase, ...] = ()
    unfinished: int = 0
    doubts: Mapping[str, int] = field(default_factory=dict)


def results_of(store: ResultStore) -> Results:
    """What a run has given until now."""
    facts, cases, metrics, digests = store.facts(), store.cases(), store.metrics(), store.recordings()
    seeds: dict[GroupKey, dict[int, Mapping[str, float | None]]] = {}
    ids: dict[GroupKey, dict[int, str]] = {}
    recordings: dict[GroupKey, dict[int, str]] = {}
    recipes: dict[GroupKey, dict[int, str]] = {}
    made_from: Mapping[str, str] = facts.get("recipes", {})
    first: dict[GroupKey, StoredCase] = {}
    for case in cases:
        if case.status == DONE:
            if case.id not in metrics:
                raise InputError(
                    f"{store.path}: results: of {case.id}, which is done, there are none; {EXPECTED} is expected"
                )
            key = GroupKey(case.scenario, case.overrides, case.tracker)
            first.setdefault(key, case)
            seeds.setdefault(key, {})[case.seed] = metrics[case.id]
            ids.setdefault(key, {})[case.seed] = case.id
            if digests.get(case.id):
                recordings.setdefault(key, {})[case.seed] = digests[case.id]
            if case.id in made_from:
                recipes.setdefault(key, {})[case.seed] = made_from[case.id]
    return Results(
        suite=facts["suite"],
        versions=facts["versions"],
        doubts=facts.get("doubts", {}),
        renderers=tuple(name for name in facts.get("renderers", ()) if name != NO_RENDERER),
        groups={
            key: Group(case.variant, seeds[key], ids[key], recordings.get(key, {}), recipes.get(key, {}))
            for key, case in first.items()
        },
        failed=tuple(case for case in cases if case.status == FAILED),
        unfinished=sum(case.status not in (DONE, FAILED) for case in cases),
    )


@dataclass(frozen=True)
class MeanOverSeeds:
    """A figure's mean over seeds, and its 95 % interval by the bootstrap; None where one seed gives none."""

    mean: float
    low: float | None
    high: float | None
    n: int


def mean_over_seeds(values: list[float]) -> MeanOverSeeds | None:
    """The mean and its percentile interval; None without values. The same values give the same interval."""
    if not values:
        return None
    n = len(values)
    mean = float(np.mean(values))
    if n == 1:
        return MeanOverSeeds(mean, None, None, 1)
    drawn = stream(n, "suite", "means").multinomial(n, np.full(n, 1 / n), size=_N_REPLICATE)
    tail = (1 - _CONFIDENCE) / 2
    low, high = np.quantile(drawn @ np.array(values) / n, [tail, 1 - tail])
    return MeanOverSeeds(mean, float(low), float(high), n)


def gated_values(group: Group) -> Iterator[tuple[str, MeanOverSeeds]]:
    """Each compared figure that applies to the group."""
    for metric in GATED:
        found = mean_over_seeds(group.values(metric))
        if found is not None:
            yield metric, found
