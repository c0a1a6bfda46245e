"""Groups: walk abreast, as a V or in file; change sides; talk in a ring; part.

One person leads, the others keep a place beside or behind. M. Moussaïd, N. Perozo, S. Garnier, D. Helbing and G. Theraulaz,
"The walking behaviour of pedestrian social groups and its impact on crowd dynamics", PLoS ONE 5(4), 2010: groups walk side
by side at low density, as a V whose middle lags in denser crowds, at about 0.8 m from neighbour to neighbour, and at 1.26 −
0.04 n m/s (n: members). The ring in which they talk is an F-formation (A. Kendon, "Conducting Interaction", 1990).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np

from trackers.area import Area
from trackers.arrays import Planar
from trackers.scipy_functions import linear_sum_assignment
from twin.people.crowd.motion_command import MotionCommand
from twin.people.script.actor import Actor, WalkingGroup
from twin.people.script.walking import (
    FOR_A_WAY,
    HALT_M,
    IN_PLACE_M,
    LOOKS_AGAIN_S,
    STANDS_M_S,
    Commands,
    has_room,
    keep_up,
    shoulders_m,
)
from twin.scenario.behaviour import Join, Lead, TurnHead

_DRAWS_LEVEL_S = 0.35
"""Time constant for closing the gap to one's place [s]."""
_FILE_M = 1.2
"""Distance between members in file, or behind for want of room [m]: what people need at 0.8 m/s (A. Seyfried, B. Steffen, W.
Klingsch and M. Boltes, "The fundamental diagram of pedestrian movement revisited", J. Statistical Mechanics, 2005).
"""
_V_BACK = 0.35
"""Lag of the middle of a V, per distance to the neighbour (Moussaïd et al. 2010, figure 4)."""
_PASSES_BEHIND_M = 1.0
"""Distance behind the leader of the place through which a member changes sides [m]."""
_CHANGE_TAKES_S = 1.5
"""Additional time near each other for a change of sides [s]."""
_PASSES_BY_M, _IN_THE_WAY_M = 0.8, 0.6
"""Passing distance from the leader on the way to the ring, for a straight way that comes nearer than the second [m]."""
_STAYS_BEHIND_S = 0.5
_SEES_AHEAD_S = 0.7
"""Horizon for obstacles in the way beside the leader [s]."""
_SWINGS_OUT, _SWINGS_AT_MOST_M = 0.5, 0.25
"""Sideways detour around the leader's back per metre of lag, and its limit."""
_WAITS_FROM_M, _WAITS_AT_M = 0.5, 2.5
"""Lags of the last member at which the leader begins to slow down, and waits [m]."""
_CHANGES_AFTER = 0.35
"""Share of the time near each other after which a member changes sides."""
_TO_THE_RING_M_S = 1.2
"""Greatest speed on the way to the ring [m/s]."""
_NEAR_BY_M, _ABREAST_BY_M, _FALLEN_BEHIND_M = 0.15, 0.35, 1.2
"""Distances from their places at which members are near each other, walk abreast, and have fallen behind [m]."""
_DRAWS_NEAR_WITHIN_S = 4.0
"""Time within which neighbours who draw near are near, or part again [s]."""
_CANDIDATES = 8
_STRAIGHT_ON_M = 4.0
"""Additional distance at which a goal ahead is still preferred to one behind [m]: groups turn seldom."""
_LEAST_SPEED_M_S = 0.3
_ON_A_SIDE_M = 0.3
"""Lateral distance from the leader that counts as a side [m]."""


def lead(actor: Actor, action: Lead) -> Commands:
    """Walk to random places with the members who join (see `twin.scenario.behaviour.Lead`)."""
    ends_at, rng = actor.ends_at(action.for_s), actor.rng
    group = WalkingGroup(actor.number, action.formation, action.spacing_m[1], [actor.number])
    group.spaced_until_s = actor.t + rng.uniform(0.0, action.far_s[1])
    actor.context.groups[actor.number] = group
    while actor.t < ends_at:
        yield from _lead_on(actor, action, group, min(actor.t + 1.0 + rng.exponential(action.stretch_s), ends_at))
        if len(group.order) > 1 and rng.random() < action.talk_share:
            yield from _talk(actor, action, group, ends_at)
    del actor.context.groups[actor.number]


