"""Tables I and II of Song et al. with our results, and further rows: each value with its interval.

Shares are over all runs together, with percentile bootstraps over runs; differences are paired by seed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackers.arrays import Array
from twin.reproduce.laser_vision_learning.runs import (
    BASELINE,
    BUSY,
    FUSED,
    GROUPS,
    HALL,
    LASER,
    NO_LEARNING,
    OTHER_BASELINE,
    PAPER_SYSTEMS,
    SYSTEMS,
    VISION,
    HallCondition,
    HallRuns,
)
from twin.reproduce.results import Bootstrap, Interval, ResultRow, SystemValue, interval
from twin.streams import stream

PLACE, TABLE_ONE, TABLE_TWO = "the place", "table I", "table II"
CHANGED, DENSITY, ABLATION = "beyond the paper, changed", "beyond the paper, density", "beyond the paper, ablation"
ACCURACY, CORRELATED, MERGES = "accuracy", "correlated, disposed of", "merge/split, disposed of"
PAIRS, MEDIAN, SECONDS = "correlated pairs a frame", "merges, median duration", "merges of 1 s or more a minute"
TABLE_GROUPS, AFTER = "people in groups", "identity 1 s after a merge"
COST, RELATIVE = "time per frame", "time per frame, fused / vision only"

_DISPOSAL = {CORRELATED: "disposal.correlated", MERGES: "disposal.merge_split", AFTER: "disposal.identity_after"}
_KINDS = {"missed": "missed", "false location": "false_location", "identity wrong": "identity_wrong"}
_PAPER_ONE = {
    (FUSED, CORRELATED): 88.62, (LASER, CORRELATED): 47.52, (VISION, CORRELATED): 66.96,
    (FUSED, MERGES): 81.75, (LASER, MERGES): 27.00, (VISION, MERGES): 35.20,
}  # fmt: skip
_PAPER_TWO = {FUSED: 89.53, LASER: 73.37, VISION: 80.95}
_STREAM = "hall bootstrap"
_PAPER_RELATIVE = 0.1511 / 0.6906
_PAPER_PLACE = {
    (BUSY, PAIRS): 3832 / 6000,
    (BUSY, "merged pairs a frame"): 537 / 6000,
    (HALL, "people a frame"): 10.26,
    (HALL, "share of them interacting"): 16.35,
}


def hall_results(hall: HallRuns) -> list[ResultRow]:
    """Compute every result of the page."""
    found = [each for name in (BUSY, HALL) for each in place_results(hall.conditions[name])]
    found += _disposals(hall.conditions[BUSY], TABLE_ONE, with_paper=True)
    found += _accuracies(hall.conditions[BUSY], TABLE_ONE, with_paper=False)
    found += _accuracies(hall.conditions[HALL], TABLE_TWO, with_paper=True)
    found += _disposals(hall.conditions[HALL], TABLE_TWO, with_paper=False)
    found += _costs(hall.conditions[HALL], TABLE_TWO)
    for condition in hall.groups:
        found += group_results(condition)
    for condition in hall.densities:
        found += _beyond(condition, DENSITY)
    for condition in hall.changed:
        found += _beyond(condition, CHANGED)
        found += _losses(condition, hall.conditions[HALL])
    if hall.ablation is not None:
        found += _beyond(hall.ablation, ABLATION)
    return found


def _share(condition: HallCondition, tracker: str, row: str) -> tuple[Array, Array]:
    """Return a tracker's correct and total counts in each run, (n,) each: the accuracy, or a disposal."""
    metrics = condition.metrics[tracker]
    if row == ACCURACY:
        count = metrics["failures.person_frames"]
        return count - condition.failures(tracker), count
    return metrics[f"{_DISPOSAL[row]}.disposed"], metrics[f"{_DISPOSAL[row]}.total"]


