"""How small a loss a suite would notice: what was tested, and with what power."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from twin.suites.evidence import fewest_for_an_alarm
from twin.suites.figures import GATED, GATED_READINGS
from twin.suites.pairs import Pair, allowance
from twin.suites.pooling import over_scenarios


@dataclass(frozen=True)
class Power:
    """The smallest loss of a figure, in its unit, that would be noticed, whichever tracker and scenario has it.

    everywhere: of one tracker in all its scenarios; in_scenario: in all seeds of one scenario; in_case: in one case alone.
    """

    metric: str
    everywhere: float
    in_scenario: float
    in_case: float


def power_of(pairs: Sequence[Pair]) -> Iterator[Power]:
    """Of each figure, the smallest loss that is noticed wherever it happens, while nothing else changes."""
    fewest = fewest_for_an_alarm()
    by_metric: Mapping[str, list[Pair]] = {
        metric: [pair for pair in pairs if pair.metric == metric] for metric in (*GATED, *GATED_READINGS)
    }
    for metric, found in by_metric.items():
        if not found:
            continue
        in_case = max(pair.allowed_in_case for pair in found)
        in_scenario = max(allowance([pair]) if len(pair.seeds) >= fewest else pair.allowed_in_case for pair in found)
        everywhere = in_scenario
        together = list(over_scenarios(found))
        if together and len({pair.key.tracker for pair in found}) == len(together):
            everywhere = max(
                allowance(pairs) if sum(len(pair.seeds) for pair in pairs) >= fewest else in_scenario
                for pairs in together
            )
        yield Power(metric, everywhere, in_scenario, in_case)
