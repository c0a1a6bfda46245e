"""Runs of the lab, read from the suite's results: the six columns of table I, conditions, and one run in full.

A condition is an entry of the suite: number of people, clothes and light. The entry `people-5` is the paper's experiment;
`people-N` with other numbers are its densities.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.observations import NS_PER_S
from twin.evaluate import Evaluation, evaluate_with_details, long_occlusions
from twin.recording.tables import TrackTable, TruthTable
from twin.reproduce.suite_runs import (
    CaseIncident,
    Condition,
    SuiteRuns,
    case_tracks,
    case_truth,
    check_entries,
    metric_arrays,
)
from twin.scenario import Scenario
from twin.suites.expansion import Case
from twin.suites.spec import Suite
from twin.suites.worker import Incident, resolved_scenario
from twin.world.world import World

COAST_S = LaserFisheyeImmOptions().track_management.coast_s
"""Longest time that a track of these trackers coasts [s]."""


@dataclass(frozen=True)
class Column:
    """Column of table I: a preset, with its filter and sensors in the paper's words."""

    tracker: str
    filter: str
    sensors: str

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.filter}, {self.sensors}"

    @property
    def paper_tracker(self) -> str:
        """Preset of the paper's system with this filter and these sensors."""
        return f"{self.tracker}-paper"

    @property
    def baseline(self) -> str | None:
        """Preset of the baseline with all scanners; None for a column of one layer."""
        return None if self.sensors == SENSOR_SETS[1] else BASELINE


IMM, KALMAN, BASELINE = "IMM", "Kalman", "sort"
SENSOR_SETS = ("both layers + camera", "waist layer + camera", "both layers")
_PRESETS = ("laser-fisheye", "waist-fisheye", "laser")
COLUMNS = tuple(
    Column(f"{preset}-{filter_.lower()}", filter_, sensors)
    for filter_ in (IMM, KALMAN)
    for preset, sensors in zip(_PRESETS, SENSOR_SETS, strict=True)
)
"""The six columns; the first is the full system."""
NAMES = {each.tracker: each.name for each in COLUMNS}
FULL = COLUMNS[0]
PAPER_CONDITION = "people-5"
"""The condition of the paper's experiment."""
DENSITY = re.compile(r"people-\d+")
"""Names of the conditions that differ only in the number of people."""


@dataclass(frozen=True)
class LongOcclusion:
    """Occlusion longer than `COAST_S`; lost: the full system's track ended in it."""

    seed: int
    person: str
    start_s: float
    end_s: float
    lost: bool


@dataclass(frozen=True, eq=False)
class LabCondition(Condition):
    """n runs of a condition; metrics of the paper's systems and of the baseline if they were run, NaN where not done."""

    overrides: tuple[str, ...]
    n_person: int
    person_minutes: Array  # (n,) [min] inside the area
    long_occlusions: tuple[LongOcclusion, ...]
    incidents: tuple[CaseIncident, ...]

    def errors(self, tracker: str) -> Array:
        """Count misidentified and lost together in each run, (n,)."""
        found = self.metrics[tracker]
        return found["misidentifications"] + found["lost_tracks"]

    @property
    def has_long_occlusion(self) -> NDArray[np.bool_]:
        """Runs with an occlusion longer than `COAST_S`, (n,)."""
        return np.isin(self.seeds, [each.seed for each in self.long_occlusions])


@dataclass(frozen=True, eq=False)
class LabRun:
    """One run in full: truth, the full system's tracks, their evaluation, and the people's names and shirts by id."""

    seed: int
    truth: TruthTable
    tracks: TrackTable
    evaluation: Evaluation
    names: Mapping[int, str]
    shirts: Mapping[int, str | None]  # None: drawn at random


