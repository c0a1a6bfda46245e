"""Apply a placement to a scenario, and write the scenario file that results."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trackers.configuration import validate
from trackers.errors import InputError
from trackers.plain_data import dump_yaml
from twin import models
from twin.recording.atomic_file import open_atomic
from twin.scenario import Scenario
from twin.scenario.housings import check_place, in_the_room
from twin.scenario.mount import Mount, mount_of
from twin.scenario.sensors import FloorDescription
from twin.studies.candidate_set import CandidatePose
from twin.studies.devices import Device, DeviceKind
from twin.studies.spec import Study


def apply_placement(study: Study, scenario: Scenario, poses: Sequence[CandidatePose]) -> Scenario:
    """Return the scenario with the poses' devices in place of its own; the same scenario without poses.

    A device of one sensor keeps its name, and further ones are called NAME-2, NAME-3 ... after their entry. Devices of an
    entry with several sensors are NAME-1, NAME-2 ..., since names like `west` describe old positions; references to the
    first sensor, as main sensor or in a fault, then mean the first again. Raises InputError for an invalid result: a fault
    of a removed sensor, a scanner that cannot have its role at this height, two sensors of one name.
    """
    if not poses:
        return scenario
    sensors, housings = dict(scenario.sensors), dict(scenario.housings)
    called: dict[str, str] = {}
    for name, device in study.devices.items():
        chosen = [(mount, device.kinds[pose.kind]) for pose in poses if pose.device == name for mount in pose.mounts]
        if device.housing is not None:
            _move_housing(device.housing, chosen, name, sensors, housings, scenario)
        elif device.together:
            _move_together(device, chosen, name, sensors, scenario)
        else:
            called |= _move_each(device, chosen, name, sensors, scenario)
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


def _names(own: Sequence[str], device_name: str, number: int) -> list[str]:
    """Name the sensors of a device: by the scenario's own name if any, then NAME-2 ... after the device."""
    return [own[0] if k == 0 and len(own) == 1 else f"{device_name}-{k + 1}" for k in range(number)]


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


def _move_each(
    device: Device,
    chosen: list[tuple[Mount, DeviceKind]],
    device_name: str,
    sensors: dict[str, Any],
    scenario: Scenario,
) -> dict[str, str]:
    """Place devices of one sensor each; return the new names of the scenario's own sensors, as far as they go."""
    for name in device.sensors:
        del sensors[name]
    names = _names(device.sensors, device_name, len(chosen))
    for number, (name, (mount, kind)) in enumerate(zip(names, chosen, strict=True)):
        template = scenario.sensors[device.sensors[min(number, len(device.sensors) - 1)]]
        if name in sensors:
            raise InputError(
                f"devices.{device_name}: {name!r} is a sensor that stays; another name of the entry is expected"
            )
        sensors[name] = _described(template, mount, kind)
    return dict(zip(device.sensors, names, strict=False))


def _move_together(
    device: Device,
    chosen: list[tuple[Mount, DeviceKind]],
    device_name: str,
    sensors: dict[str, Any],
    scenario: Scenario,
) -> None:
    poses = {name: in_the_room(scenario, name).mount.room_from_housing() for name in device.together}  # pyright: ignore
    first = poses[device.together[0]]
    for name in device.together:
        del sensors[name]
    for number, (mount, kind) in enumerate(chosen):
        for name, pose in poses.items():
            inner = mount_of(
                first.rotation.T @ pose.rotation, first.rotation.T @ (pose.translation - first.translation)
            )
            called = name if number == 0 else f"{name}-{device_name}-{number + 1}"
            sensors[called] = _described(scenario.sensors[name], mount.carrying(inner), kind)


def _move_housing(
    housing: str,
    chosen: list[tuple[Mount, DeviceKind]],
    device_name: str,
    sensors: dict[str, Any],
    housings: dict[str, Any],
    scenario: Scenario,
) -> None:
    on_it = {name: each for name, each in scenario.sensors.items() if getattr(each, "housing", None) == housing}
    for name in on_it:
        del sensors[name]
    template = housings.pop(housing)
    for number, (mount, kind) in enumerate(chosen):
        called = housing if number == 0 else f"{device_name}-{number + 1}"
        housings[called] = template.model_copy(update={"mount": mount})
        for name, each in on_it.items():
            content = each.model_dump(mode="json", exclude_none=True) | dict(kind.set) | {"housing": called}
            sensors[name if number == 0 else f"{name}-{called}"] = validate(
                type(each), content, f"devices: kinds: {kind.name}"
            )


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
    with open_atomic(path) as stream:
        stream.write("# What the study recommends: `twin run` takes it as it is.\n")
        stream.write(dump_yaml(content))


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
