"""Polygons on the floor (containment of straight ways, distances, offsets), and convex hulls of geoms.

shapely is not used: the results determine truth and routes to the bit, and borders have a width here. The hull of a geom is
that of points on its surface, in the room frame.
"""

from __future__ import annotations

import mujoco
import numpy as np

from trackers.area import TOLERANCE_M, Area, cross, edge_gaps
from trackers.arrays import Array
from trackers.errors import InputError


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


def inset(corners: Array, margin_m: float) -> Array | None:
    """Return the simple polygon (k, 2) shrunk by a margin [m], corner by corner; None if too narrow."""
    way = np.roll(corners, -1, axis=0) - corners
    turn = np.sign(cross(corners, np.roll(corners, -1, axis=0)).sum())
    inward = turn * np.stack([-way[:, 1], way[:, 0]], axis=-1) / np.linalg.norm(way, axis=1)[:, None]
    before = np.roll(inward, 1, axis=0)
    inner = corners + margin_m * (inward + before) / (1 + (inward * before).sum(axis=1))[:, None]
    turned = ((np.roll(inner, -1, axis=0) - inner) * way).sum(axis=1) <= 0
    return None if turned.any() or not Area(corners).contains(inner).all() else inner


def nearest_on(corners: Array, place: Array) -> Array:
    """Return the place (2,) [m] nearest to `place` on the border of the polygon (k, 2)."""
    way = np.roll(corners, -1, axis=0) - corners
    along = ((place - corners) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), TOLERANCE_M**2)
    feet = corners + np.clip(along, 0.0, 1.0)[:, None] * way
    return feet[np.hypot(*(feet - place).T).argmin()]


PLANE_M = 0.05
"""Thickness of a wall made of a plane, on its far side [m]."""
FARTHEST_M = 10_000.0
"""Greatest distance of objects from the room's origin [m]."""
ENDLESS_M = 50.0
"""Half the side of an infinite plane [m]."""
_SIDES = 24  # of the polygon for a circle


def hull_points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array | None:
    """Return points (n, 3) [m] whose hull is the geom's, round ones to 1 %; None for height fields. `data` needs
    kinematics."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            local = size * _cube([-1, 1], [-1, 1], [-1, 1])
        case mujoco.mjtGeom.mjGEOM_PLANE:
            x, y = np.where(size[:2] > 0, size[:2], ENDLESS_M)
            local = _cube([-x, x], [-y, y], [-PLANE_M, 0])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            ring = size[0] * circle
            local = np.concatenate([np.column_stack([ring, np.full(_SIDES, end)]) for end in (-size[1], size[1])])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            ends = [size[0] * _ball(circle) + [0.0, 0.0, end] for end in (-size[1], size[1])]
            local = np.concatenate(ends)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            local = size[0] * _ball(circle)
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            local = size * _ball(circle)
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float)
        case _:
            return None
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def check_extent(model: mujoco.MjModel, data: mujoco.MjData, source: str) -> None:
    """Raise InputError, naming `source`, for a geom that reaches farther than `FARTHEST_M`. `data` needs kinematics."""
    size_m = np.where(
        model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, model.geom_size[:, :2].max(axis=1), model.geom_rbound
    )
    reach_m = np.abs(data.geom_xpos).max(axis=1) + size_m
    for geom in np.flatnonzero(~(reach_m <= FARTHEST_M))[:1].tolist():
        name = model.geom(geom).name or f"geom {geom}"
        raise InputError(
            f"{source}: {name!r} reaches {reach_m[geom]:.3g} m from the room's origin; at most {FARTHEST_M:g} m is expected"
        )


def _cube(x: list[float], y: list[float], z: list[float]) -> Array:
    return np.array(np.meshgrid(x, y, z), dtype=float).reshape(3, -1).T


def _ball(circle: Array) -> Array:
    """Return points (n, 3) of the unit sphere: rings between the poles."""
    rings = [
        np.column_stack([np.cos(up) * circle, np.full(len(circle), np.sin(up))])
        for up in np.deg2rad(np.arange(-75, 76, 15))
    ]
    return np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
