"""Trackers beside one of them, paired by case: what an ablation's rows, or a baseline, are worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.suites.figures import FIGURE
from twin.suites.results import GroupKey, MeanOverSeeds, Results, mean_over_seeds

COMPARED = ("mota", "idf1", "hota", "motp_m", "id_switches", "misidentifications", "lost_tracks", "false_positives")


@dataclass(frozen=True)
class Beside:
    """A tracker beside the one that a suite names: mean differences, this less that, over cases that both have done."""

    tracker: str
    n_case: int
    differences: Mapping[str, MeanOverSeeds | None]  # by figure

    def verdict(self, metric: str) -> str:
        """'better' or 'worse' where the 95 % interval leaves out 0, else ''."""
        found = self.differences[metric]
        if found is None or found.low is None or found.high is None or found.low <= 0 <= found.high:
            return ""
        return "better" if (found.mean > 0) == (FIGURE[metric].better == "more") else "worse"


def beside(results: Results, reference: str) -> list[Beside]:
    """Every other tracker beside `reference`, over all scenarios together, paired by scenario, variant and seed."""
    others = dict.fromkeys(key.tracker for key in results.groups if key.tracker != reference)
    return [_beside(results, reference, tracker) for tracker in others]


def _beside(results: Results, reference: str, tracker: str) -> Beside:
    pairs = []
    for key, group in results.groups.items():
        own = results.groups.get(GroupKey(key.scenario, key.overrides, reference))
        if key.tracker == tracker and own is not None:
            pairs += [(figures, own.seeds[seed]) for seed, figures in group.seeds.items() if seed in own.seeds]
    differences = {}
    for metric in COMPARED:
        values = [(one.get(metric), other.get(metric)) for one, other in pairs]
        differences[metric] = mean_over_seeds([a - b for a, b in values if a is not None and b is not None])
    return Beside(tracker, len(pairs), differences)
