"""Figure 10: one merge through every system; and the merges that the gallery shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.observations import NS_PER_S
from twin.evaluate.disposal import AFTER_S
from twin.reproduce.laser_vision_learning.conditions import FUSED, OneRun
from twin.reproduce.moments import SeenMoment
from twin.suites.worker import Incident

MOST_DRAWN = 4
_LEAST_S = 0.5


@dataclass(frozen=True)
class Merge:
    """A merge for the rig, between whom, and which systems disposed of it."""

    start_s: float
    end_s: float
    people: tuple[str, str]
    disposed: tuple[str, ...]

    @property
    def said(self) -> str:
        """Who, from when to when."""
        return f"{self.people[0]} and {self.people[1]}, merged from {self.start_s:.1f} to {self.end_s:.1f} s"


def merges_of(run: OneRun) -> list[Merge]:
    """The merges of a run that all systems are judged by and that last half a second, the most telling first: those that
    the fused system disposes of and most others do not, then the longest."""
    table = run.situations.select("merged_rig")
    found = []
    for row in range(len(table)):
        start_ns, end_ns = int(table.start_ns[row]), int(table.end_ns[row])
        pair = int(table.first_id[row]), int(table.second_id[row])
        if not table.complete[row] or end_ns - start_ns < _LEAST_S * NS_PER_S:
            continue
        verdicts = {name: _right(run, name, pair, start_ns, end_ns) for name in run.evaluations}
        if None in verdicts.values():
            continue
        names = run.names[pair[0]], run.names[pair[1]]
        kept = tuple(name for name, right in verdicts.items() if right)
        found.append(Merge(start_ns / NS_PER_S, end_ns / NS_PER_S, names, kept))
    return sorted(found, key=lambda each: (FUSED not in each.disposed, len(each.disposed), each.start_s - each.end_s))


def moments_of(run: OneRun, merges: list[Merge]) -> list[SeenMoment]:
    """The first merge through every system, the next ones through the first system, each a moment: its middle, told by
    whether it was disposed of."""
    moments = []
    for number, merge in enumerate(merges[:MOST_DRAWN]):
        for name, case in run.cases.items():
            if number == 0 or name == next(iter(run.cases)):
                verdict = "disposed of" if name in merge.disposed else "not disposed of"
                what = f"{merge.said}: {verdict}"
                moments.append(
                    SeenMoment(case, Incident((merge.start_s + merge.end_s) / 2, "merge", what, float(number)))
                )
    return moments


def _right(run: OneRun, name: str, pair: tuple[int, int], start_ns: int, end_ns: int) -> bool | None:
    """Whether a system disposed of a merge; None where it was not judged by it."""
    people, stamps_ns = run.evaluations[name].people, run.evaluations[name].stamps_ns
    late_ns = end_ns + round(AFTER_S * NS_PER_S)
    if not np.isin(pair, people.person_ids).all() or late_ns > stamps_ns[-1]:
        return None
    rows = np.searchsorted(people.person_ids, pair)
    window = (stamps_ns >= start_ns) & (stamps_ns < late_ns) & people.judged[rows].all(axis=0)
    if not (window & (stamps_ns < end_ns)).any():
        return None
    return bool(people.right[rows][:, window].all())
