"""Offscreen images from MuJoCo's classic OpenGL renderer on EGL: many views of one snapshot, one read."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.sensors.gl_context import (
    GlInfo,
    abandon,
    check_process,
    gl_info,
    is_lost,
    make_context,
    make_mjr_context,
    no_fork,
)
from twin.sensors.render_scene import Mark, RenderView, SceneGeoms, drawing_option, has_open_mesh

_SHADOW_MAP_PX = 1024
"""Side of a lamp's map of shadows: of a room of 5 m it shows 6 mm, and twice the side costs half as much again."""


class OffscreenRenderer:
    """Draws one model from any eye point; for use in the thread that made it, closed when done.

    Shadows are off unless asked for (each view draws the shadow map again: it more than doubles the cost): see
    `ensure_shadow_light`. So is multisampling; depth and numbers, which it would mix, are then drawn once more without.
    Reflections and fog are off: fog follows the depth along each view's own axis and would step where views meet. What
    each costs is measured in `scripts/bench --only switches`.
    Sites, joints and the other decorations of MuJoCo are not drawn. Geoms outside a view are left out of it, since in
    software the cost of a view is mostly that of its vertices.

    Raises InputError where no EGL context can be made.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        shadows: bool = False,
        most_marks: int = 0,
        samples: int = 0,
        static: bool = True,
        cull: bool = True,
    ) -> None:
        """Make the context; `most_marks`: marks that an image may hold at most; `samples`: multisampling per pixel (0: none).

        `static`: draw geoms that cannot move; `cull`: pass over geoms out of sight, which changes no pixel (with
        shadows they are drawn all the same: they may throw one into the image).
        """
        self._context: Any = None
        self._mjr: mujoco.MjrContext | None = None
        self._exact: mujoco.MjrContext | None = None  # without samples
        self._maker = os.getpid(), threading.get_ident()
        self.model = model
        if shadows:
            ensure_shadow_light(model)
        with no_fork():
            self._context = make_context()
            self._mjr = make_mjr_context(model, self._context, samples, _SHADOW_MAP_PX if shadows else 0)
        self._samples = samples
        self._scene = mujoco.MjvScene(model, model.ngeom + model.nskin + model.nflex + 1 + most_marks)
        self._scene.flags[:] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = not has_open_mesh(model)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._cull = cull and not shadows
        self._bodies = mujoco.mjtCatBit.mjCAT_DYNAMIC | (mujoco.mjtCatBit.mjCAT_STATIC if static else 0)
        self._option = drawing_option()
        self._geoms = self._scene.geoms
        self._listed: tuple[int, SceneGeoms] | None = None
        self._cameras = self._scene.camera[0], self._scene.camera[1]

    def gl_info(self) -> GlInfo:
        """Return name and version of the OpenGL that draws."""
        with no_fork():
            self._make_current()
            return gl_info()

    def drawing(self) -> tuple[mujoco.MjvScene, mujoco.MjrContext]:
        """Return the scene as it was last drawn, and its context: for bare calls of MuJoCo, to measure against."""
        self._make_current()
        assert self._mjr is not None
        return self._scene, self._mjr

    @no_fork()
    def render(
        self,
        data: mujoco.MjData,
        eye_m: NDArray[np.float64],
        views: Sequence[RenderView],
        out: NDArray[np.uint8] | None,
        marks: Sequence[Mark] = (),
        *,
        depth: NDArray[np.float32] | None = None,
        numbers: NDArray[np.uint8] | None = None,
    ) -> NDArray[np.intp]:
        """Draw the views from `eye_m` (3,) into `out` (height, width, 4) RGBA, rows from the bottom up.

        Of the same scene update come, where asked for, `depth` (height, width), the distance along each view's axis [m]
        (the far plane's where nothing is), and `numbers` (height, width, 4), the number of the geom at each pixel's
        centre as red + 256 green + 65536 blue. All that are asked for have one size; without `out` no colour is read.

        Returns the geom that each number stands for, -1 for none; empty without `numbers`.

        `data` needs kinematics and light poses. The model's headlight, if active, shines from the eye along the
        first view, the same for all views.
        """
        self._make_current()
        sizes = {each.shape[:2] for each in (out, depth, numbers) if each is not None}
        if len(sizes) != 1:
            raise ValueError(f"pictures of sizes {sorted(sizes)} are asked for; one size is drawn at a time")
        ((height, width),) = sizes
        mjr = self._fitted(self._mjr, width, height)
        is_exact_asked = depth is not None or numbers is not None
        exact = self._fitted(self._without_samples(), width, height) if is_exact_asked else mjr
        self._update_scene(data, eye_m, views[0])
        for mark in marks:
            self._add(mark)
        rectangle = mujoco.MjrRect(0, 0, width, height)
        drawn = self._scene_geoms()
        seen = self._seen(drawn, data, eye_m, views)
        passes = [(exact, out, depth)] if exact is mjr or out is None else [(mjr, out, None), (exact, None, depth)]
        for context, colours, depths in passes:
            if colours is not None or depths is not None:
                self._draw(context, drawn, seen, eye_m, views)
                mujoco.mjr_readPixels(colours, depths, rectangle, context)
        if depth is not None:
            self._make_metres(depth)
        if numbers is None:
            return np.empty(0, dtype=np.intp)
        self._draw_numbers(exact, drawn, seen, eye_m, views)
        mujoco.mjr_readPixels(numbers, None, rectangle, exact)
        return drawn.geom_of_number()

    def _draw(
        self,
        context: mujoco.MjrContext,
        drawn: SceneGeoms,
        seen: NDArray[np.bool_],
        eye_m: NDArray[np.float64],
        views: Sequence[RenderView],
    ) -> None:
        """Draw the scene as it was last updated, of its geoms those that are `seen`, (n_view, n_scene_geom)."""
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)  # the other context's may be bound
        for place, view in enumerate(views):
            drawn.show_only(seen[place])
            self._point_cameras(eye_m, view)
            mujoco.mjr_render(mujoco.MjrRect(*view.viewport), self._scene, context)

    def _make_metres(self, depth: NDArray[np.float32]) -> None:
        """Turn the depth buffer's values, 1 at the near plane and 0 at the far one, into distances [m], in place."""
        near = self.model.vis.map.znear * self.model.stat.extent
        far = self.model.vis.map.zfar * self.model.stat.extent
        np.divide(near * far, depth.astype(np.float64) * (far - near) + near, out=depth, casting="same_kind")

    def _draw_numbers(
        self,
        context: mujoco.MjrContext,
        drawn: SceneGeoms,
        seen: NDArray[np.bool_],
        eye_m: NDArray[np.float64],
        views: Sequence[RenderView],
    ) -> None:
        """Draw every geom of the scene in the colour that is its number."""
        flags = self._scene.flags
        before = flags.copy()
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        try:
            self._draw(context, drawn, seen, eye_m, views)
        finally:
            flags[:] = before

    def _update_scene(self, data: mujoco.MjData, eye_m: NDArray[np.float64], view: RenderView) -> None:
        camera = mujoco.MjvCamera()
        forward = np.array(view.forward)
        camera.lookat[:] = eye_m + 1e-6 * forward
        camera.distance = 1e-6
        camera.azimuth = np.rad2deg(np.arctan2(forward[1], forward[0]))
        camera.elevation = np.rad2deg(np.arcsin(np.clip(forward[2], -1, 1)))
        mujoco.mjv_updateScene(self.model, data, self._option, None, camera, int(self._bodies), self._scene)

    def _add(self, mark: Mark) -> None:
        place = self._scene.ngeom
        cos, sin = np.cos(mark.yaw_rad), np.sin(mark.yaw_rad)
        turn = np.array([cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0])
        half, middle, rgba = np.array(mark.half), np.array(mark.middle), np.array(mark.rgba, dtype=np.float32)
        mujoco.mjv_initGeom(self._geoms[place], mujoco.mjtGeom.mjGEOM_BOX, half, middle, turn, rgba)
        self._scene.ngeom = place + 1

    def _scene_geoms(self) -> SceneGeoms:
        """Return the geoms of the last update, kept from update to update."""
        count = self._scene.ngeom
        if self._listed is None or self._listed[0] != count or not self._listed[1].updated():
            self._listed = count, SceneGeoms(self.model, self._geoms[:count])
        return self._listed[1]

    def _seen(
        self, drawn: SceneGeoms, data: mujoco.MjData, eye_m: NDArray[np.float64], views: Sequence[RenderView]
    ) -> NDArray[np.bool_]:
        """Return which geoms of the scene are drawn in each view, (n_view, n_scene_geom)."""
        eyes_m = eye_m + np.array([view.offset_m for view in views])
        faces = drawn.from_the_front(data, eyes_m)
        if not self._cull:
            return faces
        return faces & drawn.in_sight(data, eyes_m, np.stack([view.inward_normals for view in views]))

    def _point_cameras(self, eye_m: NDArray[np.float64], view: RenderView) -> None:
        for camera in self._cameras:  # left and right eye of the same picture
            near = camera.frustum_near
            camera.orthographic = 0
            camera.pos[:] = eye_m + view.offset_m
            camera.forward[:] = view.forward
            camera.up[:] = view.up
            camera.frustum_center = near * (view.left + view.right) / 2
            camera.frustum_width = near * (view.right - view.left) / 2  # half the width, despite its name
            camera.frustum_bottom = near * view.bottom
            camera.frustum_top = near * view.top

    def _without_samples(self) -> mujoco.MjrContext:
        """Return the context that draws one sample per pixel."""
        assert self._mjr is not None
        if not self._samples:
            return self._mjr
        if self._exact is None:
            self._exact = make_mjr_context(self.model, self._context, 0, 0)
        return self._exact

    @staticmethod
    def _fitted(mjr: mujoco.MjrContext | None, width: int, height: int) -> mujoco.MjrContext:
        """Return the context with a buffer of at least this size."""
        assert mjr is not None
        if width > mjr.offWidth or height > mjr.offHeight:
            mujoco.mjr_resizeOffscreen(max(width, mjr.offWidth), max(height, mjr.offHeight), mjr)
        return mjr

    def _make_current(self) -> None:
        if self._context is None:
            raise RuntimeError("the renderer is closed; make another")
        check_process()
        if threading.get_ident() != self._maker[1]:
            raise RuntimeError("an EGL context belongs to the thread that made it; make a renderer in this one")
        self._context.make_current()

    @no_fork()
    def close(self) -> None:
        """Free the context; may be called twice."""
        if self._context is not None and is_lost(*self._maker):
            abandon(self._context, self._mjr, self._exact)
            self._mjr = self._exact = self._context = None
        if self._mjr is not None and self._context is not None:
            with self._context.as_current():
                for each in (self._mjr, self._exact):
                    if each is not None:
                        each.free()
        self._mjr = self._exact = None
        if self._context is not None:
            self._context.free()
        self._context = None

    def __del__(self) -> None:
        self.close()

    def __enter__(self) -> OffscreenRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def ensure_shadow_light(model: mujoco.MjModel) -> None:
    """Let the steepest lamp of a model throw shadows where none does.

    Its shadows show only where shadows are drawn. In a lamp's shadow MuJoCo leaves out its ambient light too, so that a lamp
    with any is chosen where there is no other.
    """
    if model.nlight and not model.light_castshadow.any():
        steepness = model.light_dir[:, 2] + 2 * model.light_ambient.any(axis=1)
        model.light_castshadow[np.argmin(steepness)] = True


class RendererOnDemand:
    """Makes the renderer of a model when a camera first asks for it: a run without cameras never opens EGL.

    The switches are those of `OffscreenRenderer`.
    """

    def __init__(
        self,
        model: mujoco.MjModel | Callable[[], mujoco.MjModel],
        *,
        shadows: bool = False,
        most_marks: int = 0,
        samples: int = 0,
        static: bool = True,
        cull: bool = True,
    ) -> None:
        """Keep the switches; `model`: the one to draw, or a function that returns it: another model gets a new renderer."""
        self._model = model if callable(model) else lambda: model
        self._make = partial(
            OffscreenRenderer,
            shadows=shadows,
            most_marks=most_marks,
            samples=samples,
            static=static,
            cull=cull,
        )
        self._renderer: OffscreenRenderer | None = None

    def __call__(self) -> OffscreenRenderer:
        """Return the renderer of the model, shared by all callers; raises InputError where there is no EGL."""
        model = self._model()
        if self._renderer is not None and self._renderer.model is not model:
            self.close()
        if self._renderer is None:
            self._renderer = self._make(model)
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
