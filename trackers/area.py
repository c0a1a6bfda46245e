"""Rigid transforms, and the tracked area: a polygon on the floor, its validity, and tests of points.

shapely, equally fast, is not used: points on the border must be judged to the bit as in existing recordings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field

from trackers.arrays import Array, Mask
from trackers.configuration import Strict

Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
"""Length along an axis [m], or angle: within the range in which floats resolve a micrometre."""

Point3 = tuple[Coordinate, Coordinate, Coordinate]


_MOST_ANGLE_RAD = 2 * np.pi + 1e-6
"""One turn: a larger angle is one in degrees."""


def _in_radians(angle_rad: float) -> float:
    if abs(angle_rad) > _MOST_ANGLE_RAD:
        raise ValueError(
            f"{angle_rad:g} rad is more than one turn; in degrees it would be {np.radians(angle_rad):.4g} rad"
        )
    return angle_rad


def wrap_angle(angle_rad: Any) -> Any:
    """Return angles [rad], a number or an array, within half a turn: in [−π, π)."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


AngleRad = Annotated[Coordinate, AfterValidator(_in_radians)]
AngleDeg = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
"""Angle of a mount [deg], at most a turn: the sum of two is a pose's."""


@lru_cache(maxsize=256)
def _rotation(rpy: Point3) -> NDArray[np.float64]:
    """Return the rotation matrix; cached for the few sensors."""
    quaternion = (0.0, 0.0, 0.0, 1.0)
    for axis, angle_rad in enumerate(rpy):
        turn = [0.0, 0.0, 0.0, math.cos(angle_rad / 2)]
        turn[axis] = math.sin(angle_rad / 2)
        quaternion = _product(turn, quaternion)
    return _matrix(*quaternion)


def _product(one: Sequence[float], other: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the product of two quaternions x, y, z, w: the rotation `other`, then `one`."""
    (x, y, z, w), (of_x, of_y, of_z, of_w) = one, other
    return (
        w * of_x + of_w * x + (y * of_z - z * of_y),
        w * of_y + of_w * y + (z * of_x - x * of_z),
        w * of_z + of_w * z + (x * of_y - y * of_x),
        w * of_w - x * of_x - y * of_y - z * of_z,
    )


def _matrix(x: float, y: float, z: float, w: float) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a unit quaternion."""
    x2, y2, z2, w2 = x * x, y * y, z * z, w * w
    return np.array(
        [
            [x2 - y2 - z2 + w2, 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), -x2 + y2 - z2 + w2, 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), -x2 - y2 + z2 + w2],
        ]
    )


def rotation_of(quaternion: Sequence[float]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a quaternion x, y, z, w of any length above 0.

    This and `quaternion_of` have the bits of SciPy's Rotation, without its import, which takes longer than NumPy's.
    """
    x, y, z, w = quaternion
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return _matrix(x / length, y / length, z / length, w / length)


def quaternion_of(rotation: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return the unit quaternion x, y, z, w of a rotation matrix (3, 3), after Shepperd; an inexact one is made orthogonal."""
    if not np.allclose(rotation @ rotation.T, np.eye(3), rtol=0.0, atol=1e-12):
        from scipy.spatial.transform import Rotation  # takes a while to load

        rotation = Rotation.from_matrix(rotation).as_matrix()
    matrix = rotation.tolist()
    diagonal = [matrix[0][0], matrix[1][1], matrix[2][2]]
    diagonal.append(diagonal[0] + diagonal[1] + diagonal[2])
    i = max(range(4), key=diagonal.__getitem__)
    j, k = (i + 1) % 3, (i + 2) % 3
    quaternion = [0.0, 0.0, 0.0, 1.0 + diagonal[3]]
    if i == 3:
        quaternion[:3] = (matrix[2][1] - matrix[1][2], matrix[0][2] - matrix[2][0], matrix[1][0] - matrix[0][1])
    else:
        quaternion[i] = 1.0 - diagonal[3] + 2.0 * matrix[i][i]
        quaternion[j], quaternion[k] = matrix[j][i] + matrix[i][j], matrix[k][i] + matrix[i][k]
        quaternion[3] = matrix[k][j] - matrix[j][k]
    x, y, z, w = quaternion
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def displacement(poses: NDArray[np.float64]) -> tuple[float, float]:
    """Return the largest translation [m] and rotation [deg] of poses (n, 4, 4) from the first one."""
    away_m = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1)
    turns_rad = rotation_angles(poses[0, :3, :3].T @ poses[:, :3, :3])
    return float(away_m.max()), math.degrees(float(turns_rad.max()))


