"""One person as their script sees them: where they are, who else is there, what they can do."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, inf, radians, sin
from typing import Literal

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.crowd import Crowd
from twin.people.crowd.ground import Ground
from twin.people.crowd.motion_command import MotionCommand
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.postures import Postures
from twin.people.posture.resting import lying_pose, seated_pose
from twin.room.furniture import Bed, Seat
from twin.scenario.action import Target
from twin.scenario.behaviour import Look

_EYE_LEVEL_M = 1.5
"""Height of a place that is given on the floor, when it is looked at [m]."""
_BEFORE_M = 0.28
"""From where one sits down to where one turns round before [m]."""
_IN_THE_WAY_M = 1.0
"""Somebody so near to whoever does not get on is taken to be in their way [m]."""
_LATE, _SETS_OUT_S = 2.0, 2.0
"""Whoever takes more than this multiple of the way's time, and this long for setting out [s], is late."""


@dataclass(frozen=True)
class Approach:
    """Approach of a seat or bed: the place to turn round (2,), and to stand before sitting down [m], facing `heading`
    [rad]."""

    turns_round_at: Array
    stands_at: tuple[float, float]
    heading: float


def approaches(
    furniture: Seat | Bed, measures: BodyMeasures, person: int, adjacent: complex | None = None
) -> list[Approach]:
    """Return the ways in which a person can sit down on a seat, or lie down on a bed from either side.

    beside: x + iy [m]; the side of a bed that is nearest to it comes first.
    """
    if isinstance(furniture, Seat):
        poses = [seated_pose(furniture, measures, person)]
    else:
        sides = [complex(x, y) for x, y in furniture.bedside(0.0)]
        if adjacent is not None:
            sides.sort(key=lambda side: abs(side - adjacent))
            sides[0] = adjacent
        poses = [lying_pose(furniture, measures, person, side).edge for side in sides]
    found = []
    for pose in poses:
        stands_at = (pose.standing_place.real, pose.standing_place.imag)
        turns_at = np.array([stands_at[0] + _BEFORE_M * cos(pose.yaw), stands_at[1] + _BEFORE_M * sin(pose.yaw)])
        found.append(Approach(turns_at, stands_at, pose.yaw))
    return found


@dataclass(frozen=True)
class Going:
    """A walk under way: its goal in words, its begin [s], and how long the way takes [s]; None: no way leads there."""

    goal: str
    since_s: float
    takes_s: float | None


@dataclass(eq=False)
class Group:
    """People who walk together: their numbers from left to right as they walk, of whom `leader` leads.

    `gap_m`: the distance that neighbours keep now [m]; `ring`: where each stands while they talk, None: they walk;
    `changes`: the number of the one who is changing sides, None: nobody is; `spaced_until_s`, `changes_at_s`: when the
    distance changes, and when somebody changes sides [s].
    """

    leader: int
    formation: Literal["abreast", "v", "file"]
    gap_m: float
    order: list[int]
    ring: dict[int, complex] | None = None
    changes: int | None = None
    spaced_until_s: float = 0.0
    changes_at_s: float = inf

    @property
    def others(self) -> list[int]:
        """Those who follow the leader."""
        return [number for number in self.order if number != self.leader]


@dataclass(eq=False)
class ScriptContext:
    """State that all actors share: the clock, places and postures of all people, the room.

    `doing`: the kind of action that each is at; `taken`: who uses a seat or bed; `leaving`: who is to go, `gone`: who has
    gone; `looks_until`: when a turned head is free again [s]; `going`: where those who are on their way are to come to;
    `groups`: those who walk together, by the number of the person who leads them.
    """

    names: tuple[str, ...]
    crowd: Crowd
    postures: Postures
    ground: Ground
    t: float = 0.0
    doing: list[str] = field(default_factory=list)
    taken: dict[str, int] = field(default_factory=dict)
    leaving: set[int] = field(default_factory=set)
    departed: set[int] = field(default_factory=set)
    looks_until: dict[int, float] = field(default_factory=dict)
    going: dict[int, Going] = field(default_factory=dict)
    groups: dict[int, Group] = field(default_factory=dict)

    def late(self) -> list[str]:
        """Tell who has not arrived in twice the time that the way takes, one sentence each."""
        messages = []
        for number, going in sorted(self.going.items()):
            took_s = self.t - going.since_s
            if not self.crowd.present[number] or took_s <= _LATE * (going.takes_s or 0.0) + _SETS_OUT_S:
                continue
            apart_m = np.where(self.crowd.present, np.abs(self.crowd.place - self.crowd.place[number]), inf)
            apart_m[number] = inf
            nearest = int(apart_m.argmin())
            why = (
                f"{self.names[nearest]} is in the way"
                if apart_m[nearest] < _IN_THE_WAY_M
                else "something is in the way"
            )
            why = "no way leads there" if going.takes_s is None else why
            messages.append(f"{self.names[number]} has not reached {going.goal} after {took_s:.0f} s: {why}")
        return messages

    def number_of(self, name: str) -> int:
        """Return the index of a person in all arrays."""
        return self.names.index(name)

    def end_looks(self) -> None:
        """Free the heads of those who have looked as long as they were to."""
        for number in [number for number, until in self.looks_until.items() if self.t >= until]:
            self.postures.look_ahead(number)
            del self.looks_until[number]


