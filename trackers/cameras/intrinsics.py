"""Base of calibrated cameras: picture size, projection of points to pixels, and of pixels to rays."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial import Polynomial
from pydantic import Field, FiniteFloat, PositiveInt

from trackers.arrays import Array, Mask
from trackers.configuration import Strict

LARGEST_SIDE_PX = 8192
"""Greatest width and height of a picture."""
_NOTHING = 1e-15
"""Leading coefficient that is negligible, and whose roots would overflow a float."""


class Intrinsics(Strict):
    """Picture size [px], focal lengths and principal point [px] of a camera.

    The camera frame is the optical one: x right, y down, z ahead. Pixel centres are integers: the picture covers u from −½
    to width − ½ and v from −½ to height − ½. `project` and `rays` have the same meaning for every lens.
    """

    width: PositiveInt = Field(le=LARGEST_SIDE_PX, description="width of the picture [px]")
    height: PositiveInt = Field(le=LARGEST_SIDE_PX, description="height of the picture [px]")
    fx: float = Field(gt=0, allow_inf_nan=False, description="focal length along a row [px]")
    fy: float = Field(gt=0, allow_inf_nan=False, description="focal length along a column [px]")
    cx: FiniteFloat = Field(description="column of the principal point, pixel centres are integers [px]")
    cy: FiniteFloat = Field(description="row of the principal point, pixel centres are integers [px]")

    @abstractmethod
    def project(self, points: Float[Array, "*n 3"]) -> tuple[Float[Array, "*n 2"], Bool[Mask, "*n"]]:
        """Return pixel coordinates of points [m] in the camera frame, and whether the picture shows each.

        It shows points in the lens's field and within the picture's edges. Pixels of other points follow the lens's formula,
        NaN where it has none: behind a pinhole.
        """

    @abstractmethod
    def rays(self, pixels: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
        """Back-project pixel coordinates to unit vectors in the camera frame: the inverse of `project`.

        NaN where the lens sends no light to a pixel.
        """

    @abstractmethod
    def check_view(self) -> None:
        """Raise InputError for an impossible lens: folded inside the picture, or without light in it."""

    @property
    def matrix(self) -> Float[Array, "3 3"]:
        """The camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def contains(self, pixels: Float[Array, "*n 2"]) -> Bool[Mask, "*n"]:
        """Return a mask of pixel coordinates within the picture's edges; False for NaN."""
        u, v = pixels[..., 0], pixels[..., 1]
        return np.asarray((u >= -0.5) & (u < self.width - 0.5) & (v >= -0.5) & (v < self.height - 0.5))

    def pixel_centres(self) -> Float[Array, "height width 2"]:
        """Return the coordinates of the pixels' centres."""
        u, v = np.meshgrid(np.arange(self.width, dtype=float), np.arange(self.height, dtype=float))
        return np.stack([u, v], axis=-1)

    def pixel_rays(self) -> Float[Array, "height width 3"]:
        """Back-project the pixels' centres to unit vectors in the camera frame; NaN without light."""
        return self.rays(self.pixel_centres())


def first_turn(growth: Polynomial) -> float:
    """Return where above 0 a polynomial first stops growing; inf: nowhere. Beyond it a lens folds its picture."""
    roots = growth.deriv().trim(_NOTHING).roots()
    turns = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
    return float(turns.min()) if turns.size else np.inf
