"""Camera at its pose: from the room to its pictures and back, as trackers use it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from trackers.arrays import Array, Floats, Mask
from trackers.cameras.ellipse import Ellipses, Ellipsoids, outline_ellipses
from trackers.cameras.intrinsics import Intrinsics
from trackers.cameras.pinhole import PinholeIntrinsics
from trackers.pose import Pose

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
        at = self._matrix[:, :, :3] @ points_m + self._matrix[:, :, 3:]
        ahead = at[:, 2] > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = at[:, :2] / np.where(ahead, at[:, 2], np.nan)[:, None]
        inside = (pixels >= -0.5) & (pixels < self._edge)
        seen = inside[:, 0] & inside[:, 1]
        for number in self._bent:
            own = points_m if points_m.ndim == 2 else points_m[number]
            found, seen[number] = self.cameras[number].project(own.T)
            pixels[number] = found.T
        return pixels, seen


def _kept(array: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return a contiguous read-only copy."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
