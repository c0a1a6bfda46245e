"""How people move over the floor among others: towards their goals, around each other, inside their area.

Three layers, for all people at once:

1. The social force model (D. Helbing and P. Molnár, "Social force model for pedestrian dynamics", Physical Review E 51,
   1995): a drive towards the wanted velocity within a relaxation time, and a repulsion between people, here in the
   elliptical form that looks ahead by the relative velocity (A. Johansson, D. Helbing and P. Shukla, "Specification of
   the social force pedestrian model by evolutionary adjustment to video tracking data", Advances in Complex Systems 10,
   2007, "elliptical II"), weaker from behind. It is turned a little to the right, so that two who meet head on pass
   instead of pushing.
2. A guarantee that forces alone do not give: nobody approaches another, or the edge of the area, faster than they could
   still brake within their half of the gap. So bodies never come closer than `KEEP_APART_M`.
3. People walk where they face: the wanted speed falls with the angle between way and heading, and the heading follows
   with a limited turning rate; short avoiding steps go sideways.

Places and velocities on the floor are complex numbers x + iy: a turn is a product, a length an absolute value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.people.scripts import Order

Array = NDArray[np.float64]
Planar = NDArray[np.complex128]

RELAXATION_S = 0.22
"""Time to reach the wanted velocity [s] (Helbing and Molnár: 0.5; ours is quicker, for sudden stops and starts)."""
REPULSION_M_S2 = 5.0
"""Repulsion between two people at the least distance [m/s²]."""
LOOK_AHEAD_S = 0.5
"""How far ahead relative motion counts in the repulsion [s]."""
REPULSION_RANGE_M = 0.18
"""Distance over which the repulsion falls by 1/e [m]."""
WALL_REPULSION_M_S2 = 1.5
WALL_RANGE_M = 0.12
SIGHT_FROM_BEHIND = 0.3
"""Share of the repulsion that somebody straight behind still has."""
STANDING_SHARE = 0.25
"""Share of the repulsion on somebody who stops: they are not pushed about by people who only pass."""
PASS_ON_THE_RIGHT_RAD = 0.5
ACCELERATION_M_S2 = 4.0
"""Greatest acceleration that wanting and forces ask for [m/s²]."""
BRAKING_M_S2 = 1.5
"""Deceleration that the guarantee counts on [m/s²]; more is used where the other comes on faster."""
KEEP_APART_M = 0.60
"""Least distance between the middles of two people [m]: about the breadth of a body."""
KEEP_FROM_EDGE_M = 0.15
"""Least distance of a person's middle from the edge of the area [m]."""
FACING = 1.5
"""Full speed is wanted where the way's cosine with the heading is above 1 / FACING (48 degrees), none beyond 90."""
HALT_PER_S = 2.0
"""Greatest speed per distance to a goal at which a person halts [1/s]."""
TURN_RATE = 2.6
"""Greatest turning rate [rad/s]."""
TURN_ACCELERATION = 25.0
"""[rad/s²]."""

_PROJECTIONS = 3
_PASSES = 1e6
_ROUNDING_M_S = 1e-9
_PASS = np.exp(1j * PASS_ON_THE_RIGHT_RAD)


