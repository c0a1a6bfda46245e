"""Resting: poses on seats and beds, and the movements to sit down, lie down and get up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.people.posture.body_measures import SEATED_PELVIS_RAD, SEATED_SPINE_RAD, BodyMeasures
from twin.people.posture.posture_rows import (
    ANKLE,
    ARMS_FLAT,
    ARMS_PITCH,
    FREE_ANGLES,
    HELD,
    HIP_PITCH,
    KNEE,
    LEGS,
    NECK_PITCH,
    OFF_FEET,
    PELVIS_PITCH,
    PLACE_XY,
    PLACE_YAW,
    PLACE_Z,
    PRESSURE,
    PROP,
    REST,
    SPINE_PITCH,
    minimum_jerk,
)
from twin.room.furniture import Bed, Seat

SIT_DOWN_S = 2.0
STAND_UP_S = 1.8
"""Durations of the movements [s] (M. Schenkman et al., "Whole-body movements during rising to standing from sitting",
Physical Therapy 70, 1990: 1.8 s for rising at one's own pace; sitting down is a little slower).
"""
LEAN_RAD = 0.72
"""Greatest lean of the trunk, just before contact with the seat (Schenkman et al.: 40 to 50 degrees)."""
FEET_SHARE = 0.2
"""Share of the weight on the feet when seated with both on the floor (19 % in F. Collins, "Selecting cushions and
armchairs", Journal of Wound Care 13, 2004).
"""
BEFORE_M = 0.28
"""Distance from the place of sitting down to that of turning round before [m]."""
SEAT_SINK_M = 0.015
"""Depth by which the buttocks sink [m]."""

_ANKLES_BACK_M = 0.08
"""Distance of the ankles behind the knees when seated, for the reference leg [m]."""
_SITS_AT_LEAST_M = 0.10
"""Least distance of the hip joints behind the front edge of a seat, for the reference leg [m]."""
_THIGH_GIVES_M = 0.03
_STEEPEST = 0.5
"""Sine of the steepest slope of seated thighs: 30 degrees."""
_PRESSURE_SHIFT_M = 0.035
_KNEE_HANGING_RAD = 1.22
_ARMS_ASIDE_RAD = 0.7
"""Pitch of the arms of a person who sits beside a desk [rad]."""


@dataclass(frozen=True)
class SeatedPose:
    """Pose on a seat: hips x, y, z [m], yaw [rad]; feet_ahead_m: ankles before the hips; feet_hang: off the floor."""

    hips: tuple[float, float, float]
    yaw: float
    feet_ahead_m: float
    feet_hang: bool

    @property
    def standing_place(self) -> complex:
        """Place to stand before sitting down and after standing up, x + iy [m], facing `yaw`."""
        return complex(self.hips[0], self.hips[1]) + self.feet_ahead_m * complex(np.cos(self.yaw), np.sin(self.yaw))


def seated_pose(seat: Seat, measures: BodyMeasures, person: int) -> SeatedPose:
    """Return a person's pose on a seat, taken to extend equally behind and before its middle.

    The hips are as far back as the seat, a bag on the back, or the thighs allow. On a high seat they are nearer to the front
    edge, so that the feet stay flat and the thighs slope down to them; where that would be too near, the feet hang.
    """
    thigh, scale = float(measures.thigh[person]), float(measures.scale[person])
    top = float(seat.place[2])
    over = float(measures.under[person]) - SEAT_SINK_M
    shank_radius = float(measures.shank_radius[person])
    behind = float(max(measures.behind[person], measures.burden_behind[person]))
    behind_front = min(2.0 * seat.to_front_m - behind - 0.01, thigh - shank_radius - 0.04)
    down = top + over - float(measures.ankle_height[person] + measures.shank[person])
    least = _SITS_AT_LEAST_M * scale
    slope = down / thigh
    clear = over - float(measures.thigh_under[person]) + _THIGH_GIVES_M
    hang = slope > 0 and (slope > _STEEPEST or clear * np.sqrt(1 - slope**2) / slope < least)
    if slope > 0 and not hang:
        behind_front = min(behind_front, clear * np.sqrt(1 - slope**2) / slope)
    behind_front = max(behind_front, least)
    hips = complex(seat.place[0], seat.place[1]) + (seat.to_front_m - behind_front) * np.exp(1j * seat.yaw)
    ahead = max(thigh - _ANKLES_BACK_M * scale, behind_front + shank_radius + 0.03)
    return SeatedPose((float(hips.real), float(hips.imag), top + over), float(seat.yaw), ahead, bool(hang))


def add_sitting(rows: Array, progress: Array, pose: Array, hang: Array, stature: Array, aside: Array) -> None:
    """Add sitting to rows (POSTURE_ROWS, m); progress (m,): 0 standing, 1 seated; pose (4, m): hips x, y, z, yaw.

    The trunk leans until contact with the seat and comes up again; the hips go back and down; the hands come to rest on the
    thighs. The feet stay, except where they hang (1) in the end. Of a person who sits beside a desk the arms hang beside the
    thighs (aside (m,): 1), since elbows would reach over it.
    """
    weights = np.stack(
        [minimum_jerk(progress, 0.10, 0.74), minimum_jerk(progress, 0.0, 0.70), minimum_jerk(progress, 0.1, 0.8)]
    )
    rows[HELD] += weights
    rows[PLACE_XY] += weights[0] * pose[:2]
    rows[PLACE_Z] += weights[1] * pose[2]
    rows[PLACE_YAW] += weights[2] * pose[3]
    bump = minimum_jerk(progress, 0.0, 0.62) * (1.0 - minimum_jerk(progress, 0.62, 1.0))
    lean, seated = LEAN_RAD * bump, minimum_jerk(progress, 0.6, 1.0)
    rows[PELVIS_PITCH] += 0.55 * lean + SEATED_PELVIS_RAD * seated
    rows[SPINE_PITCH] += 0.45 * lean + SEATED_SPINE_RAD * seated
    rows[NECK_PITCH] += -0.55 * lean - (SEATED_PELVIS_RAD + SEATED_SPINE_RAD) * seated
    rows[ARMS_PITCH] -= 1.25 * lean + _ARMS_ASIDE_RAD * seated * aside
    rows[REST : REST + 2] += minimum_jerk(progress, 0.2, 0.75) * (1.0 - aside)
    # a person whose feet will hang climbs on: feet and their load leave the floor before contact with the seat
    free = hang * minimum_jerk(progress, 0.22, 0.9)
    for leg in (LEGS, LEGS + 1 + FREE_ANGLES):
        rows[leg] += free
        rows[leg + HIP_PITCH] += free * (-0.5 * np.pi - SEATED_PELVIS_RAD)
        rows[leg + KNEE] += free * _KNEE_HANGING_RAD
        rows[leg + ANKLE] += free * 0.35
    share = np.where(hang > 0, 0.0, FEET_SHARE)
    rows[OFF_FEET] += (1.0 - share) * minimum_jerk(progress, 0.63 - 0.45 * hang, 0.86 - 0.26 * hang)
    rows[PRESSURE] += _PRESSURE_SHIFT_M * (stature / 1.75) * bump


LIE_DOWN_S = 3.0
GET_UP_S = 3.0
"""Duration from sitting on the edge to lying, and back [s] (ours; supine to edge of bed takes adults 2 to 4 s)."""

MATTRESS_SINK_M = 0.025
"""Depth by which a body sinks into a mattress [m]."""
_EDGE_DEPTH_M = 0.42
"""Depth of the mattress that serves as the seat of a person on its edge [m]."""
_TOWARDS_HEAD_M = 0.04
"""Offset of a lying person's middle from that of the bed towards the head end: feet that point down take room [m]."""


@dataclass(frozen=True)
class LyingPose:
    """Pose on a bed: hips x, y, z [m], yaw towards the feet end [rad], unwrapped from the edge's; edge: the seated pose
    before and after; turns_left: to lie down.
    """

    hips: tuple[float, float, float]
    yaw: float
    edge: SeatedPose
    turns_left: bool


def lying_pose(bed: Bed, measures: BodyMeasures, person: int, adjacent: complex) -> LyingPose:
    """Return the lying pose of a person who comes from the place `adjacent`, x + iy [m], over the nearest long side.

    On the back, the middle of the body in the middle of the bed; in a bed too short the feet hang over its end.
    """
    along = np.exp(1j * bed.yaw)
    middle = complex(bed.place[0], bed.place[1])
    left = ((adjacent - middle) * along.conjugate()).imag >= 0
    outwards = along * (1j if left else -1j)
    stature = float(measures.stature[person])
    hips_up = float(measures.leg[person] + measures.ankle_height[person])
    along_m = hips_up - 0.5 * stature
    where = middle + (along_m + _TOWARDS_HEAD_M) * along
    to_edge = float(bed.to_edge_m[0 if left else 1])
    seat = where + (to_edge - 0.5 * _EDGE_DEPTH_M) * outwards
    yaw = float(np.angle(outwards))
    top = float(bed.place[2])
    place = np.array([seat.real, seat.imag, top])
    edge = seated_pose(Seat(bed.name, place, yaw, bed.furniture, bed.geoms, 0.5 * _EDGE_DEPTH_M), measures, person)
    # facing outwards from the bed's left side, the feet end is on the left
    turn = 0.5 * np.pi if left else -0.5 * np.pi
    height = top + float(max(measures.behind[person], measures.back[person])) - MATTRESS_SINK_M
    return LyingPose((where.real, where.imag, height), yaw + turn, edge, left)


def add_lying(rows: Array, progress: Array, seated: Array, lying: Array, turns_left: Array, drop: Array) -> None:
    """Add lying down to sitting; rows (POSTURE_ROWS, m) hold sitting on the edge.

    progress (m,): 0 seated, 1 on the back; seated, lying (4, m): hips x, y, z, yaw of both; turns_left (m,): 1 or 0; drop
    (m,): slope of the legs from the hips down to heels on the mattress [rad]. The legs leave the floor, the one towards the
    feet end first, and swing up while the trunk turns and lowers; the arms prop it from behind.
    """
    way = lying - seated
    rows[PLACE_XY] += minimum_jerk(progress, 0.15, 0.9) * way[:2]
    rows[PLACE_Z] += minimum_jerk(progress, 0.15, 0.9) * way[2]
    rows[PLACE_YAW] += minimum_jerk(progress, 0.06, 0.78) * way[3]
    reclined = minimum_jerk(progress, 0.1, 0.95)
    bump = 4.0 * reclined * (1.0 - reclined)
    rows[PELVIS_PITCH] += reclined * (-0.5 * np.pi - rows[PELVIS_PITCH])
    rows[SPINE_PITCH] += -reclined * rows[SPINE_PITCH] + 0.35 * bump
    rows[NECK_PITCH] += reclined * (0.12 - rows[NECK_PITCH]) + 0.35 * bump
    rows[PROP] += minimum_jerk(progress, 0.02, 0.35) * (1.0 - minimum_jerk(progress, 0.45, 0.8))
    rows[REST : REST + 2] *= 1.0 - minimum_jerk(progress, 0.0, 0.3)
    rows[ARMS_FLAT] += minimum_jerk(progress, 0.4, 1.0)
    straight = minimum_jerk(progress, 0.38, 0.97)
    raised = minimum_jerk(progress, 0.0, 0.45) * (1.0 - straight)
    for number, leg in enumerate((LEGS, LEGS + 1 + FREE_ANGLES)):
        side = 1.0 - 2.0 * number
        first = turns_left if number == 0 else 1.0 - turns_left
        begin = 0.10 - 0.06 * first
        free = minimum_jerk(progress, begin, begin + 0.32)
        angles = np.stack(
            [
                side * 0.16 * straight,
                np.zeros_like(free),
                -1.42 * (1.0 - straight) - 0.42 * raised + drop * straight,
                1.40 * (1.0 - straight) + 0.06 * straight,
                0.15 + 0.30 * straight,
            ]
        )
        hung = rows[leg].copy()  # of a person whose feet hang already
        rows[leg] += (1.0 - hung) * free
        rows[leg + 1 : leg + 1 + FREE_ANGLES] *= 1.0 - free
        rows[leg + 1 : leg + 1 + FREE_ANGLES] += free * angles
    rows[OFF_FEET] += (1.0 - rows[OFF_FEET]) * minimum_jerk(progress, 0.04, 0.36)
