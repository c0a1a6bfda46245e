"""The classifier on labelled scans of a real scanner (the leg_tracker data set), of which nothing was learned.

A cluster is a leg where it is the nearest to a label that lies on it, and where the scanner does not see the same in most scans.
The labelling took all clusters in a sector: furniture there has labels, and people beyond it have none. So the area under the
curve is given with all other clusters as no legs, and without those that stand in front of what the scanner saw there otherwise,
which are most likely people.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from sklearn.metrics import roc_auc_score

from trackers.filters.gating import distances
from trackers.laser.legs.classifier import LegClassifier
from trackers.laser.legs.features import leg_clusters
from trackers.observations import NS_PER_S, LaserScan

_ON_M = 0.1
_SAME_M, _STANDING = 0.15, 0.3
"""A cluster is the room's where the beam through it came as far in this share of all scans."""


def judge(classifier: LegClassifier, folder: Path) -> dict[int, tuple[float, float]]:
    """Print, and return, the two areas under the curve of each recording that is there."""
    found = {}
    for number in (1, 2, 3):
        path = folder / f"positive_{number}_extracted.npz"
        if not path.is_file():
            print(f"{path}: is not there", file=sys.stderr)
            continue
        with np.load(path) as file:
            first, step, least, most, _ = (float(each) for each in file["scan_amin_inc_rmin_rmax_scantime"])
            ranges, legs, stamps = file["scan_ranges"], file["legs_scanidx_x_y"], file["scan_stamp"]
        score, is_leg, is_room = [], [], []
        for place, row in enumerate(ranges):
            scan = LaserScan("scan", round(stamps[place] * NS_PER_S), row, first, step, least, most)
            clusters = leg_clusters(scan)
            labels = legs[legs[:, 0] == place, 1:]
            apart = distances(labels, clusters.middle)
            on = np.zeros(len(clusters), np.bool_)
            on[apart.argmin(axis=1)[apart.min(axis=1) < _ON_M] if apart.size else []] = True
            beam = (clusters.first_beam + clusters.last_beam) // 2
            score.append(classifier.evidence(scan, clusters))
            is_leg.append(on)
            is_room.append((np.abs(ranges[:, beam] - clusters.range_m) < _SAME_M).mean(axis=0) > _STANDING)
        scores, has_label, room = (np.concatenate(each) for each in (score, is_leg, is_room))
        legs_ = has_label & ~room
        known = legs_ | room
        found[number] = (float(roc_auc_score(legs_, scores)), float(roc_auc_score(legs_[known], scores[known])))
        print(f"{path.name}: AUC {found[number][0]:.4f} of {legs_.size} clusters, {legs_.sum()} legs; "
              f"{found[number][1]:.4f} without {(~known).sum()} that move and have no label")  # fmt: skip
    return found
