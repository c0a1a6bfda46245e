"""Companions: walk behind or abreast of another person, or walk up to them and stand face to face."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, sin

import numpy as np

from twin.people.crowd.motion_command import MotionCommand
from twin.people.crowd.social_force import KEEP_APART_M
from twin.people.script.actor import Actor
from twin.people.script.walking import HALT_M, LOOKS_AGAIN_S, Commands
from twin.scenario.behaviour import Follow, Look, Meet

_WALKS_ON_M_S = 0.2
"""Speed below which the other is about to stand."""
_COMMANDS_EVERY_S = 0.1
_DRAWS_LEVEL_S = 0.5
"""Time constant for closing the gap to the place beside the other [s]."""
_STANDS_M_S = 0.2
_IN_PLACE_M = 0.12
_SEES_AHEAD_S = 1.5
"""Horizon for obstacles in the way of the person beside [s]."""
_BEHIND_M = 0.9
_BREADTH = 1.45
"""Breadth of a body with sleeves and sway, relative to the distance between its shoulder joints (ours)."""
_STAYS_BEHIND_S = 1.0
_SWINGS_OUT = 0.6
"""Sideways detour around the other's back, per metre of lag."""


def follow(actor: Actor, action: Follow) -> Commands:
    if action.beside is not None:
        yield from _walk_abreast(actor, action)
        return
    ends_at = actor.ends_at(action.for_s)
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
        yield MotionCommand(None, until=until)
        return
    goal = way[0] if len(way) > 1 else before
    yield MotionCommand(goal, speed_m_s, until, HALT_M, halt=len(way) == 1 and distance_m > 0)


def meet(actor: Actor, action: Meet) -> Commands:
    if not actor.has_left(action.person):
        actor.sets_out(actor.target(action.person), action.speed_m_s, action.person)
    while actor.distance_to(action.person) > action.distance_m + 0.1:
        if actor.has_left(action.person):
            actor.arrives()
            return
        if actor.distance_to(action.person) == inf:
            yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
            continue
        yield from _one_step_on(actor, action.person, action.speed_m_s, actor.t + 2 * LOOKS_AGAIN_S, action.distance_m)
    actor.arrives()
    ends_at = actor.t + action.for_s
    actor.look(Look(at=action.person))
    while actor.t < ends_at and not actor.has_left(action.person):
        actor.attract_gaze(action.person)
        yield MotionCommand(
            None, until=min(actor.t + 2 * LOOKS_AGAIN_S, ends_at), heading=actor.bearing_of(action.person)
        )
    actor.look(Look())


def _walk_abreast(actor: Actor, action: Follow) -> Commands:
    """Keep level with a person, or behind for a while (see `twin.scenario.behaviour.Follow`)."""
    crowd, other = actor.context.crowd, actor.context.number_of(action.person)
    ends_at, behind_until = actor.ends_at(action.for_s), -np.inf
    keeps_m = max(action.keeps_m, shoulders_m(actor, actor.number, other))
    lateral = keeps_m * (1j if action.beside == "left" else -1j)
    while actor.t < ends_at and not actor.has_left(action.person):
        until = min(actor.t + _COMMANDS_EVERY_S, ends_at)
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
        yield _keep_up(actor, action, other, goal, until, keeps_m)


def shoulders_m(actor: Actor, first: int, second: int) -> float:
    """Return the least distance of two people abreast, shoulder to shoulder, from middle to middle [m]."""
    return float(actor.context.postures.measures.shoulder_lateral[[first, second]].sum()) * _BREADTH


def _keep_up(actor: Actor, action: Follow, other: int, goal: complex, until: float, keeps_m: float) -> MotionCommand:
    """Return the next command: be at the future place beside the other, or stand there facing as they do."""
    crowd, here = actor.context.crowd, actor.context.crowd.place[actor.number]
    velocity = crowd.velocity[other]
    stands = abs(velocity) < _STANDS_M_S
    if stands and abs(goal - here) < _IN_PLACE_M:
        return MotionCommand(
            None, until=until, heading=float(crowd.heading[other]), companions=(other,), companion_m=keeps_m
        )
    soon = goal if stands else goal + velocity * _DRAWS_LEVEL_S
    speed = min(max(abs(soon - here) / _DRAWS_LEVEL_S, _STANDS_M_S), action.speed_m_s)
    way = actor.way_to((soon.real, soon.imag)) or actor.way_to(actor.target(action.person))
    if not way:
        return MotionCommand(None, until=until, companions=(other,), companion_m=keeps_m)
    return MotionCommand(
        way[0], speed, until, 0.05, halt=stands and len(way) == 1, companions=(other,), companion_m=keeps_m
    )


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
    for start, end in ((points[0], points[1]), (points[1], points[2])):
        way = routes.way(start, end)
        if way is None or len(way) > 1:
            return False
    others = crowd.present.copy()
    others[[actor.number, *together]] = False
    gap, drift = crowd.place[others] - adjacent, crowd.velocity[others] - velocity
    nearest_s = np.clip(-(gap * drift.conj()).real / np.maximum(np.abs(drift) ** 2, 1e-9), 0.0, ahead_s)
    return not (np.abs(gap + drift * nearest_s) < KEEP_APART_M).any()
