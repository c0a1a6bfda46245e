"""Set cover: poses added greedily by coverage, and the best set, proven by branch and bound.

Coverage is the share of rows seen by at least k sensors. For k = 1 it is submodular: no pose adds more later than now, so a
set grown from S by r poses covers at most S and the r largest gains. For k > 1 it is not, but the bound holds for Σ
min(sensors, k) / k, which is never below the coverage. Greedy's 1 − 1/e (Nemhauser, Wolsey and Fisher, Mathematical
Programming 14, 1978) holds for a number of devices alone and for Σ min(sensors, k). Under prices, distances, or k > 1 only
the posterior bound is claimed.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class CoverProblem:
    """Candidate poses (n) of devices, over r distinct rows.

    counts (n, r): sensors of a pose that see a row, at most k; fixed (r,): fixed sensors that see it; weight (r,): frequency
    of a row; device (n,): the device of a pose; is_allowed: True for a set that keeps the constraints.
    """

    counts: Array
    fixed: Array
    weight: Array
    k: int
    device: Sequence[str]
    is_allowed: Callable[[list[int]], bool]

    def value(self, chosen: Sequence[int]) -> float:
        """Return the share of rows that enough sensors see."""
        return float(self.weight[self._sensors(chosen) >= self.k].sum() / self.weight.sum())

    def _sensors(self, chosen: Sequence[int]) -> Array:
        return self.fixed + self.counts[list(chosen)].sum(axis=0)

    def gains(self, chosen: Sequence[int]) -> Array:
        """Return the gain of value by each pose, (n,)."""
        now = self._sensors(chosen)
        if self.k == 1:
            return self.counts @ (self.weight * (now == 0)) / self.weight.sum()
        would = (now + self.counts >= self.k) & (now < self.k)
        return would @ self.weight / self.weight.sum()

    def bounds(self, chosen: Sequence[int]) -> tuple[float, Array]:
        """Return a submodular upper bound of `value`, and its gain by each pose, (n,)."""
        if self.k == 1:
            return self.value(chosen), self.gains(chosen)
        now = self._sensors(chosen)
        room = np.maximum(self.k - now, 0.0)
        total = self.k * self.weight.sum()
        rise = np.minimum(self.counts, room) @ self.weight / total
        return float(np.minimum(now, self.k) @ self.weight / total), rise


@dataclass(frozen=True)
class Cover:
    """Set of poses, its coverage, and an upper bound on that of any set of `wanted` poses.

    Of fewer than `wanted` poses where no such set that keeps the constraints was found; the bound is then 0 if there is none.
    refused: the constraint that no such set can keep; "" where it took a search.
    """

    chosen: tuple[int, ...]
    value: float
    bound: float
    wanted: int = 0
    refused: str = ""

    @property
    def complete(self) -> bool:
        """True for a set of as many poses as are wanted."""
        return len(self.chosen) >= self.wanted

    @property
    def optimal(self) -> bool:
        """True for a set proven to be the best."""
        return self.complete and self.bound <= self.value + _ROUNDING

    def summary(self) -> str:
        """Return 'optimal', the gap, or that no set keeps the constraints, and which."""
        if self.refused:
            return self.refused
        if not self.complete:
            return "no placement keeps the constraints" if self.bound <= 0 else "none found that keeps the constraints"
        return "optimal" if self.optimal else f"at most {self.bound - self.value:.4f} below the best"


def greedy(choice: CoverProblem, number: Mapping[str, int]) -> Cover:
    """Choose the pose of largest gain again and again; then exchange poses while that helps.

    Fewer poses where no more are allowed. For k > 1 the first sensor of a row gains nothing, so the gain of the bound is
    tried too, and the better result taken.
    """
    ways = [_grow(choice, number, by_bound) for by_bound in ((False, True) if choice.k > 1 else (False,))]
    chosen = max((_exchange(choice, each, number) for each in ways), key=lambda each: (len(each), choice.value(each)))
    bound = min(_posterior_bound(choice, each, number) for each in ways)
    value = choice.value(chosen)
    wanted = sum(number.values())
    return Cover(tuple(sorted(chosen)), value, max(bound, value), wanted)


def _grow(choice: CoverProblem, number: Mapping[str, int], by_bound: bool) -> list[int]:
    chosen: list[int] = []
    while (open_ := _selectable(choice, chosen, number)).any():
        gains, (_, rise) = choice.gains(chosen), choice.bounds(chosen)
        first, second = (rise, gains) if by_bound else (gains, rise)
        order = np.lexsort((np.arange(len(gains)), -second, -first))
        best = next((int(each) for each in order if open_[each] and choice.is_allowed([*chosen, int(each)])), None)
        if best is None:
            break
        chosen.append(best)
    return chosen


def _exchange(choice: CoverProblem, chosen: list[int], number: Mapping[str, int]) -> list[int]:
    """Exchange one pose for another while that increases coverage."""
    value, better = choice.value(chosen), True
    while better:
        better = False
        for place in range(len(chosen)):
            rest = [*chosen[:place], *chosen[place + 1 :]]
            gains = np.where(_selectable(choice, rest, number), choice.gains(rest), -1.0)
            base = choice.value(rest)
            for each in np.argsort(-gains, kind="stable"):
                if base + gains[each] <= value + _ROUNDING:
                    break
                if choice.is_allowed([*rest, int(each)]):
                    chosen, value, better = [*rest, int(each)], base + float(gains[each]), True
                    break
    return chosen


def _posterior_bound(choice: CoverProblem, chosen: Sequence[int], number: Mapping[str, int]) -> float:
    """Bound the value of any set of this size, from the bound of each partial set and the largest gains from there."""
    total = sum(number.values())
    least = 1.0
    for size in range(len(chosen) + 1):
        bound, rise = choice.bounds(chosen[:size])
        least = min(least, bound + float(np.sort(rise)[::-1][:total].sum()))
    return least


def exact(choice: CoverProblem, number: Mapping[str, int], limit_s: float) -> Cover:
    """Find the best set by branch and bound, best bound first; at the time limit return greedy's, or a better one."""
    start = time.perf_counter()
    best = greedy(choice, number)
    chosen, value = best.chosen, best.value  # the result is never worse
    total = sum(number.values())
    if len(chosen) < total:
        value = -1.0  # greedy failed by the constraints: any complete set is better
    waiting: list[tuple[float, tuple[int, ...], tuple[int, ...]]] = [(-1.0, (), tuple(range(len(choice.device))))]
    bound = value
    while waiting:
        least, taken, left = heapq.heappop(waiting)
        if -least <= value + _ROUNDING:
            break
        if time.perf_counter() - start > limit_s:
            bound = max(bound, -least)
            break
        rest = total - len(taken)
        open_ = _selectable(choice, taken, number)
        if rest == 1:
            gains = choice.gains(taken)
            base = choice.value(taken)
            for each in sorted((each for each in left if open_[each]), key=lambda each: -gains[each]):
                if base + gains[each] <= value + _ROUNDING:
                    break
                if choice.is_allowed([*taken, each]):
                    chosen, value = tuple(sorted((*taken, each))), base + float(gains[each])
                    break
            continue
        base, rise = choice.bounds(taken)
        order = sorted((each for each in left if open_[each]), key=lambda each: (-rise[each], each))
        sums = np.concatenate([[0.0], np.cumsum(rise[order])])
        for place in range(len(order) - rest + 1):
            above = base + float(sums[place + rest] - sums[place])
            if above <= value + _ROUNDING:
                break
            if choice.is_allowed([*taken, order[place]]):
                heapq.heappush(waiting, (-above, (*taken, order[place]), tuple(order[place + 1 :])))
    if value < 0:
        chosen = ()
    return Cover(chosen, max(value, 0.0), max(bound, value, 0.0), total)


def _selectable(choice: CoverProblem, chosen: Sequence[int], number: Mapping[str, int]) -> Array:
    """Return the mask (n,) of poses not taken, of devices of which more are allowed."""
    left = dict(number)
    for each in chosen:
        left[choice.device[each]] -= 1
    open_ = np.array([left[name] > 0 for name in choice.device], dtype=bool)
    open_[list(chosen)] = False
    return open_
