"""Furniture and walls as a walking body meets them: convex footprints on the floor, and how far everybody is from each.

Taken from the room's own geoms, in any MJCF file: whatever stands still and reaches into the band of heights that a
body takes up. The whole footprint of such a geom is kept free, so nobody's feet go under a table.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from trackers.limits import check_limit
from twin.geometry.geom_hull import hull_points
from twin.geometry.polygon import TOLERANCE_M, gap_between, polygon_area

Planar = NDArray[np.complex128]

LOW_M, HIGH_M = 0.05, 2.0
"""Heights between which a geom is in a walking body's way [m]: neither rugs and floor marks nor lamps are."""

KEEP_FROM_EDGE_M = 0.15
"""Least distance of a person's middle from the edge of the area [m]."""
KEEP_FROM_FURNITURE_M = 0.35
"""Least distance of a person's middle from furniture and walls [m]: hands swing at the height of a table."""
OBSTACLE_REACH_M = KEEP_FROM_FURNITURE_M - KEEP_FROM_EDGE_M
"""Greatest distance from an area at which an obstacle is still in the way of somebody who stays in the area [m]."""
_THIN_M = 1e-3
_OCTAGON = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(8) * np.pi / 4])
MOST_OBSTACLES = 500
"""Footprints that people find their ways around: the memory that takes grows with their square."""
MOST_OF_ONE = 200
"""Footprints of one piece of furniture: the time that merging them takes grows with their cube."""
_MERGED = 1.15
"""Two footprints become their hull where that covers at most this multiple of the larger one, or no more than both."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A convex footprint: `corners` (k, 2) counter-clockwise, room frame [m].

    `furniture` is what it belongs to: the body that holds the geom, or the geom's own name where that stands right in
    the worldbody.
    """

    furniture: str
    corners: Array


def obstacles_of(model: mujoco.MjModel, source: str = "room") -> list[Obstacle]:
    """Return the footprints of a room's furniture and walls; people attached to the model are left out, as they can move.

    Geoms whose top is below `LOW_M`, whose foot is above `HIGH_M`, floors and what nobody sees (alpha 0) are no obstacles.
    Footprints of one piece of furniture that (nearly) cover each other become one, round ones an octagon about them, and
    geoms right in the worldbody that stand within another footprint (books in a shelf) are left out. Raises InputError for a
    height field, and for more geoms of one thing than `MOST_OF_ONE`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, list[Array]] = {}
    loose: set[str] = set()
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] != 0 or model.geom_rgba[geom, 3] == 0:
            continue
        points = hull_points(model, data, geom)
        name = model.geom(geom).name or f"geom {geom}"
        if points is None:
            raise InputError(
                f"{source}: geom {name!r} is a height field; boxes, planes, round shapes or meshes are expected"
            )
        is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        level = is_plane and abs(data.geom_xmat[geom, 8]) > 0.99  # a floor's underside, a ceiling
        if level or points[:, 2].max() <= LOW_M or points[:, 2].min() >= HIGH_M:
            continue
        body = int(model.geom_bodyid[geom])
        furniture = (model.body(body).name or f"body {body}") if body else name
        if not body:
            loose.add(name)
        found.setdefault(furniture, []).append(_few_corners(_hull(points[:, :2])))
    for name, shapes in found.items():
        check_limit(len(shapes), MOST_OF_ONE, f"{source}: {name!r} stands in people's way with", "geoms")
    obstacles = [Obstacle(name, corners) for name, shapes in found.items() for corners in _merged(shapes)]
    covered = _covered(obstacles)
    return [each for each, hidden in zip(obstacles, covered, strict=True) if not (each.furniture in loose and hidden)]


def within_reach(obstacles: Sequence[Obstacle], area: Array, reach_m: float) -> list[Obstacle]:
    """Return the obstacles that lie in the polygon `area` (k, 2) [m] or less than `reach_m` [m] from it."""
    return [each for each in obstacles if gap_between(area, each.corners) < reach_m - TOLERANCE_M]


class Footprints:
    """Obstacles as arrays, for all people at once."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self._names = [each.furniture for each in obstacles]
        count, most = len(obstacles), max((len(each.corners) for each in obstacles), default=1)
        start, end = np.zeros((count, most), dtype=complex), np.ones((count, most), dtype=complex)
        for number, each in enumerate(obstacles):
            corners = each.corners[:, 0] + 1j * each.corners[:, 1]
            used = np.minimum(np.arange(most), len(corners) - 1)  # the last edge fills up
            start[number], end[number] = corners[used], np.roll(corners, -1)[used]
        way = (end - start).ravel()
        self._sides = most
        self._length = np.abs(way)
        self._along = way / self._length
        self._turn_back = self._along.conj()
        self._origin = start.ravel() * self._turn_back
        self._first = np.arange(count) * most  # the first edge of each obstacle

    def __len__(self) -> int:
        return len(self._names)

    def belong_to(self, furniture: Collection[str]) -> Mask:
        """Mask (m,) the obstacles that belong to the named pieces of furniture. Raises ValueError for an unknown name."""
        unknown = set(furniture).difference(self._names)
        if unknown:
            raise ValueError(f"no obstacle belongs to {sorted(unknown)}; there are {sorted(set(self._names))}")
        return np.array([name in furniture for name in self._names], dtype=bool)

    def gaps(self, places: Planar) -> tuple[Planar, Array]:
        """Return directions (n, m) from places (n,) to the nearest border of each obstacle, and distances (n, m) [m].

        Inside an obstacle the distance is negative and the direction points further in, away from the nearest border.
        """
        count = len(places)
        local = places[:, None] * self._turn_back - self._origin  # (n, edges): along each edge, and to the left of it
        left = local.imag.copy()
        beyond = local.real - np.minimum(np.maximum(local.real, 0.0), self._length)
        square = beyond * beyond + left * left
        shape = (count, len(self), self._sides)
        edge = square.reshape(shape).argmin(axis=2) + self._first  # (n, m)
        place = edge + (np.arange(count) * len(self._length))[:, None]
        offset = beyond.take(place) + 1j * left.take(place)
        distance = np.sqrt(square.take(place))
        inside = left.reshape(shape).min(axis=2) > 0
        towards = offset * self._along.take(edge) / -np.maximum(distance, 1e-9)
        if np.count_nonzero(inside):
            return np.where(inside, -towards, towards), np.where(inside, -distance, distance)
        return towards, distance


