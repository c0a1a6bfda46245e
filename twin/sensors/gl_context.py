"""OpenGL without a screen: a context on EGL, and what draws in it."""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from typing import Any

import mujoco

from trackers.errors import InputError
from twin.sensors.gl_forks import check_process, note_context

INSTALL_EGL = "apt-get install libegl1 libgl1-mesa-dri"
"""What brings software rendering to a Debian machine."""

_GL_RENDERER, _GL_VERSION, _GL_RGBA = 0x1F01, 0x1F02, 0x1908


@dataclass(frozen=True)
class GlInfo:
    """The machine's OpenGL, as noted beside every picture that is compared later."""

    renderer: str
    version: str


def gl_info() -> GlInfo:
    """Name and version of the OpenGL whose context is current."""
    from OpenGL.EGL import eglGetProcAddress

    address = ctypes.cast(eglGetProcAddress("glGetString"), ctypes.c_void_p).value  # pyright: ignore[reportArgumentType]
    get_string = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(address or 0)
    renderer, version = get_string(_GL_RENDERER), get_string(_GL_VERSION)
    return GlInfo(renderer.decode(), version.decode())


def make_context() -> Any:
    """An EGL context of our own, whatever `import mujoco` was told to use.

    MuJoCo's C code reads MUJOCO_GL when the first context is made, its Python code when it is imported; importing
    `mujoco.egl` here leaves a machine without EGL free to import mujoco for everything but pictures.
    Raises InputError where there is none, or none that survived a fork.
    """
    os.environ["MUJOCO_GL"] = "egl"
    # No thread of the rasteriser's: the second core is worth more to what runs beside the renderer (encoding, tracking),
    # one thread in turns with ours is no faster, and none is what a forked process can go on with.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    check_process()
    try:
        from mujoco.egl import GLContext
        from OpenGL.error import Error as OpenGlError
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
    """MuJoCo's side of a context: the model's meshes and textures, a buffer with this many samples a pixel (0: one).

    shadow_map_px: the side of the map of a lamp's shadows (0: none, where the model would say 64 MB).
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
    # The framebuffer's own layout: reading RGB instead costs ten times as much.
    mjr.readPixelFormat = _GL_RGBA
    # MuJoCo draws with 0 at the far plane, where floats are dense; turning it round would cost that.
    mjr.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return mjr


def _no_egl(error: Exception) -> str:
    reason = str(error).split(". ")[0].strip() or type(error).__name__
    return (
        f"cannot render: EGL gives no OpenGL context ({reason}); on Debian `{INSTALL_EGL}` brings it, "
        "and a run with --no-images needs none"
    )
