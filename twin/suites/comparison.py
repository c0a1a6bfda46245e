"""Compare the metrics of two runs of a suite, paired by case and tested together.

The twin is deterministic: identical bits of recordings and metrics mean no change. Otherwise three questions are asked.

- Did the mean of a metric get worse by more than the allowed change? The mean of a tracker in one scenario; of a tracker over all
  its scenarios; of all trackers together, for positions and rare events; and of each scanner's own metrics. Allowed change: the
  tolerance; divided by √G for a mean over G groups. By more than chance: `twin.suites.permutation_test`.
- Did one case get much worse? By ten times the allowed change and by four standard deviations between the earlier seeds.
- Is a figure missing that was measured before?

Where the recordings differ from the baseline's, `twin.suites.permutation_test` states how runs of a seed are paired and how
far they may differ. Doubled scanner noise shows in the scanner's own metrics; it costs trackers less than one more draw.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.messages import counted
from twin.suites.metrics import GATED, Tolerance, allowed_by_default, format_metric, metric_named, worsening
from twin.suites.permutation_test import (
    ALPHA,
    Collapse,
    MinimumDetectableChange,
    Pair,
    contributions,
    family_wise_p,
    min_recordings,
    minimum_detectable_changes,
    over_scenarios,
    over_trackers,
    pair_results,
)
from twin.suites.results import (
    GroupKey,
    RequirementCheck,
    Results,
    check_requirements,
    collect_results,
)
from twin.suites.store import ResultStore

EVERY_SCENARIO, EVERY_TRACKER = "every scenario", "every tracker"
"""Names of a group's scenario and tracker where several are judged together."""
_NAMED_FIRST = ("hota", "idf1")
"""Metrics that say most of a tracker; the others tell in what it changed."""


@dataclass(frozen=True)
class Change:
    """Change of a metric of one group, or of several pooled: means over the seeds that both runs have.

    A group is of a tracker in a scenario, or of a scanner, which the key then names in the tracker's place.

    p: probability that chance worsens any metric of the suite as much; p_better: the same for improvements. allowed:
    tolerated worsening of the mean. worst_seed: seed of the largest worsening (None: over several groups, or missing).
    collapse: of one case, beyond any noise.
    """

    key: GroupKey
    variant: str
    metric: str
    before: float
    now: float | None
    p: float
    p_better: float
    n_seed: int
    allowed: float
    worst_seed: int | None = None
    collapse: Collapse | None = None

    @property
    def change(self) -> float:
        """Now − before; NaN where the metric is no longer measured."""
        return float("nan") if self.now is None else self.now - self.before

    @property
    def excess(self) -> float:
        """Ratio of the change to its tolerance; inf where the metric is no longer measured."""
        return float("inf") if self.now is None else abs(self.change) / max(self.allowed, 1e-12)

    @property
    def worse(self) -> bool:
        """True where the mean got worse beyond tolerance and chance, one case collapsed, or the metric is no longer measured."""
        if self.now is None or self.collapse is not None:
            return True
        return self.p <= ALPHA and worsening(self.metric, self.change) > self.allowed

    @property
    def better(self) -> bool:
        """True where the mean got better beyond tolerance and chance."""
        return self.now is not None and self.p_better <= ALPHA and -worsening(self.metric, self.change) > self.allowed


@dataclass(frozen=True)
class Comparison:
    """All changes, by group and metric, with notes on the comparison."""

    changes: tuple[Change, ...]
    warnings: tuple[str, ...]
    detectable: tuple[MinimumDetectableChange, ...] = ()
    identical: bool = False  # recordings and metrics are identical to the bit

    @property
    def worse(self) -> list[Change]:
        """Changes for the worse, tracker by tracker, the one that changed most first; HOTA and IDF1 first of each."""
        return _ordered([each for each in self.changes if each.worse])

    @property
    def better(self) -> list[Change]:
        """Changes for the better, in the same order."""
        return _ordered([each for each in self.changes if each.better])


def compare(
    before: Results, now: Results, allowed: Callable[[str, float], float], before_name: str = "the baseline"
) -> Comparison:
    """Compare every metric of `now` with `before`; `allowed(metric, before)`: tolerated worsening in the metric's unit."""
    pairs = list(pair_results(before, now, allowed))
    tests = [[pair] for pair in pairs] + [*over_scenarios(pairs), *over_trackers(pairs)]
    shares, allowances = contributions(tests)
    p, p_better = family_wise_p(shares), family_wise_p(-shares)
    changes = [_change(*each) for each in zip(tests, p, p_better, allowances, strict=True)]
    missing = list(_missing_groups(before, now))
    identical = (
        bool(pairs)
        and not missing
        and all(each.relation == "same bits" and (each.before == each.now).all() for each in pairs)
    )
    warnings = tuple(notes_on(before, now, before_name, pairs))
    return Comparison((*missing, *changes), warnings, tuple(minimum_detectable_changes(pairs)), identical)