def _lead_on(actor: Actor, action: Lead, group: WalkingGroup, until: float) -> Commands:
    """Walk to one place; meanwhile neighbours draw near and part, and a member may change sides."""
    rng, goal = actor.rng, _goal_ahead(actor)
    speed_m_s = rng.uniform(*action.speed_m_s)
    while actor.t < until:
        _space(actor, action, group)
        way = actor.way_to(goal)
        if way:
            actor.goes_on()
        else:
            actor.waits(FOR_A_WAY)
        speed = max(speed_m_s - action.slowdown_m_s * len(group.others), _LEAST_SPEED_M_S) * _waits(actor, group)
        if not way or speed < STANDS_M_S:
            yield MotionCommand(None, until=min(actor.t + 3 * LOOKS_AGAIN_S, until))
            continue
        end = yield MotionCommand(way[0], speed, min(actor.t + 3 * LOOKS_AGAIN_S, until))
        if end in ("blocked", "taken") or (end == "arrived" and len(way) == 1):
            return


def _space(actor: Actor, action: Lead, group: WalkingGroup) -> None:
    """Let neighbours draw near while they walk abreast, and apart again; sides are changed while they are near.

    The time near each other counts from when all are near. It ends early where somebody falls behind for want of room.
    """
    rng, now, is_near = actor.rng, actor.t, group.gap_m == action.spacing_m[0]
    off_m = _off_places_m(actor, group)
    if group.draws_near and off_m < _NEAR_BY_M:
        changes = rng.random() < action.change_share
        group.draws_near = False
        group.spaced_until_s = now + rng.uniform(*action.near_s) + _CHANGE_TAKES_S * changes
        group.changes_at_s = now + _CHANGES_AFTER * (group.spaced_until_s - now) if changes else np.inf
    elif is_near and (now >= group.spaced_until_s or off_m > _FALLEN_BEHIND_M):
        group.gap_m, group.draws_near, group.changes_at_s = action.spacing_m[1], False, np.inf
        group.spaced_until_s = now + rng.uniform(*action.far_s)
    elif not is_near and now >= group.spaced_until_s and off_m < _ABREAST_BY_M:
        group.gap_m, group.draws_near = action.spacing_m[0], True
        group.spaced_until_s = now + _DRAWS_NEAR_WITHIN_S
    if now >= group.changes_at_s and group.others:
        _change_sides(group, rng)
        group.changes_at_s = np.inf


def _off_places_m(actor: Actor, group: WalkingGroup) -> float:
    """Return the greatest distance of a member from their place [m]; of one who changes sides it does not count."""
    others = [number for number in group.others if number != group.changes]
    seen, places, _ = _seen_by_leader(actor, group, others)
    return float(np.abs(seen - places).max(initial=0.0))


def _seen_by_leader(actor: Actor, group: WalkingGroup, members: list[int]) -> tuple[Planar, Planar, Planar]:
    """Return where members present are in the frame of the leader, and their places beside and behind, ahead + left i [m]."""
    crowd = actor.context.crowd
    present = [number for number in members if crowd.present[number]]
    seen = (crowd.place[present] - crowd.place[actor.number]) * crowd.facing[actor.number].conjugate()
    beside, behind = (
        [_place_in(actor, group, each) for each in present],
        [_place_behind(group, each) for each in present],
    )
    return seen, np.array(beside, dtype=complex), np.array(behind, dtype=complex)


def _goal_ahead(actor: Actor) -> np.ndarray:
    """Choose, of a few random places, one far and not behind."""
    goals = actor.free_places(_CANDIDATES)
    way = goals - actor.here
    length = np.hypot(way[:, 0], way[:, 1])
    ahead = way @ (np.cos(actor.heading), np.sin(actor.heading)) / np.maximum(length, 1e-9)
    return goals[int(np.argmax(length + _STRAIGHT_ON_M * ahead))]


