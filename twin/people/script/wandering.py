"""Walking about at random, with sudden stops, starts and turns."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.order import End, Order
from twin.people.script.actor import Actor
from twin.scenario.behaviour import Wander

_CANDIDATES = 6
_LEAST_WAY_M = 0.8
_LOOK_AHEAD_M = 1.0
_SHUT_IN_S = 0.5


def wander(actor: Actor, action: Wander) -> Generator[Order, End, None]:
    """Random places one after another (see `twin.scenario.behaviour.Wander`)."""
    ends_at = actor.ends_at(action.for_s)
    walking = False
    rng = actor.rng
    while actor.t < ends_at:
        if walking and rng.random() < action.stop_share:
            walking = False
            yield Order(None, until=min(actor.t + rng.uniform(*action.stop_s), ends_at))
            continue
        walking = True
        goal = _goal(actor)
        speed = rng.uniform(*action.speed_m_s)
        until = min(actor.t + 0.3 + rng.exponential(action.stretch_s), ends_at)
        way = actor.way_to(goal)
        if not way:  # too close to furniture to find one: wait, others may push
            yield Order(None, until=min(actor.t + _SHUT_IN_S, ends_at))
        for place in way:
            if (yield Order(place, speed, until)) != "arrived":
                break


def _goal(actor: Actor) -> Array:
    """Of a few random goals the one whose first metre is freest of others: nobody sets out into somebody's back."""
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
