"""Routes around furniture: shortest paths over the corners of the footprints, grown by the breadth of a body.

A visibility graph (T. Lozano-Pérez and M. Wesley, "An algorithm for planning collision-free paths among polyhedral
obstacles", Communications of the ACM 22, 1979), built once per room with the shortest path between every two corners. A
query tests only which corners are visible from its two ends. shapely has no visibility graph; its tests of single ways round
otherwise, and would change truth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers.area import TOLERANCE_M, Area, cross
from trackers.arrays import Array, Index, Mask
from trackers.errors import InputError
from twin.geometry.polygon import inset
from twin.room.obstacles import KEEP_FROM_EDGE_M, KEEP_FROM_FURNITURE_M, Footprints, Obstacle, inflated

ROUTE_RADIUS_M = KEEP_FROM_FURNITURE_M + 0.03
"""Distance of routes from furniture and walls [m]: slightly more than people keep, who then walk on freely."""
CLOSE_M = 0.12
"""The same at the two ends of a route, which may lie nearer, at a seat or shelf [m]."""
_EDGE_M = KEEP_FROM_EDGE_M + 0.03
_CLEAR_M = 1e-6
_CUTS_FROM = 1e-4
_MOST_NODES = 100
"""Number of nodes beyond which SciPy is worth its import."""


class Routes:
    """Routes between places in one room for one body breadth, inside `area` and around `obstacles`."""

    def __init__(self, area: Array, obstacles: Sequence[Obstacle]) -> None:
        """`area` (k, 2) [m]: the polygon of routes, `_EDGE_M` off its edges and `ROUTE_RADIUS_M` off the obstacles.

        Raises InputError where the area is too narrow for its margin.
        """
        self._open = not len(obstacles) and _is_convex(area)
        inner = inset(area, _EDGE_M)
        if inner is None:
            raise InputError(f"is too narrow to walk in; more than {2 * _EDGE_M:g} m between its edges is expected")
        self.area, self.obstacles = area, tuple(obstacles)
        self.footprints = Footprints(self.obstacles)
        self._furniture = [each.furniture for each in obstacles]
        self._border, self._inner_border = _Border(area), _Border(inner)
        self._wide = _Convex([inflated(each.corners, ROUTE_RADIUS_M) for each in obstacles])
        close_m = min(CLOSE_M, ROUTE_RADIUS_M) * np.cos(np.pi / 12)  # so that corners are no farther off either
        self._close = _Convex([inflated(each.corners, close_m) for each in obstacles])
        # slightly outside of the polygons, so that ways along their sides touch none
        corners = [inner, *(inflated(each.corners, ROUTE_RADIUS_M + _CLEAR_M) for each in obstacles)]
        nodes = np.concatenate(corners)
        free = Area(inner, _CLEAR_M).contains(nodes) & ~self._wide.contains(nodes).any(axis=1)
        self._nodes = nodes[free]
        first, second = np.triu_indices(len(self._nodes), 1)
        seen = self._sees(self._nodes[first], self._nodes[second], self._wide, self._inner_border)
        lengths = np.zeros((len(self._nodes),) * 2)
        lengths[first[seen], second[seen]] = np.linalg.norm(self._nodes[first] - self._nodes[second], axis=1)[seen]
        lengths += lengths.T
        self._apart, self._before = _shortest_ways(lengths)
        reached = np.isfinite(self._apart)
        self._main = reached[reached.sum(axis=1).argmax()] if len(reached) else np.zeros(0, dtype=bool)

    def way(self, start: Array, goal: Array) -> Array | None:
        """Find the shortest way (k, 2) [m] from start to goal (2,): the corners to pass, then the goal; None without a way.

        An end closer to furniture than the radius is left or reached directly.
        """
        ends = start, goal = np.array([start, goal], dtype=float)
        if not self._stand(ends):
            return None
        if self._open or self._leg(start, goal[None], goal)[0]:
            return goal[None].copy()
        leaves, arrives = self._leg(start, self._nodes), self._leg(goal, self._nodes)
        first, last = np.flatnonzero(leaves), np.flatnonzero(arrives)
        if not (len(first) and len(last)):
            return None
        nodes = self._nodes
        total = (
            np.linalg.norm(nodes[first] - start, axis=1)[:, None]
            + self._apart[np.ix_(first, last)]
            + np.linalg.norm(nodes[last] - goal, axis=1)
        )
        best = np.unravel_index(int(total.argmin()), total.shape)
        if not np.isfinite(total[best]):
            return None
        begin, node = int(first[best[0]]), int(last[best[1]])
        passed = [node]
        while node != begin:
            node = int(self._before[begin, node])
            passed.append(node)
        return np.concatenate([nodes[passed[::-1]], goal[None]])

    def is_straight(self, start: Array, goal: Array) -> bool:
        """Return whether the shortest way from start to goal (2,) [m] passes no corner."""
        ends = start, goal = np.array([start, goal], dtype=float)
        return self._stand(ends) and (self._open or bool(self._leg(start, goal[None], goal)[0]))

    def reachable(self, place: Array) -> bool:
        """Return whether a place (2,) [m] is reachable from the larger part of the free floor."""
        place = np.asarray(place, dtype=float)
        if not self._stand(place[None]):
            return False
        return not len(self._nodes) or bool((self._leg(place, self._nodes) & self._main).any())

    def near(self, place: Array) -> frozenset[str]:
        """Return the furniture closer to a place (2,) [m] than routes keep, which a command to go there approaches."""
        inside = self._wide.contains(np.asarray(place, dtype=float)[None])[0]
        return frozenset(name for name, close in zip(self._furniture, inside, strict=True) if close)

    def _stand(self, places: Array) -> bool:
        """Return whether people can stand at all places (n, 2), possibly close to furniture."""
        return bool(self._border.around.contains(places).all()) and not self._close.contains(places).any()

    def _leg(self, end: Array, others: Array, also: Array | None = None) -> Mask:
        """Return which straight ways from an end (2,) to others (n, 2) are free, ignoring furniture close to the end or to
        `also`.
        """
        ends = end[None] if also is None else np.stack([end, also])
        adjacent = np.asarray(self._wide.contains(ends).any(axis=0))
        border = self._inner_border if self._inner_border.around.contains(ends).all() else self._border
        return self._sees(np.broadcast_to(end, others.shape), others, self._wide.where(adjacent, self._close), border)

    @staticmethod
    def _sees(start: Array, end: Array, shapes: _Convex, border: _Border) -> Mask:
        """Return which straight ways start to end (n, 2) cross no shape and stay within the border."""
        if border.surrounds(start, end):
            return ~shapes.crossed(start, end)
        seen = ~border.cuts(start, end)
        # costlier tests only for the ways left
        seen[seen] = ~shapes.crossed(start[seen], end[seen])
        seen[seen] = border.holds(start[seen], end[seen])
        return seen


class _Convex:
    """Convex polygons as half planes: (m, k, 2) outward normals and (m, k) offsets [m].

    Bounding circles, `middle` (m, 2) and `radius` (m,) [m], spare most ways the test against every side.
    """

    def __init__(self, polygons: Sequence[Array]) -> None:
        most = max((len(corners) for corners in polygons), default=1)
        self._normal = np.zeros((len(polygons), most, 2))
        self._offset = np.ones((len(polygons), most))
        self._middle, self._radius = np.zeros((len(polygons), 2)), np.zeros(len(polygons))
        for number, corners in enumerate(polygons):
            self._middle[number] = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
            self._radius[number] = np.linalg.norm(corners - self._middle[number], axis=1).max() + _CLEAR_M
            way = np.roll(corners, -1, axis=0) - corners
            normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]
            self._normal[number, : len(corners)] = normal  # unused sides hold everywhere: 0 x < 1
            self._offset[number, : len(corners)] = (normal * corners).sum(axis=1)

    def where(self, replaced: Mask, other: _Convex) -> _Convex:
        """Return these polygons with those in `replaced` (m,) taken from another set of equal size."""
        if not replaced.any():
            return self
        mixed = _Convex([])
        most = max(self._offset.shape[1], other._offset.shape[1])
        mine, theirs = self._padded(most), other._padded(most)
        mixed._normal = np.where(replaced[:, None, None], theirs[0], mine[0])
        mixed._offset = np.where(replaced[:, None], theirs[1], mine[1])
        mixed._middle = np.where(replaced[:, None], other._middle, self._middle)
        mixed._radius = np.where(replaced, other._radius, self._radius)
        return mixed

    def _padded(self, most: int) -> tuple[Array, Array]:
        more = most - self._offset.shape[1]
        if not more:
            return self._normal, self._offset
        return (
            np.pad(self._normal, ((0, 0), (0, more), (0, 0))),
            np.pad(self._offset, ((0, 0), (0, more)), constant_values=1.0),
        )

    def contains(self, places: Array) -> Mask:
        """Return whether places (n, 2) lie strictly inside each, (n, m)."""
        return (np.einsum("nc,mkc->nmk", places, self._normal) < self._offset).all(axis=2)

    def crossed(self, start: Array, end: Array) -> Mask:
        """Return whether straight ways start to end (n, 2) cross the inside of any polygon, (n,) (Cyrus and Beck's
        clipping).
        """
        crossed = np.zeros(len(start), dtype=bool)
        way, shape = np.nonzero(self._comes_near(start, end))
        if not len(way):
            return crossed
        depth = self._offset[shape] - np.einsum("pc,pkc->pk", start[way], self._normal[shape])  # positive: inside of it
        speed = np.einsum("pc,pkc->pk", (end - start)[way], self._normal[shape])  # outwards
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = depth / speed
        leaves = np.where(speed > 0, share, np.inf).min(axis=1)
        enters = np.where(speed < 0, share, -np.inf).max(axis=1)
        adjacent = ((speed == 0) & (depth <= 0)).any(axis=1)
        inside = np.maximum(enters, 0.0) < np.minimum(leaves, 1.0) - 1e-12
        crossed[way[inside & ~adjacent]] = True
        return crossed

    def _comes_near(self, start: Array, end: Array) -> Mask:
        """Return whether straight ways start to end (n, 2) enter each bounding circle, (n, m)."""
        return _gap_square(start, end, self._middle) <= self._radius**2


def _is_convex(corners: Array) -> bool:
    """Return whether a simple polygon (k, 2) turns the same way at all corners."""
    way = np.roll(corners, -1, axis=0) - corners
    turn = cross(way, np.roll(way, -1, axis=0))
    return bool((turn >= 0).all() or (turn <= 0).all())


class _Border:
    """Border of a simple polygon (k, 2) [m]: its edges, and the areas within it and up to `TOLERANCE_M` around it."""

    def __init__(self, corners: Array) -> None:
        self.inside, self.around = Area(corners), Area(corners, TOLERANCE_M)
        self._corners, self._following = corners, np.roll(corners, -1, axis=0)
        self._edge = self._following - corners
        kernel = inset(corners, 4 * TOLERANCE_M) if _is_convex(corners) else None
        self._kernel = None if kernel is None else Area(kernel)

    def surrounds(self, start: Array, end: Array) -> bool:
        """Return whether all straight ways start to end (n, 2), from inside, are well off the border, as is found quickly:
        between ends within a convex polygon, and where each is shorter than the gap around its start.
        """
        if self._kernel is not None:
            return bool(self._kernel.contains(np.concatenate([start, end])).all())
        reach_m = np.linalg.norm(end - start, axis=1) + 4 * TOLERANCE_M
        return bool((reach_m**2 < _gap_square(self._corners, self._following, start)).all())

    def cuts(self, start: Array, end: Array) -> Mask:
        """Return which straight ways start to end (n, 2) properly cross an edge."""
        along_way, along_edge = self._shares(start, end)
        between = (along_way > _CUTS_FROM) & (along_way < 1 - _CUTS_FROM)
        between &= (along_edge > _CUTS_FROM) & (along_edge < 1 - _CUTS_FROM)
        return np.asarray(between.any(axis=1))

    def holds(self, start: Array, end: Array) -> Mask:
        """Return whether straight ways start to end (n, 2) stay in the polygon, its border included."""
        inside = self.inside.contains(start)
        near = self._touched(start, end)  # the others stay on one side of the border
        inside[near] = self._holds_piecewise(start[near], end[near])
        return inside

    def _shares(self, start: Array, end: Array) -> tuple[Array, Array]:
        """Intersect straight ways start to end (n, 2) with the lines of the edges.

        Returns shares of the way and of the edge, both (n, k); not finite where parallel.
        """
        way = end - start
        offset = self._corners - start[:, None]  # (n, k, 2)
        turn = cross(way[:, None], self._edge)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # ways of almost no length
            return cross(offset, self._edge) / turn, cross(offset, way[:, None]) / turn

    def _touched(self, start: Array, end: Array) -> Mask:
        """Return which straight ways start to end (n, 2) come to the border or very near it."""
        along_way, along_edge = self._shares(start, end)
        met = (along_way >= 0) & (along_way <= 1) & (along_edge >= 0) & (along_edge <= 1)
        near_square = (2 * TOLERANCE_M) ** 2
        met |= _gap_square(start, end, self._corners) <= near_square
        for place in (start, end):
            of_edges = _gap_square(self._corners, self._following, place).T
            met |= of_edges <= near_square
        return np.asarray(met.any(axis=1))

    def _holds_piecewise(self, start: Array, end: Array) -> Mask:
        """Return the same as `holds`, from the middles of the pieces into which edge lines and corners part each way."""
        way, met = end - start, np.nan_to_num(self._shares(start, end)[0])
        offset = self._corners - start[:, None]  # (n, k, 2)
        adjacent = np.einsum("nkc,nc->nk", offset, way) / np.maximum((way**2).sum(axis=1), TOLERANCE_M**2)[:, None]
        ends = np.zeros((len(start), 1))
        cuts = np.sort(np.clip(np.concatenate([ends, met, adjacent, ends + 1.0], axis=1), 0.0, 1.0), axis=1)
        middles = np.concatenate([ends, (cuts[:, 1:] + cuts[:, :-1]) / 2, ends + 1.0], axis=1)
        places = start[:, None] + middles[..., None] * way[:, None]
        return np.asarray(self.around.contains(places.reshape(-1, 2)).reshape(middles.shape).all(axis=1))


def _gap_square(start: Array, end: Array, places: Array) -> Array:
    """Return squares of the distances [m²] of straight ways start to end (n, 2) from places (m, 2), (n, m)."""
    way = end - start
    x, y = places[:, 0] - start[:, :1], places[:, 1] - start[:, 1:]
    length_square = np.maximum((way**2).sum(axis=1), TOLERANCE_M**2)[:, None]
    along = np.clip((x * way[:, :1] + y * way[:, 1:]) / length_square, 0.0, 1.0)
    return (x - along * way[:, :1]) ** 2 + (y - along * way[:, 1:]) ** 2


def _shortest_ways(lengths: Array) -> tuple[Array, Index]:
    """Return all shortest distances (n, n) [m] along edges of these lengths (n, n), 0 for none, and each way's last node
    but one.

    As SciPy's `shortest_path`, to the bit: after Floyd and Warshall where edges are many, else after Dijkstra from all nodes
    at once.
    """
    count = len(lengths)
    if count > _MOST_NODES:
        from scipy.sparse.csgraph import shortest_path

        return shortest_path(lengths, directed=False, return_predecessors=True)
    nodes, edges = np.arange(count), np.where(lengths > 0, lengths, np.inf)
    apart = np.where(np.eye(count, dtype=bool), 0.0, np.inf)
    before, finished = np.full((count, count), -9999), np.zeros((count, count))
    is_dense = np.count_nonzero(lengths) > count**2 / 4
    if is_dense:
        apart, before = np.minimum(apart, edges), np.where(np.isfinite(edges), nodes[:, None], before)
    for node in nodes:
        if is_dense:
            through, last = apart[:, node, None] + apart[node], np.broadcast_to(before[node], apart.shape)
        else:
            nearest = (apart + finished).argmin(axis=1)
            finished[nodes, nearest] = np.inf
            through = apart[nodes, nearest][:, None] + edges[nearest]
            last = np.broadcast_to(nearest[:, None], apart.shape)
        shorter = through < apart
        apart[shorter], before[shorter] = through[shorter], last[shorter]
    return apart, before
