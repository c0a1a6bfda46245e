"""Head: skull with nose and ears, hair, cap. x ahead, y left, z up; heights from the pivot of the neck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array
from twin.people.body.appearance import BodyAppearance
from twin.people.body.surfaces import Surface, around, ellipsoid, loft, rings

HEAD_PX = (128, 192)
"""Rows and columns of the texture; columns go around the head, the face in the middle."""

EYES = 0.50
MOUTH = 0.235
HAIRLINE = 0.80
"""Heights as shares of the head: chin 0, crown 1."""

_WHITE = np.array([0.93, 0.92, 0.90])
_DARK = np.array([0.12, 0.09, 0.08])


def picture(shape: HeadShape, looks: BodyAppearance) -> NDArray[np.uint8]:
    """Paint the texture that is wrapped around the head (rows, columns, 3), rows from the crown down."""
    rows, columns = HEAD_PX
    turn = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    steps = np.linalg.norm(np.diff(shape.ring(), axis=0), axis=-1).mean(axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    rises = np.interp(np.linspace(0, 1, 64), along, _SECTIONS[:, 0])
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
    """Return the share of hair (0 skin to 1) at an angle left of the nose [rad] and a share of the head's height."""
    return _step(np.asarray(rise) - hairline(turn), 0.025)


def hairline(turn: ArrayLike) -> Array:
    """Return the lower edge of the hair as a share of the head's height: forehead, temples, behind the ears, nape."""
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
    """Return 1 inside an ellipse (square of the relative radius below 1), falling to 0 over `edge`."""
    return np.clip((1 + edge - square) / edge, 0, 1)


def _step(inside: Array, edge: float) -> Array:
    return np.clip(0.5 + inside / edge, 0, 1)


def _box(x: Array, z: Array, middle_x: float, middle_z: float, half_x: float, half_z: float) -> Array:
    return _step(half_x - np.abs(x - middle_x), 0.03) * _step(half_z - np.abs(z - middle_z), 0.008)


_SIDES = 18
_DRAWN_AT_M = 0.2275
"""Height of the head for which the measures below are given; they scale with it [m]."""
_CAP_M = 0.018
_NO_VOLUME = ("bald", "cropped")
_THICK_M = {"afro": 0.052, "curly": 0.026, "long": 0.014, "bob": 0.018}
# height as a share of chin to crown; front, back and half breadth as shares of length and breadth of the head
_SECTIONS = np.array(
    [
        (0.00, 0.34, 0.06, 0.16),
        (0.025, 0.395, 0.03, 0.25),
        (0.07, 0.43, -0.02, 0.33),
        (0.15, 0.455, -0.12, 0.395),
        (0.235, 0.465, -0.25, 0.425),
        (0.32, 0.47, -0.36, 0.45),
        (0.41, 0.465, -0.43, 0.475),
        (0.50, 0.452, -0.475, 0.492),
        (0.59, 0.472, -0.495, 0.50),
        (0.68, 0.470, -0.50, 0.50),
        (0.77, 0.440, -0.485, 0.480),
        (0.86, 0.360, -0.43, 0.415),
        (0.93, 0.235, -0.335, 0.310),
        (0.98, 0.085, -0.19, 0.165),
        (1.00, -0.02, -0.09, 0.06),
    ]
)


@dataclass(frozen=True)
class HeadShape:
    """Chin and crown above the neck's pivot, length and breadth of the head [m]."""

    chin: float
    crown: float
    length: float
    breadth: float

    @property
    def height(self) -> float:
        """Chin to crown [m]."""
        return self.crown - self.chin

    def ring(self, grow: Array | float = 0.0, sections: Array = _SECTIONS) -> Array:
        """Make rings of the skin (m, _SIDES, 3), moved outwards by `grow` [m]."""
        share, front, back, half = sections.T
        middle = 0.5 * (front + back) * self.length
        plain = np.column_stack(
            [
                middle,
                np.zeros(len(share)),
                self.chin + share * self.height,
                0.5 * (front - back) * self.length,
                half * self.breadth,
            ]
        )
        skin = rings(plain, _SIDES, square=2.25)
        if np.isscalar(grow) and grow == 0.0:
            return skin
        centre = np.array([0.0, 0.0, self.chin + 0.55 * self.height])
        away = skin - centre
        away /= np.linalg.norm(away, axis=-1, keepdims=True)
        return skin + np.broadcast_to(grow, skin.shape[:2])[..., None] * away


def shape_of(chin: float, top: float, length: float, breadth: float, looks: BodyAppearance) -> HeadShape:
    """Return the shape of a head with its chin at `chin` and the top of its hair or cap at `top` [m]."""
    cover = _CAP_M if looks.cap is not None else min(_thickness(looks.hair_style), 0.024)
    return HeadShape(chin, chin + (top - chin) / (1 + cover / _DRAWN_AT_M), length, breadth)


def _thickness(style: str) -> float:
    """Return the thickness of the hair on the crown [m], on a head of 0.2275 m."""
    if style in _NO_VOLUME:
        return 0.0
    return _THICK_M.get(style, 0.008) + (0.0 if style in ("afro", "curly") else 0.006)


