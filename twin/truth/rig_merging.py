"""Merged for the rig: two people whom all its scanners together cannot separate in a frame.

The ideal points of all scanners lie in one picture of the floor, each scanner's latest. Two people are merged while
single linkage at `LINKAGE_M` puts points of both into one cluster (`joined`), or while one of them, whom some scanner has
in its plane and field, returns no beam to any, and the other, who does, is less than 1.5 m away (`hidden`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from trackers.observations import NS_PER_S, LaserScan
from twin.truth.pairs import Pair
from twin.truth.situations import Held
from twin.truth.visibility import SensorView

LINKAGE_M = 0.4
_LATEST_S = 0.25
"""A scan that is older than this says no more where people are [s]."""


@dataclass(frozen=True, eq=False)
class Look:
    """What one scanner meets of people at a stamp: points (k, 2) [m] on the floor, and on whom each is (k,).

    unmet: whom it has in its plane and field, near somebody, and meets with no beam.
    """

    stamp_ns: int
    points: NDArray[np.float64]
    ids: NDArray[np.int16]
    unmet: frozenset[int] = frozenset()


def look_of(scan: LaserScan, person_of_ray: NDArray[np.int16], view: SensorView, unmet: frozenset[int]) -> Look:
    """A look from an ideal scan and the ids (n_beam,) of whom its beams meet, 0 for the room."""
    beams = np.flatnonzero((person_of_ray > 0) & np.isfinite(scan.ranges_m))
    angle = scan.angle_min_rad + scan.angle_increment_rad * beams
    ahead = scan.ranges_m[beams].astype(np.float64) * np.stack([np.cos(angle), np.sin(angle)])
    points = view.room_from_sensor_xyz[:2] + (view.room_from_sensor_rotation[:2, :2] @ ahead).T
    return Look(scan.stamp_ns, points, person_of_ray[beams], unmet)


def merged_pairs(
    looks: Mapping[str, Look], stamp_ns: int, near: Mapping[Pair, float], place_m: Mapping[int, NDArray[np.float64]]
) -> dict[Pair, Held]:
    """The pairs that the scanners cannot separate at a stamp, by the latest look of each.

    near: distance [m] of the pairs that are less than 1.5 m apart; place_m: where everybody is, (2,) [m] by id.
    """
    latest = [look for look in looks.values() if stamp_ns - look.stamp_ns <= _LATEST_S * NS_PER_S]
    ids = np.concatenate([look.ids for look in latest])
    met = set(ids.tolist())
    unmet = frozenset().union(*(look.unmet for look in latest)) - met
    merged = {
        pair: Held("hidden", apart_m)
        for pair, apart_m in near.items()
        if unmet.intersection(pair) and met.intersection(pair)
    }
    for first, second in linked_pairs(np.concatenate([look.points for look in latest]), ids):
        merged[first, second] = Held("joined", float(np.hypot(*(place_m[first] - place_m[second]))))
    return merged


def linked_pairs(points: NDArray[np.float64], ids: NDArray[np.int16]) -> set[Pair]:
    """Pairs of people (ids (k,) of points (k, 2) [m]) with points in one cluster of single linkage at `LINKAGE_M`."""
    if not len(points):
        return set()
    links = KDTree(points).query_pairs(LINKAGE_M, output_type="ndarray")
    if (ids[links[:, 0]] == ids[links[:, 1]]).all():
        return set()
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(points), len(points)))
    cluster = connected_components(graph, directed=False)[1]
    members = np.unique(np.stack([cluster, ids], axis=1), axis=0)  # by cluster, then id
    crowds = np.split(members[:, 1], np.flatnonzero(np.diff(members[:, 0])) + 1)
    return {pair for crowd in crowds for pair in combinations(crowd.tolist(), 2)}
