"""Is anything worse than it was? Figures paired by case, judged together, and nothing waved through for want of seeds.

The twin is deterministic: where recordings and figures have the same bits, nothing changed. Else three questions are asked.

- Did the mean of a figure get worse by more than it may? Of a tracker in one scenario; of a tracker over all its scenarios;
  of all trackers together, for places and rare events; and of what each scanner reports. More than it may: than its
  tolerance, a mean over G groups than one of them by √G. By more than chance: `twin.suites.evidence`.
- Did one case fall beyond any noise? By ten times what the mean may and four standard deviations between the seeds before.
- Is a figure gone that was measured before?

Where recordings are others than before, `twin.suites.pairs` says what runs of a seed are to each other, and may differ by.
A scanner's noise that doubled shows in what the scanner reports: what it costs trackers is less than one more draw of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.suites.caveats import caveats_of
from twin.suites.evidence import ALPHA, family_wise_p
from twin.suites.figures import GATED, worsening
from twin.suites.pairs import Pair, pairs_of
from twin.suites.pooling import over_scenarios, over_trackers, shares_of
from twin.suites.power import Power, power_of
from twin.suites.results import GroupKey, Results

EVERY_SCENARIO, EVERY_TRACKER = "every scenario", "every tracker"
"""Stand for a group's scenario and tracker where several are judged together."""


@dataclass(frozen=True)
class Change:
    """A figure of a group, or of several together, before and now: means over the seeds that both have; totals of rare events.

    A group is of a tracker in a scenario, or of a scanner there, which the key then names in the tracker's place.

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


def compare(
    before: Results, now: Results, allowed: Callable[[str, float], float], before_name: str = "the baseline"
) -> Comparison:
    """Every figure of `now` against `before`; `allowed(metric, before)`: how much worse it may be, in its unit."""
    pairs = list(pairs_of(before, now, allowed))
    tests = [[pair] for pair in pairs] + [*over_scenarios(pairs), *over_trackers(pairs)]
    shares, allowances = shares_of(tests)
    p, p_better = family_wise_p(shares), family_wise_p(-shares)
    changes = [_change(*each) for each in zip(tests, p, p_better, allowances, strict=True)]
    gone = list(_gone(before, now))
    identical = (
        bool(pairs)
        and not gone
        and all(each.kinship == "same bits" and (each.before == each.now).all() for each in pairs)
    )
    warnings = tuple(caveats_of(before, now, before_name, pairs))
    return Comparison((*gone, *changes), warnings, tuple(power_of(pairs)), identical)


def _change(pairs: Sequence[Pair], p: float, p_better: float, allowed: float) -> Change:
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


def _excess(change: Change) -> float:
    """By how many tolerances a figure changed; what is gone comes first."""
    if change.now is None:
        return float("inf")
    return abs(change.change) / max(change.allowed, 1e-12)
