"""Obstacles for walking bodies: convex footprints of furniture and walls on the floor, and distances to them.

Taken from the geoms of any MJCF file: all that stand still and reach into the band of heights of a body. The whole footprint
is kept free, so feet do not go under a table.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from trackers.area import TOLERANCE_M, Area
from trackers.arrays import Array, Mask, Planar
from trackers.errors import InputError
from trackers.user_input.text_file import check_limit
from twin.geometry.geom_hull import hull_points, stands_still
from twin.geometry.polygon import ConvexHull, gap_between, polygon_area

LOW_M, HIGH_M = 0.05, 2.0
"""Heights between which a geom is in a walking body's way [m]: excludes rugs, floor marks and lamps."""

_LEVEL = 0.99
"""Least vertical part of the normal of a level plane."""
KEEP_FROM_EDGE_M = 0.15
"""Least distance of a person's middle from the edge of the area [m]."""
KEEP_FROM_FURNITURE_M = 0.35
"""Least distance of a person's middle from furniture and walls [m]: hands swing at the height of a table."""
OBSTACLE_REACH_M = KEEP_FROM_FURNITURE_M - KEEP_FROM_EDGE_M
"""Distance from an area within which an obstacle affects people who stay in it [m]."""
_THIN_M = 1e-3
_SIDES = 12
_OCTAGON = np.array([[np.cos(angle), np.sin(angle)] for angle in np.arange(8) * np.pi / 4])
MOST_OBSTACLES = 500
"""Greatest number of footprints for routes: memory grows with its square."""
MOST_OF_ONE = 200
"""Greatest number of footprints of one piece of furniture: the time to merge them grows with its cube."""
_MERGED = 1.15
"""Two footprints become their hull if that covers at most this multiple of the larger one, or no more than both."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A convex footprint: `corners` (k, 2) counter-clockwise, room frame [m].

    `furniture`: the body of the geom, or the geom's own name directly in the worldbody; `top_m`: height of its top, of the
    highest geom in people's way [m].
    """

    furniture: str
    corners: Array
    top_m: float = np.inf


@dataclass(frozen=True, eq=False)
class Solid:
    """A geom in people's way: its convex outline `corners` (k, 2) on the floor and its heights [m], room frame.

    `furniture`: as of an `Obstacle`.
    """

    furniture: str
    corners: Array
    low_m: float
    high_m: float


def solids_of(model: mujoco.MjModel, data: mujoco.MjData) -> list[Solid]:
    """Return the geoms of a room that are in people's way, without attached people; `data` needs kinematics."""
    found = []
    for geom in np.flatnonzero(stands_still(model)).tolist():
        points = hull_points(model, data, geom)
        if points is not None and is_in_the_way(model, data, geom, points):
            corners = _few_corners(_hull(points[:, :2]))
            found.append(Solid(furniture_name(model, geom), corners, points[:, 2].min(), points[:, 2].max()))
    return found


