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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.messages import counted, short_path
from twin.suites.metrics import (
    GATED,
    GATED_SENSOR_METRICS,
    PERSON_FRAMES,
    tolerances_of,
    worsening,
)
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
_NAMED_FIRST = ("hota", "mota", "idf1")
"""Metrics that say most of a tracker; the others tell in what it changed."""


@dataclass(frozen=True)
class Change:
    """Change of a metric of one group, or of several pooled: means over the seeds that both runs have.

    A group is of a tracker in a scenario, or of a scanner, which the key then names in the tracker's place.

    p: probability that chance worsens any metric of the suite as much, but those that did more; p_better: the same for
    improvements. allowed: tolerated worsening of the mean. worst_seed: seed of the largest worsening (None: missing), of several
    groups in `worst_of`. collapse: of one case, beyond any noise.
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
    worst_of: GroupKey | None = None
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
        """Changes for the worse: all scenarios together, then each; tracker by tracker, HOTA, MOTA and IDF1 first of each."""
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
    first, is_single, worst = pairs[0], len(pairs) == 1, max(pairs, key=lambda pair: pair.worsened.max())
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
        worst_seed=worst.seeds[int(np.argmax(worst.worsened))],
        worst_of=None if is_single else worst.key,
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
    """Order changes by scenario, those over every one first, then by tracker, then by the metric's weight.

    A change of every tracker together is left out where one tracker's of that metric, over every scenario, is among them: it
    is for events too rare for a single tracker, and would mix that one with trackers that did not change.
    """
    pooled = {(each.metric, each.key.tracker) for each in changes if each.key.scenario == EVERY_SCENARIO}
    single = {metric for metric, tracker in pooled if tracker != EVERY_TRACKER}
    scenarios = {
        key: place for place, key in enumerate(dict.fromkeys((c.key.scenario, c.key.overrides) for c in changes))
    }
    trackers = {name: place for place, name in enumerate(dict.fromkeys(each.key.tracker for each in changes))}
    weight = {
        metric: place for place, metric in enumerate(dict.fromkeys((*_NAMED_FIRST, *GATED, *GATED_SENSOR_METRICS)))
    }
    return sorted(
        [each for each in changes if each.key.tracker != EVERY_TRACKER or each.metric not in single],
        key=lambda each: (
            each.key.scenario != EVERY_SCENARIO,
            scenarios[each.key.scenario, each.key.overrides],
            each.key.tracker == EVERY_TRACKER,
            trackers[each.key.tracker],
            weight[each.metric],
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
    # a drawn rig has its scanners elsewhere in each seed: the scenario's trackers say how many seeds are in common
    compared = {pair.key: len(pair.seeds) >= min_recordings() for pair in pairs if pair.key in now.groups}
    few = [key for key, is_enough in compared.items() if not is_enough]
    if few:
        where = "every scenario" if len(few) == len(compared) else _names(few)
        yield (
            f"fewer than {min_recordings()} seeds are in common in {where}; there only a case that worsens beyond any noise "
            f"raises an alarm; small changes of a mean show from {min_recordings()} seeds on"
        )
    if other_frames := _other_frames(before, now, before_name):
        yield other_frames
    missing = [key for key in before.groups if key not in now.groups]
    added = [key for key in now.groups if key not in before.groups]
    if missing:
        yield f"{before_name} has what this run has not: {_names(missing)}"
    if added:
        yield f"not in {before_name}: {_names(added)}"


def _other_frames(before: Results, now: Results, before_name: str) -> str | None:
    """Say where a tracker is evaluated in another number of person-frames than before; None where nowhere, or not known."""
    differ = []
    for key, group in now.groups.items():
        was = before.groups[key].seeds if key in before.groups else {}
        counts = [
            (old, new)
            for seed, figures in group.seeds.items()
            if (old := was.get(seed, {}).get(PERSON_FRAMES)) and (new := figures.get(PERSON_FRAMES))
        ]
        old, new = (sum(each) for each in zip(*counts, strict=True)) if counts else (0, 0)
        if old != new:
            differ.append(
                (abs(np.log(new / old)), f"{key.scenario} with {key.tracker} {new:.0f}, in {before_name} {old:.0f}")
            )
    if not differ:
        return None
    most = max(differ, key=lambda each: each[0])[1]
    more = f" (and {counted(len(differ) - 1, 'more group')})" if len(differ) > 1 else ""
    return (
        f"person-frames differ: {most}{more}; misses and false positives are compared per person-frame, stated for "
        f"as many as {before_name} has"
    )


def _names(keys: Sequence[GroupKey], most: int = 4) -> str:
    names = list(dict.fromkeys(f"{key.scenario} with {key.tracker}" for key in keys))
    return ", ".join(names[:most]) + (
        f" and {counted(len(names) - most, 'more scenario')} with a tracker or scanner" if len(names) > most else ""
    )


def verdict_line(
    baseline: str, comparison: Comparison | None, passed: bool, more: Sequence[str] = (), wrote: str = ""
) -> str:
    """Format a verdict on one line, with `more` after the number of metrics that got worse; wrote: a new baseline, if any."""
    against, parts = "" if wrote else " without a baseline", [*more, *([f"wrote {wrote}"] if wrote else [])]
    if comparison is not None:
        n = f"{len(comparison.worse)} of {len(comparison.changes)} metrics got worse"
        against, parts = f" against {baseline}", [n, *parts]
    return f"{'passed' if passed else 'FAILED'}{against}: {'; '.join(parts)}"


@dataclass(frozen=True)
class SuiteOutcome:
    """Results of a run in `folder`, compared with those `before`, if any; and the checks of its requirements.

    baseline: the file that holds those before, as a reader knows it.
    """

    folder: Path
    store: ResultStore
    results: Results
    before: Results | None
    comparison: Comparison | None
    requirements: Sequence[RequirementCheck]
    baseline: str = "the baseline"

    @classmethod
    def of(
        cls, folder: Path, store: ResultStore, before: Results | None = None, baseline: Path | None = None
    ) -> SuiteOutcome:
        """Collect the results so far, compare them, and check the requirements."""
        facts, results = store.facts(), collect_results(store)
        comparison = None if before is None else compare(before, results, tolerances_of(facts))
        name = baseline or facts.get("baseline") or cls.baseline
        return cls(folder, store, results, before, comparison, check_requirements(facts, results), short_path(name))

    @property
    def violated(self) -> list[RequirementCheck]:
        """Requirements that are not met."""
        return [each for each in self.requirements if each.violated]

    @property
    def passed(self) -> bool:
        """True where no case failed, every requirement is met and no metric is worse than in the baseline."""
        worse = self.comparison is not None and self.comparison.worse
        return not (self.results.failed or self.violated or worse)

    def verdict(self, wrote: str = "") -> str:
        """Format the verdict on one line: "FAILED against b.json: 3 of 90 metrics got worse; 2 of 2 requirements met"."""
        parts, n = [], len(self.requirements)
        if n:
            parts.append(f"{n - len(self.violated)} of {n} requirements met")
        if self.results.failed or not (parts or self.comparison):
            n_done = sum(len(group.seeds) for group in self.results.groups.values())
            parts.append(f"{counted(n_done, 'case')} done, {len(self.results.failed)} failed")
        if self.results.unfinished:
            parts.append(f"{counted(self.results.unfinished, 'case')} not finished")
        return verdict_line(self.baseline, self.comparison, self.passed, parts, wrote)
