"""Resolve `room`, `people` and `sensors` of `kind: drawn` in a scenario into plain entries and a room's file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.configuration import validate
from trackers.errors import InputError
from twin.drawn.distributions import DrawnPeople, DrawnRoom, DrawnSensors
from twin.drawn.draw_building import DrawnBuilding, draw_building
from twin.drawn.draw_people import draw_people
from twin.drawn.draw_sensors import draw_sensors

FIELDS = ("room", "people", "sensors")


def is_drawn(content: dict[str, Any]) -> bool:
    """Return whether a scenario's content has parts to draw."""
    return any(_asks(content, field) for field in FIELDS)


def draw_scene(content: dict[str, Any], source: str, keep_room: Callable[[str, str], str]) -> dict[str, Any]:
    """Return a scenario's content with its drawn parts filled in.

    content: plain data with `seed` and `duration_s`. keep_room: given a name and the MJCF, writes the room's file and
    returns the path for the entry `room`. People and sensors are drawn only into drawn rooms. Raises InputError, naming
    `source`.
    """
    room = content.get("room")
    if not _asks(content, "room"):
        field = next(each for each in FIELDS if _asks(content, each))
        raise InputError(f"{source}: {field}: can be drawn into a drawn room only; room: {{kind: drawn}} is expected")
    seed, duration_s = content.get("seed", 0), content.get("duration_s")
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        return content | {"room": "drawn"}  # the scenario's own check reports it
    if isinstance(duration_s, bool) or not isinstance(duration_s, int | float) or not duration_s > 0:
        duration_s = 20.0
    options = validate(DrawnRoom, room, f"{source}: room")
    building = _building(options, seed, source)
    digest = hashlib.sha256(building.mjcf.encode()).hexdigest()[:16]
    drawn = content | {"room": keep_room(f"drawn_{digest}", building.mjcf)}
    if _asks(content, "people"):
        people = validate(DrawnPeople, content["people"], f"{source}: people")
        drawn["people"] = draw_people(people, building, float(duration_s), seed)
    if _asks(content, "sensors"):
        sensors = validate(DrawnSensors, content["sensors"], f"{source}: sensors")
        rig = draw_sensors(sensors, building, float(duration_s), seed, _starts(drawn.get("people")))
        drawn["sensors"] = rig.pop("sensors")
        for field, entries in rig.items():
            own = content.get(field)
            drawn[field] = entries | (own if isinstance(own, dict) else {})
    return drawn


def _building(options: DrawnRoom, seed: int, source: str) -> DrawnBuilding:
    try:
        return draw_building(options, seed, "drawn")
    except ValueError as error:
        raise InputError(f"{source}: room: {error}") from error


def _starts(people: Any) -> NDArray[np.float64]:
    """Return where people start (n, 2) [m], those whose start is given."""
    each = people.values() if isinstance(people, dict) else ()
    found = [person["start"] for person in each if isinstance(person, dict) and "start" in person]
    try:
        return np.array(found, float).reshape(-1, 2)
    except (TypeError, ValueError):
        return np.empty((0, 2))  # the scenario's own check reports it


def _asks(content: dict[str, Any], field: str) -> bool:
    """Return whether a field is a mapping with `kind: drawn`; a person or sensor named kind is a mapping itself."""
    entry = content.get(field)
    return isinstance(entry, dict) and entry.get("kind") == "drawn"
