"""How small a loss a suite would notice: what was tested, and with what power."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from twin.suites.evidence import fewest_for_an_alarm
from twin.suites.figures import GATED, GATED_READINGS
from twin.suites.pairs import Pair, allowance


@dataclass(frozen=True)
class Power:
    """The smallest loss of a figure, in its unit, that would be noticed while nothing else changes.

    of_tracker: in all scenarios of each tracker; in_scenario and in_case: in all seeds of one scenario and in one case alone,
    whichever tracker and scenario it is.
    """

    metric: str
    of_tracker: Mapping[str, float]
    in_scenario: float
    in_case: float

    @property
    def everywhere(self) -> float:
        """In all scenarios of a tracker, whichever it is."""
        return max(self.of_tracker.values())


def power_of(pairs: Sequence[Pair]) -> Iterator[Power]:
    """Of each figure, the smallest loss that is noticed."""
    by_metric: Mapping[str, list[Pair]] = {
        metric: sorted((pair for pair in pairs if pair.metric == metric), key=_tracker)
        for metric in (*GATED, *GATED_READINGS)
    }
    for metric, found in by_metric.items():
        if found:
            of_tracker = {tracker: _everywhere(list(its)) for tracker, its in groupby(found, key=_tracker)}
            yield Power(metric, of_tracker, max(map(_in_scenario, found)), max(pair.allowed_in_case for pair in found))


def _tracker(pair: Pair) -> str:
    return pair.key.tracker


def _in_scenario(pair: Pair) -> float:
    return allowance([pair]) if len(pair.seeds) >= fewest_for_an_alarm() else pair.allowed_in_case


def _everywhere(pairs: list[Pair]) -> float:
    """In all scenarios of the tracker of these pairs."""
    n_case = sum(len(pair.seeds) for pair in pairs)
    return allowance(pairs) if n_case >= fewest_for_an_alarm() else max(map(_in_scenario, pairs))
