"""On-line boosting of strong classifiers, a few of whose weak ones are exchanged every frame (Song et al., figure 7, after
Avidan's "Ensemble tracking", 2007).

H(s) = Σ_j α_j h_j(s) of M trees. Every frame the weights of its samples start equal. M trees are then taken: first K old
ones, each time that of least error under the present weights; then M − K newly trained ones. Each gets α = ½ log((1 − err) /
err), err being the weight of its wrong samples; those are multiplied by (1 − err) / err before the next (the paper prints a
sum for err that is twice this, and breaks the logarithm above one half).

Beyond figure 7 (ours): err is at least `least_error`, so that a faultless tree does not silence all others, and at most ½: a
tree that is more often wrong than right gets α = 0 and changes no weight. A set of samples that lacks one of both labels
leaves the classifier unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from trackers.arrays import Array, Float, Index, Int
from trackers.configuration import Strict
from trackers.filters.rows import Rows
from trackers.learning.cart import SortedSamples, Trees

_TAKEN = 1e6
"""Error of a tree already chosen, so that it is not chosen again."""


class BoostingOptions(Strict):
    """Options: number of trees of a classifier, and of those exchanged per frame."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"learner": "own"}

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

    @model_validator(mode="after")
    def _no_more_kept_than_there_are(self) -> BoostingOptions:
        if self.kept > self.trees:
            raise ValueError(f"kept must be at most trees = {self.trees}")
        return self


@dataclass(frozen=True, eq=False)
class StrongClassifiers(Rows):
    """n strong classifiers, each a weighted sum of trees; made by `untrained`."""

    trees: Trees
    alpha: Float[Array, "n m"]  # ≥ 0; 0 for a missing tree
    n_tree: Int[Index, "n"]  # number of trees present

    @classmethod
    def untrained(cls, n: int, n_tree: int) -> Self:
        """Make classifiers without trees, whose scores are 0."""
        return cls(Trees.undivided(n, n_tree), np.zeros((n, n_tree)), np.zeros(n, np.intp))

    def scores(self, samples: Float[Array, "k features"]) -> Float[Array, "n k"]:
        """Return H(s) / Σ_j α_j of the same samples by every classifier, in [−1, 1]; 0 without a tree of weight."""
        total = self.alpha.sum(axis=1)[:, None, None]
        share = self.alpha[:, None] / np.where(total > 0, total, 1.0)
        return np.matmul(share, self.trees.says(samples[None]))[:, 0]


class OnlineBoosting:
    """Stateless learner, frame by frame: classifiers are passed in and returned."""

    def __init__(self, options: BoostingOptions | None = None) -> None:
        self.options = options or BoostingOptions()

    def learned(
        self, strong: StrongClassifiers, samples: Float[Array, "n k features"], label: Float[Array, "n k"]
    ) -> StrongClassifiers:
        """Update the classifiers with k samples each, labelled +1 or −1; a label of 0 marks no sample."""
        taught = (label > 0).any(axis=1) & (label < 0).any(axis=1)
        if not taught.any():
            return strong
        for n_tree in np.unique(
            strong.n_tree[taught]
        ):  # all classifiers after their first training have the same number
            rows = (taught & (strong.n_tree == n_tree)).nonzero()[0]
            strong = strong.replaced(rows, self._boosted(strong.select(rows), int(n_tree), samples[rows], label[rows]))
        return strong

    def _boosted(
        self, old: StrongClassifiers, n_old: int, samples: Array, label: Float[Array, "n k"]
    ) -> StrongClassifiers:
        """Return classifiers with `n_old` trees each, after a frame that teaches them all."""
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
            ordered = SortedSamples.of(samples)
            for _ in range(n_new):
                tree = ordered.grow(weight, label)
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
        """Return (1 − err) / err of a tree, and the weights for the next, of sum 1; wrong: weights of its wrong samples."""
        error = wrong.sum(axis=1)
        odds = 1 / np.minimum(np.maximum(error, self.options.least_error), 0.5) - 1
        more = odds - 1
        return odds, (weight + more[:, None] * wrong) / (1 + more * error)[:, None]
