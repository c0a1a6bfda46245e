"""On-line boosting: figure 7 written out sample by sample, its two ends K = 0 and K = M, and frames that teach nothing."""

from __future__ import annotations

from math import log

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from pydantic import ValidationError

from trackers.learning.boosting import BoostingOptions, OnlineBoosting, StrongClassifiers, Trees

LEAST = 0.01


def frame(seed: int, n: int = 1, k: int = 40, apart: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Samples of 6 features, and the labels of n classifiers, each of which takes other samples for its own."""
    rng = np.random.default_rng(seed)
    label = np.where(np.arange(k) < k // 2, 1.0, -1.0)
    samples = rng.normal(size=(k, 6)) + apart * label[:, None]
    return samples, label * np.where(np.arange(n) % 2, -1.0, 1.0)[:, None]


def each_their_own(samples: np.ndarray, label: np.ndarray) -> np.ndarray:
    """The same samples for every classifier."""
    return np.tile(samples, (len(label), 1, 1))


def after(options: BoostingOptions, *frames: tuple[np.ndarray, np.ndarray]) -> StrongClassifiers:
    boosting = OnlineBoosting(options)
    strong = StrongClassifiers.untrained(len(frames[0][1]), boosting.options.trees)
    for samples, label in frames:
        strong = boosting.learned(strong, each_their_own(samples, label), label)
    return strong


def assert_equal(one: StrongClassifiers, other: StrongClassifiers) -> None:
    for name in ("feature", "threshold", "label"):
        np.testing.assert_array_equal(getattr(one.trees, name), getattr(other.trees, name))
    np.testing.assert_array_equal(one.alpha, other.alpha)
    np.testing.assert_array_equal(one.n_tree, other.n_tree)


class Tree:
    """One tree, asked of one sample at a time."""

    def __init__(self, trees: Trees, place: int) -> None:
        self.feature, self.threshold = trees.feature[0, place].tolist(), trees.threshold[0, place].tolist()
        self.label = trees.label[0, place].tolist()

    def says(self, sample: np.ndarray) -> float:
        if sample[self.feature[0]] > self.threshold[0]:
            return self.label[3 if sample[self.feature[2]] > self.threshold[2] else 2]
        return self.label[1 if sample[self.feature[1]] > self.threshold[1] else 0]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tree) and vars(self) == vars(other)


def impurity(inside: list[int], weight: list[float], label: np.ndarray) -> float:
    """Weighted Gini impurity of the samples inside a node."""
    of_each = [sum(weight[i] for i in inside if label[i] == each) for each in (1, -1)]
    total = sum(of_each)
    return total - sum(each**2 for each in of_each) / total if total else 0.0


def least_impurity(inside: list[int], samples: np.ndarray, weight: list[float], label: np.ndarray) -> float:
    """What the best question of all leaves of it."""
    sides = [
        [[i for i in inside if (samples[i, feature] > samples[j, feature]) == yes] for yes in (False, True)]
        for feature in range(samples.shape[1])
        for j in inside
    ]
    return min(sum(impurity(side, weight, label) for side in both) for both in sides)


def check_grown(tree: Tree, samples: np.ndarray, weight: list[float], label: np.ndarray) -> None:
    """No other tree, question by question, leaves less impurity, and leaves say what outweighs in them."""
    everyone = list(range(len(samples)))
    yes = [i for i in everyone if samples[i, tree.feature[0]] > tree.threshold[0]]
    branches = [[i for i in everyone if i not in yes], yes]
    left = sum(impurity(each, weight, label) for each in branches)
    assert left == pytest.approx(least_impurity(everyone, samples, weight, label), abs=1e-9)
    for branch, feature, threshold in zip(branches, tree.feature[1:], tree.threshold[1:], strict=True):
        leaves = [[i for i in branch if (samples[i, feature] > threshold) == answer] for answer in (False, True)]
        left = sum(impurity(each, weight, label) for each in leaves)
        assert left == pytest.approx(least_impurity(branch, samples, weight, label), abs=1e-9)
        for leaf in leaves:
            assert sum(weight[i] * label[i] * tree.says(samples[i]) for i in leaf) > -1e-12


def follow(taken: list[Tree], old: list[Tree], samples: np.ndarray, label: np.ndarray, kept: int) -> list[float]:
    """Figure 7, a frame of one classifier, sample by sample: that each tree was one to take, and what its α is."""
    weight, alphas, left = [1.0] * len(samples), [], list(old)

    def error(tree: Tree) -> float:
        return sum(w for w, s, sought in zip(weight, samples, label, strict=True) if tree.says(s) != sought)

    for j, tree in enumerate(taken):
        total = sum(weight)
        weight = [each / total for each in weight]
        if old and j < kept:
            assert error(tree) == pytest.approx(min(error(each) for each in left), abs=1e-12)
            left.remove(tree)
        else:
            check_grown(tree, samples, weight, label)
        err = min(max(error(tree), LEAST), 0.5)
        alphas.append(0.5 * log((1 - err) / err))
        weight = [
            w * (1 - err) / err if tree.says(s) != sought else w
            for w, s, sought in zip(weight, samples, label, strict=True)
        ]
    return alphas


@pytest.mark.parametrize("kept", [0, 4, 7])
def test_it_is_figure_7_written_out(kept: int) -> None:
    boosting = OnlineBoosting(BoostingOptions(trees=7, kept=kept, least_error=LEAST))
    strong, old = StrongClassifiers.untrained(1, boosting.options.trees), []
    for seed in range(3):
        samples, label = frame(seed, apart=0.3)
        strong = boosting.learned(strong, each_their_own(samples, label), label)
        trees = [Tree(strong.trees, place) for place in range(7)]
        alphas = follow(trees, old, samples, label[0], kept)
        np.testing.assert_allclose(strong.alpha[0], alphas, rtol=1e-9, atol=1e-12)
        scores = [sum(a * tree.says(s) for a, tree in zip(alphas, trees, strict=True)) / sum(alphas) for s in samples]
        np.testing.assert_allclose(strong.scores(samples)[0], scores, atol=1e-9)
        old = trees


def test_with_k_equal_to_m_it_never_trains_again() -> None:
    options = BoostingOptions(trees=8, kept=8)
    first, later = after(options, frame(0)), after(options, frame(0), frame(1), frame(2))

    def rows(strong: StrongClassifiers) -> list[bytes]:
        trees = strong.trees
        return sorted(
            b"".join(each[0, place].tobytes() for each in (trees.feature, trees.threshold, trees.label))
            for place in range(8)
        )

    assert rows(first) == rows(later)
    assert not np.array_equal(first.alpha, later.alpha)


def test_with_k_0_every_frame_is_a_fresh_classifier() -> None:
    options = BoostingOptions(trees=8, kept=0)
    assert_equal(after(options, frame(0), frame(1), frame(2)), after(options, frame(2)))
    spread = BoostingOptions(trees=8, kept=0, first_a_frame=4)
    assert_equal(after(spread, frame(0), frame(1), frame(2)), after(options, frame(2)))


def test_classifiers_that_learn_together_are_those_that_learn_alone() -> None:
    options, frames = BoostingOptions(trees=6, kept=4), [frame(seed, n=2) for seed in range(3)]
    both = after(options, *frames)
    for row in range(2):
        alone = after(options, *((samples, label[[row]]) for samples, label in frames))
        assert_equal(both.select(np.array([row])), alone)


def test_a_sample_of_nobodys_is_not_there() -> None:
    samples, label = frame(3)
    more, none = np.concatenate([samples, 5 + samples]), np.concatenate([label, 0 * label], axis=1)
    options = BoostingOptions(trees=5, kept=3)
    np.testing.assert_allclose(
        after(options, (more, none)).scores(samples), after(options, (samples, label)).scores(samples), atol=1e-9
    )


def test_the_first_training_may_be_spread_over_frames() -> None:
    options = BoostingOptions(trees=10, kept=7, first_a_frame=4)
    counts = [int(after(options, *[frame(seed) for seed in range(n)]).n_tree[0]) for n in range(1, 6)]
    assert counts == [4, 8, 10, 10, 10]
    one = after(options, frame(0))
    assert (one.alpha[0, 4:] == 0).all()
    first, later = (
        {str(Tree(each.trees, place).__dict__) for place in range(n)}
        for each, n in ((after(options, frame(0)), 4), (after(options, frame(0), frame(1)), 8))
    )
    assert first <= later  # none is exchanged before all are there


@pytest.mark.parametrize("label", [1.0, -1.0, 0.0])
def test_a_frame_without_both_labels_teaches_nothing(label: float) -> None:
    options = BoostingOptions(trees=5, kept=3)
    strong = after(options, frame(0))
    assert OnlineBoosting(options).learned(strong, frame(1)[0][None], np.full((1, 40), label)) is strong
    untrained = StrongClassifiers.untrained(1, 5)
    assert (
        OnlineBoosting(options).learned(untrained, frame(1)[0][None], np.full((1, 40), label)).scores(frame(1)[0]) == 0
    ).all()


def test_only_who_has_both_labels_learns() -> None:
    options = BoostingOptions(trees=5, kept=3)
    strong = after(options, frame(0, n=2))
    samples, label = frame(1, n=2)
    label[1] = 1.0
    learned = OnlineBoosting(options).learned(strong, each_their_own(samples, label), label)
    assert_equal(learned.select(np.array([1])), strong.select(np.array([1])))
    assert not np.array_equal(learned.alpha[0], strong.alpha[0])


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.3, 100.0]),
    st.sampled_from([0, 3, 6]),
    st.booleans(),
)
@settings(max_examples=40, deadline=None)
def test_alphas_are_bounded_and_scores_lie_between_minus_1_and_1(
    seed: int, apart: float, kept: int, alike: bool
) -> None:
    """Whether nothing is told apart (err ½), everything is (err 0), or what was learned is wrong now (err above ½)."""
    options = BoostingOptions(trees=6, kept=kept, least_error=LEAST)
    one, (samples, label), (third, _) = frame(seed, apart=apart), frame(seed + 1, apart=-apart), frame(seed + 2)
    frames = [one, (samples * (not alike), label)]
    strong = after(options, *frames)
    assert (strong.alpha >= 0).all()
    assert (strong.alpha <= 0.5 * log((1 - LEAST) / LEAST) + 1e-12).all()
    scores = strong.scores(third)
    assert np.isfinite(scores).all()
    assert (np.abs(scores) <= 1 + 1e-12).all()
    if alike:
        assert (scores == 0).all() or kept


def test_more_kept_than_there_are_is_refused() -> None:
    with pytest.raises(ValidationError, match="kept must be at most trees = 5"):
        BoostingOptions(trees=5, kept=6)
