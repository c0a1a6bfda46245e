"""Candidate poses of a device, and those that a room or constraint rejects."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import atan2, degrees, hypot, prod

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from trackers.rig_sensors import Role, check_layer
from twin.room.building import Building
from twin.room.doorways import cable_route, doorways
from twin.scenario import Scenario
from twin.scenario.camera_descriptions import StereoDescription
from twin.scenario.housings import in_the_room
from twin.scenario.mount import Mount, mount_of
from twin.scenario.sensor_descriptions import CAMERA_KINDS, FloorDescription, LaserDescription, check_floor
from twin.studies.devices import Constraints, Device, KeepFreeZone, n_steps, steps
from twin.studies.spec import Study
from twin.world.scene import Scene

_AIM_HEIGHT_M = 1.0


def relative_mounts(device: Device, scenario: Scenario) -> list[Mount]:
    """Return the mounts of a device's sensors in its own frame: that of its first sensor, or of its housing."""
    if device.housing is not None:
        return [scenario.sensors[name].mount for name in device.sensors_in(scenario)]  # pyright: ignore[reportReturnType]
    if device.sensors:
        return [Mount(xyz=(0.0, 0.0, 0.0))]
    first, *_ = hung = [in_the_room(scenario, name).mount.room_from_housing() for name in device.together]  # pyright: ignore
    back = first.rotation.T
    return [mount_of(back @ each.rotation, back @ (each.translation - first.translation)) for each in hung]


def sensor_positions(device: Device, scenario: Scenario, mounts: tuple[Mount, ...]) -> Array:
    """Return the positions of all sensors of a device (or pair) at these mounts, (k, 3) [m]."""
    return np.array([mount.carrying(inner).xyz for mount in mounts for inner in relative_mounts(device, scenario)])


def _view_positions(device: Device, scenario: Scenario, mounts: tuple[Mount, ...]) -> Array:
    """Return the positions of `sensor_positions`, and of the right views of stereo cameras, (k, 3) [m]."""
    inner = relative_mounts(device, scenario)
    described = [scenario.sensors[name] for name in device.sensors_in(scenario)[: len(inner)]]
    right = [
        mount.carrying(Mount(xyz=(0.0, -each.baseline_m, 0.0)))
        for mount, each in zip(inner, described, strict=True)
        if isinstance(each, StereoDescription)
    ]
    return np.array([mount.carrying(each).xyz for mount in mounts for each in (*inner, *right)])


def candidate_mounts(device: Device, scenario: Scenario, building: Building, scene: Scene) -> list[tuple[Mount, ...]]:
    """Return every position in every direction, with mirror images if wanted; yaw and tilt in the room's frame."""
    first = device.sensors_in(scenario)[0]
    described = scenario.sensors[first]
    lies = isinstance(described, FloorDescription)
    own_pitch_deg = 0.0 if lies else in_the_room(scenario, first).mount.pitch_deg  # pyright: ignore[reportAttributeAccessIssue]
    bases = _every_place(device, building, own_pitch_deg)
    turned = _turned(device, bases, scene.area.mean(axis=0), is_camera=described.kind in CAMERA_KINDS)
    rounded = [_rounded(each) for each in turned]
    return [(each,) if device.mirrored is None else (each, _image(each, device)) for each in rounded]


def most_poses(device: Device, building: Building) -> int:
    """Return how many poses a device has at most before any is made, those outside of the building too."""
    n_place, walls, ceiling, box = len(device.places), device.walls, device.ceiling, device.box
    if walls is not None:
        way_m = np.linalg.norm(np.roll(building.outline, -1, axis=0) - building.outline, axis=1)
        n_along = sum(n_steps((0.0, each), walls.every_m) - 1 for each in way_m.tolist())
        n_place += n_along * n_steps(walls.height_m, walls.height_every_m)
    if ceiling is not None:
        n_place += prod(n_steps((0.0, each), ceiling.every_m) for each in np.ptp(building.outline, axis=0).tolist())
    if box is not None:
        n_place += prod(n_steps(each, box.every_m) for each in (box.x_m, box.y_m, box.z_m))
    n_yaw = n_steps(device.yaw_deg, device.yaw_every_deg) if device.yaw_deg else 1
    n_tilt = n_steps(device.tilt_deg, device.tilt_every_deg) if device.tilt_deg else 1
    return n_place * (1 if device.aim else n_yaw * n_tilt)


