"""Pair two runs of a suite by seed, and test all metrics at once: family-wise p, and minimum detectable changes.

Pairs. Two runs of a seed either share their recording (or one made from the same scenario, seed and simulating code; then a
difference is the tracker's), or show the same people to sensors with other noise (a pair with two draws of noise), or show
other people (draws from two populations). In the latter two, chance moves a mean, so a mean may also fall by three standard
errors of pairs, or two of populations; harmless draws needed this (the lab, seeds 1000 to 1205 with up to seven draws each).
One draw may exchange many identities, which costs a case up to 30 times the allowed change of a mean (AssA). So a case must
fall by 50 times that below the worst earlier seed, and the rare events count the rest. Scenarios that differ in light or
shirts alone show the same people, scans and noise; recordings of a seed whose people start at the same positions are
therefore one unit of chance.

Test. If a change has no effect, before and after can be swapped in any unit of chance: this flips the signs of all its
differences, of all trackers and metrics together. The statistics are computed for all sign vectors, or for drawn ones if
they are too many. A test's p is the share of sign vectors in which the largest statistic, of those tests whose own is no
larger, is at least its own; and no less than that of a larger one (step-down max-T: Westfall and Young, Resampling-Based
Multiple Testing, 1993, algorithm 2.8). This bounds the probability of any false alarm under any dependence between trackers,
metrics and tests. A large loss elsewhere hides none. The statistics need one scale, or the noisiest dominates.
`scipy.stats.permutation_test` is not used: its p is each statistic's own, not that of the largest of all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np

from trackers.arrays import Array
from twin.streams import stream
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS, at_frames_of, format_beside, worsening
from twin.suites.results import Group, GroupKey, Results

Relation = Literal["same bits", "same origin", "same people", "unrelated"]
"""Relations of a group's recordings to those of the baseline, closest first."""

Unit = tuple[int | str, ...]
"""A seed, and the identity of its recordings among other draws of the same seed."""

_BEYOND_NOISE, _BEYOND_ANY_DRAW, _BEYOND_SPREAD = 10.0, 50.0, 4.0

_STANDARD_ERRORS: Mapping[Relation, float] = {"same people": 3.0, "unrelated": 2.0}


@dataclass(frozen=True)
class Collapse:
    """One case that worsened beyond any noise: its seed, by how much, and the worsening that is allowed in one case.

    by: beyond the worst earlier seed where recordings differ.
    """

    seed: int
    by: float
    allowed: float

    def text(self, metric: str) -> str:
        """Format seed and worsening: "seed 3 worse by 0.25 (allowed in one case: 0.11)"."""
        by, allowed = (each.split()[0] for each in format_beside(metric, self.by, self.allowed, sign=False))
        return f"seed {self.seed} worse by {by} (allowed in one case: {allowed})"


@dataclass(frozen=True)
class Pair:
    """One metric of one group in the n seeds that both runs have.

    tolerance: tolerated worsening of its mean without chance.
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
        """True where recordings are the same, or made from the same inputs."""
        return self.relation in ("same bits", "same origin")

    @property
    def units(self) -> list[Unit]:
        """Exchangeable unit of each seed: recordings whose people begin alike, or each alone where unknown."""
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
        """Centred random differences, (k, n): none, the paired differences, or those of before and now."""
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
    def collapse(self) -> Collapse | None:
        """The largest worsening of one case; None where it is within `allowed_in_case`."""
        sign = worsening(self.metric, 1.0)
        before = sign * self.before
        by = sign * self.now - (before if self.is_exact else before.max())
        worst = int(np.argmax(by))
        allowed = self.allowed_in_case
        return Collapse(self.seeds[worst], float(by[worst]), allowed) if by[worst] > allowed else None


def allowed_change(pairs: Sequence[Pair]) -> float:
    """Compute the tolerated worsening of the mean over G groups: the mean tolerance / √G, plus an allowance for chance.

    The allowance is some standard errors of the mean; recordings of the same people count as one, whatever the tracker.
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
        (seed, old, at_frames_of(metric, new, figures, was.seeds[seed]))
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


ALPHA = 0.05
"""Probability of a false alarm anywhere in a suite."""

_MOST_EXACT = 12
"""Number of changed units up to which all signs are tried: 4096 ways."""

_MOST_AT_ONCE = 5_000_000
"""Number of statistics held at once."""

_ROUNDING = 1e-9


