"""Gait: footsteps under a moving body, without sliding feet, for all people at once.

A body that moves over the floor is given feet: while a foot stands it does not move at all; the other one swings on a
smooth arc to where the body will need it, a target that follows every change of mind until shortly before landing. A
step is double support (both feet stand, the heel behind comes off as far as the leg needs) and then swing. Speeds from
standing to a fast walk; backwards, sideways and on the spot by the same rule. Running is not modelled, nor are the
forces: the pelvis is as high as the legs allow, not where dynamics would carry it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import yaml
from numpy.typing import NDArray

from twin.models import MODELS
from twin.people import pose as columns
from twin.people.pose import POSE_SIZE, Skeleton, ankles
from twin.people.proportions import Proportions

Array = NDArray[np.float64]

_REFERENCE_LEG_M = (0.530 - 0.039) * 1.75
_TABLE_STEP_M_S = 0.05
_TOP_SPEED_M_S = 2.5
_COLUMNS = (
    "step_time_s", "double_support", "step_width_m", "clearance_m", "toe_up_rad", "pelvis_drop_m", "bob_m",
    "trunk_lean_rad", "elbow_rad",
)  # fmt: skip

_STRAIGHTEST = 0.9975
"""Longest distance from hip to ankle as a share of the leg: the knee keeps 8 degrees, as a standing person's does."""
_LANDS_AHEAD = 0.42
"""Where a foot lands ahead of the pelvis, as a share of a step: less than half, because the heel behind has lifted."""
_TARGET_FIXED_AT = 0.75
"""Share of the swing after which the landing place is final."""
_HIGHEST_HEEL_RAD = 1.15
_TOES_OUT_RAD = 0.10
_FEET_APART_M = 0.085
"""Least distance between the tracks of the two feet, so that legs do not cross."""
_REACH = 0.55
"""Distance from pelvis to a standing foot, as a share of the leg, from which steps become quicker."""
_TWIST_RAD = 0.55
"""Turn of the body over a standing foot from which steps become quicker."""


@cache
def _gait_table() -> Array:
    """Rows over speed in steps of `_TABLE_STEP_M_S`, columns as `_COLUMNS`, for the reference leg."""
    content = yaml.safe_load((MODELS / "people" / "gait.yaml").read_text(encoding="utf-8"))
    speeds = np.arange(0.0, _TOP_SPEED_M_S + 2 * _TABLE_STEP_M_S, _TABLE_STEP_M_S)
    return np.stack([np.interp(speeds, content["speed_m_s"], content[name]) for name in _COLUMNS], axis=1)


