"""The hall's runs from what the suite engine has left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.evaluate import evaluate_with_details
from twin.recording.situation_table import SituationTable, read_situations
from twin.recording.tables import TruthTable, read_tracks, read_truth
from twin.reproduce.laser_vision_learning.conditions import (
    BUSY,
    HALL,
    SYSTEMS,
    Condition,
    HallRuns,
    OneRun,
    PlaceFigures,
    interacting,
)
from twin.reproduce.suite_runs import SUITE_FOLDER, SuiteRuns
from twin.suites.cache_keys import recording_key
from twin.suites.expansion import Case
from twin.suites.spec import Suite
from twin.suites.worker import TRUTH, record, renderer_of, resolved_scenario

SITUATIONS = "truth_situations.csv"


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite without the hall or the busy place."""
    names = [entry.name for entry in suite.scenarios]
    for wanted, what in ((HALL, "table II"), (BUSY, "table I")):
        if wanted not in names:
            raise InputError(f"{path}: scenarios: none is named {wanted}; one, the place of {what}, is expected")


def read_hall(found: SuiteRuns) -> HallRuns:
    """All runs; a recording that has left the cache is made again."""
    conditions = {name: _condition(name, whole, found) for name, whole in found.by_condition.items()}
    conditions[HALL] = replace(conditions[HALL], course=_course(found.by_condition[HALL], found))
    first = {name: _one_run(next(iter(found.by_condition[name].values())), found) for name in (HALL, BUSY)}
    return HallRuns(conditions, first[HALL], first[BUSY], found.not_done)


def _recorded(case: Case, found: SuiteRuns) -> tuple[TruthTable, SituationTable]:
    scenario = resolved_scenario(case)
    key = recording_key(case.resolved, renderer_of(scenario))
    with found.cache.recording(key, lambda place: record(scenario, place)) as (entry, _):
        return read_truth(entry / TRUTH), read_situations(entry / SITUATIONS)


def _one_run(cases: Mapping[str, Case], found: SuiteRuns) -> OneRun:
    any_case = next(iter(cases.values()))
    truth, situations = _recorded(any_case, found)
    evaluations = {}
    for name, case in cases.items():
        tracks = read_tracks(found.folder / SUITE_FOLDER / "cases" / case.id / "tracks" / f"{name}.csv")
        evaluations[name] = evaluate_with_details(truth, tracks, situations=situations)
    stamps_ns = next(iter(evaluations.values())).stamps_ns
    people, close = interacting(truth, situations, stamps_ns)
    names = dict(enumerate(resolved_scenario(any_case).people, start=1))
    shown = {name: case for name, case in cases.items() if name in SYSTEMS} or cases
    return OneRun(shown, truth, situations, evaluations, close, people, names)


def _course(whole: Mapping[int, Mapping[str, Case]], found: SuiteRuns) -> dict[str, tuple[Array, ...]]:
    """By tracker, of each run the failures and the person-frames up to each frame, (2, f)."""
    courses: dict[str, list[Array]] = {}
    for cases in whole.values():
        for name, evaluation in _one_run(cases, found).evaluations.items():
            people = evaluation.people
            so_far = np.cumsum([people.failures, people.judged.sum(axis=0)], axis=1)
            courses.setdefault(name, []).append(so_far.astype(float))
    return {name: tuple(each) for name, each in courses.items()}


def _condition(name: str, whole: Mapping[int, Mapping[str, Case]], found: SuiteRuns) -> Condition:
    first = next(iter(whole.values()))
    figures = {
        tracker: {
            figure: np.array([_number(found.metrics[cases[tracker].id].get(figure)) for cases in whole.values()])
            for figure in found.metrics[case.id]
        }
        for tracker, case in first.items()
    }
    recorded = [_recorded(next(iter(cases.values())), found) for cases in whole.values()]
    case = next(iter(first.values()))
    return Condition(name, tuple(first), case.overrides, tuple(whole), figures, _place(recorded))


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _place(recorded: list[tuple[TruthTable, SituationTable]]) -> PlaceFigures:
    rows, lasting = [], []
    for truth, situations in recorded:
        stamps_ns = truth.frame_stamps_ns
        people, close = interacting(truth, situations, stamps_ns)
        merges = situations.select("merged_rig")
        span_s = float(stamps_ns[-1] - stamps_ns[0]) / NS_PER_S
        pairs = situations.select("correlated").pair_frames(stamps_ns)
        rows.append((len(stamps_ns), people.sum(), close.sum(), pairs, len(merges), span_s / 60))
        lasting.append((merges.end_ns - merges.start_ns) / NS_PER_S)
    return PlaceFigures(*np.array(rows, dtype=float).T, merge_s=np.concatenate(lasting))
