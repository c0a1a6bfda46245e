"""How people move over the floor among others: towards their goals, around each other, inside their area.

Three layers, for all people at once:

1. The social force model (D. Helbing and P. Molnár, "Social force model for pedestrian dynamics", Physical Review E 51,
   1995): a drive towards the wanted velocity within a relaxation time, and a repulsion between people (in the
   circular form of D. Helbing, I. Farkas and T. Vicsek, Nature 407, 2000) that falls off exponentially, weaker from behind. The
   repulsion is turned a little to the right, so that two who meet head on pass instead of pushing.
2. A guarantee that forces alone do not give: nobody approaches another, or the edge of the area, faster than they could
   still brake within their half of the gap. So bodies never come closer than `KEEP_APART_M`.
3. People walk where they face: the wanted speed falls with the angle between way and heading, and the heading follows
   with a limited turning rate; short avoiding steps go sideways.

Parameters are the constants below.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.people.scripts import Order

Array = NDArray[np.float64]

RELAXATION_S = 0.22
"""Time to reach the wanted velocity [s] (Helbing and Molnár: 0.5; ours is quicker, for sudden stops and starts)."""
REPULSION_M_S2 = 2.2
"""Repulsion between two people whose bodies touch [m/s²]."""
REPULSION_RANGE_M = 0.25
"""Distance over which the repulsion falls by 1/e [m]."""
WALL_REPULSION_M_S2 = 1.5
WALL_RANGE_M = 0.12
SIGHT_FROM_BEHIND = 0.3
"""Share of the repulsion that somebody straight behind still has."""
PASS_ON_THE_RIGHT_RAD = 0.5
ACCELERATION_M_S2 = 4.0
"""Greatest acceleration that wanting and forces ask for [m/s²]."""
BRAKING_M_S2 = 2.5
"""Deceleration that the guarantee counts on [m/s²]; more is used where the other comes on faster."""
KEEP_APART_M = 0.56
"""Least distance between the middles of two people [m]: about the breadth of a body."""
KEEP_FROM_EDGE_M = 0.15
"""Least distance of a person's middle from the edge of the area [m]."""
TURN_RATE = 3.0
"""Greatest turning rate [rad/s]."""
TURN_ACCELERATION = 25.0
"""[rad/s²]."""


