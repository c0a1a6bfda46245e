"""Floor of a room: its level surfaces at z = 0, of any geoms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from trackers.area import Area
from trackers.arrays import Array
from trackers.errors import InputError
from twin.geometry.geom_hull import hull_points, stands_still
from twin.geometry.polygon import ConvexHull

AT_FLOOR_M = 0.01
"""Greatest height over z = 0 of a level surface that is floor [m]: people's soles are at z = 0."""
_LEVEL = 0.99
_LEAST_M2 = 0.01


@dataclass(frozen=True, eq=False)
class LevelSurface:
    """Level surface that faces up: the geom's name, its height [m], and its convex pieces (k, 2) [m]."""

    geom: str
    height_m: float
    pieces: tuple[Array, ...]


def level_surfaces(model: mujoco.MjModel, data: mujoco.MjData) -> list[LevelSurface]:
    """Return the tops of the room's level planes, boxes, cylinders and meshes, static and visible, at any height.

    Infinite planes extend as far as `hull_points` does. `data` needs kinematics.
    """
    found = []
    for geom in np.flatnonzero(stands_still(model)).tolist():
        name = model.geom(geom).name or f"geom {geom}"
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            found += _of_mesh(model, data, geom, name)
        elif (surface := _of_solid(model, data, geom, name)) is not None:
            found.append(surface)
    return found


def floor_of(model: mujoco.MjModel, data: mujoco.MjData, source: str) -> list[Array]:
    """Return the convex pieces (k, 2) [m] of the room's floor; they may overlap. `data` needs kinematics.

    Raises InputError, naming `source`, without a level surface at z = 0.
    """
    surfaces = level_surfaces(model, data)
    pieces = [piece for each in surfaces if abs(each.height_m) <= AT_FLOOR_M for piece in each.pieces]
    if not pieces:
        nearest = min(surfaces, key=lambda each: abs(each.height_m), default=None)
        there = f"; the nearest level surface is {nearest.geom!r} at z = {nearest.height_m:.3g} m" if nearest else ""
        raise InputError(
            f"{source}: has no floor{there}; a plane, or a box or mesh with a level top, at z = 0 is expected where people walk"
        )
    return pieces


def floor_hull(pieces: Sequence[Array]) -> Array:
    """Return the convex hull (k, 2) [m] of the floor's pieces."""
    points = np.concatenate(pieces)
    return points[ConvexHull(points).vertices]


def check_floor_under(walkable: Array, pieces: Sequence[Array], source: str) -> None:
    """Raise InputError, naming `source`, where the walkable area (k, 2) [m] has no floor at all."""
    low, high = walkable.min(axis=0), walkable.max(axis=0)
    steps = np.linspace(0.0, 1.0, 25)
    places = low + (high - low) * np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = places[Area(walkable).contains(places)]
    if len(places) and not any(Area(piece).contains(places).any() for piece in pieces):
        (x, y), (far_x, far_y) = low, high
        raise InputError(
            f"{source}: walkable_area: there is no floor at z = 0 under x {x:g} to {far_x:g} m, y {y:g} to {far_y:g} m; "
            "an area on the room's floor is expected"
        )


def _of_solid(model: mujoco.MjModel, data: mujoco.MjData, geom: int, name: str) -> LevelSurface | None:
    kind, upright = model.geom_type[geom], np.abs(data.geom_xmat[geom, 6:]) > _LEVEL  # which own axis is vertical
    match kind:
        case mujoco.mjtGeom.mjGEOM_PLANE:
            is_level = data.geom_xmat[geom, 8] > _LEVEL
        case mujoco.mjtGeom.mjGEOM_BOX:
            is_level = upright.any()
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            is_level = upright[2]
        case _:
            return None
    points = hull_points(model, data, geom)
    if points is None or not is_level:
        return None
    middle = (points[:, 2].max() + points[:, 2].min()) / 2
    top = points[points[:, 2] > middle]
    return LevelSurface(name, float(top[:, 2].mean()), (top[ConvexHull(top[:, :2]).vertices, :2],))


def _of_mesh(model: mujoco.MjModel, data: mujoco.MjData, geom: int, name: str) -> list[LevelSurface]:
    """Return one surface per height, of the mesh's upward triangles."""
    points = hull_points(model, data, geom)
    assert points is not None
    mesh = model.geom_dataid[geom]
    first = model.mesh_faceadr[mesh]
    corners = points[model.mesh_face[first : first + model.mesh_facenum[mesh]]]  # (n, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_m2 = np.linalg.norm(normal, axis=1)
    up = normal[:, 2] > _LEVEL * np.maximum(double_m2, 1e-12)
    corners, double_m2 = corners[up], double_m2[up]
    heights = np.round(corners[:, :, 2].mean(axis=1) / AT_FLOOR_M).astype(int)
    surfaces = []
    for level in np.unique(heights):
        here = heights == level
        if double_m2[here].sum() >= 2 * _LEAST_M2:
            pieces = tuple(corners[here][:, :, :2])
            surfaces.append(LevelSurface(name, float(corners[here][:, :, 2].mean()), pieces))
    return surfaces
