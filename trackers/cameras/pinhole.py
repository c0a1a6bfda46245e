"""Pinhole camera with Brown–Conrady distortion: from points to pixels and back."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial import Polynomial
from pydantic import BeforeValidator, Field, FiniteFloat

from trackers.arrays import Array, ArrayOrNumber, Mask
from trackers.cameras.intrinsics import Intrinsics, first_turn
from trackers.errors import InputError

MAX_TANGENT = 8.0
"""Greatest tangent of the angle from the axis in a pinhole's picture: 166° across."""
_NEWTON_STEPS = 30
_CONVERGED = 1e-9
"""Residual [tangent of the angle] of a converged direction."""


_LENGTHS = (0, 4, 5, 8, 12, 14)
"""Numbers of coefficients in OpenCV and ROS; those from the sixth on are of the rational, thin-prism and tilted models."""


def _plumb_bob(values: Any) -> Any:
    """Return coefficients of any of OpenCV's lengths as five; further zeros have no effect."""
    if not isinstance(values, Sequence) or isinstance(values, str):
        return values
    if len(values) not in _LENGTHS:
        raise ValueError(f"{len(values)} coefficients; k1, k2, p1, p2, k3 (0, 4 or 5 values) are valid")
    if any(value != 0 for value in values[5:]):
        raise ValueError(
            f"{list(values)} are {len(values)} coefficients of the model rational_polynomial, which is not supported; "
            "plumb_bob (k1, k2, p1, p2, k3, any further ones 0) is valid"
        )
    return [*values, *[0.0] * 5][:5]


