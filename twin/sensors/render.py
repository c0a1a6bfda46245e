"""Offscreen images by MuJoCo's classic OpenGL renderer on EGL: many views of one snapshot, one read."""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Unpack

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.sensors.gl_context import (
    GlInfo,
    check_process,
    fitted,
    free,
    gl_info,
    make_context,
    make_mjr_context,
    no_fork,
)
from twin.sensors.render_scene import (
    Mark,
    RenderView,
    SceneGeoms,
    Shot,
    Switches,
    add_mark,
    drawing_option,
    ensure_shadow_light,
    has_open_mesh,
    make_metres,
    point_cameras,
)
from twin.sensors.still_room import StillRoom, StillRooms, covered_rectangle, lay_over

_SHADOW_MAP_PX = 1024
"""Side of a lamp's shadow map: 6 mm in a room of 5 m; twice the side takes half as long again."""


class OffscreenRenderer:
    """Renderer of one model from any viewpoint; for use in the thread that made it, closed when done.

    Shadows are off by default (each view draws the shadow map again, which more than doubles the cost): see
    `ensure_shadow_light`. So is multisampling; depth and numbers, which it would mix, are then drawn once more without.
    Reflections and fog are off: fog follows the depth along each view's axis and would be discontinuous between views.
    `scripts/bench --only switches` measures the costs. Sites, joints and other decorations of MuJoCo are not drawn. Geoms
    outside a view are left out, since in software the cost of a view is mostly that of its vertices.

    Raises InputError without an EGL context.
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
        keep_still: bool = True,
    ) -> None:
        """Make the context; `most_marks`: greatest number of marks in an image; `samples`: multisampling per pixel (0:
        none).

        `static`: draw static geoms; `cull`: skip geoms out of sight, which changes no pixel (with shadows they are drawn, as
        they may cast one into the image); `keep_still`: draw static geoms once per camera, which changes no pixel
        (`twin.sensors.still_room`).
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
        self._rooms = StillRooms()
        self.keep_still = keep_still and static
        self.pictures: Counter[str] = Counter()
        """Pictures taken so far: `all`, and those drawn completely by reason."""

    def gl_info(self) -> GlInfo:
        """Return name and version of the OpenGL that draws."""
        with no_fork():
            self._make_current()
            return gl_info()

    def drawing(self) -> tuple[mujoco.MjvScene, mujoco.MjrContext]:
        """Return the scene as last drawn, and its context, for direct calls of MuJoCo in measurements."""
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

        From the same scene update come, if requested, `depth` (height, width), the distance along each view's axis [m] (the
        far plane's without a surface), and `numbers` (height, width, 4), the number of the geom at each pixel's centre as
        red + 256 green + 65536 blue. All have one size; without `out` no colour is read.

        Returns the geom of each number, -1 for none; empty without `numbers`.

        `data` needs kinematics and light poses. The model's headlight, if active, shines from the eye along the first view,
        the same for all views.
        """
        self._make_current()
        sizes = {each.shape[:2] for each in (out, depth, numbers) if each is not None}
        if len(sizes) != 1:
            raise ValueError(f"pictures of sizes {sorted(sizes)} are asked for; one size is drawn at a time")
        ((height, width),) = sizes
        mjr = fitted(self._mjr, width, height)
        is_exact_asked = depth is not None or numbers is not None
        exact = fitted(self._without_samples(), width, height) if is_exact_asked else mjr
        self._update_scene(data, eye_m, views[0])
        for mark in marks:
            add_mark(self._scene, self._geoms, mark)
        drawn = self._scene_geoms()
        seen = self._seen(drawn, data, eye_m, views)
        shot = Shot(data, eye_m, tuple(views), drawn, seen, (height, width), any(mark.rgba[3] < 1 for mark in marks))
        passes = [(exact, out, depth)] if exact is mjr or out is None else [(mjr, out, None), (exact, None, depth)]
        for context, colours, depths in passes:
            if colours is not None or depths is not None:
                self._take(context, shot, colours, depths)
        if depth is not None:
            make_metres(self.model, depth)
        if numbers is None:
            return np.empty(0, dtype=np.intp)
        with self._numbered():
            self._take(exact, shot, numbers, None, kind="numbers")
        return drawn.geom_of_number()

    def _take(
        self,
        context: mujoco.MjrContext,
        shot: Shot,
        values: NDArray[np.uint8] | None,
        depth: NDArray[np.float32] | None,
        kind: str = "colours",
    ) -> None:
        """Draw a shot and read values (height, width, 4) and the depth buffer (height, width), as given."""
        room = self._still_room(context, shot, kind if values is not None else "depth")
        moving = shot.seen & shot.drawn.moves
        if room is None:
            self._draw(context, shot, shot.seen)
            mujoco.mjr_readPixels(values, depth, mujoco.MjrRect(0, 0, *shot.size[::-1]), context)
            return
        self._draw(context, shot, moving, sky=False)
        covered = []
        for place, view in enumerate(shot.views):
            spheres = shot.drawn.spheres(shot.data, moving[place])
            rectangle = covered_rectangle(view, shot.eye_m, *spheres)
            if rectangle[2] and rectangle[3]:
                part = None if values is None else np.empty((rectangle[3], rectangle[2], 4), dtype=np.uint8)
                part_depth = np.empty((rectangle[3], rectangle[2]), dtype=np.float32)
                mujoco.mjr_readPixels(part, part_depth, mujoco.MjrRect(*rectangle), context)
                covered.append((rectangle, part, part_depth))
        lay_over(room, covered, values, depth)

    def _still_room(self, context: mujoco.MjrContext, shot: Shot, kind: str) -> StillRoom | None:
        """Return the static part of a shot; None if it is drawn completely, which is counted by reason."""
        self.pictures["all"] += 1
        if reason := self._drawn_whole_for(context, shot):
            self.pictures[reason] += 1
            return None
        camera = kind, shot.eye_m.tobytes(), shot.views, shot.size
        room, is_new = self._rooms.find(camera, shot.drawn.appearance(shot.data))
        if is_new:
            values = None if kind == "depth" else np.empty((*shot.size, 4), dtype=np.uint8)
            room = self._rooms.keep(camera, StillRoom(values, np.empty(shot.size, dtype=np.float32)))
            self._draw(context, shot, shot.seen & ~shot.drawn.moves)
            mujoco.mjr_readPixels(room.values, room.depth, mujoco.MjrRect(0, 0, *shot.size[::-1]), context)
        if room is None:
            self.pictures["first of a camera and its light"] += 1
        return room

    def _drawn_whole_for(self, context: mujoco.MjrContext, shot: Shot) -> str:
        """Return why a shot has to be drawn completely; '' otherwise."""
        if not self.keep_still:
            return "as asked for"
        if self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW]:
            return "shadows"
        if self._samples and context is self._mjr:
            return "multisampling"
        if shot.has_clear_marks or (shot.seen & shot.drawn.transparent).any():
            return "transparent things in sight"
        return ""

    def _draw(self, context: mujoco.MjrContext, shot: Shot, shown: NDArray[np.bool_], *, sky: bool = True) -> None:
        """Draw the last updated scene, only its geoms in `shown`, (n_view, n_scene_geom).

        Without the sky, views without geoms stay unchanged.
        """
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)  # another context may be bound
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = sky
        for place, view in enumerate(shot.views):
            if sky or shown[place].any():
                shot.drawn.show_only(shown[place])
                point_cameras(self._cameras, shot.eye_m, view)
                mujoco.mjr_render(mujoco.MjrRect(*view.viewport), self._scene, context)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1

    @contextmanager
    def _numbered(self) -> Iterator[None]:
        """Draw every geom of the scene in the colour of its number during the block."""
        flags = self._scene.flags
        before = flags.copy()
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        try:
            yield
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

    def _scene_geoms(self) -> SceneGeoms:
        """Return the geoms of the last update, kept from update to update."""
        count = self._scene.ngeom
        if self._listed is None or self._listed[0] != count or not self._listed[1].updated():
            self._listed = count, SceneGeoms(self.model, self._geoms[:count])
            self._rooms.clear()  # numbers follow the geoms' list
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

    def _without_samples(self) -> mujoco.MjrContext:
        """Return the context that draws one sample per pixel."""
        assert self._mjr is not None
        if not self._samples:
            return self._mjr
        if self._exact is None:
            self._exact = make_mjr_context(self.model, self._context, 0, 0)
        return self._exact

    def _make_current(self) -> None:
        if self._context is None:
            raise RuntimeError("the renderer is closed; make another")
        check_process()
        if threading.get_ident() != self._maker[1]:
            raise RuntimeError("a renderer belongs to the thread that made it; iterate, or draw, in one thread")
        self._context.make_current()

    @no_fork()
    def close(self) -> None:
        """Free the context; may be called twice."""
        if self._context is not None:
            free(self._context, self._maker, self._mjr, self._exact)
        self._mjr = self._exact = self._context = None

    def __del__(self) -> None:
        self.close()

    def __enter__(self) -> OffscreenRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RendererOnDemand:
    """Renderer of a model made when a camera first needs it: a run without cameras never opens EGL.

    The switches are those of `OffscreenRenderer`.
    """

    def __init__(self, model: mujoco.MjModel | Callable[[], mujoco.MjModel], **switches: Unpack[Switches]) -> None:
        """Keep the switches; `model`: the one to draw, or a function that returns it: another model gets a new renderer."""
        self._model = model if callable(model) else lambda: model
        self._make = partial(OffscreenRenderer, **switches)
        self._renderer: OffscreenRenderer | None = None
        self._pictures: Counter[str] = Counter()

    def __call__(self) -> OffscreenRenderer:
        """Return the renderer of the model, shared by all callers; raises InputError where there is no EGL."""
        model = self._model()
        if self._renderer is not None and self._renderer.model is not model:
            self.close()
        if self._renderer is None:
            self._renderer = self._make(model)
        return self._renderer

    def notes(self) -> list[str]:
        """Describe, by reason, how many pictures were drawn completely so far."""
        counts = self._pictures + (self._renderer.pictures if self._renderer is not None else Counter())
        return [
            f"{count} of {counts['all']} pictures were drawn whole: {reason}"
            for reason, count in counts.items()
            if reason != "all"
        ]

    def close(self) -> None:
        """Free the renderer, if any."""
        if self._renderer is not None:
            self._pictures += self._renderer.pictures
            self._renderer.close()
        self._renderer = None

    def __enter__(self) -> RendererOnDemand:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
