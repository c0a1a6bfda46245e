"""Footsteps under moving bodies, without sliding feet, for all people at once.

A standing foot does not move. A foot in the air swings on a smooth arc to a landing place that follows the body's motion
until shortly before landing. A step lasts from one landing to the next. In walking it is double support (both feet stand,
the rear heel rises), then swing; in running the standing foot lifts before the step ends, so that both are in the air. One
rule covers all speeds, backwards, sideways and on the spot. A foot lifts only once it is unloaded.

Positions on the floor are complex numbers x + iy; arrays over feet are (2, n), left foot first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from trackers.arrays import Array, Mask, Planar
from twin.people.body.proportions import Skeleton
from twin.people.gait.gait_table import GaitStyle

ARRIVES_AT = 0.35
"""Landing speed of a foot over the floor, as a share of its swing's mean speed."""
TARGET_FIXED_AT = 0.75
"""Share of the swing after which the landing place is final."""
TOES_OUT_RAD = 0.10
FEET_APART_M = 0.085
"""Least distance between the tracks of the two feet, so that legs do not cross [m, for the reference leg]."""
TWIST_RAD = 0.55
"""Turn of the body over a standing foot beyond which steps become quicker."""
HURRY = 1.5
"""Relative quickening at twice that turn, or at twice the style's reach."""
TURNING = 0.45
"""Relative quickening per rad/s of turning."""
CALMS_S2 = 4.0
"""Rate at which quick steps slow down again: steps per second, each second."""
BEFORE_COUNTS = 1.6
"""Weight of the distance of a standing foot before the body, relative to one behind it."""
SIDEWAYS, BACKWARDS = 0.7, 0.35
"""Relative quickening, and so shortening, of steps to the side and backwards."""
LANDS_FARTHER = 0.2
"""Additional landing distance ahead of the body of steps to the side or backwards, as a share of a step."""
TOES_DOWN_RAD_S = 5.0
"""Rate at which the toes come down after the heel has struck."""
HEEL_RAD_S = 14.0
"""Greatest rate at which the heel of a standing foot turns up or down."""
UNLOADED = 0.02
"""Share of the body's weight below which a foot may lift."""

_SIDE = np.array([[1.0], [-1.0]])
_OUT = TOES_OUT_RAD * _SIDE
_FEET = np.array([[0], [1]])
_PLACE, _YAW = 0, 1
_BUMP = 1.0 / ((3 / 7) ** 1.5 * (4 / 7) ** 2)


class MovingBodies(Protocol):
    """State of n bodies on the floor that footsteps follow; a `Crowd` has it."""

    place: Planar
    velocity: Planar
    acceleration: Planar
    heading: Array
    facing: Planar
    turn_rate: Array


class BodyMotion(NamedTuple):
    """Motion of n bodies in their own frames, (n,) each.

    velocity: complex, ahead + left i [m/s]; speed [m/s]; ahead, lateral: cosine to the heading and size of the sine, both
    smaller near standstill; forward: max(ahead, 0); backward: forward - ahead; seen_from: complex rotation from room to body.
    """

    velocity: Planar
    speed: Array
    ahead: Array
    lateral: Array
    forward: Array
    backward: Array
    seen_from: Planar


