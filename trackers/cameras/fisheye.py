"""Fisheye camera (Kannala–Brandt): from points to pixels and back."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial import Polynomial
from pydantic import AfterValidator, Field, FiniteFloat

from trackers.arrays import Array, ArrayOrNumber, Mask
from trackers.cameras.intrinsics import Intrinsics, first_turn
from trackers.errors import InputError

_GRID = 4096
_NEWTON_STEPS = 3


_TURN_RAD = 2 * np.pi
_ROUNDED_RAD = 1e-3
"""Rounding of a full turn as people write it, 6.283 or 6.2832."""


def _at_most_a_turn(angle_rad: float) -> float:
    if abs(angle_rad - _TURN_RAD) <= _ROUNDED_RAD:
        return _TURN_RAD
    if angle_rad > _TURN_RAD:
        raise ValueError("more than a full turn; an angle in radians up to 6.2832 is valid")
    return angle_rad


class FisheyeIntrinsics(Intrinsics):
    """Kannala–Brandt fisheye: r(θ) = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), u = fx r cos φ + cx, v = fy r sin φ + cy.

    θ is the angle from the optical axis; with all k = 0 the lens is equidistant. `field_of_view_rad` is the full angle of
    the lens's image, outside of which pixels are black. This is OpenCV's `fisheye` and ROS's `equidistant` model.
    """

    k: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = Field(
        default=(0.0, 0.0, 0.0, 0.0), description="coefficients k1 to k4 of θ³, θ⁵, θ⁷, θ⁹; all 0: equidistant"
    )
    field_of_view_rad: Annotated[float, AfterValidator(_at_most_a_turn)] = Field(
        gt=0, allow_inf_nan=False, description="full angle over which the lens forms an image, at most a turn [rad]"
    )

    @property
    def radius_of_angle(self) -> Polynomial:
        """r(θ), the distance from the principal point as a fraction of the focal length, θ in radians."""
        k1, k2, k3, k4 = self.k
        return Polynomial([0, 1, 0, k1, 0, k2, 0, k3, 0, k4])

    @property
    def fold_angle_rad(self) -> float:
        """Angle from the axis at which r(θ) stops growing [rad]; inf: never."""
        return first_turn(self.radius_of_angle)

    def check_view(self) -> None:
        """Raise InputError where r(θ) stops growing inside the field of view, or no light falls on the picture."""
        if self.fold_angle_rad <= self.field_of_view_rad / 2:
            fold_deg = float(np.rad2deg(self.fold_angle_rad))
            raise InputError(
                f"lens: with k = {list(self.k)} the picture folds back {fold_deg:.1f}° from the axis; "
                f"a field of view below {2 * fold_deg:.1f}° is valid, not {float(np.rad2deg(self.field_of_view_rad)):g}°"
            )
        nearest = np.clip([self.cx, self.cy], -0.5, [self.width - 0.5, self.height - 0.5])
        if np.isnan(self.rays(nearest)).any():
            raise InputError(
                f"lens: no light falls on the {self.width} x {self.height} picture with the principal point "
                f"[{self.cx:g}, {self.cy:g}]; one in the picture or near it is valid"
            )

    def project(self, points: Float[Array, "*n 3"]) -> tuple[Float[Array, "*n 2"], Bool[Mask, "*n"]]:
        """Return pixel coordinates of points [m] in the camera frame, and whether the picture shows each.

        It shows points in the field of view and within the picture's edges.
        """
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        rho = np.hypot(x, y)
        theta = np.arctan2(rho, z)
        square = theta * theta
        k1, k2, k3, k4 = self.k
        radius = theta * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        scale = np.divide(radius, rho, out=np.zeros_like(radius), where=rho > 0)
        pixels = np.stack([self.fx * scale * x + self.cx, self.fy * scale * y + self.cy], axis=-1)
        return pixels, np.asarray((theta <= self.field_of_view_rad / 2) & self.contains(pixels))

    def angle_of_radius(self, radius: Float[ArrayOrNumber, "*n"]) -> Float[Array, "*n"]:
        """Return the angle from the optical axis [rad] at which r(θ) takes each value; NaN outside the field of view.

        Needs a lens whose r(θ) grows over its whole field of view.
        """
        r_of_theta = self.radius_of_angle
        slope = r_of_theta.deriv()
        grid = np.linspace(0, self.field_of_view_rad / 2, _GRID)
        at_grid = r_of_theta(grid)
        inside = radius <= at_grid[-1]
        wanted = np.where(inside, radius, at_grid[-1])
        theta = np.interp(wanted, at_grid, grid)
        for _ in range(_NEWTON_STEPS):  # Newton's method, from a start within 4e-4 rad
            theta = theta - (r_of_theta(theta) - wanted) / slope(theta)
        return np.where(inside, theta, np.nan)

    def rays(self, pixels: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
        """Back-project pixel coordinates to unit vectors in the camera frame; NaN outside the field of view."""
        x, y = (pixels[..., 0] - self.cx) / self.fx, (pixels[..., 1] - self.cy) / self.fy
        radius = np.hypot(x, y)
        theta = self.angle_of_radius(radius)
        across = np.ones_like(radius)
        np.divide(np.sin(theta), radius, out=across, where=radius > 0)
        return np.stack([across * x, across * y, np.cos(theta)], axis=-1)
