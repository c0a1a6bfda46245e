"""The head: skull with nose and ears, hair, cap. x ahead, y left, z up; heights from the pivot of the neck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.body.appearance import Appearance
from twin.people.body.face import EYES, head_picture, scalp
from twin.people.body.surfaces import Surface, around, ellipsoid, loft, rings

_SIDES = 18
_DRAWN_AT_M = 0.2275
"""Measures below are for a head of this height and scale with it [m]."""
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

    def ring(self, grow: Array | float = 0.0, sections: Array = _SECTIONS, sides: int = _SIDES) -> Array:
        """Rings of the head's skin, moved outwards by `grow` (m, sides) [m]."""
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
        skin = rings(plain, sides, square=2.25)
        if np.isscalar(grow) and grow == 0.0:
            return skin
        centre = np.array([0.0, 0.0, self.chin + 0.55 * self.height])
        away = skin - centre
        away /= np.linalg.norm(away, axis=-1, keepdims=True)
        return skin + np.broadcast_to(grow, skin.shape[:2])[..., None] * away


def shape_of(chin: float, top: float, length: float, breadth: float, looks: Appearance) -> HeadShape:
    """The head whose chin is at `chin` and whose hair or cap ends at `top` [m]; what stands out more is above it."""
    cover = _CAP_M if looks.cap is not None else min(_thickness(looks.hair_style), 0.024)
    return HeadShape(chin, chin + (top - chin) / (1 + cover / _DRAWN_AT_M), length, breadth)


def _thickness(style: str) -> float:
    """Of the hair on the crown [m], on a head of 0.2275 m."""
    if style in _NO_VOLUME:
        return 0.0
    return _THICK_M.get(style, 0.008) + (0.0 if style in ("afro", "curly") else 0.006)


def skull(shape: HeadShape, looks: Appearance) -> Surface:
    """The head with nose and ears."""
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


def picture(shape: HeadShape, looks: Appearance) -> NDArray[np.uint8]:
    """The picture that the head wears."""
    steps = np.linalg.norm(np.diff(shape.ring(), axis=0), axis=-1).mean(axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    rises = np.interp(np.linspace(0, 1, 64), along, _SECTIONS[:, 0])
    return head_picture(looks, rises)


def hair(shape: HeadShape, style: str, capped: bool, shoulder: float) -> Surface | None:
    """The hair's volume, None where none stands out from the scalp.

    `capped`: a cap holds it down; `shoulder` [m]: height of the shoulders, for what falls on them.
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
    """Hair that hangs behind the face: a horseshoe in each level, from over the ears to its end."""
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
    """A cap with its peak ahead."""
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
