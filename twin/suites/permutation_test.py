"""Permutation test over all metrics of a suite at once: family-wise p, and minimum detectable changes.

If a change does not matter, before and now could be swapped in any recording: that turns the signs of all its differences, of
all trackers and figures together. (In any unit of chance: recordings of the same people before the same noise are one.) So
every test's statistic is worked out for all ways to give the units signs, or for drawn ones where they are too many, and a
test's p is the share of them in which the largest statistic of any test is at least its own (the single-step max-T of Westfall
and Young, Resampling-Based Multiple Testing, 1993). That keeps the chance of any false alarm, however trackers, figures and
tests depend on each other, and costs no power where they do.

What the statistics are is the caller's choice; they are to have one scale, or the noisiest hides the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from trackers.arrays import Array
from twin.streams import stream
from twin.suites.metrics import GATED, GATED_SENSOR_METRICS
from twin.suites.pairing import Pair, Unit, allowed_change

ALPHA = 0.05
"""The chance of a false alarm anywhere in a suite."""

_MOST_EXACT = 12
"""Up to so many changed units all signs are tried: 4096 ways."""

_MOST_AT_ONCE = 5_000_000
"""Statistics held at once."""

_ROUNDING = 1e-9


def family_wise_p(shares: Array) -> Array:
    """Compute the family-wise p of each of t one-sided tests (t,), by sign flips and the maximum statistic.

    shares (u, t): what each of u units of chance adds to each statistic, positive for the worse, 0 where it takes no part.
    """
    changed = shares[(shares != 0).any(axis=1)]
    if not len(changed):
        return np.ones(shares.shape[1])
    signs = _signs(len(changed))
    largest = np.empty(len(signs))
    step = max(1, _MOST_AT_ONCE // max(1, shares.shape[1]))
    for first in range(0, len(signs), step):
        largest[first : first + step] = (signs[first : first + step] @ changed).max(axis=1)
    statistic = changed.sum(axis=0)
    as_large = np.searchsorted(np.sort(largest), statistic - _ROUNDING * np.abs(statistic).max())
    return 1 - as_large / len(signs)


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
"""Metrics tested over all trackers and cases together too: positions, and events too rare for a single tracker."""


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
        allowances.append(allowed_change(pairs))
        for pair in pairs:
            rows = [place[unit] for unit in pair.units]
            shares[rows, number] += pair.worsened / max(allowances[-1], 1e-12)
    n = np.array([sum(len(pair.seeds) for pair in pairs) for pairs in tests], dtype=float)
    return shares / np.sqrt((shares**2).sum(axis=0) + n), allowances


@dataclass(frozen=True)
class MinimumDetectableChange:
    """Smallest loss of a metric, in its unit, that the comparison detects while nothing else changes.

    of_tracker: in all scenarios of each tracker; in_scenario and in_case: in all seeds of one scenario and in one case alone,
    whichever tracker and scenario it is.
    """

    metric: str
    of_tracker: Mapping[str, float]
    in_scenario: float
    in_case: float

    @property
    def everywhere(self) -> float:
        """Loss in all scenarios of a tracker, for the least sensitive tracker."""
        return max(self.of_tracker.values())


def minimum_detectable_changes(pairs: Sequence[Pair]) -> Iterator[MinimumDetectableChange]:
    """Yield the minimum detectable change of each metric."""
    by_metric: Mapping[str, list[Pair]] = {
        metric: sorted((pair for pair in pairs if pair.metric == metric), key=_tracker)
        for metric in (*GATED, *GATED_SENSOR_METRICS)
    }
    for metric, found in by_metric.items():
        if found:
            of_tracker = {tracker: _everywhere(list(its)) for tracker, its in groupby(found, key=_tracker)}
            yield MinimumDetectableChange(
                metric, of_tracker, max(map(_in_scenario, found)), max(pair.allowed_in_case for pair in found)
            )


def _tracker(pair: Pair) -> str:
    return pair.key.tracker


def _in_scenario(pair: Pair) -> float:
    return allowed_change([pair]) if len(pair.seeds) >= min_recordings() else pair.allowed_in_case


def _everywhere(pairs: list[Pair]) -> float:
    """In all scenarios of the tracker of these pairs."""
    n_case = sum(len(pair.seeds) for pair in pairs)
    return allowed_change(pairs) if n_case >= min_recordings() else max(map(_in_scenario, pairs))
