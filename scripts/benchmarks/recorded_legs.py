"""Labelled legs of a real scanner against the clusters that are left once the background is learned from the same scans."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from leg_classifier.judge import judge
from numpy.typing import NDArray

from benchmarks.figure import Figure
from trackers.arrays import Array
from trackers.laser.background import LearnedBackground
from trackers.laser.bearings import returns
from trackers.laser.clusters import find_clusters
from trackers.laser.layer import KneeOptions
from trackers.laser.legs.classifier import shipped
from trackers.observations import NS_PER_S, LaserScan

DATA = Path(__file__).parents[3] / "shared" / "data" / "lasers"
LEARNING_S = 5.0
"""Until then a background learned causally is not yet one: the first scans show people and room alike."""

_WITHIN_M = 0.15
_FURNITURE_M = 0.1
_FURNITURE_SHARE = 0.5
_LEAST_AUC = {1: 0.95, 2: 0.95, 3: 0.9}


def measure() -> Iterator[Figure]:
    """Recall of labelled legs and clusters a scan, before any background and after it was learned; nothing is tuned here.

    A few labels lie on something that stands in the same place in most scans of the recording: the labelling took all
    clusters in a sector. No background keeps those; they are counted apart.
    """
    if not DATA.is_dir():
        print(f"labelled-legs: skipped, there are no recorded scans at {DATA}", file=sys.stderr)
        return
    areas = judge(shipped(), DATA)
    for number in (1, 2, 3):
        scans, legs = labelled(number)
        background, options = LearnedBackground(), KneeOptions().cluster
        every = [find_clusters(scan, returns(scan)[1], options).middle for scan in scans]
        left = [find_clusters(scan, background.foreground(scan), options).middle for scan in scans]
        t = np.array([scan.t - scans[0].t for scan in scans])
        settled = t >= LEARNING_S
        after, furniture = settled[legs[:, 0].astype(int)], on_furniture(scans, legs)
        name = f"positive_{number}"
        yield Figure(f"{name}: labelled legs found among all clusters", recall(every, legs), "", ">= 0.99")
        yield Figure(f"{name}: the same after the background", recall(left, legs[after & ~furniture]), "", ">= 0.99")
        yield Figure(f"{name}: the same, labels on furniture counted", recall(left, legs[after]), "", "")
        yield Figure(f"{name}: the same, from the first scan on", recall(left, legs), "", "")
        auc, auc_known = areas[number]
        name_of_auc = f"{name}: AUC of the classifier of legs"
        yield Figure(f"{name_of_auc}, without what moves and has no label", auc_known, "", f">= {_LEAST_AUC[number]}")
        yield Figure(f"{name_of_auc}, with it as no legs", auc, "", "")
        yield Figure(f"{name}: labels on furniture", int(furniture.sum()), f"of {len(legs)}", "")
        for which, found in (("before", every), ("after", left)):
            n = float(np.mean([len(middle) for middle, late in zip(found, settled, strict=True) if late]))
            yield Figure(f"{name}: clusters a scan {which} the background", n, "", "")


def labelled(number: int) -> tuple[list[LaserScan], Array]:
    """The scans of positive_<number>_extracted.npz and its labelled legs (scan, x, y) [m], (k, 3)."""
    with np.load(DATA / f"positive_{number}_extracted.npz") as file:
        angle_min, increment, range_min, range_max, _ = (
            float(value) for value in file["scan_amin_inc_rmin_rmax_scantime"]
        )
        scans = [
            LaserScan("scan", round(t * NS_PER_S), ranges, angle_min, increment, range_min, range_max)
            for t, ranges in zip(file["scan_stamp"], file["scan_ranges"], strict=True)
        ]
        return scans, file["legs_scanidx_x_y"]


def recall(found: list[Array], legs: Array) -> float:
    """Share of labelled legs (scan, x, y) with a cluster's middle within 0.15 m."""
    gaps = [np.hypot(*(found[int(k)] - (x, y)).T).min(initial=np.inf) for k, x, y in legs]
    return float(np.mean(np.array(gaps) < _WITHIN_M))


def on_furniture(scans: list[LaserScan], legs: Array) -> NDArray[np.bool_]:
    """Which labels (k,) have a return within 0.1 m in the same beam in at least half of all scans."""
    ranges = np.stack([scan.ranges_m for scan in scans])
    bearing, label_range = np.arctan2(legs[:, 2], legs[:, 1]), np.hypot(legs[:, 1], legs[:, 2])
    beam = np.abs(scans[0].angles_rad - bearing[:, None]).argmin(axis=1)
    same = np.abs(ranges[:, beam] - label_range) < _FURNITURE_M  # (scan, k)
    return same.mean(axis=0) >= _FURNITURE_SHARE
