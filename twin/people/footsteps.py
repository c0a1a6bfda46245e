"""Footsteps under moving bodies, without sliding feet, for all people at once.

A body that moves over the floor is given feet: while a foot stands it does not move at all; the other one swings on a
smooth arc to where the body will need it, a target that follows every change of mind until shortly before landing. A
step is double support (both feet stand, the heel behind comes off as far as the leg needs) and then swing. Speeds from
standing to a fast walk; backwards, sideways and on the spot by the same rule.

Places on the floor are complex numbers x + iy; arrays over feet are (2, n), left foot first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.people.gait_table import GaitStyle
from twin.people.skeleton import Skeleton

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Planar = NDArray[np.complex128]

LANDS_AHEAD = 0.46
"""Where a foot lands ahead of the pelvis, as a share of a step: less than half, because the heel behind has lifted."""
LANDS_AT = 0.5
"""Velocity over the floor with which a foot arrives, as a share of the body's; the landing takes it to nothing."""
TARGET_FIXED_AT = 0.75
"""Share of the swing after which the landing place is final."""
TOES_OUT_RAD = 0.10
FEET_APART_M = 0.085
"""Least distance between the tracks of the two feet, so that legs do not cross [m, for the reference leg]."""
REACH = 0.66
"""Distance from the body to a standing foot, as a share of the leg, from which steps become quicker."""
TWIST_RAD = 0.55
"""Turn of the body over a standing foot from which steps become quicker."""
HURRY = 1.5
"""How much quicker at twice that distance or turn."""
TURNING = 0.45
"""How much quicker steps are for each rad/s of turning."""
TOES_DOWN_RAD_S = 4.0
"""How fast the toes come down after the heel has struck."""

_SIDE = np.array([[1.0], [-1.0]])
_FEET = np.array([[0], [1]])


