"""Is anything worse than it was? Figures paired by case, judged together, and nothing waved through for want of seeds.

The twin is deterministic: where recordings and figures have the same bits, nothing changed. Else three questions are asked.

- Did the mean of a figure get worse by more than it may? Of a tracker in one scenario; of a tracker over all its scenarios;
  and of events that are rare, of all trackers together. More than it may: than its tolerance, a mean over G groups than one
  of them by √G. By more than chance: `twin.suites.evidence`.
- Did one case fall beyond any noise? By ten times what the mean may and four standard deviations between the seeds before.
- Is a figure gone that was measured before?

Where a recording is neither the one before nor made from the same (scenario, seed and code that simulates; another processor or
renderer makes other bits of those), two runs of a seed are no pair but draws from two populations: there a mean may also move
by twice its standard error, and a case has to fall below the worst seed before by 25 times what the mean may, which is more than
two of five people cost who exchange their identities once: that may happen in any draw, and is counted with the rare events.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from trackers.arrays import Array
from twin.suites.evidence import ALPHA, family_wise_p, fewest_for_an_alarm
from twin.suites.figures import GATED, worsening
from twin.suites.results import Group, GroupKey, Results

EVERY_SCENARIO, EVERY_TRACKER = "every scenario", "every tracker"
"""Stand for a group's scenario and tracker where several are judged together."""
RARE = ("misidentifications", "lost_tracks", "id_switches", "misses")
"""Events that are counted over all trackers and cases together: too rare to tell anything of one."""

_BEYOND_NOISE, _BEYOND_ANY_DRAW, _BEYOND_SPREAD = 10.0, 25.0, 4.0
_STANDARD_ERRORS = 2.0


@dataclass(frozen=True)
class Change:
    """A figure of a group, or of several together, before and now: means over the seeds that both have; totals of rare events.

    p: how likely chance makes any figure of the suite change so much for the worse; p_better: for the better. allowed: how
    much worse it may be. worst_seed: where it got worst (of now's; None: over several groups, or gone). fallen: a seed whose
    case fell beyond any noise.
    """

    key: GroupKey
    variant: str
    metric: str
    before: float
    now: float | None
    p: float
    p_better: float
    n_seed: int
    allowed: float
    worst_seed: int | None = None
    fallen: int | None = None

    @property
    def change(self) -> float:
        """Now − before; NaN where the figure is gone."""
        return float("nan") if self.now is None else self.now - self.before

    @property
    def worse(self) -> bool:
        """Whether the mean got worse by more than it may and than chance, one case fell, or the figure is gone."""
        if self.now is None or self.fallen is not None:
            return True
        return self.p <= ALPHA and worsening(self.metric, self.change) > self.allowed

    @property
    def better(self) -> bool:
        """Whether the mean got better by as much."""
        return self.now is not None and self.p_better <= ALPHA and -worsening(self.metric, self.change) > self.allowed


@dataclass(frozen=True)
class Power:
    """The smallest loss of a figure, in its unit, that would be noticed, whichever tracker and scenario has it.

    everywhere: of one tracker in all its scenarios; in_scenario: in all seeds of one scenario; in_case: in one case alone.
    """

    metric: str
    everywhere: float
    in_scenario: float
    in_case: float


@dataclass(frozen=True)
class Comparison:
    """All changes, by group and figure, and what a reader must know of how they were judged."""

    changes: tuple[Change, ...]
    warnings: tuple[str, ...]
    power: tuple[Power, ...] = ()
    identical: bool = False  # recordings and figures all have the same bits

    @property
    def worse(self) -> list[Change]:
        """What got worse, the most tolerances first."""
        return sorted((each for each in self.changes if each.worse), key=_excess, reverse=True)

    @property
    def better(self) -> list[Change]:
        """What got better, the most tolerances first."""
        return sorted((each for each in self.changes if each.better), key=_excess, reverse=True)


@dataclass(frozen=True)
class _Pair:
    """One figure of one group in the n seeds that both have, and how much worse its mean and one case may be."""

    key: GroupKey
    group: Group
    metric: str
    seeds: tuple[int, ...]
    before: Array  # (n,)
    now: Array  # (n,)
    allowed: float
    allowed_in_case: float
    same_bits: bool  # of the recordings
    paired: bool  # the recordings are the same, or made from the same

    @property
    def worsened(self) -> Array:
        """By how much each seed got worse, (n,)."""
        return worsening(self.metric, 1.0) * (self.now - self.before)

    @property
    def fallen(self) -> int | None:
        """The seed that fell furthest beyond any noise."""
        sign = worsening(self.metric, 1.0)
        before = sign * self.before
        by = sign * self.now - (before if self.paired else before.max())
        worst = int(np.argmax(by))
        return self.seeds[worst] if by[worst] > self.allowed_in_case else None


