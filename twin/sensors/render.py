"""Offscreen pictures from MuJoCo's classic OpenGL renderer on EGL: many views of one moment, one read."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from twin.snapshot import DRAWN_GROUPS

INSTALL_EGL = "apt-get install libegl1 libgl1-mesa-dri"
"""What brings software rendering to a Debian machine."""

_GL_RENDERER, _GL_VERSION, _GL_RGBA = 0x1F01, 0x1F02, 0x1908
_NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)  # mjr_render passes over a geom of this type
_IS_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)


@dataclass(frozen=True)
class View:
    """One perspective picture: where it looks (unit vectors in the room frame), how wide, and where it is drawn.

    left, right, bottom, top bound the picture on the plane at distance 1 (tangents of the angles from `forward`,
    x along forward × up); `viewport` is (column, row, width, height) in the buffer [px], rows counted from the bottom.
    """

    forward: tuple[float, float, float]
    up: tuple[float, float, float]
    left: float
    right: float
    bottom: float
    top: float
    viewport: tuple[int, int, int, int]

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
class GlInfo:
    """The machine's OpenGL, as noted beside every picture that is compared later."""

    renderer: str
    version: str


class OffscreenRenderer:
    """Draws one model from any eye point; for use in the thread that made it, closed when done.

    Shadows are off unless asked for (each view draws the shadow map again: it more than doubles the cost);
    reflections, fog and multisampling are off: fog follows the depth along each view's own axis and would step where
    views meet.
    Sites, joints and the other decorations of MuJoCo are not drawn. Geoms outside a view are left out of it, since in
    software the cost of a view is mostly that of its vertices.

    Raises InputError where no EGL context can be made.
    """

    def __init__(self, model: mujoco.MjModel, *, shadows: bool = False) -> None:
        self._context: Any = None
        self._mjr: mujoco.MjrContext | None = None
        self._thread = threading.get_ident()
        self.model = model
        self._context = _make_context()
        self._mjr = _make_mjr_context(model, self._context)
        self._scene = mujoco.MjvScene(model, model.ngeom + model.nskin + model.nflex + 1)
        self._scene.flags[:] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        # A geom out of sight may still throw its shadow into the picture.
        self._leave_out_unseen = not shadows
        self._option = _drawing_option()
        self._geoms = self._scene.geoms
        self._cameras = self._scene.camera[0], self._scene.camera[1]

    def gl_info(self) -> GlInfo:
        """Name and version of the OpenGL that draws."""
        self._make_current()
        from OpenGL.EGL import eglGetProcAddress

        address = ctypes.cast(eglGetProcAddress("glGetString"), ctypes.c_void_p).value  # pyright: ignore[reportArgumentType]
        get_string = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(address or 0)
        renderer, version = get_string(_GL_RENDERER), get_string(_GL_VERSION)
        return GlInfo(renderer.decode(), version.decode())

    def render(
        self,
        data: mujoco.MjData,
        eye_m: NDArray[np.float64],
        views: Sequence[View],
        out: NDArray[np.uint8],
    ) -> None:
        """Draw the views from `eye_m` (3,) into `out` (height, width, 4) RGBA, rows from the bottom up.

        `data` needs kinematics and light poses. The model's headlight, if active, shines from the eye along the
        first view, the same for all views.
        """
        self._make_current()
        self._fit_buffer(out.shape[1], out.shape[0])
        self._update_scene(data, eye_m, views[0])
        seen = self._seen(data, eye_m, views) if self._leave_out_unseen else None
        types = self._types()
        drawn = np.ones(len(types), dtype=bool)
        for place, view in enumerate(views):
            if seen is not None:
                self._switch(types, drawn, seen[place])
                drawn = seen[place]
            self._point_cameras(eye_m, view)
            mujoco.mjr_render(mujoco.MjrRect(*view.viewport), self._scene, self._mjr)
        mujoco.mjr_readPixels(out, None, mujoco.MjrRect(0, 0, out.shape[1], out.shape[0]), self._mjr)

    def _update_scene(self, data: mujoco.MjData, eye_m: NDArray[np.float64], view: View) -> None:
        camera = mujoco.MjvCamera()
        forward = np.array(view.forward)
        camera.lookat[:] = eye_m + 1e-6 * forward
        camera.distance = 1e-6
        camera.azimuth = np.rad2deg(np.arctan2(forward[1], forward[0]))
        camera.elevation = np.rad2deg(np.arcsin(np.clip(forward[2], -1, 1)))
        bodies = mujoco.mjtCatBit.mjCAT_STATIC | mujoco.mjtCatBit.mjCAT_DYNAMIC
        mujoco.mjv_updateScene(self.model, data, self._option, None, camera, bodies, self._scene)

    def _types(self) -> list[int]:
        return [geom.type for geom in self._geoms[: self._scene.ngeom]]

    def _seen(self, data: mujoco.MjData, eye_m: NDArray[np.float64], views: Sequence[View]) -> NDArray[np.bool_]:
        """Whether each geom of the scene reaches into each view, (n_view, n_scene_geom); never wrongly False."""
        geoms = self._geoms[: self._scene.ngeom]
        index = np.array([geom.objid for geom in geoms], dtype=np.intp)
        bounded = np.array([geom.objtype for geom in geoms]) == _IS_GEOM
        index[~bounded] = 0  # skins and flexes have no bounding sphere here: always drawn
        radius = np.where(bounded, self.model.geom_rbound[index], 0.0)
        radius[radius == 0] = np.inf  # planes
        normals = np.concatenate([view.inward_normals() for view in views])  # (4 n_view, 3)
        depth = (data.geom_xpos[index] - eye_m) @ normals.T  # (n_geom, 4 n_view)
        return (depth > -radius[:, None]).reshape(len(geoms), len(views), 4).all(axis=2).T

    def _switch(self, types: list[int], before: NDArray[np.bool_], after: NDArray[np.bool_]) -> None:
        """Hide and show those geoms whose visibility changes from one view to the next."""
        for place in np.flatnonzero(before != after):
            self._geoms[place].type = types[place] if after[place] else _NOTHING

    def _point_cameras(self, eye_m: NDArray[np.float64], view: View) -> None:
        for camera in self._cameras:  # left and right eye of the same picture
            near = camera.frustum_near
            camera.orthographic = 0
            camera.pos[:] = eye_m
            camera.forward[:] = view.forward
            camera.up[:] = view.up
            camera.frustum_center = near * (view.left + view.right) / 2
            camera.frustum_width = near * (view.right - view.left) / 2  # half the width, despite its name
            camera.frustum_bottom = near * view.bottom
            camera.frustum_top = near * view.top

    def _fit_buffer(self, width: int, height: int) -> None:
        if self._mjr is not None and (width > self._mjr.offWidth or height > self._mjr.offHeight):
            mujoco.mjr_resizeOffscreen(max(width, self._mjr.offWidth), max(height, self._mjr.offHeight), self._mjr)

    def _make_current(self) -> None:
        if self._context is None:
            raise RuntimeError("the renderer is closed; make another")
        if threading.get_ident() != self._thread:
            raise RuntimeError("an EGL context belongs to the thread that made it; make a renderer in this one")
        self._context.make_current()

    def close(self) -> None:
        """Free the context; may be called twice."""
        if self._mjr is not None and self._context is not None:
            with self._context.as_current():
                self._mjr.free()
        self._mjr = None
        if self._context is not None:
            self._context.free()
        self._context = None

    def __del__(self) -> None:
        self.close()

    def __enter__(self) -> OffscreenRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RendererOnDemand:
    """Makes the renderer of a model when a camera first asks for it: a run without cameras never opens EGL."""

    def __init__(self, model: mujoco.MjModel, *, shadows: bool = False) -> None:
        self._model = model
        self._shadows = shadows
        self._renderer: OffscreenRenderer | None = None

    def __call__(self) -> OffscreenRenderer:
        """The renderer, shared by all who ask. Raises InputError where there is no EGL."""
        if self._renderer is None:
            self._renderer = OffscreenRenderer(self._model, shadows=self._shadows)
        return self._renderer

    def close(self) -> None:
        """Free the renderer, if one was made."""
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None

    def __enter__(self) -> RendererOnDemand:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _drawing_option() -> mujoco.MjvOption:
    """Bodies as they look, and nothing of what MuJoCo draws to explain them."""
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


