"""Why a device of a study may not be mounted somewhere: the room, the study's constraints, and the cable to it."""

from __future__ import annotations

import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from twin.room.building import Building
from twin.scenario import Scenario
from twin.scenario.floor import FloorDescription, check_floor
from twin.scenario.mount import Mount
from twin.studies.description import Study
from twin.studies.mounts import first_sensor
from twin.studies.moves import Move
from twin.world.scene import Scene


def reasons_against(
    study: Study,
    building: Building,
    scene: Scene,
    scenario: Scenario,
    move: Move,
    mounts: list[tuple[Mount, ...]],
    held: list[Array],
) -> dict[str, Mask]:
    """By reason, which of a device's options (n,) it is against."""
    constraints, places = study.constraints, np.concatenate(held)

    def any_of(which: Mask) -> Mask:
        return np.asarray(which.reshape(len(held), -1).any(axis=1))

    first = scenario.sensors[first_sensor(move, scenario)]
    if isinstance(first, FloorDescription):
        return {"not on the floor of the room": np.array([not _lies(first, scene, each) for each in mounts])}
    reasons = {
        "below the floor": any_of(places[:, 2] < 0),
        "outside the building": any_of(~building.is_indoors(places)),
        "inside a wall or a thing": any_of(building.is_solid(places)),
        f"where people walk below {constraints.walked_below_m:g} m": any_of(
            building.is_walked(places, constraints.walked_below_m)
        ),
    }
    for zone in constraints.keep_free:
        inside = Area(np.array(zone.polygon)).contains(places[:, :2])
        reasons[f"in the zone {zone.name!r}"] = any_of(
            inside & (places[:, 2] >= zone.from_m) & (places[:, 2] <= zone.to_m)
        )
    cable = constraints.cable
    if cable is not None and cable.most_m is not None:
        reasons[f"with more than {cable.most_m:g} m of cable"] = cable_lengths_m(study, building, held) > cable.most_m
    return reasons


def cable_lengths_m(study: Study, building: Building, held: list[Array]) -> Array:
    """Length of cable to each option (n,) [m], to each of a pair; 0 where cables are not counted."""
    cable = study.constraints.cable
    if cable is None:
        return np.zeros(len(held))
    start = np.array(cable.start)
    places = np.concatenate(held)
    straight = cable.along == "straight"
    each = np.linalg.norm(places - start, axis=1) if straight else building.way_along_walls_m(start, places)
    per = len(held[0])
    return each.reshape(len(held), per).max(axis=1)


def _lies(floor: FloorDescription, scene: Scene, mounts: tuple[Mount, ...]) -> bool:
    """Whether a pressure floor can lie there."""
    for mount in mounts:
        if mount.xyz[2] != 0 or mount.pitch_deg:
            return False
        try:
            there = {"xyz": mount.xyz, "yaw_deg": mount.yaw_deg}
            check_floor(floor.model_copy(update={"mount": floor.mount.model_copy(update=there)}), scene.floor, "")
        except InputError:
            return False
    return True