class Footsteps:
    """The feet of n people whose bodies are told where to go.

    `place` (2, n) complex: the sole's point under the ankle as if the foot were flat [m]; `yaw` (2, n) [rad];
    `height` (2, n) above the floor [m]; `pitch` (2, n) [rad], heel up positive, before what the leg's reach adds;
    `in_air` (2, n); `progress` (n,) 0 to 1 through the step, `rate` (n,) of it [1/s]; `stepping` (n,).
    """

    def __init__(self, skeleton: Skeleton, place: Planar, heading: Array, width: Array) -> None:
        """Everybody stands at `place` (n,) [m] facing `heading` (n,), feet side by side, `width` (n,) [m] apart."""
        count = len(place)
        self._scale = skeleton.scale
        self._reach = 1.0 / (REACH * skeleton.leg)
        self.place = place + 0.5j * width * np.exp(1j * heading) * _SIDE
        self.yaw = heading + TOES_OUT_RAD * _SIDE
        self.height = np.zeros((2, count))
        self.pitch = np.zeros((2, count))
        self.in_air = np.zeros((2, count), dtype=bool)
        self.progress = np.zeros(count)
        self.rate = np.zeros(count)
        self.stepping = np.zeros(count, dtype=bool)
        self.lift_at = np.zeros(count)  # progress at which the foot leaves the floor
        self._swings = np.zeros(count, dtype=bool)  # one foot is in the air
        self._foot = np.zeros(count, dtype=np.intp)  # which one, in this step
        self._velocity = np.zeros(count, dtype=complex)
        self._yaw_rate = np.zeros(count)
        self._target = place.copy()
        self._target_yaw = heading.copy()
        self._pitch_at_lift = np.zeros(count)

    def time(
        self,
        place: Planar,
        velocity: Planar,
        facing: Planar,
        heading: Array,
        turn_rate: Array,
        style: GaitStyle,
        dt: float,
    ) -> Mask:
        """Advance, end and begin steps; returns whose foot lifts now, (n,): `lift` them next."""
        strain = np.maximum(
            np.abs(self.place - place) * self._reach,
            np.abs(self.yaw - heading - TOES_OUT_RAD * _SIDE) * (1.0 / TWIST_RAD),
        )
        strain = np.where(self.in_air, 0.0, strain)
        strain = np.minimum(np.maximum(np.maximum(strain[0], strain[1]) - 1.0, 0.0), 1.0)
        self.rate = (1.0 + HURRY * strain + TURNING * np.abs(turn_rate)) / style.step_time
        self.progress += self.stepping * (dt * self.rate)
        # a foot left too far behind does not wait for the end of double support
        late = (strain > 0) & self.stepping & (self.progress < self.lift_at)
        if late.any():
            self.progress = np.where(late, self.lift_at + dt * self.rate, self.progress)
        landed = self.progress >= 1.0
        if landed.any():
            self._land(landed)
        if not self.stepping.all():
            self._begin(landed, place, velocity, facing, heading, turn_rate, style, dt)
        return self.stepping & ~self._swings & (self.progress >= self.lift_at)

    def lift(self, lifts: Mask, pitch: Array) -> None:
        """Take off the feet of those in `lifts` (n,), whose feet have turned by `pitch` (2, n) [rad]."""
        self._swings |= lifts
        self.in_air = self._swings & (self._foot == _FEET)
        self._pitch_at_lift = np.where(lifts, np.where(self._foot == 0, pitch[0], pitch[1]), self._pitch_at_lift)
        self._velocity = np.where(lifts, 0.0, self._velocity)
        self._yaw_rate = np.where(lifts, 0.0, self._yaw_rate)

    def _land(self, landed: Mask) -> None:
        lands = landed & (self._foot == _FEET)
        self.place = np.where(lands, self._target, self.place)
        self.yaw = np.where(lands, self._target_yaw, self.yaw)
        self._swings &= ~landed
        self.in_air = self._swings & (self._foot == _FEET)
        self.stepping &= ~landed
        self.progress = np.where(landed, 0.0, self.progress)

    def _begin(
        self,
        landed: Mask,
        place: Planar,
        velocity: Planar,
        facing: Planar,
        heading: Array,
        turn_rate: Array,
        style: GaitStyle,
        dt: float,
    ) -> None:
        """Begin a step where the body moves or a foot is not where it should stand."""
        speed = np.abs(velocity)
        home = place + 0.5j * style.step_width * facing * _SIDE
        misplaced = np.maximum(
            np.abs(self.place - home) / self._scale, 0.3 * np.abs(self.yaw - heading - TOES_OUT_RAD * _SIDE)
        )
        # who has just landed goes on more readily than who stands
        moves = (misplaced.max(axis=0) > np.where(landed, 0.03, 0.06)) | (speed > np.where(landed, 0.08, 0.12))
        begins = ~self.stepping & moves
        if not begins.any():
            return
        # the first step goes with the foot on the side of the motion or turn, else with the one farther from its place
        outward = np.where(speed > 0.1, (velocity * facing.conj()).imag, 0.0) + 0.1 * turn_rate
        worse = np.where(misplaced[0] > misplaced[1] + 0.01, 0, 1)
        first = np.where(np.abs(outward) > np.maximum(0.1, 0.5 * speed), np.where(outward > 0, 0, 1), worse)
        self._foot = np.where(begins, np.where(landed, 1 - self._foot, first), self._foot)
        self.lift_at = np.where(begins, style.double_support, self.lift_at)
        # from standing the weight is on the other foot at once
        self.progress = np.where(begins & ~landed, self.lift_at + dt * self.rate, self.progress)
        self.stepping |= begins

    def move(
        self,
        place: Planar,
        velocity: Planar,
        facing: Planar,
        heading: Array,
        turn_rate: Array,
        style: GaitStyle,
        dt: float,
    ) -> None:
        """Move the feet: those in the air on cubics that end where the bodies will need them."""
        swing = (self.progress - self.lift_at) / (1.0 - self.lift_at)
        if self._swings.any():
            self._swing(swing, place, velocity, heading, turn_rate, style, dt)
        ahead = (velocity * facing.conj()).real / np.maximum(np.abs(velocity), 0.1)
        share = np.maximum(swing, 0.0)
        rest = 1.0 - share
        pitch = self._pitch_at_lift * (1.0 - _smooth(share * (1 / 0.85)))
        pitch -= style.toe_up * np.maximum(ahead, 0.0) * _smooth(np.maximum(2.5 * share - 1.5, 0.0))
        down = np.minimum(np.minimum(self.pitch, 0.0) + TOES_DOWN_RAD_S * dt, 0.0)
        self.pitch = np.where(self.in_air, pitch, down)
        bump = style.clearance * 16.0 * (share * rest) ** 2
        self.height = np.where(self.in_air, bump, 0.0)

    def _swing(
        self,
        swing: Array,
        place: Planar,
        velocity: Planar,
        heading: Array,
        turn_rate: Array,
        style: GaitStyle,
        dt: float,
    ) -> None:
        first = self._foot == 0
        side = np.where(first, 1.0, -1.0)
        step_time = 1.0 / self.rate
        remaining = np.maximum((1.0 - self.progress) * step_time, dt)
        turned = heading + np.minimum(np.maximum(turn_rate * (remaining + 0.4 * step_time), -0.7), 0.7)
        left = 1j * np.exp(1j * turned)
        wanted = place + velocity * (remaining + LANDS_AHEAD * step_time) + (0.5 * style.step_width * side) * left
        other = np.where(first, self.place[1], self.place[0])
        apart = ((wanted - other) * left.conj()).real * side
        wanted += np.maximum(FEET_APART_M * self._scale - apart, 0.0) * side * left
        open_yet = swing < TARGET_FIXED_AT
        self._target = np.where(open_yet, wanted, self._target)
        self._target_yaw = np.where(open_yet, turned + TOES_OUT_RAD * side, self._target_yaw)
        r = np.minimum(dt / remaining, 1.0)
        rest = 1.0 - r
        keep, gain, per_gap = dt * rest * rest, (3.0 - 2.0 * r) * r * r, 6.0 * r * rest / remaining
        slow = 1.0 - 4.0 * r + 3.0 * r * r
        here = np.where(first, self.place[0], self.place[1])
        gap = self._target - here
        arrival = LANDS_AT * velocity
        moved = here + self._velocity * keep + gap * gain - arrival * (dt * r * rest)
        self.place = np.where(self.in_air, moved, self.place)
        self._velocity = self._velocity * slow + gap * per_gap + arrival * (3.0 * r * r - 2.0 * r)
        yaw = np.where(first, self.yaw[0], self.yaw[1])
        turn = self._target_yaw - yaw
        self.yaw = np.where(self.in_air, yaw + self._yaw_rate * keep + turn * gain, self.yaw)
        self._yaw_rate = self._yaw_rate * slow + turn * per_gap


def _smooth(share: Array) -> Array:
    """0 at 0, 1 from 1 on, a cubic between; share must not be negative."""
    share = np.minimum(share, 1.0)
    return share * share * (3.0 - 2.0 * share)