class Crowd:
    """Places, velocities and headings of n people, each with an area they stay in.

    `place`, `velocity`, `acceleration` (n,) complex [m, m/s, m/s²]; `heading` (n,) [rad], unwrapped; `facing` (n,)
    complex, its direction; `turn_rate` (n,) [rad/s].
    """

    def __init__(self, place: Planar, heading: Array, areas: Sequence[Array | None], fixed: NDArray[np.bool_]) -> None:
        """areas: a polygon (k, 2) [m] a person, None: everywhere; fixed (n,): who does not give way."""
        count = len(place)
        self.place = place.copy()
        self.velocity = np.zeros(count, dtype=complex)
        self.acceleration = np.zeros(count, dtype=complex)
        self.heading = heading.copy()
        self.facing = np.exp(1j * heading)
        self.turn_rate = np.zeros(count)
        self._may_move = np.where(fixed, 0.0, 1.0)
        self._goal = place.copy()
        self._speed = np.zeros(count)
        self._slow_down = np.full(count, _PASSES)  # greatest speed per distance to the goal [1/s]
        self._arrive_m = np.zeros(count)
        self._going = np.zeros(count)  # 1 walks, 0 stands
        self._distance = np.full(count, np.inf)
        self._edge_start, self._edge_way = _edges(areas)
        self._edge_per_square = self._edge_way.conj() / np.abs(self._edge_way) ** 2
        self._self_far = np.where(np.eye(count, dtype=bool), 1e3, 0.0)
        self._rows = np.arange(count)

    def order(self, person: int, order: Order) -> None:
        """Give one person a new order."""
        self._going[person] = 0.0 if order.goal is None else 1.0
        if order.goal is not None:
            self._goal[person] = complex(*order.goal)
        self._speed[person] = order.speed_m_s
        self._slow_down[person] = HALT_PER_S if order.halt else _PASSES
        self._arrive_m[person] = order.arrive_m
        self._distance[person] = np.inf

    def arrived(self) -> NDArray[np.bool_]:
        """Who has come to their goal, (n,)."""
        return self._distance <= self._arrive_m

    def blocked(self) -> NDArray[np.bool_]:
        """Who wants to walk and hardly moves, (n,)."""
        return np.abs(self.velocity) < 0.12 * self._going

    def step(self, dt: float) -> None:
        """Move everybody by dt [s]."""
        way = self._goal - self.place
        length = np.abs(way)
        self._distance = np.where(self._going > 0, length, np.inf)
        way = way * (self._going / np.maximum(length, 1e-6))
        along = np.minimum(np.maximum(FACING * (way * self.facing.conj()).real, 0.0), 1.0)
        speed = np.minimum(self._speed * along, length * self._slow_down)
        push = (speed * way - self.velocity) / RELAXATION_S
        between = self.place - self.place[:, None]  # (n, n) from each to each
        distance = np.abs(between) + self._self_far
        towards = between / distance
        gap = distance - KEEP_APART_M
        push += self._repulsion(between, distance, towards)
        outwards, room = self._edge_gaps()
        push -= (np.exp(room * (-1.0 / WALL_RANGE_M)) * outwards).sum(axis=1) * WALL_REPULSION_M_S2
        push *= ACCELERATION_M_S2 / np.maximum(np.abs(push), ACCELERATION_M_S2)
        velocity = (self.velocity + push * dt) * self._may_move
        normals = np.concatenate([towards, outwards], axis=1)  # (n, n + edges)
        free = np.concatenate([0.5 * gap, room], axis=1)
        velocity = self._safe(velocity, normals, np.sqrt((2 * BRAKING_M_S2) * np.maximum(free, 0.0)))
        self.acceleration += min(1.0, 12.0 * dt) * ((velocity - self.velocity) / dt - self.acceleration)
        self.velocity = velocity
        self.place = self.place + velocity * dt
        self._turn(way, dt)

    def _repulsion(self, between: Planar, distance: Array, towards: Planar) -> Planar:
        """Social force (n,) [m/s²] of the others on each; between (n, n) [m] from each to each, and its polar form."""
        drift = (self.velocity - self.velocity[:, None]) * LOOK_AHEAD_S
        soon = between + drift
        soon_distance = np.abs(soon) + self._self_far
        both = distance + soon_distance
        axis = 0.5 * np.sqrt(np.maximum(both * both - np.abs(drift) ** 2, 1e-6))
        direction = 0.5 * (towards + soon / np.maximum(soon_distance, 1e-6))
        ahead = (towards * self.facing.conj()[:, None]).real
        weight = 0.5 * (1 + SIGHT_FROM_BEHIND) + 0.5 * (1 - SIGHT_FROM_BEHIND) * ahead
        force = np.exp((axis - KEEP_APART_M) * (-1.0 / REPULSION_RANGE_M)) * (0.5 * both / axis) * weight
        away = (force * direction).sum(axis=1)
        return away * (STANDING_SHARE + (1 - STANDING_SHARE) * self._going) * (-REPULSION_M_S2 * _PASS)

    def _edge_gaps(self) -> tuple[Planar, Array]:
        """Directions to the nearest place of each edge of one's area (n, k), and the room left before it (n, k) [m]."""
        offset = self.place[:, None] - self._edge_start
        along = np.minimum(np.maximum((offset * self._edge_per_square).real, 0.0), 1.0)
        to_edge = along * self._edge_way - offset
        distance = np.abs(to_edge)
        return to_edge / np.maximum(distance, 1e-9), distance - KEEP_FROM_EDGE_M

    def _safe(self, velocity: Planar, normals: Planar, limit: Array) -> Planar:
        """The velocities made to approach nothing faster than its limit.

        normals (n, k): directions to what is approached; limit (n, k) [m/s], not negative. Rounds of projection keep
        what motion there is along an obstacle; what is still too fast then is slowed as a whole.
        """
        inverse = normals.conj()
        approach = (inverse * velocity[:, None]).real
        for _ in range(_PROJECTIONS):
            excess = approach - limit
            worst = excess.argmax(axis=1)
            too_fast = np.maximum(excess[self._rows, worst], 0.0)
            if too_fast.max(initial=0.0) < _ROUNDING_M_S:
                return velocity
            velocity = velocity - too_fast * normals[self._rows, worst]
            approach = (inverse * velocity[:, None]).real
        share = np.where(approach > limit + _ROUNDING_M_S, limit / np.maximum(approach, 1e-12), 1.0).min(axis=1)
        return velocity * share

    def _turn(self, way: Planar, dt: float) -> None:
        """Turn towards where one goes and wants to go."""
        aim = self.velocity + (0.4 * self._going) * way
        error = aim * self.facing.conj()
        moves = np.abs(aim) > 0.15
        rate = np.minimum(np.maximum(7.0 * np.arctan2(error.imag, error.real), -TURN_RATE), TURN_RATE) * moves
        change = TURN_ACCELERATION * dt
        self.turn_rate = self.turn_rate + np.minimum(np.maximum(rate - self.turn_rate, -change), change)
        self.heading = self.heading + self.turn_rate * dt
        self.facing = np.exp(1j * self.heading)


def planar(points: Array) -> Planar:
    """Points (..., 2) as complex numbers."""
    return points[..., 0] + 1j * points[..., 1]


def _edges(areas: Sequence[Array | None]) -> tuple[Planar, Planar]:
    """Edges of each person's polygon, padded with one far away: starts and ways (n, k)."""
    most = max((len(area) for area in areas if area is not None), default=1)
    start: Planar = np.full((len(areas), most), 1e6 + 1e6j, dtype=complex)
    end: Planar = start + 1.0
    for place, area in enumerate(areas):
        if area is not None:
            start[place, : len(area)] = planar(area)
            end[place, : len(area)] = planar(np.roll(area, -1, axis=0))
    return start, end - start
