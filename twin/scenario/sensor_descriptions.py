"""Descriptions of sensors in a scenario: kind, mount, schedule and accuracy.

A pressure floor has the position and pitch of its grid, and its accuracy.
"""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt, model_validator

from trackers.area import AngleDeg, Point3, Pose
from trackers.cameras import FisheyeIntrinsics
from trackers.cameras.intrinsics import Side
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import ForceCurve
from trackers.rig import FisheyeSensor, FloorSensor, LaserSensor, Role
from trackers.rig_sensors import Pitch, check_cells
from twin.geometry.polygon import leaves_at
from twin.scenario.camera_descriptions import CameraNoiseByName, PinholeDescription, StereoDescription
from twin.scenario.mount import CalibrationError, Mounted, NoiseName, by_name
from twin.sensors.camera import CAMERA_NOISE, LENSES, Lens
from twin.sensors.floor_electronics import FLOOR_ELECTRONICS, FloorElectronics
from twin.sensors.laser_noise import LASER_NOISE, LaserNoise
from twin.sensors.schedule import Timing

if TYPE_CHECKING:
    from twin.instant.snapshot import FootShapes
    from twin.sensors.render import OffscreenRenderer
    from twin.sensors.sensor import Sensor

_FloorElectronics = Annotated[
    FloorElectronics, by_name(FLOOR_ELECTRONICS, "parameters like {crosstalk: 0.1}", NoiseName | FloorElectronics)
]


class FloorMount(Strict):
    """Pose of a floor's grid: `xyz` [m] of the outer corner of element (0, 0) in the room frame, with z = 0.

    Rows run along the room's x and follow each other along y, both turned by yaw about z.
    """

    xyz: Point3 = Field(
        default=(0.0, 0.0, 0.0), description="outer corner of element (0, 0) in the room frame: x, y and z = 0 [m]"
    )
    yaw_deg: AngleDeg = Field(default=0.0, description="turn of the grid about z, counter-clockwise [deg]")

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

    The default is the floor of Mori et al. (camera-floor-particle): 252 elements 200 mm apart, 8 bits, 10 Hz, up to 10 kg/cm².
    The arrangement, 18 along x by 14 along y, is ours.
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


LensName = Literal["equidistant_185", "opencv_test_lens"]

_LaserNoise = Annotated[
    LaserNoise,
    by_name(LASER_NOISE, "parameters like {sigma_m: 0.01}", NoiseName | Literal["hokuyo"] | LaserNoise),
]
_Lens = Annotated[Lens, by_name(LENSES, "a calibration {width, height, fx, k, field_of_view_deg}", LensName | Lens)]


class LaserDescription(Mounted):
    """A planar scanner with evenly spaced beams over `field_of_view_deg`, from the first to the last, centred ahead.

    Give the spacing `resolution_deg` or the number of `beams` (neither: 0.5°, or as near as divides the field of view).
    `sweep_time_s` is the time from the first beam to the last (0: all at once).
    """

    kind: Literal["laser"] = Field(description="the kind of sensor: a planar laser scanner")
    role: Role | None = Field(
        default=None,
        description="the layer that trackers use the scanner for; none: waist from a height of 0.7 m on, knee below",
    )
    field_of_view_deg: float = Field(
        default=180.0, gt=0, le=360, description="angle from the first beam to the last, centred ahead [deg]"
    )
    resolution_deg: float | None = Field(
        default=None, gt=0, le=360, description="angle between two beams [deg]; none: by the number of beams, or 0.5"
    )
    beams: int | None = Field(default=None, ge=2, le=100_000, description="number of beams; none: by the resolution")
    range_min_m: float = Field(default=0.05, ge=0, description="shortest range; what is nearer reads NaN [m]")
    range_max_m: float = Field(default=8.0, gt=0, le=1000, description="longest range; what is farther reads +inf [m]")
    sweep_time_s: float = Field(
        default=0.0, ge=0, le=0.5, description="time from the first beam to the last [s]; 0: all at once"
    )
    range_10_percent_m: float | None = Field(
        default=None,
        gt=0,
        le=1000,
        description="range of a surface that reflects 10 % and faces the beam; darker, slanting and farther ones return no echo "
        "[m]; none: every surface within range_max_m returns one",
    )
    noise: _LaserNoise = Field(
        default=LASER_NOISE["default"],
        description="errors of the scanner: off, default, worse, hokuyo, or their parameters",
    )

    @model_validator(mode="after")
    def _consistent(self) -> LaserDescription:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(f"range_min_m {self.range_min_m:g} must be below range_max_m {self.range_max_m:g}")
        if self.sweep_time_s * self.rate_hz > 1 + 1e-9:
            raise ValueError(
                f"sweep_time_s {self.sweep_time_s:g} is longer than the period 1 / rate_hz; "
                f"at most {1 / self.rate_hz:g} is valid"
            )
        if self.resolution_deg is not None:
            if self.beams is not None:
                raise ValueError("resolution_deg and beams are both given; one of them is enough")
            steps = self.field_of_view_deg / self.resolution_deg
            if not 0.5 < steps < 100_000 or abs(steps - round(steps)) > 1e-6 * steps:
                raise ValueError(
                    f"resolution_deg {self.resolution_deg:g} does not divide field_of_view_deg "
                    f"{self.field_of_view_deg:g}; a whole number of steps (at most 99999) is valid"
                )
        return self

    @property
    def n_beam(self) -> int:
        """Number of beams."""
        if self.beams is not None:
            return self.beams
        return max(1, round(self.field_of_view_deg / (self.resolution_deg or 0.5))) + 1

    def rig_sensor(self, name: str) -> LaserSensor:
        """Return the scanner as a sensor of a rig."""
        return LaserSensor(topic=f"/{name}/scan", room_from_sensor=self.mount.room_from_housing(), role=self.role)


