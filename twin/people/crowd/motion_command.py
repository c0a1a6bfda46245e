"""Command to one person's body on the floor, valid until the next: go, stand, turn; and repulsion between people.

The repulsion is the social force model in a form that looks ahead: A. Johansson, D. Helbing and P. Shukla, "Specification of
the social force pedestrian model by evolutionary adjustment to video tracking data", Advances in Complex Systems 10, 2007:
"elliptical II", with their weight by the angle of sight. The parameters are ours: short and strong, for people close
together in a room, and turned slightly to the right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Literal, Protocol

import numpy as np

from trackers.arrays import Array, Mask, Planar

End = Literal["arrived", "time", "done", "taken", "blocked"]
"""Reason for which a command ended: goal reached, time over, its own condition met, goal occupied by another, or way
blocked.
"""


@dataclass(frozen=True)
class MotionCommand:
    """Walk or run to `goal` [m] at `speed_m_s`, or stand (goal None), until time `until` [s], arrival, or `done()`.

    `arrive_m`: distance that counts as arrival; `halt`: slow down to stop at the goal instead of passing it; `heading`:
    direction to face [rad], None: that of motion. A walker with a heading steps sideways and backwards; a standing person
    turns on the spot. `near`: names of furniture that may be approached closely, for the last steps to a seat, bed or shelf;
    `immovable`: do not give way, as people who sit, lie or bend; `companions`: indices of people without mutual repulsion,
    who may come as near abreast as `companion_m` [m] with arms held in; `keeps_step`: count on companions to walk on, and
    follow as closely as they stand; `stretch`: from the body's middle to a hand or head that it stretches out, which others
    keep off, x + iy in the room [m].
    """

    goal: tuple[float, float] | None
    speed_m_s: float = 0.0
    until: float = inf
    arrive_m: float = 0.25
    halt: bool = False
    heading: float | None = None
    near: frozenset[str] = frozenset()
    immovable: bool = False
    companions: tuple[int, ...] = ()
    companion_m: float = inf
    keeps_step: bool = False
    stretch: complex = 0j
    done: Callable[[], bool] | None = None


@dataclass(frozen=True, eq=False)
class SeenBases:
    """Influence of m bases on n people: push (n,) [m/s²] and directions (n, m), complex; limits of approach (n, m) [m/s]."""

    push: Planar
    towards: Planar
    limit: Array


class Bases(Protocol):
    """Bases that drive among people (`twin.people.crowd.bases.MovingBases`)."""

    def seen_from(self, place: Planar, braking: Array) -> SeenBases:
        """Return the influence of the bases on people at these places (n,), who brake at most by `braking` (n,) [m/s²]."""
        ...


REPULSION_M_S2 = 5.0
"""Repulsion between two people at the least distance [m/s²]."""
LOOK_AHEAD_S = 0.5
"""Horizon of relative motion in the repulsion [s]."""
REPULSION_RANGE_M = 0.18
"""Distance over which the repulsion falls by 1/e [m]."""
SIGHT_FROM_BEHIND = 0.3
"""Relative repulsion by a person straight behind."""
STANDING_SHARE = 0.25
"""Relative repulsion on a person who stops, so that passers-by do not push them about."""
PASS_ON_THE_RIGHT_RAD = 0.5
"""Clockwise turn of the repulsion, so that two who meet head on pass [rad]."""
ARMS_IN_FROM_M, ARMS_IN_AT_M = 0.8, 0.65
"""Distances of another person at which the arm on that side begins to be held in, and hangs straight down [m]."""
ARMS_IN_BY_WALLS_FROM_M, ARMS_IN_BY_WALLS_AT_M = 0.5, 0.38
"""The same of walls and furniture [m]."""
FOOT_M = 0.25
"""Length of a foot with its shoe [m]."""
KEEP_APART_M = 0.65
"""Least distance between the middles of two people [m]: room for both people's feet and swinging arms."""

BESIDE_HANDS_M = 0.45
"""Least distance between the middle of a person and another's hand or head that is stretched out [m]."""
_ALONG_ARMS = np.array([0.35, 0.65, 1.0])
"""Places along what is stretched out that others keep off, as shares of its length."""

_PASS = np.exp(1j * PASS_ON_THE_RIGHT_RAD)


def repulsion(
    between: Planar, distance: Array, towards: Planar, velocity: Planar, facing: Planar, going: Array, self_far: Array
) -> Planar:
    """Return the social force (n,) [m/s²] of the others on each.

    between (n, n): from each to each [m], towards its direction and distance (n, n) its length; velocity (n,) [m/s], facing
    (n,) unit; going (n,): 1 walks, 0 stands; self_far (n, n): a great length on the diagonal [m].
    """
    drift = (velocity - velocity[:, None]) * LOOK_AHEAD_S
    soon = between + drift
    soon_distance = np.abs(soon) + self_far
    both = distance + soon_distance
    axis = 0.5 * np.sqrt(np.maximum(both * both - np.abs(drift) ** 2, 1e-6))
    direction = 0.5 * (towards + soon / np.maximum(soon_distance, 1e-6))
    ahead = (towards * facing.conj()[:, None]).real
    weight = 0.5 * (1 + SIGHT_FROM_BEHIND) + 0.5 * (1 - SIGHT_FROM_BEHIND) * ahead
    force = np.exp((axis - KEEP_APART_M) * (-1.0 / REPULSION_RANGE_M)) * (0.5 * both / axis) * weight
    away = (force * direction).sum(axis=1)
    return away * (STANDING_SHARE + (1 - STANDING_SHARE) * going) * (-REPULSION_M_S2 * _PASS)


