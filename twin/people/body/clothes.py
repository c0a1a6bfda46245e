"""Loose clothes and bags: skirts, coat tails, sleeves, backpacks and handbags; each moves rigidly with one segment.

A skirt, or a coat below the hips, is two bells, one per thigh, which overlap in the middle. Standing it looks closed,
walking it opens like a tent, sitting it lies on the lap. At its height a scanner sees one object, half a metre broad. A
skirt ends over the knee and a coat at the middle of the thigh, so a scanner at shin height sees two legs. No skirt is long
enough to hide the legs from a scanner at knee height.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array
from twin.people.body.surfaces import Surface, cord, limb, loft, rings

SKIRT_HEM = 0.97
"""End of a skirt, as a share of the thigh from the hip."""
COAT_HEM = 0.74
"""End of a coat, as a share of the thigh from the hip."""


def bell(
    sign: int, thigh: float, hip_lateral: float, breadth: float, depth: float, hem: float, flare: float
) -> Surface:
    """Make half of a skirt around the left (sign 1) or right (-1) thigh, in the thigh's frame.

    `thigh`: its length; `hip_lateral`: from the middle of the body to the hip joint; `breadth`, `depth`: half breadth and
    half depth of the hips with the cloth on [m]; `hem`: its end as a share of the thigh; `flare`: relative widening at the
    hem.
    """
    rows = []
    for share in (-0.09, 0.03, 0.35, 0.65, 0.94, 1.0):
        grow = 1 + flare * max(share, 0.0)
        outer = breadth * grow * (0.84 if share < 0 else 1.0)
        inner = -0.075 * breadth / 0.16 * (1 + 0.4 * max(share, 0.0))
        middle, half = 0.5 * (outer + inner) - hip_lateral, 0.5 * (outer - inner)
        rows.append((-0.004, sign * middle, -share * hem * thigh, depth * grow * (0.82 if share < 0 else 1.0), half))
    return loft(rings(np.array(rows[::-1]), 14, square=2.3))


def backpack(trunk: float, depth: float, k: float) -> Surface:
    """Make a backpack in the trunk's frame: `trunk` from waist to shoulder, `depth` from its middle to the back [m]."""
    rows = [
        (-depth - 0.055 * k, 0, 0.10 * trunk, 0.045 * k, 0.105 * k),
        (-depth - 0.070 * k, 0, 0.13 * trunk, 0.075 * k, 0.130 * k),
        (-depth - 0.072 * k, 0, 0.50 * trunk, 0.080 * k, 0.135 * k),
        (-depth - 0.058 * k, 0, 0.86 * trunk, 0.065 * k, 0.125 * k),
        (-depth - 0.045 * k, 0, 0.97 * trunk, 0.038 * k, 0.085 * k),
    ]
    pocket = [
        (-depth - 0.140 * k, 0, 0.17 * trunk, 0.020 * k, 0.085 * k),
        (-depth - 0.145 * k, 0, 0.22 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.145 * k, 0, 0.45 * trunk, 0.030 * k, 0.095 * k),
        (-depth - 0.140 * k, 0, 0.50 * trunk, 0.020 * k, 0.085 * k),
    ]
    return loft(rings(rows, 14, square=3.5)) + loft(rings(pocket, 12, square=3.5))


def over_the_shoulder(front: np.ndarray, k: float, sign: int) -> Surface:
    """Make one strap of a backpack; `front` (m, 3): points of the chest's surface from the top down, left side [m]."""
    return cord(front * (1, sign, 1), 0.013 * k)


def shoulder_bag(k: float) -> Surface:
    """Make a bag worn behind the hip, flat against the body, about its middle."""
    rows = [
        (0, 0, -0.105 * k, 0.030 * k, 0.115 * k),
        (0, 0, -0.095 * k, 0.042 * k, 0.135 * k),
        (0, 0, 0.060 * k, 0.036 * k, 0.130 * k),
        (0, 0, 0.095 * k, 0.022 * k, 0.115 * k),
    ]
    return loft(rings(rows, 14, square=4.0))


def handbag(k: float) -> Surface:
    """Make a bag with two handles that hangs from the fist, which is the origin."""
    rows = [
        (0, 0, -0.300 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.285 * k, 0.145 * k, 0.055 * k),
        (0, 0, -0.190 * k, 0.130 * k, 0.045 * k),
        (0, 0, -0.115 * k, 0.105 * k, 0.020 * k),
    ]
    bag = loft(rings(rows, 14, square=4.0))
    turn = np.linspace(0, np.pi, 9)
    handle = np.column_stack([0.065 * k * np.cos(turn), 0 * turn, -0.125 * k + 0.120 * k * np.sin(turn)])
    apart = np.array([0, 0.010 * k, 0])
    return bag + cord(handle + apart, 0.006 * k) + cord(handle - apart, 0.006 * k)


