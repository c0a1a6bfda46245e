"""The content of a rendered picture: views, marks, and the geoms of one scene update, shown and hidden per view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.instant.snapshot import DRAWN_GROUPS


@dataclass(frozen=True)
class RenderView:
    """One perspective image: its direction (unit vectors in the room frame), its width, and its place in the buffer.

    left, right, bottom, top bound the image on the plane at distance 1 (tangents of the angles from `forward`, x along forward
    × up); `viewport` is (column, row, width, height) in the buffer [px], rows counted from the bottom. `offset_m` is the
    view's eye relative to the common eye of all views, room frame.
    """

    forward: tuple[float, float, float]
    up: tuple[float, float, float]
    left: float
    right: float
    bottom: float
    top: float
    viewport: tuple[int, int, int, int]
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def inward_normals(self) -> NDArray[np.float64]:
        """Unit normals of the pyramid's four sides, pointing into it, room frame, (4, 3)."""
        forward, up = np.array(self.forward), np.array(self.up)
        across = np.cross(forward, up)
        normals = np.stack(
            [
                across - self.left * forward,
                -across + self.right * forward,
                up - self.bottom * forward,
                -up + self.top * forward,
            ]
        )
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@dataclass(frozen=True)
class Mark:
    """A level box that is drawn into one picture and is no part of the scene.

    Its middle and half sizes [m], colour RGBA, 0 to 1, and by how much it is turned about z [rad].
    """

    middle: tuple[float, float, float]
    half: tuple[float, float, float]
    rgba: tuple[float, float, float, float]
    yaw_rad: float = 0.0


_NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)  # mjr_render passes over a geom of this type
IS_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)


class SceneGeoms:
    """The geoms of a scene as an update lists them, all of them shown at first."""

    def __init__(self, model: mujoco.MjModel, geoms: Sequence[mujoco.MjvGeom]) -> None:
        self._geoms = geoms
        self._objects = self._listed()
        self._types = [geom.type for geom in geoms]
        self._shown = np.ones(len(geoms), dtype=bool)
        index = np.array(self._objects, dtype=np.intp)
        bounded = np.array([geom.objtype for geom in geoms]) == IS_GEOM
        index[~bounded] = 0  # skins and flexes have no bounding sphere here: always in sight
        radius = np.where(bounded, model.geom_rbound[index], 0.0)
        radius[radius == 0] = np.inf  # planes
        self._index, self._radius = index, radius
        self._is_plane = bounded & (model.geom_type[index] == mujoco.mjtGeom.mjGEOM_PLANE)

    def updated(self) -> bool:
        """Show all geoms again after an update; return True where the same objects are listed."""
        self._shown = np.ones(len(self._geoms), dtype=bool)
        return self._listed() == self._objects

    def in_sight(
        self, data: mujoco.MjData, eyes_m: NDArray[np.float64], inward: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which geoms reach into each view, (n_view, n_geom); never wrongly False.

        `eyes_m` (n_view, 3); `inward`: unit normals of each view's four sides, pointing inward, (n_view, 4, 3).
        """
        behind = np.einsum("vi,vsi->vs", eyes_m, inward)
        depth = data.geom_xpos[self._index] @ inward.reshape(-1, 3).T - behind.reshape(-1)  # (n_geom, 4 n_view)
        return (depth > -self._radius[:, None]).reshape(len(self._radius), -1, 4).all(axis=2).T

    def from_the_front(self, data: mujoco.MjData, eyes_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which geoms each view's eye (n_view, 3) [m] is in front of, (n_view, n_geom): planes alone have a back.

        Rays pass through a plane from behind, so it is not drawn from there either.
        """
        normal = data.geom_xmat[self._index].reshape(-1, 3, 3)[:, :, 2]
        height = eyes_m @ normal.T - (data.geom_xpos[self._index] * normal).sum(axis=1)
        return (height >= 0) | ~self._is_plane

    def show_only(self, shown: NDArray[np.bool_]) -> None:
        """Hide and show those (n_geom,) whose visibility changes from one view to the next."""
        for place in np.flatnonzero(self._shown != shown).tolist():
            self._geoms[place].type = self._types[place] if shown[place] else _NOTHING
        self._shown = shown

    def _listed(self) -> list[int]:
        return [geom.objid for geom in self._geoms]

    def geom_of_number(self) -> NDArray[np.intp]:
        """Return the model's geom that each number of a drawing of numbers stands for, -1 for none."""
        geom_of_number = np.full(len(self._geoms) + 1, -1, dtype=np.intp)
        for geom in self._geoms:
            if geom.objtype == IS_GEOM:
                geom_of_number[geom.segid + 1] = geom.objid  # 0 is the background
        return geom_of_number


def has_open_mesh(model: mujoco.MjModel) -> bool:
    """Return True where a mesh of the room has an edge that is not between two faces: it can be seen from inside.

    Rays meet a face from both sides; of such meshes both are to be drawn.
    """
    of_room = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.body_weldid[model.geom_bodyid] == 0)
    for mesh in np.unique(model.geom_dataid[of_room]).tolist():
        first = model.mesh_faceadr[mesh]
        face = model.mesh_face[first : first + model.mesh_facenum[mesh]]
        edges = np.sort(face[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
        _, count = np.unique(edges[:, 0] * model.mesh_vertnum[mesh] + edges[:, 1], return_counts=True)
        if (count != 2).any():
            return True
    return False


def drawing_option() -> mujoco.MjvOption:
    """Return options that draw bodies as they look, without MuJoCo's decorations."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = DRAWN_GROUPS
    for group in (option.sitegroup, option.jointgroup, option.tendongroup, option.actuatorgroup):
        group[:] = 0
    shown = (
        mujoco.mjtVisFlag.mjVIS_TEXTURE,
        mujoco.mjtVisFlag.mjVIS_STATIC,
        mujoco.mjtVisFlag.mjVIS_SKIN,
        mujoco.mjtVisFlag.mjVIS_FLEXFACE,
        mujoco.mjtVisFlag.mjVIS_FLEXSKIN,
    )
    option.flags[:] = 0
    for flag in shown:
        option.flags[flag] = 1
    return option
