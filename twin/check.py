"""Can this machine render, and how fast."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.metadata import version

import mujoco
import numpy as np

from twin import models
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import View

_SIDE_PX = 400
_FRAMES = 5


def check_machine() -> Iterator[str]:
    """One line on each thing checked; raises InputError, saying what to do, where the machine cannot render."""
    yield f"roomtwin    {version('roomtwin')}"
    yield f"mujoco      {mujoco.__version__}"
    model = mujoco.MjModel.from_xml_path(str(models.find("rooms", "lab")))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    with OffscreenRenderer(model) as renderer:
        info = renderer.gl_info()
        yield f"renderer    {info.renderer}"
        yield f"OpenGL      {info.version}"
        pixels = np.zeros((_SIDE_PX, _SIDE_PX, 4), dtype=np.uint8)
        ahead = View((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), -1.0, 1.0, -1.0, 1.0, (0, 0, _SIDE_PX, _SIDE_PX))
        eye_m = np.array([0.0, 0.0, 1.05])
        spent_ms = []
        for _ in range(_FRAMES):
            start = time.perf_counter()
            renderer.render(data, eye_m, [ahead], pixels)
            spent_ms.append(1e3 * (time.perf_counter() - start))
    yield f"frame time  {np.median(spent_ms):.1f} ms for {_SIDE_PX} × {_SIDE_PX} of the lab"
    yield "this machine can render"
