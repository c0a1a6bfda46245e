"""Content of a rendered picture: views, marks, the geoms of one scene update shown and hidden per view, and the person at
each pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypedDict

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.instant.snapshot import DRAWN_GROUPS


class Switches(TypedDict, total=False):
    """The switches of a renderer (`twin.sensors.render.OffscreenRenderer`)."""

    shadows: bool
    most_marks: int
    samples: int
    static: bool
    cull: bool
    keep_still: bool


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
    def axes(self) -> NDArray[np.float64]:
        """Unit vectors to the right, up and ahead, room frame, (3, 3)."""
        forward, up = np.array(self.forward), np.array(self.up)
        return np.stack([np.cross(forward, up), up, forward])

    @cached_property
    def inward_normals(self) -> NDArray[np.float64]:
        """Unit normals of the pyramid's four sides, pointing into it, room frame, (4, 3)."""
        across, up, forward = self.axes
        normals = np.stack(
            [
                across - self.left * forward,
                -across + self.right * forward,
                up - self.bottom * forward,
                -up + self.top * forward,
            ]
        )
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


MARGIN_PX = 2.0
"""Margin of a drawing from which a picture is remapped, so that bilinear taps stay inside."""


def drawn_span(tangents: NDArray[np.float64], density: float) -> tuple[float, int]:
    """Return the lower edge (tangent) of a drawing, and its pixels at `density` per unit of tangent, that hold these places."""
    pixels = int(np.ceil((tangents.max() - tangents.min()) * density + 2 * MARGIN_PX))
    middle = (tangents.max() + tangents.min()) / 2
    return float(middle - pixels / density / 2), pixels


def triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return a vector (3,) as floats, of which views are made."""
    x, y, z = vector.tolist()
    return x, y, z


@dataclass(frozen=True)
class Mark:
    """Level box drawn into one picture, not part of the scene.

    Its middle and half sizes [m], colour RGBA, 0 to 1, and turn about z [rad].
    """

    middle: tuple[float, float, float]
    half: tuple[float, float, float]
    rgba: tuple[float, float, float, float]
    yaw_rad: float = 0.0


@dataclass(frozen=True, eq=False)
class Shot:
    """Views of one picture from `eye_m` (3,), and the geoms `seen` in each, (n_view, n_scene_geom), at `data`.

    `size`: height and width of their buffer [px]; `has_clear_marks`: whether transparent marks are among the geoms.
    """

    data: mujoco.MjData
    eye_m: NDArray[np.float64]
    views: tuple[RenderView, ...]
    drawn: SceneGeoms
    seen: NDArray[np.bool_]
    size: tuple[int, int]
    has_clear_marks: bool


_NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)  # mjr_render passes over a geom of this type
IS_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)


class SceneGeoms:
    """Geoms of a scene as listed by an update, initially all shown."""

    def __init__(self, model: mujoco.MjModel, geoms: Sequence[mujoco.MjvGeom]) -> None:
        self._model, self._geoms = model, geoms
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
        self.moves = np.array([geom.category for geom in geoms]) != mujoco.mjtCatBit.mjCAT_STATIC
        """Mask of geoms that can move between pictures, including marks, (n_geom,)."""
        self.transparent = np.array([geom.rgba[3] for geom in geoms]) < 1
        """Mask of transparent geoms, (n_geom,)."""
        self._still = index[bounded & ~self.moves]

    def updated(self) -> bool:
        """Show all geoms again after an update; return True if the same objects are listed."""
        self._shown = np.ones(len(self._geoms), dtype=bool)
        return self._listed() == self._objects

    def appearance(self, data: mujoco.MjData) -> bytes:
        """Return all that determines the look of static geoms besides the camera: poses, colours and lights."""
        model, head = self._model, self._model.vis.headlight
        lights = model.light_active, model.light_diffuse, model.light_ambient, model.light_specular
        shapes = model.light_type, model.light_cutoff, model.light_exponent, model.light_attenuation
        poses = data.geom_xpos[self._still], data.geom_xmat[self._still], data.light_xpos, data.light_xdir
        eye = np.array(head.active), head.ambient, head.diffuse, head.specular
        colours = model.geom_rgba, model.geom_matid, model.mat_rgba, model.mat_emission
        return b"".join(each.tobytes() for each in (*lights, *shapes, *poses, *eye, *colours))

    def spheres(self, data: mujoco.MjData, which: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return spheres around those geoms (n_geom,): middles (k, 3) and radii (k,) [m], infinite if unknown."""
        return data.geom_xpos[self._index[which]], self._radius[which]

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
        """Return which geoms each view's eye (n_view, 3) [m] is in front of, (n_view, n_geom): only planes have a back.

        Rays pass through a plane from behind, so it is not drawn from there either.
        """
        normal = data.geom_xmat[self._index].reshape(-1, 3, 3)[:, :, 2]
        height = eyes_m @ normal.T - (data.geom_xpos[self._index] * normal).sum(axis=1)
        return (height >= 0) | ~self._is_plane

    def show_only(self, shown: NDArray[np.bool_]) -> None:
        """Hide and show the geoms (n_geom,) whose visibility changes between views."""
        for place in np.flatnonzero(self._shown != shown).tolist():
            self._geoms[place].type = self._types[place] if shown[place] else _NOTHING
        self._shown = shown

    def _listed(self) -> list[int]:
        return [geom.objid for geom in self._geoms]

    def geom_of_number(self) -> NDArray[np.intp]:
        """Return the model's geom of each number in a drawing of numbers, -1 for none."""
        geom_of_number = np.full(len(self._geoms) + 1, -1, dtype=np.intp)
        for geom in self._geoms:
            if geom.objtype == IS_GEOM:
                geom_of_number[geom.segid + 1] = geom.objid  # 0 is the background
        return geom_of_number