def sleeve(length: float, top: float, end: float) -> Surface:
    """Make a short sleeve around the upper arm, its open end cut level [m]."""
    return limb(
        [(-length, end, end), (-0.5 * length, 0.5 * (top + end), 0.5 * (top + end)), (0.0, top, top)], 10, False
    )


Picture = NDArray[np.uint8]

TILE_M = 0.09
"""Breadth and height of the cloth in one repeat of `tile` [m]."""

MOTIFS = ("disc", "star", "bars", "heart", "number")
"""Motifs of a print."""

_TILE_PX = 32
_FRONT_PX = (128, 160)  # rows, columns of a trunk's picture


def tile(pattern: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """Paint one repeat (32, 32, 3) of 'striped' or 'checked' cloth."""
    place = (np.arange(_TILE_PX) + 0.5) / _TILE_PX
    across, down = np.meshgrid(place, place)
    if pattern == "striped":
        share = (down < 0.42).astype(float)
    elif pattern == "checked":
        # crossing threads colour the cloth fully, a single thread by half
        share = 0.5 * (across < 0.45) + 0.5 * (down < 0.45)
    else:
        raise ValueError(f"no tile for {pattern!r}; 'striped' or 'checked' are expected")
    return _blend(colour, second, share)


def printed(motif: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """Paint a trunk's texture with a print on the chest; u = 0.5 is the front, rows from the top."""
    rows, columns = _FRONT_PX
    across = ((np.arange(columns) + 0.5) / columns - 0.5) / 0.072
    up = (1 - (np.arange(rows) + 0.5) / rows - 0.58) / 0.13
    x, y = np.meshgrid(across, up)
    return _blend(colour, second, _motif(motif, x, y))


def _motif(motif: str, x: Array, y: Array) -> Array:
    """Return the ink, 0 or 1; x from the wearer's right to the left and y up, both about -1 to 1 over the print."""
    radius, angle = np.hypot(x, y), np.arctan2(x, y)
    match motif:
        case "disc":
            ink = (radius < 1.0) & ~((np.abs(y) < 0.16) & (radius < 0.8))
        case "star":
            ink = radius < 0.44 / np.cos((np.abs(angle) + np.pi / 5) % (2 * np.pi / 5) - np.pi / 5) * (
                1 + 0.9 * (1 - np.abs((angle * 5 / np.pi + 10.0) % 2.0 - 1.0)) * -0.35 + 0.6
            )
        case "bars":
            ink = (np.abs(x) < 1.15) & (np.abs(y) < 0.85) & ((y * 1.8 + 10.3) % 1.0 < 0.55)
        case "heart":
            ink = (x**2 + (y - 0.75 * np.abs(x) ** 0.7 + 0.1) ** 2) < 0.75
        case "number":
            stem = (np.abs(x + 0.55) < 0.17) & (np.abs(y) < 0.9)
            zero = np.abs(np.hypot((x - 0.4) / 0.55, y / 0.9) - 0.82) < 0.2
            ink = stem | zero
        case _:
            raise ValueError(f"no motif {motif!r}; valid are {', '.join(MOTIFS)}")
    return ink.astype(float)


def coat_front(coat: ArrayLike, shirt: ArrayLike) -> Picture:
    """Paint a trunk's texture: a coat closed by a row of buttons, the shirt in its neck; rows from the top."""
    rows, columns = _FRONT_PX
    coat = np.asarray(coat, dtype=float)
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns - 0.5, 1 - (np.arange(rows) + 0.5) / rows)
    out = np.broadcast_to(coat, (rows, columns, 3)).copy()
    dark = 0.62 * coat
    lapel = np.abs(u) < 0.33 * (v - 0.56)
    neck = np.abs(u) < 0.19 * (v - 0.60)
    out[lapel] = 0.86 * coat
    out[neck] = shirt
    out[(np.abs(u) < 0.006) & (v < 0.60)] = dark
    for height in (0.08, 0.22, 0.36, 0.50):
        out[(((u - 0.025) / 0.011) ** 2 + ((v - height) / 0.014) ** 2) < 1] = 0.45 * coat
    return (255 * np.clip(out, 0, 1) + 0.5).astype(np.uint8)


def _blend(colour: ArrayLike, second: ArrayLike, share: Array) -> Picture:
    colour, second = np.asarray(colour, dtype=float), np.asarray(second, dtype=float)
    return (255 * (colour + share[..., None] * (second - colour)) + 0.5).astype(np.uint8)