class Crowd:
    """Positions, velocities and headings of n people, each with an area they stay in."""

    def __init__(self, position: Array, heading: Array, areas: Sequence[Array | None], fixed: NDArray[np.bool_]) -> None:
        """position (n, 2) [m], heading (n,) [rad]; areas: a polygon (k, 2) [m] a person, None: everywhere.

        fixed (n,): who does not give way.
        """
        count = len(position)
        self.position = position.astype(float)
        self.velocity = np.zeros((count, 2))
        self.acceleration = np.zeros((count, 2))
        self.heading = heading.astype(float)
        self.turn_rate = np.zeros(count)
        self._fixed = fixed
        self._goal = position.astype(float)
        self._speed = np.zeros(count)
        self._halt = np.zeros(count, dtype=bool)
        self._arrive_m = np.zeros(count)
        self._going = np.zeros(count, dtype=bool)
        self._distance = np.zeros(count)
        self._edge_start, self._edge_way, self._edge_square = _edges(areas)
        self._self_far = np.where(np.eye(count, dtype=bool), 1e3, 0.0)

    def order(self, place: int, order: Order) -> None:
        """Give one person a new order."""
        self._going[place] = order.goal is not None
        if order.goal is not None:
            self._goal[place] = order.goal
        self._speed[place] = order.speed_m_s
        self._halt[place] = order.halt
        self._arrive_m[place] = order.arrive_m
        self._distance[place] = np.inf

    def arrived(self) -> NDArray[np.bool_]:
        """Who has come to their goal, (n,)."""
        return self._going & (self._distance <= self._arrive_m)

    def blocked(self) -> NDArray[np.bool_]:
        """Who wants to walk and hardly moves, (n,)."""
        return self._going & (np.einsum("ni,ni->n", self.velocity, self.velocity) < 0.12**2)

    def step(self, dt: float) -> None:
        """Move everybody by dt [s]."""
        wanted, way = self._wanted()
        towards, gap = self._neighbours()
        accelerate = (wanted - self.velocity) / RELAXATION_S + self._repulsion(towards, gap, wanted)
        outwards, room = self._edge_gaps()
        accelerate -= np.einsum("nk,nki->ni", WALL_REPULSION_M_S2 * np.exp(-room / WALL_RANGE_M), outwards)
        size = np.sqrt(np.einsum("ni,ni->n", accelerate, accelerate))
        accelerate *= np.minimum(1.0, ACCELERATION_M_S2 / np.maximum(size, 1e-9))[:, None]
        velocity = self.velocity + accelerate * dt
        velocity[self._fixed] = 0.0
        normals = np.concatenate([towards, outwards], axis=1)  # (n, n + edges, 2)
        free = np.concatenate([0.5 * gap, room], axis=1)
        velocity = _safe(velocity, normals, np.sqrt(2 * BRAKING_M_S2 * np.maximum(free, 0.0)))
        self.acceleration += min(1.0, 12.0 * dt) * ((velocity - self.velocity) / dt - self.acceleration)
        self.velocity = velocity
        self.position = self.position + velocity * dt
        self._turn(way, dt)

    def _wanted(self) -> tuple[Array, Array]:
        """Wanted velocities (n, 2) [m/s] and directions to the goals (n, 2), zero for who stands."""
        way = self._goal - self.position
        self._distance = np.sqrt(np.einsum("ni,ni->n", way, way))
        direction = np.where(self._going[:, None], way / np.maximum(self._distance, 1e-6)[:, None], 0.0)
        facing = np.cos(self.heading) * direction[:, 0] + np.sin(self.heading) * direction[:, 1]
        speed = self._speed * np.clip(facing, 0.0, 1.0)
        stopping = np.sqrt(2 * 1.0 * self._distance)
        speed = np.where(self._halt, np.minimum(speed, stopping), speed)
        return speed[:, None] * direction, direction

    def _neighbours(self) -> tuple[Array, Array]:
        """Directions from each to each (n, n, 2), and the gaps beyond `KEEP_APART_M` (n, n) [m], huge to oneself."""
        between = self.position[None] - self.position[:, None]
        distance = np.sqrt(np.einsum("nmi,nmi->nm", between, between)) + self._self_far
        return between / distance[..., None], distance - KEEP_APART_M

    def _repulsion(self, towards: Array, gap: Array, wanted: Array) -> Array:
        """Social force (n, 2) [m/s²] of the others on each."""
        facing = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=-1)
        ahead = np.einsum("nmi,ni->nm", towards, facing)
        weight = SIGHT_FROM_BEHIND + (1 - SIGHT_FROM_BEHIND) * 0.5 * (1 + ahead)
        force = -REPULSION_M_S2 * np.exp(-gap / REPULSION_RANGE_M) * weight
        away = np.einsum("nm,nmi->ni", force, towards)
        # who stands is not pushed about by people who only pass
        away *= np.where(self._going, 1.0, 0.25)[:, None]
        cosine, sine = np.cos(PASS_ON_THE_RIGHT_RAD), np.sin(PASS_ON_THE_RIGHT_RAD)
        return away @ np.array([[cosine, sine], [-sine, cosine]])

    def _edge_gaps(self) -> tuple[Array, Array]:
        """Directions to the nearest place of each edge of one's area (n, k, 2), and the room left before it (n, k) [m]."""
        from_start = self.position[:, None] - self._edge_start
        along = np.clip(np.einsum("nki,nki->nk", from_start, self._edge_way) / self._edge_square, 0.0, 1.0)
        to_edge = along[..., None] * self._edge_way - from_start
        distance = np.sqrt(np.einsum("nki,nki->nk", to_edge, to_edge))
        return to_edge / np.maximum(distance, 1e-9)[..., None], distance - KEEP_FROM_EDGE_M

    def _turn(self, way: Array, dt: float) -> None:
        """Turn towards where one goes and wants to go."""
        aim = self.velocity + (0.4 * self._going)[:, None] * way
        heading = np.arctan2(aim[:, 1], aim[:, 0])
        error = (heading - self.heading + np.pi) % (2 * np.pi) - np.pi
        moves = np.einsum("ni,ni->n", aim, aim) > 0.15**2
        rate = np.where(moves, np.clip(7.0 * error, -TURN_RATE, TURN_RATE), 0.0)
        change = TURN_ACCELERATION * dt
        self.turn_rate = self.turn_rate + np.clip(rate - self.turn_rate, -change, change)
        self.heading = self.heading + self.turn_rate * dt


def _edges(areas: Sequence[Array | None]) -> tuple[Array, Array, Array]:
    """Edges of each person's polygon, padded with one far away: starts and ways (n, k, 2), squared lengths (n, k)."""
    most = max((len(area) for area in areas if area is not None), default=1)
    start = np.full((len(areas), most, 2), 1e6)
    end = start + 1.0
    for place, area in enumerate(areas):
        if area is not None:
            start[place, : len(area)] = area
            end[place, : len(area)] = np.roll(area, -1, axis=0)
    way = end - start
    return start, way, np.einsum("nki,nki->nk", way, way)


def _safe(velocity: Array, normals: Array, limit: Array) -> Array:
    """The velocities (n, 2) made to approach nothing faster than its limit.

    normals (n, k, 2): directions to what is approached; limit (n, k) [m/s], not negative. Two rounds of projection keep
    what motion there is along an obstacle; what is still too fast then is slowed as a whole.
    """
    rows = np.arange(len(velocity))
    for _ in range(2):
        excess = np.einsum("nki,ni->nk", normals, velocity) - limit
        worst = excess.argmax(axis=1)
        velocity = velocity - np.maximum(excess[rows, worst], 0.0)[:, None] * normals[rows, worst]
    approach = np.einsum("nki,ni->nk", normals, velocity)
    share = np.where(approach > limit, limit / np.maximum(approach, 1e-12), 1.0).min(axis=1)
    return velocity * share[:, None]