def compare(
    before: Results, now: Results, allowed: Callable[[str, float], float], before_name: str = "the baseline"
) -> Comparison:
    """Every figure of `now` against `before`; `allowed(metric, before)`: how much worse it may be, in its unit."""
    pairs = list(_pairs(before, now, allowed))
    tests = [[pair] for pair in pairs] + [*_over_scenarios(pairs), *_rare_events(pairs)]
    shares, allowances = _shares(tests)
    p, p_better = family_wise_p(shares), family_wise_p(-shares)
    changes = [_change(*each) for each in zip(tests, p, p_better, allowances, strict=True)]
    gone = list(_gone(before, now))
    identical = bool(pairs) and not gone and all(each.same_bits and (each.before == each.now).all() for each in pairs)
    warnings = tuple(_warnings(before, now, before_name, pairs))
    return Comparison((*gone, *changes), warnings, tuple(_power(pairs)), identical)


def _pairs(before: Results, now: Results, allowed: Callable[[str, float], float]) -> Iterator[_Pair]:
    for key, group in now.groups.items():
        was = before.groups.get(key)
        if was is None:
            continue
        for metric in GATED:
            both = [
                (seed, old, new)
                for seed, figures in sorted(group.seeds.items())
                if (old := was.seeds.get(seed, {}).get(metric)) is not None and (new := figures.get(metric)) is not None
            ]
            if not both:
                continue
            seeds, old, new = zip(*both, strict=True)
            old, new, n = np.array(old), np.array(new), len(both)
            same_bits = _same(was.recordings, group.recordings, seeds)
            paired = same_bits or _same(was.recipes, group.recipes, seeds)
            spread = float(old.std(ddof=1)) if n > 1 else 0.0
            mean = allowed(metric, float(old.mean()))
            error = 0.0 if paired or n < 2 else float(np.hypot(spread, new.std(ddof=1)) / np.sqrt(n))
            yield _Pair(
                key,
                group,
                metric,
                seeds,
                old,
                new,
                allowed=mean + _STANDARD_ERRORS * error,
                allowed_in_case=(_BEYOND_NOISE if paired else _BEYOND_ANY_DRAW) * mean + _BEYOND_SPREAD * spread,
                same_bits=same_bits,
                paired=paired,
            )


def _same(before: Mapping[int, str], now: Mapping[int, str], seeds: Sequence[int]) -> bool:
    return all(seed in before and before[seed] == now.get(seed) for seed in seeds)


def _over_scenarios(pairs: Sequence[_Pair]) -> Iterator[list[_Pair]]:
    """A figure of a tracker in all its scenarios, where there are several."""
    by_tracker = sorted(pairs, key=lambda pair: (pair.key.tracker, pair.metric))
    for _, found in groupby(by_tracker, key=lambda pair: (pair.key.tracker, pair.metric)):
        if len(several := list(found)) > 1:
            yield several


def _rare_events(pairs: Sequence[_Pair]) -> Iterator[list[_Pair]]:
    """Rare events of all trackers, where there are several."""
    for metric in RARE:
        found = [pair for pair in pairs if pair.metric == metric]
        if len({pair.key.tracker for pair in found}) > 1:
            yield found


def _shares(tests: Sequence[Sequence[_Pair]]) -> tuple[Array, list[float]]:
    """What each recording adds to each test's statistic, (r, t), and how much the test's mean may get worse, a number each.

    A test is of one group, of a tracker's groups, or of all trackers': of several the mean over groups is judged, and what it
    is allowed is the mean allowance over the root of their number G. With d, what a recording got worse in units of that, the
    statistic is Σ d / √(Σ d² + n): a signal over its noise, in which what is far less than allowed counts for nothing (the
    constant under the root: Tusher, Tibshirani, Chu, PNAS 98, 2001).
    """
    place: dict[tuple[str, str, int], int] = {}
    for pairs in tests:
        for pair in pairs:
            for seed in pair.seeds:
                place.setdefault((pair.key.scenario, pair.key.overrides, seed), len(place))
    shares, allowances = np.zeros((len(place), len(tests))), []
    for number, pairs in enumerate(tests):
        allowances.append(float(np.mean([pair.allowed for pair in pairs])) / np.sqrt(len(pairs)))
        for pair in pairs:
            rows = [place[pair.key.scenario, pair.key.overrides, seed] for seed in pair.seeds]
            shares[rows, number] += pair.worsened / max(allowances[-1], 1e-12)
    n = np.array([sum(len(pair.seeds) for pair in pairs) for pairs in tests], dtype=float)
    return shares / np.sqrt((shares**2).sum(axis=0) + n), allowances


