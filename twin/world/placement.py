"""Placement checks: a scenario's area and people must fit into its room and between its furniture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, hypot

import numpy as np

from trackers.area import TOLERANCE_M, Area
from trackers.arrays import Array
from trackers.errors import InputError, text_near_bound
from twin.geometry.polygon import leaves_at, strictly_within
from twin.people.crowd.crowd import planar
from twin.people.crowd.ground import entry_place, nearest_free, standing_place
from twin.people.crowd.routes import CLOSE_M, Routes
from twin.people.script.recorded import comes_at, curve_through, known_start
from twin.room.furniture import Bed, Seat
from twin.room.obstacles import KEEP_FROM_FURNITURE_M
from twin.scenario import Scenario
from twin.scenario.action import RecordedPath
from twin.scenario.behaviour import Bend, Leave, Reach, Run, Stand, Turn, TurnHead, Walk, Wander
from twin.scenario.person import Person
from twin.world.body_pool import keeps_path

_LOOKS_EVERY_S = 0.05
_LOOKS_EVERY_M = 0.05
_MOST_LOOKS = 100_000
DOOR_REACH_M = 0.6
"""Greatest distance from where people walk to a place in a door at which a person comes or leaves [m]."""
CLEARANCE_M = 0.5
"""Least distance between the middles of two people at the start, below which their bodies overlap [m]."""


def check_placement(
    scenario: Scenario, area: Array, walkable: Array, routes: Routes, fitting: set[Person] | None = None
) -> None:
    """Raise InputError where the tracked area or a person leaves the walkable area, a start lies in furniture or another
    person, or a goal is unreachable.

    area, walkable: simple polygons (k, 2) in the room frame [m]; routes: the ways between the furniture;
    fitting: people who fit between these, not checked again; extended.
    """
    source = scenario.source
    for corner, after in zip(area, np.roll(area, -1, axis=0), strict=True):
        _check_edge(walkable, corner, after, f"{source}: area")
    for name, person in scenario.people.items():
        if fitting is None or person not in fitting:
            _check_person(person, walkable, routes, f"{source}: people.{name}")
    if fitting is not None:
        fitting.update(scenario.people.values())
    placed: dict[str, Array] = {}
    for name, person in scenario.people.items():
        start = known_start(person)
        if start is None:
            continue
        here = np.array(start) if person.start is None else entry_place(np.array(start), walkable)
        field = f"{source}: people.{name}.{_start_field(person)}: {_point(here)}"
        if person.script and isinstance(person.script[0], Wander) and not strictly_within(area, here):
            raise InputError(f"{field} is not inside the area that a wanderer stays in; {_within(area)} is expected")
        if comes_at(person) > 0 or keeps_path(person):
            continue  # later arrivals wait for a free place, and recorded paths are fixed
        for other, there in placed.items():
            distance = float(np.linalg.norm(here - there))
            if distance < CLEARANCE_M:
                apart = text_near_bound(distance, CLEARANCE_M)
                raise InputError(
                    f"{field} is {apart} m from {other!r}, who starts at {_point(there)}: their bodies overlap; "
                    f"at least {CLEARANCE_M} m between people is expected"
                )
        placed[name] = here


def check_free(place: Array, routes: Routes, field: str, clear_m: float = KEEP_FROM_FURNITURE_M) -> None:
    """Raise InputError naming the field and the furniture where a place (2,) [m] is within `clear_m` of some."""
    gaps = routes.footprints.gaps(planar(place[None]))[1][0]
    if not len(gaps) or gaps.min() >= clear_m - TOLERANCE_M:
        return
    furniture = routes.obstacles[int(gaps.argmin())].furniture
    gap_m = text_near_bound(float(gaps.min()), clear_m)
    where = f"inside {furniture!r}" if gaps.min() <= 0 else f"only {gap_m} m from {furniture!r}"
    free = nearest_free(place, routes.area, routes.obstacles, clear_m)
    instead = f", {_point(free)} for instance," if free is not None else ""
    clear = f"at least {clear_m:g} m from furniture" if clear_m > 0 else "outside of furniture"
    raise InputError(f"{field}: {_point(place)} is {where}; a place {clear}{instead} is expected")


def check_way(start: Array, goal: Array, routes: Routes, field: str) -> None:
    """Raise InputError naming the field where furniture leaves no way from start to goal (2,) [m]."""
    if routes.way(start, goal) is None:
        raise InputError(
            f"{field}: furniture leaves no way from {_point(start)} to {_point(goal)}; places that a gap of "
            f"{2 * KEEP_FROM_FURNITURE_M:g} m leads to are expected"
        )


def check_approach(
    furniture: Seat | Bed, places: Sequence[Array], routes: Routes, field: str, faults: Sequence[str] = ()
) -> None:
    """Raise InputError naming the field where no place (2,) [m] before or beside a seat or bed is reachable.

    faults: why a body has no room on the left and on the right of a seat, in words.
    """
    if any(routes.reachable(place) for place in places):
        return
    place, is_seat = places[0], isinstance(furniture, Seat)
    gaps = routes.footprints.gaps(planar(place[None]))[1][0]
    others = [
        (gap, each.furniture)
        for gap, each in zip(gaps, routes.obstacles, strict=True)
        if each.furniture != furniture.furniture
    ]
    blocked = f", {min(others)[1]!r} is in the way" if others else ""
    reasons = " and ".join(dict.fromkeys(fault or "no way leads there" for fault in faults))
    aside = f", nor sit down from its side: {reasons}" if faults else ""
    raise InputError(
        f"{field}: nobody of this size can come to {_point(place)}, before the {'seat' if is_seat else 'bed'} "
        f"{furniture.name!r}{blocked}{aside}; free floor before it{' or beside it' if is_seat else ''} is expected: turn the "
        "site, whose x axis is where one faces, or move what stands there"
    )


def _check_person(person: Person, walkable: Array, routes: Routes, field: str) -> None:
    """Raise InputError where a start, a waypoint or the way between two lies outside the walkable area or in furniture."""
    here = None
    if person.start is not None:
        start = np.array(person.start)
        here = _at_door(start, entry_place(start, walkable), f"{field}.start")
        check_free(here, routes, f"{field}.start", KEEP_FROM_FURNITURE_M if here is start else CLOSE_M)
    for number, action in enumerate(person.script):
        where = f"{field}.{_script_field(person, number)}"
        match action:
            case Walk(waypoints=waypoints, repeat=repeat) | Run(waypoints=waypoints, repeat=repeat):
                stops = [np.array(waypoint) for waypoint in waypoints]
                for place, stop in enumerate(stops):
                    starts = place == number == 0 and person.start is None
                    clear_m = KEEP_FROM_FURNITURE_M if starts else CLOSE_M
                    _check_place(stop, walkable, routes, f"{where}.waypoints.{place}", clear_m)
                ways = [*([here] if here is not None else []), *stops, *(stops[:1] if repeat else [])]
                for before, after in pairwise(ways):
                    check_way(before, after, routes, f"{where}.waypoints")
                here = stops[-1]
            case Leave(to=to):
                _check_leaving(here, np.array(to), walkable, routes, f"{where}.to")
            case RecordedPath(points=points):
                _check_path(np.array(points), walkable, routes, f"{where}.points")
            case Stand() | Turn() | Bend() | Reach() | TurnHead():
                pass
            case _:
                here = None  # wandering, following and sitting continue from another place


def _check_leaving(here: Array | None, to: Array, walkable: Array, routes: Routes, field: str) -> None:
    """Raise InputError where the place to leave at cannot be approached from `here` (None: anywhere)."""
    place = _at_door(to, standing_place(to, walkable), field)
    check_free(place, routes, field, CLOSE_M)
    if here is not None:
        check_way(here, place, routes, field)
    elif not routes.reachable(place):
        raise InputError(f"{field}: furniture leaves no way to {_point(to)}; a place that can be reached is expected")


def _at_door(asked: Array, place: Array, field: str) -> Array:
    """Return the place (2,) [m] for one asked for in a door; raise InputError where this is farther out than doors are."""
    beyond_m = hypot(*(place - asked))
    if beyond_m > DOOR_REACH_M:
        beyond = text_near_bound(beyond_m, DOOR_REACH_M)
        raise InputError(
            f"{field}: {_point(asked)} is outside the room's walkable area; {beyond} m beyond where people walk is more "
            f"than the {DOOR_REACH_M:g} m of a door; a place in the room or in a door, {_point(place)} for instance, is expected"
        )
    return place


def _check_place(place: Array, walkable: Array, routes: Routes, field: str, clear_m: float) -> None:
    _check_point(walkable, place, field)
    check_free(place, routes, field, clear_m)


def _check_path(points: Array, walkable: Array, routes: Routes, field: str) -> None:
    """Raise InputError naming where a recorded path (k, 3) t, x, y, or the curve through it, is in a wall or furniture.

    Rows before the start are ignored.
    """
    area = Area(walkable, TOLERANCE_M)
    curve = curve_through(points)
    leaves = np.flatnonzero((points[:, 0] >= 0) & ~area.contains(points[:, 1:]))[:1]
    t = _times_along(points[: leaves[0] + 1] if leaves.size else points)
    places = curve(t)
    for number in np.flatnonzero(~area.contains(places))[:1]:
        _check_point(walkable, places[number], _path_position(points, float(t[number]), field))
    if len(routes.obstacles):
        inside = routes.footprints.gaps(planar(places))[1].min(axis=1) < -TOLERANCE_M
        for number in np.flatnonzero(inside)[:1]:
            check_free(places[number], routes, _path_position(points, float(t[number]), field), 0.0)


def _times_along(points: Array) -> Array:
    """Choose the times at which a path (k, 3) t, x, y is checked from t = 0 on: the rows, and between two as densely as
    needed.
    """
    looks = []
    for (t, x, y), (t2, x2, y2) in pairwise(points):
        if t2 > 0:
            # between two rows a monotone cubic is at most three times as fast as the straight line
            steps = min((t2 - t) / _LOOKS_EVERY_S, 3 * hypot(x2 - x, y2 - y) / _LOOKS_EVERY_M)
            looks.append(np.linspace(max(t, 0.0), t2, min(max(1, ceil(steps)), _MOST_LOOKS), endpoint=False))
    return np.concatenate([*looks, points[-1:, 0]])


def _path_position(points: Array, t: float, field: str) -> str:
    """Name a place on a path: at a row, or between two."""
    row = int(np.searchsorted(points[:, 0], t))
    if points[row, 0] == t:
        return f"{field}.{row}, at {t:g} s"
    return f"{field}, between {row - 1} and {row}, at {t:g} s"


def _check_point(walkable: Array, place: Array, field: str) -> None:
    if not Area(walkable, TOLERANCE_M).contains(place[None])[0]:
        raise InputError(
            f"{field}: {_point(place)} is outside the room's walkable area; {_within(walkable)} is expected"
        )


def _check_edge(walkable: Array, here: Array, after: Array, field: str) -> None:
    outside = leaves_at(walkable, here, after)
    if outside is not None:
        raise InputError(
            f"{field}: the edge from {_point(here)} to {_point(after)} is outside the room's walkable area at {_point(outside)}; "
            f"{_within(walkable)} is expected"
        )


def _start_field(person: Person) -> str:
    if person.start is not None:
        return "start"
    return f"{_script_field(person, 0)}.{'points' if keeps_path(person) else 'waypoints'}.0"


def _script_field(person: Person, number: int) -> str:
    """Name an action's field: a script of one action is written without brackets."""
    return "script" if len(person.script) == 1 else f"script.{number}"


def _within(area: Array) -> str:
    """Describe an area in words: a range per axis for an aligned rectangle, else the corners."""
    low, high = area.min(axis=0), area.max(axis=0)
    if len(area) == 4 and ((area == low) | (area == high)).all():
        return f"x {low[0]:g} to {high[0]:g} m, y {low[1]:g} to {high[1]:g} m"
    return f"a place in the polygon {_listed(area)}"


def _listed(corners: Array) -> str:
    return f"[{', '.join(_point(corner) for corner in corners)}]"


def _point(place: Array) -> str:
    return f"[{place[0]:.6g}, {place[1]:.6g}]"
