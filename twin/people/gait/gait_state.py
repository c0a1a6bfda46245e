"""State of a gait, and the joint coordinates that follow from it: heels, pelvis, legs, arms, head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackers.arrays import Array, Planar
from twin.people.body.person_spec import JOINT_PLACE, LEG, NQ_PERSON, SIDES
from twin.people.body.proportions import Skeleton, leg_angles

PLACE, VELOCITY = 0, 1
"""Rows of `GaitState.floor`, complex x + iy: ground point of the body [m], its velocity [m/s]."""
FEET = slice(2, 4)
"""Left foot and right foot [m]."""
FLOOR_ROWS = 4

HEADING, TURN_RATE = 0, 1
"""Rows of `GaitState.rows`: heading of the body [rad] and its rate [rad/s]."""
BOB = 2
"""Height of the pelvis about its standing height [m]."""
SWAY, SWAY_RATE = 3, 4
"""Of the pelvis to the left [m], and its rate [m/s]."""
TRUNK_PITCH, TRUNK_ROLL, GAZE, ELBOW = 5, 6, 7, 8
"""Angles [rad]."""
FEET_HEIGHT, FEET_PITCH, FEET_YAW = slice(9, 11), slice(11, 13), slice(13, 15)
"""Left foot and right foot: height [m], pitch without that of the leg's reach [rad], yaw [rad]."""
FEET_LOAD, FEET_PRESSURE = slice(15, 17), slice(17, 19)
"""Left foot and right foot: load [body weights], its point ahead of the ankle [m]."""
ARM_SWING = 19
"""Swing of the arms [rad per metre of stride]."""
ARMS_IN = slice(20, 22)
"""Left arm and right arm: fraction held in, from 0 (as in walking alone) to 1 (straight down)."""
ROWS = 22

_STANDS_AT = 0.9945
"""Height of the hips over the ankles when standing, as a share of the leg."""
_HIGHEST_HEEL_RAD = 1.4
_TIPTOE_FROM_M = 0.2
_SWINGS_FROM_M = 0.02
_TWIST_PER_STRIDE = 0.13
"""Turn of the pelvis towards the foot in front [rad/m, for the reference leg]."""
_LETS_GO = 0.8
"""Excess of the pelvis over the height that a foot's leg allows, per root of the foot's height off the floor [m^0.5]."""
_UNLOADED_M = 0.12
"""Excess allowed over the leg of an unloaded foot; none if it carries half the body [m]."""
_ARMS_OUT_RAD = 0.10
_WEIGHED_DOWN = 0.8
"""Part of its swing and of the elbow's bend that an arm loses whose hand carries a bag; assumed."""
_HANDS_INWARD = 0.35
"""Inward turn of the upper arms per radian of elbow beyond 0.6: runners' hands swing before the chest."""
_TOES_FREE_M = 0.2
"""Height of the ball at which the toes of a lifted foot are straight."""

_LEGS = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in LEG] for side in SIDES]).T  # (7, 2)
_SPINE_YAW, _SPINE_PITCH, _SPINE_ROLL = (JOINT_PLACE[name] for name in ("spine_yaw", "spine_pitch", "spine_roll"))
_NECK_YAW, _NECK_PITCH = (JOINT_PLACE[name] for name in ("neck_yaw", "neck_pitch"))
_SHOULDER_PITCH, _SHOULDER_ROLL, _SHOULDER_YAW, _ELBOW = (
    np.array([JOINT_PLACE[f"{side}_{joint}"] for side in SIDES])  # (2,)
    for joint in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
)
_SIDE = np.array([[1.0], [-1.0]])


@dataclass(frozen=True, eq=False)
class GaitState:
    """State of the gait of n people at one time, in numbers that may be interpolated linearly (angles are unwrapped).

    floor (FLOOR_ROWS, n), rows (ROWS, n): the constants of this module name their rows.
    """

    floor: Planar
    rows: Array

    @property
    def pelvis(self) -> Planar:
        """Ground point under the pelvis, (n,) [m]."""
        return self.floor[PLACE] + 1j * self.rows[SWAY] * np.exp(1j * self.rows[HEADING])

    @property
    def pelvis_velocity(self) -> Planar:
        """Velocity of the ground point under the pelvis, (n,) [m/s]."""
        turning = 1j * self.rows[SWAY_RATE] - self.rows[TURN_RATE] * self.rows[SWAY]
        return self.floor[VELOCITY] + turning * np.exp(1j * self.rows[HEADING])


