"""Trees of depth 2: scikit-learn's as the oracle, and the samples that tell nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sklearn.tree import DecisionTreeClassifier

from trackers.learning.boosting import Grown, SortedSamples, Trees


def draw(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples, some features of few values, weights of which some are 0, and labels."""
    rng = np.random.default_rng(seed)
    k, features = int(rng.integers(4, 120)), int(rng.integers(1, 25))
    samples = rng.normal(size=(k, features)) if seed % 2 else rng.integers(0, 6, (k, features)).astype(float)
    weight = rng.exponential(size=k) * (rng.random(k) < 0.9)
    return samples, weight / weight.sum(), np.where(rng.random(k) < 0.5, 1.0, -1.0)


@pytest.mark.parametrize("seed", range(200))
def test_the_labels_are_scikit_learns(seed: int) -> None:
    samples, weight, label = draw(seed)
    says = SortedSamples.of(samples[None]).grow(weight[None], label[None]).says[0]
    oracle = DecisionTreeClassifier(max_depth=2, random_state=0).fit(samples, label, weight).predict(samples)
    np.testing.assert_array_equal(says[weight > 0], oracle[weight > 0])


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_trees_trained_together_are_those_trained_alone_and_say_again_what_they_said(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    samples = rng.normal(size=(n, int(rng.integers(1, 50)), int(rng.integers(1, 8))))
    learner = SortedSamples.of(samples)
    weight = rng.exponential(size=(m, *samples.shape[:2]))
    weight /= weight.sum(axis=2, keepdims=True)
    label = np.where(rng.random(samples.shape[:2]) < 0.5, 1.0, -1.0)
    grown = [learner.grow(each, label) for each in weight]
    trees = Trees.grown(grown)
    np.testing.assert_array_equal(trees.says(samples), np.stack([each.says for each in grown], axis=1))
    for row in range(n):
        alone = SortedSamples.of(samples[[row]])
        alone = Trees.grown([alone.grow(each[[row]], label[[row]]) for each in weight])
        for name in ("feature", "threshold", "label"):
            np.testing.assert_array_equal(getattr(trees, name)[row], getattr(alone, name)[0])


def one(samples: list[list[float]], label: list[float]) -> tuple[Grown, Trees]:
    weight = np.full((1, len(samples)), 1 / len(samples))
    grown = SortedSamples.of(np.array([samples])).grow(weight, np.array([label], float))
    return grown, Trees.grown([grown])


def test_thresholds_lie_midway() -> None:
    grown, _ = one([[0.0], [1.0], [4.0], [9.0]], [1, 1, -1, -1])
    assert grown.root.threshold.tolist() == [2.5]
    assert np.isinf(grown.branches.threshold).all()


@pytest.mark.parametrize("samples", [[[3.0, 1.0]] * 5, [[3.0]]], ids=["all patches alike", "one patch"])
def test_samples_that_nothing_parts_get_the_label_that_outweighs(samples: list[list[float]]) -> None:
    label = [1.0, -1.0, 1.0, 1.0, -1.0][: len(samples)]
    grown, trees = one(samples, label)
    assert np.isinf(trees.threshold).all()
    assert (grown.says == 1).all()
    assert (trees.says(np.array([[[-1e9] * len(samples[0]), [1e9] * len(samples[0])]])) == 1).all()


@pytest.mark.parametrize("label", [1.0, -1.0])
def test_one_label_alone_is_what_is_said_of_everything(label: float) -> None:
    grown, trees = one([[0.0], [1.0], [2.0]], [label] * 3)
    assert (grown.says == label).all()
    assert (trees.says(np.array([[[-5.0], [7.0]]])) == label).all()
