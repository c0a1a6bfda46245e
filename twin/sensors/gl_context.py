"""OpenGL without a screen: EGL contexts, their renderers, and their fate when the process forks.

A forked child has its parent's memory but only the forking thread. Software rendering without its own threads
(LP_NUM_THREADS=0) is memory alone and continues. A thread of the rasteriser, or a graphics card's driver, is lost, and
waiting for it never ends: such a child refuses to draw. No other thread may be within OpenGL during a fork: its locks are
never released in the child.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from trackers.errors import InputError

_RASTERISER_THREAD = "llvmpipe-"
"""Mesa's name for the threads of its software renderer."""

_state = threading.Condition()  # reentrant: a renderer may be freed by the garbage collector at any line
_n_drawing = 0
_n_forking = 0
_own = threading.local()
_drawn_in: int | None = None  # process that made the first context
_goes_on = True  # whether children of that process can draw
_opencv_threads: list[int] = []  # before the present fork
_idle: list[Any] = []  # contexts of closed renderers, current in no thread
_MOST_IDLE = 2
_gl_errors: tuple[
    type[Exception], ...
] = ()  # OpenGL's own; known from the first context on, as nothing is imported at exit


@contextmanager
def no_fork() -> Iterator[None]:
    """Prevent every fork of this process during the block; blocks of several threads run concurrently."""
    global _n_drawing
    if getattr(_own, "drawing", False):
        yield
        return
    with _state:
        _state.wait_for(lambda: not _n_forking)
        _n_drawing += 1
    _own.drawing = True
    try:
        yield
    finally:
        _own.drawing = False
        with _state:
            _n_drawing -= 1
            _state.notify_all()


def note_context(renderer: str) -> None:
    """Note that this process has a context by the OpenGL of this name (GL_RENDERER)."""
    global _drawn_in, _goes_on
    if _drawn_in is None:
        _drawn_in = os.getpid()
        _goes_on = renderer.startswith("llvmpipe") and not _has_rasteriser_threads()


def check_process() -> None:
    """Raise InputError in a process forked from one that has drawn, if drawing would hang."""
    if _drawn_in not in (None, os.getpid()) and not _goes_on:
        raise InputError(
            f"cannot render: process {os.getpid()} was forked from {_drawn_in}, which has rendered before, and this OpenGL "
            "does not survive a fork; start processes with multiprocessing.get_context('spawn') (for an executor: "
            "mp_context=), or unset LP_NUM_THREADS where the renderer is llvmpipe"
        )


def is_lost(process: int, thread: int) -> bool:
    """Return True if a context made by this thread of this process cannot be freed in the current one."""
    return process != os.getpid() and (thread != threading.get_ident() or not _goes_on)


def abandon(*lost: Any) -> None:
    """Keep objects that would call OpenGL when freed until the end of the process."""
    for each in lost:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(each))


def _has_rasteriser_threads() -> bool:
    tasks = Path("/proc/self/task")
    return any(task.read_text().startswith(_RASTERISER_THREAD) for task in tasks.glob("*/comm"))


def _before_fork() -> None:
    global _n_forking
    _state.acquire()
    _n_forking += 1
    _state.wait_for(lambda: _n_drawing == getattr(_own, "drawing", False))
    # Mesa waits at the end of a child for a thread of the parent's, by an address that a new thread may reuse: one of
    # OpenCV's pool never ends, and so the child would not. So the child has no such pool, and the parent none while it
    # forks.
    cv2 = sys.modules.get("cv2")
    if _drawn_in is not None and cv2 is not None:
        _opencv_threads.append(cv2.getNumThreads())
        cv2.setNumThreads(1)


def _after_in_parent() -> None:
    global _n_forking
    if _opencv_threads:
        sys.modules["cv2"].setNumThreads(_opencv_threads.pop())
    _n_forking -= 1
    _state.notify_all()
    _state.release()


def _after_in_child() -> None:
    global _n_forking, _n_drawing
    _n_forking, _n_drawing = 0, int(getattr(_own, "drawing", False))
    _state.release()
    egl = sys.modules.get("mujoco.egl")
    if egl is not None:
        atexit.unregister(egl._terminate_display)  # would wait for threads missing in the child
        if not _goes_on:
            egl.EGL_DISPLAY = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_in_parent, after_in_child=_after_in_child)


INSTALL_EGL = "apt-get install libegl1 libgl1-mesa-dri"
"""Command that installs software rendering on a Debian machine."""

_GL_RENDERER, _GL_VERSION, _GL_RGBA = 0x1F01, 0x1F02, 0x1908


@dataclass(frozen=True)
class GlInfo:
    """The machine's OpenGL, noted with every image for later comparison."""

    renderer: str
    version: str


