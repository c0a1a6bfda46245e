"""Results of every condition with the paper's values where printed, and ablations paired by run.

Errors of heads are taken in every frame of a run, by range, visibility and posture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Index, Mask
from trackers.observations import NS_PER_S
from trackers.rig import Rig, placed_camera
from trackers.scipy_functions import linear_sum_assignment
from twin.recording.reader import Recording
from twin.recording.tables import TrackTable, TruthTable, read_truth
from twin.reproduce.results import ResultRow, SystemValue
from twin.reproduce.suite_runs import Condition, SuiteRuns, case_tracks
from twin.suites.worker import RECORDING, TRUTH, case_recording

LOST_M, LOST_S = 0.5, 1.0
"""Horizontal distance from the head to the nearest track, and its duration, that make a person lost."""
_SEATED_SHARE = 0.8
"""Height of the pelvis, as a share of its greatest in the run, below which a person sits or bends."""


@dataclass(frozen=True, eq=False)
class HeadErrors:
    """n matches of a person and a track. off_m: track less truth, x, y, z; turned_rad: its yaw less the true one.

    seen_by: number of cameras with a free view of the middle of the head; range_m: from the nearest of them. lost: number of
    people; found_s: time when the last person was found; nan if a person was not.
    """

    stamps_ns: NDArray[np.int64]
    off_m: Array
    turned_rad: Array
    range_m: Array
    seen_by: Index
    seated: Mask
    lost: int
    found_s: float

    @property
    def xy_cm(self) -> Array:
        """Error in XY."""
        return 100 * np.hypot(self.off_m[:, 0], self.off_m[:, 1])

    @property
    def yaw_deg(self) -> Array:
        """Absolute error of the yaw."""
        return np.degrees(np.abs(self.turned_rad))

    def statistics(self) -> dict[str, float]:
        """Compute every statistic of the run, by name."""
        level, up, turned = self.xy_cm, 100 * self.off_m[:, 2], self.yaw_deg
        known = level.size > 0
        return {
            "XY": level.mean() if known else np.nan,
            "XY, standard deviation": level.std() if known else np.nan,
            "XY, largest": level.max() if known else np.nan,
            "Z": np.abs(up).mean() if known else np.nan,
            "Z, standard deviation": np.abs(up).std() if known else np.nan,
            "Z, largest": np.abs(up).max() if known else np.nan,
            "Z, bias": up.mean() if known else np.nan,
            "yaw": turned.mean() if known else np.nan,
            "yaw, median": float(np.median(turned)) if known else np.nan,
            "lost": float(self.lost),
            "found after": self.found_s,
        }


def head_errors(truth: TruthTable, tracks: TrackTable, rig: Rig) -> HeadErrors:
    """Match each person with the nearest track in every frame, distinct within `LOST_M` for several people.

    A single person is matched at any distance, so that a track that slid away is an error and not a miss.
    """
    people = np.unique(truth.id)
    gate = np.inf if people.size == 1 else LOST_M
    near: dict[int, list[tuple[int, bool]]] = {int(each): [] for each in people}
    rows: list[tuple[int, int]] = []
    for stamp in tracks.frame_stamps_ns:
        there, found = np.flatnonzero(truth.stamps_ns == stamp), np.flatnonzero(tracks.stamps_ns == stamp)
        there = there[~np.isnan(truth.head_x[there])]
        away = np.hypot(
            truth.head_x[there, None] - tracks.head_x[found], truth.head_y[there, None] - tracks.head_y[found]
        )
        pairs = dict(zip(*linear_sum_assignment(np.minimum(away, 10.0)), strict=True)) if away.size else {}
        for k, row in enumerate(there):
            distance = away[k, pairs[k]] if k in pairs else np.inf
            near[int(truth.id[row])].append((int(stamp), bool(distance < LOST_M)))
            if k in pairs and distance < gate:
                rows.append((int(row), int(found[pairs[k]])))
    row, track = np.array(rows, np.intp).reshape(-1, 2).T
    place = np.column_stack([truth.head_x, truth.head_y, truth.head_z])[row]
    seen_by, range_m = _sight(place, truth, row, rig)
    turned = tracks.head_yaw[track] - truth.head_yaw[row]
    highest = {int(each): np.nanmax(truth.z[truth.id == each]) for each in people}
    return HeadErrors(
        stamps_ns=truth.stamps_ns[row],
        off_m=np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z])[track] - place,
        turned_rad=(turned + np.pi) % (2 * np.pi) - np.pi,
        range_m=range_m,
        seen_by=seen_by,
        seated=truth.z[row] < _SEATED_SHARE * np.array([highest[int(each)] for each in truth.id[row]]),
        lost=sum(_is_lost(each) for each in near.values()),
        found_s=max((_found_s(each) for each in near.values()), default=np.nan),
    )


def spread_cm(runs: Mapping[int, TrackTable]) -> tuple[Array, Array]:
    """Compute the standard deviation between runs of one recording at each common stamp, in XY and Z [cm]."""
    stamps = sorted(set.intersection(*({int(each) for each in run.stamps_ns} for run in runs.values())))
    places = np.array(
        [
            [
                (run.head_x[at], run.head_y[at], run.head_z[at])
                for at in (int(np.searchsorted(run.stamps_ns, stamp)) for stamp in stamps)
            ]
            for run in runs.values()
        ]
    )
    off = places - places.mean(axis=0)
    return 100 * np.sqrt((off[..., :2] ** 2).sum(axis=-1).mean(axis=0)), 100 * np.sqrt((off[..., 2] ** 2).mean(axis=0))


def _sight(place: Array, truth: TruthTable, row: Index, rig: Rig) -> tuple[Index, Array]:
    """Count the cameras that see each head, and measure the distance to the nearest."""
    seen_by, nearest = np.zeros(len(place), np.intp), np.full(len(place), np.inf)
    for name, sensor in rig.cameras().items():
        camera = placed_camera(sensor)
        seen = camera.project(place)[1] & (truth.visible[name][row] > 0 if name in truth.visible else True)
        away = np.linalg.norm(place - camera.eye_m, axis=1)
        seen_by += seen
        nearest = np.where(seen, np.minimum(nearest, away), nearest)
    return seen_by, nearest


def _is_lost(near: list[tuple[int, bool]]) -> bool:
    """Return whether a person once found was away from every track for too long."""
    since = None
    found = False
    for stamp, here in near:
        found |= here
        since = None if here else since if since is not None else stamp
        if found and since is not None and stamp - since >= LOST_S * NS_PER_S:
            return True
    return not found


def _found_s(near: list[tuple[int, bool]]) -> float:
    """Measure the time from a person's first frame to the first match [s]."""
    return next(((stamp - near[0][0]) / NS_PER_S for stamp, here in near if here), np.nan)


