"""Gait: bodies carried over their footsteps, for all people at once.

Split by cost: what has a memory (footsteps, springs, habits of trunk and head) is stepped on the people's clock and kept as a
`Moment` of numbers that may be interpolated; what follows from it alone (heel lift, height of the pelvis, all joints) is
computed by `twin.people.pose` only for the times that are asked for. Running is not modelled, nor are forces: the
pelvis is as high as the legs allow, not where dynamics would carry it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.people.crowd import Crowd
from twin.people.footsteps import Footsteps
from twin.people.gait_table import GaitTable
from twin.people.pose import FLOOR_ROWS, ROWS, Moment, heel_and_pelvis
from twin.people.skeleton import Skeleton

Array = NDArray[np.float64]

_BOB_RATE = 22.0
_SWAY_RATE = 9.0
_SWAY_SHARE = 0.3
_SWAY_MOST_M = 0.035
_HABIT_RATE = 6.0
_LEAN_PER_ACCELERATION = np.array([[0.03], [-0.025]])  # pitch by what is ahead, roll by what is to the left [rad s²/m]
_LEAN_MOST_RAD = 0.10


class Gait:
    """The feet, pelvis and trunk of n people as they follow a crowd's motion; `moment` is how they are now."""

    def __init__(self, skeleton: Skeleton, crowd: Crowd) -> None:
        """Everybody stands where the crowd has them."""
        count = len(crowd.place)
        self._skeleton = skeleton
        self._table = GaitTable(skeleton)
        style = self._table.at(np.zeros(count))
        self._feet = Footsteps(skeleton, crowd.place, crowd.heading, style.step_width)
        self._springs = np.zeros((2, 2, count))  # value and rate of: pelvis height about its mean, sway to the left [m]
        self._spring_rate = np.array([[_BOB_RATE], [_SWAY_RATE]])
        self._habits = np.zeros((4, count))  # trunk pitch, trunk roll, gaze, elbow [rad]
        self._habits[3] = style.elbow
        self.moment = Moment(np.zeros((FLOOR_ROWS, count), dtype=complex), np.zeros((ROWS, count)))
        self._record(crowd)

    def step(self, crowd: Crowd, gaze: Array, dt: float) -> None:
        """Follow the crowd to where it is now, `dt` [s] after the last call; gaze (n,): turn of the head [rad]."""
        feet = self._feet
        style = self._table.at(np.abs(crowd.velocity))
        lifts = feet.time(crowd.place, crowd.velocity, crowd.facing, crowd.heading, crowd.turn_rate, style, dt)
        if lifts.any():
            feet.lift(lifts, heel_and_pelvis(self.moment, self._skeleton)[0])
        feet.move(crowd.place, crowd.velocity, crowd.facing, crowd.heading, crowd.turn_rate, style, dt)
        # lowest in the middle of double support; the spring answers 2 / rate late, which is taken off here
        phase = feet.progress - 0.5 * feet.lift_at + (2.0 / _BOB_RATE) * feet.rate
        rhythm = np.cos((2 * np.pi) * phase) * feet.stepping
        across = ((feet.place - crowd.place) * crowd.facing.conj()).imag * (1.0 - feet.in_air)
        sway = _SWAY_SHARE * (across[0] + across[1])
        goal = np.array(
            [-style.pelvis_drop - style.bob * rhythm, np.minimum(np.maximum(sway, -_SWAY_MOST_M), _SWAY_MOST_M)]
        )
        self._spring(goal, dt)
        push = crowd.acceleration * crowd.facing.conj()
        lean = np.array([push.real, push.imag]) * _LEAN_PER_ACCELERATION
        lean = np.minimum(np.maximum(lean, -_LEAN_MOST_RAD), _LEAN_MOST_RAD)
        habits = np.array([lean[0] + style.trunk_lean, lean[1], gaze, style.elbow])
        self._habits += min(1.0, _HABIT_RATE * dt) * (habits - self._habits)
        self._record(crowd)

    def _spring(self, goal: Array, dt: float) -> None:
        """Critically damped springs towards the goals (2, n), exactly over dt."""
        rate = self._spring_rate
        gap = self._springs[0] - goal
        drive = (self._springs[1] + rate * gap) * dt
        decay = np.exp(-rate * dt)
        self._springs[1] = (self._springs[1] - rate * drive) * decay
        self._springs[0] = goal + (gap + drive) * decay

    def _record(self, crowd: Crowd) -> None:
        floor, rows, feet = self.moment.floor, self.moment.rows, self._feet
        floor[0] = crowd.place
        floor[1] = crowd.velocity
        floor[2:4] = feet.place
        rows[0] = crowd.heading
        rows[1] = crowd.turn_rate
        rows[2:4] = self._springs[0]
        rows[4] = self._springs[1, 1]
        rows[5:9] = self._habits
        rows[9:11] = feet.height
        rows[11:13] = feet.pitch
        rows[13:15] = feet.yaw
