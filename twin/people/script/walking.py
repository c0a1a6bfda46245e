"""Walking: along a way around furniture to a place, through waypoints, or at random with sudden stops and turns.

Companions walk behind or abreast of another person, or walk up to them and stand face to face.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import cos, inf, sin
from typing import Any

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.ground import standing_place
from twin.people.crowd.motion_command import KEEP_APART_M, End, MotionCommand
from twin.people.script.actor import Actor
from twin.scenario.behaviour import Follow, Meet, Run, TurnHead, Walk, Wander

Commands = Generator[MotionCommand, End, Any]
"""Commands of an action; each is answered with the reason for which it ended."""

LOOKS_AGAIN_S = 0.1
"""Interval at which a condition or a moving person is checked again [s]."""
HALT_M = 0.05
"""Distance of arrival at a halting place [m]."""
_PASS_M = 0.2
_NEXT_TO_M = 0.02
"""Tolerance for arriving at the nearest standing place, of a corner for example [m]."""
_CANDIDATES = 6
_LEAST_WAY_M = 0.8
_LOOK_AHEAD_M = 1.0
_SHUT_IN_S = 0.5
FOR_A_WAY = "for a way out of where furniture leaves none"
_ASIDE_M, _ASIDE_M_S, _ASIDE_FOR_S = 0.6, 0.7, (0.5, 1.5)
"""Length of a step aside [m], its speed [m/s], and the least and the longest time that it takes [s]."""
_BESIDE_M = 0.8
"""Distance from a taken place within which people stop beside who is there [m]."""


def wander(actor: Actor, action: Wander) -> Commands:
    """Walk to a sequence of random places (see `twin.scenario.behaviour.Wander`)."""
    ends_at = actor.ends_at(action.for_s)
    walking = False
    rng = actor.rng
    while actor.t < ends_at:
        if walking and rng.random() < action.stop_share:
            walking = False
            yield MotionCommand(None, until=min(actor.t + rng.uniform(*action.stop_s), ends_at))
            continue
        walking = True
        goal = _goal(actor)
        speed = rng.uniform(*action.speed_m_s)
        until = min(actor.t + 0.3 + rng.exponential(action.stretch_s), ends_at)
        way = actor.way_to(goal)
        if way:
            actor.goes_on()
        else:  # too close to furniture to find one: wait, since others may push
            actor.waits(FOR_A_WAY)
            yield MotionCommand(None, until=min(actor.t + _SHUT_IN_S, ends_at))
        for place in way:
            if (yield MotionCommand(place, speed, until)) != "arrived":
                break


def for_a_way_to(person: str) -> str:
    """Return the words for a wait for a way to somebody."""
    return f"for a way to {person}, to whom furniture leaves none"


def _goal(actor: Actor) -> Array:
    """Choose, of a few random goals, the one with the freest first metre, so that nobody sets out into another's back."""
    here, others = actor.here, actor.others()
    goals = actor.free_places(_CANDIDATES)
    way = goals - here
    length = np.hypot(way[:, 0], way[:, 1])
    direction = way / np.maximum(length, 1e-9)[:, None]
    free = np.minimum(length / _LEAST_WAY_M, 1.0)
    if len(others):
        ahead = here + direction * np.minimum(length, _LOOK_AHEAD_M)[:, None]
        to_others = others - here
        along = np.clip(direction @ to_others.T, 0.0, _LOOK_AHEAD_M)  # (goals, others)
        nearest = np.linalg.norm(to_others - along[..., None] * direction[:, None], axis=-1).min(axis=1)
        crowded = np.linalg.norm(others - ahead[:, None], axis=-1).min(axis=1)
        free = free + np.minimum(nearest, 0.7) + np.minimum(crowded, 0.7)
    return goals[int(np.argmax(free))]


def walk(actor: Actor, action: Walk | Run) -> Commands:
    """Go through the waypoints at the action's speed [m/s]; over and over with `repeat`."""
    face = action.face if isinstance(action, Walk) else None
    while True:
        for place in action.waypoints:
            halt = place is action.waypoints[-1] and not action.repeat
            yield from walk_to(actor, place, action.speed_m_s, halt=halt, face=face)
        if not action.repeat:
            return
        if len(action.waypoints) == 1:
            yield MotionCommand(None)


