"""Housings: several sensors on one, moved as one; and a sensor as it hangs in the room, or is assumed to."""

from __future__ import annotations

from collections.abc import Mapping
from math import radians
from typing import TYPE_CHECKING, Any, Protocol

from pydantic import Field, ValidationError

from trackers.configuration import Strict
from trackers.rig import Point2, Pose, Rig, RigSensor
from trackers.rig_sensors import check_height, check_layer
from twin.scenario.mount import CalibrationError, Mount, Mounted
from twin.scenario.pressure_floor import FloorDescription

if TYPE_CHECKING:
    from twin.scenario.sensors import AnyDescription


class Housing(Strict):
    """A body that carries sensors: those whose `housing` it is have their mounts in its frame, x ahead, y left, z up."""

    mount: Mount = Field(description="where the housing is in the room and how it is turned")


class HasSensors(Protocol):
    """The part of a scenario that holds its sensors: a `Scenario`, which is built on this module."""

    @property
    def sensors(self) -> Mapping[str, AnyDescription]: ...
    @property
    def housings(self) -> Mapping[str, Housing]: ...
    @property
    def room_name(self) -> str: ...
    @property
    def main_sensor(self) -> str | None: ...


def check_on_housing(description: Any, housings: Mapping[str, Housing]) -> None:
    """Raise ValueError where a sensor is on a housing that is not there."""
    if isinstance(description, Mounted) and description.housing is not None and description.housing not in housings:
        there = f"valid are {', '.join(housings)}" if housings else "there is none under housings"
        raise ValueError(f"housing: {description.housing!r} is no housing; {there}, or none for a mount in the room")


def in_the_room(scenario: HasSensors, name: str) -> AnyDescription:
    """Return the description of a sensor with its mount in the room's frame, whatever housing it is on."""
    description = scenario.sensors[name]
    if isinstance(description, FloorDescription) or description.housing is None:
        return description
    mount = scenario.housings[description.housing].mount.carrying(description.mount)
    return description.model_copy(update={"mount": mount, "housing": None})


def check_place(scenario: HasSensors, name: str) -> None:
    """Raise ValueError where a sensor hangs below the floor, or where its role cannot be."""
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
    """Raise ValueError where the assumed sensor is nothing that a rig can hold."""
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
    """Raise ValueError where something is assumed of a sensor that does not fit its kind."""
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
    """Return the sensor that trackers assume, which hangs in the room as described and truly is as `true` says."""
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
    """Return the rig that trackers assume, that of a simulation of the scenario, without building any sensor.

    area: the tracked area, a polygon in the room's frame [m].
    """
    hung = {name: in_the_room(scenario, name) for name in scenario.sensors}
    assumed = {name: assumed_sensor(description, description.rig_sensor(name)) for name, description in hung.items()}
    return Rig(sensors=assumed, area=area, room=scenario.room_name, main=scenario.main_sensor)


def _assumed_pose(description: AnyDescription, assumed: CalibrationError) -> Pose:
    if isinstance(description, FloorDescription):
        mount = description.mount
        x, y, _ = (a + b for a, b in zip(mount.xyz, assumed.xyz, strict=True))
        return Pose(xyz=(x, y, 0.0), rpy=(0.0, 0.0, radians(mount.yaw_deg + assumed.rpy_deg[2])))
    moved = description.model_copy(update={"mount": assumed.mount(description.mount)})
    return moved.rig_sensor("").room_from_sensor
