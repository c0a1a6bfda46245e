"""The room from above: walls and furniture as polygons, for plans in reports and previews."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from twin.geometry.geom_hull import hull_points

_LOW_M, _HIGH_M = 0.1, 1.8
"""A thing shows on the plan when part of it is between these heights [m]: neither floor marks nor lamps do."""


def room_outline(model: mujoco.MjModel, data: mujoco.MjData) -> list[NDArray[np.float64]]:
    """Convex outlines (k, 2) [m] of the static geoms that stand in the room; `data` needs kinematics."""
    outlines = []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] != 0 or model.geom_rgba[geom, 3] == 0:
            continue
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and not model.geom_size[geom, :2].all():
            continue
        corners = hull_points(model, data, geom)
        if corners is None or corners[:, 2].max() < _LOW_M or corners[:, 2].min() > _HIGH_M:
            continue
        flat = corners[:, :2]
        if np.ptp(flat, axis=0).min() > 1e-6:
            outlines.append(flat[ConvexHull(flat).vertices])
    return outlines