def furniture_name(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of the body of a geom, or the geom's own directly in the worldbody."""
    body = int(model.geom_bodyid[geom])
    return (model.body(body).name or f"body {body}") if body else model.geom(geom).name or f"geom {geom}"


def obstacles_of(model: mujoco.MjModel, source: str = "room") -> list[Obstacle]:
    """Return the footprints of a room's furniture and walls, without attached people.

    Geoms whose top is below `LOW_M` or foot above `HIGH_M`, floors and invisible geoms (alpha 0) are no obstacles.
    Footprints of one piece of furniture that (nearly) cover each other become one, round ones an octagon about them; geoms
    directly in the worldbody within another footprint (books in a shelf) are left out. Raises InputError for a height field,
    and for more geoms of one piece than `MOST_OF_ONE`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found: dict[str, list[Array]] = {}
    top_m: dict[str, float] = {}
    loose: set[str] = set()
    for geom in np.flatnonzero(stands_still(model)).tolist():
        points = hull_points(model, data, geom)
        name = model.geom(geom).name or f"geom {geom}"
        if points is None:
            raise InputError(
                f"{source}: geom {name!r} is a height field; boxes, planes, round shapes or meshes are expected"
            )
        if not is_in_the_way(model, data, geom, points):
            continue
        if not model.geom_bodyid[geom]:
            loose.add(name)
        body = furniture_name(model, geom)
        found.setdefault(body, []).append(_few_corners(_hull(points[:, :2])))
        top_m[body] = max(top_m.get(body, 0.0), float(points[:, 2].max()))
    for name, shapes in found.items():
        check_limit(len(shapes), MOST_OF_ONE, f"{source}: {name!r} stands in people's way with", "geoms")
    obstacles = [Obstacle(name, corners, top_m[name]) for name, shapes in found.items() for corners in _merged(shapes)]
    covered = _covered(obstacles)
    return [each for each, hidden in zip(obstacles, covered, strict=True) if not (each.furniture in loose and hidden)]


def is_in_the_way(model: mujoco.MjModel, data: mujoco.MjData, geom: int, points: Array) -> bool:
    """Return True for a geom, of hull `points` (n, 3) [m], between the floor and the heads.

    A level plane has no thickness; one that faces down is a ceiling.
    """
    low_m, high_m = points[:, 2].min(), points[:, 2].max()
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and abs(data.geom_xmat[geom, 8]) > _LEVEL:
        if data.geom_xmat[geom, 8] < 0:
            return False
        low_m = high_m = data.geom_xpos[geom, 2]
    return bool(high_m > LOW_M and low_m < HIGH_M)


def within_reach(obstacles: Sequence[Obstacle], area: Array, reach_m: float) -> list[Obstacle]:
    """Return the obstacles in the polygon `area` (k, 2) [m] or less than `reach_m` [m] from it."""
    return [each for each in obstacles if gap_between(area, each.corners) < reach_m - TOLERANCE_M]


class Footprints:
    """Obstacles as arrays, for all people at once."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self._names = [each.furniture for each in obstacles]
        count, most = len(obstacles), max((len(each.corners) for each in obstacles), default=1)
        start, end = np.zeros((count, most), dtype=complex), np.ones((count, most), dtype=complex)
        for number, each in enumerate(obstacles):
            corners = each.corners[:, 0] + 1j * each.corners[:, 1]
            used = np.minimum(np.arange(most), len(corners) - 1)  # repeat the last edge
            start[number], end[number] = corners[used], np.roll(corners, -1)[used]
        way = (end - start).ravel()
        self._sides = most
        self._has_inside = np.array([len(each.corners) > 2 for each in obstacles], dtype=bool)
        self._length = np.abs(way)
        self._along = way / self._length
        self._turn_back = self._along.conj()
        self._origin = start.ravel() * self._turn_back
        self._first = np.arange(count) * most  # the first edge of each obstacle

    def __len__(self) -> int:
        return len(self._names)

    def belong_to(self, furniture: Collection[str]) -> Mask:
        """Return a mask (m,) of the obstacles of the named furniture. Raises ValueError for an unknown name."""
        unknown = set(furniture).difference(self._names)
        if unknown:
            raise ValueError(f"no obstacle belongs to {sorted(unknown)}; there are {sorted(set(self._names))}")
        return np.array([name in furniture for name in self._names], dtype=bool)

    def gaps(self, places: Planar) -> tuple[Planar, Array]:
        """Return directions (n, m) from places (n,) to the nearest border of each obstacle, and distances (n, m) [m].

        Inside an obstacle the distance is negative and the direction points further in, away from the nearest border.
        """
        local = places[:, None] * self._turn_back - self._origin  # (n, edges): along each edge, and to the left of it
        along, left = local.real.copy(), local.imag.copy()
        beyond = along - np.minimum(np.maximum(along, 0.0), self._length)
        square = beyond * beyond + left * left
        shape = (len(places), len(self), self._sides)
        edge = square.reshape(shape).argmin(axis=2) + self._first  # (n, m)
        place = edge + (np.arange(len(places)) * len(self._length))[:, None]
        offset = local.take(place)
        maybe_inside = (offset.imag > 0) & self._has_inside
        offset.real = beyond.take(place)
        distance = np.sqrt(square.take(place))
        towards = offset * self._along.take(edge) / -np.maximum(distance, 1e-9)
        if np.count_nonzero(maybe_inside):
            inside = left.reshape(shape).min(axis=2) > 0
            return np.where(inside, -towards, towards), np.where(inside, -distance, distance)
        return towards, distance


def inflated(corners: Array, margin_m: float) -> Array:
    """Return the convex polygon (k, 2) grown by a margin [m], with corners cut by a polygon of 12 sides about the circle."""
    angle = 2 * np.pi * (np.arange(_SIDES) + 0.5) / _SIDES
    disc = margin_m / np.cos(np.pi / _SIDES) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _hull((corners[:, None] + disc).reshape(-1, 2))


def _covered(obstacles: list[Obstacle]) -> list[bool]:
    """Return a mask of the footprints fully inside a larger one."""
    if not obstacles:
        return []
    low = np.array([each.corners.min(axis=0) for each in obstacles])
    high = np.array([each.corners.max(axis=0) for each in obstacles])
    size = np.array([polygon_area(each.corners) for each in obstacles])
    # bounding boxes first: rooms have dozens of footprints, and few contain another
    may_hold = (low[:, None] - _THIN_M <= low).all(axis=2) & (high[:, None] + _THIN_M >= high).all(axis=2)
    may_hold &= size[:, None] > size
    return [
        any(Area(obstacles[other].corners, _THIN_M).contains(one.corners).all() for other in holders.nonzero()[0])
        for one, holders in zip(obstacles, may_hold.T, strict=True)
    ]


def _few_corners(corners: Array) -> Array:
    """Return the convex polygon (k, 2), or an octagon about it if it has more corners."""
    if len(corners) <= len(_OCTAGON):
        return corners
    support = (corners @ _OCTAGON.T).max(axis=0)  # along eight directions
    after, reach = np.roll(_OCTAGON, -1, axis=0), np.roll(support, -1)
    normals = np.stack([_OCTAGON, after], axis=1)  # (8, 2, 2): a corner is the meeting of two sides
    return _hull(np.linalg.solve(normals, np.stack([support, reach], axis=1)[..., None])[..., 0])


def _hull(points: Array) -> Array:
    """Return the convex hull (k, 2), counter-clockwise; too thin shapes are made `_THIN_M` thick."""
    if min(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)) < _THIN_M:
        points = (points[:, None] + _THIN_M * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])).reshape(-1, 2)
    return points[ConvexHull(points).vertices]


def _merged(shapes: list[Array]) -> list[Array]:
    """Merge the shapes that nearly cover each other, or are in line."""
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


_FAR_M = 1e6


def edges_of(areas: Sequence[Array | None]) -> tuple[list[Obstacle], Array]:
    """Return the edges of all areas as obstacles without an inside, and the clearance of each person (n, edges) [m].

    Edges of other people's areas do not confine a person.
    """
    edges: list[Obstacle] = []
    keep = np.full((len(areas), 0), -_FAR_M)
    known: list[Array] = []
    for area in areas:
        if area is None or any(np.array_equal(area, other) for other in known):
            continue
        known.append(area)
        edges += [Obstacle("area", np.stack(ends)) for ends in zip(area, np.roll(area, -1, axis=0), strict=True)]
        own = np.array([each is not None and np.array_equal(each, area) for each in areas], dtype=bool)
        keep = np.concatenate(
            [keep, np.where(own, KEEP_FROM_EDGE_M, -_FAR_M)[:, None].repeat(len(area), axis=1)], axis=1
        )
    return edges, keep
