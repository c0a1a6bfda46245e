"""One figure of one group, before and now, seed by seed, and how much worse it may be.

Where a recording is neither the one before nor made from the same (scenario, seed and code that simulates; another processor or
renderer makes other bits of those), two runs of a seed are no pair but draws from two populations: there a mean may also move
by twice its standard error, and a case has to fall below the worst seed before by 25 times what the mean may, which is more than
two of five people cost who exchange their identities once: that may happen in any draw, and is counted with the rare events.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.suites.figures import GATED, worsening
from twin.suites.results import Group, GroupKey, Results

_BEYOND_NOISE, _BEYOND_ANY_DRAW, _BEYOND_SPREAD = 10.0, 25.0, 4.0
_STANDARD_ERRORS = 2.0


@dataclass(frozen=True)
class Pair:
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


def pairs_of(before: Results, now: Results, allowed: Callable[[str, float], float]) -> Iterator[Pair]:
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
            yield Pair(
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