def walk_to(
    actor: Actor,
    goal: Array | tuple[float, float],
    speed_m_s: float,
    *,
    halt: bool,
    face: Any = None,
    exactly: bool = False,
    what: str = "",
) -> Commands:
    """Walk around furniture to a place (2,) [m], named `what`."""
    actor.sets_out(goal, speed_m_s, what)
    yield from _by_a_way(actor, goal, speed_m_s, halt=halt, face=face, exactly=exactly)
    actor.arrives()


def _by_a_way(
    actor: Actor, goal: Array | tuple[float, float], speed_m_s: float, *, halt: bool, face: Any, exactly: bool
) -> Commands:
    """Walk along a way; if others block it, step aside, or wait where they are at the goal, and search again."""
    place_m = np.asarray(goal, dtype=float)
    near = actor.context.ground.routes.near(place_m)
    off_m = float(np.hypot(*(standing_place(place_m, actor.context.ground.walkable) - place_m)))
    pass_m = max(_PASS_M, off_m + _NEXT_TO_M)
    while True:
        way = actor.way_to(goal)
        for place in way:
            last = place is way[-1]
            arrive_m = HALT_M if (halt or exactly) and last else pass_m if last else _PASS_M
            end = yield from _towards(
                actor, MotionCommand(place, speed_m_s, inf, arrive_m, halt and last, near=near), face
            )
            if last and halt and end == "taken" and not exactly:
                if (apart_m := actor.distance_to((float(place_m[0]), float(place_m[1])))) > _BESIDE_M:
                    actor.misses(
                        f"stops {apart_m:.1f} m before [{place_m[0]:.6g}, {place_m[1]:.6g}], which others have taken"
                    )
                return
            if end == "taken":
                yield MotionCommand(None, until=actor.t + actor.rng.uniform(0.3, 1.0))
            if end == "blocked":
                yield from _step_aside(actor)
            if end in ("blocked", "taken"):
                break
        else:
            if way:
                return
            yield MotionCommand(None, until=actor.t + actor.rng.uniform(0.3, 1.0))


def _step_aside(actor: Actor) -> Commands:
    """Step to where others leave most room: of two in each other's way, one walks on meanwhile."""
    ways = np.exp(1j * (actor.rng.uniform(0, 2 * np.pi) + np.arange(_CANDIDATES) * (2 * np.pi / _CANDIDATES)))
    places = actor.here + _ASIDE_M * np.column_stack([ways.real, ways.imag])
    places = places[actor.context.ground.is_free(places)]
    others = actor.others()
    if len(places) and len(others):
        room = np.linalg.norm(places[:, None] - others, axis=2).min(axis=1)
        x, y = places[int(np.argmax(room))]
        until = actor.t + actor.rng.uniform(*_ASIDE_FOR_S)
        yield MotionCommand((float(x), float(y)), _ASIDE_M_S, until, HALT_M, halt=True)


def _towards(actor: Actor, command: MotionCommand, face: Any) -> Commands:
    """Walk one stretch of the way, facing a person or an object meanwhile."""
    if face is None:
        return (yield command)
    while True:
        end = yield replace(command, until=actor.t + LOOKS_AGAIN_S, heading=actor.bearing_of(face))
        if end != "time":
            return end


_WALKS_ON_M_S = 0.2
"""Speed below which the other is about to stand."""
_DRAWS_LEVEL_S = 0.5
"""Time constant for closing the gap to the place beside the other [s]."""
STANDS_M_S = 0.2
"""Speed below which others stand, and one is placed beside them where they are [m/s]."""
IN_PLACE_M = 0.12
"""Distance from one's place among others that is close enough while they stand [m]."""
_SEES_AHEAD_S = 1.5
"""Horizon for obstacles in the way of the person beside [s]."""
_BEHIND_M = 0.9
_BREADTH = 1.45
"""Breadth of a body with sleeves and sway, relative to the distance between its shoulder joints (ours)."""
_THROUGH_M, _CLEAR_M, _AROUND_RAD = 0.4, 0.1, 1.0
"""Distance within which a way leads through another [m]; room kept, and angle walked, around them [m, rad]."""
_STAYS_BEHIND_S = 1.0
_SWINGS_OUT = 0.6
"""Sideways detour around the other's back, per metre of lag."""


