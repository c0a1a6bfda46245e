"""Calibrated cameras, from points to pixels and back: pinhole (Brown–Conrady distortion) and fisheye (Kannala–Brandt)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat

from trackers.arrays import Array, ArrayOrNumber, Bool, Float, Mask
from trackers.configuration import Strict
from trackers.errors import InputError, text_near_bound

LARGEST_SIDE_PX = 8192
"""Greatest width and height of a picture."""
Side = Annotated[int, Field(gt=0, le=LARGEST_SIDE_PX)]
"""Width or height of a picture [px]."""
_NOTHING = 1e-15
"""Leading coefficient that is negligible, and whose roots would overflow a float."""


class Intrinsics(Strict):
    """Picture size [px], focal lengths and principal point [px] of a camera.

    The camera frame is the optical one: x right, y down, z ahead. Pixel centres are integers: the picture covers u from −½
    to width − ½ and v from −½ to height − ½. `project` and `rays` have the same meaning for every lens.
    """

    width: Side = Field(description="width of the picture [px]")
    height: Side = Field(description="height of the picture [px]")
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
            reach_deg, most_deg = (float(np.rad2deg(np.arctan(each))) for each in (reach.max(), MAX_TANGENT))
            raise InputError(
                f"the picture reaches {text_near_bound(reach_deg, most_deg, '.1f')}° from the camera's axis; "
                f"at most {most_deg:g}° is valid, a fisheye sees farther"
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
        pixels = _pairs(self.fx * bent_x + self.cx, self.fy * bent_y + self.cy)
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


def _pairs(u: Array | float, v: Array | float) -> Float[Array, "*n 2"]:
    """Return two coordinates in the last axis, faster than `np.stack`."""
    pairs = np.empty((*np.shape(u), 2))
    pairs[..., 0], pairs[..., 1] = u, v
    return pairs


def _kept_within(x: ArrayOrNumber, y: ArrayOrNumber, radius: float) -> tuple[ArrayOrNumber, ArrayOrNumber]:
    """Pull places beyond this radius back onto it: behind the fold Newton's method would find another root."""
    scale = np.minimum(1.0, radius / np.maximum(np.hypot(x, y), 1e-300))
    return x * scale, y * scale


_GRID = 4096
_ANGLE_STEPS = 3


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
            fold_deg, view_deg = (float(np.rad2deg(each)) for each in (self.fold_angle_rad, self.field_of_view_rad))
            raise InputError(
                f"lens: with k = {list(self.k)} the picture folds back {fold_deg:.1f}° from the axis; "
                f"a field of view below {2 * fold_deg:g}° is valid, not {text_near_bound(view_deg, 2 * fold_deg, '.6g')}°"
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
        radius = theta
        if any(self.k):
            square = theta * theta
            k1, k2, k3, k4 = self.k
            radius = theta * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        scale = np.divide(radius, rho, out=np.zeros_like(radius), where=rho > 0)
        pixels = _pairs(self.fx * scale * x + self.cx, self.fy * scale * y + self.cy)
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
        for _ in range(_ANGLE_STEPS):  # Newton's method, from a start within 4e-4 rad
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
