"""Polygons: simple ones are told from others, and ways out of them are found."""

from __future__ import annotations

import numpy as np
import pytest

from trackers.area import Area, cross, edge_gaps, meets_itself_at
from twin.geometry.polygon import gap_between, inset, leaves_at, polygon_area, strictly_within

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
BAY = np.array([[-2, 0], [2, 0], [2, 4], [0.8, 4], [0.8, 2], [-0.8, 2], [-0.8, 4], [-2, 4]], dtype=float)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    "corners", [SQUARE, BAY, SQUARE[:3], np.insert(SQUARE, 1, [1.0, 0.0], axis=0)], ids=["square", "bay", "3", "180°"]
)
def test_simple_polygons_are_let_be(corners, turned):
    assert meets_itself_at(corners[::-1] if turned else corners) is None


@pytest.mark.parametrize(
    ("corners", "place"),
    [
        ([[0, 0], [2, 0], [0, 2], [2, 2]], [1, 1]),  # a bow-tie
        ([[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]], [0, 0]),  # closed by its first corner
        ([[0, 0], [2, 0], [2, 0], [0, 2]], [2, 0]),  # a corner twice
        ([[0, 0], [1, 0], [2, 0]], [1, 0]),  # all in one line
        ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], [1, 0]),  # a corner on an edge
        ([[0, 0], [2, 0], [2, 2], [0, 2], [0, 3]], [0, 2]),  # an edge folded back
    ],
)
def test_where_a_polygon_meets_itself(corners, place):
    np.testing.assert_allclose(meets_itself_at(np.array(corners, dtype=float)), place, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ([-1.5, 3.5], [-1.5, 0.5]),
        ([-2, 0], [2, 0]),  # along an edge
        ([-2, 2], [2, 2]),  # along the end of the bay, corners touched
        ([0.8, 4], [0.8, 2]),
        ([1, 1], [1, 1]),
        ([-2 - 1e-8, 0], [-2 - 1e-8, 4]),
    ],
)
def test_ways_that_stay_inside(start, end):
    assert leaves_at(BAY, np.array(start, dtype=float), np.array(end, dtype=float)) is None


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ([-1.5, 3], [1.5, 3]),  # across the bay, both ends inside
        ([-2, 4], [2, 4]),
        ([-1.5, 3], [0.9, 2.01]),
        ([1, 1], [3, 1]),
        ([3, 1], [3, 1]),
        ([-2 - 1e-3, 0], [-2 - 1e-3, 4]),
    ],
)
def test_ways_that_leave(start, end):
    start, end = np.array(start, dtype=float), np.array(end, dtype=float)
    for first, second in ((start, end), (end, start)):
        place = leaves_at(BAY, first, second)
        assert place is not None
        assert not Area(BAY, 1e-6).contains(place[None])[0]


def test_ways_agree_with_many_places_on_them():
    rng = np.random.default_rng(0)
    inside = Area(BAY)
    for start, end in rng.uniform([-2.2, -0.2], [2.2, 4.2], (300, 2, 2)):
        places = start + np.linspace(0, 1, 2000)[:, None] * (end - start)
        left = leaves_at(BAY, start, end) is not None
        if not inside.contains(places).all():
            assert left
        elif left:  # a corner cut between two of the places
            assert min(np.linalg.norm(places[:, None] - BAY, axis=-1).min(axis=0)) < 0.05


def test_a_border_is_not_strictly_inside():
    assert strictly_within(SQUARE, np.array([0.001, 1.0]))
    for x, y in ([0, 1], [2, 1], [1, 0], [1, 2], [0, 0], [2, 2], [2.1, 1]):
        assert not strictly_within(SQUARE, np.array([x, y], dtype=float))


@pytest.mark.parametrize("turned", [False, True])
def test_area_and_inset(turned):
    corners = BAY[::-1] if turned else BAY
    assert polygon_area(corners) == pytest.approx(16 - 3.2)
    inner = inset(corners, 0.2)
    assert inner is not None
    gaps = [gap_between(corners, np.tile(corner, (3, 1)) + 1e-9 * np.eye(3, 2)) for corner in inner]
    assert Area(corners).contains(inner).all()
    assert gaps == [0.0] * len(inner)
    assert polygon_area(inner) == pytest.approx(3.6 * 1.6 + 2 * 0.8 * 2.0)
    assert inset(corners, 0.7) is None


@pytest.mark.parametrize(
    ("other", "gap"),
    [
        (SQUARE + np.array([3.0, 0.0]), 1.0),
        (SQUARE + np.array([3.0, 3.0]), np.sqrt(2)),
        (SQUARE + np.array([2.0, 0.0]), 0.0),
        (SQUARE + np.array([1.0, 0.5]), 0.0),
        (0.2 * SQUARE + 0.5, 0.0),
        (9 * SQUARE - 4.0, 0.0),
        (np.array([[-1.0, 0.9], [3.0, 0.9], [3.0, 1.1], [-1.0, 1.1]]), 0.0),
    ],
)
def test_gaps_between_polygons(other, gap):
    assert gap_between(SQUARE, other) == pytest.approx(gap)
    assert gap_between(other, SQUARE) == pytest.approx(gap)


@pytest.mark.parametrize("margin_m", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("chamfer_m", [0.02, 0.1, 0.3])
def test_edges_that_the_margin_consumes_vanish(margin_m, turned, chamfer_m):
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    way = np.roll(square, -1, axis=0) - square
    cut = np.stack([square + chamfer_m / 2 * way, np.roll(square, -1, axis=0) - chamfer_m / 2 * way], axis=1)
    corners = cut.reshape(-1, 2)[:: -1 if turned else 1]
    inner = inset(corners, margin_m)
    places = np.stack(np.meshgrid(np.linspace(0, 2, 81), np.linspace(0, 2, 81)), axis=-1).reshape(-1, 2)
    depth_m = np.where(Area(corners).contains(places), edge_gaps(corners, places).min(axis=0), 0.0)
    within = Area(inner).contains(places)
    assert within[depth_m > margin_m + 1e-6].all()
    assert not within[depth_m < margin_m - 1e-6].any()
    assert np.sign(cross(inner, np.roll(inner, -1, axis=0)).sum()) == np.sign(
        cross(corners, np.roll(corners, -1, axis=0)).sum()
    )
