"""Boosted trees of scikit-learn as complete trees of one depth, which trackers read (`trackers.laser.legs.classifier.Forest`)."""

from __future__ import annotations

import numpy as np
from sklearn.ensemble import HistGradientBoostingClassifier, HistGradientBoostingRegressor

from trackers.arrays import Array
from trackers.laser.legs.classifier import Forest

NEVER = 1e9
"""Threshold of a question whose answer is always no."""


def complete_trees(fitted: HistGradientBoostingClassifier | HistGradientBoostingRegressor, depth: int) -> Forest:
    """Copy the trees of a fitted model, none deeper than `depth`."""
    grown = [predictors[0].nodes for predictors in fitted._predictors]
    feature = np.zeros((len(grown), 2**depth - 1), np.intp)
    threshold = np.full(feature.shape, NEVER)
    leaf = np.zeros((len(grown), 2**depth))
    for tree, nodes in enumerate(grown):
        _fill(nodes, 0, 0, feature[tree], threshold[tree], leaf[tree])
    return Forest(feature, threshold, leaf, float(fitted._baseline_prediction.ravel()[0]))


def _fill(nodes, at: int, place: int, feature: Array, threshold: Array, leaf: Array) -> None:
    """Copy the tree below a node to the complete tree below a place; a leaf above the bottom has its value there."""
    if place >= len(feature):
        leaf[place - len(feature)] = nodes[at]["value"]
    elif nodes[at]["is_leaf"]:
        for child in (2 * place + 1, 2 * place + 2):
            _fill(nodes, at, child, feature, threshold, leaf)
    else:
        feature[place], threshold[place] = nodes[at]["feature_idx"], nodes[at]["num_threshold"]
        _fill(nodes, nodes[at]["left"], 2 * place + 1, feature, threshold, leaf)
        _fill(nodes, nodes[at]["right"], 2 * place + 2, feature, threshold, leaf)
