"""Gait: bodies carried over their footsteps, walking and running, with the load on each foot.

State with memory (footsteps, loads, pelvis, habits of trunk and head) is stepped on the people's clock and kept as an
interpolable `GaitState`. All that follows from it (heel lift, all joints) is computed by `twin.people.gait.gait_state`, only
for the times asked for.

Vertical motion and load agree. The table gives the load of a regular step, and the height of the pelvis is its double
integral: (z[k+1] - 2 z[k] + z[k-1]) / dt² is g (load[k] - 1) to rounding, tick by tick. A weak pull, zero in a regular gait
and in flight, brings the pelvis to the height of the pace; it is part of the load. The centre of mass is taken to move up
and down with the pelvis. Forces along the floor are not modelled.
"""

from __future__ import annotations

from math import exp

import numpy as np

from trackers.arrays import Array, Mask
from twin.people.body.proportions import Skeleton
from twin.people.gait import gait_state
from twin.people.gait.footsteps import BodyMotion, Footsteps, MovingBodies
from twin.people.gait.gait_state import FLOOR_ROWS, ROWS, GaitState, feet_pitch
from twin.people.gait.gait_table import HEIGHT, LOAD, RATE, RUN_PACE, SHARE_BEHIND, GaitStyle, GaitTable

GRAVITY_M_S2 = 9.81

_CHANGE_S = 0.45
"""Time of the change from a walk to a run and back [s]."""
_PULL = 8.0
"""Rate of the pull of the pelvis to its height [1/s]."""
_SWAY_RATE = 9.0
_SWAY_SHARE = 0.3
_SWAY_MOST_M = 0.035
_HABIT_RATE = 6.0
_HEADS_FROM_M_S = 0.25
"""Speed above which forwards, backwards and sideways have full effect."""
_LEAN = np.array([[0.03], [-0.025]])  # pitch and roll per acceleration ahead and to the left [rad s²/m]
_LEAN_MOST_RAD = 0.10
_SHIFT_STEPPING, _SHIFT_STANDING = 0.4, 0.08
"""Greatest shift of weight between the feet per tick of `_TICK_S`, as a share of it."""
_TICK_S = 0.025
_PRESSURE_M_S = 2.5
"""Greatest speed of the point of load along a foot beyond that of a step [m/s]."""

_STANDS_AT = 0.40
"""Point of load of a standing person as a share of the shoe (0.05 m before the ankle); walking backwards mirrors it there.
"""

_ROLLS_M = 0.05
"""Approach of a foot that rolls over its heel, by the pelvis' turn towards it [m, for the reference leg]."""
_BEARS = 0.3
"""Load above which a foot's leg holds the pelvis down [body weights]."""
_HINDMOST = 0.05
_LATERAL_DROP, _BACK_DROP = 3.0, 2.0
"""Additional lowering of the pelvis in steps to the side, with legs spread, and backwards, as shares."""

_ARMS_IN = range(gait_state.ARMS_IN.start, gait_state.ARMS_IN.stop)
_HABITS = (
    gait_state.TRUNK_PITCH,
    gait_state.TRUNK_ROLL,
    gait_state.GAZE,
    gait_state.ELBOW,
    gait_state.ARM_SWING,
    *_ARMS_IN,
)
"""Quantities that follow slowly, by their rows of `GaitState.rows`."""
_BOB, _BOB_RATE = 0, 1

_SWAYS_HZ = np.array([[0.11], [0.29], [0.17], [0.37]])
_SWAYS_SHARE = 0.04
_SWAYS_AHEAD_M = 0.0025


