"""A rigid transform: where something is and how it is turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat
from scipy.spatial.transform import Rotation

from trackers.configuration import Strict

Point3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


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
        return Rotation.from_euler("xyz", self.rpy).as_matrix()

    @property
    def translation(self) -> NDArray[np.float64]:
        """Translation [m], (3,)."""
        return np.array(self.xyz)

    @classmethod
    def from_matrix(cls, rotation: NDArray[np.float64], xyz: Point3) -> Pose:
        """The pose with this rotation matrix (3, 3) and origin [m]."""
        roll, pitch, yaw = Rotation.from_matrix(rotation).as_euler("xyz")
        return cls(xyz=xyz, rpy=(float(roll), float(pitch), float(yaw)))
