"""Starts of people: place, heading and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

import numpy as np

from trackers.arrays import Array
from trackers.errors import InputError
from twin.people.crowd.ground import Ground
from twin.scenario.behaviour import RecordedPath, Run, Walk
from twin.scenario.person import Person

Point = tuple[float, float]

_CANDIDATES = 200
_APART_M = 0.75
"""Least distance between the middles of two people at the start."""


def known_start(person: Person) -> Point | None:
    """Return the described start x, y [m]; None: a place is drawn.

    As given, the beginning of a recorded path, or the first waypoint of a walk.
    """
    if person.start is not None or not person.script:
        return person.start
    match person.script[0]:
        case RecordedPath() as path:
            return path.points[0][1:]
        case Walk(waypoints=waypoints) | Run(waypoints=waypoints):
            return waypoints[0]
        case _:
            return None


def start_places(
    names: Sequence[str], people: Sequence[Person], ground: Ground, random: Sequence[np.random.Generator], source: str
) -> Array:
    """Return the starts of all people, (n, 2) [m]: as described, or drawn in the area, clear of furniture and of those
    placed.

    Raises InputError where the area has no room left.
    """
    places = {
        number: np.array(start) for number, person in enumerate(people) if (start := known_start(person)) is not None
    }
    for number, name in enumerate(names):
        if number in places:
            continue
        candidates = ground.free_places(_CANDIDATES, random[number])
        # people on recorded paths and later arrivals are avoided when they come
        taken = [place for other, place in places.items() if comes_at(people[other]) <= comes_at(people[number])]
        if taken:
            clear = np.linalg.norm(candidates[:, None] - np.array(taken), axis=-1).min(axis=1) >= _APART_M
            candidates = candidates[clear]
        if not len(candidates):
            raise InputError(
                f"{source}: people.{name}: no place in the area is {_APART_M} m from everybody else; "
                f"fewer people than {len(people)}, or a larger area, are expected"
            )
        places[number] = candidates[0]
    return np.array([places[number] for number in range(len(people))], dtype=float).reshape(-1, 2)


def comes_at(person: Person) -> float:
    """Return the time at which a person enters the room [s]."""
    if person.script and isinstance(person.script[0], RecordedPath):
        return max(0.0, person.script[0].points[0][0])
    return person.arrive_s


def describe_late_actions(people: Mapping[str, Person], duration_s: float) -> list[str]:
    """Return one sentence per person and action that does not begin before the end of the run at `duration_s` [s]."""
    messages = []
    never = [name for name, person in people.items() if comes_at(person) >= duration_s]
    if len(never) > 1:
        messages.append(
            f"people: {len(never)} never come, as the end at {duration_s:g} s is before: {', '.join(never)}"
        )
    for name, person in people.items():
        if name in never:
            if len(never) == 1:
                messages.append(
                    f"people.{name}.arrive_s: {comes_at(person):g} s is after the end at {duration_s:g} s: never comes"
                )
            continue
        messages += [
            f"people.{name}.script.{place}.at_s: {action.at_s:g} s is after the end at {duration_s:g} s: never done"
            for place, action in enumerate(person.script)
            if action.at_s is not None and action.at_s >= duration_s
        ]
    return messages


def first_heading(person: Person, start: Array, rng: np.random.Generator) -> float:
    """Return a person's initial heading [rad]: as given, towards the first waypoint elsewhere, or random."""
    drawn = float(rng.uniform(-np.pi, np.pi))
    if person.heading_deg is not None:
        return float(np.deg2rad(person.heading_deg))
    match person.script[0] if person.script else None:
        case RecordedPath(points=points):
            waypoints = [point[1:] for point in points]
        case Walk(waypoints=waypoints) | Run(waypoints=waypoints):
            pass
        case _:
            return drawn
    for x, y in waypoints:
        if hypot(x - start[0], y - start[1]) > 0.3:
            return float(np.arctan2(y - start[1], x - start[0]))
    return drawn
