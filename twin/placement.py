"""Whether a scenario's area and people fit into its room, checked before anything is built."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.errors import InputError
from twin.people.scripts import known_start
from twin.polygon import TOLERANCE_M, leaves_at, meets_itself_at, strictly_inside
from twin.scenario import Scenario
from twin.scenario.people import Person, Walk, Wander

Array = NDArray[np.float64]

CLEARANCE_M = 0.5
"""Least distance between the middles of two people at the start: below it their bodies overlap [m]."""


def check_polygon(corners: Array, field: str) -> None:
    """Raise InputError naming the field where the polygon (k, 2) [m] crosses or touches itself."""
    place = meets_itself_at(corners)
    if place is not None:
        raise InputError(
            f"{field}: {_listed(corners)} crosses or touches itself at {_point(place)}; "
            "corners in their order around the area, each once, are expected"
        )


def check_placement(scenario: Scenario, area: Array, walkable: Array | None) -> None:
    """Raise InputError where the tracked area or a person leaves the walkable area, or two people start in each other.

    area, walkable: simple polygons (k, 2) in the room frame [m]; walkable None: the room does not say, and only what
    the people ask of each other and of the tracked area is checked.
    """
    source = f"scenario {scenario.name!r}"
    if walkable is not None:
        for corner, after in zip(area, np.roll(area, -1, axis=0), strict=True):
            _check_way(walkable, corner, after, f"{source}: area: the edge")
        for name, person in scenario.people.items():
            _check_person(person, walkable, f"{source}: people.{name}")
    placed: dict[str, Array] = {}
    for name, person in scenario.people.items():
        start = known_start(person)
        if start is None:
            continue
        here = np.array(start)
        field = f"{source}: people.{name}.{_start_field(person)}: {_point(here)}"
        if isinstance(person.script, Wander) and not strictly_inside(area, here):
            raise InputError(f"{field} is not inside the area that a wanderer stays in; {_within(area)} is expected")
        for other, there in placed.items():
            distance = float(np.linalg.norm(here - there))
            if distance < CLEARANCE_M:
                raise InputError(
                    f"{field} is {distance:.2f} m from {other!r}, who starts at {_point(there)}: their bodies overlap; "
                    f"at least {CLEARANCE_M} m between people is expected"
                )
        placed[name] = here


def _check_person(person: Person, walkable: Array, field: str) -> None:
    """Raise InputError where a start, a waypoint or the straight way between two lies outside the walkable area."""
    if person.start is not None:
        _check_point(walkable, np.array(person.start), f"{field}.start")
    if not isinstance(person.script, Walk):
        return
    waypoints = [np.array(waypoint) for waypoint in person.script.waypoints]
    for number, waypoint in enumerate(waypoints):
        _check_point(walkable, waypoint, f"{field}.script.waypoints.{number}")
    stops = [*([np.array(person.start)] if person.start is not None else []), *waypoints]
    if person.script.repeat:
        stops.append(waypoints[0])
    for here, after in pairwise(stops):
        _check_way(walkable, here, after, f"{field}.script.waypoints: the straight way")


def _check_point(walkable: Array, place: Array, field: str) -> None:
    if not Area(walkable, TOLERANCE_M).contains(place[None])[0]:
        raise InputError(
            f"{field}: {_point(place)} is outside the room's walkable area; {_within(walkable)} is expected"
        )


def _check_way(walkable: Array, here: Array, after: Array, field: str) -> None:
    outside = leaves_at(walkable, here, after)
    if outside is not None:
        raise InputError(
            f"{field} from {_point(here)} to {_point(after)} is outside the room's walkable area at {_point(outside)}; "
            f"{_within(walkable)} is expected"
        )


def _start_field(person: Person) -> str:
    return "start" if person.start is not None else "script.waypoints.0"


def _within(area: Array) -> str:
    """Where one may be, in words: a range each for a rectangle along the axes, else the corners."""
    low, high = area.min(axis=0), area.max(axis=0)
    if len(area) == 4 and ((area == low) | (area == high)).all():
        return f"x {low[0]:g} to {high[0]:g} m, y {low[1]:g} to {high[1]:g} m"
    return f"a place in the polygon {_listed(area)}"


def _listed(corners: Array) -> str:
    return f"[{', '.join(_point(corner) for corner in corners)}]"


def _point(place: Array) -> str:
    return f"[{place[0]:g}, {place[1]:g}]"