def _make_context() -> Any:
    """An EGL context of our own, whatever `import mujoco` was told to use.

    MuJoCo's C code reads MUJOCO_GL when the first context is made, its Python code when it is imported; importing
    `mujoco.egl` here leaves a machine without EGL free to import mujoco for everything but pictures.
    """
    os.environ["MUJOCO_GL"] = "egl"
    # One rasteriser thread: the second core is worth more to what runs beside the renderer (encoding, tracking).
    os.environ.setdefault("LP_NUM_THREADS", "1")
    try:
        from mujoco.egl import GLContext
        from OpenGL.error import Error as OpenGlError
    except (ImportError, OSError, AttributeError) as error:
        raise InputError(_no_egl(error)) from error
    try:
        context = GLContext(1, 1)
        context.make_current()
    except (ImportError, RuntimeError, OpenGlError) as error:
        raise InputError(_no_egl(error)) from error
    return context


def _make_mjr_context(model: mujoco.MjModel, context: Any) -> mujoco.MjrContext:
    quality = model.vis.quality
    samples, quality.offsamples = quality.offsamples, 0
    try:
        mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    except mujoco.FatalError as error:
        context.free()
        raise InputError(_no_egl(error)) from error
    finally:
        quality.offsamples = samples
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, mjr)
    # The framebuffer's own layout: reading RGB instead costs ten times as much.
    mjr.readPixelFormat = _GL_RGBA
    return mjr


def _no_egl(error: Exception) -> str:
    reason = str(error).split(". ")[0].strip() or type(error).__name__
    return (
        f"cannot render: EGL gives no OpenGL context ({reason}); on Debian `{INSTALL_EGL}` brings it, "
        "and a run with --no-images needs none"
    )