def _change(pairs: Sequence[Pair], p: float, p_better: float, allowed: float) -> Change:
    first, is_single = pairs[0], len(pairs) == 1
    trackers = {pair.key.tracker for pair in pairs}
    pooled = GroupKey(EVERY_SCENARIO, "[]", first.key.tracker if len(trackers) == 1 else EVERY_TRACKER)
    return Change(
        key=first.key if is_single else pooled,
        variant=first.group.variant if is_single else "",
        metric=first.metric,
        before=float(np.mean([pair.before.mean() for pair in pairs])),
        now=float(np.mean([pair.now.mean() for pair in pairs])),
        p=float(p),
        p_better=float(p_better),
        n_seed=sum(len(pair.seeds) for pair in pairs),
        allowed=allowed,
        worst_seed=first.seeds[int(np.argmax(first.worsened))] if is_single else None,
        collapse=first.collapse if is_single else None,
    )


def _missing_groups(before: Results, now: Results) -> Iterator[Change]:
    """Yield metrics that applied to a group before and now apply to none of its seeds, though it was run."""
    for key, was in before.groups.items():
        group = now.groups.get(key)
        if group is None or not set(was.seeds) & set(group.seeds):
            continue
        for metric in GATED:
            values = was.values(metric)
            if values and not group.values(metric):
                yield Change(key, group.variant, metric, float(np.mean(values)), None, 0.0, 1.0, len(values), 0.0)


def _ordered(changes: Sequence[Change]) -> list[Change]:
    """Order changes by tracker, then by the metric's weight, then by decreasing ratio to the tolerance."""
    most: dict[str, float] = {}
    for each in changes:
        most[each.key.tracker] = max(most.get(each.key.tracker, 0.0), each.excess)
    weight = {metric: place for place, metric in enumerate(_NAMED_FIRST)}
    return sorted(
        changes,
        key=lambda each: (
            -most[each.key.tracker],
            each.key.tracker,
            weight.get(each.metric, len(weight)),
            -each.excess,
        ),
    )