class _Hips(NamedTuple):
    """Pelvis and hip joints as the loads have them: ground point of the pelvis (n,) [m], distance of the left foot before the
    right one (n,) [m], yaw of the pelvis (n,) [rad]; places (2, n) and height (n,) of the joints [m].
    """

    pelvis: Planar
    stride: Array
    yaw: Array
    place: Planar
    height: Array


def heel_and_pelvis(state: GaitState, skeleton: Skeleton) -> tuple[Array, Array, Array, Planar, Planar, Array]:
    """Return pitch of the feet (2, n) [rad], yaw (n,) [rad] and height (n,) [m] of the pelvis, and the ends of the legs:
    places of hips and ankles (2, n) [m], and the ankles' height (2, n) [m].

    Heels come up as far as the legs need to reach the hips; where that does not suffice the pelvis comes down. It does not
    in a regular gait, where its height is that of the loads' motion.
    """
    return _heel_and_pelvis(state, _hips(state, skeleton), skeleton)


def _heel_and_pelvis(
    state: GaitState, hips: _Hips, skeleton: Skeleton
) -> tuple[Array, Array, Array, Planar, Planar, Array]:
    pitch = _feet_pitch(state, hips, skeleton)
    ankle, ankle_height = _ankles(state, pitch, skeleton)
    reach = skeleton.longest**2 - np.abs(hips.place - ankle) ** 2
    # a foot in the air, or about to be, does not hold the pelvis down
    free = _LETS_GO * np.sqrt(np.maximum(state.rows[FEET_HEIGHT], 0.0)) + _UNLOADED_M * np.maximum(
        1.0 - 2.0 * state.rows[FEET_LOAD], 0.0
    )
    allowed = ankle_height + np.sqrt(np.maximum(reach, 0.0)) + free
    height = np.minimum(hips.height, np.minimum(allowed[0], allowed[1]))
    return pitch, hips.yaw, height, hips.place, ankle, ankle_height


def feet_pitch(state: GaitState, skeleton: Skeleton) -> Array:
    """Return the pitch of the feet (2, n) [rad] as `heel_and_pelvis` does."""
    return _feet_pitch(state, _hips(state, skeleton), skeleton)


def _feet_pitch(state: GaitState, hips: _Hips, skeleton: Skeleton) -> Array:
    pitch, needed = state.rows[FEET_PITCH], _heel_needed(state, hips, skeleton)
    return np.where(pitch < 0, pitch + needed, np.maximum(pitch, needed))


def _hips(state: GaitState, skeleton: Skeleton) -> _Hips:
    rows, (left, right) = state.rows, state.floor[FEET]
    facing = np.exp(1j * rows[HEADING])
    pelvis = state.floor[PLACE] + 1j * rows[SWAY] * facing
    stride = ((left - right) * facing.conj()).real
    yaw = rows[HEADING] - _TWIST_PER_STRIDE * stride / skeleton.scale
    hips = pelvis + 1j * skeleton.hip_offset * np.exp(1j * yaw)
    return _Hips(pelvis, stride, yaw, hips, _STANDS_AT * skeleton.leg + skeleton.ankle_height + rows[BOB])


def pelvis_yaw(state: GaitState, skeleton: Skeleton) -> Array:
    """Return the yaw of the pelvis, (n,) [rad]."""
    return _hips(state, skeleton).yaw


class FootLoads(NamedTuple):
    """Feet of n people on the floor, (2, n) each, left first.

    load [body weights], 0 in the air; pressure_ahead: point of load ahead of the ankle along the foot [m]; height of the
    lowest point of the sole [m]; place: complex x + iy of the sole's point under the ankle of the flat foot [m]; yaw [rad].
    """

    load: Array
    pressure_ahead: Array
    height: Array
    place: Planar
    yaw: Array


def foot_loads(state: GaitState, skeleton: Skeleton) -> FootLoads:
    """Return the load and position of each foot."""
    rows = state.rows
    # the straight toes of a foot that points down are its lowest point
    toes = skeleton.toes * np.sin(np.maximum(rows[FEET_PITCH], 0.0) * _free(state, skeleton))
    height = np.maximum(rows[FEET_HEIGHT] - toes, 0.0)
    return FootLoads(rows[FEET_LOAD], rows[FEET_PRESSURE], height, state.floor[FEET], rows[FEET_YAW])


