"""Where a device of a study may be mounted: every place turned every way, and where its sensors are then."""

from __future__ import annotations

from itertools import product
from math import atan2, degrees, hypot

import numpy as np

from trackers.arrays import Array
from twin.room.building import Building
from twin.scenario import Scenario
from twin.scenario.floor import FloorDescription
from twin.scenario.housings import in_the_room
from twin.scenario.mount import Mount, mount_of
from twin.scenario.sensors import CAMERA_KINDS
from twin.studies.moves import Move, steps
from twin.world.scene import Scene

_AIM_HEIGHT_M = 1.0


def first_sensor(move: Move, scenario: Scenario) -> str:
    """The sensor by which a device is described."""
    if move.housing is not None:
        return next(name for name, each in scenario.sensors.items() if getattr(each, "housing", None) == move.housing)
    return (*move.sensors, *move.together)[0]


def inner_mounts(move: Move, scenario: Scenario) -> list[Mount]:
    """Where the sensors of a device are in its own frame: that of its first sensor, or of its housing."""
    if move.housing is not None:
        on_it = [each for each in scenario.sensors.values() if getattr(each, "housing", None) == move.housing]
        return [each.mount for each in on_it]  # pyright: ignore[reportReturnType]
    if move.sensors:
        return [Mount(xyz=(0.0, 0.0, 0.0))]
    first, *_ = hung = [in_the_room(scenario, name).mount.room_from_housing() for name in move.together]  # pyright: ignore
    back = first.rotation.T
    return [mount_of(back @ each.rotation, back @ (each.translation - first.translation)) for each in hung]


def positions_at(move: Move, scenario: Scenario, mounts: tuple[Mount, ...]) -> Array:
    """Where all sensors of a device (or pair) at these mounts are, (k, 3) [m]."""
    return np.array([mount.carrying(inner).xyz for mount in mounts for inner in inner_mounts(move, scenario)])


def every_mount(move: Move, scenario: Scenario, building: Building, scene: Scene) -> list[tuple[Mount, ...]]:
    """Every place turned every way, with its mirror image where there is one; yaw and tilt in the room."""
    first = first_sensor(move, scenario)
    described = scenario.sensors[first]
    lies = isinstance(described, FloorDescription)
    own_pitch_deg = 0.0 if lies else in_the_room(scenario, first).mount.pitch_deg  # pyright: ignore[reportAttributeAccessIssue]
    bases = _every_place(move, building, own_pitch_deg)
    turned = _turned(move, bases, scene.area.mean(axis=0), is_camera=described.kind in CAMERA_KINDS)
    rounded = [_rounded(each) for each in turned]
    return [(each,) if move.mirrored is None else (each, _image(each, move)) for each in rounded]


def _every_place(move: Move, building: Building, own_pitch_deg: float) -> list[Mount]:
    """Every place, not yet turned: those it names, along walls and below the ceiling, and in a box."""
    bases: list[Mount] = [Mount(xyz=each.xyz, yaw_deg=each.yaw_deg, pitch_deg=each.pitch_deg) for each in move.places]
    if move.walls is not None:
        walls = move.walls
        heights = steps(walls.height_m, walls.height_every_m)
        places, facing = building.along_walls(walls.every_m, walls.off_m, heights)
        for place, yaw in zip(places.tolist(), facing.tolist(), strict=True):
            x, y, z = place
            bases.append(Mount(xyz=(x, y, z), yaw_deg=degrees(yaw), pitch_deg=own_pitch_deg))
    if move.ceiling is not None:
        low, high = building.outline.min(axis=0), building.outline.max(axis=0)
        grid = [steps((a + move.ceiling.every_m / 2, b), move.ceiling.every_m) for a, b in zip(low, high, strict=True)]
        places = np.array(list(product(*grid)))
        places = places[building.is_indoors(places)]
        heights = building.ceiling_m(places) - move.ceiling.off_m
        for (x, y), z in zip(places.tolist(), heights.tolist(), strict=True):
            if np.isfinite(z):
                bases.append(Mount(xyz=(x, y, z), pitch_deg=own_pitch_deg))
    if move.box is not None:
        axes = [steps(each, move.box.every_m) for each in (move.box.x_m, move.box.y_m, move.box.z_m)]
        bases += [Mount(xyz=(x, y, z), pitch_deg=own_pitch_deg) for x, y, z in product(*axes)]
    return bases


def _turned(move: Move, bases: list[Mount], middle: Array, *, is_camera: bool) -> list[Mount]:
    """Each place turned every way, or to the middle (x, y) [m] of where people walk."""
    turned = []
    for base in bases:
        if move.aim:
            x, y, z = base.xyz
            gap = hypot(middle[0] - x, middle[1] - y)
            yaw = degrees(atan2(middle[1] - y, middle[0] - x))
            pitch = degrees(atan2(z - _AIM_HEIGHT_M, gap)) if is_camera else base.pitch_deg
            turned.append(base.model_copy(update={"yaw_deg": yaw, "pitch_deg": pitch}))
            continue
        yaws = steps(move.yaw_deg, move.yaw_every_deg) if move.yaw_deg else [0.0]
        tilts = steps(move.tilt_deg, move.tilt_every_deg) if move.tilt_deg else [base.pitch_deg]
        turned += [
            base.model_copy(update={"yaw_deg": base.yaw_deg + yaw, "pitch_deg": tilt}) for yaw in yaws for tilt in tilts
        ]
    return turned


def _rounded(mount: Mount) -> Mount:
    """To the millimetre and a hundredth of a degree: what somebody with a drill can read off a plan, and more."""
    x, y, z = (round(each, 3) + 0.0 for each in mount.xyz)
    yaw = (mount.yaw_deg + 180) % 360 - 180
    return Mount(xyz=(x, y, z), yaw_deg=round(yaw, 2) + 0.0, pitch_deg=round(mount.pitch_deg, 2) + 0.0)


def _image(mount: Mount, move: Move) -> Mount:
    mirror = move.mirrored
    assert mirror is not None
    x, y, z = mount.xyz
    if mirror.x_m is not None:
        return _rounded(mount.model_copy(update={"xyz": (2 * mirror.x_m - x, y, z), "yaw_deg": 180 - mount.yaw_deg}))
    assert mirror.y_m is not None
    return _rounded(mount.model_copy(update={"xyz": (x, 2 * mirror.y_m - y, z), "yaw_deg": -mount.yaw_deg}))
