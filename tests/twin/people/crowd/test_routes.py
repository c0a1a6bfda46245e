"""Routes: they keep off furniture, they are short, and there is none where there is none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from trackers.area import Area
from trackers.errors import InputError
from twin.people.crowd.routes import ROUTE_RADIUS_M, Routes
from twin.room.obstacles import Footprints, Obstacle

pytestmark = pytest.mark.slow

ROOM = np.array([[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]])
BAY = np.array([[-2, 0], [2, 0], [2, 4], [0.8, 4], [0.8, 2], [-0.8, 2], [-0.8, 4], [-2, 4]], dtype=float)


def box(name, x, y, half_x, half_y, yaw=0.0):
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [half_x, half_y]
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return Obstacle(name, corners @ turn + [x, y])


def length(start, way):
    return sum(np.linalg.norm(after - here) for here, after in pairwise([np.asarray(start), *way]))


def least_gap(obstacles, start, way):
    stops = np.array([start, *way])
    places = np.concatenate(
        [here + np.linspace(0, 1, 200)[:, None] * (after - here) for here, after in pairwise(stops)]
    )
    return Footprints(obstacles).gaps(places[:, 0] + 1j * places[:, 1])[1].min(), places


def test_a_free_way_is_straight():
    routes = Routes(ROOM, [box("table", 0, 0, 0.5, 0.5)])
    np.testing.assert_array_equal(routes.way([-2, 2], [2, 2]), [[2, 2]])


def test_a_table_is_walked_around_the_shorter_way():
    table = box("table", 0, 0.2, 0.2, 1.0)
    routes = Routes(ROOM, [table])
    way = routes.way(np.array([-2.0, 0.0]), np.array([2.0, 0.0]))
    assert least_gap([table], [-2.0, 0.0], way)[0] >= ROUTE_RADIUS_M - 1e-6
    assert (way[:-1, 1] < 0).all()
    corner = np.hypot(2 - 0.2, 0.8 + ROUTE_RADIUS_M)
    assert 4.0 < length([-2, 0], way) < 2 * corner + 0.4 + 0.2


def test_ways_lead_around_the_corners_of_the_area():
    routes = Routes(BAY, [])
    way = routes.way([-1.5, 3.5], [1.5, 3.5])
    _, places = least_gap([box("far", 50, 50, 1, 1)], [-1.5, 3.5], way)
    assert len(way) == 3
    assert Area(BAY, 1e-6).contains(places).all()
    starts, steps = np.random.default_rng(1).normal([[[0, 2]], [[0, 0]]], [[[1]], [[0.5]]], (2, 200, 2))
    straight = np.array([routes.is_straight(*ends) for ends in zip(starts, starts + steps, strict=True)])
    places = starts + np.linspace(0, 1, 50)[:, None, None] * steps
    inside = Area(BAY, 1e-6).contains(places.reshape(-1, 2)).reshape(50, -1).all(axis=0)
    np.testing.assert_array_equal(straight, inside)
    assert 50 < inside.sum() < 150


def test_no_way_into_a_closed_corner_or_furniture_or_out():
    walls = [box("wall", 0, 0, 3.2, 0.05), box("table", 1, -1.5, 0.5, 0.5)]
    routes = Routes(ROOM, walls)
    assert routes.way([0, 1], [0, -1]) is None
    assert routes.way([-2, -2], [1, -1.5]) is None
    assert routes.way([-2, -2], [5, 0]) is None
    assert not routes.reachable([1, -1.5])
    assert not routes.reachable([5, 0])
    assert routes.reachable([-2, -2]) != routes.reachable([-2, 2])


def test_a_gap_is_passed_if_a_body_fits():
    def doorway(half_gap):
        return [box("left", -1.6, 0, 1.6 - half_gap, 0.05), box("right", 1.6, 0, 1.6 - half_gap, 0.05)]

    wide, narrow = doorway(ROUTE_RADIUS_M + 0.02), doorway(ROUTE_RADIUS_M - 0.02)
    assert Routes(ROOM, wide).way([0.2, 1], [0, -1]) is not None
    assert Routes(ROOM, narrow).way([0.2, 1], [0, -1]) is None


def test_the_ends_may_be_close_to_furniture():
    chair, table = box("chair", 0, 0, 0.2, 0.2), box("table", 0.0, 1.5, 0.5, 0.3)
    routes = Routes(ROOM, [chair, table])
    goal = np.array([0.35, 0.0])
    way = routes.way([-2.0, 0.0], goal)
    assert way is not None and len(way) > 2
    np.testing.assert_array_equal(way[-1], goal)
    assert least_gap([chair], [-2.0, 0.0], way)[0] >= 0.11
    assert routes.near(goal) == {"chair"}
    assert routes.near(np.array([-2.0, 0.0])) == frozenset()
    assert routes.reachable(goal)
    assert routes.way(goal, [-2.0, 0.0]) is not None
    assert routes.way([0.25, 0.0], [-2.0, 0.0]) is None  # inside what a body's middle cannot be in


def test_an_area_without_room_is_refused():
    with pytest.raises(InputError, match="too narrow"):
        Routes(np.array([[0, 0], [5, 0], [5, 0.2], [0, 0.2]]), [])


boxes = st.builds(
    box,
    st.just("box"),
    st.floats(-2.5, 2.5),
    st.floats(-2.5, 2.5),
    st.floats(0.1, 0.8),
    st.floats(0.1, 0.8),
    st.floats(0, 3),
)
place = st.tuples(st.floats(-2.7, 2.7), st.floats(-2.7, 2.7))


@settings(max_examples=80, deadline=None)
@given(st.lists(boxes, min_size=1, max_size=5), place, place)
def test_routes_never_cross_what_is_kept_free(obstacles, start, goal):
    ends = np.array([complex(*start), complex(*goal)])
    assume(Footprints(obstacles).gaps(ends)[1].min() > 1.05 * ROUTE_RADIUS_M)
    routes = Routes(ROOM, obstacles)
    way = routes.way(start, goal)
    back = routes.way(goal, start)
    assert (way is None) == (back is None)
    assert routes.is_straight(start, goal) == (way is not None and len(way) == 1)
    if way is None:
        return
    np.testing.assert_array_equal(way[-1], goal)
    gap, places = least_gap(obstacles, start, way)
    assert gap >= ROUTE_RADIUS_M - 1e-6
    assert Area(ROOM, 1e-6).contains(places).all()
    assert length(start, way) == pytest.approx(length(goal, back), abs=1e-4)
    assert length(start, way) >= abs(ends[1] - ends[0]) - 1e-9


def test_a_route_is_as_short_as_a_fine_grid_finds():
    obstacles = [box("a", -0.5, 0.5, 0.8, 0.2, 0.4), box("b", 1.2, -0.8, 0.2, 1.0, 1.2), box("c", 0.8, 1.5, 0.3, 0.6)]
    routes = Routes(ROOM, obstacles)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    side = np.linspace(-2.8, 2.8, 113)
    grid = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    free = Footprints(obstacles).gaps(grid[:, 0] + 1j * grid[:, 1])[1].min(axis=1) > ROUTE_RADIUS_M
    number = np.arange(len(grid)).reshape(113, 113)
    rows, columns, weights = [], [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2)):
        a = number[: 113 - dx, max(0, -dy) : 113 - max(0, dy)].ravel()
        b = number[dx:, max(0, dy) : 113 + min(0, dy)].ravel()
        both = free[a] & free[b]
        rows.append(a[both])
        columns.append(b[both])
        weights.append(np.full(both.sum(), 0.05 * np.hypot(dx, dy)))
    graph = coo_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(113**2,) * 2)
    start, goal = np.array([-2.0, 0.0]), np.array([2.0, 0.5])
    begin, end = (int(np.linalg.norm(grid - place, axis=1).argmin()) for place in (start, goal))
    shortest = dijkstra(graph.tocsr(), directed=False, indices=begin)[end]
    ours = length(start, routes.way(start, goal))
    assert 0.95 * shortest < ours < 1.02 * shortest
