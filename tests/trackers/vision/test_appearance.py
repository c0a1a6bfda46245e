"""What is remembered of how people look."""

from __future__ import annotations

import numpy as np

from trackers.vision.histogram import Appearance, HistogramOptions


def test_doubtful_looks_teach_nothing_but_some_in_a_row_do():
    shirts = np.array([[1.0, 0.0], [0.0, 0.0]])
    clothes = Appearance.started(shirts, np.array([9, 0]))
    both, other = np.arange(2), np.array([[0.0, 1.0], [0.0, 1.0]])

    def looked_upon(clothes, doubtful=True):
        return clothes.learned(both, other, np.array([doubtful, doubtful]), 5, 0.4)

    for _ in range(5):
        clothes = looked_upon(clothes)
        assert clothes.reference.tolist() == shirts.tolist()
        assert clothes.n_look.tolist() == [9, 0]
    changed = looked_upon(clothes)
    np.testing.assert_allclose(changed.reference, [[0.4, 0.6], [0.0, 1.0]])  # blended, and the first that there is
    assert changed.n_look.tolist() == [10, 1]
    # in a row: one that is believed between them, and it takes as many again
    again = looked_upon(looked_upon(clothes, doubtful=False))
    np.testing.assert_allclose(again.reference, [[0.4, 0.6], [0.0, 1.0]])


def test_four_looks_are_enough_to_know_what_somebody_wears_now():
    clothes, now = Appearance.started(np.array([[1.0, 0.0]]), np.array([9])), np.array([[0.0, 1.0]])
    for _ in range(4):
        clothes = clothes.learned(np.arange(1), now, np.zeros(1, np.bool_), 0, HistogramOptions().memory)
    distance = clothes.distance(np.array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2, np.bool_))
    assert distance is not None and distance[0, 0] < 0.05 and distance[0, 1] > 0.9


def test_only_looks_that_are_comparable_have_a_distance():
    clothes = Appearance.started(np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([3, 0]))
    looks = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
    distance = clothes.distance(looks, np.array([True, True, False]))
    np.testing.assert_allclose(distance, [[0, 1, np.nan], [np.nan, np.nan, np.nan]])
    assert clothes.distance(looks, np.zeros(3, np.bool_)) is None
    assert clothes.select(np.array([False, True])).distance(looks, np.ones(3, np.bool_)) is None