class Gait:
    """The feet, pelvis, trunk and arms of n people who are told where their bodies go."""

    def __init__(self, proportions: Sequence[Proportions], position: Array, heading: Array) -> None:
        """Everybody stands at `position` (n, 2) [m], facing `heading` (n,) [rad], feet side by side."""
        count = len(proportions)
        self.skeleton = Skeleton(proportions)
        self._table = _gait_table()
        self._scale = self.skeleton.leg / _REFERENCE_LEG_M
        self._root = np.sqrt(self._scale)
        self._rows = np.arange(count)
        self._side = np.array([1.0, -1.0])
        self._feet = np.zeros((count, 2, 5))  # x, y, height, pitch, yaw
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
        width = self._table[0, 2] * self._scale
        self._feet[..., :2] = position[:, None] + (0.5 * width[:, None] * self._side)[..., None] * left[:, None]
        self._feet[..., 4] = heading[:, None] + _TOES_OUT_RAD * self._side
        self._stepping = np.zeros(count, dtype=bool)
        self._foot = np.zeros(count, dtype=np.intp)  # which one swings in this step
        self._progress = np.zeros(count)  # 0 to 1 through the step
        self._lift_at = np.zeros(count)  # progress at which the foot leaves the floor
        self._in_air = np.zeros(count, dtype=bool)
        self._swing_velocity = np.zeros((count, 3))  # of x, y, yaw
        self._target = np.zeros((count, 3))
        self._pitch_at_lift = np.zeros(count)
        self._rise = np.zeros((count, 2))  # pelvis height below or above its mean [m], and its rate
        self._sway = np.zeros((count, 2))  # pelvis to the left of its path [m], and its rate
        self._lean = np.zeros((count, 2))  # trunk pitch, roll
        self._gaze = np.zeros(count)
        self._pelvis_xy = position.copy()
        self._pose = np.zeros((count, POSE_SIZE))
        zero = np.zeros(count)
        self.step(position, np.zeros((count, 2)), np.zeros((count, 2)), heading, zero, zero, 1e-9)
        self._pose[:, columns.VELOCITY] = 0.0

    def pose(self) -> Array:
        """The pose now, (n, POSE_SIZE), columns as `twin.people.pose` names them."""
        return self._pose

    @property
    def in_air(self) -> NDArray[np.bool_]:
        """Which feet are off the floor, (n, 2) left, right."""
        return self._in_air[:, None] & (self._foot[:, None] == np.arange(2))

    def step(
        self,
        position: Array,
        velocity: Array,
        acceleration: Array,
        heading: Array,
        turn_rate: Array,
        gaze: Array,
        dt: float,
    ) -> None:
        """Follow the bodies to where they are now, `dt` [s] after the last call.

        position, velocity, acceleration: (n, 2) of the body over the floor [m, m/s, m/s²]; heading, turn_rate: (n,)
        [rad, rad/s], heading unwrapped; gaze: (n,) turn of the head from the heading [rad].
        """
        forward = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        ahead = np.einsum("ni,ni->n", velocity, forward)
        style = self._look_up(speed)
        self._time_steps(position, velocity, heading, turn_rate, left, style, speed, dt)
        swing = np.where(
            self._in_air, (self._progress - self._lift_at) / np.maximum(1e-9, 1 - self._lift_at), 0.0
        )
        self._place_feet(swing, style, np.clip(ahead / np.maximum(speed, 0.1), 0.0, 1.0), dt)
        self._carry_body(position, acceleration, heading, forward, left, gaze, style, swing, dt)

    def _look_up(self, speed: Array) -> Array:
        """Gait parameters (len(_COLUMNS), n) at these speeds, scaled to each person."""
        place = np.minimum(speed / self._root, _TOP_SPEED_M_S) / _TABLE_STEP_M_S
        row = place.astype(np.intp)
        share = (place - row)[:, None]
        style = ((1 - share) * self._table[row] + share * self._table[row + 1]).T
        style[0] *= self._root
        style[2:4] *= self._scale
        style[5:7] *= self._scale
        return style

    def _time_steps(
        self,
        position: Array,
        velocity: Array,
        heading: Array,
        turn_rate: Array,
        left: Array,
        style: Array,
        speed: Array,
        dt: float,
    ) -> None:
        """Advance, end and begin steps; move the swinging feet over the floor."""
        rows, step_time = self._rows, style[0]
        offset = self._feet[..., :2] - position[:, None]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        twist = np.abs(self._feet[..., 4] - heading[:, None] - _TOES_OUT_RAD * self._side)
        standing = ~self.in_air
        strain = np.maximum(distance / (_REACH * self.skeleton.leg)[:, None], twist / _TWIST_RAD) - 1
        strain = np.clip(np.where(standing, strain, 0.0), 0.0, 1.0).max(axis=1)
        rate = (1 + 1.5 * strain) / step_time
        self._progress += np.where(self._stepping, dt * rate, 0.0)
        # a foot left too far behind does not wait for the end of double support
        self._progress = np.where(
            self._stepping & (strain > 0) & (self._progress < self._lift_at), self._lift_at, self._progress
        )
        landed = self._stepping & (self._progress >= 1)
        if landed.any():
            self._land(landed)
        idle = ~self._stepping
        if idle.any():
            self._begin(idle, landed, position, velocity, heading, turn_rate, left, style, speed)
        lifts = self._stepping & ~self._in_air & (self._progress >= self._lift_at)
        if lifts.any():
            self._in_air |= lifts
            self._pitch_at_lift = np.where(lifts, self._feet[rows, self._foot, 3], self._pitch_at_lift)
            self._swing_velocity[lifts] = 0.0
        if self._in_air.any():
            self._swing(position, velocity, heading, turn_rate, style, 1 / rate, dt)

    def _land(self, landed: NDArray[np.bool_]) -> None:
        who, foot = np.nonzero(landed)[0], self._foot[landed]
        self._feet[who, foot, 0:2] = self._target[who, :2]
        self._feet[who, foot, 4] = self._target[who, 2]
        self._feet[who, foot, 2] = 0.0
        self._in_air[landed] = False
        self._stepping[landed] = False
        self._progress[landed] = 0.0

    def _begin(
        self,
        idle: NDArray[np.bool_],
        landed: NDArray[np.bool_],
        position: Array,
        velocity: Array,
        heading: Array,
        turn_rate: Array,
        left: Array,
        style: Array,
        speed: Array,
    ) -> None:
        """Begin a step where the body moves or a foot is not where it should stand."""
        home = position[:, None] + (0.5 * style[2][:, None] * self._side)[..., None] * left[:, None]
        gap = self._feet[..., :2] - home
        misplaced = np.hypot(gap[..., 0], gap[..., 1]) / self._scale[:, None]
        misplaced = np.maximum(
            misplaced, 0.3 * np.abs(self._feet[..., 4] - heading[:, None] - _TOES_OUT_RAD * self._side)
        )
        # who has just landed goes on more readily than who stands
        bound = np.where(landed, 0.03, 0.06)
        begins = idle & ((misplaced.max(axis=1) > bound) | (speed > np.where(landed, 0.08, 0.12)))
        sideways = np.einsum("ni,ni->n", velocity, left)
        outward = np.where(speed > 0.1, sideways, 0.0) + 0.1 * turn_rate
        worse = np.where(misplaced[:, 0] > misplaced[:, 1] + 0.01, 0, 1)
        lateral = np.where(outward > 0, 0, 1)
        first = np.where(np.abs(outward) > np.maximum(0.1, 0.5 * speed), lateral, worse)
        self._foot = np.where(begins, np.where(landed, 1 - self._foot, first), self._foot)
        self._lift_at = np.where(begins, style[1], self._lift_at)
        # from standing the weight is on the other foot at once
        self._progress = np.where(begins & ~landed, self._lift_at, self._progress)
        self._stepping |= begins

    def _swing(
        self,
        position: Array,
        velocity: Array,
        heading: Array,
        turn_rate: Array,
        style: Array,
        step_time: Array,
        dt: float,
    ) -> None:
        """Move the swinging feet towards where the bodies will need them, on cubics that end at rest."""
        rows, foot = self._rows, self._foot
        side = self._side[foot]
        remaining = np.maximum((1 - self._progress) * step_time, dt)
        turned = heading + np.clip(turn_rate * (remaining + 0.4 * step_time), -0.7, 0.7)
        left = np.stack([-np.sin(turned), np.cos(turned)], axis=-1)
        wanted = np.empty_like(self._target)
        ahead = (remaining + _LANDS_AHEAD * step_time)[:, None]
        wanted[:, :2] = position + velocity * ahead + (0.5 * style[2] * side)[:, None] * left
        other = self._feet[rows, 1 - foot]
        apart = np.einsum("ni,ni->n", wanted[:, :2] - other[:, :2], left) * side
        missing = np.maximum(_FEET_APART_M * self._scale - apart, 0.0) * side
        wanted[:, :2] += missing[:, None] * left
        wanted[:, 2] = turned + _TOES_OUT_RAD * side
        share = (self._progress - self._lift_at) / (1 - self._lift_at)
        self._target = np.where((share < _TARGET_FIXED_AT)[:, None], wanted, self._target)
        here = self._feet[rows, foot][:, [0, 1, 4]]
        gap = self._target - here
        r = np.minimum(dt / remaining, 1.0)[:, None]
        moved = here + self._swing_velocity * dt * (1 - r) ** 2 + gap * (3 - 2 * r) * r**2
        pace = self._swing_velocity * (1 - 4 * r + 3 * r**2) + 6 * r * (1 - r) * gap / remaining[:, None]
        air = self._in_air[:, None]
        self._swing_velocity = np.where(air, pace, self._swing_velocity)
        moved = np.where(air, moved, here)
        self._feet[rows, foot, 0:2] = moved[:, :2]
        self._feet[rows, foot, 4] = moved[:, 2]

    def _place_feet(self, swing: Array, style: Array, frontal: Array, dt: float) -> None:
        """Height and pitch of the feet, but for what the legs will need: `_carry_body` lifts heels further."""
        rows, foot, air = self._rows, self._foot, self._in_air
        pitch = self._feet[..., 3]
        # standing: toes come down within a tenth of a second of the heel's strike; heels are down unless needed up
        standing = np.where(pitch < 0, np.minimum(pitch + 4.0 * dt, 0.0), 0.0)
        settle, strike = _smooth(swing / 0.55), _smooth((swing - 0.5) / 0.5)
        swinging = self._pitch_at_lift * (1 - settle) - style[4] * frontal * strike
        mask = self.in_air
        self._feet[..., 3] = np.where(mask, swinging[:, None], standing)
        # the bump starts and ends at rest and is highest a little before the middle
        height = style[3] * 6.75 * swing * (1 - swing) ** 2 * _smooth(swing / 0.2)
        self._feet[rows, foot, 2] = np.where(air, height, 0.0)

    def _carry_body(
        self,
        position: Array,
        acceleration: Array,
        heading: Array,
        forward: Array,
        left: Array,
        gaze: Array,
        style: Array,
        swing: Array,
        dt: float,
    ) -> None:
        """Pelvis over the feet, heels up where the leg needs it, trunk and arms against the legs."""
        feet, skeleton = self._feet, self.skeleton
        offset = feet[..., :2] - position[:, None]
        along = np.einsum("nki,ni->nk", offset, forward)
        across = np.einsum("nki,ni->nk", offset, left)
        stride = along[:, 0] - along[:, 1]  # left foot before the right one
        rhythm = np.where(self._stepping, np.cos(2 * np.pi * (self._progress - self._lift_at / 2)), 0.0)
        _spring(self._rise, -style[5] - style[6] * rhythm, 22.0, dt)
        support = np.where(self._in_air, across[self._rows, 1 - self._foot], across.mean(axis=1))
        _spring(self._sway, np.clip(0.3 * support, -0.035, 0.035), 9.0, dt)
        pelvis_xy = position + self._sway[:, :1] * left
        twist = -0.13 * stride / self._scale
        yaw = heading + twist
        sway_left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
        hips = pelvis_xy[:, None] + skeleton.hip_offset[..., None] * sway_left[:, None]
        height = 0.997 * skeleton.leg + skeleton.ankle_height + self._rise[:, 0]
        pitch, needed = feet[..., 3], self._heel_needed(hips, height)
        feet[..., 3] = np.where(pitch < 0, pitch + needed, np.maximum(pitch, needed))
        height = np.minimum(height, self._height_allowed(hips))
        pose = self._pose
        pose[:, 0:2] = pelvis_xy
        pose[:, 2] = height
        pose[:, columns.PELVIS_YAW] = yaw
        lean = np.stack(
            [
                style[7] + np.clip(0.03 * np.einsum("ni,ni->n", acceleration, forward), -0.1, 0.12),
                np.clip(-0.025 * np.einsum("ni,ni->n", acceleration, left), -0.1, 0.1),
            ],
            axis=-1,
        )
        blend = min(1.0, 6.0 * dt)
        self._lean += blend * (lean - self._lean)
        self._gaze += blend * (gaze - self._gaze)
        pose[:, 5] = -2.0 * twist
        pose[:, 6] = self._lean[:, 0]
        pose[:, 7] = self._lean[:, 1]
        pose[:, 8] = self._gaze + twist
        pose[:, 9] = 0.04 - 0.8 * self._lean[:, 0]
        swung = 0.62 * stride / self._scale
        pose[:, 10] = 0.04 + swung
        pose[:, 11] = 0.04 - swung
        pose[:, columns.ELBOW] = -style[8][:, None] + 0.5 * np.minimum(pose[:, columns.SHOULDER_PITCH], 0.0)
        pose[:, columns.VELOCITY] = (pelvis_xy - self._pelvis_xy) / dt
        self._pelvis_xy = pelvis_xy
        pose[:, columns.HEADING] = heading
        pose[:, columns.FEET] = feet.reshape(len(feet), 10)

    def _heel_needed(self, hips: Array, height: Array) -> Array:
        """Pitch (n, 2) [rad] by which a foot must turn about its ball for the leg to reach it, 0 where it need not.

        In the plane of the foot: the ankle lies on a circle about the ball, and must come within the leg's length.
        """
        feet, skeleton = self._feet, self.skeleton
        cosine, sine = np.cos(feet[..., 4]), np.sin(feet[..., 4])
        gap = hips - feet[..., :2]
        ahead = gap[..., 0] * cosine + gap[..., 1] * sine - skeleton.ball[:, None]
        aside = gap[..., 1] * cosine - gap[..., 0] * sine
        up = height[:, None] - feet[..., 2]
        radius = np.hypot(skeleton.ball, skeleton.ankle_height)
        rest = np.arctan2(skeleton.ankle_height, -skeleton.ball)
        far = ahead**2 + up**2
        leg = (_STRAIGHTEST * skeleton.leg)[:, None] ** 2 - aside**2
        cosine = (far + (radius**2)[:, None] - leg) / (2 * np.sqrt(far) * radius[:, None])
        spread = np.arccos(np.clip(cosine, -1.0, 1.0))
        return np.clip(rest[:, None] - np.arctan2(up, ahead) - spread, 0.0, _HIGHEST_HEEL_RAD)

    def _height_allowed(self, hips: Array) -> Array:
        """The greatest height of the pelvis (n,) [m] at which both legs reach their ankles."""
        joints = ankles(self._feet, self.skeleton)
        gap = hips - joints[..., :2]
        square = (_STRAIGHTEST * self.skeleton.leg)[:, None] ** 2 - np.einsum("nki,nki->nk", gap, gap)
        return (joints[..., 2] + np.sqrt(np.maximum(square, 0.0))).min(axis=1)


def _smooth(share: Array) -> Array:
    """0 below 0, 1 above 1, a cubic between."""
    share = np.clip(share, 0.0, 1.0)
    return share * share * (3 - 2 * share)


def _spring(state: Array, goal: Array, rate: float, dt: float) -> None:
    """Move state (n, 2: value, its derivative) as a critically damped spring towards the goal, exactly over dt."""
    gap = state[:, 0] - goal
    drive = (state[:, 1] + rate * gap) * dt
    decay = np.exp(-rate * dt)
    state[:, 0] = goal + (gap + drive) * decay
    state[:, 1] = (state[:, 1] - rate * drive) * decay
