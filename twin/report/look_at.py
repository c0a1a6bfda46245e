"""Pictures of a scene from any place towards any other, for people to look at: lit for them where the room is dark."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.room.lighting import ENOUGH_LIGHT, MOST_LAMPS, light_of
from twin.sensors.render import OffscreenRenderer
from twin.sensors.render_scene import Mark, View

DARK = ", dark: lit for this view"
"""What is said of a picture of a room with less."""


def axes_towards(eye_m: Array, target_m: Array) -> tuple[Array, Array, Array]:
    """Unit vectors right, up and forward (3,) of an upright camera at `eye_m` (3,) that looks at `target_m` (3,) [m]."""
    forward = (target_m - eye_m) / np.linalg.norm(target_m - eye_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


@contextmanager
def lit_for_the_eye(model: mujoco.MjModel) -> Iterator[None]:
    """Light a model from the eye while the block runs, by as much as its lamps fall short of `ENOUGH_LIGHT`."""
    head, missing = model.vis.headlight, ENOUGH_LIGHT - light_of(model)
    if missing <= 0:
        yield
        return
    own = head.active, head.ambient.copy(), head.diffuse.copy(), model.light_active.copy()
    head.active = True
    head.ambient[:] += missing
    head.diffuse[:] += 0.5 * missing
    if np.count_nonzero(model.light_active) >= MOST_LAMPS:  # no place for one more
        model.light_active[:] = False
    try:
        yield
    finally:
        head.active, head.ambient[:], head.diffuse[:], model.light_active[:] = own


def picture(
    renderer: OffscreenRenderer,
    data: mujoco.MjData,
    eye_m: Array,
    target_m: Array,
    half_height: float,
    size_px: tuple[int, int],
    *,
    finer: int = 1,
    marks: Sequence[Mark] = (),
) -> NDArray[np.uint8]:
    """The scene from `eye_m` (3,) towards `target_m` (3,) [m], not straight up or down: RGB (height, width, 3).

    `half_height`: tangent of half the vertical field; `size_px`: width and height; `finer`: drawn so many times as large
    and averaged, which smooths edges. `data` needs kinematics and light poses. A dark room is lit from the eye, which no
    sensor sees.
    """
    _, up, forward = axes_towards(eye_m, target_m)
    width, height = finer * size_px[0], finer * size_px[1]
    half_width = half_height * width / height
    pixels = np.zeros((height, width, 4), dtype=np.uint8)
    view = View(
        (float(forward[0]), float(forward[1]), float(forward[2])),
        (float(up[0]), float(up[1]), float(up[2])),
        -half_width, half_width, -half_height, half_height, (0, 0, width, height),
    )  # fmt: skip
    with lit_for_the_eye(renderer.model):
        renderer.render(data, eye_m, [view], pixels, marks)
    upright = np.ascontiguousarray(pixels[::-1, :, :3])
    return upright if finer == 1 else np.asarray(cv2.resize(upright, size_px, interpolation=cv2.INTER_AREA), np.uint8)