def group_results(condition: HallCondition) -> Iterator[ResultRow]:
    """Compute the table of people in groups: the paper's value, its system here, ours, and the baseline; then differences.

    Rows of `groups-SENSORS` have these sensors before their names. Differences are of shares over all runs, in points, with
    replicates paired by run.
    """
    yield from place_results(condition)
    boot, sensors = (
        condition.bootstrap(_STREAM),
        condition.name.removeprefix(GROUPS).removeprefix("-").replace("-", " "),
    )
    prefix = f"{sensors}: " if sensors else ""
    replicates = {
        (tracker, row): 100 * boot.ratio(*(each[:, None] for each in _share(condition, tracker, row)))[:, 0]
        for tracker in condition.trackers
        for row in (ACCURACY, *_DISPOSAL)
    }
    for (tracker, row), values in replicates.items():
        if tracker not in SYSTEMS:
            continue
        paper = _PAPER_TWO.get(tracker) if row == ACCURACY else _PAPER_ONE.get((tracker, row))
        others = [
            None if (name, row) not in replicates else SystemValue.of(name, interval(replicates[name, row]))
            for name in (PAPER_SYSTEMS[tracker], BASELINE)
        ]
        ours, column = interval(values), condition.tracker_label(tracker)
        yield ResultRow.of(TABLE_GROUPS, prefix + row, column, ours, "%", len(condition.seeds), paper, *others)
    for name, what in ((BASELINE, BASELINE), (OTHER_BASELINE, OTHER_BASELINE), (NO_LEARNING, "without learning")):
        for row in (ACCURACY, AFTER):
            if (FUSED, row) in replicates and (name, row) in replicates:
                gain = interval(replicates[FUSED, row] - replicates[name, row])
                name_of_row = f"{prefix}{row}, fused over {what}"
                yield _result(TABLE_GROUPS, name_of_row, "difference", None, gain, "%", condition)


def cost_fit(conditions: list[HallCondition], tracker: str) -> Array | None:
    """Fit the mean time per frame [ms] to (1, people per frame, interacting people per frame) by least squares over all
    runs.

    Returns three coefficients and the explained share of variance (4,); None with fewer than five runs.
    """
    rows = [
        (1.0, people / frames, close / frames, ms)
        for condition in conditions
        if tracker in condition.trackers
        for people, close, frames, ms in zip(
            condition.place.people, condition.place.interacting, condition.place.frames,
            condition.metrics[tracker]["ms_per_frame.mean"], strict=True,
        )
    ]  # fmt: skip
    if len(rows) < 5:
        return None
    table = np.array(rows)
    fitted, *_ = np.linalg.lstsq(table[:, :3], table[:, 3], rcond=None)
    left = table[:, 3] - table[:, :3] @ fitted
    return np.append(fitted, 1 - left.var() / table[:, 3].var())


def place_results(condition: HallCondition) -> Iterator[ResultRow]:
    """Compute the rows on a condition's scenes by the truth: people, correlated and merged pairs, durations of merges."""
    place, boot = condition.place, condition.bootstrap(_STREAM)
    shares = (
        ("people a frame", place.people, place.frames, "1", 1.0),
        ("share of them interacting", place.interacting, place.people, "%", 100.0),
        (PAIRS, place.correlated, place.frames, "1", 1.0),
        ("merged pairs a frame", place.merged, place.frames, "1", 1.0),
        ("merges a minute", place.merges, place.minutes, "/min", 1.0),
    )
    for row, above, below, unit, times in shares:
        paper = _PAPER_PLACE.get((condition.name, row))
        yield _result(PLACE, row, condition.name, paper, boot.share(times * above, below), unit, condition)
    if len(place.merge_s):
        lasting = Bootstrap(len(place.merge_s), stream(condition.seeds[0], "reproduce", "merges bootstrap"))
        long: Array = np.where(place.merge_s >= 0.5, 100.0, 0.0)
        for row, values, unit in (
            ("merges, mean duration", place.merge_s, "s"),
            ("merges of 0.5 s or more", long, "%"),
        ):
            yield _result(PLACE, row, condition.name, None, interval(lasting.mean(values)), unit, condition)
        median = interval(lasting.median(place.merge_s))
        yield _result(PLACE, MEDIAN, condition.name, None, median, "s", condition)
        seconds = np.where(place.merge_s >= 1.0, 1.0, 0.0)
        a_minute = interval(lasting.mean(seconds) * len(seconds) / place.minutes.sum())
        yield _result(PLACE, SECONDS, condition.name, None, a_minute, "/min", condition)


