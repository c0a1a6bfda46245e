"""The room from above: walls and furniture as polygons, for plans in reports and previews."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

_LOW_M, _HIGH_M = 0.1, 1.8
"""A thing shows on the plan when part of it is between these heights [m]: neither floor marks nor lamps do."""


_WALL_M = 0.05
"""How thick a wall that is a plane is drawn, on its far side [m]."""


def room_outline(model: mujoco.MjModel, data: mujoco.MjData) -> list[NDArray[np.float64]]:
    """Convex outlines (k, 2) [m] of the static geoms that stand in the room; `data` needs kinematics."""
    outlines = []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] != 0 or model.geom_rgba[geom, 3] == 0:
            continue
        corners = _corners(model, data, geom)
        if corners is None or corners[:, 2].max() < _LOW_M or corners[:, 2].min() > _HIGH_M:
            continue
        flat = corners[:, :2]
        if np.ptp(flat, axis=0).min() > 1e-6:
            outlines.append(flat[ConvexHull(flat).vertices])
    return outlines


def _corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> NDArray[np.float64] | None:
    """Points (n, 3) [m] in the room frame whose hull is the geom's; None for endless planes and height fields."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            local = size * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        case mujoco.mjtGeom.mjGEOM_PLANE if size[0] > 0 and size[1] > 0:
            local = np.array(np.meshgrid([-size[0], size[0]], [-size[1], size[1]], [-_WALL_M, 0])).reshape(3, -1).T
        case mujoco.mjtGeom.mjGEOM_CYLINDER | mujoco.mjtGeom.mjGEOM_CAPSULE:
            ring = size[0] * circle
            local = np.concatenate([np.column_stack([ring, np.full(24, end)]) for end in (-size[1], size[1])])
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
            equator = np.column_stack([circle, np.zeros(24)])
            local = radii * np.concatenate([equator, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float)
        case _:
            return None
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