def joint_coordinates(state: GaitState, skeleton: Skeleton) -> Array:
    """Return `qpos` (n, NQ_PERSON), laid out as `twin.people.body.person_spec.JOINTS`."""
    at = _hips(state, skeleton)
    pitch, yaw, height, hips, ankle, ankle_height = _heel_and_pelvis(state, at, skeleton)
    rows = state.rows
    feet_yaw = rows[FEET_YAW]
    # a leg too short for its swinging foot draws the foot nearer
    over, up = hips - ankle, height - ankle_height
    nearer = np.minimum(skeleton.longest / np.sqrt(over.real**2 + over.imag**2 + up * up), 1.0)
    legs = leg_angles(over * nearer, up * nearer, yaw, feet_yaw, pitch, skeleton.thigh, skeleton.shank)
    twist, arms = -_TWIST_PER_STRIDE * at.stride / skeleton.scale, rows[ARM_SWING] * at.stride
    inward = _HANDS_INWARD * np.maximum(rows[ELBOW] - 0.6, 0.0)
    out = np.zeros((NQ_PERSON, len(yaw)))
    out[0], out[1], out[2] = at.pelvis.real, at.pelvis.imag, height
    out[3], out[6] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    # the shoulders turn against the pelvis, the head stays with the gaze
    out[_SPINE_YAW], out[_SPINE_PITCH], out[_SPINE_ROLL] = -2.0 * twist, rows[TRUNK_PITCH], rows[TRUNK_ROLL]
    out[_NECK_YAW], out[_NECK_PITCH] = rows[GAZE] + twist, 0.04 - 0.8 * rows[TRUNK_PITCH]
    free = 1.0 - _WEIGHED_DOWN * skeleton.carries
    swing = 0.04 + _SIDE * arms * free
    out[_SHOULDER_PITCH] = swing - 0.7 * rows[TRUNK_PITCH]
    out[_SHOULDER_ROLL] = _SIDE * (_ARMS_OUT_RAD * (1.0 - np.maximum(rows[ARMS_IN], skeleton.carries)))
    out[_SHOULDER_YAW] = -_SIDE * inward
    out[_ELBOW] = 0.5 * np.minimum(swing, 0.0) - rows[ELBOW] * free
    out[_LEGS[:6]] = legs
    # the toes stay level while the heel is up, and straighten in the air
    out[_LEGS[6]] = np.maximum(pitch, 0.0) * (_free(state, skeleton) - 1.0)
    return out.T


def _free(state: GaitState, skeleton: Skeleton) -> Array:
    """Return how straight the toes of each foot are, 0 on the floor to 1 in the air, (2, n)."""
    return np.minimum(state.rows[FEET_HEIGHT] / (_TOES_FREE_M * skeleton.scale), 1.0)


def _ankles(state: GaitState, pitch: Array, skeleton: Skeleton) -> tuple[Planar, Array]:
    """Return ankle joints: positions (2, n) complex and heights (2, n) [m].

    A foot with its heel up (pitch > 0) turns about the ball, one with its toes up about the heel, so the pivot of a standing
    foot does not move.
    """
    pivot = np.where(pitch > 0, skeleton.ball, -skeleton.heel)
    cosine, sine = np.cos(pitch), np.sin(pitch)
    ahead = pivot * (1 - cosine) + skeleton.ankle_height * sine
    place = state.floor[FEET] + ahead * np.exp(1j * state.rows[FEET_YAW])
    return place, state.rows[FEET_HEIGHT] + pivot * sine + skeleton.ankle_height * cosine


def _heel_needed(state: GaitState, hips: _Hips, skeleton: Skeleton) -> Array:
    """Return the pitch (2, n) [rad] by which a foot must turn about its ball for the leg to reach it, 0 where it need not.

    In the plane of the foot, the ankle lies on a circle about the ball within the leg's length of the hip; law of cosines.
    """
    gap = (hips.place - state.floor[FEET]) * np.exp(-1j * state.rows[FEET_YAW])
    ahead, lateral = gap.real - skeleton.ball, gap.imag
    up = hips.height - state.rows[FEET_HEIGHT]
    radius, rest = skeleton.ball_from_ankle, skeleton.ball_below_ankle_rad
    far = ahead**2 + up**2
    leg = skeleton.longest**2 - lateral**2
    cosine = (far + radius**2 - leg) / (2 * np.sqrt(far) * radius)
    spread = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    needed = np.minimum(np.maximum(rest - np.arctan2(up, ahead) - spread, 0.0), _HIGHEST_HEEL_RAD)
    # a foot before the body is reached by a lower pelvis, not on tiptoe
    behind = np.minimum(np.maximum(0.5 + gap.real * (1 / _TIPTOE_FROM_M), 0.0), 1.0)
    # a foot in the air soon takes the pitch of its swing
    return needed * behind * np.maximum(1.0 - state.rows[FEET_HEIGHT] / (_SWINGS_FROM_M * skeleton.scale), 0.0)
