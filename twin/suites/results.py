"""Results of a suite as compared and shown: one group per scenario, variant and tracker, with its seeds.

Trackers are compared with a reference tracker by differences paired by case, per stratum, with the cases of largest loss.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trackers.errors import InputError
from twin.messages import counted
from twin.report.metrics_table import frames_note
from twin.suites.metrics import METRICS, PERSON_FRAMES, MeanOverSeeds, format_metric, holds, mean_over_seeds, rate
from twin.suites.store import DONE, EXPECTED, FAILED, RecordingInfo, ResultStore, StoredCase
from twin.suites.worker import NO_RENDERER


@dataclass(frozen=True)
class GroupKey:
    """Key of a group: a scenario with its overrides (JSON), and a tracker (or a scanner, by its position)."""

    scenario: str
    overrides: str
    tracker: str


@dataclass(frozen=True)
class Group:
    """Metrics of each seed, by name; None where a metric does not apply.

    All by seed, if known: cases: ids; recordings: digests of the recordings; recipes: digests of scenario, seed and code,
    since other processors and renderers make other bits; people: digests of the people's motion, independent of sensors;
    rooms: digests of the room.
    """

    variant: str
    seeds: Mapping[int, Mapping[str, float | None]]
    cases: Mapping[int, str] = field(default_factory=dict)
    recordings: Mapping[int, str] = field(default_factory=dict)
    recipes: Mapping[int, str] = field(default_factory=dict)
    people: Mapping[int, str] = field(default_factory=dict)
    rooms: Mapping[int, str] = field(default_factory=dict)

    def values(self, metric: str) -> list[float]:
        """List the metric of each seed that has it."""
        values = (figures.get(metric) for figures in self.seeds.values())
        return [value for value in values if value is not None]

    @property
    def n(self) -> str:
        """Person-frames of all seeds as text, with the share of frames evaluated if below 1."""
        counts, shares = self.values(PERSON_FRAMES), self.values("judged.share")
        if len(counts) < len(self.seeds) or not counts:
            return "–"  # run of an older version
        share = min(shares, default=1.0)
        return f"{sum(counts):.0f}" + (f" ({share:.1%} of the frames or more)" if share < 1 else "")


@dataclass(frozen=True)
class Results:
    """Results of a run or a baseline.

    renderers: of all recordings with images; tracker_warnings, scenario_warnings: cases by warning; sensors: range noise, one
    group per scenario, variant and scanner, whose key names it in the tracker's place.
    """

    suite: str
    versions: Mapping[str, str | None]
    renderers: tuple[str, ...]
    groups: Mapping[GroupKey, Group]
    failed: tuple[StoredCase, ...] = ()
    unfinished: int = 0
    tracker_warnings: Mapping[str, int] = field(default_factory=dict)
    scenario_warnings: Mapping[str, int] = field(default_factory=dict)
    sensors: Mapping[GroupKey, Group] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """The word for what its groups are of: scenario, recording, or both."""
        bags = {bool(group.values("track_count")) for group in self.groups.values()}
        return " or ".join(["scenario"] * (bags != {True}) + ["recording"] * (True in bags))


def collect_results(store: ResultStore) -> Results:
    """Collect the results of a run so far. Raises InputError for a finished case without results."""
    facts, cases, metrics, recorded = store.facts(), store.cases(), store.metrics(), store.recorded()
    recipes: Mapping[str, str] = facts.get("recipes", {})
    groups: dict[GroupKey, list[_Figures]] = {}
    sensors: dict[GroupKey, list[_Figures]] = {}
    for case in cases:
        if case.status != DONE:
            continue
        if case.id not in metrics:
            raise InputError(
                f"{store.path}: results: of {case.id}, which is done, there are none; {EXPECTED} is expected"
            )
        groups.setdefault(GroupKey(case.scenario, case.overrides, case.tracker), []).append((case, metrics[case.id]))
        for scanner, scatter_m in recorded.get(case.id, RecordingInfo()).scatter_m.items():
            key = GroupKey(case.scenario, case.overrides, scanner)
            sensors.setdefault(key, []).append((case, {"range_scatter_m": scatter_m}))
    return Results(
        suite=facts["suite"],
        versions=facts["versions"],
        tracker_warnings=facts.get("tracker_warnings", {}),
        scenario_warnings=facts.get("scenario_warnings", {}),
        renderers=tuple(name for name in facts.get("renderers", ()) if name != NO_RENDERER),
        groups={key: _group(found, recorded, recipes) for key, found in groups.items()},
        failed=tuple(case for case in cases if case.status == FAILED),
        unfinished=sum(case.status not in (DONE, FAILED) for case in cases),
        sensors={key: _group(found, recorded, recipes) for key, found in sensors.items()},
    )


def pooled(runs: Sequence[tuple[str, Results]]) -> Results:
    """Pool the cases of several runs, given with the names of their folders. Raises InputError for a case that two have."""
    groups: dict[GroupKey, Group] = {}
    for name, results in runs:
        for key, group in results.groups.items():
            known = groups.setdefault(key, Group(group.variant, {}))
            if twice := sorted(set(known.seeds) & set(group.seeds)):
                raise InputError(
                    f"{name}: {key.scenario}, seed {twice[0]}, {key.tracker} is in another folder too; runs of other seeds or "
                    "scenarios are expected"
                )
            groups[key] = replace(known, seeds={**known.seeds, **group.seeds}, rooms={**known.rooms, **group.rooms})
    return Results(
        suite=", ".join(dict.fromkeys(results.suite for _, results in runs)),
        versions=runs[0][1].versions,
        renderers=(),
        groups=groups,
        failed=tuple(case for _, results in runs for case in results.failed),
        unfinished=sum(results.unfinished for _, results in runs),
    )


_Figures = tuple[StoredCase, Mapping[str, float | None]]


def _group(found: Sequence[_Figures], recorded: Mapping[str, RecordingInfo], recipes: Mapping[str, str]) -> Group:
    known = {case.seed: recorded.get(case.id, RecordingInfo()) for case, _ in found}
    return Group(
        found[0][0].variant,
        {case.seed: figures for case, figures in found},
        {case.seed: case.id for case, _ in found},
        recordings={seed: each.digest for seed, each in known.items() if each.digest},
        recipes={case.seed: recipes[case.id] for case, _ in found if case.id in recipes},
        people={seed: each.people for seed, each in known.items() if each.people},
        rooms={case.seed: case.room for case, _ in found if case.room},
    )


@dataclass(frozen=True)
class RequirementCheck:
    """Check of a requirement: the mean over the seeds of a scenario; None where the tracker lacks the metric."""

    key: GroupKey
    variant: str
    metric: str
    bound: str
    mean: float | None

    @property
    def violated(self) -> bool:
        """True where the requirement is not met."""
        return self.mean is None or not holds(self.mean, self.bound)

    @property
    def measured(self) -> str:
        """The mean as text."""
        return "not measured" if self.mean is None else format_metric(self.metric, self.mean)

    def sentence(self) -> str:
        """Format the check: "MOTA is 0.912, required >= 0.97"."""
        return f"{METRICS[self.metric].name} is {self.measured}, required {self.bound}"


def check_requirements(facts: Mapping[str, Any], results: Results) -> list[RequirementCheck]:
    """Check the requirements among the facts of a run, for the groups that have been run."""
    checks = []
    for each in facts.get("requirements", ()):
        key = GroupKey(each["scenario"], each["overrides"], each["tracker"])
        group = results.groups.get(key)
        if group is not None:
            values = group.values(each["metric"])
            mean = float(np.mean(values)) if values else None
            checks.append(RequirementCheck(key, group.variant, each["metric"], each["bound"], mean))
    return checks


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
    room: Hashable
    """Digest of the room, or the scenario where it is unknown."""
    case_id: str | None
    metrics: Mapping[str, float | None]
    reference: Mapping[str, float | None]

    def difference(self, metric: str) -> float | None:
        """Subtract the reference's metric, of counts over frames their rates; None where either lacks it."""
        own, other = rate(metric, self.metrics), rate(metric, self.reference)
        return None if own is None or other is None else own - other


