"""A face and what is on the scalp, painted into a small picture that is wrapped around the head."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array
from twin.people.body.appearance import Appearance

HEAD_PX = (128, 192)
"""Rows and columns of the picture; columns go around the head, the face in the middle."""

EYES = 0.50
MOUTH = 0.235
HAIRLINE = 0.80
"""Places along the height of the head, chin 0, crown 1."""

_WHITE = np.array([0.93, 0.92, 0.90])
_DARK = np.array([0.12, 0.09, 0.08])


def head_picture(looks: Appearance, rises: Array) -> NDArray[np.uint8]:
    """The head's picture (rows, columns, 3), rows from the crown down.

    `rises`: the height of each row of the mesh's texture, v = 0 ... 1, as a share of the head's height, both ends
    included.
    """
    rows, columns = HEAD_PX
    turn = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    v = 1 - (np.arange(rows) + 0.5) / rows
    rise = np.interp(v, np.linspace(0, 1, len(rises)), rises)
    x, z = np.meshgrid(turn, rise)  # x: left of the nose [rad]
    skin, hair = np.array(looks.skin), np.array(looks.hair)
    out = np.broadcast_to(skin, (rows, columns, 3)).copy()
    warm = np.clip(skin * (1.02, 0.86, 0.84), 0, 1)
    for side in (1, -1):
        _blend(out, warm, 0.5 * _soft(((x - side * 0.52) / 0.26) ** 2 + ((z - 0.36) / 0.09) ** 2, 0.8))
    if looks.beard:
        edge = 0.36 - 0.13 * np.exp(-((x / 0.30) ** 2)) + 0.08 * np.clip((np.abs(x) - 0.7) / 0.5, 0, 1)
        _blend(out, hair, 0.85 * _step(edge - z, 0.02) * _step(1.45 - np.abs(x), 0.05) * _step(z - 0.02, 0.01))
        _blend(out, hair, 0.85 * _box(x, z, 0.0, 0.300, 0.34, 0.024))
    lips = np.clip(0.62 * skin + (0.15, 0.0, 0.02), 0, 1)
    _blend(out, lips, _soft((x / 0.27) ** 2 + ((z - MOUTH) / 0.030) ** 2, 0.3))
    _blend(out, 0.45 * lips, _soft((x / 0.25) ** 2 + ((z - MOUTH) / 0.009) ** 2, 0.4))
    brow = 0.55 * hair + 0.1 * skin if sum(looks.hair) > 1.6 else hair
    for side in (1, -1):
        across = x - side * 0.37
        _blend(out, 0.80 * skin, _soft((across / 0.25) ** 2 + ((z - EYES - 0.012) / 0.060) ** 2, 0.5))
        _blend(out, _WHITE, _soft((across / 0.185) ** 2 + ((z - EYES) / 0.036) ** 2, 0.3))
        _blend(out, _DARK, _soft((across / 0.095) ** 2 + ((z - EYES) / 0.038) ** 2, 0.3))
        _blend(out, _DARK, _box(across, z, 0.0, EYES + 0.036, 0.19, 0.008))
        lift = 0.012 * np.cos(across * 6)
        _blend(out, brow, _box(across, z - lift, 0.0, EYES + 0.088, 0.21, 0.015))
    if looks.glasses:
        _paint_glasses(out, x, z)
    if looks.hair_style != "bald":
        _blend(out, hair, scalp(x, z))
    return (255 * np.clip(out, 0, 1) + 0.5).astype(np.uint8)


def scalp(turn: ArrayLike, rise: ArrayLike) -> Array:
    """Share of hair (0 skin to 1) on the head at an angle left of the nose [rad] and a share of the head's height."""
    return _step(np.asarray(rise) - hairline(turn), 0.025)


def hairline(turn: ArrayLike) -> Array:
    """The lowest hair as a share of the head's height: the forehead, the temples, behind the ears, the nape."""
    return np.interp(
        np.abs(np.asarray(turn)),
        [0.0, 0.55, 0.85, 1.15, 1.35, 1.60, 1.95, 2.30, np.pi],
        [HAIRLINE, HAIRLINE - 0.01, 0.72, 0.56, 0.42, 0.50, 0.46, 0.20, 0.14],
    )


def _paint_glasses(out: Array, x: Array, z: Array) -> None:
    frame = np.array([0.10, 0.10, 0.12])
    for side in (1, -1):
        across, up = (x - side * 0.38) / 0.285, (z - EYES + 0.004) / 0.078
        radius = (across**4 + up**4) ** 0.25
        _blend(out, np.array([0.75, 0.80, 0.84]), 0.25 * _step(1.0 - radius, 0.05))
        _blend(out, frame, _step(0.13 - np.abs(radius - 1.0), 0.04))
    _blend(out, frame, _box(np.abs(x), z, 0.04, EYES + 0.02, 0.07, 0.011))
    _blend(out, frame, _box(np.abs(x), z, 1.15, EYES + 0.018, 0.50, 0.013))


def _blend(out: Array, colour: ArrayLike, share: Array) -> None:
    out += share[..., None] * (np.asarray(colour) - out)


def _soft(square: Array, edge: float) -> Array:
    """1 inside an ellipse (square of the relative radius below 1), falling to 0 over `edge`."""
    return np.clip((1 + edge - square) / edge, 0, 1)


def _step(inside: Array, edge: float) -> Array:
    return np.clip(0.5 + inside / edge, 0, 1)


def _box(x: Array, z: Array, middle_x: float, middle_z: float, half_x: float, half_z: float) -> Array:
    return _step(half_x - np.abs(x - middle_x), 0.03) * _step(half_z - np.abs(z - middle_z), 0.008)