def notes_on(before: Results, now: Results, before_name: str, pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield notes on the comparison, one sentence each."""
    if before.suite != now.suite:
        yield f"{before_name} is of the suite {before.suite}, this one is {now.suite}"
    unrelated = [pair.key for pair in pairs if pair.relation == "unrelated"]
    if unrelated and not any(group.people for group in before.groups.values()):
        yield (
            f"{before_name} does not say on which ways its people went, as one written before that was kept: written anew, "
            "it lets seeds be pairs where sensors alone report otherwise"
        )
    if unrelated:
        yield (
            f"the recordings of {_names(unrelated)} are not those of {before_name}: another scenario, or other code that moves "
            "people; seeds are then two populations and no pairs"
        )
    related = [pair.key for pair in pairs if pair.relation == "same people"]
    if related:
        yield (
            f"the recordings of {_names(related)} show the people of {before_name} on the same ways, but the sensors report "
            "otherwise: other noise, other sensors or other code; seeds are pairs of which each has a draw of the noise"
        )
    if any(pair.relation == "same origin" for pair in pairs):
        yield (
            f"recordings have other bits than those of {before_name} though they are made from the same, as on another processor "
            "or renderer; seeds are pairs all the same"
        )
    if before.renderers and now.renderers and set(before.renderers) != set(now.renderers):
        yield f"{before_name} was drawn by {' and '.join(before.renderers)}, here it is {' and '.join(now.renderers)}"
    old, new = before.versions.get("mujoco"), now.versions.get("mujoco")
    if old != new:
        yield f"{before_name} was made with MuJoCo {old}, here it is {new}: contacts and pictures may differ"
    compared = {pair.key: len(pair.seeds) >= min_recordings() for pair in pairs}
    few = [key for key, is_enough in compared.items() if not is_enough]
    if few:
        where = "every scenario" if len(few) == len(compared) else _names(few)
        yield (
            f"fewer than {min_recordings()} seeds are in common in {where}; there only a case that worsens beyond any noise "
            f"raises an alarm; small changes of a mean show from {min_recordings()} seeds on"
        )
    missing = [key for key in before.groups if key not in now.groups]
    added = [key for key in now.groups if key not in before.groups]
    if missing:
        yield f"{before_name} has what this run has not: {_names(missing)}"
    if added:
        yield f"not in {before_name}: {_names(added)}"


def _names(keys: Sequence[GroupKey], most: int = 4) -> str:
    names = list(dict.fromkeys(f"{key.scenario} with {key.tracker}" for key in keys))
    return ", ".join(names[:most]) + (
        f" and {counted(len(names) - most, 'more scenario')} with a tracker or scanner" if len(names) > most else ""
    )


@dataclass(frozen=True)
class SuiteOutcome:
    """Results of a run in `folder`, compared with those `before`, if any; and the checks of its requirements."""

    folder: Path
    store: ResultStore
    results: Results
    before: Results | None
    comparison: Comparison | None
    requirements: Sequence[RequirementCheck]

    @classmethod
    def of(cls, folder: Path, store: ResultStore, before: Results | None = None) -> SuiteOutcome:
        """Collect the results so far, compare them, and check the requirements."""
        facts, results = store.facts(), collect_results(store)
        comparison = None if before is None else compare(before, results, tolerances_of(facts))
        return cls(folder, store, results, before, comparison, check_requirements(facts, results))

    @property
    def violated(self) -> list[RequirementCheck]:
        """Requirements that are not met."""
        return [each for each in self.requirements if each.violated]


def tolerances_of(facts: Mapping[str, Any]) -> Callable[[str, float], float]:
    """Return the function that computes tolerances, from the suite's facts."""
    own = {name: Tolerance(**content) for name, content in facts.get("tolerances", {}).items()}

    def allowed(metric: str, baseline: float) -> float:
        return own[metric].allowed(baseline) if metric in own else allowed_by_default(metric, baseline)

    return allowed


_KIND_OF = {"misidentifications": "misidentification", "lost_tracks": "lost", "id_switches": "switch"}
"""Metrics that count events; for all others the worst second is shown."""


@dataclass(frozen=True)
class IncidentLink:
    """Page of a case and time to look at [s]; `what` happened there."""

    page: Path
    t_s: float
    what: str

    def text(self) -> str:
        """Format page and time on one line."""
        return f"{self.page} at {self.t_s:.1f} s ({self.what})"


def incident_link(change: Change, results: Results, store: ResultStore, folder: Path) -> IncidentLink | None:
    """Find the incident behind a change, in the seed with the largest worsening; None if the run lacks that case."""
    group = results.groups.get(change.key)
    case_id = group.cases.get(change.worst_seed) if group is not None and change.worst_seed is not None else None
    if case_id is None:
        return None
    incidents = store.incidents(case_id)
    kind = _KIND_OF.get(change.metric)
    chosen = next((each for each in incidents if each.kind == kind), incidents[0] if incidents else None)
    if chosen is None:
        return None
    return IncidentLink(case_page(folder, case_id), chosen.t_s, chosen.what)


def case_page(folder: Path, case_id: str) -> Path:
    """Return the report of a case of the run in `folder`; in a suite without reports the case's folder."""
    case = folder / "cases" / case_id
    return report if (report := case / "report.html").is_file() else case


def describe_change(change: Change) -> str:
    """Describe a change: "MOTP 0.067 m → 0.091 m (+0.024 m, allowed 0.004 m)"."""
    name = metric_named(change.metric).name
    was = format_metric(change.metric, change.before)
    if change.now is None:
        return f"{name} {was} → no longer measured"
    now, by = format_metric(change.metric, change.now), format_metric(change.metric, change.change, sign=True)
    return (
        f"{name} {was} → {now} ({by}, allowed {format_metric(change.metric, change.allowed)}, {significance(change)})"
    )


def significance(change: Change) -> str:
    """Describe the significance of a change: its p, and a case that collapsed."""
    if change.now is None:
        return "missing"
    p, parts = min(change.p, change.p_better), []
    if (case := change.collapse) is not None:
        by, allowed = (format_metric(change.metric, each).split()[0] for each in (case.by, case.allowed))
        parts = [f"seed {case.seed} worse by {by} (allowed in one case: {allowed})"]
    chance = f"p {p:.3f}" if p >= 0.0005 else "p < 0.001"
    return ", ".join([*parts, *([chance] if p <= ALPHA or not parts else [])])