def skull(shape: HeadShape, looks: BodyAppearance) -> Surface:
    """Make the head with nose and ears."""
    surface = loft(shape.ring())
    k = shape.height / _DRAWN_AT_M
    eyes = shape.chin + EYES * shape.height
    front = 0.46 * shape.length
    nose = rings(
        [
            (front + 0.004 * k, 0, eyes - 0.052 * k, 0.010 * k, 0.013 * k),
            (front + 0.009 * k, 0, eyes - 0.046 * k, 0.016 * k, 0.017 * k),
            (front + 0.009 * k, 0, eyes - 0.036 * k, 0.015 * k, 0.014 * k),
            (front + 0.001 * k, 0, eyes - 0.012 * k, 0.012 * k, 0.009 * k),
            (front - 0.006 * k, 0, eyes + 0.010 * k, 0.008 * k, 0.008 * k),
        ],
        8,
    )
    surface = surface + loft(nose).painted(0.5, 0.30 if not looks.beard else 0.395)
    for side in (1, -1):
        ear = ellipsoid((0, 0, 0), (0.017 * k, 0.008 * k, 0.030 * k), 8).turned(-0.2)
        at = (-0.010 * k, side * (0.5 * shape.breadth + 0.001 * k), eyes - 0.014 * k)
        surface = surface + ear.moved(at).painted(0.5 + side * 0.33, 0.36)
    return surface


def hair(shape: HeadShape, style: str, capped: bool, shoulder: float) -> Surface | None:
    """Make the hair's volume; None where none stands out from the scalp.

    `capped`: a cap holds it down; `shoulder` [m]: height of the shoulders, on which long hair falls.
    """
    k = shape.height / _DRAWN_AT_M
    if style in _NO_VOLUME:
        return None
    turn = around(_SIDES)
    grow = np.full((len(_SECTIONS), _SIDES), -0.006 * k)
    cover = scalp(turn[None, :], _SECTIONS[:, 0][:, None])
    rise = _SECTIONS[:, 0][:, None]
    high = np.clip((rise - 0.55) / 0.4, 0, 1)
    thick = _THICK_M.get(style, 0.008)
    extra = _thickness(style) - thick
    if capped:
        thick, extra = min(thick, 0.010), -0.006
    body = (thick + extra * high) * k
    if style in ("afro", "curly") and not capped:
        bumps = 0.18 * np.sin(5 * turn[None, :] + 9 * rise) * np.cos(4 * turn[None, :] - 17 * rise)
        body = body * (1 + (bumps if style == "curly" else 0.3 * bumps))
    grow = grow + cover * (body + 0.006 * k)
    surface = loft(shape.ring(grow))
    back, breadth = 0.5 * shape.length, 0.5 * shape.breadth
    eyes = shape.chin + EYES * shape.height
    if style == "bun":
        surface = surface + ellipsoid((-back - 0.018 * k, 0, eyes + 0.045 * k), (0.034 * k, 0.038 * k, 0.036 * k))
    elif style == "ponytail":
        tail = [
            (-back + 0.002 * k, 0, eyes + 0.045 * k, 0.022 * k, 0.022 * k),
            (-back - 0.030 * k, 0, eyes + 0.025 * k, 0.024 * k, 0.026 * k),
            (-back - 0.042 * k, 0, eyes - 0.030 * k, 0.024 * k, 0.032 * k),
            (-back - 0.036 * k, 0, eyes - 0.100 * k, 0.020 * k, 0.028 * k),
            (-back - 0.026 * k, 0, eyes - 0.165 * k, 0.008 * k, 0.010 * k),
        ]
        surface = surface + loft(rings(tail[::-1], 10))
    elif style in ("long", "bob"):
        end = shoulder - 0.035 * k if style == "long" else shape.chin + 0.015 * k
        surface = surface + _curtain(eyes + 0.05 * k, end, back, breadth, k)
    return surface


def _curtain(top: float, end: float, back: float, breadth: float, k: float) -> Surface:
    """Make hair that hangs behind the face: a horseshoe at each level, from above the ears to its end."""
    sides = 12
    angle = np.linspace(0.50 * np.pi, 1.50 * np.pi, sides)
    rows = []
    for share in (0.0, 0.15, 0.4, 0.7, 1.0):
        z = top + share * (end - top)
        half = breadth + (0.013 + 0.006 * np.sin(np.pi * share) - 0.006 * share) * k
        depth = back + (0.010 - 0.030 * share) * k
        outer = np.stack([0.016 * k + depth * np.cos(angle), half * np.sin(angle), np.full(sides, z)], axis=-1)
        inner = np.stack(
            [0.016 * k + (depth - 0.035 * k) * np.cos(angle), (half - 0.022 * k) * np.sin(angle), np.full(sides, z)],
            axis=-1,
        )
        rows.append(np.vstack([outer, inner[::-1]]))
    return loft(np.array(rows[::-1]))


def cap(shape: HeadShape) -> Surface:
    """Make a cap with its peak ahead."""
    k = shape.height / _DRAWN_AT_M
    keep = np.array([0.64, 0.70, 0.78, 0.86, 0.93, 0.98, 1.0])
    sections = np.column_stack([np.interp(keep, _SECTIONS[:, 0], column) for column in _SECTIONS.T])
    sections[:, 0] = keep
    grow = np.array([0.010, 0.014, 0.017, 0.018, 0.018, 0.018, 0.018])[:, None] * k
    crown = loft(shape.ring(np.broadcast_to(grow, (len(keep), _SIDES)), sections))
    z = shape.chin + 0.695 * shape.height
    front, half = 0.40 * shape.length, 0.40 * shape.breadth
    rows = []
    for share in (0.0, 0.35, 0.7, 0.92, 1.0):
        reach = front + share * 0.085 * k
        broad = half * np.sqrt(max(1.0 - share**2.4, 0.02))
        drop = z - 0.018 * k * share
        thick = 0.004 * k
        angle = around(8)
        rows.append(
            np.stack(
                [
                    np.full(8, reach),
                    -broad * np.cos(angle),
                    drop + thick * np.sin(angle) - 0.20 * broad * np.cos(angle) ** 2 * (broad / half),
                ],
                axis=-1,
            )
        )
    return crown + loft(np.array(rows))
