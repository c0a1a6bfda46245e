"""One figure: what was measured, and its target."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A measured value beside its target, a bound like '<= 1.5' or '>= 20'; '' for one that is only reported."""

    name: str
    value: float
    unit: str
    target: str

    @property
    def holds(self) -> bool | None:
        """True where the target is met; None without a target."""
        if not self.target:
            return None
        relation, bound = self.target.split()
        return self.value <= float(bound) if relation == "<=" else self.value >= float(bound)

    def row(self) -> dict[str, Any]:
        """The figure as it is printed and stored."""
        return asdict(self) | {"holds": self.holds}


def median_ratio(
    measured: Callable[[], object],
    bare: Callable[[], object],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Median over rounds of the cost of one call over that of a bare call beside it, so that a noisy machine cancels.

    `clock`: `time.process_time` for CPU time, where no other process or graphics card does a part of the work.
    """
    ratios = []
    for _ in range(rounds):
        start = clock()
        bare()
        middle = clock()
        measured()
        ratios.append((clock() - middle) / (middle - start))
    return statistics.median(ratios)


def median_s(call: Callable[[], object], rounds: int = 100) -> float:
    """Median over rounds of what a call costs [s], after one that is not counted."""
    call()
    spent = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    return statistics.median(spent)
