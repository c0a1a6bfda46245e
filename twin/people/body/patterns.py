"""Cloth with a pattern, painted into small pictures: stripes, checks, a print on the chest, a coat's front."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackers.arrays import Array

Picture = NDArray[np.uint8]

TILE_M = 0.09
"""Breadth and height of the cloth in one repeat of `tile` [m]."""

MOTIFS = ("disc", "star", "bars", "heart", "number")
"""What a print shows."""

_TILE_PX = 32
_FRONT_PX = (128, 160)  # rows, columns of a trunk's picture


def tile(pattern: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """One repeat (32, 32, 3) of 'striped' or 'checked' cloth."""
    place = (np.arange(_TILE_PX) + 0.5) / _TILE_PX
    across, down = np.meshgrid(place, place)
    if pattern == "striped":
        share = (down < 0.42).astype(float)
    elif pattern == "checked":
        # where the coloured threads cross both ways the cloth is full, where one does it is half
        share = 0.5 * (across < 0.45) + 0.5 * (down < 0.45)
    else:
        raise ValueError(f"no tile for {pattern!r}; 'striped' or 'checked' are expected")
    return _blend(colour, second, share)


def printed(motif: str, colour: ArrayLike, second: ArrayLike) -> Picture:
    """A trunk's picture with a print on the chest; u = 0.5 is the front, rows from the top."""
    rows, columns = _FRONT_PX
    across = ((np.arange(columns) + 0.5) / columns - 0.5) / 0.072
    up = (1 - (np.arange(rows) + 0.5) / rows - 0.58) / 0.13
    x, y = np.meshgrid(across, up)
    return _blend(colour, second, _motif(motif, x, y))


def _motif(motif: str, x: Array, y: Array) -> Array:
    """Share of ink, 0 or 1; x from the wearer's right to the left and y up, both about -1 to 1 over the print."""
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
    """A trunk's picture: a coat closed by a row of buttons, the shirt in its neck; rows from the top."""
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
