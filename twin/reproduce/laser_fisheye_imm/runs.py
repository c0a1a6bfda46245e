"""The lab's runs from what the suite engine has left: every condition's figures, occlusions and moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.evaluate import evaluate_with_details, long_occlusions
from twin.recording.tables import TruthTable, read_tracks, read_truth
from twin.reproduce.laser_fisheye_imm.conditions import (
    COAST_S,
    COLUMNS,
    DENSITY,
    FULL,
    PAPERS,
    Condition,
    Hidden,
    LabRuns,
    OneRun,
)
from twin.reproduce.moments import SeenMoment
from twin.reproduce.suite_runs import SUITE_FOLDER, SuiteRuns
from twin.scenario import Scenario
from twin.suites.cache_keys import recording_key
from twin.suites.expansion import Case
from twin.suites.spec import Suite
from twin.suites.worker import TRUTH, Incident, record, renderer_of, resolved_scenario
from twin.world.world import World


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the paper's condition, or with an entry without one of the six columns."""
    if PAPERS not in [entry.name for entry in suite.scenarios]:
        raise InputError(f"{path}: scenarios: none is named {PAPERS}; one, the paper's experiment, is expected")
    for entry in suite.scenarios:
        missing = [each.tracker for each in COLUMNS if each.tracker not in (entry.trackers or suite.trackers)]
        if missing:
            raise InputError(
                f"{path}: trackers: {entry.name or entry.scenario} is without {missing[0]}; all six columns of table I "
                f"({', '.join(each.tracker for each in COLUMNS)}) are expected"
            )


def read_lab(found: SuiteRuns) -> LabRuns:
    """The lab's runs from those of the suite; a recording that has left the cache is made again."""
    conditions, runs = [], {}
    for name, whole in found.by_condition.items():
        full = [_one_run(cases[FULL.tracker], found) for cases in whole.values()]
        runs[name] = full[0]
        conditions.append(_condition(name, whole, full, found.metrics, found.moments))
    order = {PAPERS: 0}
    conditions.sort(key=lambda each: order.get(each.name, 1 if DENSITY.fullmatch(each.name) else 2))
    papers = next(iter(found.by_condition[PAPERS].values()))[FULL.tracker]
    return LabRuns(
        tuple(conditions),
        runs[PAPERS],
        World(resolved_scenario(papers)).scene.area,
        runs[PAPERS].evaluation.stamps_ns.size,
        _scan_rate_hz(runs[PAPERS]),
        found.not_done,
    )


def _one_run(case: Case, found: SuiteRuns) -> OneRun:
    scenario = resolved_scenario(case)
    key = recording_key(case.resolved, renderer_of(scenario))
    with found.cache.recording(key, lambda place: record(scenario, place)) as (entry, _):
        truth = read_truth(entry / TRUTH)
    tracks = read_tracks(found.folder / SUITE_FOLDER / "cases" / case.id / "tracks" / f"{case.tracker}.csv")
    return OneRun(
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
    full: Sequence[OneRun],
    metrics: Mapping[str, Mapping[str, float | None]],
    moments: Mapping[str, Sequence[Incident]],
) -> Condition:
    first = next(iter(whole.values()))[FULL.tracker]
    scenario = resolved_scenario(first)
    kinds = metrics[first.id]
    figures = {
        column.tracker: {
            kind: np.array([_number(metrics[cases[column.tracker].id].get(kind)) for cases in whole.values()])
            for kind in kinds
        }
        for column in COLUMNS
    }
    return Condition(
        name=name,
        overrides=first.overrides,
        seeds=tuple(whole),
        n_person=len(scenario.people),
        person_minutes=np.array([_person_minutes(run.truth) for run in full]),
        figures=figures,
        hidden=tuple(each for run in full for each in _hidden(run, scenario)),
        moments=tuple(
            SeenMoment(cases[column.tracker], moment)
            for column in COLUMNS
            for cases in whole.values()
            for moment in moments[cases[column.tracker].id]
            if moment.kind in ("misidentification", "lost")
        ),
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _person_minutes(truth: TruthTable) -> float:
    return float(truth.in_area.sum()) * _period_s(truth) / 60


def _scan_rate_hz(run: OneRun) -> float:
    return NS_PER_S / float(np.median(np.diff(run.evaluation.stamps_ns)))


def _period_s(truth: TruthTable) -> float:
    return float(np.median(np.diff(truth.frame_stamps_ns))) / NS_PER_S


def _hidden(run: OneRun, scenario: Scenario) -> list[Hidden]:
    scanners = [name for name, sensor in scenario.sensors.items() if sensor.kind == "laser"]
    lost = [(event.person_id, event.stamp_ns / NS_PER_S) for event in run.evaluation.events if event.kind == "lost"]
    return [
        Hidden(
            run.seed,
            run.names[each.person_id],
            each.start_s,
            each.end_s,
            any(person == each.person_id and each.start_s <= t_s <= each.end_s for person, t_s in lost),
        )
        for each in long_occlusions(run.truth, scanners, COAST_S)
    ]
