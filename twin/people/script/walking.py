"""Walking: along a way around furniture to a place, through waypoints, or at random with sudden stops and turns."""

from __future__ import annotations

from collections.abc import Generator
from math import inf
from typing import Any

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.ground import standing_place
from twin.people.crowd.motion_command import End, MotionCommand
from twin.people.script.actor import Actor
from twin.scenario.behaviour import Run, Walk, Wander

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
        if not way:  # too close to furniture to find one: wait, since others may push
            yield MotionCommand(None, until=min(actor.t + _SHUT_IN_S, ends_at))
        for place in way:
            if (yield MotionCommand(place, speed, until)) != "arrived":
                break


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
    """Walk along a way; if others block it, wait and search again."""
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
                return
            if end == "taken":
                yield MotionCommand(None, until=actor.t + actor.rng.uniform(0.3, 1.0))
            if end in ("blocked", "taken"):
                break
        else:
            if way:
                return
            yield MotionCommand(None, until=actor.t + actor.rng.uniform(0.3, 1.0))


def _towards(actor: Actor, command: MotionCommand, face: Any) -> Commands:
    """Walk one stretch of the way, facing a person or an object meanwhile."""
    if face is None:
        return (yield command)
    while True:
        end = yield MotionCommand(
            command.goal,
            command.speed_m_s,
            actor.t + LOOKS_AGAIN_S,
            command.arrive_m,
            command.halt,
            actor.bearing_of(face),
            command.near,
        )
        if end != "time":
            return end
