"""Camera at its pose: from the room to its pictures and back; and ellipsoids, such as heads, as ellipses in them.

A pinhole without distortion sees an ellipsoid as an exact ellipse: with centre m and shape S in the camera frame (its
surface is (x − m)ᵀ S⁻¹ (x − m) = 1) the dual of its outline's conic is C* = m mᵀ − S (Hartley and Zisserman, Multiple View
Geometry, 8.3, with the camera [I | 0]). The outline in a distorting lens is no ellipse; it is replaced by the ellipse with
the mean and second moments of eight projected points of the outline. That is good while the distortion varies little over
the ellipsoid: for a head 1 m away to 2 % of its longer semi-axis, farther off better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from trackers.area import Pose
from trackers.arrays import Array, Bool, Float, Floats, Mask
from trackers.cameras.intrinsics import Intrinsics, PinholeIntrinsics

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


_ROUND_A_PERSON = 8


class PlacedCamera:
    """Pinhole or fisheye camera and its pose in the room: `room_from_camera` takes its optical frame to the room's.

    Positions and directions are in the room frame [m]. Rays of the pixels are computed on first use and kept.
    """

    def __init__(self, intrinsics: Intrinsics, room_from_camera: Pose) -> None:
        self.intrinsics = intrinsics
        self.rotation: Float[Array, "3 3"] = room_from_camera.rotation
        self.eye_m: Float[Array, "3"] = room_from_camera.translation

    def project(self, points_m: Float[Array, "*n 3"]) -> tuple[Float[Array, "*n 2"], Bool[Mask, "*n"]]:
        """Return pixel coordinates of points [m], and whether the picture shows each, ignoring occlusion.

        See `Intrinsics.project`.
        """
        return self.intrinsics.project((points_m - self.eye_m) @ self.rotation)

    def rays(self, pixels: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
        """Back-project pixel coordinates to unit vectors in the room frame; NaN without light."""
        return self.intrinsics.rays(pixels) @ self.rotation.T

    @cached_property
    def pixel_rays(self) -> Float[Array, "height width 3"]:
        """Unit vectors from the eye through the pixels' centres; NaN without light."""
        return _kept(self.intrinsics.pixel_rays() @ self.rotation.T)

    def points(self, depth_m: Float[Floats, "height width"]) -> Float[Array, "height width 3"]:
        """Back-project a depth picture to one point [m] per pixel; NaN for depth 0.

        Depth is along the optical axis. Raises TypeError for a camera that is no pinhole, ValueError for a picture of
        another size.
        """
        size = (self.intrinsics.height, self.intrinsics.width)
        if depth_m.shape != size:
            raise ValueError(f"the depth picture has shape {depth_m.shape}; the camera's intrinsics say {size}")
        depth = np.where(depth_m > 0, depth_m, np.nan)
        points = np.empty((*size, 3))
        for axis, rays in enumerate(self._depth_rays):
            np.multiply(rays, depth, out=points[..., axis])
            points[..., axis] += self.eye_m[axis]
        return points

    @cached_property
    def _depth_rays(self) -> Float[Array, "3 height width"]:
        """Points of the pixels at a depth of 1 m, from the eye: numpy is fastest along long rows."""
        if not isinstance(self.intrinsics, PinholeIntrinsics):
            raise TypeError(f"{type(self.intrinsics).__name__}: depth along an axis is for pinhole cameras")
        return _kept(np.moveaxis(self.intrinsics.directions() @ self.rotation.T, -1, 0))

    def ellipses(self, solids: Ellipsoids) -> tuple[Ellipses, Bool[Mask, "n"]]:
        """Project ellipsoids to ellipses; return also whether each centre lies in the picture."""
        ellipses = outline_ellipses(self.intrinsics, solids.seen_from(self.eye_m, self.rotation))
        return ellipses, self.project(solids.centre)[1] & self.intrinsics.contains(ellipses.centre)

    def person_boxes(
        self, places_m: ArrayLike, height_m: ArrayLike, width_m: float
    ) -> tuple[Float[Array, "n 4"], Bool[Mask, "n"]]:
        """Return boxes left, top, right, bottom [px] of upright persons, and whether the picture shows part of each.

        A person is a cylinder over the position (n, 2) [m], of this height, one for all or (n,), and width. Boxes extend
        beyond the picture's edges; they are NaN for a person not wholly ahead of a pinhole.
        """
        places = np.asarray(places_m, dtype=float)
        turn = 2 * np.pi * np.arange(_ROUND_A_PERSON) / _ROUND_A_PERSON
        rim = places[:, None] + width_m / 2 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        points = np.zeros((len(places), 2 * _ROUND_A_PERSON, 3))
        points[:, :_ROUND_A_PERSON, :2] = points[:, _ROUND_A_PERSON:, :2] = rim  # at the soles, at the crown
        points[:, _ROUND_A_PERSON:, 2] = np.reshape(height_m, (-1, 1))
        pixels, seen = self.project(points)
        return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=-1), np.logical_or.reduce(seen, axis=1)