OURS, PAPER, BASELINE = "rgbd-head", "rgbd-head-paper", "silhouettes"
"""Trackers of the suite: ours; the paper's system from a known start; silhouettes alone, the baseline."""
FIRST, SECOND, TRAP, PEOPLE = "sequence-1", "sequence-2", "trap", "three-people"
NEEDED = (FIRST, SECOND, TRAP, PEOPLE)
EXPERIMENTS, SPREAD, CAUGHT = "experiments", "runs of one recording", "runs of the trap"
BEYOND, CHOICE = "beyond the paper", "beyond the paper, choice"
ABLATION, WHERE = "beyond the paper, ablations", "beyond the paper, where"
TIME = "time per frame"
STREAM = "rgbd-head bootstrap"
"""Random stream of the intervals."""

_UNITS = {"yaw": "°", "yaw, median": "°", "lost": "/run", "found after": "s", TIME: "ms"}
_PAPER = {
    FIRST: {"XY": 4.34, "XY, standard deviation": 2.70, "Z": 6.02, "Z, standard deviation": 2.62},
    SECOND: {"XY": 2.17, "XY, standard deviation": 1.20, "Z": 3.25, "Z, standard deviation": 1.77},
}
_CHOICES = ("heads-", "points-", "cameras-")
_ABLATIONS = (
    ("no-silhouette", "without silhouettes", ("Z", "XY")),
    ("depth-in-metres", "depth in metres, not by range", ("XY", "Z")),
    ("share-of-skin", "share instead of place of skin", ("yaw",)),
    ("direction-each", "a direction of each hypothesis", ("yaw", "XY")),
    ("one-layer", "as many hypotheses in one layer", ("XY", "Z")),
    ("one-stamp", "stamps ignored", ("XY",)),
    ("no-environment", "without the environment", ("XY", "lost")),
)
"""Ablations: tracker, omitted part, and the metrics affected."""


@dataclass(frozen=True, eq=False)
class HeadCondition(Condition):
    """n runs of a condition, with statistics as metrics, and errors of ours per run."""

    errors: Sequence[HeadErrors]


def read_conditions(runs: SuiteRuns) -> dict[str, HeadCondition]:
    """Collect every condition of the suite by name."""
    found = {}
    for name, by_seed in runs.by_condition.items():
        metrics: dict[str, list[dict[str, float]]] = {}
        errors = []
        for cases in by_seed.values():
            with case_recording(next(iter(cases.values())), runs.cache) as entry:
                truth, rig = read_truth(entry / TRUTH), Recording(entry / RECORDING).rig
            for tracker, case in cases.items():
                each = head_errors(truth, case_tracks(case, runs), rig)
                time = runs.metrics[case.id].get("ms_per_frame.mean")
                metrics.setdefault(tracker, []).append(each.statistics() | {TIME: np.nan if time is None else time})
                errors += [each] if tracker == OURS else []
        by_tracker = {
            tracker: {key: np.array([run[key] for run in of]) for key in of[0]} for tracker, of in metrics.items()
        }
        found[name] = HeadCondition(name, tuple(by_seed), by_tracker, errors)
    return found