def _waits(actor: Actor, group: WalkingGroup) -> float:
    """Return the factor on the leader's speed that lets lagging members catch up."""
    seen, beside, behind = _seen_by_leader(actor, group, group.others)
    off_m = np.minimum(np.abs(seen - beside), np.abs(seen - behind))
    lags_m = np.where(seen.real < beside.real, off_m, 0.0).max(initial=0.0)
    return float(np.clip((_WAITS_AT_M - lags_m) / (_WAITS_AT_M - _WAITS_FROM_M), 0.0, 1.0))


def _change_sides(group: WalkingGroup, rng: np.random.Generator) -> None:
    """Send one follower to the other side of the leader."""
    number = group.others[int(rng.integers(len(group.others)))]
    left = group.order.index(number) < group.order.index(group.leader)
    group.order.remove(number)
    group.order.insert(len(group.order) if left else 0, number)
    group.changes = number


def _talk(actor: Actor, action: Lead, group: WalkingGroup, ends_at: float) -> Commands:
    """Stand in a ring for a while, facing its middle, where there is room."""
    crowd, count = actor.context.crowd, len(group.order)
    radius_m = action.ring_m / (2 * np.sin(pi / count))
    here = complex(crowd.place[actor.number])
    middle = here + radius_m * complex(crowd.facing[actor.number])
    others = group.others
    slots = middle + (here - middle) * np.exp(2j * pi * np.arange(1, count) / count)
    points = np.stack([slots.real, slots.imag], axis=1)
    ground = actor.context.ground
    if not (Area(ground.inner).contains(points).all() and all(ground.routes.reachable(point) for point in points)):
        return
    member, slot = linear_sum_assignment(np.abs(crowd.place[others][:, None] - slots))
    group.ring = {others[m]: complex(slots[s]) for m, s in zip(member, slot, strict=True)} | {actor.number: here}
    until = min(actor.t + actor.rng.uniform(*action.talk_s), ends_at)
    actor.look(TurnHead(at=actor.context.names[others[int(actor.rng.integers(len(others)))]]))
    heading = float(np.angle(middle - here))
    while actor.t < until:
        yield MotionCommand(None, until=min(actor.t + LOOKS_AGAIN_S, until), heading=heading, companions=tuple(others))
    group.ring = None
    actor.look(TurnHead())


def join(actor: Actor, action: Join) -> Commands:
    """Join the group of a leader (see `twin.scenario.behaviour.Join`)."""
    context, leader = actor.context, actor.context.number_of(action.person)
    ends_at, behind_until, group = actor.ends_at(action.for_s), -np.inf, None
    while actor.t < ends_at and not actor.has_left(action.person):
        found = context.groups.get(leader)
        if found is None or not context.crowd.present[leader]:
            if group is not None:
                break
            actor.waits(f"for {action.person} to lead")
            yield MotionCommand(None, until=actor.t + LOOKS_AGAIN_S)
            continue
        if group is None:
            actor.goes_on()
            group = found
            group.order.insert(int(actor.rng.integers(len(group.order) + 1)), actor.number)
        until = min(actor.t + LOOKS_AGAIN_S, ends_at)
        if group.ring is not None and actor.number in group.ring:
            yield _ring_place(actor, group, group.ring, until)
            continue
        crowd = context.crowd
        place, facing = crowd.place[leader], crowd.facing[leader]
        _keep_sides(actor, group)
        goal = place + _place_in(actor, group, actor.number) * facing
        if group.formation != "file" and not (
            Area(context.ground.inner).contains(np.array([[goal.real, goal.imag]]))[0]
            and has_room(actor, group.order, place, goal, crowd.velocity[leader], _SEES_AHEAD_S)
        ):
            behind_until = actor.t + _STAYS_BEHIND_S
        if actor.t < behind_until:
            goal = place + _place_behind(group, actor.number) * facing
        stay = replace(_stay(actor, group, until), keeps_step=True)
        yield keep_up(actor, leader, _around(actor, place, facing, goal), stay, action.speed_m_s, _DRAWS_LEVEL_S)
    if group is not None and actor.number in group.order:
        group.order.remove(actor.number)