def rotation_angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles (n,) of rotation matrices (n, 3, 3) [rad]."""
    from scipy.spatial.transform import Rotation  # takes a while to load

    return Rotation.from_matrix(rotations).magnitude()


class Pose(Strict):
    """A rigid transform: `xyz` [m], then `rpy` roll, pitch, yaw [rad] about the fixed x, y, z axes (as in URDF)."""

    xyz: Point3 = Field(
        default=(0.0, 0.0, 0.0), description="origin of the sensor's frame in the room frame: x, y, z [m]"
    )
    rpy: tuple[AngleRad, AngleRad, AngleRad] = Field(
        default=(0.0, 0.0, 0.0), description="roll, pitch, yaw about the room's fixed x, y, z, in this order [rad]"
    )

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation matrix, (3, 3)."""
        return _rotation(self.rpy).copy()

    @property
    def translation(self) -> NDArray[np.float64]:
        """Translation [m], (3,)."""
        return np.array(self.xyz)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Homogeneous transform from the frame to its surroundings, (4, 4)."""
        whole = np.eye(4)
        whole[:3, :3], whole[:3, 3] = _rotation(self.rpy), self.xyz
        return whole

    @classmethod
    def from_transform(cls, matrix: NDArray[np.float64]) -> Pose:
        """Make the pose of a homogeneous transform (4, 4)."""
        x, y, z = matrix[:3, 3].tolist()
        return cls.from_matrix(matrix[:3, :3], (x, y, z))

    @classmethod
    def from_matrix(cls, rotation: NDArray[np.float64], xyz: Point3) -> Pose:
        """Make the pose with this rotation matrix (3, 3) and origin [m]."""
        from scipy.spatial.transform import Rotation  # takes a while to load

        roll, pitch, yaw = Rotation.from_matrix(rotation).as_euler("xyz")
        return cls(xyz=xyz, rpy=(float(roll), float(pitch), float(yaw)))


_TOLERANCE_M = 1e-9
TOLERANCE_M = 1e-6
"""Distance from a border within which a point lies on it [m], as users' numbers are rounded."""


class Area:
    """A polygon with corners (c, 2) [m], in either sense of rotation, widened by `margin_m` all around."""

    def __init__(self, corners: ArrayLike, margin_m: float = 0.0) -> None:
        self._start = np.asarray(corners, float).T  # (2, c)
        end = np.roll(self._start, -1, axis=1)
        self._edge = end - self._start
        self._end_y = end[1]
        self._slope = self._edge[0] / np.where(self._edge[1] == 0, 1.0, self._edge[1])
        self._length_square = np.maximum((self._edge**2).sum(axis=0), 1e-18)
        self._margin_m = margin_m
        turned = np.array([-self._edge[1], self._edge[0]]) / np.sqrt(self._length_square)
        to_the_middle = self._start.mean(axis=1)[:, None] - self._start
        rotation = np.sign((turned * to_the_middle).sum())  # 0: no inside
        self._inward = rotation * turned.T  # (c, 2), unit vectors
        self._border = (self._inward * self._start.T).sum(axis=1)[:, None]
        self._convex = rotation != 0 and bool((self._inward @ self._start >= self._border - _TOLERANCE_M).all())

    @property
    def corners(self) -> Array:
        """The corners (c, 2) [m]."""
        return self._start.T

    @property
    def size_m2(self) -> float:
        """Size of the polygon without its margin [m²]."""
        (x, y), (along_x, along_y) = self._start, self._edge
        return abs(float((x * along_y - y * along_x).sum())) / 2

    def contains(self, points: Array) -> Mask:
        """Return a mask (n,) of points (n, 2) in the polygon or within the margin of its border."""
        if not self._convex:
            return self._exactly(points)
        # distance inside the nearest side's line: sufficient except in the margin and on the border
        depth_m = np.minimum.reduce(self._inward @ points.T - self._border, axis=0)
        inside = depth_m > _TOLERANCE_M
        if np.count_nonzero(inside) == inside.size:  # the usual case
            return inside
        unsure = ~inside & (depth_m >= -self._margin_m - _TOLERANCE_M)
        if np.count_nonzero(unsure):
            inside[unsure] = self._exactly(points[unsure])
        return inside

    def _exactly(self, points: Array) -> Mask:
        x, y = points[:, :1], points[:, 1:]
        off_x, off_y = x - self._start[0], y - self._start[1]  # (n, c)
        # a ray towards +x crosses an odd number of edges from inside
        straddles = (self._start[1] > y) != (self._end_y > y)
        crossed = straddles & (off_x < off_y * self._slope)
        along = (off_x * self._edge[0] + off_y * self._edge[1]) / self._length_square
        along = np.minimum(np.maximum(along, 0), 1)
        gap_square = (off_x - along * self._edge[0]) ** 2 + (off_y - along * self._edge[1]) ** 2
        return np.logical_xor.reduce(crossed, axis=1) | (gap_square <= self._margin_m**2).any(axis=1)


