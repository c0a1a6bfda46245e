"""Sitting down and standing up: where one sits and stands on and before a seat, and the movement between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.people.posture.course import minimum_jerk
from twin.people.posture.measures import SEATED_PELVIS_RAD, SEATED_SPINE_RAD, BodyMeasures
from twin.people.posture.rows import (
    ANKLE,
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
    REST,
    SPINE_PITCH,
)
from twin.room.furniture import Seat

SIT_DOWN_S = 2.0
STAND_UP_S = 1.8
"""How long the movements take [s] (M. Schenkman et al., "Whole-body movements during rising to standing from sitting",
Physical Therapy 70, 1990: 1.8 s for rising at a pace of one's own; sitting down is a little slower)."""
LEAN_RAD = 0.72
"""Greatest lean of the trunk, just before the seat is met (Schenkman et al.: 40 to 50 degrees)."""
FEET_SHARE = 0.2
"""Share of the weight on the feet of one who sits with both of them on the floor (19 % in F. Collins, "Selecting cushions
and armchairs", Journal of Wound Care 13, 2004)."""
SINK_M = 0.015
"""How far buttocks give way on a seat [m]."""

_ANKLES_BACK_M = 0.08
"""How far the ankles stand behind the knees of one who sits, for the reference leg [m]."""
_SITS_AT_LEAST_M = 0.10
"""Least way of the hip joints behind the front edge of a seat, for the reference leg [m]."""
_THIGH_GIVES_M = 0.03
_STEEPEST = 0.5
"""Sine of the steepest slope of thighs that is still sitting: 30 degrees."""
_PRESSURE_SHIFT_M = 0.035
_KNEE_HANGING_RAD = 1.22


@dataclass(frozen=True)
class Spot:
    """Where one person sits: hips x, y, z [m], yaw [rad]; feet_ahead_m: ankles before the hips; feet_hang: off the floor."""

    hips: tuple[float, float, float]
    yaw: float
    feet_ahead_m: float
    feet_hang: bool

    @property
    def standing_place(self) -> complex:
        """Where one stands before sitting down and after standing up, x + iy [m]; facing `yaw`."""
        return complex(self.hips[0], self.hips[1]) + self.feet_ahead_m * complex(np.cos(self.yaw), np.sin(self.yaw))


def spot_on(seat: Seat, measures: BodyMeasures, person: int) -> Spot:
    """Where this person sits on this seat, of which as much is taken to lie behind its middle as before it.

    As far back as the seat, a bag on the back, or the thighs allow; nearer to the front edge where the seat is
    high, so that the feet stay flat on the floor and the thighs slope down to them; where that would be too near,
    the feet hang in the air.
    """
    thigh, scale = float(measures.thigh[person]), float(measures.scale[person])
    top = float(seat.place[2])
    over = float(measures.under[person]) - SINK_M
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
    return Spot((float(hips.real), float(hips.imag), top + over), float(seat.yaw), ahead, bool(hang))


def lay_sitting(rows: Array, progress: Array, spot: Array, hang: Array, stature: Array) -> None:
    """Add sitting to rows (POSTURE_ROWS, m); progress (m,): 0 standing, 1 seated; spot (4, m): hips x, y, z, yaw.

    The trunk leans until the seat is met and comes up again; the hips go back and down; the hands come to lie on the
    thighs. The feet stay where they stand, except where they hang (1) in the end.
    """
    weights = np.stack(
        [minimum_jerk(progress, 0.10, 0.74), minimum_jerk(progress, 0.0, 0.70), minimum_jerk(progress, 0.1, 0.8)]
    )
    rows[HELD] += weights
    rows[PLACE_XY] += weights[0] * spot[:2]
    rows[PLACE_Z] += weights[1] * spot[2]
    rows[PLACE_YAW] += weights[2] * spot[3]
    bump = minimum_jerk(progress, 0.0, 0.62) * (1.0 - minimum_jerk(progress, 0.62, 1.0))
    lean, seated = LEAN_RAD * bump, minimum_jerk(progress, 0.6, 1.0)
    rows[PELVIS_PITCH] += 0.55 * lean + SEATED_PELVIS_RAD * seated
    rows[SPINE_PITCH] += 0.45 * lean + SEATED_SPINE_RAD * seated
    rows[NECK_PITCH] += -0.55 * lean - (SEATED_PELVIS_RAD + SEATED_SPINE_RAD) * seated
    rows[ARMS_PITCH] -= 1.25 * lean
    rows[REST : REST + 2] += minimum_jerk(progress, 0.2, 0.75)
    # one whose feet will hang climbs on: the feet leave the floor, and their load, before the seat is met
    free = hang * minimum_jerk(progress, 0.22, 0.9)
    for leg in (LEGS, LEGS + 1 + FREE_ANGLES):
        rows[leg] += free
        rows[leg + HIP_PITCH] += free * (-0.5 * np.pi - SEATED_PELVIS_RAD)
        rows[leg + KNEE] += free * _KNEE_HANGING_RAD
        rows[leg + ANKLE] += free * 0.35
    share = np.where(hang > 0, 0.0, FEET_SHARE)
    rows[OFF_FEET] += (1.0 - share) * minimum_jerk(progress, 0.63 - 0.45 * hang, 0.86 - 0.26 * hang)
    rows[PRESSURE] += _PRESSURE_SHIFT_M * (stature / 1.75) * bump