def family_wise_p(shares: Array) -> Array:
    """Compute the family-wise p of each of t one-sided tests (t,), by sign flips and step-down maximum statistics.

    shares (u, t): contribution of each of u units of chance to each statistic, positive for the worse, 0 without part in it.
    """
    changed = shares[(shares != 0).any(axis=1)]
    if not len(changed):
        return np.ones(shares.shape[1])
    signs = _signs(len(changed))
    statistic = changed.sum(axis=0)
    order = np.argsort(statistic)  # the largest of the first tests to each: of those whose statistic is no larger
    least = (statistic - _ROUNDING * np.abs(statistic).max())[order]
    as_large = np.zeros(shares.shape[1])
    step = max(1, _MOST_AT_ONCE // max(1, shares.shape[1]))
    for first in range(0, len(signs), step):
        drawn = signs[first : first + step] @ changed[:, order]
        as_large += (np.maximum.accumulate(drawn, axis=1) >= least).sum(axis=0)
    p = np.empty(shares.shape[1])
    p[order] = np.maximum.accumulate((as_large / len(signs))[::-1])[::-1]
    return p


def min_recordings() -> int:
    """Compute the least number of recordings whose unanimous worsening is significant."""
    return int(np.ceil(-np.log2(ALPHA)))


def _signs(count: int) -> Array:
    """Draw sign vectors (f, count), the observed one first."""
    if count <= _MOST_EXACT:
        bits = np.arange(2**count)[:, None] >> np.arange(count) & 1
        return 1.0 - 2.0 * bits.astype(float)
    drawn = stream(count, "suite", "signs").integers(0, 2, size=(2**_MOST_EXACT, count))
    drawn[0] = 0
    return 1.0 - 2.0 * drawn.astype(float)


OF_ALL = ("motp_m", "misidentifications", "lost_tracks", "id_switches", "misses")
"""Metrics also tested over all trackers and cases together: positions, and events too rare for a single tracker."""


def over_scenarios(pairs: Sequence[Pair]) -> Iterator[list[Pair]]:
    """Yield each metric of a tracker pooled over its scenarios, where there are several."""
    by_tracker = sorted(pairs, key=lambda pair: (pair.key.tracker, pair.metric))
    for _, found in groupby(by_tracker, key=lambda pair: (pair.key.tracker, pair.metric)):
        if len(several := list(found)) > 1:
            yield several


def over_trackers(pairs: Sequence[Pair]) -> Iterator[list[Pair]]:
    """Yield each rare-event metric pooled over all trackers, where there are several."""
    for metric in OF_ALL:
        found = [pair for pair in pairs if pair.metric == metric]
        if len({pair.key.tracker for pair in found}) > 1:
            yield found


def contributions(tests: Sequence[Sequence[Pair]]) -> tuple[Array, list[float]]:
    """Compute each unit's contribution to each test's statistic, (u, t), and each test's tolerance.

    A test is of one group, of a tracker's groups, or of all trackers'; of several groups the mean is judged. With d, a
    unit's worsening relative to the allowed one, the statistic is Σ d / √(Σ d² + n): a signal over its noise, in which
    worsenings far below the allowed one count for nothing (the constant under the root: Tusher, Tibshirani, Chu, PNAS 98,
    2001).
    """
    place: dict[Unit, int] = {}
    for pairs in tests:
        for pair in pairs:
            for unit in pair.units:
                place.setdefault(unit, len(place))
    shares, allowances = np.zeros((len(place), len(tests))), []
    for number, pairs in enumerate(tests):
        allowances.append(allowed_change(pairs))
        for pair in pairs:
            rows = [place[unit] for unit in pair.units]
            shares[rows, number] += pair.worsened / max(allowances[-1], 1e-12)
    n = np.array([sum(len(pair.seeds) for pair in pairs) for pairs in tests], dtype=float)
    return shares / np.sqrt((shares**2).sum(axis=0) + n), allowances


@dataclass(frozen=True)
class MinimumDetectableChange:
    """Smallest loss of a metric, in its unit, that the comparison detects while nothing else changes.

    of_tracker: in all scenarios of each tracker; in_scenario and in_case: in all seeds of one scenario and in one case
    alone, each for the tracker and scenario that need the least and the most.
    """

    metric: str
    of_tracker: Mapping[str, float]
    in_scenario: tuple[float, float]
    in_case: tuple[float, float]

    @property
    def everywhere(self) -> tuple[float, float]:
        """Loss in all scenarios of a tracker, for the trackers that need the least and the most."""
        return min(self.of_tracker.values()), max(self.of_tracker.values())


def minimum_detectable_changes(pairs: Sequence[Pair]) -> Iterator[MinimumDetectableChange]:
    """Yield the minimum detectable change of each metric."""
    by_metric: Mapping[str, list[Pair]] = {
        metric: sorted((pair for pair in pairs if pair.metric == metric), key=_tracker)
        for metric in (*GATED, *GATED_SENSOR_METRICS)
    }
    for metric, found in by_metric.items():
        if found:
            of_tracker = {tracker: _everywhere(list(its)) for tracker, its in groupby(found, key=_tracker)}
            in_scenario, in_case = [_in_scenario(pair) for pair in found], [pair.allowed_in_case for pair in found]
            yield MinimumDetectableChange(
                metric, of_tracker, (min(in_scenario), max(in_scenario)), (min(in_case), max(in_case))
            )


def _tracker(pair: Pair) -> str:
    return pair.key.tracker


def _in_scenario(pair: Pair) -> float:
    return allowed_change([pair]) if len(pair.seeds) >= min_recordings() else pair.allowed_in_case


def _everywhere(pairs: list[Pair]) -> float:
    """Return the detectable loss in all scenarios of the tracker of these pairs."""
    n_case = sum(len(pair.seeds) for pair in pairs)
    return allowed_change(pairs) if n_case >= min_recordings() else max(map(_in_scenario, pairs))
