"""Strong classifiers that are boosted on-line, a few weak ones exchanged every frame (Song et al., figure 7, after Avidan's
"Ensemble tracking", 2007).

H(s) = Σ_j α_j h_j(s) of M trees. With every frame's samples the weights start equal. Then, M times over, a tree is taken:
first K of the old ones, each time that of least error under the weights that those before it left; then M − K that are trained
anew. Each gets α = ½ log((1 − err) / err), err being the weight of the samples that it has wrong; those are multiplied by
(1 − err) / err before the next (the paper prints a sum for err that is twice this, and breaks the logarithm above one half).

Where figure 7 ends (ours). err counts as at least `least_error`, so that a tree without a fault does not silence all others,
and as at most ½: a tree that is wrong more often than right gets α = 0, has no say, and changes no weight. A set of samples
that lacks one of both labels teaches nothing: the classifier stays as it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from trackers.arrays import Array, Index
from trackers.configuration import Strict
from trackers.filters.rows import Rows
from trackers.learning.cart import Grown, SortedSamples, Trees

_TAKEN = 1e6
"""Error of a tree that is already chosen, so that no other is chosen after it."""


class BoostingOptions(Strict):
    """Options: number of trees of a classifier, and of those that a frame exchanges."""

    trees: PositiveInt = Field(default=30, description="trees of a classifier (M)")
    kept: NonNegativeInt = Field(
        default=25,
        description="trees that live on when a new frame is learned, the best ones; the rest is trained anew (K)",
    )
    first_a_frame: PositiveInt | None = Field(
        default=None,
        description="trees that a frame of the first training trains at most: it takes several frames then, during "
        "which no tree is exchanged; none: the first frame trains all (ours)",
    )
    least_error: float = Field(
        default=0.01,
        gt=0,
        le=0.5,
        description="error that a tree is taken to have at least, so that α is bounded (ours)",
    )
    learner: Literal["own", "scikit-learn"] = Field(
        default="own",
        description="what trains a tree: ours, or scikit-learn's, which is slower and gives the same labels",
    )

    @model_validator(mode="after")
    def _no_more_kept_than_there_are(self) -> BoostingOptions:
        if self.kept > self.trees:
            raise ValueError(f"kept must be at most trees = {self.trees}")
        return self


@dataclass(frozen=True, eq=False)
class StrongClassifiers(Rows):
    """n strong classifiers, each a weighted sum of trees; made by `untrained`."""

    trees: Trees
    alpha: Float[Array, "n m"]  # ≥ 0; 0 for a tree that is not there yet
    n_tree: Int[Index, "n"]  # how many of the trees are there

    @classmethod
    def untrained(cls, n: int, n_tree: int) -> Self:
        """Classifiers of nothing: every score is 0."""
        return cls(Trees.undivided(n, n_tree), np.zeros((n, n_tree)), np.zeros(n, np.intp))

    def scores(self, samples: Float[Array, "k features"]) -> Float[Array, "n k"]:
        """H(s) / Σ_j α_j of the same samples by every classifier, in [−1, 1]; 0 where no tree has a say."""
        total = self.alpha.sum(axis=1)[:, None, None]
        share = self.alpha[:, None] / np.where(total > 0, total, 1.0)
        return np.matmul(share, self.trees.says(samples[None]))[:, 0]


_Grow = Callable[[Array, Array], Grown]
"""Weights and labels, (n, k) each → a tree for each of n rows: `SortedSamples.grow`, or scikit-learn's."""


class OnlineBoosting:
    """Learns frame by frame; holds no state: the classifiers are passed in and handed back."""

    def __init__(self, options: BoostingOptions | None = None) -> None:
        self.options = options or BoostingOptions()

    def untrained(self, n: int) -> StrongClassifiers:
        """n classifiers that have learned nothing."""
        return StrongClassifiers.untrained(n, self.options.trees)

    def learned(
        self, strong: StrongClassifiers, samples: Float[Array, "n k features"], label: Float[Array, "n k"]
    ) -> StrongClassifiers:
        """Update the classifiers with k samples each, labelled +1 or −1; a label of 0 marks no sample."""
        taught = (label > 0).any(axis=1) & (label < 0).any(axis=1)
        if not taught.any():
            return strong
        for n_tree in np.unique(strong.n_tree[taught]):  # those whose first training is over have as many, all of them
            rows = (taught & (strong.n_tree == n_tree)).nonzero()[0]
            strong = strong.replaced(rows, self._boosted(strong.select(rows), int(n_tree), samples[rows], label[rows]))
        return strong

    def _boosted(
        self, old: StrongClassifiers, n_old: int, samples: Array, label: Float[Array, "n k"]
    ) -> StrongClassifiers:
        """Classifiers with `n_old` trees each after a frame that teaches them all."""
        options, n = self.options, len(old)
        n_kept, n_new = options.kept, options.trees - options.kept
        if n_old < options.trees:
            n_kept, n_new = n_old, min(options.trees - n_old, options.first_a_frame or options.trees)
        weight = np.abs(label)
        weight /= weight.sum(axis=1, keepdims=True)
        chosen, grown, all_odds = [], [], []
        if n_kept:
            rows, wrong = np.arange(n), (old.trees.says(samples)[:, :n_old] != label[:, None]).astype(float)
            for _ in range(n_kept):
                each = np.matmul(wrong, weight[..., None])[..., 0]
                best = each.argmin(axis=1)
                chosen.append(best)
                odds, weight = self._reweighted(weight, weight * wrong[rows, best])
                wrong[rows, best] = _TAKEN
                all_odds.append(odds)
        if n_new:
            grow = self._learner(samples)
            for _ in range(n_new):
                tree = grow(weight, label)
                grown.append(tree)
                odds, weight = self._reweighted(weight, weight * (tree.says != label))
                all_odds.append(odds)
        n_absent = options.trees - n_kept - n_new
        trees = Trees.undivided(n, n_absent)
        if grown:
            trees = Trees.grown(grown).followed_by(trees)
        if chosen:
            trees = old.trees.of_each(np.stack(chosen, axis=1)).followed_by(trees)
        alpha = 0.5 * np.log(np.stack([*all_odds, *[np.ones(n)] * n_absent], axis=1))
        return StrongClassifiers(trees, alpha, np.full(n, n_kept + n_new))

    def _reweighted(
        self, weight: Float[Array, "n k"], wrong: Float[Array, "n k"]
    ) -> tuple[Float[Array, "n"], Float[Array, "n k"]]:
        """(1 − err) / err of a tree, and the weights, again of sum 1, that it leaves to the next; wrong: weights it has wrong."""
        error = wrong.sum(axis=1)
        odds = 1 / np.minimum(np.maximum(error, self.options.least_error), 0.5) - 1
        more = odds - 1
        return odds, (weight + more[:, None] * wrong) / (1 + more * error)[:, None]

    def _learner(self, samples: Array) -> _Grow:
        if self.options.learner == "own":
            return SortedSamples.of(samples).grow
        from trackers.learning.scikit_learn import ScikitLearnTrees

        return ScikitLearnTrees(samples).grow
