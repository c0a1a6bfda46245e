"""Table I of Bai and Takahashi: six columns of every condition with the paper's values; statements; and each column's
breaking density.

Counts are means per run of the paper's length; intervals are percentile bootstraps over runs, differences are paired by
seed. A column breaks at the first density at which the interval of its errors (misidentified and lost) per minute of a
person in the area leaves zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackers.arrays import Array
from twin.reproduce.laser_fisheye_imm.runs import (
    COAST_S,
    COLUMNS,
    FULL,
    IMM,
    KALMAN,
    SENSOR_SETS,
    Column,
    LabCondition,
    LabRuns,
)
from twin.reproduce.results import Interval, ResultRow, SystemValue, interval

TABLE_ONE, PAIRED, BEYOND, DENSITY = "table I", "table I, paired", "beyond the paper", "beyond the paper, density"
MISIDENTIFIED, LOST, TOTAL = "misidentified", "lost", "misidentified + lost"
COUNTS = (MISIDENTIFIED, LOST, TOTAL)
RATES = {"MOTA": ("mota", "1"), "IDF1": ("idf1", "1"), "MOTP": ("motp_m", "m")}
ROWS = (*COUNTS, *RATES)
"""Rows of the table: the paper's counts, their sum, and further metrics."""
ALL_SETS = "summed over the three sensor sets"
_STREAM = "lab bootstrap"

_PAPER = {
    (SENSOR_SETS[0], MISIDENTIFIED): 0.0,
    (SENSOR_SETS[0], LOST): 0.0,
    (SENSOR_SETS[1], MISIDENTIFIED): 3.0,
    (SENSOR_SETS[1], LOST): 5.0,
    (SENSOR_SETS[2], MISIDENTIFIED): 3.0,
    (SENSOR_SETS[2], LOST): 8.0,
}  # of the IMM; the Kalman filter's row is damaged in our copy: 2, 0, 19, 5 and 4 are legible, but not their columns


def paper_value(column: Column, row: str) -> float | None:
    """Return the paper's value, of its one run; None if missing or illegible."""
    if column.filter != IMM:
        return None
    if row == TOTAL:
        return _PAPER[column.sensors, MISIDENTIFIED] + _PAPER[column.sensors, LOST]
    return _PAPER.get((column.sensors, row))


def values(condition: LabCondition, tracker: str, row: str) -> Array:
    """Return a row of the table in each run, (n,)."""
    if row == TOTAL:
        return condition.errors(tracker)
    metric = {MISIDENTIFIED: "misidentifications", LOST: "lost_tracks"}.get(row) or RATES[row][0]
    return condition.metrics[tracker][metric]


def cell(condition: LabCondition, tracker: str, row: str) -> Interval:
    """Compute a cell of the table: the mean over the runs that have the metric, with its interval."""
    found = values(condition, tracker, row)
    if row in COUNTS:
        return condition.bootstrap(_STREAM, len(found)).rate(found, np.ones(len(found)))
    found = found[~np.isnan(found)]
    return interval(condition.bootstrap(_STREAM, len(found)).mean(found))


def system_value(condition: LabCondition, tracker: str | None, row: str) -> SystemValue | None:
    """Compute a cell of another system; None unless it was run in every run that has the metric."""
    if tracker is None or tracker not in condition.metrics or not _known(condition, tracker, row):
        return None
    if row in COUNTS and np.isnan(values(condition, tracker, row)).any():
        return None
    return SystemValue.of(tracker, cell(condition, tracker, row))


def difference(condition: LabCondition, tracker: str, other: str) -> Interval:
    """Compute errors of a system minus those of another, mean over runs, paired by seed."""
    change = condition.errors(tracker) - condition.errors(other)
    return condition.bootstrap(_STREAM).difference(change)


def filters_difference(condition: LabCondition, paper: bool = False) -> Interval:
    """Compute errors of the IMM minus those of the Kalman filter, each summed over the sensor sets, paired by seed.

    paper: of the paper's systems.
    """
    change = np.zeros(len(condition.seeds))
    for each in COLUMNS:
        errors = condition.errors(each.paper_tracker if paper else each.tracker)
        change = change + errors * (1 if each.filter == IMM else -1)
    return condition.bootstrap(_STREAM).difference(change)


def _has_papers_systems(condition: LabCondition) -> bool:
    """Return whether all of the paper's systems did every run of the condition."""
    papers = [each.paper_tracker for each in COLUMNS]
    return all(each in condition.metrics and not np.isnan(condition.errors(each)).any() for each in papers)


def error_rate(condition: LabCondition, column: Column) -> Interval:
    """Compute errors per minute of a person in the area."""
    errors = condition.errors(column.tracker)
    return condition.bootstrap(_STREAM).rate(errors, condition.person_minutes)


def breaks_at(densities: Sequence[LabCondition], column: Column) -> LabCondition | None:
    """Find the first condition at which the interval of the error rate leaves zero; None without one."""
    return next((each for each in densities if error_rate(each, column).low > 0), None)


def lab_results(lab: LabRuns) -> list[ResultRow]:
    """Compute every result: table I, the paired differences, and the same for further conditions."""
    return [
        *_table(lab.paper_condition, TABLE_ONE, prefix="", with_paper=True),
        *_paired(lab.paper_condition, PAIRED, prefix=""),
        *(
            result
            for condition in lab.conditions[1:]
            for result in (
                *_table(condition, BEYOND, prefix=f"{condition.name}: ", with_paper=False),
                *_paired(condition, f"{BEYOND}, paired", prefix=f"{condition.name}: "),
            )
        ),
        *(
            ResultRow.of(DENSITY, each.name, column.name, error_rate(each, column), "/person-min", len(each.seeds))
            for each in lab.densities
            for column in COLUMNS
        ),
    ]


