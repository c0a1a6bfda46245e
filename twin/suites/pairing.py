"""One figure of one group, before and now, seed by seed: what two runs of a seed are to each other, and may differ by.

- The recording is the same, or made from the same (scenario, seed and code that simulates; another processor or renderer
  makes other bits of those): what differs is the tracker's doing.
- It shows the same people on the same ways, but sensors report otherwise: the runs are a pair still, of one draw of noise
  and another.
- It shows other people: the runs are draws from two populations.

In the latter two chance moves a mean, so there it may also get worse by some standard errors: three between pairs, two between
populations, which is what harmless draws asked for (the lab, seeds 1000 to 1205 with up to seven draws each). And one draw may
exchange many identities, which cost a case up to 30 times what a mean may change there (AssA): a case has to fall by 50 times
that below the worst seed before, and the rare events count the rest.

Scenarios that differ in light or shirts alone show one seed's people, scans and noise once more. What chance draws as one is
counted as one: recordings of a seed whose people begin in the same places.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackers.arrays import Array
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS, worsening
from twin.suites.results import Group, GroupKey, Results

Relation = Literal["same bits", "same origin", "same people", "unrelated"]
"""Relations of a group's recordings to those of the baseline, closest first."""

Unit = tuple[int | str, ...]
"""A seed, and what tells its recordings from those of the same seed that are another draw."""

_BEYOND_NOISE, _BEYOND_ANY_DRAW, _BEYOND_SPREAD = 10.0, 50.0, 4.0

_STANDARD_ERRORS: Mapping[Relation, float] = {"same people": 3.0, "unrelated": 2.0}


@dataclass(frozen=True)
class Pair:
    """One metric of one group in the n seeds that both runs have.

    tolerance: how much worse its mean may be where chance has no part.
    """

    key: GroupKey
    group: Group
    metric: str
    seeds: tuple[int, ...]
    before: Array  # (n,)
    now: Array  # (n,)
    tolerance: float
    relation: Relation

    @property
    def is_exact(self) -> bool:
        """True where the recordings are the same, or made from the same inputs."""
        return self.relation in ("same bits", "same origin")

    @property
    def units(self) -> list[Unit]:
        """Exchangeable unit of each seed: recordings whose people begin alike, or each alone where that is not known."""
        people = self.group.people
        return [
            (seed, start_digest(people[seed])) if people.get(seed) else (seed, self.key.scenario, self.key.overrides)
            for seed in self.seeds
        ]

    @property
    def worsened(self) -> Array:
        """Worsening of each seed, (n,)."""
        return worsening(self.metric, 1.0) * (self.now - self.before)

    @property
    def draws(self) -> Array:
        """Centred random differences, (k, n): none, the paired differences, or before and now each."""
        of_kin = {"same people": [self.now - self.before], "unrelated": [self.before, self.now]}
        drawn = np.array(of_kin.get(self.relation, ()), dtype=float).reshape(-1, len(self.seeds))
        return drawn - drawn.mean(axis=1, keepdims=True)

    @property
    def allowed_in_case(self) -> float:
        """Tolerated worsening of one case."""
        spread = float(self.before.std(ddof=1)) if len(self.seeds) > 1 else 0.0
        times = _BEYOND_NOISE if self.is_exact else _BEYOND_ANY_DRAW
        return times * self.tolerance + _BEYOND_SPREAD * spread

    @property
    def fallen(self) -> int | None:
        """Seed with the largest worsening beyond `allowed_in_case`; None where there is none."""
        sign = worsening(self.metric, 1.0)
        before = sign * self.before
        by = sign * self.now - (before if self.is_exact else before.max())
        worst = int(np.argmax(by))
        return self.seeds[worst] if by[worst] > self.allowed_in_case else None


def allowed_change(pairs: Sequence[Pair]) -> float:
    """Compute the tolerated worsening of the mean over G groups: the mean tolerance / √G, plus an allowance for chance.

    Chance is some standard errors of the mean, for which recordings of the same people, whoever tracks them, count as one.
    """
    tolerance = float(np.mean([pair.tolerance for pair in pairs])) / np.sqrt(len(pairs))
    moved: dict[tuple[int, Unit], float] = {}  # by row of the draws
    for pair in pairs:
        n = len(pair.seeds)
        scale = _STANDARD_ERRORS.get(pair.relation, 0.0) * np.sqrt(n / (n - 1)) / (n * len(pairs)) if n > 1 else 0.0
        for row, drawn in enumerate(pair.draws):
            for unit, by in zip(pair.units, drawn, strict=True):
                moved[row, unit] = moved.get((row, unit), 0.0) + scale * float(by)
    return tolerance + float(np.sqrt(sum(by**2 for by in moved.values())))


def pair_results(before: Results, now: Results, allowed: Callable[[str, float], float]) -> Iterator[Pair]:
    """Pair every metric of each tracker group and scanner in both runs; `allowed`: see `comparison.compare`."""
    for old, new, metrics in ((before.groups, now.groups, GATED), (before.sensors, now.sensors, GATED_SENSOR_METRICS)):
        for key, group in new.items():
            if key in old:
                for metric in metrics:
                    yield from _pair(key, old[key], group, metric, allowed)


def _pair(
    key: GroupKey, was: Group, group: Group, metric: str, allowed: Callable[[str, float], float]
) -> Iterator[Pair]:
    both = [
        (seed, old, new)
        for seed, figures in sorted(group.seeds.items())
        if (old := was.seeds.get(seed, {}).get(metric)) is not None and (new := figures.get(metric)) is not None
    ]
    if both:
        seeds, old, new = zip(*both, strict=True)
        tolerance = allowed(metric, float(np.mean(old)))
        yield Pair(key, group, metric, seeds, np.array(old), np.array(new), tolerance, _relation(was, group, seeds))


def _relation(was: Group, group: Group, seeds: Sequence[int]) -> Relation:
    if _same(was.recordings, group.recordings, seeds):
        return "same bits"
    if _same(was.recipes, group.recipes, seeds):
        return "same origin"
    return "same people" if _same(was.people, group.people, seeds) else "unrelated"


def _same(before: Mapping[int, str], now: Mapping[int, str], seeds: Sequence[int]) -> bool:
    return all(before.get(seed) and before[seed] == now.get(seed) for seed in seeds)


def start_digest(people: str) -> str:
    """Return the part of a people digest that covers the first second."""
    return people.partition("-")[0]
