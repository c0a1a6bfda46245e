"""From a moment of the gait to the whole body: heels, pelvis, legs, arms, head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.body.body import JOINT_PLACE, LEG, NQ_PERSON, SIDES
from twin.people.body.legs import leg_angles
from twin.people.body.skeleton import Skeleton

Planar = NDArray[np.complex128]

FLOOR_ROWS = 4
ROWS = 20

STRAIGHTEST = 0.9945
"""Longest distance from hip to ankle as a share of the leg: the knee keeps 12 degrees."""
_STANDS_AT = 0.9945
"""Height of the hips over the ankles when standing, as a share of the leg."""
_HIGHEST_HEEL_RAD = 1.4
_TIPTOE_FROM_M = 0.2
_SWINGS_FROM_M = 0.02
_TWIST_PER_STRIDE = 0.13
"""Turn of the pelvis towards the foot in front [rad/m, for the reference leg]."""
_LETS_GO = 0.8
"""How much higher the pelvis may be than a foot's leg allows, for the root of its height off the floor [m^0.5]."""
_UNLOADED_M = 0.12
"""How much higher it may be than the leg of a foot allows that carries nothing; none if that carries half the body [m]."""
_ARMS_OUT_RAD = 0.10
_HANDS_INWARD = 0.35
"""How much the upper arms turn in for each radian of elbow beyond 0.6: runners' hands go before the chest."""
_TOES_FREE_M = 0.2
"""Height of the ball from which the toes of a lifted foot are straight."""

