"""What is remembered of how people look."""

from __future__ import annotations

import numpy as np

from trackers.tracking.appearance import Appearance


def test_doubtful_looks_teach_nothing_but_some_in_a_row_do():
    places, shirts = np.array([[0.0, 2.0], [0.5, 2.0]]), np.array([[1.0, 0.0], [0.0, 0.0]])
    clothes = Appearance.started(shirts, np.array([9, 0]), 0, places)
    both, other = np.arange(2), np.array([[0.0, 1.0], [0.0, 1.0]])

    def looked_upon(clothes, k, doubtful=True):
        return clothes.learned(both, other, np.array([doubtful, doubtful]), 5, 0.4, k, places + k)

    for k in range(1, 6):
        clothes = looked_upon(clothes, k)
        assert clothes.reference.tolist() == shirts.tolist()
        assert clothes.n_look.tolist() == [9, 0]
        assert clothes.looked_ns.tolist() == [0, 0]
    changed = looked_upon(clothes, 6)
    np.testing.assert_allclose(changed.reference, [[0.4, 0.6], [0.0, 1.0]])  # blended, and the first that there is
    assert changed.n_look.tolist() == [10, 1]
    assert changed.looked_ns.tolist() == [6, 6]
    # in a row: one that is believed between them, and it takes as many again
    again = looked_upon(looked_upon(clothes, 6, doubtful=False), 7)
    np.testing.assert_allclose(again.reference, [[0.4, 0.6], [0.0, 1.0]])


def test_only_looks_that_are_comparable_have_a_distance():
    clothes = Appearance.started(np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([3, 0]), 0, np.zeros((2, 2)))
    looks = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
    distance = clothes.distance(looks, np.array([True, True, False]))
    np.testing.assert_allclose(distance, [[0, 1, np.nan], [np.nan, np.nan, np.nan]])
    assert clothes.distance(looks, np.zeros(3, np.bool_)) is None
    assert clothes.select(np.array([False, True])).distance(looks, np.ones(3, np.bool_)) is None
