"""Points on a geom's surface whose convex hull is the geom, in the room frame."""

from __future__ import annotations

import mujoco
import numpy as np

from trackers.arrays import Array, Mask
from trackers.errors import InputError, text_near_bound

PLANE_M = 0.05
"""Thickness of a wall made of a plane, on its far side [m]."""
FARTHEST_M = 10_000.0
"""Greatest distance of objects from the room's origin [m]."""
ENDLESS_M = 50.0
"""Half the side of an infinite plane [m]."""
_LARGEST_MESH_M, _SMALLEST_MESH_M = 20.0, 0.005
"""Least side of a mesh beyond which, and greatest below which, it is of another unit [m]: no thing in a room is 20 m deep."""
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


def stands_still(model: mujoco.MjModel) -> Mask:
    """Return a mask (n_geom,) of the geoms of the room itself: visible (alpha above 0), and of bodies that do not move."""
    return (model.body_weldid[model.geom_bodyid] == 0) & (model.geom_rgba[:, 3] != 0)


def check_extent(model: mujoco.MjModel, data: mujoco.MjData, source: str) -> None:
    """Raise InputError, naming `source`, for a geom that reaches farther than `FARTHEST_M`. `data` needs kinematics."""
    size_m = np.where(
        model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, model.geom_size[:, :2].max(axis=1), model.geom_rbound
    )
    reach_m = np.abs(data.geom_xpos).max(axis=1) + size_m
    for geom in np.flatnonzero(~(reach_m <= FARTHEST_M))[:1].tolist():
        name = model.geom(geom).name or f"geom {geom}"
        reach = text_near_bound(float(reach_m[geom]), FARTHEST_M, ".3g")
        raise InputError(
            f"{source}: {name!r} reaches {reach} m from the room's origin; lengths in metres, at most "
            f"{FARTHEST_M:g} m, are expected"
        )


def unlikely_meshes(model: mujoco.MjModel) -> list[str]:
    """Return a sentence on the meshes of a room whose size is that of another unit than metres; none without any."""
    sizes: dict[str, Array] = {}
    for geom in np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & stands_still(model)).tolist():
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        size_m = np.ptp(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], axis=0)
        if size_m.min() > _LARGEST_MESH_M or size_m.max() < _SMALLEST_MESH_M:
            sizes[model.mesh(mesh).name or f"mesh {mesh}"] = size_m
    if not sizes:
        return []
    (name, size_m), *more = sizes.items()
    others = f", and {len(more)} more are as far off" * bool(more)
    return [
        f'room: the mesh {name!r} is {size_m.max():.3g} m long{others}; a mesh in mm has scale="0.001 0.001 0.001", one in m none'
    ]


def _cube(x: list[float], y: list[float], z: list[float]) -> Array:
    return np.array(np.meshgrid(x, y, z), dtype=float).reshape(3, -1).T


def _ball(circle: Array) -> Array:
    """Return points (n, 3) of the unit sphere: rings between the poles."""
    rings = [
        np.column_stack([np.cos(up) * circle, np.full(len(circle), np.sin(up))])
        for up in np.deg2rad(np.arange(-75, 76, 15))
    ]
    return np.concatenate([*rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