def note_on_frames(results: Results) -> str | None:
    """Say where trackers are evaluated in different person-frames, over the seeds that all have; None where nowhere."""
    scenarios: dict[tuple[str, str], dict[str, Group]] = {}
    for key, group in results.groups.items():
        scenarios.setdefault((key.scenario, key.overrides), {})[key.tracker] = group
    differ = []
    for (scenario, _), by_tracker in scenarios.items():
        shared = set.intersection(*(set(group.seeds) for group in by_tracker.values()))
        counts = {
            tracker: count
            for tracker, group in by_tracker.items()
            if (count := sum(group.seeds[seed].get(PERSON_FRAMES) or 0.0 for seed in shared))
        }
        if frames_note(counts):
            differ.append((min(counts.values()) / max(counts.values()), scenario, counts))
    if not differ:
        return None
    _, scenario, counts = min(differ, key=lambda each: each[0])
    more = f", as in {counted(len(differ) - 1, 'more scenario')}" if len(differ) > 1 else ""
    return frames_note(counts, scenario + more)


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


def worst_cases(results: Results, reference: str) -> list[PairedCase]:
    """Return the `N_WORST` cases whose HOTA is furthest below the reference's, the worst first; only cases that are below."""
    lost = [(case.difference("hota"), case) for case in _paired(results.groups, reference)]
    behind = [(change, case) for change, case in lost if change is not None and change < 0]
    return [case for _, case in sorted(behind, key=lambda each: each[0])[:N_WORST]]


def _others(results: Results, reference: str) -> list[str]:
    return list(dict.fromkeys(key.tracker for key in results.groups if key.tracker != reference))


def room_of(key: GroupKey, group: Group, seed: int) -> Hashable:
    """Return what a case's room is known by: its digest, else the scenario with its overrides."""
    return group.rooms.get(seed) or (key.scenario, key.overrides)


def _paired(groups: Mapping[GroupKey, Group], reference: str) -> Iterator[PairedCase]:
    for key, group in groups.items():
        own = groups.get(GroupKey(key.scenario, key.overrides, reference))
        if key.tracker == reference or own is None:
            continue
        for seed, metrics in group.seeds.items():
            if seed in own.seeds:
                room = room_of(key, group, seed)
                yield PairedCase(key, group.variant, seed, room, group.cases.get(seed), metrics, own.seeds[seed])


def _difference(tracker: str, cases: list[PairedCase]) -> ReferenceDifference:
    mine = [case for case in cases if case.key.tracker == tracker]
    found = {
        metric: {(case.key, case.seed): change for case in mine if (change := case.difference(metric)) is not None}
        for metric in REFERENCE_METRICS
    }
    place = {(case.key, case.seed): (case.room, case.seed) for case in mine}
    hota = found["hota"].values()
    behind = sum(change < -BEHIND_HOTA for change in hota) / len(hota) if hota else None
    differences = {
        metric: mean_over_seeds(list(changes.values()), [place[case] for case in changes])
        for metric, changes in found.items()
    }
    return ReferenceDifference(tracker, len(mine), differences, behind)
