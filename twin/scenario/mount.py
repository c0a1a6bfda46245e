"""Mounts of sensors: true and assumed, in the room or on a housing that carries several; and noise models by name."""

from __future__ import annotations

from math import asin, atan2, cos, degrees, radians
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, FiniteFloat

from trackers.area import AngleDeg, Point3, Pose
from trackers.configuration import Strict
from trackers.errors import valid_names
from twin.sensors.schedule import Timing

_HOUSING_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""A camera's optical frame (x right, y down, z ahead) in that of its housing (x ahead, y left, z up)."""

_Displacement = Annotated[float, Field(ge=-1000, le=1000)]
"""Assumed displacement of a sensor along one axis [m]."""

_UPRIGHT = 1e-9
"""Cosine of the pitch below which yaw and roll turn about the same axis: all of it is taken as yaw."""


class Mount(Strict):
    """Pose of a sensor in the room: `xyz` [m] in the room frame; angles [deg] of its frame.

    Its frame is x ahead, y left, z up, for cameras too. Turned by yaw about z (90 looks along the room's y), then by
    pitch about the new y (positive looks down), then by roll about the new x. Of a sensor on a housing, all of this is
    in the housing's frame instead of the room's.
    """

    xyz: Point3 = Field(description="place in the room frame, or in that of the housing it hangs on: x, y, z [m]")
    yaw_deg: AngleDeg = Field(
        default=0.0, description="turn about z, first; counter-clockwise, 90 looks along the room's y [deg]"
    )
    pitch_deg: AngleDeg = Field(default=0.0, description="turn about the new y, second; positive looks down [deg]")
    roll_deg: AngleDeg = Field(
        default=0.0, description="turn about the new x, last; positive dips the right side [deg]"
    )

    def room_from_housing(self) -> Pose:
        """Return the pose of the frame x ahead, y left, z up."""
        return Pose(xyz=self.xyz, rpy=(radians(self.roll_deg), radians(self.pitch_deg), radians(self.yaw_deg)))

    def room_from_optical(self) -> Pose:
        """Return the pose of a camera's optical frame, x right, y down, z ahead."""
        rotation: NDArray[np.float64] = self.room_from_housing().rotation @ _HOUSING_FROM_OPTICAL
        return Pose.from_matrix(rotation, self.xyz)

    def carrying(self, inner: Mount) -> Mount:
        """Return the mount of an object that hangs in this one's frame at `inner`, in this one's surroundings."""
        outer, held = self.room_from_housing(), inner.room_from_housing()
        return mount_of(outer.rotation @ held.rotation, outer.translation + outer.rotation @ held.translation)


def mount_of(rotation: NDArray[np.float64], xyz: NDArray[np.float64]) -> Mount:
    """Return the mount with this rotation matrix (3, 3) and position (3,) [m]."""
    pitch = asin(min(1.0, max(-1.0, -rotation[2, 0])))
    if cos(pitch) > _UPRIGHT:
        yaw, roll = atan2(rotation[1, 0], rotation[0, 0]), atan2(rotation[2, 1], rotation[2, 2])
    else:
        yaw, roll = atan2(-rotation[0, 1], rotation[1, 1]), 0.0
    x, y, z = xyz.tolist()
    return Mount(xyz=(x, y, z), yaw_deg=degrees(yaw), pitch_deg=degrees(pitch), roll_deg=degrees(roll))


class CalibrationError(Strict):
    """Calibration error of a sensor: assumed minus true.

    `xyz` [m]: how far off it is assumed, along the room's axes; `rpy_deg` [deg]: turned by this about its own frame (x
    ahead, y left, z up; of a camera too): roll about x, pitch about y, yaw about z. `focal_scale`: the assumed focal length
    over the true one; `principal_px`: the assumed principal point off the true one, right and down [px]; both of cameras
    alone. `time_offset_s` is what the rig tells a tracker to add to the stamps [s].

    The twin senses from the true place with the true lens, and so is the truth; the rig that trackers get and that a bag
    carries holds what is assumed. The error of a pressure floor is level: no z, no roll, no pitch.
    """

    xyz: tuple[_Displacement, _Displacement, _Displacement] = Field(
        default=(0.0, 0.0, 0.0),
        description="how far off the sensor is assumed to be, assumed minus true, along the room's x, y, z [m]",
    )
    rpy_deg: tuple[AngleDeg, AngleDeg, AngleDeg] = Field(
        default=(0.0, 0.0, 0.0),
        description="how it is assumed to be turned: roll, pitch, yaw about its own x, y, z, assumed minus true [deg]",
    )
    focal_scale: float = Field(
        default=1.0, ge=0.1, le=10, description="assumed focal length over the true one, of cameras only"
    )
    principal_px: tuple[FiniteFloat, FiniteFloat] = Field(
        default=(0.0, 0.0),
        description="assumed principal point off the true one, right and down, of cameras only [px]",
    )
    time_offset_s: float = Field(
        default=0.0, ge=-3600, le=3600, description="what the rig adds to the sensor's stamps [s]"
    )

    @property
    def changes_lens(self) -> bool:
        """True if the assumed lens differs from the true one."""
        return self.focal_scale != 1 or self.principal_px != (0.0, 0.0)

    @property
    def changes_pose(self) -> bool:
        """True if the assumed pose differs from the true one."""
        return any(self.xyz) or any(self.rpy_deg)

    def mount(self, true: Mount) -> Mount:
        """Return the assumed mount of a sensor at this true mount in the room."""
        roll, pitch, yaw = self.rpy_deg
        turned = true.carrying(Mount(xyz=(0.0, 0.0, 0.0), yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll))
        x, y, z = (np.array(true.xyz) + np.array(self.xyz)).tolist()
        return turned.model_copy(update={"xyz": (x, y, z)})


class Mounted(Timing):
    """Sensor with a mount: in the room, or in the frame of a `housing`, given by name.

    `calibration_error`: assumed minus true calibration.
    """

    former_names: ClassVar = {"believed": "calibration_error"}

    mount: Mount = Field(description="where the sensor hangs and how it is turned")
    housing: str | None = Field(
        default=None, description="name of the housing that carries the sensor; none: it hangs in the room"
    )
    calibration_error: CalibrationError | None = Field(
        default=None, description="what the calibration says wrongly of the sensor; none: nothing"
    )


NoiseName = Literal["off", "default", "worse"]


def by_name(presets: dict[str, Any], otherwise: str, schema: Any) -> BeforeValidator:
    """Make a validator that replaces a preset's name by the preset; `schema`: type of the field in a JSON schema."""

    def resolve(value: Any) -> Any:
        if value is False:
            value = "off"  # YAML reads an unquoted off as false
        if not isinstance(value, str):
            return value
        if value not in presets:
            raise ValueError(f"no preset of this name; {valid_names(value, presets, f' or {otherwise}')}")
        return presets[value]

    return BeforeValidator(resolve, json_schema_input_type=schema)
