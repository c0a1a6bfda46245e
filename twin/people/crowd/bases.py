"""Bases that drive among people: housings on wheels, stepped with the crowd, avoided by it and braking for it.

A base is a differential drive: it turns, and goes where it faces. It heads for the next corner of its way around furniture,
turned aside by people and things near by (the repulsion of the social force model, as an angle), and approaches nothing faster
than it can still brake. People feel it as they feel each other and count on its motion (`twin.people.crowd.crowd`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np

from trackers.arrays import Array, Mask, Planar
from twin.people.crowd.ground import Ground
from twin.people.crowd.motion_command import SeenBases
from twin.room.obstacles import Footprints
from twin.scenario.housings import FollowDrive, Housing, PathDrive

_ACCELERATION_M_S2, _BRAKING_M_S2, _TURN_ACCELERATION = 0.8, 1.5, 4.0
_TURNS_PER_S = 2.5
"""Turning rate per error of the heading [1/s]."""
_SHY_M, _SHY_OF_THINGS_M = 0.5, 0.15
"""Distances over which the repulsion by people and by things falls by 1/e [m]."""
_CLEAR_M = 0.35
"""Room for a standing body beside the base [m]."""
_OFF_THINGS_M = 0.05
_ARRIVES_M, _NEW_WAY_S, _GIVES_UP_S = 0.3, 0.5, 8.0
_FEELS_M_S2, _FEELS_OVER_M = 4.0, 0.3
"""Repulsion of people by a base at the least distance [m/s²], and the distance over which it falls by 1/e [m]."""
_PASS_ON_THE_RIGHT = np.exp(0.5j)
_PLAIN_REACH_M = 0.2
"""Radius of a base without a body [m]."""


class MovingBases:
    """Places, headings and speeds of m bases, and their history.

    `place`, `velocity` (m,) complex [m, m/s]; `heading` (m,) [rad], unwrapped; `reach_m` (m,): radius of each.
    """

    def __init__(
        self,
        housings: Mapping[str, Housing],
        ground: Ground,
        people: Sequence[str],
        rngs: Mapping[str, np.random.Generator],
        tick_s: float,
        history_s: float,
    ) -> None:
        """housings: those that drive; people: names in the order of the crowd; rngs: a generator per base."""
        self.names = tuple(housings)
        self._drives = [housing.drive for housing in housings.values() if housing.drive is not None]
        mounts = [housing.mount for housing in housings.values()]
        self.place = np.array([complex(each.xyz[0], each.xyz[1]) for each in mounts], dtype=complex)
        self.heading = np.radians([each.yaw_deg for each in mounts])
        self._z_m = np.array([each.xyz[2] for each in mounts])
        self.reach_m = np.array([h.body.reach_m if h.body is not None else _PLAIN_REACH_M for h in housings.values()])
        self.velocity = np.zeros(len(mounts), dtype=complex)
        self._turn_rate = np.zeros(len(mounts))
        self._ground, self._rngs = ground, [rngs[name] for name in self.names]
        self._things = Footprints(ground.obstacles)
        self._number = {name: number for number, name in enumerate(people)}
        self._ways: list[list[complex]] = [[] for _ in mounts]
        self._next = [0] * len(mounts)
        self._planned_s, self._stuck_s = np.full(len(mounts), -np.inf), np.zeros(len(mounts))
        self._tick_s, self._size = tick_s, round(history_s / tick_s) + 2
        self._rows = np.zeros((self._size, 3, len(mounts)))
        self._tick = 0
        self._keep()

    def at(self, t: float) -> dict[str, Array]:
        """Return the pose (4, 4) of each base in the room at time t [s], by name; raises ValueError for a time not kept."""
        place = t / self._tick_s
        before = min(int(place + 1e-9), self._tick)
        oldest = max(0, self._tick - self._size + 2)
        if not oldest <= place + 1e-9 <= self._tick + 1e-6:
            raise ValueError(
                f"t = {t} s is not between {oldest * self._tick_s:.2f} and {self._tick * self._tick_s:.2f} s, for which "
                "the places of bases are kept"
            )
        share = max(place - before, 0.0)
        early, late = self._rows[before % self._size], self._rows[min(before + 1, self._tick) % self._size]
        x, y, yaw = early + share * (late - early)
        found = {}
        for number, name in enumerate(self.names):
            pose = np.eye(4)
            cosine, sine = np.cos(yaw[number]), np.sin(yaw[number])
            pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
            pose[:3, 3] = x[number], y[number], self._z_m[number]
            found[name] = pose
        return found

    def seen_from(self, place: Planar, braking: Array) -> SeenBases:
        """Return the influence of the bases on people at these places (n,), who brake at most by `braking` (n,) [m/s²].

        The push of the social force model is turned a little to the right. Nobody approaches a base faster than they can still
        brake, less the base's own motion.
        """
        way = self.place - place[:, None]
        distance = np.maximum(np.abs(way), 1e-9)
        towards, room = way / distance, distance - self.reach_m - _CLEAR_M
        force = np.exp(np.maximum(room, 0.0) / -_FEELS_OVER_M) * towards
        comes_on = np.maximum(-(towards.conj() * self.velocity).real, 0.0)
        limit = np.sqrt(2 * braking[:, None] * np.maximum(room, 0.0)) - comes_on
        return SeenBases(force.sum(axis=1) * (-_FEELS_M_S2 * _PASS_ON_THE_RIGHT), towards, limit)

    def step(self, t: float, place: Planar, velocity: Planar, present: Mask) -> None:
        """Drive all bases on by a tick; place, velocity, present (n,): of the people, in the order of `people`."""
        for number in range(len(self.names)):
            goal, speed = self._goal(number, t, place, velocity, present)
            self._drive(number, goal, speed, place[present], velocity[present])
        self._tick += 1
        self._keep()

    def _keep(self) -> None:
        self._rows[self._tick % self._size] = self.place.real, self.place.imag, self.heading

    def _goal(self, number: int, t: float, place: Planar, velocity: Planar, present: Mask) -> tuple[complex, float]:
        """Return where a base heads for next [m], and at which speed at most [m/s]."""
        drive, here = self._drives[number], self.place[number]
        if isinstance(drive, FollowDrive):
            person = self._number.get(drive.person)
            if person is None or not present[person]:
                return here, 0.0
            gap = abs(place[person] - here) - drive.distance_m
            speed = float(np.clip(1.2 * gap + abs(velocity[person]) * (gap > -0.2), 0.0, drive.speed_m_s))
            if t - self._planned_s[number] >= _NEW_WAY_S:
                self._plan(number, t, place[person])
            if len(self._ways[number]) <= 1:
                return place[person], speed
            self._pass_corners(number)
            return self._ways[number][0], speed
        self._stuck_s[number] = 0.0 if abs(self.velocity[number]) > 0.05 else self._stuck_s[number] + self._tick_s
        if not self._ways[number] or self._stuck_s[number] > _GIVES_UP_S:
            self._stuck_s[number] = 0.0
            target = self._target(number)
            if target is None:
                return here, 0.0
            self._plan(number, t, target)
        self._pass_corners(number)
        if not self._ways[number]:
            return here, 0.0
        left = abs(self._ways[number][0] - here) if len(self._ways[number]) == 1 else np.inf
        return self._ways[number][0], min(drive.speed_m_s, 0.15 + left)

    def _target(self, number: int) -> complex | None:
        """Return the next place to go to; None at the end of a path."""
        drive = self._drives[number]
        if isinstance(drive, PathDrive):
            if self._next[number] >= len(drive.waypoints) and not drive.repeat:
                return None
            waypoint = drive.waypoints[self._next[number] % len(drive.waypoints)]
            self._next[number] += 1
            return complex(*waypoint)
        return complex(*self._ground.free_places(1, self._rngs[number])[0])

    def _plan(self, number: int, t: float, target: complex) -> None:
        here = self.place[number]
        ends = np.array([[here.real, here.imag], [target.real, target.imag]])
        way = self._ground.routes.way(*ends)
        corners = [target] if way is None else [complex(x, y) for x, y in way if abs(complex(x, y) - here) > 1e-6]
        self._ways[number] = corners or [target]
        self._planned_s[number] = t

    def _pass_corners(self, number: int) -> None:
        way = self._ways[number]
        while way and abs(way[0] - self.place[number]) < _ARRIVES_M:
            way.pop(0)

    def _drive(self, number: int, goal: complex, speed: float, place: Planar, velocity: Planar) -> None:
        """Turn and go towards a goal by one tick, aside of people and things, and slower than it could still brake."""
        drive, dt = self._drives[number], self._tick_s
        here, facing = self.place[number], np.exp(1j * self.heading[number])
        way = goal - here
        wanted = way / max(abs(way), 1e-9) if speed > 0 else facing
        others = place - here
        distance = np.maximum(np.abs(others), 1e-9)
        towards, room = others / distance, distance - self.reach_m[number] - _CLEAR_M
        things, gap = self._things.gaps(np.array([here]))
        gap = gap[0] - self.reach_m[number] - _OFF_THINGS_M
        aside = (np.exp(np.maximum(room, 0) / -_SHY_M) * towards).sum() * _PASS_ON_THE_RIGHT
        aside = aside + (np.exp(np.maximum(gap, 0) / -_SHY_OF_THINGS_M) * things[0]).sum()
        if isinstance(drive, FollowDrive):
            aside = 0.3 * aside  # the one who is followed is ahead
        error = float(np.angle((wanted - 0.8 * aside * (speed > 0)) / facing))
        turn = float(np.clip(_TURNS_PER_S * error, -drive.turn_rate, drive.turn_rate))
        change = np.clip(turn - self._turn_rate[number], -_TURN_ACCELERATION * dt, _TURN_ACCELERATION * dt)
        self._turn_rate[number] += change
        ahead = speed * max(np.cos(error), 0.0) if abs(error) < pi / 2 else 0.0
        directions, free = np.concatenate([towards, things[0]]), np.concatenate([room, gap])
        comes_on = np.concatenate([np.maximum(-(towards.conj() * velocity).real, 0.0), np.zeros(len(gap))])
        approach = (directions.conj() * facing).real
        limit = np.maximum(np.sqrt(2 * _BRAKING_M_S2 * np.maximum(free, 0.0)) - comes_on, 0.0)
        blocks = approach > 0.05
        if blocks.any():
            ahead = min(ahead, float((limit[blocks] / approach[blocks]).min()))
        now = abs(self.velocity[number])
        now = float(np.clip(ahead, now - 2 * _BRAKING_M_S2 * dt, now + _ACCELERATION_M_S2 * dt))
        self.heading[number] += self._turn_rate[number] * dt
        self.velocity[number] = now * np.exp(1j * self.heading[number])
        self.place[number] = here + self.velocity[number] * dt