class Gait:
    """Feet, pelvis, trunk and loads of n people as they follow a crowd's motion."""

    def __init__(self, skeleton: Skeleton, crowd: MovingBodies) -> None:
        """Start all people at the crowd's positions, standing, or in stride if they move."""
        count = len(crowd.place)
        self._skeleton = skeleton
        self._leg = skeleton.longest
        self._rolls = _ROLLS_M * skeleton.scale
        self._table = GaitTable(skeleton)
        self._feet = Footsteps(skeleton, count)
        self._run = np.zeros(count)  # 0 walks, 1 runs
        self._runs = np.zeros(count, dtype=bool)
        self._clock = 0.0
        self._phases = 2 * np.pi * ((np.arange(count) * 0.618034 + np.array([[0.0], [0.31], [0.57], [0.83]])) % 1.0)
        self._bob = np.zeros((2, count))  # the pelvis about its standing height [m]; its rate half a tick ago [m/s]
        self._sway = np.zeros((2, count))  # of the pelvis to the left [m], and its rate [m/s]
        self._left = np.full(count, 0.5)  # share of the load on the left foot
        self._idle: Array | float = 0.0  # how far the weight of a standing person has shifted
        self._load = np.zeros((2, count))  # [body weights]
        self._ahead = np.zeros((2, count))  # of the ankle: point of the load [m]
        self._habits = np.zeros((len(_HABITS), count))
        self._wanted = np.zeros((len(_HABITS), count))
        self.state = GaitState(np.zeros((FLOOR_ROWS, count), dtype=complex), np.zeros((ROWS, count)))
        self.place_anew(np.ones(count, dtype=bool), crowd)

    def place_anew(self, who: Mask, crowd: MovingBodies, arms_in: Array | float = 0.0) -> None:
        """Put the feet of `who` (n,) under their bodies, as if the crowd's present motion had always lasted.

        For people who enter or are placed anew: they stand, or are in mid-step at their speed, without memory. arms_in: as of
        `step`.
        """
        motion = _body_motion(crowd)
        similar = self._table.similar(motion.speed)
        middle = 0.5 * (self._table.runs_above + self._table.walks_below)
        self._runs = np.where(who, similar > middle, self._runs)
        self._run = np.where(who, self._runs, self._run)
        style = self._table.at(similar + RUN_PACE * self._run)
        feet = self._feet
        moves = who & (motion.speed > 0.3)
        if (who & ~moves).any():
            feet.stand(who & ~moves, crowd, style)
        if moves.any():
            feet.walk(moves, crowd, motion, style)
        self._sway[:, who] = 0.0
        self._wanted[-len(_ARMS_IN) :] = arms_in
        self._want(crowd, motion, 0.0, style)
        self._habits[:, who] = self._wanted[:, who]
        cycle, left, point, _ = self._carry(motion, style)
        height, rate = self._reference(cycle, motion, style)
        load = np.where(feet.stepping, cycle[:, LOAD], 1.0) * ~feet.in_air.all(axis=0)
        self._bob[_BOB, who] = height[who]
        self._bob[_BOB_RATE, who] = (rate - 0.5 * _TICK_S * GRAVITY_M_S2 * (load - 1.0))[who]
        left = np.where(feet.in_air[0] == feet.in_air[1], left, feet.in_air[1])
        self._left[who] = left[who]
        self._ahead[:, who] = point[:, who]
        self._load[:, who] = (np.stack([left, 1.0 - left]) * load)[:, who]
        self._record(crowd)

    def step(
        self,
        crowd: MovingBodies,
        gaze: Array,
        dt: float,
        still: Mask | None = None,
        arms_in: Array | float = 0.0,
    ) -> None:
        """Follow the crowd to its present state, `dt` [s] after the last call; gaze (n,): turn of the head [rad].

        People who are `still` (n,) sit or lie: they begin no steps and their feet stay. arms_in (2, n): fraction by which
        the left and the right arm are held in, 0 to 1.
        """
        feet = self._feet
        motion = _body_motion(crowd)
        similar = self._table.similar(motion.speed)
        pace = similar
        if np.count_nonzero(self._run) or np.count_nonzero(similar > self._table.runs_above):
            self._runs = similar > np.where(self._runs, self._table.walks_below, self._table.runs_above)
            change = dt * (1.0 / _CHANGE_S)
            self._run = np.minimum(np.maximum(self._runs, self._run - change), self._run + change)
            pace = similar + RUN_PACE * self._run
        style = self._table.at(pace)
        feet.time(crowd, motion, style, still, dt)
        self._clock += dt
        cycle, left, point, stance = self._carry(motion, style)
        self._bob[_BOB] += dt * self._bob[_BOB_RATE]
        self._bear(cycle, left, motion, style, dt)
        most = dt * _PRESSURE_M_S
        self._ahead = np.minimum(np.maximum(point, self._ahead - most), self._ahead + most)
        feet.lift(self._load, style, dt, lambda: feet_pitch(self.state, self._skeleton))
        feet.move(crowd, motion, style, stance, dt)
        self._wanted[-len(_ARMS_IN) :] = arms_in
        self._lean(crowd, motion, gaze, style, dt)
        self._record(crowd)

    def _carry(self, motion: BodyMotion, style: GaitStyle) -> tuple[Array, Array, Array, Array]:
        """Return the regular cycle now (n, 4), the wanted share on the left foot (n,) and points of load (2, n).

        And the finished share of each foot's stance (2, n), 0 without steps.
        """
        feet, stepping = self._feet, self._feet.stepping
        cycle = self._table.cycle(style.row, feet.progress)
        behind = cycle[:, SHARE_BEHIND] * (feet.progress < feet.lift_at)
        left = np.where(feet.lands[0], behind, 1.0 - behind)
        stance = np.minimum((feet.own + 1.0) / style.stance, 1.0) * (stepping & ~feet.in_air)
        share = (self._table.roll(stance, self._run) - _STANDS_AT) * (motion.ahead * stepping)
        point = np.maximum(share + _STANDS_AT, _HINDMOST) * self._skeleton.shoe - self._skeleton.heel
        self._idle = 0.0
        if np.count_nonzero(stepping) < len(stepping):
            sways = np.sin((2 * np.pi * self._clock) * _SWAYS_HZ + self._phases)
            left = np.where(stepping, left, 0.5)
            self._idle = (_SWAYS_SHARE * ~stepping) * (sways[0] + sways[1])
            point += (_SWAYS_AHEAD_M * ~stepping) * (sways[2] + sways[3])
        return cycle, left, point, stance

    def _reference(self, cycle: Array, motion: BodyMotion, style: GaitStyle) -> tuple[Array, Array]:
        """Return the pelvis' height [m] about its standing height in a regular gait, and its rate [m/s]."""
        step_time = self._feet.stepping / self._feet.rate
        unit = GRAVITY_M_S2 * step_time
        drop = style.pelvis_drop * (1.0 + _LATERAL_DROP * motion.lateral + _BACK_DROP * motion.backward)
        return cycle[:, HEIGHT] * (unit * step_time) - drop, cycle[:, RATE] * unit

    def _bear(self, cycle: Array, left: Array, motion: BodyMotion, style: GaitStyle, dt: float) -> None:
        """Share the load of this tick between the feet, and step the pelvis's rate."""
        feet, bob = self._feet, self._bob
        regular = np.where(feet.stepping, cycle[:, LOAD], 1.0)
        height, rate = self._reference(cycle, motion, style)
        height = np.minimum(height, self._reach())
        now = bob[_BOB_RATE] + (0.5 * dt * GRAVITY_M_S2) * (regular - 1.0)
        pull = (_PULL * _PULL / GRAVITY_M_S2) * (height - bob[_BOB]) + (2.0 * _PULL / GRAVITY_M_S2) * (rate - now)
        left_air, right_air = feet.in_air
        load = np.maximum(regular + np.minimum(regular, 1.0) * pull, 0.0) * ~(left_air & right_air)
        bob[_BOB_RATE] += (dt * GRAVITY_M_S2) * (load - 1.0)
        most = np.where(feet.stepping, _SHIFT_STEPPING, _SHIFT_STANDING) * (dt / _TICK_S)
        shifted = np.minimum(np.maximum(left, self._left - most), self._left + most)
        # on one foot, it carries all the weight
        self._left = np.where(left_air ^ right_air, right_air, shifted)
        left = self._left
        # a standing person shifts the weight slightly
        self._load[0] = left * (1.0 + self._idle * (1.0 - left)) * load
        self._load[1] = load - self._load[0]

    def _reach(self) -> Array:
        """Return the height of the pelvis about its standing height that the legs of the loaded front feet allow [m]."""
        seen, leg = self._feet.seen, self._leg
        ahead = np.maximum(seen.real - self._rolls, 0.0)
        lateral = seen.imag - self._skeleton.hip_offset
        down = leg - np.sqrt(np.maximum(leg * leg - ahead * ahead - lateral * lateral, 0.0))
        down *= self._load > _BEARS
        return -np.maximum(down[0], down[1])

    def _lean(self, crowd: MovingBodies, motion: BodyMotion, gaze: Array, style: GaitStyle, dt: float) -> None:
        """Move the pelvis over the loaded foot, on a critically damped spring; habits follow slowly."""
        across = self._feet.seen.imag
        goal = (2.0 * _SWAY_SHARE) * (across[1] + self._left * (across[0] - across[1]))
        goal = np.minimum(np.maximum(goal, -_SWAY_MOST_M), _SWAY_MOST_M)
        sway, rate = self._sway
        gap = sway - goal
        drive = (rate + _SWAY_RATE * gap) * dt
        decay = exp(-_SWAY_RATE * dt)
        rate[:] = (rate - _SWAY_RATE * drive) * decay
        sway[:] = goal + (gap + drive) * decay
        self._want(crowd, motion, gaze, style)
        self._habits += min(1.0, _HABIT_RATE * dt) * (self._wanted - self._habits)

    def _want(self, crowd: MovingBodies, motion: BodyMotion, gaze: Array | float, style: GaitStyle) -> None:
        push = crowd.acceleration * motion.seen_from
        pitch, _, gazed, elbow, swing, *_ = wanted = self._wanted
        lean = _LEAN * push.view(float).reshape(-1, 2).T
        wanted[:2] = np.minimum(np.maximum(lean, -_LEAN_MOST_RAD), _LEAN_MOST_RAD)
        pitch += style.trunk_lean * motion.ahead
        gazed[:] = gaze
        elbow[:] = style.elbow
        swing[:] = style.arm_swing

    def _record(self, crowd: MovingBodies) -> None:
        floor, rows, feet = self.state.floor, self.state.rows, self._feet
        floor[gait_state.PLACE] = crowd.place
        floor[gait_state.VELOCITY] = crowd.velocity
        floor[gait_state.FEET] = feet.place
        rows[gait_state.HEADING] = crowd.heading
        rows[gait_state.TURN_RATE] = crowd.turn_rate
        rows[gait_state.BOB] = self._bob[_BOB]
        rows[gait_state.SWAY : gait_state.SWAY_RATE + 1] = self._sway
        rows[gait_state.TRUNK_PITCH : gait_state.ELBOW + 1] = self._habits[:4]
        rows[gait_state.ARM_SWING : gait_state.ARMS_IN.stop] = self._habits[4:]
        rows[gait_state.FEET_HEIGHT] = feet.height
        rows[gait_state.FEET_PITCH] = feet.pitch
        rows[gait_state.FEET_YAW] = feet.yaw
        rows[gait_state.FEET_LOAD] = self._load
        rows[gait_state.FEET_PRESSURE] = self._ahead


def _body_motion(crowd: MovingBodies) -> BodyMotion:
    seen_from = crowd.facing.conj()
    velocity = crowd.velocity * seen_from
    speed = np.abs(velocity)
    seen = velocity / np.maximum(speed, _HEADS_FROM_M_S)
    ahead, forward = seen.real, np.maximum(seen.real, 0.0)
    return BodyMotion(velocity, speed, ahead, np.abs(seen.imag), forward, forward - ahead, seen_from)
