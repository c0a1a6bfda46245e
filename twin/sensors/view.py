"""What is drawn: a perspective picture from somewhere, and marks in it that are no part of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class View:
    """One perspective picture: where it looks (unit vectors in the room frame), how wide, and where it is drawn.

    left, right, bottom, top bound the picture on the plane at distance 1 (tangents of the angles from `forward`,
    x along forward × up); `viewport` is (column, row, width, height) in the buffer [px], rows counted from the bottom.
    `offset_m` is where it looks from, beside the eye that all views of a moment have in common, room frame.
    """

    forward: tuple[float, float, float]
    up: tuple[float, float, float]
    left: float
    right: float
    bottom: float
    top: float
    viewport: tuple[int, int, int, int]
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def inward_normals(self) -> NDArray[np.float64]:
        """Unit normals of the pyramid's four sides, pointing into it, room frame, (4, 3)."""
        forward, up = np.array(self.forward), np.array(self.up)
        across = np.cross(forward, up)
        normals = np.stack(
            [
                across - self.left * forward,
                -across + self.right * forward,
                up - self.bottom * forward,
                -up + self.top * forward,
            ]
        )
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@dataclass(frozen=True)
class Mark:
    """A level box that is drawn into one picture and is no part of the scene.

    Its middle and half sizes [m], colour RGBA, 0 to 1, and by how much it is turned about z [rad].
    """

    middle: tuple[float, float, float]
    half: tuple[float, float, float]
    rgba: tuple[float, float, float, float]
    yaw_rad: float = 0.0