def results_of(conditions: Mapping[str, HeadCondition]) -> list[ResultRow]:
    """Compute every result: each condition, then choices, ablations, and errors by range, cameras and posture."""
    found: list[ResultRow] = []
    for name, condition in conditions.items():
        found += _means(condition, EXPERIMENTS if name in NEEDED else BEYOND)
    return [*found, *_choices(conditions[FIRST]), *_ablations(conditions), *_where(conditions)]


def _means(condition: HeadCondition, where: str) -> Iterator[ResultRow]:
    seed = condition.seeds[0]

    def system(tracker: str, metric: str) -> SystemValue | None:
        values = condition.metrics.get(tracker, {}).get(metric, np.empty(0))
        return SystemValue.mean(tracker, values, seed, STREAM)

    for tracker, metrics in condition.metrics.items():
        if tracker.startswith(_CHOICES) or tracker in (PAPER, BASELINE):
            continue
        for row, values in metrics.items():
            others: tuple[Any, ...] = ()
            if tracker == OURS:
                others = _PAPER.get(condition.name, {}).get(row), system(PAPER, row), system(BASELINE, row)
            # a comma would separate the condition from the metric
            name = row.replace("XY, ", "XY ").replace("Z, ", "Z ").replace("yaw, ", "yaw ")
            where_in = f"{condition.name}, {name}"
            yield from ResultRow.of_runs(where, where_in, tracker, values, unit_of(row), seed, STREAM, *others)


def unit_of(metric: str) -> str:
    """Return the unit of a statistic of a run."""
    return _UNITS.get(metric, "cm")


def _choices(condition: HeadCondition) -> Iterator[ResultRow]:
    """Compare numbers of hypotheses, points and cameras in sequence 1."""
    for tracker, metrics in condition.metrics.items():
        if tracker == OURS or tracker.startswith(_CHOICES):
            name = "as chosen" if tracker == OURS else tracker.replace("-", " ")
            for row in ("XY", "Z", "yaw", "lost", TIME):
                seed = condition.seeds[0]
                yield from ResultRow.of_runs(CHOICE, name, row, metrics[row], unit_of(row), seed, STREAM)


def _ablations(conditions: Mapping[str, HeadCondition]) -> Iterator[ResultRow]:
    """Compute the effect of omitting one part, over its conditions, paired by run: without less with."""
    for tracker, what, metrics in _ABLATIONS:
        among = [each for each in conditions.values() if tracker in each.metrics]
        name = f"{what} ({', '.join(each.name for each in among)})"
        for row in metrics if among else ():
            change = np.concatenate([each.metrics[tracker][row] - each.metrics[OURS][row] for each in among])
            column, seed = f"change of {row}", among[0].seeds[0]
            yield from ResultRow.of_runs(ABLATION, name, column, change, unit_of(row), seed, STREAM)


def _where(conditions: Mapping[str, HeadCondition]) -> Iterator[ResultRow]:
    """Compute our errors by range, number of cameras that see the head, and posture, over the runs with any."""
    parts_of: dict[str, list[tuple[HeadErrors, Mask]]] = {}
    for each in (each for name in (FIRST, SECOND, PEOPLE) for each in conditions[name].errors):
        for name, mask in _classes(each).items():
            parts_of.setdefault(name, []).extend([(each, mask)] if mask.any() else [])
    for name, parts in parts_of.items():
        metrics = {
            "XY": [each.xy_cm[mask].mean() for each, mask in parts],
            "Z": [100 * np.abs(each.off_m[mask, 2]).mean() for each, mask in parts],
            "yaw": [each.yaw_deg[mask].mean() for each, mask in parts],
        }
        for row, values in metrics.items():
            seed = conditions[FIRST].seeds[0]
            yield from ResultRow.of_runs(WHERE, name, row, np.array(values), unit_of(row), seed, STREAM)


def _classes(errors: HeadErrors) -> dict[str, Mask]:
    """Return which matches are in each class, by its name."""
    range_m, seen_by = errors.range_m, errors.seen_by
    return {
        **{f"nearest camera {low} to {low + 1} m": (range_m >= low) & (range_m < low + 1) for low in (1, 2, 3, 4)},
        **{f"seen by {count} cameras": seen_by == count for count in (1, 2, 3, 4)},
        "upright": ~errors.seated,
        "seated or bent": errors.seated,
    }