def gl_info() -> GlInfo:
    """Return name and version of the OpenGL whose context is current."""
    from OpenGL.EGL import eglGetProcAddress

    address = ctypes.cast(eglGetProcAddress("glGetString"), ctypes.c_void_p).value  # pyright: ignore[reportArgumentType]
    get_string = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(address or 0)
    renderer, version = get_string(_GL_RENDERER), get_string(_GL_VERSION)
    return GlInfo(renderer.decode(), version.decode())


def make_context() -> Any:
    """Return an EGL context of our own, whatever `import mujoco` was configured to use: an idle one, else a new one.

    In an idle one the shaders are compiled already, which takes a quarter of a second in software.
    MuJoCo's C code reads MUJOCO_GL when the first context is made, its Python code when it is imported; importing `mujoco.egl`
    here leaves a machine without EGL free to import mujoco for all but images. Raises InputError where there is none, or none
    that survived a fork.
    """
    os.environ["MUJOCO_GL"] = "egl"
    # No thread for the rasteriser: the second core is worth more for encoding and tracking, alternating with ours is no
    # faster, and only without one can a forked process continue.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    global _gl_errors
    check_process()
    with _state:
        idle = _idle.pop() if _idle else None
    if idle is not None:
        idle.make_current()
        return idle
    try:
        from mujoco.egl import GLContext
        from OpenGL.error import Error as OpenGlError

        _gl_errors = (OpenGlError,)
    except (ImportError, OSError, AttributeError) as error:
        raise InputError(_no_egl(error)) from error
    try:
        context = GLContext(1, 1)
        context.make_current()
        note_context(gl_info().renderer)
    except (ImportError, RuntimeError, OpenGlError) as error:
        raise InputError(_no_egl(error)) from error
    return context


def make_mjr_context(model: mujoco.MjModel, context: Any, samples: int, shadow_map_px: int) -> mujoco.MjrContext:
    """Make MuJoCo's part of a context: the model's meshes and textures, a buffer with this many samples per pixel (0: one).

    shadow_map_px: side of a lamp's shadow map (0: none, where the model's would take 64 MB). Raises InputError without EGL.
    """
    quality = model.vis.quality
    own = quality.offsamples, quality.shadowsize
    quality.offsamples, quality.shadowsize = samples, shadow_map_px
    try:
        mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    except mujoco.FatalError as error:
        context.free()
        raise InputError(_no_egl(error)) from error
    finally:
        quality.offsamples, quality.shadowsize = own
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, mjr)
    # The framebuffer's own layout: reading RGB instead is ten times slower.
    mjr.readPixelFormat = _GL_RGBA
    # MuJoCo draws with 0 at the far plane, where floats are dense; reversing it would lose that.
    mjr.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return mjr


def fitted(mjr: mujoco.MjrContext | None, width: int, height: int) -> mujoco.MjrContext:
    """Return MuJoCo's part of a context with a buffer of at least this size [px]."""
    assert mjr is not None
    if width > mjr.offWidth or height > mjr.offHeight:
        mujoco.mjr_resizeOffscreen(max(width, mjr.offWidth), max(height, mjr.offHeight), mjr)
    return mjr


def free(context: Any, maker: tuple[int, int], *drawers: mujoco.MjrContext | None) -> None:
    """Free MuJoCo's parts of a context made by `maker`, a process and its thread, and keep the context for the next renderer.

    One that is still current in another thread, which EGL leaves even when that ends, is kept until the process ends.
    """
    if is_lost(*maker) or sys.is_finalizing():
        abandon(context, *drawers)
        return
    try:
        with context.as_current():
            for each in drawers:
                if each is not None:
                    each.free()
    except _gl_errors:
        if maker[1] == threading.get_ident():
            raise
        abandon(context, *drawers)
        return
    _keep(context)


def _keep(context: Any) -> None:
    """Leave a context current in no thread, to be used again by any; free it where enough are kept."""
    from mujoco.egl import EGL, EGL_DISPLAY

    with _state:
        is_kept = EGL_DISPLAY is not None and len(_idle) < _MOST_IDLE
        if is_kept:
            current = EGL.eglGetCurrentContext()
            if current and current.address == context._context.address:
                EGL.eglMakeCurrent(EGL_DISPLAY, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT)
            _idle.append(context)
    if not is_kept:
        context.free()


@atexit.register
def _leave_idle() -> None:
    """Leave idle contexts to the end of the process, when OpenGL's modules may be unloaded before them."""
    abandon(*_idle)


def _no_egl(error: Exception) -> str:
    reason = str(error).split(". ")[0].strip() or type(error).__name__
    return (
        f"cannot render: EGL gives no OpenGL context ({reason}); on Debian `{INSTALL_EGL}` brings it, "
        "and a run with --no-images needs none"
    )
