"""From a moment of the gait to the whole body: heels, pelvis, legs, arms, head."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.people.body import JOINT_PLACE, LEG, NQ_PERSON, SIDES
from twin.people.legs import leg_angles
from twin.people.skeleton import Skeleton

Array = NDArray[np.float64]
Planar = NDArray[np.complex128]

FLOOR_ROWS = 4
ROWS = 15

_STRAIGHTEST = 0.9945
"""Longest distance from hip to ankle as a share of the leg: the knee keeps 12 degrees."""
_STANDS_AT = 0.9945
"""Height of the hips over the ankles when standing, as a share of the leg."""
_HIGHEST_HEEL_RAD = 1.15
_TIPTOE_FROM_M = 0.2
_TWIST_PER_STRIDE = 0.13
"""Turn of the pelvis towards the foot in front [rad/m, for the reference leg]."""
_SWING_PER_STRIDE = 0.52
"""Swing of the arms against the legs [rad/m, for the reference leg]."""
_ARMS_OUT_RAD = 0.10

_LEGS = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in LEG] for side in SIDES])  # (2, 7)
_SPINE_YAW, _SPINE_PITCH, _SPINE_ROLL = (JOINT_PLACE[name] for name in ("spine_yaw", "spine_pitch", "spine_roll"))
_NECK_YAW, _NECK_PITCH = (JOINT_PLACE[name] for name in ("neck_yaw", "neck_pitch"))
_ARMS = tuple(
    tuple(JOINT_PLACE[f"{side}_{joint}"] for joint in ("shoulder_pitch", "shoulder_roll", "elbow")) for side in SIDES
)


@dataclass(frozen=True, eq=False)
class Moment:
    """How n people move at one time, in numbers that may be interpolated linearly (angles are unwrapped).

    floor (4, n) complex x + iy: place of the body [m], its velocity [m/s], left foot, right foot [m].
    rows (15, n): heading [rad], turn rate [rad/s], pelvis height about its standing height, sway of the pelvis to the
    left [m], its rate [m/s], trunk pitch, trunk roll, gaze, elbow [rad], height of the left and right foot [m], their
    pitch before what the leg's reach adds [rad], their yaw [rad].
    """

    floor: Planar
    rows: Array

    @property
    def pelvis(self) -> Planar:
        """Ground point under the pelvis, (n,) [m]."""
        return self.floor[0] + 1j * self.rows[3] * np.exp(1j * self.rows[0])

    @property
    def pelvis_velocity(self) -> Planar:
        """Velocity of the ground point under the pelvis, (n,) [m/s]."""
        turning = 1j * self.rows[4] - self.rows[1] * self.rows[3]
        return self.floor[1] + turning * np.exp(1j * self.rows[0])


def heel_and_pelvis(moment: Moment, skeleton: Skeleton) -> tuple[Array, Array, Array]:
    """Pitch of the feet (2, n) [rad], yaw (n,) [rad] and height (n,) [m] of the pelvis.

    Heels come up as far as the legs need to reach the hips; where that is not enough the pelvis comes down.
    """
    yaw = moment.rows[0] - _TWIST_PER_STRIDE * _stride(moment) / skeleton.scale
    hips = moment.pelvis + 1j * skeleton.hip_offset * np.exp(1j * yaw)
    height = _STANDS_AT * skeleton.leg + skeleton.ankle_height + moment.rows[2]
    pitch = moment.rows[11:13]
    needed = _heel_needed(moment, hips, height, skeleton)
    pitch = np.where(pitch < 0, pitch + needed, np.maximum(pitch, needed))
    ankle, ankle_height = _ankles(moment, pitch, skeleton)
    reach = (_STRAIGHTEST * skeleton.leg) ** 2 - np.abs(hips - ankle) ** 2
    allowed = ankle_height + np.sqrt(np.maximum(reach, 0.0))
    return pitch, yaw, np.minimum(height, np.minimum(allowed[0], allowed[1]))


def joint_coordinates(moment: Moment, skeleton: Skeleton) -> Array:
    """`qpos` (n, NQ_PERSON) of each person, laid out as `twin.people.body.JOINTS` says."""
    pitch, yaw, height = heel_and_pelvis(moment, skeleton)
    pelvis, rows = moment.pelvis, moment.rows
    facing = np.exp(1j * yaw)
    hips = pelvis + 1j * skeleton.hip_offset * facing
    ankle, ankle_height = _ankles(moment, pitch, skeleton)
    feet_yaw = rows[13:15]
    legs = leg_angles(hips - ankle, height - ankle_height, yaw, feet_yaw, pitch, skeleton.thigh, skeleton.shank)
    stride = _stride(moment) / skeleton.scale
    twist = -_TWIST_PER_STRIDE * stride
    out = np.zeros((NQ_PERSON, len(yaw)))
    out[0], out[1], out[2] = pelvis.real, pelvis.imag, height
    out[3], out[6] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    # the shoulders turn against the pelvis, the head stays with the gaze
    out[_SPINE_YAW], out[_SPINE_PITCH], out[_SPINE_ROLL] = -2.0 * twist, rows[5], rows[6]
    out[_NECK_YAW], out[_NECK_PITCH] = rows[7] + twist, 0.04 - 0.8 * rows[5]
    for (pitch_place, roll_place, elbow_place), sign in zip(_ARMS, (1.0, -1.0), strict=True):
        swing = 0.04 + sign * _SWING_PER_STRIDE * stride
        out[pitch_place] = swing - 0.7 * rows[5]
        out[roll_place] = sign * _ARMS_OUT_RAD
        out[elbow_place] = 0.7 * np.minimum(swing, 0.0) - rows[8]
    for place in range(6):
        out[_LEGS[:, place]] = legs[place]
    # the toes stay level while the heel is up
    out[_LEGS[:, 6]] = -np.maximum(pitch, 0.0)
    return out.T


def _stride(moment: Moment) -> Array:
    """How far the left foot is before the right one, along the heading, (n,) [m]."""
    return ((moment.floor[2] - moment.floor[3]) * np.exp(-1j * moment.rows[0])).real


def _ankles(moment: Moment, pitch: Array, skeleton: Skeleton) -> tuple[Planar, Array]:
    """Ankle joints: places (2, n) complex and heights (2, n) [m].

    A foot with its heel up (pitch > 0) turns about the ball, one with its toes up about the heel, so that the pivot of
    a standing foot stays where it is.
    """
    pivot = np.where(pitch > 0, skeleton.ball, -skeleton.heel)
    cosine, sine = np.cos(pitch), np.sin(pitch)
    ahead = pivot * (1 - cosine) + skeleton.ankle_height * sine
    place = moment.floor[2:4] + ahead * np.exp(1j * moment.rows[13:15])
    return place, moment.rows[9:11] + pivot * sine + skeleton.ankle_height * cosine


def _heel_needed(moment: Moment, hips: Planar, height: Array, skeleton: Skeleton) -> Array:
    """Pitch (2, n) [rad] by which a foot must turn about its ball for the leg to reach it, 0 where it need not.

    In the plane of the foot: the ankle lies on a circle about the ball, and must come within the leg's length of the
    hip; law of cosines.
    """
    gap = (hips - moment.floor[2:4]) * np.exp(-1j * moment.rows[13:15])
    ahead, aside = gap.real - skeleton.ball, gap.imag
    up = height - moment.rows[9:11]
    radius = np.hypot(skeleton.ball, skeleton.ankle_height)
    rest = np.arctan2(skeleton.ankle_height, -skeleton.ball)
    far = ahead**2 + up**2
    leg = (_STRAIGHTEST * skeleton.leg) ** 2 - aside**2
    cosine = (far + radius**2 - leg) / (2 * np.sqrt(far) * radius)
    spread = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    needed = np.minimum(np.maximum(rest - np.arctan2(up, ahead) - spread, 0.0), _HIGHEST_HEEL_RAD)
    # a foot before the body is reached by a lower pelvis, not on tiptoe
    behind = np.minimum(np.maximum(0.5 + gap.real * (1 / _TIPTOE_FROM_M), 0.0), 1.0)
    return needed * behind