def follow(actor: Actor, action: Follow) -> Commands:
    """Keep the distance [m] to a person, behind or abreast, until the time is over or they leave."""
    if action.beside is not None:
        yield from _walk_abreast(actor, action)
        return
    ends_at = actor.ends_at(action.for_s)
    if actor.has_left(action.person):
        actor.misses(f"does not follow {action.person}, who has left")
    while actor.t < ends_at and not actor.has_left(action.person):
        until = min(actor.t + 2 * LOOKS_AGAIN_S, ends_at)
        gap = actor.distance_to(action.person) - action.keeps_m
        if gap == inf:
            yield MotionCommand(None, until=until)
            continue
        # speed proportional to the gap: it closes within about half a second and stays closed
        ahead = actor.speed_of(action.person)
        walks_on = ahead > _WALKS_ON_M_S
        if gap < (-ahead if walks_on else 0.1):
            yield MotionCommand(None, until=until, heading=actor.bearing_of(action.person))
        else:
            speed = min(action.speed_m_s, max(ahead + 2 * gap, _WALKS_ON_M_S))
            yield from _one_step_on(actor, action.person, speed, until, 0.0 if walks_on else action.keeps_m)


def _one_step_on(actor: Actor, person: str, speed_m_s: float, until: float, distance_m: float) -> Commands:
    """Walk for a short time towards a moving person, ending at a distance from them."""
    there, bearing = actor.target(person), actor.bearing_of(person)
    before = (float(there[0]) - distance_m * cos(bearing), float(there[1]) - distance_m * sin(bearing))
    way = actor.way_to(there) or actor.way_to(before)
    if not way:
        actor.waits(for_a_way_to(person))
        yield MotionCommand(None, until=until)
        return
    actor.goes_on()
    goal = way[0] if len(way) > 1 else before
    yield MotionCommand(goal, speed_m_s, until, HALT_M, halt=len(way) == 1 and distance_m > 0)


def meet(actor: Actor, action: Meet) -> Commands:
    """Walk up to a person, face them for a while, and give up if they leave."""
    if not actor.has_left(action.person):
        actor.sets_out(actor.target(action.person), action.speed_m_s, action.person)
    while actor.distance_to(action.person) > action.distance_m + 0.1:
        if actor.has_left(action.person):
            actor.arrives()
            actor.misses(f"does not meet {action.person}, who has left")
            return
        if actor.distance_to(action.person) == inf:
            yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
            continue
        yield from _one_step_on(actor, action.person, action.speed_m_s, actor.t + 2 * LOOKS_AGAIN_S, action.distance_m)
    actor.arrives()
    ends_at = actor.t + action.for_s
    actor.look(TurnHead(at=action.person))
    while actor.t < ends_at and not actor.has_left(action.person):
        actor.attract_gaze(action.person)
        yield MotionCommand(
            None, until=min(actor.t + 2 * LOOKS_AGAIN_S, ends_at), heading=actor.bearing_of(action.person)
        )
    actor.look(TurnHead())


