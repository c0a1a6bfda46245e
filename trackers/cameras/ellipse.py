"""Ellipsoids, such as heads and bodies, as ellipses in a camera's picture.

A pinhole without distortion sees an ellipsoid as an exact ellipse: with centre m and shape S in the camera frame (its
surface is (x − m)ᵀ S⁻¹ (x − m) = 1) the dual of its outline's conic is C* = m mᵀ − S (Hartley and Zisserman, Multiple View
Geometry, 8.3, with the camera [I | 0]). The outline in a distorting lens is no ellipse; it is replaced by the ellipse with
the mean and second moments of eight projected points of the outline. That is good while the distortion varies little over
the ellipsoid: for a head 1 m away to 2 % of its longer semi-axis, farther off better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from trackers.arrays import Array
from trackers.cameras.intrinsics import Intrinsics
from trackers.cameras.pinhole import PinholeIntrinsics

_ON_OUTLINE = 8


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """Solid ellipsoids by their centres [m] and shapes [m²]: (x − centre)ᵀ shape⁻¹ (x − centre) = 1."""

    centre: Float[Array, "n 3"]
    shape: Float[Array, "n 3 3"]

    @classmethod
    def upright(cls, centre_m: ArrayLike, semi_axes_m: ArrayLike, yaw_rad: ArrayLike = 0.0) -> Ellipsoids:
        """Return ellipsoids at centres (n, 3) of semi-axes (3,) or (n, 3): ahead, to the left, up; turned by yaw (n,).

        Yaw is about the vertical, counter-clockwise from the room's x axis.
        """
        centre = np.asarray(centre_m, dtype=float)
        ahead, across, up = np.moveaxis(np.broadcast_to(np.square(np.asarray(semi_axes_m, float)), centre.shape), -1, 0)
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        shape = np.zeros((*centre.shape, 3))
        shape[:, 0, 0] = ahead * cosine**2 + across * sine**2
        shape[:, 1, 1] = ahead * sine**2 + across * cosine**2
        shape[:, 0, 1] = shape[:, 1, 0] = (ahead - across) * cosine * sine
        shape[:, 2, 2] = up
        return cls(centre, shape)

    def seen_from(self, eye_m: Float[Array, "3"], room_from_camera: Float[Array, "3 3"]) -> Ellipsoids:
        """Express the solids in the frame of a camera with this position [m] and rotation."""
        centre = (self.centre - eye_m) @ room_from_camera
        return Ellipsoids(centre, room_from_camera.T @ self.shape @ room_from_camera)


@dataclass(frozen=True, eq=False)
class Ellipses:
    """Ellipses by their centres [px] and shapes [px²]: (q − centre)ᵀ shape⁻¹ (q − centre) = 1.

    NaN where the camera sees no ellipse: inside the ellipsoid, too near, or partly behind.
    """

    centre: Float[Array, "n 2"]
    shape: Float[Array, "n 2 2"]

    def __len__(self) -> int:
        """Return the number of ellipses."""
        return len(self.centre)

    def points(self, of_unit_disc: Float[Array, "m 2"]) -> Float[Array, "n m 2"]:
        """Map points of the unit disc into each ellipse [px]; its rim onto the outline.

        The disc's y axis runs down the picture. The map keeps the order of points and their even spread.
        """
        (xx, xy), (_, yy) = np.moveaxis(self.shape, 0, -1)
        across = np.sqrt(xx)  # Cholesky, written out: a batch of 2 × 2
        slant = xy / across
        down = np.sqrt(yy - slant**2)
        x, y = of_unit_disc.T
        u = self.centre[:, :1] + across[:, None] * x
        v = self.centre[:, 1:] + slant[:, None] * x + down[:, None] * y
        return np.stack([u, v], axis=-1)

    def outline(self, count: int = 32) -> Float[Array, "n {count} 2"]:
        """Return points around each ellipse [px]."""
        return self.points(_circle(count))


def outline_ellipses(intrinsics: Intrinsics, solids: Ellipsoids) -> Ellipses:
    """Project ellipsoids in a camera's own frame, one ellipse each (accuracy: see the module)."""
    if not isinstance(intrinsics, PinholeIntrinsics):
        towards = _looking_at(solids.centre)  # a fisheye's view does not lie before one plane
        turned = Ellipsoids(
            np.einsum("nij,nj->ni", towards, solids.centre), towards @ solids.shape @ np.swapaxes(towards, 1, 2)
        )
        return _fitted(intrinsics, _on_plane(turned), towards)
    ideal = _on_plane(solids)
    if intrinsics.is_distorted:
        return _fitted(intrinsics, ideal, None)
    focal = np.array([intrinsics.fx, intrinsics.fy])
    centre = ideal.centre * focal + (intrinsics.cx, intrinsics.cy)
    return Ellipses(centre, ideal.shape * np.outer(focal, focal))


def _on_plane(solids: Ellipsoids) -> Ellipses:
    """Project outlines to the plane z = 1; NaN where a solid is not wholly in front of the plane z = 0."""
    m, S = solids.centre, solids.shape
    scale = m[:, 2] ** 2 - S[:, 2, 2]
    scale = np.where((m[:, 2] > 0) & (scale > 0), scale, np.nan)[:, None]
    centre = (m[:, :2] * m[:, 2:] - S[:, :2, 2]) / scale
    dual = (m[:, :2, None] * m[:, None, :2] - S[:, :2, :2]) / scale[..., None]
    return Ellipses(centre, centre[:, :, None] * centre[:, None, :] - dual)


def _fitted(intrinsics: Intrinsics, ideal: Ellipses, towards: Float[Array, "n 3 3"] | None) -> Ellipses:
    """Return ellipses with the mean and second moments of projected points; of the plane z = 1, turned `towards`."""
    on_plane = ideal.outline(_ON_OUTLINE)
    directions = np.concatenate([on_plane, np.ones((*on_plane.shape[:2], 1))], axis=-1)
    if towards is not None:
        directions = directions @ towards
    pixels, _ = intrinsics.project(directions)
    centre = pixels.mean(axis=1)
    off = pixels - centre[:, None]
    return Ellipses(centre, 2 / _ON_OUTLINE * np.swapaxes(off, 1, 2) @ off)


def _looking_at(places: Float[Array, "n 3"]) -> Float[Array, "n 3 3"]:
    """Return rotations to frames whose z axis points at each place."""
    ahead = places / np.linalg.norm(places, axis=1, keepdims=True)
    # perpendicular to the axis that is farther off
    off_axis = np.where(np.abs(ahead[:, 1:2]) < 0.7, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    right = np.cross(off_axis, ahead)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], axis=1)


def _circle(count: int) -> Float[Array, "{count} 2"]:
    """Return points around the unit circle."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
