"""Is a sensor's mount free, or inside a wall?"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError


def check_mount(model: mujoco.MjModel, data: mujoco.MjData, field: str, xyz: NDArray[np.float64]) -> None:
    """Raise InputError naming the field and the geom if the point (3,) [m] lies inside a static geom of the room."""
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] != 0 or model.geom_rgba[geom, 3] == 0:
            continue
        local = (xyz - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
        if inside_geom(model.geom_type[geom], model.geom_size[geom], local[None]).any():
            thing = model.geom(geom).name or f"geom {geom}"
            where = f"[{xyz[0]:g}, {xyz[1]:g}, {xyz[2]:g}]"
            raise InputError(f"{field}: {where} is inside {thing!r} of the room; a point in free space is expected")


def inside_geom(kind: int, size: NDArray[np.float64], local: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which points (n, 3) in the geom's frame lie inside it, (n,); meshes and height fields are taken as empty."""
    match kind:
        case mujoco.mjtGeom.mjGEOM_PLANE:
            # One-sided: behind it is inside the wall. A size of 0 means endless.
            return (local[:, 2] < 0) & ((np.abs(local[:, :2]) <= size[:2]) | (size[:2] == 0)).all(axis=1)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return (np.abs(local) - size).max(axis=1) <= 0
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return (local * local).sum(axis=1) <= size[0] ** 2
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ((local / size) ** 2).sum(axis=1) <= 1
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return (np.hypot(local[:, 0], local[:, 1]) <= size[0]) & (np.abs(local[:, 2]) <= size[1])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            beyond = local[:, 2] - np.clip(local[:, 2], -size[1], size[1])
            return local[:, 0] ** 2 + local[:, 1] ** 2 + beyond**2 <= size[0] ** 2
        case _:
            return np.zeros(len(local), dtype=bool)
