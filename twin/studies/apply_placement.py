"""Apply a placement to a scenario, and write the scenario file that results."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trackers.configuration import validate
from trackers.errors import InputError
from trackers.user_input.plain_data import dump_yaml
from twin import models
from twin.recording.atomic_file import write_atomic
from twin.scenario import Scenario
from twin.scenario.housings import check_place
from twin.scenario.mount import Mount
from twin.scenario.sensor_descriptions import FloorDescription
from twin.studies.candidate_poses import relative_mounts
from twin.studies.candidate_set import CandidatePose
from twin.studies.devices import Device, DeviceKind
from twin.studies.spec import Study

_Placed = tuple[Mount, DeviceKind]
"""One device: its mount, or that of its first sensor, in the room, and its kind."""


def apply_placement(study: Study, scenario: Scenario, poses: Sequence[CandidatePose]) -> Scenario:
    """Return the scenario with the poses' devices in place of its own; the same scenario without poses.

    Devices are called after their entry, since names like `west` describe old positions: NAME, NAME-2 ... of an entry with
    one sensor, NAME-1, NAME-2 ... of one with several; references to the first sensor, as main sensor or in a fault, then
    mean the first again. Devices of several sensors each keep their names; further ones get the entry's appended.
    Raises InputError for an invalid result: a fault of a removed sensor, a scanner that cannot have its role at this height,
    two sensors of one name.
    """
    if not poses:
        return scenario
    sensors, housings = dict(scenario.sensors), dict(scenario.housings)
    called: dict[str, str] = {}
    for own in [each for device in study.devices.values() for each in device.sensors_in(scenario)]:
        del sensors[own]
    for name, device in study.devices.items():
        chosen = [(mount, device.kinds[pose.kind]) for pose in poses if pose.device == name for mount in pose.mounts]
        if device.housing is not None:
            placed_housings, placed = _on_housings(device.housing, device.sensors_in(scenario), name, chosen, scenario)
            del housings[device.housing]
            housings |= placed_housings
        elif device.together:
            placed = _together(device, name, chosen, scenario)
        else:
            placed = _single(device, name, chosen, scenario)
            if taken := next((each for each in placed if each in sensors), None):
                raise InputError(
                    f"devices.{name}: {taken!r} is a sensor that stays; another name of the entry is expected"
                )
            called |= dict(zip(device.sensors, placed, strict=False))
        sensors |= placed
    if not sensors:
        raise InputError("no sensor is left; at least one is expected")
    main = called.get(scenario.main_sensor or "", scenario.main_sensor)
    faults = {
        each: fault.model_copy(update={"sensor": tuple(called.get(name, name) for name in fault.sensor)})
        for each, fault in scenario.faults.items()
    }
    changed = scenario.model_copy(
        update={
            "sensors": sensors,
            "housings": housings,
            "main_sensor": main if main in sensors else None,
            "faults": faults,
        }
    )
    for fault_name, fault in faults.items():
        removed = [each for each in fault.sensor if each not in sensors]
        if removed:
            raise InputError(
                f"faults.{fault_name}: {removed[0]!r} is not there; a fault of a sensor that stays is expected"
            )
    for name in sensors:
        try:
            check_place(changed, name)
        except ValueError as error:
            raise InputError(f"sensors.{name}.{error}") from error
    return changed


def _described(description: Any, mount: Mount, kind: DeviceKind) -> Any:
    """Describe a sensor of this kind at a mount in the room, with its pose freed of rounding by rotation."""
    angles = {each: round(getattr(mount, each), 9) + 0.0 for each in ("yaw_deg", "pitch_deg", "roll_deg")}
    x, y, z = (round(each, 9) + 0.0 for each in mount.xyz)
    mount = Mount(xyz=(x, y, z), **angles)
    if isinstance(description, FloorDescription):
        content: dict[str, Any] = {"xyz": mount.xyz, "yaw_deg": mount.yaw_deg}
    else:
        content = mount.model_dump()
    if not kind.set:
        update: dict[str, Any] = {"mount": type(description.mount)(**content)}
        if not isinstance(description, FloorDescription):
            update["housing"] = None
        return description.model_copy(update=update)
    whole = description.model_dump(mode="json", exclude_none=True) | {"mount": content} | dict(kind.set)
    whole.pop("housing", None)
    return validate(type(description), whole, f"devices: kinds: {kind.name}")


def _single(device: Device, device_name: str, chosen: Sequence[_Placed], scenario: Scenario) -> dict[str, Any]:
    """Describe devices of one sensor each, called after their entry."""
    templates = [scenario.sensors[name] for name in device.sensors]
    placed = {}
    for number, (mount, kind) in enumerate(chosen):
        name = device_name if number == 0 and len(templates) == 1 else f"{device_name}-{number + 1}"
        placed[name] = _described(templates[min(number, len(templates) - 1)], mount, kind)
    return placed


def _together(device: Device, device_name: str, chosen: Sequence[_Placed], scenario: Scenario) -> dict[str, Any]:
    """Describe devices of several sensors each."""
    inner = dict(zip(device.together, relative_mounts(device, scenario), strict=True))
    return {
        _name(name, device_name, number): _described(scenario.sensors[name], mount.carrying(inner[name]), kind)
        for number, (mount, kind) in enumerate(chosen)
        for name in device.together
    }


def _on_housings(
    housing: str, names: Sequence[str], device_name: str, chosen: Sequence[_Placed], scenario: Scenario
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return copies of a housing, and the sensors on each."""
    housings, sensors = {}, {}
    for number, (mount, kind) in enumerate(chosen):
        called = housing if number == 0 else f"{device_name}-{number + 1}"
        housings[called] = scenario.housings[housing].model_copy(update={"mount": mount})
        for name in names:
            sensor = scenario.sensors[name]
            content = sensor.model_dump(mode="json", exclude_none=True) | dict(kind.set) | {"housing": called}
            sensors[_name(name, device_name, number)] = validate(type(sensor), content, f"devices: kinds: {kind.name}")
    return housings, sensors


def _name(own: str, device_name: str, number: int) -> str:
    """Name a sensor of a device of several: of the first one by its own name."""
    return own if number == 0 else f"{own}-{device_name}-{number + 1}"


def write_scenario(path: Path, own: Scenario, changed: Scenario, own_file: Path, name: str, description: str) -> None:
    """Write a scenario file that extends `own_file` (which loads as `own`) and loads as `changed` except for its name and
    people.
    """
    shipped = models.MODELS / "scenarios"
    parent = own_file.stem if own_file.parent == shipped else os.path.relpath(own_file.resolve(), path.parent.resolve())
    before, now = (each.model_dump(mode="json", exclude_none=True) for each in (own, changed))
    content: dict[str, Any] = {"extends": parent, "name": name, "description": description}
    for field in (
        "duration_s",
        "area",
        "background",
        "background_frames",
        "rendering",
        "main_sensor",
        "faults",
        "sensors",
        "housings",
    ):
        changed = _changes(before.get(field), now.get(field))
        if changed is not None or (field in before and field not in now):
            content[field] = changed
    write_atomic(path, "# What the study recommends: `twin run` takes it as it is.\n" + dump_yaml(content))


def _changes(before: Any, now: Any) -> Any:
    """Return what `deep_merge` needs to turn `before` into `now`: null for a removed key; None where nothing changed."""
    if before == now:
        return None
    if not isinstance(before, dict) or not isinstance(now, dict):
        return now
    same = object()
    found = {key: None for key in before if key not in now}
    for key, value in now.items():
        if before.get(key, same) != value:
            found[key] = _changes(before[key], value) if key in before else value
    return found