def _every_place(device: Device, building: Building, own_pitch_deg: float) -> list[Mount]:
    """Return every position, not yet turned: listed, along walls, below the ceiling, and in a box."""
    bases: list[Mount] = [Mount(xyz=each.xyz, yaw_deg=each.yaw_deg, pitch_deg=each.pitch_deg) for each in device.places]
    if device.walls is not None:
        walls = device.walls
        heights = steps(walls.height_m, walls.height_every_m)
        places, facing = building.along_walls(walls.every_m, walls.off_m, heights)
        for place, yaw in zip(places.tolist(), facing.tolist(), strict=True):
            x, y, z = place
            bases.append(Mount(xyz=(x, y, z), yaw_deg=degrees(yaw), pitch_deg=own_pitch_deg))
    if device.ceiling is not None:
        low, high = building.outline.min(axis=0), building.outline.max(axis=0)
        grid = [
            steps((a + device.ceiling.every_m / 2, b), device.ceiling.every_m) for a, b in zip(low, high, strict=True)
        ]
        places = np.array(list(product(*grid)))
        places = places[building.is_indoors(places)]
        heights = building.ceiling_m(places) - device.ceiling.off_m
        for (x, y), z in zip(places.tolist(), heights.tolist(), strict=True):
            if np.isfinite(z):
                bases.append(Mount(xyz=(x, y, z), pitch_deg=own_pitch_deg))
    if device.box is not None:
        axes = [steps(each, device.box.every_m) for each in (device.box.x_m, device.box.y_m, device.box.z_m)]
        bases += [Mount(xyz=(x, y, z), pitch_deg=own_pitch_deg) for x, y, z in product(*axes)]
    return bases


def _turned(device: Device, bases: list[Mount], middle: Array, *, is_camera: bool) -> list[Mount]:
    """Turn each mount in every direction, or to the middle (x, y) [m] of the tracked area."""
    turned = []
    for base in bases:
        if device.aim:
            x, y, z = base.xyz
            gap = hypot(middle[0] - x, middle[1] - y)
            yaw = degrees(atan2(middle[1] - y, middle[0] - x))
            pitch = degrees(atan2(z - _AIM_HEIGHT_M, gap)) if is_camera else base.pitch_deg
            turned.append(base.model_copy(update={"yaw_deg": yaw, "pitch_deg": pitch}))
            continue
        yaws = steps(device.yaw_deg, device.yaw_every_deg) if device.yaw_deg else [0.0]
        tilts = steps(device.tilt_deg, device.tilt_every_deg) if device.tilt_deg else [base.pitch_deg]
        turned += [
            base.model_copy(update={"yaw_deg": base.yaw_deg + yaw, "pitch_deg": tilt}) for yaw in yaws for tilt in tilts
        ]
    return turned


def _rounded(mount: Mount) -> Mount:
    """Round to the millimetre and a hundredth of a degree, finer than a plan can be read."""
    x, y, z = (round(each, 3) + 0.0 for each in mount.xyz)
    yaw = (mount.yaw_deg + 180) % 360 - 180
    return Mount(xyz=(x, y, z), yaw_deg=round(yaw, 2) + 0.0, pitch_deg=round(mount.pitch_deg, 2) + 0.0)


def _image(mount: Mount, device: Device) -> Mount:
    mirror = device.mirrored
    assert mirror is not None
    x, y, z = mount.xyz
    if mirror.x_m is not None:
        return _rounded(mount.model_copy(update={"xyz": (2 * mirror.x_m - x, y, z), "yaw_deg": 180 - mount.yaw_deg}))
    assert mirror.y_m is not None
    return _rounded(mount.model_copy(update={"xyz": (x, 2 * mirror.y_m - y, z), "yaw_deg": -mount.yaw_deg}))