def inflated(corners: Array, margin_m: float, sides: int = 12) -> Array:
    """Return the convex polygon (k, 2) with a margin [m] all around, corners cut by a polygon of `sides` about the
    circle."""
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    disc = margin_m / np.cos(np.pi / sides) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _hull((corners[:, None] + disc).reshape(-1, 2))


def _covered(obstacles: list[Obstacle]) -> list[bool]:
    """Mask the footprints that a larger one holds all of."""
    if not obstacles:
        return []
    low = np.array([each.corners.min(axis=0) for each in obstacles])
    high = np.array([each.corners.max(axis=0) for each in obstacles])
    size = np.array([polygon_area(each.corners) for each in obstacles])
    # only where the boxes about them allow it: rooms have dozens of footprints, and few hold another
    may_hold = (low[:, None] - _THIN_M <= low).all(axis=2) & (high[:, None] + _THIN_M >= high).all(axis=2)
    may_hold &= size[:, None] > size
    return [
        any(Area(obstacles[other].corners, _THIN_M).contains(one.corners).all() for other in holders.nonzero()[0])
        for one, holders in zip(obstacles, may_hold.T, strict=True)
    ]


def _few_corners(corners: Array) -> Array:
    """Return the convex polygon (k, 2) itself, or an octagon about it where it has more corners."""
    if len(corners) <= len(_OCTAGON):
        return corners
    support = (corners @ _OCTAGON.T).max(axis=0)  # along eight directions
    after, reach = np.roll(_OCTAGON, -1, axis=0), np.roll(support, -1)
    normals = np.stack([_OCTAGON, after], axis=1)  # (8, 2, 2): a corner is where two sides meet
    return _hull(np.linalg.solve(normals, np.stack([support, reach], axis=1)[..., None])[..., 0])


def _hull(points: Array) -> Array:
    """Return the convex hull (k, 2), counter-clockwise; what is too thin for one is made `_THIN_M` thick."""
    if min(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)) < _THIN_M:
        points = (points[:, None] + _THIN_M * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])).reshape(-1, 2)
    return points[ConvexHull(points).vertices]


def _merged(shapes: list[Array]) -> list[Array]:
    """Return the shapes with those that nearly cover each other, or stand in line, made one."""
    shapes = list(shapes)
    while True:
        for first in range(len(shapes)):
            for second in range(first + 1, len(shapes)):
                hull = _hull(np.concatenate([shapes[first], shapes[second]]))
                parts = polygon_area(shapes[first]), polygon_area(shapes[second])
                hull = _few_corners(hull)
                if polygon_area(hull) <= _MERGED * max(parts) or polygon_area(hull) <= sum(parts):
                    shapes[first] = hull
                    del shapes[second]
                    break
            else:
                continue
            break
        else:
            return shapes