def _change(pairs: Sequence[_Pair], p: float, p_better: float, allowed: float) -> Change:
    first = pairs[0]
    if len(pairs) == 1:
        worst = first.seeds[int(np.argmax(first.worsened))]
        before, now = float(first.before.mean()), float(first.now.mean())
        n_seed = len(first.seeds)
        return Change(
            first.key,
            first.group.variant,
            first.metric,
            before,
            now,
            float(p),
            float(p_better),
            n_seed,
            allowed,
            worst,
            first.fallen,
        )
    trackers = {pair.key.tracker for pair in pairs}
    key = GroupKey(EVERY_SCENARIO, "[]", first.key.tracker if len(trackers) == 1 else EVERY_TRACKER)
    before = float(np.mean([pair.before.mean() for pair in pairs]))
    now = float(np.mean([pair.now.mean() for pair in pairs]))
    n_seed = sum(len(pair.seeds) for pair in pairs)
    return Change(key, "", first.metric, before, now, float(p), float(p_better), n_seed, allowed)


def _gone(before: Results, now: Results) -> Iterator[Change]:
    """Figures that applied to a group before and apply to none of its seeds now, though it was run."""
    for key, was in before.groups.items():
        group = now.groups.get(key)
        if group is None or not set(was.seeds) & set(group.seeds):
            continue
        for metric in GATED:
            values = was.values(metric)
            if values and not group.values(metric):
                yield Change(key, group.variant, metric, float(np.mean(values)), None, 0.0, 1.0, len(values), 0.0)


def _power(pairs: Sequence[_Pair]) -> Iterator[Power]:
    """Of each figure, the smallest loss that is noticed wherever it happens, while nothing else changes."""
    fewest = fewest_for_an_alarm()
    by_metric: Mapping[str, list[_Pair]] = {
        metric: [pair for pair in pairs if pair.metric == metric] for metric in GATED
    }
    for metric, found in by_metric.items():
        if not found:
            continue
        in_case = max(pair.allowed_in_case for pair in found)
        in_scenario = max(pair.allowed if len(pair.seeds) >= fewest else pair.allowed_in_case for pair in found)
        everywhere = in_scenario
        together = list(_over_scenarios(found))
        if together and len({pair.key.tracker for pair in found}) == len(together):
            everywhere = max(
                float(np.mean([pair.allowed for pair in pairs])) / np.sqrt(len(pairs))
                if sum(len(pair.seeds) for pair in pairs) >= fewest
                else in_scenario
                for pairs in together
            )
        yield Power(metric, everywhere, in_scenario, in_case)


def _warnings(before: Results, now: Results, before_name: str, pairs: Sequence[_Pair]) -> Iterator[str]:
    if before.suite != now.suite:
        yield f"{before_name} is of the suite {before.suite}, this one is {now.suite}"
    changed = {pair.key: pair for pair in pairs if not pair.paired}
    if changed:
        yield (
            f"the recordings of {_names(list(changed))} are not those of {before_name}: other noise, another scenario, "
            "or code that simulates; seeds are then two populations and no pairs"
        )
    if any(pair.paired and not pair.same_bits for pair in pairs):
        yield (
            f"recordings have other bits than those of {before_name} though they are made from the same, as on another processor "
            "or renderer; seeds are pairs all the same"
        )
    if before.renderers and now.renderers and set(before.renderers) != set(now.renderers):
        yield f"{before_name} was drawn by {_listed(before.renderers)}, here it is {_listed(now.renderers)}"
    old, new = before.versions.get("mujoco"), now.versions.get("mujoco")
    if old != new:
        yield f"{before_name} was made with MuJoCo {old}, here it is {new}: contacts and pictures may differ"
    few = {pair.key: pair for pair in pairs if len(pair.seeds) < fewest_for_an_alarm()}
    if few:
        yield (
            f"{_names(list(few))} have fewer than {fewest_for_an_alarm()} seeds in common: there alone, only one that "
            "falls beyond any noise is noticed"
        )
    missing = [key for key in before.groups if key not in now.groups]
    added = [key for key in now.groups if key not in before.groups]
    if missing:
        yield f"{before_name} has what this run has not: {_names(missing)}"
    if added:
        yield f"not in {before_name}: {_names(added)}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join(names)


def _names(keys: Sequence[GroupKey], most: int = 4) -> str:
    names = list(dict.fromkeys(f"{key.scenario} with {key.tracker}" for key in keys))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _excess(change: Change) -> float:
    """By how many tolerances a figure changed; what is gone comes first."""
    if change.now is None:
        return float("inf")
    return abs(change.change) / max(change.allowed, 1e-12)
