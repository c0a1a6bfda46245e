"""Runs of the hall, read from the suite's results: the three systems, conditions, places, and one run in full.

A condition is an entry of the suite: `busy` is table I, `hall` is table II and figure 11; `groups` and `groups-SENSORS` hold
people in groups, the paper's target; `people-N` is a density; `ablation` compares variants of the fused system; every other
is the hall with one change.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.evaluate import Evaluation, evaluate_with_details
from twin.recording.situation_table import SituationTable, read_situations
from twin.recording.tables import TruthTable, read_truth
from twin.reproduce.suite_runs import Condition, SuiteRuns, case_tracks, check_entries, metric_arrays
from twin.suites.expansion import Case
from twin.suites.spec import Suite
from twin.suites.worker import TRUTH, case_recording, resolved_scenario

FUSED, LASER, VISION = "laser-vision-learning", "laser-vision-learning-laser", "laser-vision-learning-vision"
SYSTEMS: Mapping[str, str] = {FUSED: "fused", LASER: "laser only", VISION: "vision only"}
"""The paper's three systems, by preset, with their names in tables."""
HALL, BUSY, GROUPS, ABLATION = "hall", "busy", "groups", "ablation"
PAPER_SYSTEMS: Mapping[str, str] = {
    FUSED: "laser-vision-learning-paper",
    LASER: "laser-vision-learning-paper-laser",
    VISION: "laser-vision-learning-paper-vision",
}
"""Preset of the same system by the paper's rules, by our preset."""
BASELINE, OTHER_BASELINE, NO_LEARNING = "sort", "laser-imm", "no-learning"
DENSITY = re.compile(r"people-\d+")


@dataclass(frozen=True, eq=False)
class PlaceStatistics:
    """Statistics of n runs' scenes by the truth, (n,) each except the durations of all merges together."""

    frames: Array  # of the scanners
    people: Array  # person-frames inside the area
    interacting: Array  # of them, those less than 1.5 m from another person
    correlated: Array  # pairs of people in frames
    merges: Array
    merged: Array  # pairs of people in frames
    minutes: Array
    merge_s: Array  # (m,) duration of each merge


@dataclass(frozen=True, eq=False)
class HallRun:
    """One run of the hall or the busy place: case and evaluation by system, and situations."""

    cases: Mapping[str, Case]
    situations: SituationTable
    evaluations: Mapping[str, Evaluation]
    interacting: Array  # (f,) interacting people in each judged frame
    people: Array  # (f,) inside the area
    names: Mapping[int, str]


@dataclass(frozen=True, eq=False)
class HallCondition(Condition):
    """n runs of a condition."""

    place: PlaceStatistics
    course: Mapping[str, tuple[Array, ...]] | None = (
        None  # tracker -> cumulative failures and person-frames of each run, (2, f)
    )

    def tracker_label(self, tracker: str) -> str:
        """Return a tracker's name in tables."""
        return SYSTEMS.get(tracker, tracker.replace("-", " "))

    def failures(self, tracker: str) -> Array:
        """Count failures of all kinds in each run, (n,)."""
        kinds = self.metrics[tracker]
        return kinds["failures.missed"] + kinds["failures.false_location"] + kinds["failures.identity_wrong"]

    def accuracy(self, tracker: str) -> Array:
        """Compute the accuracy of each run, (n,) [%]."""
        return 100 * (1 - self.failures(tracker) / self.metrics[tracker]["failures.person_frames"])

    def accuracy_so_far(self, tracker: str, seed: int, frames: int) -> float:
        """Compute the accuracy of a run's first `frames` frames [%]; of the whole run without its course."""
        run = self.seeds.index(seed)
        if self.course is None:
            return float(self.accuracy(tracker)[run])
        failed, count = self.course[tracker][run][:, :frames][:, -1]
        return float(100 * (1 - failed / count))


@dataclass(frozen=True, eq=False)
class HallRuns:
    """All conditions by name, and the first run of the hall and of the busy place in full."""

    conditions: Mapping[str, HallCondition]
    hall: HallRun
    busy: HallRun
    not_done: tuple[str, ...]

    @property
    def densities(self) -> list[HallCondition]:
        """The conditions that differ in the number of people, fewest first."""
        found = [each for each in self.conditions.values() if DENSITY.fullmatch(each.name)]
        return sorted(found, key=lambda each: int(each.name.removeprefix("people-")))

    @property
    def groups(self) -> list[HallCondition]:
        """The conditions with people in groups."""
        return [each for each in self.conditions.values() if each.name.split("-")[0] == GROUPS]

    @property
    def changed(self) -> list[HallCondition]:
        """Conditions that change the hall in one respect."""
        others = [*self.densities, *self.groups]
        return [
            each for each in self.conditions.values() if each.name not in (HALL, BUSY, ABLATION) and each not in others
        ]

    @property
    def ablation(self) -> HallCondition | None:
        """Variants of the fused system; None if the suite has none."""
        return self.conditions.get(ABLATION)


