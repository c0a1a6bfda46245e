"""Results of every condition with the paper's values where printed, and ablations paired by run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array
from trackers.observations import NS_PER_S, Image
from trackers.vision.front_end import FrontEndOptions, front_ends
from trackers.vision.views import CameraViews
from twin.recording.reader import Recording
from twin.reproduce.results import ResultRow, SystemValue, mean_over_runs
from twin.reproduce.suite_runs import SuiteRuns, case_recording, metric_arrays
from twin.suites.cache import RecordingCache
from twin.suites.expansion import Case
from twin.suites.worker import RECORDING, resolved_scenario
from twin.world.simulation import Simulation

OURS, PAPER, BASELINE = "camera-floor-particle", "camera-floor-particle-paper", "floor-kalman"
MOVEMENTS = ("crossing", "turning", "going-around", "going-back")
COURSE, HOME, PAIR = "straight-course", "home", "pair"
NEEDED = (*MOVEMENTS, COURSE, HOME, PAIR)
EXPERIMENTS, BEYOND, ABLATION = "experiments", "beyond the paper", "beyond the paper, ablations"
RIGHT = "people right at the end"
_STREAM = "camera-floor bootstrap"

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
    (HOME, "all rules the paper's", PAPER, RIGHT),
)
"""Ablations: condition, omitted part, preset, and the metric affected."""


@dataclass(frozen=True, eq=False)
class CameraFloorCondition:
    """n runs of a condition: metrics of metrics.json by tracker, (n,), NaN where one does not apply."""

    name: str
    seeds: tuple[int, ...]
    metrics: Mapping[str, Mapping[str, Array]]


def read_conditions(runs: SuiteRuns) -> dict[str, CameraFloorCondition]:
    """Collect every condition of the suite by name."""
    found = {}
    for name, by_seed in runs.by_condition.items():
        found[name] = CameraFloorCondition(name, tuple(by_seed), metric_arrays(by_seed.values(), runs.metrics))
    return found


def results_of(conditions: Mapping[str, CameraFloorCondition]) -> list[ResultRow]:
    """Compute every result: the four movements together, then each condition, then ablations."""
    movements = [conditions[name] for name in MOVEMENTS]
    by_all = [tracker for tracker in movements[0].metrics if all(tracker in each.metrics for each in movements)]
    together = CameraFloorCondition(
        "four movements",
        tuple(seed for each in movements for seed in each.seeds),
        {
            tracker: {
                key: np.concatenate([each.metrics[tracker][key] for each in movements]) for _, key, _, _ in _MEANS
            }
            for tracker in by_all
        },
    )
    found = list(_means(together, EXPERIMENTS))
    for name, condition in conditions.items():
        found += _means(condition, EXPERIMENTS if name in NEEDED else BEYOND)
    return found + list(_ablations(conditions))


def tracker_label(tracker: str) -> str:
    """Shorten a tracker's name for tables."""
    return "ours" if tracker == OURS else tracker.removeprefix(f"{OURS}-")


def _means(condition: CameraFloorCondition, where: str) -> Iterator[ResultRow]:
    for tracker, metrics in condition.metrics.items():
        for row, key, times, unit in _MEANS:
            values = times * metrics[key]
            known = values[~np.isnan(values)]
            if known.size:
                paper = _PAPER_HEAD.get(row) if tracker == OURS and condition.name not in (COURSE, PAIR) else None
                paper = paper if where == EXPERIMENTS else None
                found = mean_over_runs(known, condition.seeds[0], _STREAM)
                others = [
                    SystemValue.mean(each, times * condition.metrics[each][key], condition.seeds[0], _STREAM)
                    if each in condition.metrics
                    else None
                    for each in (PAPER, BASELINE)
                    if tracker == OURS
                ]
                each = f"{condition.name}, {row}"
                yield ResultRow.of(where, each, tracker_label(tracker), found, unit, len(known), paper, *others)


def _ablations(conditions: Mapping[str, CameraFloorCondition]) -> Iterator[ResultRow]:
    """Compute the effect of omitting a part, paired by run: the metric without less the metric with."""
    units = {row: (key, times, unit) for row, key, times, unit in _MEANS}
    for name, what, tracker, row in ABLATIONS:
        condition = conditions.get(name)
        if condition is None or tracker not in condition.metrics:
            continue
        key, times, unit = units[row]
        change = times * (condition.metrics[tracker][key] - condition.metrics[OURS][key])
        known = change[~np.isnan(change)]
        if known.size:
            found = mean_over_runs(known, condition.seeds[0], _STREAM)
            yield ResultRow.of(ABLATION, f"{what} ({name})", f"change of {row}", found, unit, len(known))


SHOWN = ("crossing", "shadows")
"""Conditions that differ only in shadows."""
_EVERY_S = 0.5


def mask_results(runs: SuiteRuns) -> list[ResultRow]:
    """Measure recall and precision of foreground pixels in the first run of each condition, all cameras together."""
    found = []
    for name in SHOWN:
        if name not in runs.by_condition:
            continue
        case = next(iter(next(iter(runs.by_condition[name].values())).values()))
        recall, precision = mask_quality(case, runs.cache)
        for row, share in (("of people's pixels, foreground", recall), ("of foreground, people's", precision)):
            value = 100 * share
            found.append(ResultRow(BEYOND, f"{name}, {row}", "ours", None, value, (value, value), "%", 1))
    return found


def mask_quality(case: Case, cache: RecordingCache) -> tuple[float, float]:
    """Compute the share of people's pixels in the foreground, and of the foreground on people."""
    both = people = found = 0
    with case_recording(case, cache) as entry, Simulation(resolved_scenario(case)) as simulation:
        for image, mask in _foreground(entry / RECORDING):
            true = simulation.person_images(image.stamp_ns / NS_PER_S)[image.sensor] > 0
            both, people, found = both + (mask & true).sum(), people + true.sum(), found + mask.sum()
    return float(both / people), float(both / found)


def _foreground(path: Path) -> Iterator[tuple[Image, NDArray[np.bool_]]]:
    """Yield the tracker's foreground in each camera's image, one per half second."""
    bag = Recording(path)
    area = None if bag.rig.area is None else Area(bag.rig.area)
    cameras = CameraViews(front_ends(bag.rig.cameras(), list(bag.background), FrontEndOptions(), area))
    last_ns: dict[str, int] = {}
    for image in bag.observations():
        if isinstance(image, Image) and image.stamp_ns - last_ns.get(image.sensor, -NS_PER_S) >= _EVERY_S * NS_PER_S:
            last_ns[image.sensor] = image.stamp_ns
            for view in cameras.views({image.sensor: image}):
                yield image, view.mask
