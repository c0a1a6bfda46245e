"""On-line boosting of strong classifiers, a few of whose weak ones are exchanged every frame (Song et al., figure 7, after
Avidan's "Ensemble tracking", 2007).

H(s) = Σ_j α_j h_j(s) of M trees. Every frame the weights of its samples start equal. M trees are then taken: first K old
ones, each time that of least error under the present weights; then M − K newly trained ones. Each gets α = ½ log((1 − err) /
err), err being the weight of its wrong samples; those are multiplied by (1 − err) / err before the next (the paper prints a
sum for err that is twice this, and breaks the logarithm above one half).

Beyond figure 7 (ours): err is at least `least_error`, so that a faultless tree does not silence all others, and at most ½: a
tree that is more often wrong than right gets α = 0 and changes no weight. A set of samples that lacks one of both labels
leaves the classifier unchanged.

The weak ones are classification trees of depth 2 on weighted samples (CART: Breiman, Friedman, Olshen and Stone, 1984),
many at once.

A tree tests feature > threshold of a sample, then one of two further such questions; four leaves give +1 or −1. Each
question minimizes the weighted Gini impurity. A side of a split with weight W, and S more weight for +1 than for −1, has the
impurity (W − S² / W) / 2; so the gain of a split is, up to a constant of the node, (S_no − W_no S / W)² / (W_no W_yes),
which cumulative sums of the samples in order of a feature give for every threshold. That order does not depend on the
weights: it is computed once per frame for all trees and people.

Thresholds lie midway between samples. Samples of weight 0 are ignored. Values less than 10⁻⁷ apart are equal. These are the
rules of scikit-learn's `DecisionTreeClassifier(max_depth=2)`, which gives the same labels, but fits one tree at a time, and so
is not used. A question without gain has the
threshold ∞.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from trackers.arrays import Array, Bool, Complex, Complexes, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.rows import Rows

_SAME = 1e-7
_NOTHING = 1e-15
"""Of weights that sum to 1: rounding error of 0."""


class Questions(NamedTuple):
    """n questions, each feature > threshold."""

    feature: Int[Index, "n"]
    threshold: Float[Array, "n"]


class Grown(NamedTuple):
    """One tree per row of n weights, and its labels of its training samples."""

    root: Questions
    branches: Questions  # of 2 n nodes: after the root's answer no, then after yes
    leaves: Float[Array, "4 n"]  # labels: no and no, yes and no, no and yes, yes and yes
    says: Float[Array, "n k"]


@dataclass(frozen=True, eq=False)
class Trees(Rows):
    """n sets of m trees."""

    feature: Int[Index, "n m 3"]  # of the first question, of that after no, of that after yes
    threshold: Float[Array, "n m 3"]
    label: Float[Array, "n m 4"]  # +1 or −1: after no and no, no and yes, yes and no, yes and yes

    @classmethod
    def undivided(cls, n: int, m: int) -> Self:
        """Return trees that label everything −1."""
        return cls(np.zeros((n, m, 3), np.intp), np.full((n, m, 3), np.inf), np.full((n, m, 4), -1.0))

    @classmethod
    def grown(cls, trees: Sequence[Grown]) -> Self:
        """Stack m trees for each of n rows, at least one."""
        n = len(trees[0].root.feature)
        feature = np.stack([np.concatenate([tree.root.feature, tree.branches.feature]) for tree in trees])
        threshold = np.stack([np.concatenate([tree.root.threshold, tree.branches.threshold]) for tree in trees])
        label = np.stack([tree.leaves for tree in trees]).reshape(-1, 2, 2, n).swapaxes(1, 2).reshape(-1, 4, n)
        feature, threshold = feature.reshape(-1, 3, n), threshold.reshape(-1, 3, n)
        return cls(feature.transpose(2, 0, 1), threshold.transpose(2, 0, 1), label.transpose(2, 0, 1))

    def of_each(self, tree: Int[Index, "n k"]) -> Self:
        """Select k trees of each set by index."""
        return self._field_by_field(lambda each: np.take_along_axis(each, tree[..., None], axis=1), lambda batch: batch)

    def followed_by(self, other: Self) -> Self:
        """Concatenate the trees of each set with those of `other`."""
        return self._field_by_field(lambda mine, more: np.concatenate([mine, more], axis=1), lambda batch: batch, other)

    def says(self, samples: Float[Array, "sets k features"]) -> Float[Array, "n m k"]:
        """Classify every sample by every tree, +1 or −1; samples are one set for all, or a set per tree."""
        rows = np.arange(len(samples))[:, None, None]
        first, after_no, after_yes = np.moveaxis(
            samples.swapaxes(1, 2)[rows, self.feature] > self.threshold[..., None], 2, 0
        )
        no_no, no_yes, yes_no, yes_yes = np.moveaxis(self.label[..., None], 2, 0)
        return np.where(first, np.where(after_yes, yes_yes, yes_no), np.where(after_no, no_yes, no_no))


@dataclass(frozen=True, eq=False)
class SortedSamples:
    """n sets of k samples in the order of each feature, for all trees trained on them."""

    by_feature: Float[Array, "n features k"]
    in_order: Float[Array, "n features k"]
    order: Int[Index, "n features k"]  # of the samples of all sets, concatenated
    parts: Float[Array, "n features places"]  # 1 where the values before and after a place differ, else 0

    @classmethod
    def of(cls, samples: Float[Array, "n k features"]) -> Self:
        """Sort sets of at least one sample of at least one feature."""
        by_feature = np.ascontiguousarray(samples.swapaxes(1, 2))
        order = by_feature.argsort(axis=2, kind="stable")
        in_order = np.take_along_axis(by_feature, order, axis=2)
        parts = (in_order[..., 1:] - in_order[..., :-1] > _SAME).astype(float)
        n, _, k = order.shape
        return cls(by_feature, in_order, order + k * np.arange(n)[:, None, None], parts)

    @cached_property
    def _of_branches(self) -> SortedSamples:
        """The sets repeated for both branches of the trees."""
        twice = {name: np.concatenate([each, each]) for name, each in vars(self).items() if name != "_of_branches"}
        twice["order"][len(self.order) :] += self.order.shape[0] * self.order.shape[2]
        return SortedSamples(**twice)

    def grow(self, weight: Float[Array, "n k"], label: Float[Array, "n k"]) -> Grown:
        """Grow a tree per set, whose weights sum to 1 and whose labels are +1 or −1.

        A sample's weight and its weight times its label form one complex number, so that one pass sums both.
        """
        n = len(weight)
        weighed = weight + 1j * (weight * label)
        root, yes = self._asked(weighed)
        where_yes = weighed * yes
        in_branch = np.concatenate([weighed - where_yes, where_yes])
        branches, answers = self._of_branches._asked(in_branch)
        signed = in_branch.imag
        of_yes = (signed * answers).sum(axis=1)
        leaves = np.where(np.concatenate([signed.sum(axis=1) - of_yes, of_yes]) > 0, 1.0, -1.0)
        said = np.where(answers, leaves[2 * n :, None], leaves[: 2 * n, None])
        return Grown(root, branches, leaves, np.where(yes, said[n:], said[:n]))

    def _asked(self, weighed: Complex[Complexes, "n k"]) -> tuple[Questions, Bool[Mask, "n k"]]:
        """Find the best split of each set, and the samples on its yes side."""
        n, _, places = self.parts.shape
        if places == 0:
            return Questions(np.zeros(n, np.intp), np.full(n, np.inf)), np.zeros(weighed.shape, np.bool_)
        sums = weighed.take(self.order).cumsum(axis=2)
        W, S = sums.real[:, :1, -1:], sums.imag[:, :1, -1:]
        W_no = sums.real[..., :-1]
        gain = W_no * (S / np.maximum(W, _NOTHING))
        gain -= sums.imag[..., :-1]
        gain *= gain
        both = W - W_no
        both *= W_no
        gain /= np.maximum(both, _NOTHING, out=both)
        gain *= self.parts
        gain = gain.reshape(n, -1)
        best, rows = gain.argmax(axis=1), np.arange(n)
        asked = gain.max(axis=1) > _NOTHING
        feature, place = np.divmod(best, places)
        # the first of equal gains: the sample before it is in the node, the one after it need not be
        value, low = self.by_feature[rows, feature], self.in_order[rows, feature, place]
        high = np.where((value > low[:, None]) & (weighed.real > 0), value, np.inf).min(axis=1)
        threshold = np.where(asked, low + 0.5 * (high - low), np.inf)
        return Questions(feature, threshold), value > threshold[:, None]


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
