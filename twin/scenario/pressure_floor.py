"""Pressure floor in a scenario: position and pitch of its grid, and its accuracy."""

from __future__ import annotations

from math import radians
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, PositiveInt, model_validator

from trackers.area import Coordinate, Point3, Pose
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.force_curve import ForceCurve
from trackers.rig import FloorSensor
from trackers.rig_sensors import Pitch, check_cells
from twin.geometry.polygon import leaves_at
from twin.scenario.mount import CalibrationError, NoiseName, by_name
from twin.sensors.floor import FLOOR_ELECTRONICS, FloorElectronics
from twin.sensors.schedule import Timing

_FloorElectronics = Annotated[
    FloorElectronics,
    BeforeValidator(
        by_name(FLOOR_ELECTRONICS, "parameters like {crosstalk: 0.1}"),
        json_schema_input_type=NoiseName | FloorElectronics,
    ),
]


class FloorMount(Strict):
    """Position of a floor's grid: `xyz` [m] of the outer corner of element (0, 0) in the room frame, on the floor, z = 0.

    Rows run along the room's x, turned by yaw about z; they follow each other along y, turned likewise.
    """

    xyz: Point3 = Field(
        default=(0.0, 0.0, 0.0), description="outer corner of element (0, 0) in the room frame: x, y and z = 0 [m]"
    )
    yaw_deg: Coordinate = Field(default=0.0, description="turn of the grid about z, counter-clockwise [deg]")

    @model_validator(mode="after")
    def _on_the_floor(self) -> FloorMount:
        if self.xyz[2] != 0:
            raise ValueError(
                f"xyz has z = {self.xyz[2]:g}; the sensing elements lie in the room's floor, z = 0 is valid"
            )
        return self

    def room_from_grid(self) -> Pose:
        """Return the pose of the grid's frame: x along a row, y from row to row, z up."""
        return Pose(xyz=self.xyz, rpy=(0.0, 0.0, radians(self.yaw_deg)))


class FloorDescription(Timing):
    """A pressure floor: `rows` x `columns` square elements of side `pitch_m`, each a force-sensing resistor with `curve`.

    The default is the floor of Mori et al. (camera-floor-particle): 252 elements 200 mm apart, 8 bits, 10 Hz, to 10 kg/cm²; laid
    18 along x by 14 along y (ours).
    """

    former_names: ClassVar = {"believed": "calibration_error"}

    kind: Literal["floor"] = Field(description="the kind of sensor: a pressure floor")
    mount: FloorMount = Field(default=FloorMount(), description="where the grid lies and how it is turned")
    rows: PositiveInt = Field(default=14, description="number of rows, which follow each other along y")
    columns: PositiveInt = Field(default=18, description="number of elements in a row, along x")
    pitch_m: Pitch = Field(default=0.2, description="side of an element [m]")
    rate_hz: float = Field(default=10.0, gt=0, le=1000, description="frames a second [Hz]")
    curve: ForceCurve = Field(default=ForceCurve(), description="what an element reads under a load")
    noise: _FloorElectronics = Field(
        default=FLOOR_ELECTRONICS["default"],
        description="errors of cover, resistors and electronics: off, default, worse, or their parameters",
    )
    calibration_error: CalibrationError | None = Field(
        default=None, description="what the calibration says wrongly of the floor; none: nothing"
    )

    @model_validator(mode="after")
    def _consistent(self) -> FloorDescription:
        check_cells(self.rows, self.columns)
        self.noise.check_cells(self.rows, self.columns)
        return self

    def rig_sensor(self, name: str) -> FloorSensor:
        """Return the floor as a sensor of a rig."""
        return FloorSensor(
            topic=f"/{name}/floor",
            room_from_sensor=self.mount.room_from_grid(),
            rows=self.rows,
            columns=self.columns,
            pitch_m=self.pitch_m,
            curve=self.curve,
        )


def check_floor(description: FloorDescription, floor: NDArray[np.float64], field: str) -> None:
    """Raise InputError naming the field if the grid leaves the room's floor, a simple polygon (k, 2) [m]."""
    corners = description.rig_sensor("floor").corners
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        outside = leaves_at(floor, start, end)
        if outside is not None:
            low, high = floor.min(axis=0), floor.max(axis=0)
            size_m = np.array([description.columns, description.rows]) * description.pitch_m
            raise InputError(
                f"{field}: a grid of {description.rows} rows and {description.columns} columns of {description.pitch_m:g} m, "
                f"{size_m[0]:g} m x {size_m[1]:g} m, is outside the room at [{outside[0]:.3g}, {outside[1]:.3g}]; a grid on its "
                f"floor is valid, which lies in x {low[0]:g} to {high[0]:g} m, y {low[1]:g} to {high[1]:g} m"
            )
