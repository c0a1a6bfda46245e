"""Bodies led over the floor by the hand of a test, and what the gait makes of them, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from twin.people.body.proportions import Skeleton, proportions_of
from twin.people.gait.gait import Gait
from twin.people.gait.gait_state import BOB, FootLoads, GaitState, foot_loads, heel_and_pelvis, joint_coordinates

TICK_S = 0.025


@dataclass
class Led:
    """What a crowd offers the gait."""

    place: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    heading: np.ndarray
    facing: np.ndarray
    turn_rate: np.ndarray

    @classmethod
    def standing(cls, count: int) -> Led:
        still = np.zeros(count, dtype=complex)
        return cls(
            1.0 * still, 1.0 * still, 1.0 * still, np.zeros(count), np.ones(count, dtype=complex), np.zeros(count)
        )

    def go(self, seen: complex | np.ndarray, turn_rate: float | np.ndarray) -> None:
        """One tick with this velocity as the body sees it, ahead + left i [m/s], and turn [rad/s]."""
        self.turn_rate = np.zeros(len(self.place)) + turn_rate
        self.heading = self.heading + self.turn_rate * TICK_S
        self.facing = np.exp(1j * self.heading)
        velocity = seen * self.facing
        self.acceleration = self.acceleration + 0.3 * ((velocity - self.velocity) / TICK_S - self.acceleration)
        self.velocity = velocity
        self.place = self.place + velocity * TICK_S


@dataclass
class Course:
    """Everything of n people over k ticks; arrays (k, ..., n)."""

    skeleton: Skeleton
    gait: Gait
    led: Led
    t: list = field(default_factory=list)
    coordinates: list = field(default_factory=list)
    load: list = field(default_factory=list)
    ahead: list = field(default_factory=list)
    height: list = field(default_factory=list)
    place: list = field(default_factory=list)
    rows: list = field(default_factory=list)
    lowered: list = field(default_factory=list)

    def record(self, t: float) -> None:
        state = GaitState(self.gait.state.floor.copy(), self.gait.state.rows.copy())
        feet: FootLoads = foot_loads(state, self.skeleton)
        self.t.append(t)
        self.coordinates.append(joint_coordinates(state, self.skeleton))
        self.rows.append(state.rows)
        standing = 0.9945 * self.skeleton.leg + self.skeleton.ankle_height
        self.lowered.append(standing + state.rows[BOB] - heel_and_pelvis(state, self.skeleton)[2])
        for name in ("load", "height", "place"):
            getattr(self, name).append(getattr(feet, name).copy())
        self.ahead.append(feet.pressure_ahead.copy())

    def after(self, t: float) -> Course:
        """The same from time t [s] on, as arrays."""
        names = ("t", "coordinates", "load", "ahead", "height", "place", "rows", "lowered")
        keep = np.array(self.t) > t
        return Course(self.skeleton, self.gait, self.led, *(np.array(getattr(self, name))[keep] for name in names))


def lead(
    velocity: Callable[[float], complex],
    statures: tuple[float, ...],
    seconds: float,
    turn_rate: Callable[[float], float] = lambda t: 0.0,
    still: Callable[[float], np.ndarray | None] = lambda t: None,
    before_tick: Callable[[float, Led, Gait], None] = lambda t, led, gait: None,
) -> Course:
    """People of these statures [m] who all move with the same velocity, as they see it [m/s], from standing."""
    count = len(statures)
    led = Led.standing(count)
    skeleton = Skeleton([proportions_of(stature) for stature in statures])
    gait = Gait(skeleton, led)
    course = Course(skeleton, gait, led)
    for tick in range(1, round(seconds / TICK_S) + 1):
        t = tick * TICK_S
        led.go(velocity(t), turn_rate(t))
        before_tick(t, led, gait)
        gait.step(led, np.zeros(count), TICK_S, still(t))
        course.record(t)
    return course.after(0.0)


@cache
def steady(speed: float, statures: tuple[float, ...], seconds: float = 6.0) -> Course:
    """A steady walk or run, from the fourth second on; shared by the tests that look at it."""
    return lead(lambda t: speed * min(t / max(0.4, speed / 4), 1.0), statures, seconds + 4.0).after(4.0)


def stances(on: np.ndarray) -> list[slice]:
    """Whole stretches in which the flags (k,) hold, those cut off at the ends left out."""
    change = np.diff(on.astype(int))
    starts, ends = np.nonzero(change == 1)[0] + 1, np.nonzero(change == -1)[0] + 1
    return [slice(start, ends[ends > start][0]) for start in starts if (ends > start).any()]
