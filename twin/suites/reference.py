"""A suite's trackers against a reference tracker: differences paired by case, per stratum, and the cases with the largest
losses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from twin.suites.metrics import METRICS
from twin.suites.results import Group, GroupKey, MeanOverSeeds, Results, mean_over_seeds

BEHIND_HOTA = 0.01
"""A case counts as behind the reference when its HOTA is lower by more than this."""

N_WORST = 10

REFERENCE_METRICS = (
    "mota",
    "idf1",
    "hota",
    "motp_m",
    "id_switches",
    "misidentifications",
    "lost_tracks",
    "false_positives",
)


@dataclass(frozen=True)
class ReferenceDifference:
    """Mean differences between a tracker and the reference, over cases that both completed.

    behind: share of the cases whose HOTA is more than `BEHIND_HOTA` below the reference's; None without HOTA.
    """

    tracker: str
    n_case: int
    differences: Mapping[str, MeanOverSeeds | None]  # by metric
    behind: float | None

    def verdict(self, metric: str) -> str:
        """Return 'better' or 'worse' where the 95 % interval excludes 0, else ''."""
        found = self.differences[metric]
        if found is None or found.low is None or found.high is None or found.low <= 0 <= found.high:
            return ""
        return "better" if (found.mean > 0) == (METRICS[metric].better == "more") else "worse"


@dataclass(frozen=True)
class PairedCase:
    """A case of a tracker and the same case of the reference."""

    key: GroupKey
    variant: str
    seed: int
    case_id: str | None
    metrics: Mapping[str, float | None]
    reference: Mapping[str, float | None]

    def difference(self, metric: str) -> float | None:
        """Subtract the reference's metric; None where either lacks it."""
        own, other = self.metrics.get(metric), self.reference.get(metric)
        return None if own is None or other is None else own - other


def differences_from(results: Results, reference: str) -> list[ReferenceDifference]:
    """Compare every other tracker with `reference`, over all scenarios, paired by scenario, variant and seed."""
    cases = list(_paired(results.groups, reference))
    return [_difference(tracker, cases) for tracker in _others(results, reference)]


def differences_by_scenario(results: Results, reference: str) -> dict[tuple[str, str], list[ReferenceDifference]]:
    """Compare every other tracker with `reference` within each scenario and variant: the strata of a suite."""
    strata: dict[tuple[str, str], list[PairedCase]] = {}
    for case in _paired(results.groups, reference):
        strata.setdefault((case.key.scenario, case.variant), []).append(case)
    others = _others(results, reference)
    return {
        place: [row for row in (_difference(tracker, cases) for tracker in others) if row.n_case]
        for place, cases in strata.items()
    }


def worst_cases(results: Results, reference: str, n: int = N_WORST) -> list[PairedCase]:
    """Return the n cases whose HOTA is furthest below the reference's, the worst first; only cases that are below."""
    lost = [(case.difference("hota"), case) for case in _paired(results.groups, reference)]
    behind = [(change, case) for change, case in lost if change is not None and change < 0]
    return [case for _, case in sorted(behind, key=lambda each: each[0])[:n]]


def _others(results: Results, reference: str) -> list[str]:
    return list(dict.fromkeys(key.tracker for key in results.groups if key.tracker != reference))


def _paired(groups: Mapping[GroupKey, Group], reference: str) -> Iterator[PairedCase]:
    for key, group in groups.items():
        own = groups.get(GroupKey(key.scenario, key.overrides, reference))
        if key.tracker == reference or own is None:
            continue
        for seed, metrics in group.seeds.items():
            if seed in own.seeds:
                yield PairedCase(key, group.variant, seed, group.cases.get(seed), metrics, own.seeds[seed])


def _difference(tracker: str, cases: list[PairedCase]) -> ReferenceDifference:
    mine = [case for case in cases if case.key.tracker == tracker]
    found = {
        metric: [change for case in mine if (change := case.difference(metric)) is not None]
        for metric in REFERENCE_METRICS
    }
    hota = found["hota"]
    behind = sum(change < -BEHIND_HOTA for change in hota) / len(hota) if hota else None
    differences = {metric: mean_over_seeds(changes) for metric, changes in found.items()}
    return ReferenceDifference(tracker, len(mine), differences, behind)
