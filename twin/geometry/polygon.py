"""Polygons on the floor: hulls, containment of straight ways, distances, offsets.

shapely is not used: the results determine truth and routes to the bit, and borders have a width here.
"""

from __future__ import annotations

import numpy as np

from trackers.area import TOLERANCE_M, Area, cross, edge_gaps
from trackers.arrays import Array
from trackers.scipy_functions import scipy_functions

ConvexHull, Delaunay, QhullError = scipy_functions(
    "spatial", "_qhull", "ConvexHull", "Delaunay", "QhullError", needs="linalg.cython_lapack"
)
"""As in `scipy.spatial`."""

_PARALLEL = 1e-9
"""Sine of the angle below which two edges are parallel."""


def leaves_at(corners: Array, start: Array, end: Array) -> Array | None:
    """Return the first place (2,) [m] found outside the simple polygon (k, 2) [m] on the way start to end (2,), or None.

    The way is cut where it meets an edge and beside each corner; each piece is wholly inside or outside.
    """
    way = end - start
    edge = np.roll(corners, -1, axis=0) - corners
    offset = corners - start
    turn = cross(way, edge)
    crosses = turn != 0.0
    met = cross(offset[crosses], edge[crosses]) / turn[crosses]
    adjacent = offset @ way / max(float(way @ way), TOLERANCE_M**2)
    cuts = np.unique(np.clip(np.concatenate([[0.0, 1.0], met, adjacent]), 0.0, 1.0))
    shares = np.sort(np.concatenate([cuts[[0, -1]], (cuts[1:] + cuts[:-1]) / 2]))
    places = start + shares[:, None] * way
    outside = ~Area(corners, TOLERANCE_M).contains(places)
    return places[int(outside.argmax())] if outside.any() else None


def strictly_within(corners: Array, place: Array) -> bool:
    """Return whether a place (2,) lies inside the simple polygon (k, 2) [m], not on its border."""
    inside = bool(Area(corners).contains(place[None])[0])
    return inside and float(edge_gaps(corners, place[None]).min()) > TOLERANCE_M


def polygon_area(corners: Array) -> float:
    """Return the area of the simple polygon (k, 2) [m²], in either sense of rotation."""
    return 0.5 * abs(float(cross(corners, np.roll(corners, -1, axis=0)).sum()))


def counter_clockwise(corners: Array) -> Array:
    """Return the corners (k, 2) of a simple polygon in the order that has the inside on the left."""
    turns_left = cross(corners, np.roll(corners, -1, axis=0)).sum() > 0
    return corners if turns_left else corners[::-1].copy()


def gap_between(first: Array, second: Array) -> float:
    """Return the least distance between two simple polygons (k, 2) and (l, 2) [m], 0 for an overlap."""
    if Area(first).contains(second).any() or Area(second).contains(first).any():
        return 0.0
    one, other = np.roll(first, -1, axis=0) - first, np.roll(second, -1, axis=0) - second
    adjacent = np.sign(cross(one[:, None], second - first[:, None]))  # of corners of the second, edges of the first
    across = np.sign(cross(other[:, None], first - second[:, None]))
    if ((adjacent * np.roll(adjacent, -1, axis=1) < 0) & (across * np.roll(across, -1, axis=1) < 0).T).any():
        return 0.0
    return float(min(edge_gaps(first, second).min(), edge_gaps(second, first).min()))


def thickness_m(corners: Array) -> float:
    """Return the least distance of two parallels that hold a convex polygon (k, 2) between them [m]."""
    edges = np.roll(corners, -1, axis=0) - corners
    edges = edges[np.linalg.norm(edges, axis=1) > 1e-9]
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return float(np.ptp(corners @ normals.T, axis=0).min())


def inset(corners: Array, margin_m: float) -> Array | None:
    """Return the simple polygon (k, 2) shrunk by a margin [m], with the sense of rotation kept; None if too narrow.

    Edges that the margin consumes vanish, the one that is turned round farthest first, and their neighbours meet.
    """
    way = np.roll(corners, -1, axis=0) - corners
    turn = np.sign(cross(corners, np.roll(corners, -1, axis=0)).sum())
    along = way / np.linalg.norm(way, axis=1)[:, None]
    inward = turn * np.stack([-along[:, 1], along[:, 0]], axis=-1)
    before = np.roll(inward, 1, axis=0)
    inner = corners + margin_m * (inward + before) / (1 + (inward * before).sum(axis=1))[:, None]
    kept = np.arange(len(corners))
    while len(kept) >= 3:
        length = ((np.roll(inner, -1, axis=0) - inner) * along[kept]).sum(axis=1)
        if (length > 0).all():
            return inner if Area(corners).contains(inner).all() else None
        kept = np.delete(kept, length.argmin())
        normal, last = inward[kept], np.roll(kept, 1)
        slope = cross(inward[last], normal)
        if (np.abs(slope) < _PARALLEL).any():
            return None
        reach, reach_before = ((inward[each] * corners[each]).sum(axis=1) + margin_m for each in (kept, last))
        across = reach_before[:, None] * normal - reach[:, None] * inward[last]
        inner = np.stack([across[:, 1], -across[:, 0]], axis=-1) / slope[:, None]
    return None


def nearest_on(corners: Array, place: Array) -> Array:
    """Return the place (2,) [m] nearest to `place` on the border of the polygon (k, 2)."""
    return foot_on(corners, place)[1]


def foot_on(corners: Array, place: Array) -> tuple[float, Array]:
    """Return how far along the border of the polygon (k, 2) its place nearest to `place` is [m], and that place (2,) [m]."""
    way = np.roll(corners, -1, axis=0) - corners
    along = ((place - corners) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), TOLERANCE_M**2)
    along = np.clip(along, 0.0, 1.0)
    feet = corners + along[:, None] * way
    edge = int(np.hypot(*(feet - place).T).argmin())
    length = np.hypot(*way.T)
    return float(length[:edge].sum() + along[edge] * length[edge]), feet[edge]


def overlap(one: Array, other: Array) -> bool:
    """Return whether two convex polygons (k, 2) overlap, by separating axes: fast enough for thousands of trials per plan."""
    for shape in (one, other):
        edges = np.roll(shape, -1, axis=0) - shape
        for normal in np.column_stack([-edges[:, 1], edges[:, 0]]):
            mine, theirs = one @ normal, other @ normal
            if mine.max() <= theirs.min() + 1e-9 or theirs.max() <= mine.min() + 1e-9:
                return False
    return True