def _table(condition: LabCondition, where: str, prefix: str, with_paper: bool) -> Iterator[ResultRow]:
    for row in ROWS:
        unit = "/run" if row in COUNTS else RATES[row][1]
        for column in COLUMNS:
            if row not in COUNTS and not _known(condition, column.tracker, row):
                continue  # no person was matched in any run: the metric does not apply
            yield ResultRow.of(
                where,
                prefix + row,
                column.name,
                cell(condition, column.tracker, row),
                unit,
                len(condition.seeds),
                paper_value(column, row) if with_paper else None,
                system_value(condition, column.paper_tracker, row),
                system_value(condition, column.baseline, row),
            )


def _paired(condition: LabCondition, where: str, prefix: str) -> Iterator[ResultRow]:
    by_set = {(each.filter, each.sensors): each for each in COLUMNS}
    pairs = [(f"IMM − Kalman, {sensors}", by_set[IMM, sensors], by_set[KALMAN, sensors]) for sensors in SENSOR_SETS]
    pairs += [(f"{FULL.name} − {column.name}", FULL, column) for column in COLUMNS[1:]]
    has_papers = _has_papers_systems(condition)
    found: list[tuple[str, Interval, SystemValue | None]] = []
    for row, one, other in pairs:
        first, second = one.paper_tracker, other.paper_tracker
        papers = SystemValue.of(f"{first} − {second}", difference(condition, first, second)) if has_papers else None
        found.append((row, difference(condition, one.tracker, other.tracker), papers))
    papers = SystemValue.of("*-paper", filters_difference(condition, paper=True)) if has_papers else None
    found.insert(len(SENSOR_SETS), (f"IMM − Kalman, {ALL_SETS}", filters_difference(condition), papers))
    for row, ours, system in found:
        yield ResultRow.of(where, prefix + row, TOTAL, ours, "/run", len(condition.seeds), paper_system=system)


Verdict = Literal["holds", "does not hold", "not decided"]

LEAST_MOTA, LEAST_IDF1, MOST_MOTP_M = 0.97, 0.99, 0.10


@dataclass(frozen=True)
class Statement:
    """Statement about table I, its verdict by these runs, and the evidence."""

    text: str
    verdict: Verdict
    evidence: str


def statements(condition: LabCondition) -> Iterator[Statement]:
    """Check the statements about the paper's experiment, in order."""
    n_run = len(condition.seeds)
    misidentified = int(values(condition, FULL.tracker, MISIDENTIFIED).sum())
    yield Statement(
        "The full system with IMM misidentifies no person, in any run.",
        _holds(misidentified == 0),
        f"{misidentified} in {n_run} runs",
    )
    lost, excused = values(condition, FULL.tracker, LOST), condition.has_long_occlusion
    lost_without = int(lost[~excused].sum())
    yield Statement(
        f"It loses no person in a run without an occlusion longer than the {COAST_S:g} s that tracks coast.",
        _holds(lost_without == 0),
        f"{lost_without} lost in {(~excused).sum()} such runs; {int(lost[excused].sum())} in the other "
        f"{excused.sum()}, listed below",
    )
    sums = {each.name: int(condition.errors(each.tracker).sum()) for each in COLUMNS}
    own = sums.pop(FULL.name)
    yield Statement(
        "Every other column makes more errors, summed over the runs.",
        _holds(min(sums.values()) > own),
        f"{own} against " + ", ".join(f"{total} ({name})" for name, total in sums.items()),
    )
    filters = {
        "The Kalman filter makes more errors than the IMM, summed over the sensor sets and paired by seed.": False
    }
    if _has_papers_systems(condition):
        filters["So it does by the paper's rules alone."] = True
    for text, paper in filters.items():
        change = filters_difference(condition, paper)
        evidence = f"IMM − Kalman: {change.value:.2f} errors a run, 95 %: {change.low:.2f} to {change.high:.2f}"
        yield Statement(
            text,
            "holds" if change.high < 0 else "does not hold" if change.low > 0 or change.value >= 0 else "not decided",
            evidence.replace("-", "−"),
        )
    for row, bound in (("MOTA", LEAST_MOTA), ("IDF1", LEAST_IDF1), ("MOTP", MOST_MOTP_M)):
        if not _known(condition, FULL.tracker, row):
            continue
        found, mean = values(condition, FULL.tracker, row), cell(condition, FULL.tracker, row).value
        if row == "MOTP":
            text = f"Its tracks are {bound:g} m from their people at most, on the mean (MOTP)."
            yield Statement(text, _holds(mean <= bound), f"{mean:.3f} m, most in a run {np.nanmax(found):.3f} m")
        else:
            text = f"{row} of the full system is at least {bound:g}, on the mean."
            yield Statement(text, _holds(mean >= bound), f"{mean:.3f}, least in a run {np.nanmin(found):.3f}")


def _holds(whether: bool) -> Verdict:
    return "holds" if whether else "does not hold"


def _known(condition: LabCondition, tracker: str, row: str) -> bool:
    return not np.isnan(values(condition, tracker, row)).all()
