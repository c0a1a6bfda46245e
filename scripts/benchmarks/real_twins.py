"""Do trackers rank on twins of real recordings as they rank on these?

Each tracker gets one figure: F1 of people in the labelled sector within 0.5 m, one to one, scan by scan; on twins the mean over
seeds. Blocks of a recording, drawn with replacement, and seeds of its twin give the intervals: the same blocks on both sides,
since a twin repeats its recording second by second. Nothing is tuned on the outcome.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from benchmarks.figure import Figure
from benchmarks.recorded_legs import DATA
from benchmarks.recorded_twin import HEIGHTS_M, Labelled, make_twin, recording, walks_of
from trackers.area import Pose
from trackers.arrays import Array
from trackers.feeding import track_frames
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser.legs.classifier import shipped
from trackers.laser.legs.features import leg_clusters
from trackers.observations import NS_PER_S, LaserScan
from trackers.presets import make_tracker
from trackers.rig import LaserSensor, Rig

TRACKERS = ("sort", "laser-kalman", "laser-imm", "laser-vision-learning-laser", "laser-legs", "fusion")
TAUGHT_BY_TWINS = ("laser-legs", "fusion")
"""Both weigh clusters by the classifier of legs that was learned on twins."""
_RECORDINGS = (1, 2, 3)
_SEEDS = tuple(range(1000, 1008))
_TRACKER_SEED = 1000
_GATE_M = 0.5
_EDGE_M = 0.25
"""A track this near to the edge of the sector may be of a person whose legs are beyond it [m]."""
_BLOCK_S = 3.0
_DRAWS = 2000
_HALVES = 500

_MISSED, _UNMET, _FALSE, _DOUBLE, _SWITCHED, _AWAY, _RIGHT, _THERE = range(8)
"""Columns of counts: people missed, of these before a track first found them, false tracks, more tracks of a person, switches,
distances [m], people found, all people."""


@dataclass(frozen=True)
class _Sides:
    """Counts of a recording, (trackers, blocks, 8), and of its twins, (seeds, trackers, blocks, 8)."""

    real: Array
    twin: Array


def measure() -> Iterator[Figure]:
    """Yield the figures of each tracker on each recording and on its twins, rank correlations, and pairs in another order."""
    if not DATA.is_dir():
        print(f"real-twins: skipped, there are no recorded scans at {DATA}", file=sys.stderr)
        return
    sides = []
    for number in _RECORDINGS:
        real = recording(number)
        twins = [make_twin(real, seed) for seed in _SEEDS]
        yield from _likeness(f"positive_{number}", real, twins)
        walks, blocks = walks_of(real), _blocks(real.scans)
        each = _Sides(
            np.array([_counts(name, real, walks, blocks) for name in TRACKERS]),
            np.array([[_counts(name, twin, walks, blocks) for name in TRACKERS] for twin in twins]),
        )
        sides.append(each)
        scores = np.array([_f1(each.real), _f1(each.twin).mean(axis=0)])
        for tracker, (on_real, on_twin) in zip(TRACKERS, scores.T.tolist(), strict=True):
            yield Figure(f"positive_{number}, {tracker}: F1 on the recording, {len(real.scans)} scans", on_real, "", "")
            yield Figure(f"positive_{number}, {tracker}: F1 on its twin, {len(real.scans)} scans", on_twin, "", "")
        yield from _ranked(f"positive_{number}", scores)
    yield from _together(sides)


def f1(name: str, labels: Labelled) -> float:
    """Return the F1 of a tracker's tracks in the sector against people, one to one within the gate."""
    return float(_f1(_counts(name, labels, [], np.zeros(len(labels.scans), np.intp))))


def _f1(counts: Array) -> Array:
    """Return F1 (...) of counts (..., blocks, 8)."""
    total = counts.sum(axis=-2)
    right = 2 * total[..., _RIGHT]
    return right / np.maximum(right + total[..., _MISSED] + total[..., _FALSE] + total[..., _DOUBLE], 1)


