"""Housings: bodies that carry several sensors and may drive; and sensors at their true and at their assumed poses."""

from __future__ import annotations

from collections.abc import Mapping
from math import fmod, hypot, radians
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from pydantic import Field, ValidationError, model_validator

from trackers.configuration import Strict
from trackers.errors import valid_names
from trackers.rig import Name, OdometrySensor, Point2, Pose, Rig, RigSensor
from trackers.rig_sensors import check_height, check_layer
from twin.scenario.action import check_repeat
from twin.scenario.mount import CalibrationError, Mount, Mounted
from twin.scenario.sensor_descriptions import FloorDescription
from twin.sensors.odometry import OdometryDescription

if TYPE_CHECKING:
    from twin.scenario.sensor_descriptions import AnyDescription


BaseSpeed = Annotated[float, Field(gt=0, le=5, allow_inf_nan=False)]


class _Drives(Strict):
    """Limits of a differential drive: the base turns on the spot and goes ahead, never sideways."""

    speed_m_s: BaseSpeed = Field(default=0.7, description="greatest speed [m/s]")
    turn_rate: BaseSpeed = Field(default=1.2, description="greatest turning rate [rad/s]")


class PathDrive(_Drives):
    """A drive along waypoints that goes around furniture and brakes for people."""

    kind: Literal["path"] = Field(description="the drive: along waypoints")
    waypoints: tuple[Point2, ...] = Field(min_length=1, description="places to pass in the room frame [m]")
    repeat: bool = Field(default=False, description="whether to start over at the first waypoint")

    @model_validator(mode="after")
    def _goes_on(self) -> PathDrive:
        check_repeat(self.waypoints, self.repeat)
        return self


class FollowDrive(_Drives):
    """A drive behind a person at a distance, facing them; the base stands while they are not in the room."""

    kind: Literal["follow"] = Field(description="the drive: behind a person")
    person: Name = Field(description="who is followed")
    distance_m: float = Field(default=1.2, ge=0.6, le=10, description="distance that is kept from the person [m]")


class WanderDrive(_Drives):
    """A drive to random places of the tracked area, one after another."""

    kind: Literal["wander"] = Field(description="the drive: to random places")


Drive = Annotated[PathDrive | FollowDrive | WanderDrive, Field(discriminator="kind")]


class BaseBody(Strict):
    """A solid about the housing's origin, from the floor up: a cylinder of `radius_m`, or a box of `size_m`.

    Rays and cameras meet it, and people keep clear of it. Rays of the housing's own scanners pass through it.
    """

    radius_m: float | None = Field(default=None, gt=0.02, le=1, description="radius of a cylinder [m]; none: a box")
    size_m: tuple[BaseSpeed, BaseSpeed] | None = Field(default=None, description="length and width of a box [m]")
    height_m: float = Field(default=0.4, gt=0.02, le=2.5, description="height above the floor [m]")
    colour: tuple[float, float, float] = Field(default=(0.25, 0.3, 0.35), description="red, green, blue, 0 to 1")

    @model_validator(mode="after")
    def _one_shape(self) -> BaseBody:
        if (self.radius_m is None) == (self.size_m is None):
            raise ValueError("one of radius_m (a cylinder) and size_m (a box) is expected")
        return self

    @property
    def reach_m(self) -> float:
        """Radius of the upright cylinder about the body [m]."""
        return self.radius_m if self.radius_m is not None else hypot(*(self.size_m or (0.0, 0.0))) / 2


class Housing(Strict):
    """A body that carries sensors. Their mounts are in its frame: x ahead, y left, z up.

    With a `drive` it moves, also during a sweep of its scanners, and `mount` is the pose at which it starts. Its odometry is a
    sensor of the rig, named after the housing; the housing's sensors are mounted on it.
    """

    mount: Mount = Field(
        description="where the housing is in the room and how it is turned, at the start where it drives"
    )
    drive: Drive | None = Field(default=None, description="how it drives about the room; none: it stands")
    body: BaseBody | None = Field(
        default=None, description="a solid that rays, cameras and people meet; none: only sensors"
    )
    odometry: OdometryDescription = Field(
        default=OdometryDescription(),
        description="errors of the odometry of a housing that drives",
        exclude_if=lambda odometry: odometry == OdometryDescription(),
    )

    @model_validator(mode="after")
    def _stands_upright(self) -> Housing:
        if self.drive is not None and (self.mount.pitch_deg or self.mount.roll_deg):
            raise ValueError("mount: a housing that drives stands upright; pitch_deg and roll_deg of 0 are valid")
        return self


