"""The axis of a body from the outline that a scanner at waist height sees of it, learned from bodies of the twin.

What is seen of a trunk is an arc with arms beside or before it, cut off where something nearer hides the rest. Two forests
of regression trees (`trackers.laser.legs.classifier.Forest`) say how far the axis is behind the middle of the samples, and
how far left of it; a third how exactly. Features are the outline's depth at places from its right end to its left one, so
that scanners of any resolution see alike. They and their mirror image are asked, so that a mirrored body has the mirrored
axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import accumulate
from pathlib import Path

import numpy as np

from trackers.arrays import Array, Bool, Float, Mask
from trackers.laser.bearings import beams_of_turn
from trackers.laser.clusters import Clusters, directions
from trackers.laser.legs.classifier import Forest, read_forest
from trackers.observations import LaserScan

SHIPPED = Path(__file__).with_name("trunks.npz")
"""File that `scripts/learn-trunks` wrote."""

_N_PLACE = 8
_PLACES = np.linspace(0.0, 1.0, _N_PLACE)
N_FEATURE = _N_PLACE + 7
_NEAREST_M = 0.1
_SIDES = _N_PLACE + np.arange(4)  # right, left, hidden before, hidden after
_MIRROR = np.concatenate([np.arange(_N_PLACE)[::-1], _SIDES[[1, 0, 3, 2]], np.arange(_SIDES[-1] + 1, N_FEATURE)])
_SIGNS = np.where(np.isin(np.arange(N_FEATURE), _SIDES[:2]), -1.0, 1.0)


def outline_features(
    scan: LaserScan, foreground: Bool[Mask, "n_beam"], clusters: Clusters
) -> Float[Array, "k features"]:
    """Compute the features of k clusters of the foreground of a scan with its beams in counter-clockwise order [m]."""
    spacing, count = abs(scan.angle_increment_rad), beams_of_turn(scan) or scan.ranges_m.size
    points = np.where(foreground, scan.ranges_m, 0.0) * directions(scan)
    near = np.maximum(clusters.range_m, _NEAREST_M)
    n_beam = (clusters.last_beam - clusters.first_beam) % count + 1
    since_first = np.arange(n_beam.sum()) - (n_beam.cumsum() - n_beam).repeat(n_beam)
    row, beams = np.arange(len(clusters)).repeat(n_beam), (clusters.first_beam.repeat(n_beam) + since_first) % count
    row, beams = row[foreground[beams]], beams[foreground[beams]]
    x, y = points[:, beams] - clusters.middle[row].T
    ahead_x, ahead_y = (clusters.middle / near[:, None])[row].T
    along, across = x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y
    order = np.lexsort((across, row))  # from right to left, cluster by cluster
    along, across = along[order], across[order]
    stops = np.bincount(row).cumsum()
    starts = np.concatenate([[0], stops[:-1]])
    right, left = across[starts], across[stops - 1]
    width = left - right
    places = right[:, None] + _PLACES * width[:, None]
    features = np.empty((len(clusters), N_FEATURE))
    for number, (start, stop) in enumerate(zip(starts.tolist(), stops.tolist(), strict=True)):
        features[number, :_N_PLACE] = np.interp(places[number], across[start:stop], along[start:stop])
    others = right, left, clusters.hidden_before, clusters.hidden_after, width, spacing * near, 1 / near
    features.T[_N_PLACE:] = others
    return features


def mirrored(features: Float[Array, "k features"]) -> Float[Array, "k features"]:
    """Return the features of the mirrored outlines: the other way round, with the sides exchanged and of the other sign."""
    return features[:, _MIRROR] * _SIGNS


@dataclass(frozen=True, eq=False)
class TrunkOutlines:
    """The forests: the axis behind the middle, left of it [m], and ln of the variance on each axis [ln m²]."""

    behind: Forest
    left: Forest
    ln_variance: Forest

    @property
    def _forests(self) -> tuple[Forest, Forest, Forest]:
        return self.behind, self.left, self.ln_variance

    @cached_property
    def _together(self) -> Forest:
        """All trees as one forest, so that an outline goes down them at once."""
        tables = ((each.feature, each.threshold, each.leaf) for each in self._forests)
        return Forest(*map(np.concatenate, zip(*tables, strict=True)), bias=0.0)

    def axes(
        self, scan: LaserScan, foreground: Bool[Mask, "n_beam"], clusters: Clusters
    ) -> tuple[Float[Array, "k 2"], Float[Array, "k"]]:
        """Return the axes of k clusters in the scanner's frame [m], and the variance of each on each axis [m²]."""
        if len(clusters) == 0:
            return clusters.middle, np.empty(0)
        behind_m, left_m, variance_m2 = self.score(outline_features(scan, foreground, clusters))
        ahead = clusters.middle / np.maximum(clusters.range_m, _NEAREST_M)[:, None]
        across = ahead[:, ::-1] * (-1.0, 1.0)
        return clusters.middle + ahead * behind_m[:, None] + across * left_m[:, None], variance_m2

    def score(
        self, features: Float[Array, "k features"]
    ) -> tuple[Float[Array, "k"], Float[Array, "k"], Float[Array, "k"]]:
        """Return how far the axes are behind the middles and left of them [m], and the variance on each axis [m²]."""
        both, n = np.concatenate([features, mirrored(features)]), len(features)
        leaves = self._together.leaves(both)
        stops = accumulate(len(each.feature) for each in self._forests)
        behind, left, ln_variance = (
            leaves[stop - len(each.feature) : stop].sum(axis=0) + each.bias
            for each, stop in zip(self._forests, stops, strict=True)
        )
        return (
            0.5 * (behind[:n] + behind[n:]),
            0.5 * (left[:n] - left[n:]),
            np.exp(0.5 * (ln_variance[:n] + ln_variance[n:])),
        )


@cache
def shipped() -> TrunkOutlines:
    """Read the forests that come with the package."""
    return TrunkOutlines(
        *(read_forest(SHIPPED, name, N_FEATURE, "learn-trunks") for name in ("behind", "left", "ln_variance"))
    )