class Footsteps:
    """Feet of n people under commanded bodies.

    `soles` (2, 2, n) complex: per foot the sole's point under the ankle of the flat foot [m], and its yaw [rad]; `height`
    (2, n) of the ball (of the heel while the toes are up) above the floor [m]; `pitch` (2, n) [rad], heel up positive;
    `in_air` (2, n); `progress` (n,) 0 to 1 through the step, `rate` (n,) of it [1/s]; `stepping` (n,); `lands` (2, n): the
    foot that lands at the end of this step; `seen` (2, n) complex: the feet in the body's frame at the beginning of the
    tick, ahead + left i [m].
    """

    def __init__(self, skeleton: Skeleton, count: int) -> None:
        """Leave the feet unplaced: `stand` or `walk` puts them under their bodies."""
        self._scale = skeleton.scale
        self._apart = FEET_APART_M * skeleton.scale
        self._per_leg = 1.0 / skeleton.leg
        self.soles = np.zeros((2, 2, count), dtype=complex)
        self.seen = np.zeros((2, count), dtype=complex)
        self.height = np.zeros((2, count))
        self.pitch = np.zeros((2, count))
        self.in_air = np.zeros((2, count), dtype=bool)
        self.progress = np.zeros(count)
        self.rate = np.ones(count)
        self.stepping = np.zeros(count, dtype=bool)
        self.lands = np.zeros((2, count), dtype=bool)
        self.lands[1] = True
        self.lift_at = np.zeros(count)  # progress at which the foot that lands next leaves the floor
        self.own = np.zeros((2, count))  # progress towards the foot's own next landing, -1 to 1
        self._lifted_at = np.zeros((2, count))  # `own` when the foot left the floor
        self._pitch_at_lift = np.zeros((2, count))
        self._straight = np.zeros((2, count))  # yaw of feet that stand under their bodies
        self._start = np.zeros((2, 2, count), dtype=complex)  # the soles at lift-off of the feet in the air
        self._target = np.zeros((2, 2, count), dtype=complex)

    @property
    def place(self) -> Planar:
        """Positions of the feet, (2, n) complex [m]."""
        return self.soles[_PLACE]

    @property
    def yaw(self) -> Array:
        """Yaw of the feet, (2, n) [rad]."""
        return self.soles[_YAW].real

    def stand(self, who: Mask, bodies: MovingBodies, style: GaitStyle) -> None:
        """Put the feet of `who` (n,) flat under their bodies, side by side."""
        home = bodies.place + 0.5j * style.step_width * bodies.facing * _SIDE
        self.place[:, who] = home[:, who]
        self._straight = bodies.heading + _OUT
        self.soles[_YAW][:, who] = self._straight[:, who]
        for feet in (self.height, self.pitch, self._pitch_at_lift, self.in_air, self._lifted_at, self.own):
            feet[:, who] = 0
        self._start[..., who] = self._target[..., who] = self.soles[..., who]
        self.progress[who] = 0.0
        self.stepping[who] = False
        self.rate[who] = 1.0 / style.step_time[who]

    def walk(self, who: Mask, bodies: MovingBodies, motion: BodyMotion, style: GaitStyle) -> None:
        """Put the feet of `who` (n,) into the stride of walking or running: one stands, one swings."""
        self.stand(who, bodies, style)
        self._hurry(bodies, motion, 0.0, style, who)
        progress = 0.5 * (1.0 + np.minimum(style.double_support, 0.0))
        step = bodies.velocity / self.rate
        # the left foot is as far before or behind the body as its stance has it; the right one swings past
        self.place[0, who] += ((style.lands_ahead - progress) * step)[who]
        self._start[_PLACE][1, who] += ((style.lands_ahead - progress - 1.0) * step)[who]
        self.progress[who] = progress[who]
        self.stepping[who] = True
        self.lands[:, who] = _FEET == 1
        self.lift_at[who] = style.double_support[who]
        self.in_air[1, who] = True
        self._lifted_at[1, who] = style.double_support[who]
        self._pitch_at_lift[1, who] = (style.heel_rise * motion.forward)[who]
        self.own = self.progress - ~self.lands
        others = ~who
        soles, height, pitch = self.soles, self.height, self.pitch
        self._swing(bodies, motion, style)
        self.soles = np.where(others, soles, self.soles)
        self.height, self.pitch = np.where(others, height, self.height), np.where(others, pitch, self.pitch)

    def _hurry(
        self, bodies: MovingBodies, motion: BodyMotion, strain: Array | float, style: GaitStyle, who: Mask | bool
    ) -> None:
        quicker = 1.0 + HURRY * strain + TURNING * np.abs(bodies.turn_rate) + SIDEWAYS * motion.lateral
        quicker += BACKWARDS * motion.backward
        quicker /= style.step_time
        self.rate = quicker if who is True else np.where(who, quicker, self.rate)

    def time(self, bodies: MovingBodies, motion: BodyMotion, style: GaitStyle, still: Mask | None, dt: float) -> None:
        """Advance, end and begin steps; those who are `still` (n,) begin none."""
        self.seen = (self.place - bodies.place) * motion.seen_from
        self._straight = bodies.heading + _OUT
        twist = self.yaw - self._straight
        # a heel comes up for a body that has moved ahead, not back
        far = np.maximum(np.abs(self.seen), BEFORE_COUNTS * self.seen.real)
        strain = np.maximum(far * (self._per_leg / style.reach), np.abs(twist) * (1.0 / TWIST_RAD))
        strain *= ~self.in_air
        worst = np.minimum(np.maximum(np.maximum(strain[0], strain[1]) - 1.0, 0.0), 1.0)
        before = self.rate
        self._hurry(bodies, motion, worst, style, True)
        self.rate = np.maximum(self.rate, before - dt * CALMS_S2)
        self.progress += self.stepping * (dt * self.rate)
        if np.count_nonzero(worst):
            # a foot left too far behind does not wait for the end of double support
            late = (worst > 0) & self.stepping & (self.progress < self.lift_at)
            self.progress = np.where(late, self.lift_at, self.progress)
        landed = self.progress >= 1.0
        if np.count_nonzero(landed):
            self._land(landed)
        if np.count_nonzero(self.stepping) < len(self.stepping):
            self._begin(landed, twist, bodies, motion, style, still)
        self.own = self.progress - ~self.lands

    def _land(self, landed: Mask) -> None:
        """Put down the feet that land; a person with the other foot in the air goes straight on to the next step."""
        lands = landed & self.lands
        self.soles = np.where(lands, self._target, self.soles)
        self.in_air &= ~lands
        goes_on = self.in_air[0] | self.in_air[1]
        self.stepping &= ~landed | goes_on
        self.progress -= landed
        self.lands ^= landed & goes_on
        self.lift_at = np.where(landed, -1.0, self.lift_at)

    def _begin(
        self,
        landed: Mask,
        twist: Array,
        bodies: MovingBodies,
        motion: BodyMotion,
        style: GaitStyle,
        still: Mask | None,
    ) -> None:
        """Begin a step where the body moves or a foot is not where it should stand."""
        home = style.half_width * _SIDE
        misplaced = np.maximum(np.abs(self.seen - 1j * home) / self._scale, 0.3 * np.abs(twist))
        # a foot that has just landed starts the next step more readily than a standing person
        worst = np.maximum(misplaced[0], misplaced[1])
        moves = (worst > np.where(landed, 0.03, 0.06)) | (motion.speed > np.where(landed, 0.08, 0.12))
        starts = ~self.stepping & moves
        if still is not None:
            starts &= ~still
        if np.count_nonzero(starts):
            # the first step goes with the foot on the side of the motion or turn, else with the farther one
            outward = np.where(motion.speed > 0.1, motion.velocity.imag, 0.0) + 0.1 * bodies.turn_rate
            worse = misplaced[0] <= misplaced[1] + 0.01
            right = np.where(np.abs(outward) > np.maximum(0.1, 0.5 * motion.speed), outward <= 0, worse)
            right = np.where(landed, self.lands[0], right)
            self.lands = np.where(starts, right == (_FEET == 1), self.lands)
            self.lift_at = np.where(starts, style.double_support, self.lift_at)
            # from standing the weight goes to the other foot at once
            self.progress = np.where(starts & ~landed, np.maximum(self.lift_at, 0.0), self.progress)
            self.stepping |= starts
        self.progress *= self.stepping

    def lift(self, load: Array, style: GaitStyle, dt: float, drawn: Callable[[], Array]) -> None:
        """Take off the feet whose time has come and whose load (2, n) [body weights] is zero.

        `drawn` returns the pitch of the feet (2, n) [rad] including the legs' reach, from which the swing goes on.
        """
        # in running the standing foot lifts before the other one lands
        due = np.where(self.lands, self.lift_at, style.flight)
        lifts = (self.own >= due) & self.stepping & ~self.in_air & (load < UNLOADED)
        if np.count_nonzero(lifts):
            self.in_air |= lifts
            # lift-off between the last tick and this one
            self._lifted_at = np.where(lifts, np.maximum(due, self.own - dt * self.rate), self._lifted_at)
            self._pitch_at_lift = np.where(lifts, np.maximum(self.pitch, drawn()), self._pitch_at_lift)
            self._start = np.where(lifts, self.soles, self._start)

    def move(self, bodies: MovingBodies, motion: BodyMotion, style: GaitStyle, stance: Array, dt: float) -> None:
        """Move the feet: in the air towards their landing places, on the floor the heels up or down.

        stance (2, n): finished share of a foot's stance.
        """
        rise = _smooth(np.maximum(stance - style.heel_off, 0.0) / style.heel_turns)
        wanted = (style.heel_rise * motion.forward) * rise
        pitch = self.pitch
        quick = dt * np.where(pitch < 0, TOES_DOWN_RAD_S, HEEL_RAD_S)
        self.pitch = np.minimum(np.maximum(wanted, pitch - dt * HEEL_RAD_S), pitch + quick)
        if np.count_nonzero(self.in_air):
            self._swing(bodies, motion, style)
        else:
            self.height = np.zeros_like(pitch)

    def _swing(self, bodies: MovingBodies, motion: BodyMotion, style: GaitStyle) -> None:
        """Move the feet in the air from lift-off to their target, with the bump and pitch of a swing."""
        step_time = 1.0 / self.rate
        remaining = np.maximum(1.0 - self.own, 0.0) * step_time
        turn = np.minimum(np.maximum(bodies.turn_rate * (remaining + 0.4 * step_time), -0.7), 0.7)
        left = (1j * bodies.facing) * np.exp(1j * turn)
        lands = style.lands_ahead + LANDS_FARTHER * (1.0 - motion.forward)
        wanted = bodies.place + bodies.velocity * (remaining + lands * step_time)
        # no crossing of the other foot's track
        apart = ((wanted - self.place[::-1]) * left.conj()).real
        wanted += left * (np.maximum(style.half_width, self._apart - apart * _SIDE) * _SIDE)
        share = np.minimum(np.maximum((self.own - self._lifted_at) / (1.0 - self._lifted_at), 0.0), 1.0)
        open_yet = share < TARGET_FIXED_AT
        np.copyto(self._target[_PLACE], wanted, where=open_yet)
        np.copyto(self._target[_YAW], self._straight + turn, where=open_yet)
        square = share * share
        covered = square * (3.0 - ARRIVES_AT - (2.0 - ARRIVES_AT) * share)
        self.soles = np.where(self.in_air, self._start + covered * (self._target - self._start), self.soles)
        rest = 1.0 - share
        bump = (_BUMP * self.in_air) * (share * np.sqrt(share)) * (rest * rest)
        self.height = style.clearance * bump
        pitch = self._pitch_at_lift * (1.0 - _smooth(share * (1 / 0.85))) + (style.kick * motion.forward) * bump
        pitch -= (style.toe_up * motion.forward) * _smooth(np.maximum(2.5 * share - 1.5, 0.0))
        self.pitch = np.where(self.in_air, pitch, self.pitch)


def _smooth(share: Array) -> Array:
    """Return 0 at 0, 1 from 1 on, a cubic between; share must not be negative."""
    share = np.minimum(share, 1.0)
    return share * share * (3.0 - 2.0 * share)
