"""Is anything worse than it was? Figures paired by seed, an interval for each, and all of them judged together.

The change of a figure is the mean over the seeds of a group of (now − before). Its interval is the percentile bootstrap's
over the seeds (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 13.3), its p the share of replicates
beyond 0, twice the smaller one. Over all figures of all groups Holm's step-down procedure (Scandinavian Journal of
Statistics 6, 1979) keeps the chance of any false alarm at 5 %, as far as the bootstrap's p can be trusted: of three seeds it
says little more than that all three changed the same way, which also chance does. So an alarm needs the tolerance passed too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.streams import stream
from twin.suites.figures import GATED, worsening
from twin.suites.results import Group, GroupKey, Results

ALPHA = 0.05
"""The chance of a false alarm anywhere in a suite, as far as the bootstrap's p can be trusted."""
FEWEST_SEEDS = 3
RELAXED = 3.0
"""The tolerance of figures that images take part in grows by this factor where another renderer drew them."""

_FEWEST_REPLICATES = 10_000
_REPLICATES_PER_TEST = 4 / ALPHA
"""So many that the smallest p there can be is half of what Holm asks of the first of all tests."""


@dataclass(frozen=True)
class Change:
    """A figure of a group, before and now: means over the seeds that both have, and the interval of their difference.

    low, high: at the level at which Holm's procedure judged it; allowed: how much worse it may be; worst_seed: where it got
    worst (of now's, None where the figure is gone altogether).
    """

    key: GroupKey
    variant: str
    metric: str
    before: float
    now: float | None
    low: float
    high: float
    n_seed: int
    allowed: float
    significant: bool
    worst_seed: int | None

    @property
    def change(self) -> float:
        """Now − before; NaN where the figure is gone."""
        return float("nan") if self.now is None else self.now - self.before

    @property
    def worse(self) -> bool:
        """Whether the interval says so and the tolerance is passed, or the figure is gone."""
        return self.now is None or (self.significant and worsening(self.metric, self.change) > self.allowed)

    @property
    def better(self) -> bool:
        """The same the other way."""
        return self.now is not None and self.significant and -worsening(self.metric, self.change) > self.allowed


@dataclass(frozen=True)
class Comparison:
    """All changes, by group and figure, and what a reader must know of how they were judged."""

    changes: tuple[Change, ...]
    warnings: tuple[str, ...]

    @property
    def worse(self) -> list[Change]:
        """What got worse, the most tolerances first."""
        return sorted((each for each in self.changes if each.worse), key=_excess, reverse=True)

    @property
    def better(self) -> list[Change]:
        """What got better, the most tolerances first."""
        return sorted((each for each in self.changes if each.better), key=_excess, reverse=True)


@dataclass(frozen=True)
class _Paired:
    """One figure of one group in the n seeds that both have."""

    key: GroupKey
    group: Group
    metric: str
    seeds: tuple[int, ...]
    before: Array  # (n,)
    now: Array  # (n,)


def compare(
    before: Results, now: Results, allowed: Callable[[str, float], float], before_name: str = "the baseline"
) -> Comparison:
    """Every figure of `now` against `before`; `allowed(metric, before)`: how much worse it may be, in its unit."""
    other_renderer = bool(before.renderers and now.renderers and set(before.renderers) != set(now.renderers))
    pairs, gone = list(_pairs(before, now)), list(_gone(before, now))
    tested = [pair for pair in pairs if len(pair.seeds) >= FEWEST_SEEDS]
    n_replicate = max(_FEWEST_REPLICATES, int(np.ceil(_REPLICATES_PER_TEST * max(1, len(tested)))))
    replicates = [_replicated_means(pair.now - pair.before, n_replicate) for pair in tested]
    p = np.array([_two_sided_p(means) for means in replicates])
    levels, significant = holm(p)
    changes = []
    for pair, means, level, found in zip(tested, replicates, levels, significant, strict=True):
        low, high = np.quantile(means, [level / 2, 1 - level / 2])
        was = float(pair.before.mean())
        worst = int(np.argmax([worsening(pair.metric, change) for change in pair.now - pair.before]))
        changes.append(
            Change(
                key=pair.key,
                variant=pair.group.variant,
                metric=pair.metric,
                before=was,
                now=float(pair.now.mean()),
                low=float(low),
                high=float(high),
                n_seed=len(pair.seeds),
                allowed=allowed(pair.metric, was) * (RELAXED if other_renderer and pair.group.image_based else 1.0),
                significant=bool(found),
                worst_seed=pair.seeds[worst],
            )
        )
    warnings = _warnings(before, now, before_name, other_renderer, len(pairs) - len(tested))
    return Comparison((*gone, *changes), tuple(warnings))


def holm(p: Array, alpha: float = ALPHA) -> tuple[Array, NDArray[np.bool_]]:
    """Holm's step-down procedure on m p-values: the level each is judged at, and which are significant, (m,) each."""
    m = len(p)
    levels, significant = np.empty(m), np.zeros(m, dtype=bool)
    order = np.argsort(p, kind="stable")
    levels[order] = alpha / np.arange(m, 0, -1)
    failing = np.flatnonzero(p[order] > levels[order])
    significant[order[: failing[0] if failing.size else m]] = True
    return levels, significant


def _replicated_means(differences: Array, n_replicate: int) -> Array:
    """Bootstrap replicates of the mean of n differences, (n_replicate,); as many seeds, the same draws."""
    n = len(differences)
    drawn = stream(n, "suite", "comparison").multinomial(n, np.full(n, 1 / n), size=n_replicate)
    return drawn @ differences / n


def _two_sided_p(means: Array) -> float:
    smaller = min(np.count_nonzero(means <= 0), np.count_nonzero(means >= 0))
    return min(1.0, 2 * (smaller + 1) / (len(means) + 1))


def _pairs(before: Results, now: Results) -> Iterator[_Paired]:
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
            if both:
                seeds, old, new = zip(*both, strict=True)
                yield _Paired(key, group, metric, seeds, np.array(old), np.array(new))


def _gone(before: Results, now: Results) -> Iterator[Change]:
    """Figures that applied to a group before and apply to none of its seeds now, though it was run."""
    for key, was in before.groups.items():
        group = now.groups.get(key)
        if group is None or not set(was.seeds) & set(group.seeds):
            continue
        for metric in GATED:
            values = was.values(metric)
            if values and not group.values(metric):
                nan = float("nan")
                yield Change(
                    key, group.variant, metric, float(np.mean(values)), None, nan, nan, len(values), 0.0, True, None
                )


def _warnings(before: Results, now: Results, before_name: str, other_renderer: bool, n_untested: int) -> Iterator[str]:
    if before.suite != now.suite:
        yield f"{before_name} is of the suite {before.suite}, this one is {now.suite}"
    if other_renderer:
        yield (
            f"{before_name} was drawn by {_listed(before.renderers)}, here it is {_listed(now.renderers)}: figures that "
            f"images take part in are given {RELAXED:g} times their tolerance"
        )
    old, new = before.versions.get("mujoco"), now.versions.get("mujoco")
    if old != new:
        yield f"{before_name} was made with MuJoCo {old}, here it is {new}: contacts and pictures may differ"
    if n_untested:
        yield f"{n_untested} figures have fewer than {FEWEST_SEEDS} seeds in common and were not compared"
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