@dataclass(frozen=True, eq=False)
class LabRuns:
    """All conditions, the paper's first, then its densities, then the others; and its first run in full."""

    conditions: tuple[LabCondition, ...]
    first: LabRun
    area: Array  # (k, 2) corners of the tracked area [m]
    n_scan: int  # of the paper's condition, each scanner
    scan_rate_hz: float
    not_done: tuple[str, ...]  # ids of cases that failed or were not run

    @property
    def area_m2(self) -> float:
        """Size of the tracked area."""
        (x, y), (x2, y2) = self.area.T, np.roll(self.area, -1, axis=0).T
        return float(abs((x * y2 - x2 * y).sum()) / 2)

    @property
    def paper_condition(self) -> LabCondition:
        """The paper's experiment."""
        return self.conditions[0]

    @property
    def densities(self) -> list[LabCondition]:
        """Conditions that differ only in the number of people, fewest first."""
        found = [each for each in self.conditions if DENSITY.fullmatch(each.name)]
        return sorted(found, key=lambda each: each.n_person)

    @property
    def others(self) -> list[LabCondition]:
        """The conditions that are neither the paper's nor a density."""
        return [each for each in self.conditions if not DENSITY.fullmatch(each.name)]


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the paper's condition, or with an entry without one of the six columns."""
    check_entries(suite, path, {PAPER_CONDITION: "the paper's experiment"}, [each.tracker for each in COLUMNS])


def read_lab(found: SuiteRuns) -> LabRuns:
    """Read the lab's runs from those of the suite; a recording no longer in the cache is made again."""
    conditions, runs = [], {}
    for name, whole in found.by_condition.items():
        full = [_one_run(cases[FULL.tracker], found) for cases in whole.values()]
        runs[name] = full[0]
        conditions.append(_condition(name, whole, full, found.metrics, found.incidents))
    order = {PAPER_CONDITION: 0}
    conditions.sort(key=lambda each: order.get(each.name, 1 if DENSITY.fullmatch(each.name) else 2))
    papers = found.first_cases(PAPER_CONDITION)[FULL.tracker]
    return LabRuns(
        tuple(conditions),
        runs[PAPER_CONDITION],
        World(resolved_scenario(papers)).scene.area,
        runs[PAPER_CONDITION].evaluation.stamps_ns.size,
        _scan_rate_hz(runs[PAPER_CONDITION]),
        found.not_done,
    )


def _one_run(case: Case, found: SuiteRuns) -> LabRun:
    scenario = resolved_scenario(case)
    truth, tracks = case_truth(case, found), case_tracks(case, found)
    return LabRun(
        case.seed,
        truth,
        tracks,
        evaluate_with_details(truth, tracks),
        names=dict(enumerate(scenario.people, start=1)),
        shirts=dict(enumerate((person.shirt for person in scenario.people.values()), start=1)),
    )


def _condition(
    name: str,
    whole: Mapping[int, Mapping[str, Case]],
    full: Sequence[LabRun],
    metrics: Mapping[str, Mapping[str, float | None]],
    incidents: Mapping[str, Sequence[Incident]],
) -> LabCondition:
    first = next(iter(whole.values()))[FULL.tracker]
    scenario = resolved_scenario(first)
    return LabCondition(
        name=name,
        overrides=first.overrides,
        seeds=tuple(whole),
        n_person=len(scenario.people),
        person_minutes=np.array([_person_minutes(run.truth) for run in full]),
        metrics=metric_arrays(whole.values(), metrics),
        long_occlusions=tuple(each for run in full for each in _long_occlusions(run, scenario)),
        incidents=tuple(
            CaseIncident(cases[column.tracker], incident)
            for column in COLUMNS
            for cases in whole.values()
            for incident in incidents[cases[column.tracker].id]
            if incident.kind in ("misidentification", "lost")
        ),
    )


def _person_minutes(truth: TruthTable) -> float:
    return float(truth.in_area.sum()) * _period_s(truth) / 60


def _scan_rate_hz(run: LabRun) -> float:
    return NS_PER_S / float(np.median(np.diff(run.evaluation.stamps_ns)))


def _period_s(truth: TruthTable) -> float:
    return float(np.median(np.diff(truth.frame_stamps_ns))) / NS_PER_S


def _long_occlusions(run: LabRun, scenario: Scenario) -> list[LongOcclusion]:
    scanners = [name for name, sensor in scenario.sensors.items() if sensor.kind == "laser"]
    lost = [(event.person_id, event.stamp_ns / NS_PER_S) for event in run.evaluation.events if event.kind == "lost"]
    return [
        LongOcclusion(
            run.seed,
            run.names[each.person_id],
            each.start_s,
            each.end_s,
            any(person == each.person_id and each.start_s <= t_s <= each.end_s for person, t_s in lost),
        )
        for each in long_occlusions(run.truth, scanners, COAST_S)
    ]