def rejection_reasons(
    study: Study,
    building: Building,
    scene: Scene,
    scenario: Scenario,
    device: Device,
    mounts: list[tuple[Mount, ...]],
    held: list[Array],
    zones: Sequence[KeepFreeZone],
) -> dict[str, Mask]:
    """Return the mask (n,) of rejected candidate poses of a device by reason; zones: from `keep_free_zones`."""
    constraints, places = study.constraints, np.concatenate(held)

    def any_of(which: Mask) -> Mask:
        return np.asarray(which.reshape(len(held), -1).any(axis=1))

    first = scenario.sensors[device.sensors_in(scenario)[0]]
    if isinstance(first, FloorDescription):
        return {"not on the floor of the room": np.array([not _lies(first, scene, each) for each in mounts])}
    views = np.concatenate([_view_positions(device, scenario, each) for each in mounts])
    reasons = {
        "below the floor": any_of(places[:, 2] < 0),
        "outside the building": any_of(~building.is_indoors(views)),
        "inside a wall or a thing": any_of(building.is_solid(views)),
        f"where people walk below {constraints.walked_below_m:g} m": any_of(
            building.is_walked(places, constraints.walked_below_m)
        ),
    }
    role = first.role if isinstance(first, LaserDescription) and device.housing is None else None
    if role is not None and not any("role" in kind.set for kind in device.kinds):
        reasons[f"tilted too far for a {role} scanner"] = np.array([_is_steep(role, each) for each in mounts])
    for zone in zones:
        inside = Area(np.array(zone.polygon)).contains(places[:, :2])
        within = any_of(inside & (places[:, 2] >= zone.from_m) & (places[:, 2] <= zone.highest_m))
        reason = f"in the zone {zone.name!r}"
        reasons[reason] = reasons.get(reason, False) | within
    cable = constraints.cable
    if cable is not None and cable.most_m is not None:
        lengths_m = cable_lengths_m(study, building, held, len(mounts[0]))
        reasons[f"with more than {cable.most_m:g} m of cable"] = lengths_m.max(axis=1) > cable.most_m
    return reasons


def keep_free_zones(constraints: Constraints, building: Building, source: str) -> tuple[KeepFreeZone, ...]:
    """Return the zones without devices as polygons, one per doorway of those by doors, which keep their distance.

    Raises InputError, naming `source`, where the room has no doorway.
    """
    zones: list[KeepFreeZone] = []
    for place, zone in enumerate(constraints.keep_free):
        if zone.doors_m is None:
            zones.append(zone)
            continue
        if not (doors := doorways(building)):
            raise InputError(
                f"{source}: constraints.keep_free.{place}.doors_m: {zone.doors_m:g} m around doors, and the room has none; a gap "
                "in a wall, a geom called door, or a polygon is expected"
            )
        for door in doors:
            corners = tuple((float(x), float(y)) for x, y in door.zone(zone.doors_m).round(4))
            top_m = None if np.isinf(door.top_m) else door.top_m
            zones.append(
                zone.model_copy(update={"polygon": corners, "to_m": top_m if zone.to_m is None else zone.to_m})
            )
    return tuple(zones)


def cable_lengths_m(study: Study, building: Building, held: list[Array], n_device: int) -> Array:
    """Return the length of cable to each device, one or a pair, of each candidate pose, (n, n_device) [m].

    held: positions of each pose's sensors (k, 3) [m], device by device; a cable reaches the farthest sensor of its device. 0
    where cables do not count.
    """
    cable = study.constraints.cable
    if cable is None:
        return np.zeros((len(held), n_device))
    start = np.array(cable.start)
    places = np.concatenate(held)
    if cable.along == "straight":
        each = np.linalg.norm(places - start, axis=1)
    else:
        doors = doorways(building)
        each = np.array([cable_route(building, doors, start, place).length_m for place in places])
    return each.reshape(len(held), n_device, -1).max(axis=2)


def _is_steep(role: Role, mounts: tuple[Mount, ...]) -> bool:
    """Return True where a scanner is tilted too far to scan the layer of its role."""
    try:
        for mount in mounts:
            check_layer(role, mount.room_from_housing())
    except ValueError:
        return True
    return False


def _lies(floor: FloorDescription, scene: Scene, mounts: tuple[Mount, ...]) -> bool:
    """Return True where a pressure floor fits."""
    for mount in mounts:
        if mount.xyz[2] != 0 or mount.pitch_deg:
            return False
        try:
            there = {"xyz": mount.xyz, "yaw_deg": mount.yaw_deg}
            check_floor(floor.model_copy(update={"mount": floor.mount.model_copy(update=there)}), scene.floor, "")
        except InputError:
            return False
    return True