def least_apart(companions: Mask, companion_m: Array, keeps_step: Mask, towards: Planar, facing: Planar) -> Array:
    """Return the least distance (n, n) [m] between people, less for companions abreast.

    companions (n, n): pairs who walk together; companion_m (n,): least distance abreast [m]; keeps_step (n,): people who
    count on companions to walk on; towards (n, n): unit, from each to each; facing (n,): unit. Before and behind each other
    companions keep the usual distance, and those who keep step a foot's length more, to spare the feet.
    """
    closer = np.where(companions, KEEP_APART_M - companion_m[:, None], 0.0)
    lateral = (towards * facing.conj()[:, None]).imag ** 2
    lateral = np.minimum(lateral, lateral.T)
    apart = KEEP_APART_M - np.maximum(closer, closer.T) * lateral
    if not np.count_nonzero(keeps_step):
        return apart
    return apart + FOOT_M * (1.0 - lateral) * (companions & keeps_step[:, None])


def stretched(place: Planar, stretch: Planar) -> tuple[Planar, Array]:
    """Return directions (n, k) from people to arms and trunks that others stretch out, and the room before them [m].

    place (n,): of the bodies' middles; stretch (n,): from these to hands or heads, 0 of most [m].
    """
    whose = np.flatnonzero(stretch)
    points = place[whose] + _ALONG_ARMS[:, None] * stretch[whose]  # (3, m)
    between = points.ravel() - place[:, None]
    distance = np.maximum(np.abs(between), 1e-6)
    own = np.tile(whose, len(_ALONG_ARMS)) == np.arange(len(place))[:, None]
    return between / distance, np.where(own, np.inf, distance - BESIDE_HANDS_M)


def room_made(companions: Mask, keeps_step: Mask, towards: Planar, velocity: Planar) -> Array:
    """Return the speed (n, n) [m/s] at which companions walk away ahead of those who keep step; 0 for all others.

    Arguments as in `least_apart`; velocity (n,) [m/s].
    """
    return np.maximum((towards.conj() * velocity).real, 0.0) * (companions & keeps_step[:, None])


_PROJECTIONS = 3
ROUNDING_M_S = 1e-9


def slowed_down(velocity: Planar, normals: Planar, limit: Array) -> Planar:
    """Limit velocities so that no obstacle is approached faster than its limit.

    normals (n, k): directions to the obstacles; limit (n, k) [m/s], negative to back away. Rounds of projection keep the
    motion along an obstacle; a velocity still too fast is scaled down.
    """
    inverse = normals.conj()
    approach = (inverse * velocity[:, None]).real
    for _ in range(_PROJECTIONS):
        excess = approach - limit
        if not np.count_nonzero(excess > ROUNDING_M_S):
            return velocity
        worst, numbers = excess.argmax(axis=1), np.arange(len(velocity))
        too_fast = np.maximum(excess[numbers, worst], 0.0)
        velocity = velocity - too_fast * normals[numbers, worst]
        approach = (inverse * velocity[:, None]).real
    limit = np.maximum(limit, 0.0)
    if not np.count_nonzero(approach > limit + ROUNDING_M_S):
        return velocity
    share = np.where(approach > limit + ROUNDING_M_S, limit / np.maximum(approach, 1e-12), 1.0).min(axis=1)
    return velocity * share


def arms_in(apart: Array, between: Planar, gap_m: Array, to_things: Planar, facing: Planar) -> Array | float:
    """Return the fraction by which each person holds in the left and the right arm, (2, n): 0 as when alone, 1 straight
    down; one 0 where all are far apart.

    apart (n, n), gap_m (n, m): distances of people's middles from each other, and from furniture and walls [m]; between (n, n),
    to_things (n, m): the ways there in the room; facing (n,): unit.
    """
    near, beside = apart.min(initial=np.inf) < ARMS_IN_FROM_M, gap_m.min(initial=np.inf) < ARMS_IN_BY_WALLS_FROM_M
    if not (near or beside):
        return 0.0
    held, turned_back = np.zeros((2, len(apart))), facing.conj()[:, None]
    for counts, distance, way, from_m, at_m in (
        (near, apart, between, ARMS_IN_FROM_M, ARMS_IN_AT_M),
        (beside, gap_m, to_things, ARMS_IN_BY_WALLS_FROM_M, ARMS_IN_BY_WALLS_AT_M),
    ):
        if counts:
            share = np.minimum(np.maximum((from_m - distance) / (from_m - at_m), 0.0), 1.0)
            on_left = (way * turned_back).imag > 0
            held = np.maximum(held, np.array([share * on_left, share * ~on_left]).max(axis=2, initial=0.0))
    return held