class FisheyeDescription(Mounted):
    """A fisheye camera: a lens by name or calibration, and the picture's `size` [width, height] (default: the lens's own).

    The mount's x axis is the optical axis.
    """

    kind: Literal["fisheye"] = Field(description="the kind of sensor: a fisheye camera")
    lens: _Lens = Field(default=LENSES["equidistant_185"], description="the lens: a name, or a calibration")
    size: tuple[Side, Side] | None = Field(
        default=None, description="width and height of the picture [px]; none: the lens's own"
    )
    noise: CameraNoiseByName = Field(
        default=CAMERA_NOISE["default"], description="noise of the image sensor: off, default, worse, or its parameters"
    )

    @model_validator(mode="after")
    def _consistent(self) -> FisheyeDescription:
        self.intrinsics()  # raises for a lens that folds back
        return self

    def intrinsics(self) -> FisheyeIntrinsics:
        """Return the lens at the picture's size."""
        return self.lens.intrinsics(self.size)

    def rig_sensor(self, name: str) -> FisheyeSensor:
        """Return the camera as a sensor of a rig."""
        return FisheyeSensor(
            topic=f"/{name}/image/compressed",
            room_from_sensor=self.mount.room_from_optical(),
            intrinsics=self.intrinsics(),
        )


AnyDescription = LaserDescription | FisheyeDescription | PinholeDescription | StereoDescription | FloorDescription
SensorDescription = Annotated[AnyDescription, Field(discriminator="kind")]

CAMERA_KINDS = ("fisheye", "camera", "stereo")
"""Kinds of sensors that need rendering."""


def _no_soles() -> FootShapes:
    raise ValueError(
        "somebody treads on a floor that was built without the soles of its people (build_sensor's shapes)"
    )


def build_sensor(
    name: str,
    description: AnyDescription,
    renderer: Callable[[], OffscreenRenderer],
    *,
    shapes: Callable[[], FootShapes] = _no_soles,
    device: np.random.Generator | None = None,
    mounted_on: str | None = None,
) -> Sensor:
    """Build the sensor with its noise.

    `renderer` is called at a camera's first picture only. `shapes` returns the soles of the snapshots' people; it is called
    at the first step on a floor. `device` draws the differences between floors of one description, such as dead elements.
    Without it the generator of the first observation draws them, anew for every series of observations, so that a background
    and a run would differ. `mounted_on`: the driving housing of a scanner, in whose frame its mount is.

    Raises InputError for a lens that cannot be rendered.
    """
    from twin.sensors.floor_electronics import BuiltElectronics
    from twin.sensors.sensor import Noisy

    ideal = _build_ideal(name, description, renderer, shapes, mounted_on)
    if isinstance(description, StereoDescription):
        return ideal  # its noise is in both views before they are matched
    noise = description.electronics if isinstance(description, PinholeDescription) else description.noise
    if noise.is_off:
        return ideal
    if isinstance(description, FloorDescription) and device is not None:
        parts = description.noise.build(description.rows, description.columns, device)
        return Noisy(ideal, BuiltElectronics(description.noise, parts))
    return Noisy(ideal, noise)


def _build_ideal(
    name: str,
    description: AnyDescription,
    renderer: Callable[[], OffscreenRenderer],
    shapes: Callable[[], FootShapes],
    mounted_on: str | None,
) -> Sensor:
    # MuJoCo and OpenCV are imported here: reading a scenario needs neither.
    match description:
        case FisheyeDescription():
            from twin.sensors.fisheye import Fisheye

            return Fisheye(name, description.rig_sensor(name), renderer)
        case PinholeDescription():
            from twin.sensors.pinhole import Pinhole

            return Pinhole(name, description.rig_sensor(name), renderer, instants_s=description.instants_s)
        case StereoDescription():
            from twin.sensors.pinhole import Stereo

            return Stereo(
                name,
                description.rig_sensor(name),
                renderer,
                matching=description.matching,
                noise=description.electronics,
                range_min_m=description.range_min_m,
                range_max_m=description.range_max_m,
            )
        case FloorDescription():
            from twin.sensors.floor import Floor

            return Floor(name, description.rig_sensor(name), shapes)
        case LaserDescription():
            from twin.sensors.laser import Laser

            field_of_view_rad = radians(description.field_of_view_deg)
            return Laser(
                name,
                description.rig_sensor(name).model_copy(update={"mounted_on": mounted_on}),
                beams=description.n_beam,
                angle_min_rad=-field_of_view_rad / 2,
                angle_increment_rad=field_of_view_rad / (description.n_beam - 1),
                range_min_m=description.range_min_m,
                range_max_m=description.range_max_m,
                sweep_time_s=description.sweep_time_s,
                range_10_percent_m=description.range_10_percent_m,
            )
