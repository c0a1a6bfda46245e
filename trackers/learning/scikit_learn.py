"""The same trees by scikit-learn: a slower reference for ours."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeClassifier

from trackers.arrays import Array, Index
from trackers.learning.cart import Grown, Questions

_LEAF = -1
"""Child index of a node without one."""


class ScikitLearnTrees:
    """Trainer of trees on n sets of k samples."""

    def __init__(self, samples: Float[Array, "n k features"]) -> None:
        self._samples = np.asarray(samples, np.float32)

    def grow(self, weight: Float[Array, "n k"], label: Float[Array, "n k"]) -> Grown:
        """Grow trees as `SortedSamples.grow` does."""
        rows = [self._grow(*row) for row in zip(self._samples, weight, label, strict=True)]
        feature, threshold, leaves, says = (np.stack(each, axis=1) for each in zip(*rows, strict=True))
        questions = Questions(feature[1:].ravel(), threshold[1:].ravel())
        return Grown(Questions(feature[0], threshold[0]), questions, leaves.ravel(), says.T)

    def _grow(self, samples: NDArray[np.float32], weight: Array, label: Array) -> tuple[Index, Array, Array, Array]:
        """Return features (3,), thresholds (3,), labels of the leaves (4,) as in `Grown`, and the tree's labels (k,)."""
        there = weight > 0
        fitted = DecisionTreeClassifier(max_depth=2, random_state=0).fit(samples[there], label[there], weight[there])
        tree = fitted.tree_
        majority = fitted.classes_[tree.value[:, 0].argmax(axis=1)]
        branches = [self._child(0, side) for side in (tree.children_left, tree.children_right)]
        nodes = np.array([0, *branches])
        divides = tree.children_left[nodes] != _LEAF
        leaves = [self._child(node, side) for side in (tree.children_left, tree.children_right) for node in branches]
        feature = np.where(divides, tree.feature[nodes], 0).astype(np.intp)
        threshold = np.where(divides, tree.threshold[nodes], np.inf)
        return feature, threshold, majority[leaves], fitted.predict(samples)

    @staticmethod
    def _child(node: int, children: Index) -> int:
        """Return a node's child, or the node itself if it is a leaf."""
        return node if children[node] == _LEAF else int(children[node])