def driven(scenario: HasSensors) -> dict[str, Housing]:
    """Return the driving housings by name."""
    return {name: housing for name, housing in scenario.housings.items() if housing.drive is not None}


def base_of(scenario: HasSensors, name: str) -> str | None:
    """Return the driving housing of a sensor; None for one that stands in the room."""
    housing = getattr(scenario.sensors[name], "housing", None)
    return housing if housing in driven(scenario) else None


def odometry_sensor(scenario: HasSensors, name: str) -> OdometrySensor:
    """Return the odometry of a driving housing as a sensor of the rig. Its frame is the housing's starting pose."""
    topic = "/odom" if len(driven(scenario)) == 1 else f"/{name}/odom"
    return OdometrySensor(topic=topic, room_from_sensor=scenario.housings[name].mount.room_from_housing())


def held_sensor(scenario: HasSensors, name: str) -> AnyDescription:
    """Return the description of a sensor with its mount in the room, or in its driving housing's frame."""
    description = scenario.sensors[name]
    return description if base_of(scenario, name) is not None else in_the_room(scenario, name)


def rig_sensor(scenario: HasSensors, name: str) -> RigSensor:
    """Return a sensor of the true rig, mounted on its housing if that drives."""
    sensor = held_sensor(scenario, name).rig_sensor(name)
    base = base_of(scenario, name)
    return sensor if base is None else sensor.model_copy(update={"mounted_on": base})


class HasSensors(Protocol):
    """The part of a `Scenario` that holds its sensors. `Scenario` itself imports this module."""

    @property
    def sensors(self) -> Mapping[str, AnyDescription]: ...
    @property
    def housings(self) -> Mapping[str, Housing]: ...
    @property
    def room_name(self) -> str: ...
    @property
    def main_sensor(self) -> str | None: ...
    @property
    def people(self) -> Mapping[str, Any]: ...


def check_on_housing(description: Any, housings: Mapping[str, Housing]) -> None:
    """Raise ValueError for a sensor on an undefined housing."""
    if isinstance(description, Mounted) and description.housing is not None and description.housing not in housings:
        there = valid_names(description.housing, housings) if housings else "there is none under housings"
        raise ValueError(f"housing: {description.housing!r} is no housing; {there}, or none for a mount in the room")


def check_drives(scenario: HasSensors) -> None:
    """Raise ValueError for a driving housing with a sensor's name, an unknown person to follow, or sensors that cannot drive."""
    for name, housing in driven(scenario).items():
        if name in scenario.sensors:
            raise ValueError(
                f"housings.{name}: a sensor has that name, and the rig's odometry would; another is expected"
            )
        if isinstance(housing.drive, FollowDrive) and housing.drive.person not in scenario.people:
            valid = valid_names(housing.drive.person, scenario.people, none="none, as people is empty")
            raise ValueError(f"housings.{name}.drive.person: {housing.drive.person!r} is nobody in people; {valid}")
    for name, sensor in scenario.sensors.items():
        if base_of(scenario, name) is not None and sensor.kind != "laser":
            raise ValueError(
                f"sensors.{name}.housing: {getattr(sensor, 'housing', '')!r} drives, and a {sensor.kind} cannot drive yet; "
                "lasers are valid on it"
            )


def in_the_room(scenario: HasSensors, name: str) -> AnyDescription:
    """Return the description of a sensor with its mount in the room's frame, on any housing."""
    description = scenario.sensors[name]
    if isinstance(description, FloorDescription) or description.housing is None:
        return description
    mount = scenario.housings[description.housing].mount.carrying(description.mount)
    return description.model_copy(update={"mount": mount, "housing": None})