class Actor:
    """One of the people of a scenario, with a generator of their own."""

    def __init__(self, context: ScriptContext, number: int, rng: np.random.Generator) -> None:
        self.context = context
        self.number = number
        self.rng = rng

    @property
    def t(self) -> float:
        """The people's clock [s]."""
        return self.context.t

    @property
    def here(self) -> Array:
        """Place of the person, (2,) [m]."""
        return self.place_of(self.number)

    @property
    def heading(self) -> float:
        """Heading of the person [rad]."""
        return float(self.context.crowd.heading[self.number])

    def place_of(self, number: int) -> Array:
        """Return the place of a person, (2,) [m]."""
        place = self.context.crowd.place[number]
        return np.array([place.real, place.imag])

    def target(self, target: Target) -> Array:
        """Return the ground point of somebody by name or of a place, (2,) [m]."""
        if isinstance(target, str):
            return self.place_of(self.context.number_of(target))
        return np.array(target[:2])

    def distance_to(self, target: Target) -> float:
        """Return distance on the floor [m]; infinite to somebody who is not there."""
        if isinstance(target, str) and not self.context.crowd.present[self.context.number_of(target)]:
            return inf
        return float(np.linalg.norm(self.target(target) - self.here))

    def bearing_of(self, target: Target) -> float:
        """Return direction on the floor to a target [rad]."""
        way = self.target(target) - self.here
        return float(np.arctan2(way[1], way[0]))

    def speed_of(self, name: str) -> float:
        """Return how fast somebody walks [m/s]."""
        return float(abs(self.context.crowd.velocity[self.context.number_of(name)]))

    def look(self, action: Look) -> None:
        """Turn the head as a look says, from now on."""
        context, number = self.context, self.number
        context.looks_until[number] = self.ends_at(action.for_s)
        if isinstance(action.at, str):
            context.postures.look_at_person(number, context.number_of(action.at))
        elif action.at is not None:
            point = action.at if len(action.at) == 3 else (*action.at, _EYE_LEVEL_M)
            context.postures.look_at(number, np.array(point))
        elif action.yaw_deg is not None:
            context.postures.turn_head(number, radians(action.yaw_deg), radians(action.pitch_deg))
        else:
            context.postures.look_ahead(number)

    def approach(self, furniture: Seat | Bed) -> Approach:
        """Return how to come to a seat or bed: to the nearest side of a bed that a way leads to."""
        context = self.context
        here = complex(context.crowd.place[self.number])
        found = approaches(furniture, context.postures.measures, self.number, here)
        return next((each for each in found if self.way_to(each.turns_round_at)), found[0])

    def sets_out(self, goal: Array | tuple[float, float], speed_m_s: float, what: str = "") -> None:
        """Note that the person is on their way to a place [m], called `what`, until `arrives`."""
        way = self.way_to(goal)
        stops = np.array([self.here, *way])
        length_m = float(np.hypot(*np.diff(stops, axis=0).T).sum())
        named = what or f"[{float(goal[0]):.6g}, {float(goal[1]):.6g}]"
        self.context.going[self.number] = Going(named, self.t, length_m / speed_m_s if way else None)

    def arrives(self) -> None:
        """Note that the person is on no way any more."""
        self.context.going.pop(self.number, None)

    def has_left(self, name: str) -> bool:
        """Return whether somebody has left for good."""
        return self.context.number_of(name) in self.context.departed

    def attract_gaze(self, name: str) -> None:
        """Turn a person who only stands about, body and gaze, to this one."""
        context, other = self.context, self.context.number_of(name)
        if context.doing[other] == "stand" and context.postures.may_walk()[other]:
            way = self.here - self.place_of(other)
            context.crowd.command(other, MotionCommand(None, heading=float(np.arctan2(way[1], way[0])), immovable=True))

    def others(self) -> Array:
        """Return the places of all others in the room, (k, 2) [m]."""
        crowd = self.context.crowd
        there = crowd.present.copy()
        there[self.number] = False
        places = crowd.place[there]
        return np.stack([places.real, places.imag], axis=-1)

    def ends_at(self, for_s: float | None) -> float:
        """Return the time [s] at which something that begins now is over."""
        return inf if for_s is None else self.t + for_s

    def free_places(self, count: int) -> Array:
        """Draw places (count, 2) [m] in the area, clear of furniture."""
        return self.context.ground.free_places(count, self.rng)

    def way_to(self, goal: Array | tuple[float, float]) -> list[tuple[float, float]]:
        """Return the places to pass on the way around furniture, the goal last; none where there is no way."""
        way = self.context.ground.routes.way(self.here, np.asarray(goal, dtype=float))
        return [] if way is None else [(float(x), float(y)) for x, y in way]
