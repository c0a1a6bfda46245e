"""What each action of a script means, as orders one after another.

An action is a generator: it yields an order, and is resumed with the reason for which the order ended.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from math import cos, inf, pi, radians, sin
from typing import Any

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.order import End, Order
from twin.people.crowd.places import standing_place
from twin.people.posture.posture import Part
from twin.people.script.abreast import walk_beside
from twin.people.script.actor import Actor, Going
from twin.people.script.wandering import wander
from twin.room.furniture import Bed, Seat
from twin.scenario.behaviour import (
    Action,
    Bend,
    Condition,
    Follow,
    Leave,
    Lie,
    Look,
    Meet,
    Path,
    Reach,
    Run,
    Sit,
    Stand,
    Turn,
    Walk,
    Wander,
)  # fmt: skip

Doing = Generator[Order, End, Any]

_LOOKS_AGAIN_S = 0.1
"""How often a condition, or somebody who moves, is looked at [s]."""
_PASS_M = 0.2
_HALT_M = 0.05
_WALKS_ON_M_S = 0.2
"""Whoever is slower is about to stand."""
_FACING_RAD = radians(3)
_TURNS_AT_ONCE_DEG = 150.0
_STEPS_AWAY_M = 0.28
"""From where one stands up to where ways begin [m]."""
_STEPS_BACK_M_S = 0.5
_STEPS_BACK_FOR_S = 3.0
_STANDS_FOR_S = 0.6


def perform(actor: Actor, script: Sequence[Action]) -> Doing:
    """One action after another, then stand for ever."""
    for action in script:
        yield from _wait_for(actor, action)
        actor.stage.doing[actor.number] = action.kind
        yield from _DOING[type(action)](actor, action)
    actor.stage.doing[actor.number] = "stand"
    while True:
        yield Order(None)


def _wait_for(actor: Actor, action: Action) -> Doing:
    actor.stage.doing[actor.number] = "stand"
    if action.at_s is not None and actor.t < action.at_s:
        yield Order(None, until=action.at_s)
    while action.when is not None and not _holds(actor, action.when):
        yield Order(None, until=actor.t + _LOOKS_AGAIN_S)


def _holds(actor: Actor, condition: Condition) -> bool:
    if condition.near is not None and condition.within_m is not None:
        return actor.distance_to(condition.near) <= condition.within_m
    stage = actor.stage
    return condition.person is not None and stage.doing[stage.number_of(condition.person)] == condition.does


def _upright(actor: Actor) -> Doing:
    """Stand up, whoever sits, lies or bends."""
    postures, number = actor.stage.postures, actor.number
    if postures.may_walk()[number]:
        return
    postures.rise(number)
    yield Order(None, firm=True, done=lambda: bool(postures.may_walk()[number]))
    yield from _step_away(actor)


def _walk_to(
    actor: Actor,
    goal: Array | tuple[float, float],
    speed_m_s: float,
    *,
    halt: bool,
    face: Any = None,
    exactly: bool = False,
    what: str = "",
) -> Doing:
    """Around furniture to a place, called `what` where it has a name."""
    actor.sets_out(goal, speed_m_s, what)
    yield from _by_a_way(actor, goal, speed_m_s, halt=halt, face=face, exactly=exactly)
    actor.arrives()


def _by_a_way(
    actor: Actor, goal: Array | tuple[float, float], speed_m_s: float, *, halt: bool, face: Any, exactly: bool
) -> Doing:
    """Along a way; where others stand in it, wait a moment and look for a way again."""
    near = actor.stage.ground.routes.near(np.asarray(goal, dtype=float))
    while True:
        way = actor.way_to(goal)
        for place in way:
            last = place is way[-1]
            arrive_m = _HALT_M if (halt or exactly) and last else _PASS_M
            end = yield from _towards(actor, Order(place, speed_m_s, inf, arrive_m, halt and last, near=near), face)
            if last and halt and end == "taken" and not exactly:
                return
            if end == "taken":
                yield Order(None, until=actor.t + actor.rng.uniform(0.3, 1.0))
            if end in ("blocked", "taken"):
                break
        else:
            if way:
                return
            yield Order(None, until=actor.t + actor.rng.uniform(0.3, 1.0))


def _towards(actor: Actor, order: Order, face: Any) -> Doing:
    """One stretch of the way, facing somebody or something meanwhile."""
    if face is None:
        return (yield order)
    while True:
        end = yield Order(
            order.goal,
            order.speed_m_s,
            actor.t + _LOOKS_AGAIN_S,
            order.arrive_m,
            order.halt,
            actor.bearing_of(face),
            order.near,
        )
        if end != "time":
            return end


def _turn_to(actor: Actor, heading: float) -> Doing:
    def faces() -> bool:
        off = (heading - actor.heading + pi) % (2 * pi) - pi
        return abs(off) < _FACING_RAD

    yield Order(None, heading=heading, done=faces)


def _stand(actor: Actor, action: Stand) -> Doing:
    yield from _upright(actor)
    yield Order(None, until=actor.ends_at(action.for_s), firm=True)


def _walk(actor: Actor, action: Walk | Run) -> Doing:
    yield from _upright(actor)
    face = action.face if isinstance(action, Walk) else None
    while True:
        for place in action.waypoints:
            halt = place is action.waypoints[-1] and not action.repeat
            yield from _walk_to(actor, place, action.speed_m_s, halt=halt, face=face)
        if not action.repeat:
            return
        if len(action.waypoints) == 1:
            yield Order(None)


def _turn(actor: Actor, action: Turn) -> Doing:
    yield from _upright(actor)
    if action.towards is not None:
        heading = actor.bearing_of(action.towards)
    elif action.to_deg is not None:
        heading = radians(action.to_deg)
    else:
        # a turn of more than half a circle goes the way it says, in parts
        by, heading = action.by_deg or 0.0, actor.heading
        while abs(by) > _TURNS_AT_ONCE_DEG:
            part = _TURNS_AT_ONCE_DEG if by > 0 else -_TURNS_AT_ONCE_DEG
            heading, by = heading + radians(part), by - part
            yield from _turn_to(actor, heading)
        heading += radians(by)
    yield from _turn_to(actor, heading)


def _rest(actor: Actor, action: Sit | Lie) -> Doing:
    """Sit or lie down on what the room has for it, and get up when the time is over."""
    name = action.seat if isinstance(action, Sit) else action.bed
    if isinstance(action, Sit) and action.seated:  # as everybody began
        yield from _settled(actor, action.for_s, "body")
        yield from _upright(actor)
        return
    yield from _go_and_take(actor, name)
    match actor.stage.ground.furniture[name]:
        case Seat() as seat:
            actor.stage.postures.sit(actor.number, seat)
        case Bed() as bed:
            actor.stage.postures.lie(actor.number, bed)
    yield from _settled(actor, action.for_s, "body")
    yield from _upright(actor)


def _go_and_take(actor: Actor, name: str) -> Doing:
    """Stand before a seat or bed, the back to it, when nobody else uses it."""
    stage, number = actor.stage, actor.number
    yield from _upright(actor)
    if name in stage.taken:
        stage.going[number] = Going(name, actor.t, 0.0)
    while name in stage.taken:
        yield Order(None, until=actor.t + _LOOKS_AGAIN_S)
    actor.arrives()
    stage.taken[name] = number
    furniture = stage.ground.furniture[name]
    approach = actor.approach(furniture)
    place, heading = approach.stands_at, approach.heading
    turns_at = float(approach.turns_round_at[0]), float(approach.turns_round_at[1])
    yield from _walk_to(actor, turns_at, 1.0, halt=True, exactly=True, what=name)
    yield from _turn_to(actor, heading)
    near = frozenset({furniture.furniture})
    yield Order(place, _STEPS_BACK_M_S, actor.t + _STEPS_BACK_FOR_S, 0.03, True, heading, near)
    yield Order(None, until=actor.t + _STANDS_FOR_S, heading=heading, near=near, firm=True)


def _settled(actor: Actor, for_s: float | None, part: Part) -> Doing:
    """Until a part of the posture is where it was sent, and then for a time."""
    postures, number = actor.stage.postures, actor.number
    yield Order(None, firm=True, done=lambda: postures.done(number, part))
    if for_s is None or for_s > 0:
        yield Order(None, until=actor.ends_at(for_s), firm=True)


def _step_away(actor: Actor) -> Doing:
    """From the seat or bed that one got up from, to where ways begin."""
    stage, number = actor.stage, actor.number
    for name in [name for name, user in stage.taken.items() if user == number]:
        here, heading = actor.here, actor.heading
        ahead = float(here[0]) + _STEPS_AWAY_M * cos(heading), float(here[1]) + _STEPS_AWAY_M * sin(heading)
        near = frozenset({stage.ground.furniture[name].furniture})
        yield Order(ahead, 0.8, actor.t + _STEPS_BACK_FOR_S, 0.1, near=near)
        del stage.taken[name]


def _bend(actor: Actor, action: Bend) -> Doing:
    yield from _upright(actor)
    actor.stage.postures.bend(actor.number, radians(action.angle_deg))
    yield from _settled(actor, action.for_s, "bend")
    actor.stage.postures.straighten(actor.number)
    yield from _settled(actor, 0.0, "bend")


def _reach(actor: Actor, action: Reach) -> Doing:
    actor.stage.postures.reach(actor.number, np.array(action.point), action.hand)
    yield from _settled(actor, action.for_s, "reach")
    actor.stage.postures.withdraw(actor.number)
    yield from _settled(actor, 0.0, "reach")


def _look(actor: Actor, action: Look) -> Doing:
    actor.look(action)
    return
    yield  # a generator like the others, which orders nothing


def _follow(actor: Actor, action: Follow) -> Doing:
    yield from _upright(actor)
    if action.beside is not None:
        yield from walk_beside(actor, action)
        return
    ends_at = actor.ends_at(action.for_s)
    while actor.t < ends_at and not actor.is_gone(action.person):
        until = min(actor.t + 2 * _LOOKS_AGAIN_S, ends_at)
        gap = actor.distance_to(action.person) - action.keeps_m
        if gap == inf:
            yield Order(None, until=until)
            continue
        # as fast as the gap asks for: it closes within about half a second, and stays closed behind somebody who walks on
        ahead = actor.speed_of(action.person)
        walks_on = ahead > _WALKS_ON_M_S
        if gap < (-ahead if walks_on else 0.1):
            yield Order(None, until=until, heading=actor.bearing_of(action.person))
        else:
            speed = min(action.speed_m_s, max(ahead + 2 * gap, _WALKS_ON_M_S))
            yield from _one_step_on(actor, action.person, speed, until, 0.0 if walks_on else action.keeps_m)


def _one_step_on(actor: Actor, person: str, speed_m_s: float, until: float, distance_m: float) -> Doing:
    """A moment's walk towards somebody who moves, to end at a distance from them."""
    there, bearing = actor.target(person), actor.bearing_of(person)
    before = (float(there[0]) - distance_m * cos(bearing), float(there[1]) - distance_m * sin(bearing))
    way = actor.way_to(there) or actor.way_to(before)
    if not way:
        yield Order(None, until=until)
        return
    goal = way[0] if len(way) > 1 else before
    yield Order(goal, speed_m_s, until, _HALT_M, halt=len(way) == 1 and distance_m > 0)


