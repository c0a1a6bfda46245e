"""Rigid transforms: position and orientation."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from trackers.configuration import Strict

Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
"""Length along an axis [m], or angle: within the range in which floats resolve a micrometre."""

Point3 = tuple[Coordinate, Coordinate, Coordinate]


@lru_cache(maxsize=256)
def _rotation(rpy: Point3) -> NDArray[np.float64]:
    """Return the rotation matrix; cached for the few sensors."""
    return Rotation.from_euler("xyz", rpy).as_matrix()


class Pose(Strict):
    """A rigid transform: `xyz` [m], then `rpy` roll, pitch, yaw [rad] about the fixed x, y, z axes (as in URDF)."""

    xyz: Point3 = Field(
        default=(0.0, 0.0, 0.0), description="origin of the sensor's frame in the room frame: x, y, z [m]"
    )
    rpy: Point3 = Field(
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
        roll, pitch, yaw = Rotation.from_matrix(rotation).as_euler("xyz")
        return cls(xyz=xyz, rpy=(float(roll), float(pitch), float(yaw)))
