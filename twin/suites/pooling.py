"""Which pairs are judged together, and what each recording adds to the statistic of that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from trackers.arrays import Array
from twin.suites.pairs import Pair, Unit, allowance

OF_ALL = ("motp_m", "misidentifications", "lost_tracks", "id_switches", "misses")
"""What is judged over all trackers and cases together too: places, and events too rare to tell anything of one."""


def over_scenarios(pairs: Sequence[Pair]) -> Iterator[list[Pair]]:
    """A figure of a tracker in all its scenarios, where there are several."""
    by_tracker = sorted(pairs, key=lambda pair: (pair.key.tracker, pair.metric))
    for _, found in groupby(by_tracker, key=lambda pair: (pair.key.tracker, pair.metric)):
        if len(several := list(found)) > 1:
            yield several


def over_trackers(pairs: Sequence[Pair]) -> Iterator[list[Pair]]:
    """A figure of all trackers, where there are several."""
    for metric in OF_ALL:
        found = [pair for pair in pairs if pair.metric == metric]
        if len({pair.key.tracker for pair in found}) > 1:
            yield found


def shares_of(tests: Sequence[Sequence[Pair]]) -> tuple[Array, list[float]]:
    """What each unit of chance adds to each test's statistic, (u, t), and how much the test's mean may get worse.

    A test is of one group, of a tracker's groups, or of all trackers': of several the mean over groups is judged. With d,
    what a unit got worse in units of what that is allowed, the statistic is Σ d / √(Σ d² + n): a signal over its
    noise, in which what is far less than allowed counts for nothing (the constant under the root: Tusher, Tibshirani,
    Chu, PNAS 98, 2001).
    """
    place: dict[Unit, int] = {}
    for pairs in tests:
        for pair in pairs:
            for unit in pair.units:
                place.setdefault(unit, len(place))
    shares, allowances = np.zeros((len(place), len(tests))), []
    for number, pairs in enumerate(tests):
        allowances.append(allowance(pairs))
        for pair in pairs:
            rows = [place[unit] for unit in pair.units]
            shares[rows, number] += pair.worsened / max(allowances[-1], 1e-12)
    n = np.array([sum(len(pair.seeds) for pair in pairs) for pairs in tests], dtype=float)
    return shares / np.sqrt((shares**2).sum(axis=0) + n), allowances