class PinholeIntrinsics(Intrinsics):
    """Pinhole camera: u = fx x″ + cx, v = fy y″ + cy, of the direction (x, y, 1) distorted to (x″, y″).

    With r² = x² + y² and d = 1 + k1 r² + k2 r⁴ + k3 r⁶: x″ = x d + 2 p1 x y + p2 (r² + 2 x²), y″ = y d + p1 (r² + 2 y²) + 2
    p2 x y (Brown 1966, Conrady 1919). `distortion` is (k1, k2, p1, p2, k3), the order of OpenCV and of ROS's `plumb_bob`.
    """

    distortion: Annotated[
        tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat],
        BeforeValidator(_plumb_bob, json_schema_input_type=list[FiniteFloat]),
    ] = Field(
        default=(0.0, 0.0, 0.0, 0.0, 0.0), description="Brown–Conrady coefficients k1, k2, p1, p2, k3; all 0: none"
    )

    @property
    def is_distorted(self) -> bool:
        """True for a lens with distortion."""
        return any(self.distortion)

    @property
    def fold_radius(self) -> float:
        """Tangent of the angle from the axis at which the radial polynomial stops growing; inf: never."""
        return _fold_radius(self.distortion)

    def check_view(self) -> None:
        """Raise InputError where the lens folds inside the picture, or the picture reaches too far from the axis."""
        reach = np.abs(self.edge_tangents())
        if reach.max() > MAX_TANGENT:
            raise InputError(
                f"the picture reaches {np.rad2deg(np.arctan(reach.max())):.1f}° from the camera's axis; "
                f"at most {np.rad2deg(np.arctan(MAX_TANGENT)):.1f}° is valid, a fisheye sees farther"
            )

    def edge_tangents(self) -> Float[Array, "260 2"]:
        """Return the tangents x/z, y/z at the picture's edge; raises InputError where the lens folds inside."""
        columns, rows = np.linspace(-0.5, self.width - 0.5, 65), np.linspace(-0.5, self.height - 0.5, 65)
        edge = np.concatenate(
            [
                *(np.stack([columns, np.full(65, row)], axis=-1) for row in rows[[0, -1]]),
                *(np.stack([np.full(65, column), rows], axis=-1) for column in columns[[0, -1]]),
            ]
        )
        tangents = self.unproject(edge)[:, :2]
        if np.isnan(tangents).any():
            raise InputError(
                f"distortion {list(self.distortion)} (k1, k2, p1, p2, k3) folds back inside the "
                f"{self.width} x {self.height} picture, so that its edge sees nothing; one that grows up to the edge is valid"
            )
        return tangents

    def project(self, points: Float[Array, "*n 3"]) -> tuple[Float[Array, "*n 2"], Bool[Mask, "*n"]]:
        """Return pixel coordinates of points [m] in the camera frame, and whether the picture shows each.

        It shows points ahead, before the lens folds, within the picture's edges. Pixels of points not ahead are NaN.
        """
        z = points[..., 2]
        ahead = z > 0
        depth = np.where(ahead, z, np.nan)
        x, y = points[..., 0] / depth, points[..., 1] / depth
        bent_x, bent_y = self._bend(x, y) if self.is_distorted else (x, y)
        pixels = np.stack([self.fx * bent_x + self.cx, self.fy * bent_y + self.cy], axis=-1)
        seen = ahead & self.contains(pixels)
        if self.is_distorted:
            seen &= np.hypot(x, y) < self.fold_radius
        return pixels, np.asarray(seen)

    def unproject(self, pixels: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
        """Return directions with z = 1 of pixel coordinates, in the camera frame; times z: points.

        NaN where the lens sends no light.
        """
        bent_x = (pixels[..., 0] - self.cx) / self.fx
        bent_y = (pixels[..., 1] - self.cy) / self.fy
        x, y = self._straighten(bent_x, bent_y) if self.is_distorted else (bent_x, bent_y)
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def rays(self, pixels: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
        """Back-project pixel coordinates to unit vectors in the camera frame; NaN without light."""
        directions = self.unproject(pixels)
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def directions(self) -> Float[Array, "height width 3"]:
        """Return the directions of the pixels' centres, scaled to z = 1."""
        return self.unproject(self.pixel_centres())

    def _bend(
        self, x: Float[ArrayOrNumber, "*n"], y: Float[ArrayOrNumber, "*n"]
    ) -> tuple[Float[ArrayOrNumber, "*n"], Float[ArrayOrNumber, "*n"]]:
        k1, k2, p1, p2, k3 = self.distortion
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        cross = x * y
        return (
            x * radial + 2 * p1 * cross + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * cross,
        )

    def _straighten(self, bent_x: ArrayOrNumber, bent_y: ArrayOrNumber) -> tuple[Array, Array]:
        """Invert the distortion by Newton's method from the optical axis; NaN where it does not converge."""
        k1, k2, p1, p2, k3 = self.distortion
        fold = self.fold_radius
        x, y = _kept_within(bent_x, bent_y, 0.9 * fold)
        for _ in range(_NEWTON_STEPS):
            at_x, at_y = self._bend(x, y)
            miss_x, miss_y = bent_x - at_x, bent_y - at_y
            square = x * x + y * y
            radial = 1 + square * (k1 + square * (k2 + square * k3))
            slope = 2 * (k1 + square * (2 * k2 + square * 3 * k3))
            xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
            yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
            xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
            determinant = xx * yy - xy * xy
            determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
            x = x + (yy * miss_x - xy * miss_y) / determinant
            y = y + (xx * miss_y - xy * miss_x) / determinant
            x, y = _kept_within(x, y, fold)
        at_x, at_y = self._bend(x, y)
        found = np.hypot(bent_x - at_x, bent_y - at_y) < _CONVERGED
        return np.where(found, x, np.nan), np.where(found, y, np.nan)


@lru_cache(maxsize=64)
def _fold_radius(distortion: tuple[float, float, float, float, float]) -> float:
    """Return where the radial polynomial stops growing; cached, since every projection needs it."""
    k1, k2, _, _, k3 = distortion
    return first_turn(Polynomial([0, 1, 0, k1, 0, k2, 0, k3]))


def _kept_within(x: ArrayOrNumber, y: ArrayOrNumber, radius: float) -> tuple[ArrayOrNumber, ArrayOrNumber]:
    """Pull places beyond this radius back onto it: behind the fold Newton's method would find another root."""
    scale = np.minimum(1.0, radius / np.maximum(np.hypot(x, y), 1e-300))
    return x * scale, y * scale
