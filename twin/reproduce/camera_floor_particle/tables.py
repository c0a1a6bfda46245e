"""The figures of every condition, the paper's beside ours where it prints one, and ablations paired by run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.reproduce.intervals import Bootstrap, Interval, interval
from twin.reproduce.results import Result
from twin.reproduce.suite_runs import SuiteRuns
from twin.streams import stream

OURS = "camera-floor-particle"
MOVEMENTS = ("crossing", "turning", "going-around", "going-back")
COURSE, HOME, PAIR = "straight-course", "home", "pair"
NEEDED = (*MOVEMENTS, COURSE, HOME, PAIR)
EXPERIMENTS, BEYOND, ABLATION = "experiments", "beyond the paper", "beyond the paper, ablations"
RIGHT = "people right at the end"

_MEANS = (
    (RIGHT, "right_at_end", 100.0, "%"),
    ("identity switches", "id_switches", 1.0, "/run"),
    ("people lost", "lost_tracks", 1.0, "/run"),
    ("body on the floor", "motp_m", 1.0, "m"),
    ("body, height", "body_height_error_m", 1.0, "m"),
    ("head x", "head_error_m.x", 1.0, "m"),
    ("head y", "head_error_m.y", 1.0, "m"),
    ("head z", "head_error_m.z", 1.0, "m"),
    ("pan, median", "head_yaw_median_rad", 180 / np.pi, "°"),
    ("time per frame", "ms_per_frame.mean", 1.0, "ms"),
)
_PAPER_HEAD = {"head x": 0.049, "head y": 0.054, "head z": 0.045}
ABLATIONS = (
    ("three-black-cameras", "without the floor", "camera-floor-particle-colour", RIGHT),
    (HOME, "without the cameras", "camera-floor-particle-floor", "body on the floor"),
    (PAIR, "without the exclusion", "camera-floor-particle-no-exclusion", RIGHT),
    ("pair-by-one-camera", "without the exclusion", "camera-floor-particle-no-exclusion", RIGHT),
    (HOME, "without the mixture", "camera-floor-particle-no-mixture", "head z"),
    (HOME, "all rules the paper's", "camera-floor-particle-paper", RIGHT),
)
"""Where what is left out matters: condition, what is left out, preset, figure."""


@dataclass(frozen=True, eq=False)
class Condition:
    """What n runs of a condition gave: figures of metrics.json by tracker, (n,), NaN where one does not apply."""

    name: str
    seeds: tuple[int, ...]
    figures: Mapping[str, Mapping[str, Array]]


def conditions_of(runs: SuiteRuns) -> dict[str, Condition]:
    """Every condition of the suite by name."""
    found = {}
    for name, by_seed in runs.by_condition.items():
        figures = {
            tracker: {
                figure: np.array([_number(runs.metrics[cases[tracker].id].get(figure)) for cases in by_seed.values()])
                for _, figure, _, _ in _MEANS
            }
            for tracker in next(iter(by_seed.values()))
        }
        found[name] = Condition(name, tuple(by_seed), figures)
    return found


def results_of(conditions: Mapping[str, Condition]) -> list[Result]:
    """Every figure: those of the four movements together first, then each condition's, then ablations."""
    movements = [conditions[name] for name in MOVEMENTS]
    together = Condition(
        "four movements",
        tuple(seed for each in movements for seed in each.seeds),
        {OURS: {key: np.concatenate([each.figures[OURS][key] for each in movements]) for _, key, _, _ in _MEANS}},
    )
    found = list(_means(together, EXPERIMENTS))
    for name, condition in conditions.items():
        found += _means(condition, EXPERIMENTS if name in NEEDED else BEYOND)
    return found + list(_ablations(conditions))


def called(tracker: str) -> str:
    """A tracker as it stands in tables."""
    return "ours" if tracker == OURS else tracker.removeprefix(f"{OURS}-")


def _means(condition: Condition, where: str) -> Iterator[Result]:
    for tracker, figures in condition.figures.items():
        for row, key, times, unit in _MEANS:
            values = times * figures[key]
            known = values[~np.isnan(values)]
            if known.size:
                paper = _PAPER_HEAD.get(row) if tracker == OURS and condition.name not in (COURSE, PAIR) else None
                paper = paper if where == EXPERIMENTS else None
                each = f"{condition.name}, {row}"
                yield _result(where, each, called(tracker), paper, _mean(known, condition.seeds[0]), unit, len(known))


def _ablations(conditions: Mapping[str, Condition]) -> Iterator[Result]:
    """What is lost by leaving something out, paired by run: the figure without less the figure with."""
    units = {row: (key, times, unit) for row, key, times, unit in _MEANS}
    for name, what, tracker, row in ABLATIONS:
        condition = conditions.get(name)
        if condition is None or tracker not in condition.figures:
            continue
        key, times, unit = units[row]
        change = times * (condition.figures[tracker][key] - condition.figures[OURS][key])
        known = change[~np.isnan(change)]
        if known.size:
            found = _mean(known, condition.seeds[0])
            yield _result(ABLATION, f"{what} ({name})", f"change of {row}", None, found, unit, len(known))


def _mean(values: Array, seed: int) -> Interval:
    return interval(Bootstrap(len(values), stream(seed, "reproduce", "camera-floor bootstrap")).mean(values))


def _result(where: str, row: str, column: str, paper: float | None, found: Interval, unit: str, n_run: int) -> Result:
    return Result(where, row, column, paper, found.value, (found.low, found.high), unit, n_run)


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
