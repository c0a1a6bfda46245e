"""A classifier of clusters: gradient-boosted trees as plain arrays (Friedman, "Greedy function approximation", 2001).

Every tree is complete, of one depth for all, so that a batch of clusters goes down all trees at once: node i asks whether
feature > threshold and goes on to 2 i + 1 or 2 i + 2. The sum of the leaves that a cluster comes to is the logarithm of the
odds that it is a leg, in nats. A second forest has the first one's verdicts of the clusters around among its features: a leg
is rarely alone, and a table has four.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Array, Float, Index, Int
from trackers.filters.gating import distances
from trackers.laser.clusters import Clusters
from trackers.laser.legs.features import NAMES, cluster_features
from trackers.observations import LaserScan
from trackers.user_input.array_files import ArraySpec, read_arrays
from trackers.user_input.text_file import AnyPath

SHIPPED = Path(__file__).with_name("legs.npz")
"""File that `scripts/learn-legs` wrote."""

PARTNER_M = (0.1, 0.8)
"""Distances at which the other leg of a person may be [m]."""
_AROUND_M = 1.5
_NO_PARTNER = -8.0
"""Verdict of a cluster without others around, in nats."""
N_ABOUT = 4
"""Features of the second forest beside those of the cluster: its own verdict, and those of others."""


@dataclass(frozen=True, eq=False)
class Forest:
    """m complete trees of depth d: 2ᵈ − 1 questions and 2ᵈ leaves each, and what is added to their sum."""

    feature: Int[Index, "m questions"]
    threshold: Float[Array, "m questions"]  # infinite where nothing is asked: the answer is no
    leaf: Float[Array, "m leaves"]
    bias: float

    def score(self, features: Float[Array, "k features"]) -> Float[Array, "k"]:
        """Return the logarithm of the odds [nat]."""
        return self.leaves(features).sum(axis=0) + self.bias

    def leaves(self, features: Float[Array, "k features"]) -> Float[Array, "m k"]:
        """Return the leaf of each tree that each sample comes to."""
        flat, row = features.ravel(), np.arange(len(features)) * features.shape[1]
        place = np.arange(len(self.leaf))[:, None]
        for feature, threshold in self._depths:
            value = flat.take(feature.take(place, mode="clip") + row, mode="clip")
            place = 2 * place + (value > threshold.take(place, mode="clip"))
        return self.leaf.take(place, mode="clip")

    @cached_property
    def _depths(self) -> list[tuple[Int[Index, "asked"], Float[Array, "asked"]]]:
        """Features and thresholds by depth, tree by tree, so that question i goes on to 2 i or 2 i + 1 of the next."""
        starts = 2 ** np.arange(self.feature.shape[1].bit_length() + 1) - 1
        questions = [slice(*ends) for ends in pairwise(starts.tolist())]
        return [(self.feature[:, each].ravel(), self.threshold[:, each].ravel()) for each in questions]


@dataclass(frozen=True, eq=False)
class LegClassifier:
    """The two forests."""

    alone: Forest
    among: Forest

    def evidence(self, scan: LaserScan, clusters: Clusters) -> Float[Array, "k"]:
        """Return ln p(cluster | leg) / p(cluster | anything else) of the `leg_clusters` of a scan [nat].

        The forests are balanced when they are taught: their odds are this ratio. Beams in counter-clockwise order.
        """
        if len(clusters) == 0:
            return np.empty(0)
        features = cluster_features(scan, clusters)
        return self.among.score(with_verdicts(features, self.alone.score(features), clusters.middle))


def with_verdicts(
    features: Float[Array, "k features"], verdict: Float[Array, "k"], middle: Float[Array, "k 2"]
) -> Float[Array, "k more"]:
    """Append the first forest's verdict of each cluster, the best of a partner, the best around, and how many look like legs."""
    apart = distances(middle, middle)
    np.fill_diagonal(apart, np.inf)
    partner = (apart > PARTNER_M[0]) & (apart < PARTNER_M[1])
    around = apart < _AROUND_M
    best = [np.where(each, verdict, _NO_PARTNER).max(axis=1) for each in (partner, around)]
    count = (around & (verdict > 0)).sum(axis=1)
    return np.column_stack([features, verdict, *best, count])


def shipped() -> LegClassifier:
    """Read the classifier that comes with the package."""
    return read_classifier(SHIPPED)


@cache
def read_classifier(path: AnyPath) -> LegClassifier:
    """Read a classifier. Raises InputError for a file that is none."""
    return LegClassifier(read_forest(path, "alone", len(NAMES)), read_forest(path, "among", len(NAMES) + N_ABOUT))


@cache
def read_forest(path: AnyPath, name: str, n_feature: int, script: str = "learn-legs") -> Forest:
    """Read a forest of a file, which `script` writes, by its name in it. Raises InputError for a file without one."""
    specs = {
        f"{name}_feature": ArraySpec("iu", ("trees", "questions"), 0, n_feature - 1),
        f"{name}_threshold": ArraySpec("f", ("trees", "questions"), -1e9, 1e9),
        f"{name}_leaf": ArraySpec("f", ("trees", None), -100, 100),
        f"{name}_bias": ArraySpec("f", (), -100, 100),
    }
    feature, threshold, leaf, bias = read_arrays(path, specs, f"what `scripts/{script}` writes").values()
    return Forest(feature.astype(np.intp), threshold.astype(float), leaf.astype(float), float(bias))


def write_forests(forests: Mapping[str, Forest], path: AnyPath, made_by: str = "") -> None:
    """Write forests by name, as arrays of single precision. made_by: the command, kept as text."""
    arrays: dict[str, Any] = {"made_by": np.array(made_by)}
    for name, forest in forests.items():
        arrays |= {
            f"{name}_feature": forest.feature.astype(np.uint8),
            f"{name}_threshold": forest.threshold.astype(np.float32),
            f"{name}_leaf": forest.leaf.astype(np.float32),
            f"{name}_bias": np.float32(forest.bias),
        }
    np.savez_compressed(path, **arrays)