def _walk_abreast(actor: Actor, action: Follow) -> Commands:
    """Keep level with a person, or behind for a while (see `twin.scenario.behaviour.Follow`)."""
    crowd, other = actor.context.crowd, actor.context.number_of(action.person)
    ends_at, behind_until = actor.ends_at(action.for_s), -np.inf
    keeps_m = max(action.keeps_m, shoulders_m(actor, actor.number, other))
    lateral = keeps_m * (1j if action.beside == "left" else -1j)
    while actor.t < ends_at and not actor.has_left(action.person):
        until = min(actor.t + LOOKS_AGAIN_S, ends_at)
        if not crowd.present[other]:
            yield MotionCommand(None, until=until)
            continue
        place, velocity, facing = crowd.place[other], crowd.velocity[other], crowd.facing[other]
        adjacent = place + lateral * facing
        if not has_room(actor, (other,), place, adjacent, velocity):
            behind_until = actor.t + _STAYS_BEHIND_S
        if actor.t >= behind_until:
            lags_m = ((adjacent - crowd.place[actor.number]) * facing.conjugate()).real
            goal = adjacent + _SWINGS_OUT * np.clip(lags_m, 0.0, 1.0) * lateral / keeps_m * facing
        else:
            goal = place - _BEHIND_M * facing
        goal = _around(complex(crowd.place[actor.number]), complex(goal), complex(place))
        stay = MotionCommand(None, until=until, companions=(other,), companion_m=keeps_m)
        yield keep_up(actor, other, goal, stay, action.speed_m_s, _DRAWS_LEVEL_S)


def _around(here: complex, goal: complex, other: complex) -> complex:
    """Return the goal [m], or a place on the way around the other, if the straight way there leads through them."""
    way, offset = goal - here, other - here
    along = min(max((offset * way.conjugate()).real / max(abs(way) ** 2, 1e-9), 0.0), 1.0)
    if along in (0.0, 1.0) or abs(offset - along * way) > _THROUGH_M:
        return goal
    turn = float(np.angle((goal - other) / (here - other)))
    step = np.sign(turn) * min(abs(turn), _AROUND_RAD)
    return other + (KEEP_APART_M + _CLEAR_M) * np.exp(1j * (np.angle(here - other) + step))


def shoulders_m(actor: Actor, first: int, second: int) -> float:
    """Return the least distance of two people abreast, shoulder to shoulder, from middle to middle [m]."""
    return float(actor.context.postures.measures.shoulder_lateral[[first, second]].sum()) * _BREADTH


def keep_up(
    actor: Actor, other: int, goal: complex, stay: MotionCommand, speed_m_s: float, draws_level_s: float
) -> MotionCommand:
    """Return the next command: be at one's future place `goal` beside another, or stand there facing as they do.

    other: index of the person beside; stay: the command to stand among one's companions; speed_m_s: greatest speed;
    draws_level_s: time constant for closing the gap to one's place [s].
    """
    crowd, here = actor.context.crowd, actor.context.crowd.place[actor.number]
    velocity = crowd.velocity[other]
    stands = abs(velocity) < STANDS_M_S
    if stands and abs(goal - here) < IN_PLACE_M:
        return replace(stay, heading=float(crowd.heading[other]))
    soon = goal if stands else goal + velocity * draws_level_s
    speed = min(max(abs(soon - here) / draws_level_s, STANDS_M_S), speed_m_s)
    way = actor.way_to((soon.real, soon.imag)) or actor.way_to(actor.place_of(other))
    if not way:
        actor.waits(for_a_way_to(actor.context.names[other]))
        return stay
    actor.goes_on()
    return replace(stay, goal=way[0], speed_m_s=speed, arrive_m=HALT_M, halt=stands and len(way) == 1)


def has_room(
    actor: Actor,
    together: Sequence[int],
    place: complex,
    adjacent: complex,
    velocity: complex,
    ahead_s: float = _SEES_AHEAD_S,
) -> bool:
    """Return whether the place beside a person is free, and stays so for `ahead_s` as they go on.

    together: indices of the people who walk together and do not block each other.
    """
    routes, crowd = actor.context.ground.routes, actor.context.crowd
    points = [np.array([at.real, at.imag]) for at in (place, adjacent, adjacent + velocity * ahead_s)]
    if not all(routes.is_straight(start, end) for start, end in pairwise(points)):
        return False
    others = crowd.present.copy()
    others[[actor.number, *together]] = False
    gap, drift = crowd.place[others] - adjacent, crowd.velocity[others] - velocity
    nearest_s = np.clip(-(gap * drift.conj()).real / np.maximum(np.abs(drift) ** 2, 1e-9), 0.0, ahead_s)
    return not (np.abs(gap + drift * nearest_s) < KEEP_APART_M).any()