class CameraGroup:
    """Several cameras, to which points are projected at once: undistorted ones by one matrix product."""

    def __init__(self, cameras: Sequence[PlacedCamera]) -> None:
        self.cameras = tuple(cameras)
        self.eyes_m: Float[Array, "c 3"] = np.array([each.eye_m for each in cameras]).reshape(-1, 3)
        self._matrix = np.zeros((len(cameras), 3, 4))  # from the room, homogeneous, to u z, v z, z
        self._bent = []
        for number, camera in enumerate(cameras):
            lens = camera.intrinsics
            if isinstance(lens, PinholeIntrinsics) and not lens.is_distorted:
                self._matrix[number] = lens.matrix @ np.column_stack(
                    [camera.rotation.T, -camera.rotation.T @ camera.eye_m]
                )
            else:
                self._bent.append(number)
        self._edge = (
            np.array([[each.intrinsics.width, each.intrinsics.height] for each in cameras]).reshape(-1, 2, 1) - 0.5
        )

    def project(self, points_m: Float[Floats, "*#c 3 k"]) -> tuple[Float[Array, "c 2 k"], Bool[Mask, "c k"]]:
        """Return pixels u, v of points [m], common or per camera, and whether the picture shows each.

        See `PlacedCamera.project`.
        """
        c, k = len(self.cameras), points_m.shape[-1]
        pixels, seen = np.empty((c, 2, k)), np.empty((c, k), np.bool_)
        if len(self._bent) < c:
            at = self._matrix[:, :, :3] @ points_m + self._matrix[:, :, 3:]
            with np.errstate(divide="ignore", invalid="ignore"):
                np.divide(at[:, :2], np.where(at[:, 2] > 0, at[:, 2], np.nan)[:, None], out=pixels)
            inside = (pixels >= -0.5) & (pixels < self._edge)
            np.logical_and(inside[:, 0], inside[:, 1], out=seen)
        for number in self._bent:
            own = points_m if points_m.ndim == 2 else points_m[number]
            found, seen[number] = self.cameras[number].project(own.T)
            pixels[number] = found.T
        return pixels, seen


def through_people(
    eyes_m: Float[Array, "*cameras 3"],
    points_m: Float[Array, "k 3"],
    people_m: Float[Array, "n 2"],
    radius_m: float | Float[Array, "k 1"],
    crown_m: float | Float[Array, "n"],
) -> tuple[Bool[Mask, "*cameras k n"], Float[Array, "*cameras k n"]]:
    """Return whether lines of sight from eyes through points meet people, upright cylinders from the floor to their crowns [m].

    And the share of the way to the point at which each passes the person's axis: below 1 the person is before the point.
    """
    way, off = points_m - eyes_m[..., None, :], people_m - eyes_m[..., None, :2]
    way_x, way_y, way_z = (way[..., axis, None] for axis in range(3))
    off_x, off_y = (off[..., None, :, axis] for axis in range(2))
    square = np.maximum(way_x**2 + way_y**2, 1e-9)
    along = (way_x * off_x + way_y * off_y) / square
    beside_m = np.abs(way_x * off_y - way_y * off_x) / np.sqrt(square)
    z = eyes_m[..., None, None, 2] + along * way_z
    return (along > 0) & (beside_m < radius_m) & (z > 0) & (z < crown_m), along


def _kept(array: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return a contiguous read-only copy."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
