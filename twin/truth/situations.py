"""Situations of two people that make tracking hard, from the frame in which one begins to the first after it.

- interaction: the ground points under their pelvises are less than 1.5 m apart. least_m: the least distance [m].
- correlated: the gap between their outlines, seen from above, is below 0.3 m (outlines: `twin.truth.body_outlines`). least_m:
  the smallest gap [m], 0 where outlines overlap.
- merged: one scanner cannot separate the two, judged by its ideal scan. One event per scanner; its end is the split. how:
  `joined` where beams on both belong to one cluster; `hidden` where one of them returns no beam since the other stands before
  it, less than 1.5 m away (a person hidden from farther away is only occluded: visible_<sensor> in truth.csv); `both` where an
  event holds frames of either sort. least_m: as of an interaction.
- merged_rig: all scanners of the rig together cannot separate the two, whatever a tracker makes of it. Breaks of up to 0.4 s
  belong to the event; events shorter than 0.2 s are dropped. how and least_m: as of merged.

A cluster of one scanner: consecutive beams on people, with at most one beam between them that misses people, whose points lie
no farther apart than 0.15 m plus two spacings of the beams at the nearer one's range. Clusters do not continue from the last
beam of a full turn to the first.

Merged for the rig: the ideal points of all scanners, each scanner's latest, lie in one picture of the floor. Two people are
merged while single linkage at `LINKAGE_M` puts points of both into one cluster (`joined`), or while one of them, in the plane
and field of some scanner, returns no beam to any scanner, and the other, who does, is less than 1.5 m away (`hidden`).

Frames of interaction and correlation are the stamps of all sensors, frames of merging those of the scanner, or of all
scanners. All this holds for people in the room, inside the tracked area or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import nan

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, LaserScan
from twin.truth.truth_types import Separation, Situation, SituationKind
from twin.truth.visibility import SensorView

INTERACTION_M = 1.5
CORRELATED_M = 0.3
JUMP_M = 0.15
JUMP_SPACINGS = 2.0
MAX_GAP_BEAMS = 1
RIG_BREAK_S = 0.4
RIG_SHORTEST_S = 0.2
_BREAK_NS: Mapping[SituationKind, int] = {"merged_rig": round(RIG_BREAK_S * NS_PER_S)}
_SHORTEST_NS: Mapping[SituationKind, int] = {"merged_rig": round(RIG_SHORTEST_S * NS_PER_S)}


@dataclass(frozen=True, slots=True)
class PairState:
    """State of a pair while a situation holds in a frame: the kind of separation lost, and the distance [m]."""

    how: Separation = ""
    least_m: float = nan


@dataclass(slots=True)
class _Open:
    start_ns: int
    how: Separation
    least_m: float
    break_ns: int | None = None  # start of a tolerated break


class OpenSituations:
    """Current situations, frame by frame; a tolerated break does not end one."""

    def __init__(self) -> None:
        self._open: dict[tuple[SituationKind, str], dict[Pair, _Open]] = {}

    @property
    def first_break_ns(self) -> int | None:
        """Start of the first break that may still end [ns]; None without one."""
        breaks = [one.break_ns for open_ in self._open.values() for one in open_.values() if one.break_ns is not None]
        return min(breaks, default=None)

    def update(
        self, kind: SituationKind, sensor: str, stamp_ns: int, holding: Mapping[Pair, PairState]
    ) -> list[Situation]:
        """Return the situations that end with this frame, by pair; `holding`: the pairs (first id < second id) in which it
        holds.
        """
        open_ = self._open.setdefault((kind, sensor), {})
        ended = []
        for pair in sorted(open_.keys() - holding.keys()):
            one = open_[pair]
            one.break_ns = stamp_ns if one.break_ns is None else one.break_ns
            if stamp_ns - one.break_ns >= _BREAK_NS.get(kind, 0):
                ended += _situation(kind, sensor, pair, open_.pop(pair), stamp_ns)
        for pair in sorted(holding):
            held = holding[pair]
            one = open_.get(pair)
            if one is None:
                open_[pair] = _Open(stamp_ns, held.how, held.least_m)
            else:
                one.break_ns = None
                one.how = one.how if one.how == held.how else "both"
                one.least_m = min(one.least_m, held.least_m)
        return ended

    def finish(self, end_ns: int) -> list[Situation]:
        """Return the situations that hold at the end of the run, by kind, sensor and pair."""
        rest = [
            situation
            for (kind, sensor), open_ in sorted(self._open.items())
            for pair in sorted(open_)
            for situation in _situation(kind, sensor, pair, open_[pair], end_ns)
        ]
        self._open.clear()
        return rest


def _situation(kind: SituationKind, sensor: str, pair: Pair, one: _Open, end_ns: int) -> list[Situation]:
    """Return a situation if long enough: complete if it no longer holds, else up to the end of the run."""
    complete = one.break_ns is not None
    end_ns = one.break_ns if one.break_ns is not None else end_ns
    if end_ns - one.start_ns < _SHORTEST_NS.get(kind, 0):
        return []
    return [Situation(kind, *pair, sensor, one.start_ns, end_ns, complete, one.how, one.least_m)]


def joined_pairs(
    range_m: NDArray[np.floating], person_of_ray: NDArray[np.int16], angle_increment_rad: float
) -> set[Pair]:
    """Find pairs of people with beams in one cluster of an ideal scan: ranges [m] and ids, both (n_beam,)."""
    beams = ((person_of_ray > 0) & np.isfinite(range_m)).nonzero()[0]
    person = person_of_ray[beams]
    following = np.array([beams[:-1], beams[1:]])
    changes = person[1:] != person[:-1]
    # in most scans no cluster spans two people
    at_changes = _splits(range_m, following[:, changes], angle_increment_rad)
    if np.count_nonzero(at_changes) == at_changes.size:
        return set()
    cluster = np.concatenate([[0], np.cumsum(_splits(range_m, following, angle_increment_rad))])
    pairs: set[Pair] = set()
    for number in np.unique(cluster[1:][changes]):
        pairs.update(combinations(np.unique(person[cluster == number]).tolist(), 2))
    return pairs


def _splits(range_m: NDArray[np.floating], beams: NDArray[np.intp], angle_increment_rad: float) -> NDArray[np.bool_]:
    """Return True where a cluster ends between two consecutive beams on people, (n,) of the pairs `beams` (2, n)."""
    near, angle = range_m[beams].astype(np.float64), angle_increment_rad * beams
    across, along = near * np.sin(angle), near * np.cos(angle)
    step = np.hypot(along[1] - along[0], across[1] - across[0])
    spacing = abs(angle_increment_rad) * np.minimum(near[1], near[0])
    return (step > JUMP_M + JUMP_SPACINGS * spacing) | (beams[1] - beams[0] > MAX_GAP_BEAMS + 1)


Pair = tuple[int, int]


@lru_cache(maxsize=256)
def every_pair(count: int) -> NDArray[np.intp]:
    """Return all pairs of `count` people, (count · (count - 1) / 2, 2) indices, first < second; read-only."""
    pairs = np.stack(np.triu_indices(count, k=1), axis=1)
    pairs.flags.writeable = False
    return pairs


def ordered_pairs(first: NDArray[np.integer], second: NDArray[np.integer]) -> list[Pair]:
    """Convert pairs of ids (m,) to tuples, the smaller first."""
    return list(zip(np.minimum(first, second).tolist(), np.maximum(first, second).tolist(), strict=True))


def pairs_within(ids: NDArray[np.integer], place_m: NDArray[np.float64], limit_m: float) -> dict[Pair, float]:
    """Return the distance [m] of pairs of people, ids (n,) at places (n, 2) [m], that are less than `limit_m` apart."""
    first, second = every_pair(len(ids)).T
    apart = np.hypot(*(place_m[first] - place_m[second]).T)
    near = (apart < limit_m).nonzero()[0]
    return dict(zip(ordered_pairs(ids[first[near]], ids[second[near]]), apart[near].tolist(), strict=True))


LINKAGE_M = 0.4
_IDS = np.iinfo(np.int16).max + 1
_LATEST_S = 0.25
"""Age beyond which a scan no longer shows where people are [s]."""


@dataclass(frozen=True, eq=False)
class ScanPoints:
    """Points of one scanner on people at a stamp: points (k, 2) [m] on the floor, and the id of each (k,).

    unmet: people in its plane and field, near another person, without any beam.
    """

    stamp_ns: int
    points: NDArray[np.float64]
    ids: NDArray[np.int16]
    unmet: frozenset[int] = frozenset()


def scan_points(
    scan: LaserScan, person_of_ray: NDArray[np.int16], view: SensorView, unmet: frozenset[int]
) -> ScanPoints:
    """Convert an ideal scan and the person ids (n_beam,) of its beams, 0 for the room, to points on people."""
    beams = ((person_of_ray > 0) & np.isfinite(scan.ranges_m)).nonzero()[0]
    angle = scan.angle_min_rad + scan.angle_increment_rad * beams
    ahead = scan.ranges_m[beams].astype(np.float64) * np.array([np.cos(angle), np.sin(angle)])
    points = view.room_from_sensor_xyz[:2] + (view.room_from_sensor_rotation[:2, :2] @ ahead).T
    return ScanPoints(scan.stamp_ns, points, person_of_ray[beams], unmet)


def merged_pairs(
    looks: Mapping[str, ScanPoints],
    stamp_ns: int,
    near: Mapping[Pair, float],
    place_m: Mapping[int, NDArray[np.float64]],
) -> dict[Pair, PairState]:
    """Find the pairs that the scanners cannot separate at a stamp, by the latest points of each.

    near: distance [m] of the pairs less than 1.5 m apart; place_m: position of each person present, (2,) [m] by id. An
    earlier scan may show a person who has left since: they are in no pair.
    """
    latest = [look for look in looks.values() if stamp_ns - look.stamp_ns <= _LATEST_S * NS_PER_S]
    ids = np.concatenate([look.ids for look in latest])
    met = set(ids.tolist())
    unmet = frozenset().union(*(look.unmet for look in latest)) - met
    merged = {
        pair: PairState("hidden", apart_m)
        for pair, apart_m in near.items()
        if unmet.intersection(pair) and met.intersection(pair)
    }
    points = np.concatenate([look.points for look in latest])
    if left := met - place_m.keys():
        there = ~np.isin(ids, list(left))
        points, ids = points[there], ids[there]
    for first, second in linked_pairs(points, ids):
        merged[first, second] = PairState("joined", float(np.hypot(*(place_m[first] - place_m[second]))))
    return merged


def linked_pairs(points: NDArray[np.float64], ids: NDArray[np.int16]) -> set[Pair]:
    """Find pairs of people (ids (k,) of points (k, 2) [m]) in one cluster of single linkage at `LINKAGE_M`."""
    points, ids = _near_another(points, ids)
    if not len(points):
        return set()
    links = _close_pairs(points)
    if (ids[links[:, 0]] == ids[links[:, 1]]).all():
        return set()
    cluster = _clusters(links, len(points))
    crowd, member = np.divmod(np.unique(cluster * _IDS + ids), _IDS)  # by cluster, then id
    crowds = np.split(member, np.flatnonzero(np.diff(crowd)) + 1)
    return {pair for crowd in crowds for pair in combinations(crowd.tolist(), 2)}


def _near_another(points: NDArray[np.float64], ids: NDArray[np.int16]) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    """Return the points, person by person, and ids of the people whose points' bounding box is within `LINKAGE_M` of
    another's.
    """
    if not len(points):
        return points, ids
    order = ids.argsort(kind="stable")
    points, ids = points[order], ids[order]
    first = np.concatenate([[0], (ids[1:] != ids[:-1]).nonzero()[0] + 1])
    low, high = np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)
    gap = np.maximum(np.maximum(low[:, None] - high, low - high[:, None]), 0.0)  # (n, n, 2)
    near = np.hypot(gap[..., 0], gap[..., 1]) <= LINKAGE_M + 1e-9
    kept = (near.sum(axis=1) > 1).repeat(np.append(first[1:], len(ids)) - first)
    return points[kept], ids[kept]


def _close_pairs(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the pairs (m, 2) of points (k, 2) no farther apart than `LINKAGE_M`, found along x."""
    order = points[:, 0].argsort()
    x, y = points[order].T
    after = np.arange(1, len(x) + 1)
    counts = x.searchsorted(x + LINKAGE_M + 1e-9, side="right") - after
    first = np.repeat(after - 1, counts)
    second = np.arange(len(first)) + np.repeat(after - counts.cumsum() + counts, counts)
    near = (x[first] - x[second]) ** 2 + (y[first] - y[second]) ** 2 <= LINKAGE_M**2
    return np.array([order[first[near]], order[second[near]]]).T


def _clusters(links: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Return for each of `count` points the first of its cluster, points joined by links (m, 2).

    Like scipy's `connected_components`, whose checks take longer than joining a few hundred points.
    """
    first, (one, other) = np.arange(count), links.T
    while True:
        lower = first.copy()
        np.minimum.at(lower, one, first[other])
        np.minimum.at(lower, other, first[one])
        if np.array_equal(lower, first):
            return first
        first = lower[lower]  # follow the chain to its present first member