_LEGS = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in LEG] for side in SIDES])  # (2, 7)
_SPINE_YAW, _SPINE_PITCH, _SPINE_ROLL = (JOINT_PLACE[name] for name in ("spine_yaw", "spine_pitch", "spine_roll"))
_NECK_YAW, _NECK_PITCH = (JOINT_PLACE[name] for name in ("neck_yaw", "neck_pitch"))
_ARMS = tuple(
    tuple(JOINT_PLACE[f"{side}_{joint}"] for joint in ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"))
    for side in SIDES
)


@dataclass(frozen=True, eq=False)
class Moment:
    """How n people move at one time, in numbers that may be interpolated linearly (angles are unwrapped).

    floor (4, n) complex x + iy: place of the body [m], its velocity [m/s], left foot, right foot [m].
    rows (20, n): heading [rad], turn rate [rad/s], pelvis height about its standing height, sway of the pelvis to the
    left [m], its rate [m/s], trunk pitch, trunk roll, gaze, elbow [rad], height of the left and right foot [m], their
    pitch before what the leg's reach adds [rad], their yaw [rad], load on them [body weights], where it acts ahead of
    the ankles [m], swing of the arms [rad/m].
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

    Heels come up as far as the legs need to reach the hips; where that is not enough the pelvis comes down (it does not
    in a regular gait, so there its height is that of the loads' motion).
    """
    yaw = moment.rows[0] - _TWIST_PER_STRIDE * _stride(moment) / skeleton.scale
    hips = moment.pelvis + 1j * skeleton.hip_offset * np.exp(1j * yaw)
    height = _STANDS_AT * skeleton.leg + skeleton.ankle_height + moment.rows[2]
    pitch = moment.rows[11:13]
    needed = _heel_needed(moment, hips, height, skeleton)
    pitch = np.where(pitch < 0, pitch + needed, np.maximum(pitch, needed))
    ankle, ankle_height = _ankles(moment, pitch, skeleton)
    reach = (STRAIGHTEST * skeleton.leg) ** 2 - np.abs(hips - ankle) ** 2
    # a foot in the air, or about to be, does not hold the pelvis down
    free = _LETS_GO * np.sqrt(np.maximum(moment.rows[9:11], 0.0)) + _UNLOADED_M * np.maximum(
        1.0 - 2.0 * moment.rows[15:17], 0.0
    )
    allowed = ankle_height + np.sqrt(np.maximum(reach, 0.0)) + free
    return pitch, yaw, np.minimum(height, np.minimum(allowed[0], allowed[1]))


class FootLoads(NamedTuple):
    """The feet of n people on the floor, (2, n) each, left first.

    load [body weights], 0 in the air; pressure_ahead: where it acts, ahead of the ankle along the foot [m]; height of
    the lowest point of the sole [m]; place: complex x + iy of the sole's point under the ankle, as if the foot were flat
    [m]; yaw [rad].
    """

    load: Array
    pressure_ahead: Array
    height: Array
    place: Planar
    yaw: Array


def foot_loads(moment: Moment, skeleton: Skeleton) -> FootLoads:
    """What each foot carries, and where it is."""
    rows = moment.rows
    # straight toes of a foot that points down are its lowest
    toes = skeleton.toes * np.sin(np.maximum(rows[11:13], 0.0) * _free(moment, skeleton))
    height = np.maximum(rows[9:11] - toes, 0.0)
    return FootLoads(rows[15:17], rows[17:19], height, moment.floor[2:4], rows[13:15])


def joint_coordinates(moment: Moment, skeleton: Skeleton) -> Array:
    """`qpos` (n, NQ_PERSON) of each person, laid out as `twin.people.body.body.JOINTS` says."""
    pitch, yaw, height = heel_and_pelvis(moment, skeleton)
    pelvis, rows = moment.pelvis, moment.rows
    facing = np.exp(1j * yaw)
    hips = pelvis + 1j * skeleton.hip_offset * facing
    ankle, ankle_height = _ankles(moment, pitch, skeleton)
    feet_yaw = rows[13:15]
    # a leg that is too short for where its foot swings has the foot nearer
    over, up = hips - ankle, height - ankle_height
    nearer = np.minimum(STRAIGHTEST * skeleton.leg / np.sqrt(over.real**2 + over.imag**2 + up * up), 1.0)
    legs = leg_angles(over * nearer, up * nearer, yaw, feet_yaw, pitch, skeleton.thigh, skeleton.shank)
    stride = _stride(moment)
    twist, arms = -_TWIST_PER_STRIDE * stride / skeleton.scale, rows[19] * stride
    inward = _HANDS_INWARD * np.maximum(rows[8] - 0.6, 0.0)
    out = np.zeros((NQ_PERSON, len(yaw)))
    out[0], out[1], out[2] = pelvis.real, pelvis.imag, height
    out[3], out[6] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    # the shoulders turn against the pelvis, the head stays with the gaze
    out[_SPINE_YAW], out[_SPINE_PITCH], out[_SPINE_ROLL] = -2.0 * twist, rows[5], rows[6]
    out[_NECK_YAW], out[_NECK_PITCH] = rows[7] + twist, 0.04 - 0.8 * rows[5]
    for (pitch_place, roll_place, yaw_place, elbow_place), sign in zip(_ARMS, (1.0, -1.0), strict=True):
        swing = 0.04 + sign * arms
        out[pitch_place] = swing - 0.7 * rows[5]
        out[roll_place] = sign * _ARMS_OUT_RAD
        out[yaw_place] = -sign * inward
        out[elbow_place] = 0.5 * np.minimum(swing, 0.0) - rows[8]
    for place in range(6):
        out[_LEGS[:, place]] = legs[place]
    # the toes stay level while the heel is up, and straighten in the air
    out[_LEGS[:, 6]] = np.maximum(pitch, 0.0) * (_free(moment, skeleton) - 1.0)
    return out.T


def _free(moment: Moment, skeleton: Skeleton) -> Array:
    """How much the toes of each foot are straight, 0 on the floor to 1 in the air, (2, n)."""
    return np.minimum(moment.rows[9:11] / (_TOES_FREE_M * skeleton.scale), 1.0)


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
    leg = (STRAIGHTEST * skeleton.leg) ** 2 - aside**2
    cosine = (far + radius**2 - leg) / (2 * np.sqrt(far) * radius)
    spread = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    needed = np.minimum(np.maximum(rest - np.arctan2(up, ahead) - spread, 0.0), _HIGHEST_HEEL_RAD)
    # a foot before the body is reached by a lower pelvis, not on tiptoe
    behind = np.minimum(np.maximum(0.5 + gap.real * (1 / _TIPTOE_FROM_M), 0.0), 1.0)
    # a foot in the air soon turns as its swing has it
    return needed * behind * np.maximum(1.0 - moment.rows[9:11] / (_SWINGS_FROM_M * skeleton.scale), 0.0)