def _disposals(condition: HallCondition, where: str, with_paper: bool) -> Iterator[ResultRow]:
    for row in (CORRELATED, MERGES):
        for tracker in condition.trackers:
            disposed, total = _share(condition, tracker, row)
            if total.sum():
                paper = _PAPER_ONE.get((tracker, row)) if with_paper else None
                share = condition.bootstrap(_STREAM).share(100 * disposed, total)
                yield _result(where, row, condition.tracker_label(tracker), paper, share, "%", condition)


def _accuracies(condition: HallCondition, where: str, with_paper: bool) -> Iterator[ResultRow]:
    boot = condition.bootstrap(_STREAM)
    for tracker in condition.trackers:
        metrics, column = condition.metrics[tracker], condition.tracker_label(tracker)
        paper = _PAPER_TWO.get(tracker) if with_paper else None
        right, count = _share(condition, tracker, ACCURACY)
        right = boot.share(100 * right, count)
        yield _result(where, ACCURACY, column, paper, right, "%", condition)
        for kind, metric in _KINDS.items():
            share = boot.share(100 * metrics[f"failures.{metric}"], count)
            yield _result(where, kind, column, None, share, "%", condition)
        for row, metric in (("MOTA", "mota"), ("IDF1", "idf1"), ("HOTA", "hota")):
            yield _result(where, row, column, None, interval(boot.mean(metrics[metric])), "1", condition)


def _costs(condition: HallCondition, where: str) -> Iterator[ResultRow]:
    boot = condition.bootstrap(_STREAM)
    for tracker in condition.trackers:
        for row, metric in ((COST, "ms_per_frame.mean"), (f"{COST}, 95 %", "ms_per_frame.p95")):
            cost = interval(boot.mean(condition.metrics[tracker][metric]))
            yield _result(where, row, condition.tracker_label(tracker), None, cost, "ms", condition)
    if FUSED in condition.trackers and VISION in condition.trackers:
        fused, vision = (condition.metrics[each]["ms_per_frame.mean"] for each in (FUSED, VISION))
        found = boot.share(fused, vision)
        yield _result(where, RELATIVE, condition.tracker_label(FUSED), _PAPER_RELATIVE, found, "1", condition)


def _beyond(condition: HallCondition, where: str) -> Iterator[ResultRow]:
    boot = condition.bootstrap(_STREAM)
    for tracker in condition.trackers:
        right, count = _share(condition, tracker, ACCURACY)
        cost, column = boot.mean(condition.metrics[tracker]["ms_per_frame.mean"]), condition.tracker_label(tracker)
        accuracy = boot.share(100 * right, count)
        yield _result(where, f"{condition.name}, {ACCURACY}", column, None, accuracy, "%", condition)
        yield _result(where, f"{condition.name}, {COST}", column, None, interval(cost), "ms", condition)
    for each in _disposals(condition, where, with_paper=False):
        yield ResultRow(where, f"{condition.name}, {each.row}", each.column, None, each.ours, each.ci95, "%", each.runs)


def _losses(condition: HallCondition, hall: HallCondition) -> Iterator[ResultRow]:
    """Compute the loss of accuracy by a change of the hall, paired by seed, over the frames of the change's runs."""
    seeds = [seed for seed in condition.seeds if seed in hall.seeds]
    for tracker in condition.trackers:
        if tracker not in hall.trackers or not seeds:
            continue
        runs = [condition.seeds.index(seed) for seed in seeds]
        here, frames = condition.accuracy(tracker)[runs], condition.place.frames[runs].astype(int).tolist()
        there = np.array([hall.accuracy_so_far(tracker, *each) for each in zip(seeds, frames, strict=True)])
        boot = Bootstrap(len(seeds), stream(seeds[0], "reproduce", _STREAM))
        lost = interval(boot.mean(there - here))
        row = f"{condition.name}, loss of accuracy"
        yield _result(CHANGED, row, condition.tracker_label(tracker), None, lost, "%", condition)


def _result(
    where: str, row: str, column: str, paper: float | None, found: Interval, unit: str, condition: HallCondition
) -> ResultRow:
    return ResultRow.of(where, row, column, found, unit, len(condition.seeds), paper)