def interacting(truth: TruthTable, situations: SituationTable, stamps_ns: np.ndarray) -> tuple[Array, Array]:
    """Count the people inside the area and those who interact in each of these frames, (f,) each."""
    people, close = np.zeros(len(stamps_ns)), np.zeros(len(stamps_ns))
    pairs = situations.select("interaction")
    holds = pairs.frames(stamps_ns)
    for person in np.unique(truth.id).tolist():
        there = np.isin(stamps_ns, truth.stamps_ns[(truth.id == person) & truth.in_area])
        people += there
        close += there & holds[(pairs.first_id == person) | (pairs.second_id == person)].any(axis=0)
    return people, close


SITUATIONS = "truth_situations.csv"


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the hall or the busy place."""
    check_entries(suite, path, {HALL: "the place of table II", BUSY: "the place of table I"})


def read_hall(found: SuiteRuns) -> HallRuns:
    """Read all runs; a recording no longer in the cache is made again."""
    conditions = {name: _condition(name, whole, found) for name, whole in found.by_condition.items()}
    conditions[HALL] = replace(conditions[HALL], course=_course(found.by_condition[HALL], found))
    first = {name: _one_run(found.first_cases(name), found) for name in (HALL, BUSY)}
    return HallRuns(conditions, first[HALL], first[BUSY], found.not_done)


def _recorded(case: Case, found: SuiteRuns) -> tuple[TruthTable, SituationTable]:
    with case_recording(case, found.cache) as entry:
        return read_truth(entry / TRUTH), read_situations(entry / SITUATIONS)


def _one_run(cases: Mapping[str, Case], found: SuiteRuns) -> HallRun:
    any_case = next(iter(cases.values()))
    truth, situations = _recorded(any_case, found)
    evaluations = {}
    for name, case in cases.items():
        evaluations[name] = evaluate_with_details(truth, case_tracks(case, found), situations=situations)
    stamps_ns = next(iter(evaluations.values())).stamps_ns
    people, close = interacting(truth, situations, stamps_ns)
    names = dict(enumerate(resolved_scenario(any_case).people, start=1))
    shown = {name: case for name, case in cases.items() if name in SYSTEMS} or cases
    return HallRun(shown, situations, evaluations, close, people, names)


def _course(whole: Mapping[int, Mapping[str, Case]], found: SuiteRuns) -> dict[str, tuple[Array, ...]]:
    """Accumulate failures and person-frames over frames, (2, f), by tracker and run."""
    courses: dict[str, list[Array]] = {}
    for cases in whole.values():
        for name, evaluation in _one_run(cases, found).evaluations.items():
            people = evaluation.people
            so_far = np.cumsum([people.failures, people.judged.sum(axis=0)], axis=1)
            courses.setdefault(name, []).append(so_far.astype(float))
    return {name: tuple(each) for name, each in courses.items()}


def _condition(name: str, whole: Mapping[int, Mapping[str, Case]], found: SuiteRuns) -> HallCondition:
    metrics = metric_arrays(whole.values(), found.metrics)
    recorded = [_recorded(next(iter(cases.values())), found) for cases in whole.values()]
    return HallCondition(name, tuple(whole), metrics, place_statistics(recorded))


def place_statistics(recorded: Sequence[tuple[TruthTable, SituationTable]]) -> PlaceStatistics:
    """Count people and their situations in n runs by the truth."""
    rows, lasting = [], []
    for truth, situations in recorded:
        stamps_ns = truth.frame_stamps_ns
        people, close = interacting(truth, situations, stamps_ns)
        merges = situations.select("merged_rig")
        span_s = float(stamps_ns[-1] - stamps_ns[0]) / NS_PER_S
        pairs = situations.select("correlated").pair_frames(stamps_ns)
        merged = merges.pair_frames(stamps_ns)
        rows.append((len(stamps_ns), people.sum(), close.sum(), pairs, len(merges), merged, span_s / 60))
        lasting.append((merges.end_ns - merges.start_ns) / NS_PER_S)
    return PlaceStatistics(*np.array(rows, dtype=float).T, merge_s=np.concatenate(lasting))
