"""View of one person's script: own state, other people, possible actions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from itertools import chain
from math import cos, inf, radians, sin
from typing import Literal

import numpy as np

from trackers.arrays import Array
from twin.people.crowd.crowd import Crowd
from twin.people.crowd.ground import Ground
from twin.people.crowd.motion_command import MotionCommand
from twin.people.posture.body_measures import BodyMeasures, Penetration
from twin.people.posture.postures import Postures
from twin.people.posture.resting import BEFORE_M, SeatedPose, lying_pose, seated_pose
from twin.people.posture.side_seating import side_poses
from twin.room.furniture import Bed, Seat
from twin.scenario.action import Target
from twin.scenario.behaviour import TurnHead

_EYE_LEVEL_M = 1.5
"""Height of the gaze at a place on the floor [m]."""
_BODY_REACH_M = 1.5
"""Distance from a body's middle beyond which no action touches anything [m]."""
_IN_THE_WAY_M = 1.0
"""Distance within which a person counts as in the way of one who makes no progress [m]."""
_LATE, _SETS_OUT_S = 2.0, 2.0
"""Multiple of the way's time, and allowance for setting out [s], beyond which a person is late."""


@dataclass(frozen=True)
class Approach:
    """Approach of a seat or bed: place to turn round (2,), place to stand before sitting down (2,) [m], facing `heading`
    [rad]; `side`: pose beside a desk in which one sits down there, before turning in.
    """

    turns_round_at: Array
    stands_at: tuple[float, float]
    heading: float
    side: SeatedPose | None = None


def approaches(
    furniture: Seat | Bed, measures: BodyMeasures, person: int, adjacent: complex | None = None
) -> Iterator[Approach]:
    """Yield the approaches of a seat, from before it and then from its free sides, or of a bed from either side.

    adjacent: x + iy [m]; the side of a bed nearest to it comes first.
    """
    if isinstance(furniture, Seat):
        yield _approach(seated_pose(furniture, measures, person))
        yield from (_approach(pose, pose) for pose, fault in side_poses(furniture, measures, person) if not fault)
        return
    sides = [complex(x, y) for x, y in furniture.sides()]
    if adjacent is not None:
        sides.sort(key=lambda side: abs(side - adjacent))
        sides[0] = adjacent
    yield from (_approach(lying_pose(furniture, measures, person, side).edge) for side in sides)


def first_that(reaches: Callable[[Array], object], found: Iterator[Approach]) -> Approach:
    """Return the first approach whose place to turn round is reached, or the first of all."""
    first = next(found)
    return next((each for each in chain([first], found) if reaches(each.turns_round_at)), first)


def _approach(pose: SeatedPose, side: SeatedPose | None = None) -> Approach:
    stands_at = (pose.standing_place.real, pose.standing_place.imag)
    turns_at = np.array([stands_at[0] + BEFORE_M * cos(pose.yaw), stands_at[1] + BEFORE_M * sin(pose.yaw)])
    return Approach(turns_at, stands_at, pose.yaw, side)


@dataclass(frozen=True)
class Going:
    """A walk under way: goal in words, start [s], and expected duration [s], None without a way."""

    goal: str
    since_s: float
    takes_s: float | None


@dataclass(eq=False)
class WalkingGroup:
    """People who walk together: indices from left to right, one of them the `leader`.

    `gap_m`: present distance between neighbours [m]; `ring`: place of each while they talk, None: they walk; `changes`:
    index of the one who is changing sides, or None; `draws_near`: neighbours are not yet at the near distance;
    `spaced_until_s`, `changes_at_s`: times of the next change of distance and of sides [s].
    """

    leader: int
    formation: Literal["abreast", "v", "file"]
    gap_m: float
    order: list[int]
    ring: dict[int, complex] | None = None
    changes: int | None = None
    draws_near: bool = False
    spaced_until_s: float = 0.0
    changes_at_s: float = inf

    @property
    def others(self) -> list[int]:
        """Members other than the leader."""
        return [number for number in self.order if number != self.leader]


Overlap = Callable[[int, Callable[[Postures], object] | None, Collection[int]], Penetration | None]
"""Function of a person, an action (None: the present pose) and geoms to press into: the deepest overlap with the room."""


def _no_overlap(number: int, act: object, allowed: Collection[int]) -> None:
    """Return None: people without bodies touch nothing."""