def meets_itself_at(corners: Array) -> Array | None:
    """Return a place (2,) [m] where the polygon (k, 2) [m] crosses or touches itself; None where its edges meet at corners
    only.

    Repeated corners, edges that fold back and collinear corners count as touching.
    """
    count = len(corners)
    edge = np.roll(corners, -1, axis=0) - corners
    own = np.eye(count, dtype=bool)
    own |= np.roll(own, 1, axis=1)  # own[i, j]: corner j is an end of edge i
    touching = (edge_gaps(corners, corners) < TOLERANCE_M) & ~own
    if touching.any():
        return corners[np.argwhere(touching)[0, 1]]
    side = np.sign(cross(edge[:, None], corners - corners[:, None]))  # [i, j]: of corner j beside edge i
    parted = side * np.roll(side, -1, axis=1) < 0  # the ends of edge j lie on either side of the line of edge i
    crossing = np.argwhere(parted & parted.T)
    if not len(crossing):
        return None
    one, other = crossing[0]
    share = cross(corners[other] - corners[one], edge[other]) / cross(edge[one], edge[other])
    return corners[one] + share * edge[one]


def edge_gaps(corners: Array, places: Array) -> Array:
    """Return the distances (k, n) [m] from each edge of the polygon (k, 2) to places (n, 2)."""
    edge = np.roll(corners, -1, axis=0) - corners
    offset = places - corners[:, None]
    along = np.einsum("knc,kc->kn", offset, edge) / np.maximum((edge**2).sum(axis=1), TOLERANCE_M**2)[:, None]
    return np.linalg.norm(offset - np.clip(along, 0.0, 1.0)[..., None] * edge[:, None], axis=-1)


def cross(first: Array, second: Array) -> Array:
    """Return the z components of the cross products of vectors (..., 2) on the floor."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def check_polygon(corners: Array) -> None:
    """Raise ValueError where the polygon (k, 2) [m] crosses or touches itself."""
    place = meets_itself_at(corners)
    if place is not None:
        raise ValueError(
            f"{corners.tolist()} crosses or touches itself at [{place[0]:.4g}, {place[1]:.4g}]; "
            "corners in their order around the area, each once, are expected"
        )


def _simple(corners: tuple[Point2, ...]) -> tuple[Point2, ...]:
    if len(corners) < 3:
        raise ValueError(f"has {len(corners)} corners; a polygon needs at least 3")
    check_polygon(np.array(corners))
    return corners


Point2 = tuple[Coordinate, Coordinate]
Polygon = Annotated[tuple[Point2, ...], Field(max_length=500), AfterValidator(_simple)]
"""Corners of a simple polygon in the room frame [m], as in configuration."""