def check_place(scenario: HasSensors, name: str) -> None:
    """Raise ValueError for a sensor below the floor, or at a height that does not fit its role."""
    description = in_the_room(scenario, name)
    if isinstance(description, FloorDescription):
        return
    try:
        check_height(description.mount.room_from_housing())
    except ValueError as error:
        raise ValueError(f"mount.xyz: {error}") from error
    role = getattr(description, "role", None)
    if role is not None:
        check_layer(role, description.mount.room_from_housing())


def check_assumed_sensor(scenario: HasSensors, name: str) -> None:
    """Raise ValueError for an assumed sensor that a rig cannot hold."""
    description = in_the_room(scenario, name)
    if description.calibration_error is None:
        return
    try:
        assumed = assumed_sensor(description, description.rig_sensor(name))
        type(assumed).model_validate(assumed.model_dump())
    except ValidationError as error:
        faults = [".".join(map(str, each["loc"])) + ": " * bool(each["loc"]) + each["msg"] for each in error.errors()]
        raise ValueError(
            "; ".join(f"calibration_error: {each.replace('Value error, ', '')}" for each in faults)
        ) from error


def check_calibration_error(description: Any) -> None:
    """Raise ValueError for an assumed value that does not fit the sensor's kind."""
    assumed = description.calibration_error
    if assumed is None:
        return
    if assumed.changes_lens and not hasattr(description, "intrinsics"):
        raise ValueError(
            f"calibration_error: focal_scale and principal_px are of cameras, not of a {description.kind}; "
            "xyz, rpy_deg and time_offset_s are valid for it"
        )
    if isinstance(description, FloorDescription) and (assumed.xyz[2] or assumed.rpy_deg[0] or assumed.rpy_deg[1]):
        raise ValueError(
            "calibration_error: a floor lies level; xyz: [dx, dy, 0] and rpy_deg: [0, 0, yaw] are valid for it, "
            f"not {list(assumed.xyz)} and {list(assumed.rpy_deg)}"
        )


def assumed_sensor(description: AnyDescription, true: RigSensor) -> RigSensor:
    """Return the sensor that trackers assume: `true`, changed by the calibration errors of its description."""
    assumed = description.calibration_error
    if assumed is None:
        return true
    change: dict[str, Any] = {"time_offset_s": true.time_offset_s + assumed.time_offset_s}
    if assumed.changes_pose:
        change["room_from_sensor"] = _assumed_pose(description, assumed)
    intrinsics = getattr(true, "intrinsics", None)
    if assumed.changes_lens and intrinsics is not None:
        right, down = assumed.principal_px
        scale = assumed.focal_scale
        lens = {
            "fx": intrinsics.fx * scale,
            "fy": intrinsics.fy * scale,
            "cx": intrinsics.cx + right,
            "cy": intrinsics.cy + down,
        }
        change["intrinsics"] = intrinsics.model_copy(update=lens)
    return true.model_copy(update=change)


def assumed_rig(scenario: HasSensors, area: tuple[Point2, ...]) -> Rig:
    """Return the rig that trackers assume in a simulation of the scenario, without building any sensor.

    area: the tracked area, a polygon in the room's frame [m].
    """
    assumed = {
        name: assumed_sensor(held_sensor(scenario, name), rig_sensor(scenario, name)) for name in scenario.sensors
    }
    bases = {name: odometry_sensor(scenario, name) for name in driven(scenario)}
    return Rig(sensors=assumed | bases, area=area, room=scenario.room_name, main=scenario.main_sensor)


def _assumed_pose(description: AnyDescription, assumed: CalibrationError) -> Pose:
    if isinstance(description, FloorDescription):
        mount = description.mount
        x, y, _ = (a + b for a, b in zip(mount.xyz, assumed.xyz, strict=True))
        return Pose(xyz=(x, y, 0.0), rpy=(0.0, 0.0, radians(fmod(mount.yaw_deg + assumed.rpy_deg[2], 360.0))))
    moved = description.model_copy(update={"mount": assumed.mount(description.mount)})
    return moved.rig_sensor("").room_from_sensor
