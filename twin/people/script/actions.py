"""Actions of a script as motion commands.

An action is a generator: it yields a command and is sent the reason for which the command ended.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from functools import partial
from math import cos, radians, sin
from typing import Any, TypeVar

import numpy as np

from trackers.area import wrap_angle
from trackers.arrays import Array
from twin.people.crowd.ground import standing_place
from twin.people.crowd.motion_command import BESIDE_HANDS_M, MotionCommand
from twin.people.posture.body_measures import Penetration
from twin.people.posture.postures import Hand, Part, Postures
from twin.people.script.actor import Actor, Going
from twin.people.script.groups import join, lead
from twin.people.script.walking import LOOKS_AGAIN_S, Commands, follow, meet, walk, walk_to, wander
from twin.room.furniture import Bed, Seat
from twin.scenario.action import RecordedPath, WaitCondition
from twin.scenario.behaviour import (
    Action,
    Bend,
    Follow,
    Join,
    Lead,
    Leave,
    Lie,
    Meet,
    Reach,
    Run,
    Sit,
    Stand,
    Turn,
    TurnHead,
    Walk,
    Wander,
)

_FACING_RAD = radians(3)
_TURNS_AT_ONCE_DEG = 150.0
_STEPS_AWAY_M = 0.28
"""Distance of a step away from a seat, to where ways begin [m]."""
_AHEAD = 0.7
"""Least cosine between the headings of a person and of a seat that they leave ahead, not from its side."""
_STEPS_BACK_M_S = 0.5
_STEPS_BACK_FOR_S = 3.0
_STANDS_FOR_S = 0.6
_TURNS_ASIDE = [radians(turn) for step in range(0, 181, 15) for turn in ((step, -step) if step else (0,))]
"""Turns before a bend, the least first [rad]."""
_WAITS_FOR_ROOM_S = 6.0
"""Time after which a bend or a reach is given up for want of room [s]."""
_SHORT_M = 0.1
"""Distance between hand and point from which on a reach is reported as too short, the length of fingers [m]."""
_STOPS_SHORT_M = (0.0, 0.05, 0.1, 0.15)
"""Distances before a point at which a hand that touches something stops, the length of a hand at most [m]."""
_BESIDE_THINGS_M, _STEP_M = 0.28, 0.1
"""Room beside the head and the hanging arms of who bends [m], and the step between the places where it is looked for [m]."""
_UNDER_HIPS_M = 0.15
"""Depth of a trunk bent to the level, below the hips [m]."""

_Result = TypeVar("_Result")


def perform(actor: Actor, script: Sequence[Action]) -> Commands:
    """Perform the actions in order, then stand forever."""
    for action in script:
        yield from _wait_for(actor, action)
        actor.context.doing[actor.number] = action.kind
        yield from _DOING[type(action)](actor, action)
        actor.goes_on()
    actor.context.doing[actor.number] = "stand"
    while True:
        yield MotionCommand(None)


def _wait_for(actor: Actor, action: Action) -> Commands:
    actor.context.doing[actor.number] = "stand"
    if action.at_s is not None and actor.t < action.at_s:
        yield MotionCommand(None, until=action.at_s)
    while action.when is not None and not _holds(actor, action.when):
        actor.waits(f"for {_in_words(action.when)}: {action.kind} has not started")
        yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
    actor.goes_on()


def _in_words(condition: WaitCondition) -> str:
    if condition.near is None:
        return f"{condition.person} to {condition.does}"
    what = (
        condition.near if isinstance(condition.near, str) else f"[{', '.join(f'{each:g}' for each in condition.near)}]"
    )
    return f"{what} to be within {condition.within_m:g} m"


def _holds(actor: Actor, condition: WaitCondition) -> bool:
    if condition.near is not None and condition.within_m is not None:
        return actor.distance_to(condition.near) <= condition.within_m
    context = actor.context
    return condition.person is not None and context.doing[context.number_of(condition.person)] == condition.does


def _upright(actor: Actor) -> Commands:
    """Stand up from sitting, lying or bending."""
    postures, number = actor.context.postures, actor.number
    if postures.may_walk()[number]:
        return
    postures.rise(number)
    yield MotionCommand(None, immovable=True, done=lambda: bool(postures.may_walk()[number]))
    yield from _step_away(actor)


def _turn_to(actor: Actor, heading: float) -> Commands:
    def faces() -> bool:
        return abs(wrap_angle(heading - actor.heading)) < _FACING_RAD

    yield MotionCommand(None, heading=heading, done=faces)


def _stand(actor: Actor, action: Stand) -> Commands:
    yield MotionCommand(None, until=actor.ends_at(action.for_s), immovable=True)


def _on_feet(acts: Callable[[Actor, Any], Commands]) -> Callable[[Actor, Any], Commands]:
    """Have an action begin with standing up."""

    def perform(actor: Actor, action: Action) -> Commands:
        yield from _upright(actor)
        yield from acts(actor, action)

    return perform


def _turn(actor: Actor, action: Turn) -> Commands:
    if action.towards is not None:
        heading = actor.bearing_of(action.towards)
    elif action.to_deg is not None:
        heading = radians(action.to_deg)
    else:
        # a turn of more than half a circle keeps its direction, in parts
        by, heading = action.by_deg or 0.0, actor.heading
        while abs(by) > _TURNS_AT_ONCE_DEG:
            part = _TURNS_AT_ONCE_DEG if by > 0 else -_TURNS_AT_ONCE_DEG
            heading, by = heading + radians(part), by - part
            yield from _turn_to(actor, heading)
        heading += radians(by)
    yield from _turn_to(actor, heading)


def _rest(actor: Actor, action: Sit | Lie) -> Commands:
    """Sit or lie down on a piece of furniture, and get up when the time is over."""
    name = action.seat if isinstance(action, Sit) else action.bed
    furniture, postures, number = actor.context.ground.furniture[name], actor.context.postures, actor.number
    if isinstance(action, Sit) and action.seated:  # seated from the start
        found = actor.overlap_in(None)
    else:
        side = yield from _go_and_take(actor, name)
        found = None
        if isinstance(furniture, Bed):
            act, found = _freest(actor, [partial(Postures.lie, person=number, bed=furniture)])
        elif side is not None:  # a pose in which there is room
            act = partial(Postures.sit, person=number, seat=furniture, side=side)
        else:  # the hands lie on the thighs if there is room for the elbows
            ways = [partial(Postures.sit, person=number, seat=furniture, arms_hang=each) for each in (False, True)]
            act, found = _freest(actor, ways)
        act(postures)
    if found is not None:
        actor.misses(f"has no room on {name!r} ({_in_the_way(found)})")
    yield from _settled(actor, action.for_s, "body")
    yield from _upright(actor)


def _freest(
    actor: Actor, ways: Sequence[Callable[[Postures], _Result]]
) -> tuple[Callable[[Postures], _Result], Penetration | None]:
    """Return the first way of an action that touches nothing, or the one that comes least deep into the room, and its overlap."""
    tried = []
    for way in ways:
        found = actor.overlap_in(way)
        if found is None:
            return way, None
        tried.append((way, found))
    return min(tried, key=lambda each: each[1].depth_m)


def _in_the_way(found: Penetration) -> str:
    """Return an overlap in words."""
    return f"{found.geom.partition('/')[2]} {100 * found.depth_m:.1f} cm inside {found.other_geom!r}"


def _go_and_take(actor: Actor, name: str) -> Commands:
    """Stand with the back to a seat or bed, once it is free; returns the pose of sitting down from a side, or None."""
    context, number = actor.context, actor.number
    yield from _upright(actor)
    if name in context.taken:
        context.going[number] = Going(name, actor.t, 0.0)
    while name in context.taken:
        yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
    actor.arrives()
    context.taken[name] = number
    furniture = context.ground.furniture[name]
    approach = actor.approach(furniture)
    place, heading = approach.stands_at, approach.heading
    turns_at = float(approach.turns_round_at[0]), float(approach.turns_round_at[1])
    near = frozenset({furniture.furniture})
    if approach.side is not None:
        near |= context.ground.routes.near(np.array(place))
    while True:  # again after somebody stood in the way of the steps back
        yield from walk_to(actor, turns_at, 1.0, halt=True, exactly=True, what=name)
        yield from _turn_to(actor, heading)
        yield MotionCommand(place, _STEPS_BACK_M_S, actor.t + _STEPS_BACK_FOR_S, 0.03, True, heading, near)
        yield MotionCommand(None, until=actor.t + _STANDS_FOR_S, heading=heading, near=near, immovable=True)
        if context.postures.stands_near(number, complex(*place), heading):
            return approach.side


def _settled(actor: Actor, for_s: float | None, part: Part, stretch: complex = 0j) -> Commands:
    """Wait until a part of the posture reaches its goal, and then for a time; others keep off what it stretches out."""
    postures, number = actor.context.postures, actor.number
    yield MotionCommand(None, immovable=True, stretch=stretch, done=lambda: postures.done(number, part))
    if for_s is None or for_s > 0:
        yield MotionCommand(None, until=actor.ends_at(for_s), immovable=True, stretch=stretch)


def _step_away(actor: Actor) -> Commands:
    """Step away from the seat or bed, to where ways begin."""
    context, number = actor.context, actor.number
    for name in [name for name, user in context.taken.items() if user == number]:
        here, heading = actor.here, actor.heading
        ahead = float(here[0]) + _STEPS_AWAY_M * cos(heading), float(here[1]) + _STEPS_AWAY_M * sin(heading)
        furniture = context.ground.furniture[name]
        near = frozenset({furniture.furniture})
        if isinstance(furniture, Seat) and cos(heading - furniture.yaw) < _AHEAD:  # beside a desk
            near |= context.ground.routes.near(actor.here)
        yield MotionCommand(ahead, 0.8, actor.t + _STEPS_BACK_FOR_S, 0.1, near=near)
        del context.taken[name]


def _bend(actor: Actor, action: Bend) -> Commands:
    """Bend forward where there is room for the head, after a turn aside if need be."""
    postures, number, angle_rad = actor.context.postures, actor.number, radians(action.angle_deg)
    ahead_m = postures.measures.head_ahead_m(number, angle_rad)
    above_m = float((postures.measures.leg + postures.measures.ankle_height)[number]) - _UNDER_HIPS_M
    steps = np.arange(_STEP_M, ahead_m, _STEP_M)

    def way() -> complex | None:
        for turn in _TURNS_ASIDE:
            found = complex(np.exp(1j * (actor.heading + turn)))
            places = actor.here + steps[:, None] * np.array([found.real, found.imag])
            free = actor.context.ground.is_clear(places, above_m, _BESIDE_THINGS_M)
            if free and _clear_of_others(actor, places):
                return found
        return None

    if (yield from _room_for(actor, lambda: way() is not None)):
        found = way() or 1.0
        yield from _turn_to(actor, float(np.angle(found)))
        bends, touched = _freest(actor, [partial(Postures.bend, person=number, angle_rad=angle_rad)])
        if touched is not None:
            actor.misses(f"has no room to bend ({_in_the_way(touched)})")
            return
        bends(postures)
        yield from _settled(actor, action.for_s, "bend", ahead_m * found)
        postures.straighten(number)
        yield from _settled(actor, 0.0, "bend", ahead_m * found)
    else:
        actor.misses("has no room to bend")


def _reach(actor: Actor, action: Reach) -> Commands:
    """Reach for a point once nobody stands before it, as far as what it is on or in lets the hand.

    The other hand reaches where the body would else be in the way of things.
    """
    point, postures, number = np.array(action.point), actor.context.postures, actor.number
    way = point[:2] - actor.here
    far_m = min(float(np.hypot(*way)), float(postures.measures.arm[number] + postures.measures.stature[number] / 2))
    stretch = complex(*way) / max(float(np.hypot(*way)), 1e-6) * far_m
    places = actor.here + np.linspace(0.3, 1.0, 8)[:, None] * np.array([stretch.real, stretch.imag])
    if not (yield from _room_for(actor, lambda: _clear_of_others(actor, places))):
        actor.misses(f"cannot reach {action.point}, as somebody stands before it")
        return
    hands: tuple[Hand, ...] = (action.hand,)
    if action.hand == "auto" and not (
        postures.measures.left_carries[number] or postures.measures.right_carries[number]
    ):
        hands = "auto", "left", "right"
    back = np.append(way, 0.0) / max(float(np.hypot(*way)), 1e-6)
    ways = [
        partial(Postures.reach, person=number, point=point - less_m * back, hand=hand)
        for less_m in _STOPS_SHORT_M
        for hand in hands
    ]
    reaches, touched = _freest(actor, ways)
    if touched is not None:
        actor.misses(f"has no room to reach {action.point} ({_in_the_way(touched)})")
        return
    if (short_m := reaches(postures)) > _SHORT_M:
        actor.misses(f"cannot reach {action.point}, which is {short_m:.2f} m too far")
    yield from _settled(actor, action.for_s, "reach", stretch)
    postures.withdraw(number)
    yield from _settled(actor, 0.0, "reach", stretch)


def _clear_of_others(actor: Actor, places: Array) -> bool:
    """Return whether nobody else is so near to any of the places (k, 2) [m] that a hand or head there would touch them."""
    others = actor.others()
    return bool((np.linalg.norm(places[:, None] - others, axis=2) > BESIDE_HANDS_M).all())


def _room_for(actor: Actor, is_free: Callable[[], bool]) -> Generator[MotionCommand, str, bool]:
    """Wait until there is room for an action, and return whether there is."""
    until = actor.t + _WAITS_FOR_ROOM_S
    while not is_free() and actor.t < until:
        yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
    return is_free()


def _look(actor: Actor, action: TurnHead) -> Commands:
    actor.look(action)
    return
    yield  # an empty generator, like the others


def _keep_path(actor: Actor, action: RecordedPath) -> Commands:
    yield MotionCommand(None)


def _leave(actor: Actor, action: Leave) -> Commands:
    place = standing_place(np.array(action.to), actor.context.ground.walkable)
    yield from walk_to(actor, (float(place[0]), float(place[1])), action.speed_m_s, halt=False, exactly=True)
    actor.context.leaving.add(actor.number)
    yield MotionCommand(None)


_DOING: dict[type, Callable[[Actor, Any], Commands]] = {
    Wander: wander, Sit: _rest, Lie: _rest, Reach: _reach, TurnHead: _look, RecordedPath: _keep_path,
    Stand: _on_feet(_stand), Walk: _on_feet(walk), Run: _on_feet(walk), Turn: _on_feet(_turn), Bend: _on_feet(_bend),
    Follow: _on_feet(follow), Meet: _on_feet(meet), Lead: _on_feet(lead), Join: _on_feet(join), Leave: _on_feet(_leave),
}  # fmt: skip
