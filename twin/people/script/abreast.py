"""Walking abreast of somebody, and behind them where there is no room."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from twin.people.crowd.order import End, Order
from twin.people.crowd.social_force import KEEP_APART_M
from twin.people.script.actor import Actor
from twin.scenario.behaviour import Follow

_ORDERS_EVERY_S = 0.1
_DRAWS_LEVEL_S = 0.5
"""The way to the place beside the other is made up within about this time [s]."""
_STANDS_M_S = 0.2
_IN_PLACE_M = 0.12
_SEES_AHEAD_S = 1.5
"""So far ahead people look for what would be in the way of the one beside [s]."""
_BEHIND_M = 0.9
_STAYS_BEHIND_S = 1.0
_SWINGS_OUT = 0.6
"""Who draws level passes wide of the other's back: so much farther aside for each metre that they lag."""


def walk_beside(actor: Actor, action: Follow) -> Generator[Order, End, None]:
    """Keep level with somebody who goes their own way, or behind them for a while (see `twin.scenario.behaviour.Follow`)."""
    crowd, other = actor.stage.crowd, actor.stage.number_of(action.person)
    ends_at, behind_until = actor.ends_at(action.for_s), -np.inf
    aside = action.keeps_m * (1j if action.beside == "left" else -1j)
    while actor.t < ends_at and not actor.is_gone(action.person):
        until = min(actor.t + _ORDERS_EVERY_S, ends_at)
        if not crowd.present[other]:
            yield Order(None, until=until)
            continue
        place, velocity, facing = crowd.place[other], crowd.velocity[other], crowd.facing[other]
        beside = place + aside * facing
        if not _has_room(actor, other, place, beside, velocity):
            behind_until = actor.t + _STAYS_BEHIND_S
        if actor.t >= behind_until:
            lags_m = ((beside - crowd.place[actor.number]) * facing.conjugate()).real
            goal = beside + _SWINGS_OUT * np.clip(lags_m, 0.0, 1.0) * aside / action.keeps_m * facing
        else:
            goal = place - _BEHIND_M * facing
        yield _keep_up(actor, action, other, goal, until)


def _keep_up(actor: Actor, action: Follow, other: int, goal: complex, until: float) -> Order:
    """The order for a moment: be where the place one keeps will be, or stand there, facing as the other does."""
    crowd, here = actor.stage.crowd, actor.stage.crowd.place[actor.number]
    velocity = crowd.velocity[other]
    stands = abs(velocity) < _STANDS_M_S
    if stands and abs(goal - here) < _IN_PLACE_M:
        return Order(None, until=until, heading=float(crowd.heading[other]), companion=other)
    soon = goal if stands else goal + velocity * _DRAWS_LEVEL_S
    speed = min(max(abs(soon - here) / _DRAWS_LEVEL_S, _STANDS_M_S), action.speed_m_s)
    way = actor.way_to((soon.real, soon.imag)) or actor.way_to(actor.target(action.person))
    if not way:
        return Order(None, until=until, companion=other)
    return Order(way[0], speed, until, 0.05, halt=stands and len(way) == 1, companion=other)


def _has_room(actor: Actor, other: int, place: complex, beside: complex, velocity: complex) -> bool:
    """Whether the place beside somebody is free, and stays so for a while as they go on."""
    routes, crowd = actor.stage.ground.routes, actor.stage.crowd
    points = [np.array([at.real, at.imag]) for at in (place, beside, beside + velocity * _SEES_AHEAD_S)]
    for start, end in ((points[0], points[1]), (points[1], points[2])):
        way = routes.way(start, end)
        if way is None or len(way) > 1:
            return False
    others = crowd.present.copy()
    others[[actor.number, other]] = False
    gap, drift = crowd.place[others] - beside, crowd.velocity[others] - velocity
    nearest_s = np.clip(-(gap * drift.conj()).real / np.maximum(np.abs(drift) ** 2, 1e-9), 0.0, _SEES_AHEAD_S)
    return not (np.abs(gap + drift * nearest_s) < KEEP_APART_M).any()