@dataclass(eq=False)
class ScriptContext:
    """State shared by all actors: clock, positions and postures of all people, the room.

    `doing`: kind of action of each; `taken`: user of each seat or bed; `leaving`: people about to leave, `departed`: people
    who have left; `looks_until`: time at which a turned head is free again [s]; `going`: walks under way; `groups`: people who
    walk together, by the index of their leader; `waiting`: what each waits for, and since when [s]; `missed`: sentences on
    goals that were given up; `overlap`: of an action that is tried out.
    """

    names: tuple[str, ...]
    crowd: Crowd
    postures: Postures
    ground: Ground
    overlap: Overlap = _no_overlap
    t: float = 0.0
    doing: list[str] = field(default_factory=list)
    taken: dict[str, int] = field(default_factory=dict)
    leaving: set[int] = field(default_factory=set)
    departed: set[int] = field(default_factory=set)
    looks_until: dict[int, float] = field(default_factory=dict)
    going: dict[int, Going] = field(default_factory=dict)
    groups: dict[int, WalkingGroup] = field(default_factory=dict)
    waiting: dict[int, tuple[str, float]] = field(default_factory=dict)
    missed: list[str] = field(default_factory=list)

    def late(self) -> list[str]:
        """Describe people who gave a goal up, who still wait, and who have not arrived in twice the time that their way takes."""
        messages = [
            *self.missed,
            *(
                f"{self.names[number]} waits since {since_s:.1f} s {what}"
                for number, (what, since_s) in sorted(self.waiting.items())
                if self.crowd.present[number]
            ),
        ]
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
            user = self.taken.get(going.goal, number)
            why = why if user == number else f"{self.names[user]} is there"
            messages.append(f"{self.names[number]} has not reached {going.goal} after {took_s:.0f} s: {why}")
        return messages

    def number_of(self, name: str) -> int:
        """Return the index of a person in all arrays."""
        return self.names.index(name)

    def end_looks(self) -> None:
        """Free the heads whose looks are over."""
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
        """Return the position of a person, (2,) [m]."""
        place = self.context.crowd.place[number]
        return np.array([place.real, place.imag])

    def target(self, target: Target) -> Array:
        """Return the ground point of a person by name, or of a place, (2,) [m]."""
        if isinstance(target, str):
            return self.place_of(self.context.number_of(target))
        return np.array(target[:2])

    def distance_to(self, target: Target) -> float:
        """Return the distance on the floor [m]; infinite to an absent person."""
        if isinstance(target, str) and not self.context.crowd.present[self.context.number_of(target)]:
            return inf
        return float(np.linalg.norm(self.target(target) - self.here))

    def bearing_of(self, target: Target) -> float:
        """Return the direction on the floor to a target [rad]."""
        way = self.target(target) - self.here
        return float(np.arctan2(way[1], way[0]))

    def speed_of(self, name: str) -> float:
        """Return a person's walking speed [m/s]."""
        return float(abs(self.context.crowd.velocity[self.context.number_of(name)]))

    def look(self, action: TurnHead) -> None:
        """Turn the head as a look describes, from now on."""
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
        """Return the approach to a seat or bed: the first side to which a way leads."""
        context = self.context
        here = complex(context.crowd.place[self.number])
        return first_that(self.way_to, approaches(furniture, context.postures.measures, self.number, here))

    def sets_out(self, goal: Array | tuple[float, float], speed_m_s: float, what: str = "") -> None:
        """Note the way to a place [m], named `what`, until `arrives`."""
        way = self.way_to(goal)
        stops = np.array([self.here, *way])
        length_m = float(np.hypot(*np.diff(stops, axis=0).T).sum())
        named = what or f"[{float(goal[0]):.6g}, {float(goal[1]):.6g}]"
        self.context.going[self.number] = Going(named, self.t, length_m / speed_m_s if way else None)

    def arrives(self) -> None:
        """Note the end of the way."""
        self.context.going.pop(self.number, None)

    def waits(self, what: str) -> None:
        """Note a wait, in words; it began when it was noted first, and lasts until `goes_on`."""
        _, since_s = self.context.waiting.get(self.number, ("", self.t))
        self.context.waiting[self.number] = what, since_s

    def goes_on(self) -> None:
        """Note the end of a wait."""
        self.context.waiting.pop(self.number, None)

    def overlap_in(self, act: Callable[[Postures], object] | None) -> Penetration | None:
        """Return the deepest overlap with the room in an action from here (None: in the present pose), by the body's own geoms.

        None where nothing is within reach. The furniture that the person uses does not count.
        """
        context, number = self.context, self.number
        if context.ground.gap_m(self.here) >= _BODY_REACH_M:
            return None
        used = [context.ground.furniture[name].geoms for name, user in context.taken.items() if user == number]
        return context.overlap(number, act, frozenset().union(*used))

    def misses(self, what: str) -> None:
        """Note, in words, a goal that the person gives up."""
        self.context.missed.append(f"{self.name} {what}, at {self.t:.1f} s")

    @property
    def name(self) -> str:
        """Name of the person."""
        return self.context.names[self.number]

    def has_left(self, name: str) -> bool:
        """Return whether a person has left for good."""
        return self.context.number_of(name) in self.context.departed

    def attract_gaze(self, name: str) -> None:
        """Turn body and gaze of an idle person to this one."""
        context, other = self.context, self.context.number_of(name)
        if context.doing[other] == "stand" and context.postures.may_walk()[other]:
            way = self.here - self.place_of(other)
            context.crowd.command(other, MotionCommand(None, heading=float(np.arctan2(way[1], way[0])), immovable=True))

    def others(self) -> Array:
        """Return the positions of all others in the room, (k, 2) [m]."""
        crowd = self.context.crowd
        there = crowd.present.copy()
        there[self.number] = False
        places = crowd.place[there]
        return np.stack([places.real, places.imag], axis=-1)

    def ends_at(self, for_s: float | None) -> float:
        """Return the end time [s] of an action that begins now."""
        return inf if for_s is None else self.t + for_s

    def free_places(self, count: int) -> Array:
        """Draw places (count, 2) [m] in the area, clear of furniture."""
        return self.context.ground.free_places(count, self.rng)

    def way_to(self, goal: Array | tuple[float, float]) -> list[tuple[float, float]]:
        """Return the places to pass around furniture, the goal last; empty without a way."""
        way = self.context.ground.routes.way(self.here, np.asarray(goal, dtype=float))
        return [] if way is None else [(float(x), float(y)) for x, y in way]