def _blocks(scans: Sequence[LaserScan]) -> NDArray[np.intp]:
    """Return the number of the block of each scan: parts of a stretch without a gap, of about the same length."""
    t = np.array([scan.t for scan in scans])
    number, first = [], 0
    for stretch in np.split(t, np.flatnonzero(np.diff(t) > 1.0) + 1):
        n_block = max(1, round(float(stretch[-1] - stretch[0]) / _BLOCK_S))
        number.append(first + np.arange(len(stretch)) * n_block // len(stretch))
        first += n_block
    return np.concatenate(number)


def _counts(name: str, labels: Labelled, walks: Sequence[Array], blocks: NDArray[np.intp]) -> Array:
    """Return the counts (blocks, 8) of a tracker."""
    rig = Rig(
        sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(0, 0, float(np.mean(HEIGHTS_M)))))}
    )
    tracker = make_tracker(name, rig, (), np.random.default_rng(_TRACKER_SEED))
    frames = {frame.stamp_ns: frame for frame in track_frames(tracker, rig, labels.scans)}
    counts, followed = np.zeros((blocks[-1] + 1, 8)), dict[int, int]()
    for scan, block in zip(labels.scans, blocks.tolist(), strict=True):
        people, tracks = labels.people[scan.stamp_ns], frames[scan.stamp_ns].tracks if scan.stamp_ns in frames else ()
        places = np.array([[each.x, each.y] for each in tracks]).reshape(-1, 2)
        away = distances(people, places)
        person, track = max_weight_assignment(np.where(away < _GATE_M, _GATE_M - away, 0.0))
        near = (away < _GATE_M).any(axis=0)
        row = counts[block]
        row[_THERE] += len(people)
        row[_RIGHT] += len(person)
        row[_MISSED] += len(people) - len(person)
        row[_DOUBLE] += int(near.sum()) - len(person)
        row[_FALSE] += int((labels.sector.holds(places, _EDGE_M) & ~near).sum())
        row[_AWAY] += float(away[person, track].sum())
        t = (scan.stamp_ns - labels.scans[0].stamp_ns) / NS_PER_S
        for one, other in zip(person.tolist(), track.tolist(), strict=True):
            if (walk := _walk_at(walks, t, people[one])) is not None:
                row[_SWITCHED] += followed.setdefault(walk, tracks[other].id) != tracks[other].id
                followed[walk] = tracks[other].id
        for one in np.setdiff1d(np.arange(len(people)), person).tolist():
            row[_UNMET] += _walk_at(walks, t, people[one]) not in {None, *followed}
    return counts


def _walk_at(walks: Sequence[Array], t: float, place: Array) -> int | None:
    """Return the number of the walk nearest to a place at a time, None where none is within the gate."""
    now = [number for number, walk in enumerate(walks) if walk[0, 0] <= t <= walk[-1, 0]]
    at = np.array([[np.interp(t, walks[number][:, 0], walks[number][:, axis]) for axis in (1, 2)] for number in now])
    away = distances(at.reshape(-1, 2), place[None])[:, 0]
    return now[int(away.argmin())] if away.min(initial=_GATE_M) < _GATE_M else None


def _likeness(name: str, real: Labelled, twins: Sequence[Labelled]) -> Iterator[Figure]:
    """Yield how alike labelled legs are on both sides: number, width, gap, and what the classifier makes of them."""
    measured: tuple[tuple[str, Callable[[Labelled], float]], ...] = (
        ("people a scan", lambda each: sum(map(len, each.people.values())) / len(each.scans)),
        ("labelled legs a person", lambda each: len(each.legs) / sum(map(len, each.people.values()))),
        ("width of a labelled cluster, median [m]", lambda each: float(np.median(each.widths_m))),
        ("gap of a person's legs, median [m]", lambda each: float(np.median(each.gaps_m))),
        ("evidence of a labelled leg, lowest tenth [nat]", lambda each: float(np.quantile(_evidence(each), 0.1))),
        ("labelled legs that count as none [%]", lambda each: 100 * float((_evidence(each) < 0).mean())),
    )
    for row, of in measured:
        for column, value in (("recording", of(real)), ("its twins", float(np.mean([of(each) for each in twins])))):
            yield Figure(f"{name}, {row}: {column}, {len(real.scans)} scans", value, "", "")


def _evidence(labels: Labelled) -> Array:
    """Return what the shipped classifier says for each label (k,) [nat], of the cluster nearest to it."""
    found = []
    for place, scan in enumerate(labels.scans):
        clusters = leg_clusters(scan)
        away = distances(labels.legs[labels.legs[:, 0] == place, 1:], clusters.middle)
        if away.size:
            found.append(shipped().evidence(scan, clusters)[away.argmin(axis=1)])
    return np.concatenate(found)


def _ranked(name: str, scores: Array) -> Iterator[Figure]:
    """Yield rank correlation and distance of scores (2, trackers): of all, and of those that no twin taught."""
    for which, some in _chosen():
        yield Figure(f"{name}: rank correlation of {len(some)}, {which}", _correlation(*scores[:, some]), "", ">= 0.9")
        apart = float(np.abs(scores[1, some] - scores[0, some]).mean())
        yield Figure(f"{name}: mean difference of F1, {which}", apart, "", "")


def _chosen() -> tuple[tuple[str, list[int]], ...]:
    untaught = [place for place, tracker in enumerate(TRACKERS) if tracker not in TAUGHT_BY_TWINS]
    return ("all trackers", list(range(len(TRACKERS)))), ("trackers that no twin taught", untaught)


def _correlation(one: Array, other: Array) -> float:
    """Return Spearman's rank correlation; 0 where one side does not order at all."""
    ranks = np.array([rankdata(one), rankdata(other)])
    if (ranks == ranks[:, :1]).all(axis=1).any():
        return 0.0
    return round(float(np.corrcoef(ranks)[0, 1]), 9)  # a fraction, so that 0.9 is 0.9