def add_mark(scene: mujoco.MjvScene, geoms: Sequence[mujoco.MjvGeom], mark: Mark) -> None:
    """Append a mark to a scene, whose available slots are `geoms`."""
    place = scene.ngeom
    cos, sin = np.cos(mark.yaw_rad), np.sin(mark.yaw_rad)
    turn = np.array([cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0])
    half, middle, rgba = np.array(mark.half), np.array(mark.middle), np.array(mark.rgba, dtype=np.float32)
    mujoco.mjv_initGeom(geoms[place], mujoco.mjtGeom.mjGEOM_BOX, half, middle, turn, rgba)
    scene.ngeom = place + 1


def point_cameras(cameras: Sequence[mujoco.MjvGLCamera], eye_m: NDArray[np.float64], view: RenderView) -> None:
    """Point a scene's cameras, the left and right eye of the same picture, for a view from `eye_m` (3,) [m]."""
    for camera in cameras:
        near = camera.frustum_near
        camera.orthographic = 0
        camera.pos[:] = eye_m + view.offset_m
        camera.forward[:] = view.forward
        camera.up[:] = view.up
        camera.frustum_center = near * (view.left + view.right) / 2
        camera.frustum_width = near * (view.right - view.left) / 2  # half the width, despite its name
        camera.frustum_bottom = near * view.bottom
        camera.frustum_top = near * view.top


def make_metres(model: mujoco.MjModel, depth: NDArray[np.float32]) -> None:
    """Convert the depth buffer's values, 1 at the near plane and 0 at the far one, to distances [m], in place."""
    near = model.vis.map.znear * model.stat.extent
    far = model.vis.map.zfar * model.stat.extent
    np.divide(near * far, depth.astype(np.float64) * (far - near) + near, out=depth, casting="same_kind")


def has_open_mesh(model: mujoco.MjModel) -> bool:
    """Return True if a mesh of the room has an edge not between two faces, and so a visible inside.

    Rays meet both sides of a face; both sides of such meshes must be drawn.
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


def ensure_shadow_light(model: mujoco.MjModel) -> None:
    """Let the steepest lamp of a model cast shadows if none does.

    They are drawn only with shadows enabled. In a lamp's shadow MuJoCo omits its ambient light too, so a lamp with any is
    chosen only if there is no other.
    """
    if model.nlight and not model.light_castshadow.any():
        steepness = model.light_dir[:, 2] + 2 * model.light_ambient.any(axis=1)
        model.light_castshadow[np.argmin(steepness)] = True


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


_FRACTION = 32
"""Fractions of a pixel in cv2's fixed-point tables."""


class PersonPixels:
    """Converter of the numbers drawn by `OffscreenRenderer.render` to id images, by the table that remaps the camera's
    colours.

    `maps`: the camera's table for `cv2.remap`, fixed point, negative outside the lens's field; None if the drawing is the
    picture, its rows from the bottom up. A pixel takes the id of the nearest drawn pixel: ids, unlike colours, are not
    mixed.
    """

    def __init__(self, maps: tuple[NDArray, NDArray] | None) -> None:
        self._maps = maps

    def people(
        self, drawn: NDArray[np.uint8], geom_of_number: NDArray[np.intp], person_of_geom: NDArray[np.int16]
    ) -> NDArray[np.int16]:
        """Return the id image (height, width) in a drawing (rows, columns, 4): 0 the room, -1 outside the field."""
        person_of_number = np.where(geom_of_number >= 0, person_of_geom[geom_of_number], np.int16(0))
        if self._maps is None:
            return person_of_number[_numbers(drawn)[::-1]]
        nearest, outside = self._nearest
        bent = cv2.remap(drawn, nearest, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # pyright: ignore[reportCallIssue, reportArgumentType]
        people = person_of_number[_numbers(bent)]
        people[outside] = -1
        return people

    @cached_property
    def _nearest(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        """Nearest drawn pixel of each of the picture's, (height, width, 2), and a mask of those without one."""
        assert self._maps is not None
        whole, fraction = self._maps
        steps = np.stack([fraction % _FRACTION, fraction // _FRACTION], axis=-1)
        return whole + (steps >= _FRACTION // 2).astype(np.int16), np.any(whole < 0, axis=-1)


def _numbers(drawn: NDArray) -> NDArray[np.integer]:
    """Return red + 256 green + 65536 blue of RGBA pixels, (rows, columns)."""
    return np.ascontiguousarray(drawn).view("<u4")[..., 0] & 0xFFFFFF
