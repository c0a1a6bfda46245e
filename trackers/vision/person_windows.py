"""Windows that show an upright person at places of the floor, whatever the lens and however steeply it looks down.

A window is a rectangle through the middle of the person, square to the line of sight and level from side to side: as high as
a standing person looks from there, as wide as one with swinging arms. It is laid out in the room as a grid of cells and
projected, so that it has the size, the slant and the bend that a person has at that place of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.filters.rows import Rows

HEIGHT_M, DEPTH_M = 1.75, 0.5
"""Of the person that a window is cut for: they come as high as 1.95 m, and lean."""
_AROUND = 1.15
"""Length of the window, in that of the person."""
WIDTH_M = 1.0


@dataclass(frozen=True, eq=False)
class PersonWindows(Rows):
    """One window a place, cells row by row from the crown down and from left to right."""

    pixels: Float[Array, "n rows columns 2"]  # the cells' middles [px], NaN behind a pinhole
    inside: Bool[Mask, "n rows columns"]  # whether the picture shows them
    cell_px: Float[Array, "n"]  # side of a cell in the middle of the window
    right: Float[Array, "n 2"]  # unit vectors on the floor: to the right, and ahead, as the camera looks at the place
    ahead: Float[Array, "n 2"]
    steepness: Float[Array, "n"]  # 0 where the camera looks level at the person, 1 straight down


def person_windows(camera: PlacedCamera, places_m: Float[Array, "n 2"], rows: int, columns: int) -> PersonWindows:
    """The windows at places on the floor, z = 0."""
    middle = np.concatenate([places_m, np.full((len(places_m), 1), HEIGHT_M / 2)], axis=1)
    sight = middle - camera.eye_m
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
    level = np.linalg.norm(sight[:, :2], axis=1)
    ahead = np.where(level[:, None] > 1e-6, sight[:, :2] / np.maximum(level, 1e-6)[:, None], (0.0, 1.0))
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    down = -sight[:, 2]
    up = np.concatenate([ahead * down[:, None], level[:, None]], axis=1)  # square to the sight and to the right
    height = _AROUND * (HEIGHT_M * level + DEPTH_M * np.abs(down))
    across = ((np.arange(columns) + 0.5) / columns - 0.5) * WIDTH_M
    along = (0.5 - (np.arange(rows) + 0.5) / rows) * height[:, None]
    points = np.repeat((middle[:, None] + along[..., None] * up[:, None])[:, :, None], columns, axis=2)
    points[..., :2] += across[:, None] * right[:, None, None]
    pixels, inside = camera.project(points)
    next_cell = middle.copy()
    next_cell[:, :2] += right * (WIDTH_M / columns)
    cell = camera.project(next_cell)[0] - camera.project(middle)[0]
    return PersonWindows(pixels, inside, np.hypot(cell[:, 0], cell[:, 1]), right, ahead, np.abs(down))


def largest_overlap(pixels: Float[Array, "k rows columns 2"]) -> Float[Array, "k"]:
    """For each window the largest share of its bounding box that another's covers."""
    k = len(pixels)
    if k < 2:
        return np.zeros(k)
    u, v = pixels[..., 0].reshape(k, -1), pixels[..., 1].reshape(k, -1)
    low = np.stack([u.min(axis=1), v.min(axis=1)], axis=1)
    high = np.stack([u.max(axis=1), v.max(axis=1)], axis=1)
    common = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    area = np.nan_to_num(np.prod(np.maximum(common, 0), axis=-1))  # what lies behind a pinhole has no pixels
    own = np.maximum(np.prod(high - low, axis=-1), 1e-9)
    np.fill_diagonal(area, 0)
    return (area / own[:, None]).max(axis=1)