def _together(sides: Sequence[_Sides]) -> Iterator[Figure]:
    """Yield figures of all recordings together: the means' correlation with its interval, errors by kind, and pairs."""
    rng = np.random.default_rng(_TRACKER_SEED)
    scores = np.array([_mean_f1([each.real for each in sides]), _mean_f1([each.twin.mean(axis=0) for each in sides])])
    yield from _ranked("mean of the three", scores)
    drawn = np.array([_draw(sides, rng) for _ in range(_DRAWS)])  # (draws, 2, trackers)
    halves = [_split(sides, rng) for _ in range(_HALVES)]
    for which, some in _chosen():
        low, high = np.quantile([_correlation(*each[:, some]) for each in drawn], (0.025, 0.975)).tolist()
        yield Figure(f"mean of the three: low end of 95 %, {which}", low, "", "")
        yield Figure(f"mean of the three: high end of 95 %, {which}", high, "", "")
        between = float(np.mean([_correlation(*each[:, some]) for each in halves]))
        yield Figure(f"one half of the recordings against the other: rank correlation, {which}", between, "", "")
    yield from _errors(sides)
    yield from _pairs(scores, drawn)


def _mean_f1(counts: Sequence[Array]) -> Array:
    return np.mean([_f1(each) for each in counts], axis=0)


def _draw(sides: Sequence[_Sides], rng: np.random.Generator) -> Array:
    """Return scores (2, trackers) of blocks and seeds drawn with replacement, the same blocks on both sides."""
    real, twin = [], []
    for each in sides:
        block = rng.integers(each.real.shape[1], size=each.real.shape[1])
        real.append(each.real[:, block])
        twin.append(each.twin[rng.integers(len(each.twin), size=len(each.twin))].mean(axis=0)[:, block])
    return np.array([_mean_f1(real), _mean_f1(twin)])


def _split(sides: Sequence[_Sides], rng: np.random.Generator) -> Array:
    """Return scores (2, trackers) of the recordings: of one half of their blocks, and of the other."""
    halves: tuple[list[Array], list[Array]] = ([], [])
    for each in sides:
        block = rng.permutation(each.real.shape[1])
        halves[0].append(each.real[:, block[::2]])
        halves[1].append(each.real[:, block[1::2]])
    return np.array([_mean_f1(half) for half in halves])


def _errors(sides: Sequence[_Sides]) -> Iterator[Figure]:
    """Yield the errors of each tracker by kind, of 100 people."""
    for place, tracker in enumerate(TRACKERS):
        for where, counts in (
            ("recordings", np.sum([each.real[place].sum(axis=0) for each in sides], axis=0)),
            ("twins", np.sum([each.twin[:, place].mean(axis=0).sum(axis=0) for each in sides], axis=0)),
        ):
            per_100 = 100 * counts / counts[_THERE]
            for column, value in (
                ("missed", per_100[_MISSED]),
                ("of these before any track", per_100[_UNMET]),
                ("false", per_100[_FALSE]),
                ("doubles", per_100[_DOUBLE]),
                ("switches", per_100[_SWITCHED]),
                ("cm off", 100 * counts[_AWAY] / counts[_RIGHT]),
            ):
                yield Figure(f"errors of 100 people, {tracker}: {column}, {where}", float(value), "", "")


def _pairs(scores: Array, drawn: Array) -> Iterator[Figure]:
    """Yield the differences, with intervals, of trackers in another order on twins; and how many pairs recordings tell apart."""
    changed = apart = kept = 0
    for one, other in combinations(np.argsort(-scores[0], kind="stable").tolist(), 2):
        (on_real, on_twin), spread = scores[:, one] - scores[:, other], drawn[..., one] - drawn[..., other]
        (real_low, twin_low), (real_high, twin_high) = np.quantile(spread, (0.025, 0.975), axis=0)
        is_kept, is_apart = bool(on_real * on_twin > 0), bool(real_low > 0 or real_high < 0)
        changed, apart, kept = changed + (not is_kept), apart + is_apart, kept + (is_kept and is_apart)
        if is_kept:
            continue
        for column, value in (
            ("on the recordings", on_real), ("from", real_low), ("to", real_high),
            ("on twins", on_twin), ("twins from", twin_low), ("twins to", twin_high),
        ):  # fmt: skip
            name = f"difference of F1, {TRACKERS[one]} over {TRACKERS[other]}: {column}, mean of the three"
            yield Figure(name, float(value), "", "")
    n_pair = len(TRACKERS) * (len(TRACKERS) - 1) // 2
    yield Figure("pairs of trackers in another order on twins", changed, f"of {n_pair}", "")
    yield Figure("pairs of trackers that the recordings tell apart", apart, f"of {n_pair}", "")
    yield Figure(
        "pairs that the recordings tell apart and that are in the same order on twins", kept, f"of {apart}", ""
    )
