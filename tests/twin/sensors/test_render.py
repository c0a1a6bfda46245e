"""The renderer: what is left out is out of sight, one thread, clear words without EGL."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest
from capsule_room import ROOM, CapsuleWorld, capsule_model
from numpy.typing import NDArray

from trackers.cameras import FisheyeIntrinsics
from twin.scenario import Scenario
from twin.sensors.camera import Lens
from twin.sensors.fisheye import FaceTable, _nearest_face, build_face_table
from twin.sensors.gl_context import INSTALL_EGL
from twin.sensors.render import OffscreenRenderer, RendererOnDemand
from twin.world.simulation import Simulation

EYE_M = np.array([0.0, 0.2, 1.0])
LENS: FisheyeIntrinsics = Lens(width=200, height=200, fx=45, field_of_view_deg=220).intrinsics()
# Columns: right, down, ahead, for a camera that looks along the room's y.
ROOM_FROM_CAMERA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def faces() -> FaceTable:
    return build_face_table(LENS, ROOM_FROM_CAMERA)


def draw(renderer: OffscreenRenderer, world: CapsuleWorld) -> NDArray[np.uint8]:
    table = faces()
    out = np.zeros((table.height, table.width, 4), dtype=np.uint8)
    renderer.render(world.snapshot(0.0).data, EYE_M, table.views, out)
    return out


def test_leaving_out_the_unseen_changes_no_pixel():
    world = CapsuleWorld(capsule_model())
    with (
        OffscreenRenderer(world.model) as leaving_out,
        OffscreenRenderer(world.model, cull=False) as drawing_all,
    ):
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


def test_a_context_used_before_draws_the_same():
    """Shaders, lights, samples and sizes of the renderer before leave nothing behind in the context that is used again."""
    room = ROOM.replace('shadowsize="0"', 'shadowsize="1024"')
    plain, lit = CapsuleWorld(capsule_model()), CapsuleWorld(capsule_model({}, room=room))
    drawn = []
    for world, switches in [(plain, {}), (lit, {"shadows": True, "samples": 4}), (plain, {})]:
        with OffscreenRenderer(world.model, **switches) as renderer:
            drawn.append(draw(renderer, world))
            context = renderer._context
    with OffscreenRenderer(plain.model) as again, OffscreenRenderer(plain.model) as beside:
        assert again._context is context
        assert beside._context is not context
        drawn += [draw(beside, plain), draw(again, plain)]
    for each in (drawn[2], *drawn[3:]):
        np.testing.assert_array_equal(each, drawn[0])
    assert (drawn[1] != drawn[0]).any()


def test_a_context_of_one_thread_is_used_in_another():
    world = CapsuleWorld(capsule_model())

    def picture(_: int) -> NDArray[np.uint8]:
        with OffscreenRenderer(world.model) as renderer:
            return draw(renderer, world)

    with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second:
        pictures = [one.submit(picture, 0).result() for one in (first, second, first)]
    for each in pictures:
        np.testing.assert_array_equal(each, picture(0))


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


_VIEW = {"vertical_field_of_view_deg": 59}
SENSING_ROOM_CAMERAS = {
    "camera": {"kind": "camera", **_VIEW, "mount": {"xyz": [-2.35, -1.95, 2.4], "yaw_deg": 40, "pitch_deg": 25}},
    "stereo": {"kind": "stereo", **_VIEW, "mount": {"xyz": [2.35, -1.95, 2.4], "yaw_deg": 140, "pitch_deg": 25}},
    "fisheye": {"kind": "fisheye", "mount": {"xyz": [-1.0, -2.0, 1.05], "yaw_deg": 90}},
}


def home_pictures(rendering: dict[str, Any]) -> dict[str, NDArray[np.int16]]:
    size = {"camera": [160, 120], "stereo": [160, 120], "fisheye": [160, 160]}
    content = {
        "name": "home",
        "room": "sensing_room",
        "duration_s": 1,
        "people": {"ann": {"start": [0, 0], "script": {"kind": "stand"}}},
        "sensors": {
            name: {**sensor, "rate_hz": 5, "noise": "off", "size": size[name]}
            for name, sensor in SENSING_ROOM_CAMERAS.items()
        },
        **rendering,
    }
    content["sensors"]["stereo"] |= {"baseline_m": 0.1, "mode": "ideal"}
    with Simulation(Scenario.model_validate(content)) as simulation:
        return {name: seen.rgb.astype(np.int16) for name, seen in simulation.look(0).items()}  # pyright: ignore[reportAttributeAccessIssue]


def test_a_scenario_s_rendering_reaches_every_kind_of_camera():
    plain = home_pictures({})
    for name, picture in home_pictures({"rendering": {"shadows": False, "samples": 0}}).items():
        np.testing.assert_array_equal(picture, plain[name])
    shadowed = home_pictures({"rendering": {"shadows": True, "samples": 4}})
    for name, picture in shadowed.items():
        darker = (picture - plain[name]).sum(axis=-1) < -60
        assert 0.02 < darker.mean() < 0.5, f"{name}: a lamp's shadows, not the night"


def test_shadows_leave_no_seam_between_the_faces_of_a_fisheye():
    """What shadows change must not jump from one face of the cube to the next."""
    world = CapsuleWorld(capsule_model({}, room=ROOM.replace('shadowsize="0"', 'shadowsize="1024"')))
    table, bent = faces(), []
    for shadows in (False, True):
        with OffscreenRenderer(world.model, shadows=shadows) as renderer:
            drawn = cv2.remap(draw(renderer, world), table.column, table.row, cv2.INTER_LINEAR)
        bent.append(drawn[..., :3].astype(np.int16))
    change = (bent[1] - bent[0]).sum(axis=-1)
    face = _nearest_face(LENS.pixel_rays())
    at_seam = (face[:, 1:] != face[:, :-1]) & (face[:, 1:] >= 0) & (face[:, :-1] >= 0)
    shadowed = at_seam & (change[:, 1:] < -60) & (change[:, :-1] < -60)
    lit_beside = at_seam & ((change[:, 1:] < -60) != (change[:, :-1] < -60))
    assert shadowed.sum() > 3 * lit_beside.sum(), "who is in the shadow on one side of a seam is so on the other"