def _keep_sides(actor: Actor, group: WalkingGroup) -> None:
    """Let a member on the other side after a turn of the group stay there; one who changes sides has arrived."""
    crowd, order = actor.context.crowd, group.order
    seen = (crowd.place[actor.number] - crowd.place[group.leader]) * crowd.facing[group.leader].conjugate()
    left = order.index(actor.number) < order.index(group.leader)
    if abs(seen.imag) < _ON_A_SIDE_M:
        return
    if left == (seen.imag > 0):
        group.changes = None if group.changes == actor.number else group.changes
    elif group.changes != actor.number:
        order.remove(actor.number)
        order.insert(0 if seen.imag > 0 else len(order), actor.number)


def _place_in(actor: Actor, group: WalkingGroup, number: int) -> complex:
    """Return a member's place in the frame of the leader, ahead + left i [m]."""
    if group.formation == "file":
        return _place_behind(group, number)
    gaps = [max(group.gap_m, shoulders_m(actor, *pair)) for pair in pairwise(group.order)]
    left = -np.concatenate([[0.0], np.cumsum(gaps)])
    own, leads = group.order.index(number), group.order.index(group.leader)
    ahead = np.zeros(len(left))
    if group.formation == "v":
        ahead = _V_BACK * np.abs(left - left.mean())
    return complex(ahead[own] - ahead[leads], left[own] - left[leads])


def _place_behind(group: WalkingGroup, number: int) -> complex:
    """Return a member's place in file in the frame of the leader, ahead + left i [m]."""
    return complex(-_FILE_M * (1 + group.others.index(number)), 0.0)


def _around(actor: Actor, place: complex, facing: complex, goal: complex) -> complex:
    """Return the next point on the way to one's place, around the leader's back."""
    seen = (actor.context.crowd.place[actor.number] - place) * facing.conjugate()
    wanted = (goal - place) * facing.conjugate()
    if seen.imag * wanted.imag < 0 and abs(wanted.imag) > 0.1:  # on the wrong side
        back = complex(-_PASSES_BEHIND_M, np.sign(wanted.imag) * 0.3 if seen.real < -0.4 else seen.imag)
        return place + back * facing
    wide_m = float(np.clip(_SWINGS_OUT * (wanted.real - seen.real), 0.0, _SWINGS_AT_MOST_M))
    return goal + wide_m * 1j * np.sign(wanted.imag) * facing


def _stay(actor: Actor, group: WalkingGroup, until: float) -> MotionCommand:
    """Return the command to stand among the other members, as near abreast as shoulders allow."""
    others = tuple(number for number in group.order if number != actor.number)
    least_m = max(shoulders_m(actor, actor.number, other) for other in others)
    return MotionCommand(None, until=until, companions=others, companion_m=least_m)


def _ring_place(actor: Actor, group: WalkingGroup, ring: dict[int, complex], until: float) -> MotionCommand:
    """Return the next command of a talk: go to one's place in the ring, and stand there facing its middle."""
    goal, here = ring[actor.number], actor.context.crowd.place[actor.number]
    stay = _stay(actor, group, until)
    aim = _past(here, goal, complex(actor.context.crowd.place[group.leader]))
    way = [] if abs(goal - here) < IN_PLACE_M else actor.way_to((aim.real, aim.imag))
    if not way:
        return replace(stay, heading=float(np.angle(sum(ring.values()) / len(ring) - here)))
    speed = min(max(abs(goal - here) / _DRAWS_LEVEL_S, STANDS_M_S), _TO_THE_RING_M_S)
    return replace(stay, goal=way[0], speed_m_s=speed, arrive_m=HALT_M, halt=len(way) == 1)


def _past(here: complex, goal: complex, leader: complex) -> complex:
    """Return the next point on the way to a goal, past the leader's side where they stand between."""
    ahead = (goal - here) / max(abs(goal - here), 1e-9)
    seen = (leader - here) * ahead.conjugate()
    if not (0 < seen.real < abs(goal - here) and abs(seen.imag) < _IN_THE_WAY_M):
        return goal
    return leader + ahead * complex(0.0, -_PASSES_BY_M if seen.imag > 0 else _PASSES_BY_M)