def _meet(actor: Actor, action: Meet) -> Doing:
    yield from _upright(actor)
    if not actor.is_gone(action.person):
        actor.sets_out(actor.target(action.person), action.speed_m_s, action.person)
    while actor.distance_to(action.person) > action.distance_m + 0.1:
        if actor.is_gone(action.person):
            actor.arrives()
            return
        if actor.distance_to(action.person) == inf:
            yield Order(None, until=actor.t + _LOOKS_AGAIN_S)
            continue
        yield from _one_step_on(actor, action.person, action.speed_m_s, actor.t + 2 * _LOOKS_AGAIN_S, action.distance_m)
    actor.arrives()
    ends_at = actor.t + action.for_s
    actor.look(Look(at=action.person))
    while actor.t < ends_at and not actor.is_gone(action.person):
        actor.draws_the_eyes_of(action.person)
        yield Order(None, until=min(actor.t + 2 * _LOOKS_AGAIN_S, ends_at), heading=actor.bearing_of(action.person))
    actor.look(Look())


def _keep_path(actor: Actor, action: Path) -> Doing:
    yield Order(None)


def _leave(actor: Actor, action: Leave) -> Doing:
    yield from _upright(actor)
    place = standing_place(np.array(action.to), actor.stage.ground.walkable)
    yield from _walk_to(actor, (float(place[0]), float(place[1])), action.speed_m_s, halt=False, exactly=True)
    actor.stage.leaving.add(actor.number)
    yield Order(None)


_DOING: dict[type, Callable[[Actor, Any], Doing]] = {
    Wander: wander, Stand: _stand, Walk: _walk, Run: _walk, Turn: _turn, Sit: _rest, Lie: _rest, Bend: _bend,
    Reach: _reach, Look: _look, Follow: _follow, Meet: _meet, Path: _keep_path, Leave: _leave,
}  # fmt: skip
