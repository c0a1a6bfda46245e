"""Motion of people over the floor among others: towards their goals, around each other, inside their area.

Three layers, for all people at once:

1. The social force model (D. Helbing and P. Molnár, "Social force model for pedestrian dynamics", Physical Review E 51,
   1995): a drive towards the wanted velocity within a relaxation time, and a repulsion between people, here in the
   elliptical form that looks ahead by the relative velocity (A. Johansson, D. Helbing and P. Shukla, "Specification of
   the social force pedestrian model by evolutionary adjustment to video tracking data", Advances in Complex Systems 10,
   2007, "elliptical II"), weaker from behind. It is turned a little to the right, so that two who meet head on pass
   instead of pushing. Walls and furniture repel by their nearest point, as in the first paper.
2. A guarantee beyond forces: people approach others, furniture, and the edge of the area only as fast as
   they could still brake within the gap (within their half of it where the other is a person). So bodies never come
   closer than `KEEP_APART_M` and the clearance of the scenario. Runners count on harder braking.
3. People walk where they face: the wanted speed falls with the angle between way and heading, and the heading follows
   with a limited turning rate; short avoiding steps go sideways. People who hold a heading step backwards and sideways, slowly.

Driven people keep a given path, tick by tick, feel nothing, and are avoided by the others. Absent people exert and feel
nothing.

No library of crowds is used: truth and recordings follow from these steps to the bit.

Positions and velocities on the floor are complex numbers x + iy: a turn is a product, a length an absolute value.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask, Planar
from twin.people.crowd.motion_command import (
    KEEP_APART_M,
    ROUNDING_M_S,
    Bases,
    MotionCommand,
    arms_in,
    least_apart,
    repulsion,
    room_made,
    slowed_down,
    stretched,
)
from twin.room.obstacles import KEEP_FROM_FURNITURE_M, Footprints, Obstacle, edges_of

RELAXATION_S = 0.22
"""Relaxation time to the desired velocity [s] (Helbing and Molnár: 0.5; ours is shorter, for sudden stops and starts)."""
WALL_REPULSION_M_S2 = 1.5
"""Repulsion by an edge of the area or furniture at the least distance [m/s²]."""
WALL_RANGE_M = 0.12
ACCELERATION_M_S2 = 4.0
"""Greatest acceleration of drive and repulsion together [m/s²]."""
BRAKING_M_S2 = 1.5
"""Guaranteed deceleration up to `BRISK_M_S` [m/s²]; more is used where the other approaches faster."""
BRISK_M_S = 2.0
"""Commanded speed up to which people brake as walkers [m/s]."""
RUNNER_BRAKES_PER_S = 0.7
"""Additional deceleration of runners for each m/s above `BRISK_M_S` [1/s]: 3.6 m/s² at 5 m/s."""
NEAR_M = 0.12
"""Least distance from furniture that a command may approach [m]: standing with the calves at the edge of a seat."""
FACING = 1.5
"""Full speed is desired where the cosine between way and heading is above 1 / FACING (48 degrees), none beyond 90."""
TAKEN_WITHIN_M = 1.0
"""Distance from which a person sees that a goal is taken [m]."""
LATERAL_M_S = 0.8
"""Greatest speed sideways and backwards of people who hold a heading [m/s]."""
HALTING_M = 0.5
"""Distance to a halting place from which the repulsion of walls and furniture fades [m]."""
HALT_PER_S = 2.0
"""Greatest speed of halting per distance to the goal [1/s]."""
TURN_RATE = 2.6
"""Greatest turning rate [rad/s]."""
TURN_ACCELERATION = 25.0
"""Greatest turning acceleration [rad/s²]."""
FOLLOWS_FROM_M_S = 0.15
"""Speed below which the heading does not follow the motion [m/s]."""

_PASSES = 1e6
_ALL = slice(None)


class Crowd:
    """Positions, velocities and headings of n people, each confined to an area.

    `place`, `velocity`, `acceleration` (n,) complex [m, m/s, m/s²]; `heading` (n,) [rad], unwrapped; `facing` (n,) complex,
    its direction; `turn_rate` (n,) [rad/s]; `present` (n,): in the room, initially all; `driven` (n,): on a path given by
    `drive`, initially none. The last two may be written between steps. `bases`: bases that drive, which are avoided.
    """

    def __init__(
        self,
        place: Planar,
        heading: Array,
        areas: Sequence[Array | None],
        obstacles: Sequence[Obstacle] = (),
        clearance_m: float = KEEP_FROM_FURNITURE_M,
    ) -> None:
        """areas: polygon (k, 2) [m] per person, None: everywhere; obstacles: all within reach (`obstacles.within_reach`);
        clearance_m: least distance of people's middles from them [m].
        """
        count = len(place)
        self.place = place.copy()
        self.velocity = np.zeros(count, dtype=complex)
        self.acceleration = np.zeros(count, dtype=complex)
        self.heading = heading.copy()
        self.facing = np.exp(1j * heading)
        self.turn_rate = np.zeros(count)
        self.present = np.ones(count, dtype=bool)
        self.driven = np.zeros(count, dtype=bool)
        self._path_place = place.copy()
        self._path_velocity = np.zeros(count, dtype=complex)
        self._may_move = np.ones(count)
        self._goal = place.copy()
        self._speed = np.zeros(count)
        self._braking = np.full(count, BRAKING_M_S2)
        self._slow_down = np.full(count, _PASSES)  # greatest speed per distance to the goal [1/s]
        self._halts = np.zeros(count, dtype=bool)
        self._slow_late = np.full(count, _PASSES)  # greatest square of the speed per distance to the goal [m/s²]
        self._arrive_m = np.zeros(count)
        self._going = np.zeros(count)  # 1 walks, 0 stands
        self._holds = np.zeros(count, dtype=bool)  # a heading
        self._hold = np.zeros(count)
        self._distance = np.full(count, np.inf)
        self._furniture = Footprints(obstacles)
        edges, keep_from_edges = edges_of(areas)
        self._barriers = Footprints([*obstacles, *edges])
        self._keep_m = clearance_m
        keep_from_furniture = np.full((count, len(obstacles)), clearance_m)
        self._clearance = np.concatenate([keep_from_furniture, keep_from_edges], axis=1)  # (n, obstacles + edges)
        self._repels = np.ones(self._clearance.shape)
        self._heeds_walls = np.full(count, _PASSES)  # share of their repulsion per distance to the goal [1/m]
        self._self_far = np.where(np.eye(count, dtype=bool), 1e3, 0.0)
        self._companions = np.zeros((count, count), dtype=bool)  # who walks with whom
        self._companion_m = np.full(count, KEEP_APART_M)  # least distance abreast of them [m]
        self._keeps_step = np.zeros(count, dtype=bool)
        self._stretch = np.zeros(count, dtype=complex)
        self._commanded()
        self._gap_m = np.full((count, len(obstacles)), np.inf)  # from things beside, and the ways there
        self._to_things = np.zeros((count, len(obstacles)), dtype=complex)
        self.bases: Bases | None = None

    def command(self, person: int, command: MotionCommand) -> None:
        """Give one person a new command; raises ValueError for furniture that has no obstacle."""
        self._going[person] = 0.0 if command.goal is None else 1.0
        if command.goal is not None:
            self._goal[person] = complex(*command.goal)
        self._speed[person] = command.speed_m_s
        self._braking[person] = BRAKING_M_S2 + RUNNER_BRAKES_PER_S * max(command.speed_m_s - BRISK_M_S, 0.0)
        self._halts[person] = command.halt
        self._slow_down[person] = HALT_PER_S if command.halt else _PASSES
        self._slow_late[person] = 2.0 * self._braking[person] if command.halt else _PASSES
        self._arrive_m[person] = command.arrive_m
        self._distance[person] = np.inf
        self._holds[person] = command.heading is not None
        self._hold[person] = 0.0 if command.heading is None else command.heading
        self._may_move[person] = 0.0 if command.immovable else 1.0
        self._heeds_walls[person] = 1.0 / HALTING_M if command.halt else _PASSES
        self._companions[person] = False
        self._companions[person, list(command.companions)] = True
        self._keeps_step[person] = command.keeps_step
        self._companion_m[person] = min(command.companion_m, KEEP_APART_M)
        self._stretch[person] = command.stretch
        near = self._furniture.belong_to(command.near)
        self._clearance[person, : len(near)] = np.where(near, NEAR_M, self._keep_m)
        self._repels[person, : len(near)] = ~near
        self._commanded()

    def _commanded(self) -> None:
        """Note which wishes anybody has: a step works out nothing for others."""
        self._anybody_accompanies = bool(self._companions.any())
        self._anybody_abreast = bool((self._companion_m < KEEP_APART_M).any())
        self._anybody_keeps_step = bool(self._keeps_step.any())
        self._anybody_stretches = bool(self._stretch.any())
        self._anybody_holds = bool(self._holds.any())
        self._anybody_halts = bool(self._halts.any())

    def enter(self, person: int, place: complex, heading: float, velocity: complex = 0j) -> None:
        """Bring one person into the room at a position [m], heading [rad] and velocity [m/s]."""
        self.present[person] = True
        self.place[person], self.velocity[person] = place, velocity
        self.heading[person], self.facing[person] = heading, np.exp(1j * heading)
        self.acceleration[person], self.turn_rate[person] = 0.0, 0.0
        self._distance[person] = np.inf

    def drive(self, place: Planar, velocity: Planar) -> None:
        """Set where `driven` people will be after the next step, (n,) each [m, m/s]; other rows are unused."""
        self._path_place, self._path_velocity = place, velocity

    def face(self, people: NDArray[np.intp], heading: Array) -> None:
        """Have some people (k,) face headings (k,) [rad] until their next command."""
        self._holds[people], self._hold[people] = True, heading
        self._anybody_holds = bool(self._holds.any())

    def arrived(self) -> Mask:
        """Return a mask (n,) of the people who have reached their goal."""
        return (self._distance <= self._arrive_m) & self.present

    def halting(self, within_m: float) -> Mask:
        """Return a mask (n,) of the people about to halt at a goal less than `within_m` [m] away."""
        if not self._anybody_halts:
            return np.zeros(len(self._halts), dtype=bool)
        return (self._distance < within_m) & self._halts & self.present

    def taken(self) -> Mask:
        """Return a mask (n,) of the people about to halt at a goal that another occupies."""
        close = self.halting(TAKEN_WITHIN_M)
        if not np.count_nonzero(close):
            return close
        others = self.present & (self._self_far == 0)
        near = (np.abs(self.place - self._goal[:, None]) < KEEP_APART_M) & others
        return near.any(axis=1) & close

    def blocked(self) -> Mask:
        """Return a mask (n,) of the people who want to walk and hardly move."""
        return (np.abs(self.velocity) < 0.12 * self._going) & self.present & ~self.driven

    def step(self, dt: float) -> None:
        """Move all people present by dt [s]."""
        rows: Any = _ALL if np.count_nonzero(self.present) == len(self.present) else np.flatnonzero(self.present)
        place, before, facing, going = self.place[rows], self.velocity[rows], self.facing[rows], self._going[rows]
        driven = self.driven[rows]
        anybody_driven = np.count_nonzero(driven) > 0
        if anybody_driven:
            going = np.where(driven, 0.0, going)
        way = self._goal[rows] - place
        length = np.abs(way)
        self._distance = self._spread(self._distance, rows, np.where(going > 0, length, np.inf))
        way = way * (going / np.maximum(length, 1e-6))
        push = (self._wanted_speed(rows, way, length, before, facing) * way - before) / RELAXATION_S
        between = place - place[:, None]  # (n, n) from each to each
        self_far = self._self_far[: len(place), : len(place)]
        distance = np.maximum(np.abs(between), ROUNDING_M_S) + self_far  # recorded paths may meet in one point
        towards = between / distance
        push += repulsion(between, distance, towards, before, facing, going, self._unfelt(rows, self_far))
        outwards, room = self._barriers.gaps(place)
        things = slice(self._gap_m.shape[1])
        self._gap_m[rows], self._to_things[rows] = room[:, things], outwards[:, things]
        room = room - self._clearance[rows]
        from_walls = self._repels[rows] * np.exp(np.maximum(room, 0.0) * (-1.0 / WALL_RANGE_M)) * outwards
        # people who stand stay, and people who halt by a wall come up to it
        keeps_off = going * np.minimum(length * self._heeds_walls[rows], 1.0)
        push -= from_walls.sum(axis=1) * (WALL_REPULSION_M_S2 * keeps_off)
        to_bases = None if self.bases is None else self.bases.seen_from(place, self._braking[rows])
        if to_bases is not None:
            push += to_bases.push
        push *= ACCELERATION_M_S2 / np.maximum(np.abs(push), ACCELERATION_M_S2)
        velocity = (before + push * dt) * self._may_move[rows]
        if self._anybody_stretches:
            to_arms, off_arms = stretched(place, self._stretch[rows])
            outwards, room = np.concatenate([outwards, to_arms], axis=1), np.concatenate([room, off_arms], axis=1)
        normals = np.concatenate([towards, outwards], axis=1)  # (n, n + edges + obstacles)
        gap = distance - self._least_apart(rows, towards, facing)
        if anybody_driven:  # they will not brake: the other gets the whole gap, less their own motion
            gap = np.where(driven, 2.0 * gap, gap)
        free = np.concatenate([0.5 * gap, room], axis=1)
        limit = np.sqrt((2 * self._braking[rows, None]) * np.maximum(free, 0.0))
        if anybody_driven:
            limit[:, : len(place)] -= np.maximum(-(towards.conj() * before).real, 0.0) * driven
        if self._anybody_keeps_step:
            limit[:, : len(place)] += room_made(
                self._companions[rows][:, rows], self._keeps_step[rows], towards, before
            )
        if to_bases is not None:
            normals = np.concatenate([normals, to_bases.towards], axis=1, dtype=complex)
            limit = np.concatenate([limit, to_bases.limit], axis=1)
        velocity = slowed_down(velocity, normals, limit)
        after = place + velocity * dt
        if anybody_driven:
            velocity = np.where(driven, self._path_velocity[rows], velocity)
            after = np.where(driven, self._path_place[rows], after)
        change = min(1.0, 12.0 * dt) * ((velocity - before) / dt - self.acceleration[rows])
        self.acceleration = self._spread(self.acceleration, rows, self.acceleration[rows] + change)
        self.velocity = self._spread(self.velocity, rows, velocity)
        self.place = self._spread(self.place, rows, after)
        self._turn(rows, velocity + (0.4 * going) * way, dt)

    def _unfelt(self, rows: Any, self_far: Array) -> Array:
        """Return a great length (n, n) [m] where a person present does not feel the other: itself and companions."""
        if not self._anybody_accompanies:
            return self_far
        together = self._companions[rows][:, rows]
        return np.where(together | together.T, 1e3, self_far)

    def _least_apart(self, rows: Any, towards: Planar, facing: Planar) -> Array | float:
        """Return the least distance between people present, (n, n) [m] or one for all."""
        if not self._anybody_abreast:
            return KEEP_APART_M
        return least_apart(
            self._companions[rows][:, rows], self._companion_m[rows], self._keeps_step[rows], towards, facing
        )

    def arms_in(self) -> Array | float:
        """Return the fraction by which each holds in the left and the right arm, (2, n); 0 where all are far apart."""
        between = self.place - self.place[:, None]
        apart = np.abs(between) + self._self_far
        if np.count_nonzero(self.present) < len(apart):
            apart = np.where(self.present & self.present[:, None], apart, np.inf)
        return arms_in(apart, between, self._gap_m, self._to_things, self.facing)

    @staticmethod
    def _spread(whole: NDArray[Any], rows: Any, part: NDArray[Any]) -> NDArray[Any]:
        """Return `whole` (n,) with the rows of people present replaced by `part`."""
        if rows is _ALL:
            return part
        whole = whole.copy()
        whole[rows] = part
        return whole

    def _wanted_speed(self, rows: Any, way: Planar, length: Array, velocity: Planar, facing: Planar) -> Array:
        """Return the desired speeds along unit ways (0 for standing) that end after `length` [m]."""
        speed = self._speed[rows]
        along = np.minimum(np.maximum(FACING * (way * facing.conj()).real, 0.0), 1.0)
        slowed = speed * along
        if self._anybody_holds:
            holds = self._holds[rows]
            lateral = np.minimum(speed, LATERAL_M_S)
            slowed = np.where(holds, lateral + (speed - lateral) * along, slowed)
        # speeds follow RELAXATION_S late: a fast person slows down that much earlier
        left = np.maximum(length - RELAXATION_S * np.abs(velocity), 0.0)
        return np.minimum(slowed, np.minimum(length * self._slow_down[rows], np.sqrt(left * self._slow_late[rows])))

    def _turn(self, rows: Any, aim: Planar, dt: float) -> None:
        """Turn towards the motion and the desired way, weighted in `aim` [m/s], or to the held heading."""
        moves = np.abs(aim) > FOLLOWS_FROM_M_S
        if self._anybody_holds:
            holds = self._holds[rows]
            aim = np.where(holds, np.exp(1j * self._hold[rows]), aim)
            moves = moves | holds
        error = aim * self.facing[rows].conj()
        rate = np.minimum(np.maximum(7.0 * np.arctan2(error.imag, error.real), -TURN_RATE), TURN_RATE) * moves
        change = TURN_ACCELERATION * dt
        turn_rate = self.turn_rate[rows]
        turn_rate = turn_rate + np.minimum(np.maximum(rate - turn_rate, -change), change)
        heading = self.heading[rows] + turn_rate * dt
        self.turn_rate = self._spread(self.turn_rate, rows, turn_rate)
        self.heading = self._spread(self.heading, rows, heading)
        self.facing = self._spread(self.facing, rows, np.exp(1j * heading))


def planar(points: Array) -> Planar:
    """Return points (..., 2) as complex numbers x + iy."""
    return points[..., 0] + 1j * points[..., 1]
