"""Inside a polygon or near it."""

import numpy as np
import pytest

from trackers.area import Area

SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])


def test_inside_outside_and_margin():
    points = np.array([(1.0, 1.0), (2.2, 1.0), (-0.2, -0.2), (5.0, 1.0), (1.0, 2.0)])
    np.testing.assert_array_equal(Area(SQUARE).contains(points), [True, False, False, False, True])
    np.testing.assert_array_equal(Area(SQUARE, 0.25).contains(points), [True, True, False, False, True])
    np.testing.assert_array_equal(Area(SQUARE, 0.3).contains(points), [True, True, True, False, True])


def test_a_polygon_with_a_notch_and_either_sense_of_rotation():
    notched = np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], float)
    points = np.array([(2.0, 0.5), (2.0, 2.0), (0.3, 3.0), (3.7, 3.0)])
    for polygon in (notched, notched[::-1]):
        np.testing.assert_array_equal(Area(polygon).contains(points), [True, False, True, True])


def test_no_points():
    assert Area(SQUARE, 0.1).contains(np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    "corners", [SQUARE, [(0, 0), (3, -1), (4, 2), (1, 3)], [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)]]
)
def test_many_points_at_once_are_the_same_as_one_by_one(corners, turn):
    area = Area(np.array(corners, float)[::turn], 0.1)
    points = np.random.default_rng(3).uniform(-2, 5, (500, 2))
    one_by_one = [bool(area.contains(point[None])[0]) for point in points]
    assert area.contains(points).tolist() == one_by_one
    assert 0 < sum(one_by_one) < 500


def test_a_polygon_without_an_inside_holds_its_border_only():
    area = Area(np.array([(0, 0), (1, 0), (2, 0)], float))
    assert area.contains(np.array([(1.0, 0.0), (1.0, 0.5), (9.0, 0.0)])).tolist() == [True, False, False]
