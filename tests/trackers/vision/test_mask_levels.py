"""How much of cells a mask fills."""

import numpy as np
from hypothesis import given, settings, strategies as st

from trackers.vision.person_detector import MaskLevels, level_of


def scalar(mask, u, v, level):
    """The average over the nine squares of 2^level pixels about a pixel, written out; None beside the picture's edge."""
    side = 2**level
    column, row = int((u + 0.5) // side), int((v + 0.5) // side)
    rows, columns = mask.shape[0] // side, mask.shape[1] // side
    if not (1 <= row < rows - 1 and 1 <= column < columns - 1):
        return None
    return mask[(row - 1) * side : (row + 2) * side, (column - 1) * side : (column + 2) * side].mean()


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_a_cell_is_the_average_of_its_squares(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((48, 64)) < 0.4
    levels = MaskLevels(64, 48, [0, 1, 2])
    pixels, level = rng.uniform(-0.5, (63.5, 47.5), (60, 1, 2)), rng.integers(0, 3, 60)
    read = levels.table(mask)[levels.index(pixels, level)][:, 0] / 255
    for value, (u, v), of in zip(read, pixels[:, 0], level, strict=True):
        expected = scalar(mask, u, v, of)
        if expected is not None:
            assert abs(value - expected) < 0.02  # bytes, rounded at every level


def test_outside_of_the_picture_there_is_nothing():
    levels = MaskLevels(32, 24, [0, 2])
    table = levels.table(np.ones((24, 32), np.bool_))
    outside = np.array([[(-0.6, 3)], [(32, 3)], [(3, -9)], [(3, 24)], [(np.nan, 3)]])
    for level in (0, 2):
        assert (table[levels.index(outside, np.full(5, level))] == 0).all()
        assert (table[levels.index(np.array([[(0.0, 0.0)], [(31, 23)]]), np.full(2, level))] == 255).all()


def test_the_level_follows_the_cell():
    np.testing.assert_array_equal(level_of(np.array([0.1, 3.0, 6.0, 12.5, 1e6, np.nan])), [0, 0, 1, 2, 5, 0])
