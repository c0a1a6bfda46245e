"""Inside a polygon or near it."""

import numpy as np

from trackers.area import within

SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])


def test_inside_outside_and_margin():
    points = np.array([(1.0, 1.0), (2.2, 1.0), (-0.2, -0.2), (5.0, 1.0), (1.0, 2.0)])
    np.testing.assert_array_equal(within(SQUARE, points), [True, False, False, False, True])
    np.testing.assert_array_equal(within(SQUARE, points, 0.25), [True, True, False, False, True])
    np.testing.assert_array_equal(within(SQUARE, points, 0.3), [True, True, True, False, True])


def test_a_polygon_with_a_notch_and_either_sense_of_rotation():
    notched = np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], float)
    points = np.array([(2.0, 0.5), (2.0, 2.0), (0.3, 3.0), (3.7, 3.0)])
    for polygon in (notched, notched[::-1]):
        np.testing.assert_array_equal(within(polygon, points), [True, False, True, True])


def test_no_points():
    assert within(SQUARE, np.empty((0, 2)), 0.1).shape == (0,)
