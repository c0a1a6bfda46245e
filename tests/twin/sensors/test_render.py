"""The renderer: what is left out is out of sight, one thread, clear words without EGL."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numpy as np
import pytest
from capsule_room import ROOM, CapsuleWorld, capsule_model
from numpy.typing import NDArray

from trackers.cameras import FisheyeIntrinsics
from twin.sensors.fisheye_faces import FaceTable, build_face_table
from twin.sensors.lens import Lens
from twin.sensors.render import INSTALL_EGL, OffscreenRenderer, RendererOnDemand

EYE_M = np.array([0.0, 0.2, 1.0])
LENS: FisheyeIntrinsics = Lens(width=200, height=200, fx=45, field_of_view_deg=220).intrinsics()
# Columns: right, down, ahead, for a camera that looks along the room's y.
ROOM_FROM_CAMERA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def faces() -> FaceTable:
    return build_face_table(LENS, ROOM_FROM_CAMERA, 1.0)


def draw(renderer: OffscreenRenderer, world: CapsuleWorld) -> NDArray[np.uint8]:
    table = faces()
    out = np.zeros((table.height, table.width, 4), dtype=np.uint8)
    renderer.render(world.snapshot(0.0).data, EYE_M, table.views, out)
    return out


def test_leaving_out_the_unseen_changes_no_pixel():
    # With shadows on nothing is left out; without lights that cast them the picture must be the same.
    world = CapsuleWorld(capsule_model(room=ROOM.replace("<light ", '<light castshadow="false" ')))
    with OffscreenRenderer(world.model) as leaving_out, OffscreenRenderer(world.model, shadows=True) as drawing_all:
        picture = draw(leaving_out, world)
        np.testing.assert_array_equal(picture, draw(drawing_all, world))
        assert picture[..., :3].any()
        np.testing.assert_array_equal(picture, draw(leaving_out, world))


def test_shadows_are_there_when_asked_for():
    room = ROOM.replace('shadowsize="0"', 'shadowsize="1024"')
    world = CapsuleWorld(capsule_model(room=room))
    with OffscreenRenderer(world.model) as plain, OffscreenRenderer(world.model, shadows=True) as shadowed:
        assert draw(shadowed, world).sum(dtype=int) < draw(plain, world).sum(dtype=int)


def test_gl_is_named(renderer: RendererOnDemand):
    info = renderer().gl_info()
    assert info.renderer
    assert info.version[0].isdigit()


def test_the_renderer_is_made_on_demand_and_once(world: CapsuleWorld):
    with RendererOnDemand(world.model) as renderer:
        assert renderer._renderer is None
        assert renderer() is renderer()
    assert renderer._renderer is None


def test_another_thread_is_refused(world: CapsuleWorld, renderer: RendererOnDemand):
    mine = renderer()
    caught: list[Exception] = []

    def work() -> None:
        try:
            draw(mine, world)
        except RuntimeError as error:
            caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert "belongs to the thread" in str(caught[0])


def test_closed_means_closed(world: CapsuleWorld):
    renderer = OffscreenRenderer(world.model)
    renderer.close()
    renderer.close()
    with pytest.raises(RuntimeError, match="closed"):
        draw(renderer, world)


_RENDER = """
import mujoco
from trackers.errors import InputError
from twin.sensors.render import OffscreenRenderer
try:
    OffscreenRenderer(mujoco.MjModel.from_xml_string("<mujoco/>"))
except InputError as error:
    print(error)
"""

_HIDE_LIBRARY = """
from OpenGL.platform import ctypesloader
load = ctypesloader.loadLibrary
def missing(loader, name, mode=None):
    if name == "EGL":
        raise OSError("libEGL.so.1: cannot open shared object file")
    return load(loader, name, mode)
ctypesloader.loadLibrary = missing
"""


@pytest.mark.parametrize(
    ("prelude", "surroundings"),
    [("", {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}), (_HIDE_LIBRARY, {})],
    ids=["no driver", "no library"],
)
def test_without_egl_the_error_says_what_to_install(prelude: str, surroundings: dict[str, str]):
    clean = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    done = subprocess.run(
        [sys.executable, "-c", prelude + _RENDER], env=clean | surroundings, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert INSTALL_EGL in done.stdout
    assert len(done.stdout.strip().splitlines()) == 1
