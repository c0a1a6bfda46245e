"""Lying down and getting up: from the edge of a bed onto one's back, and the way back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array
from twin.people.posture.course import minimum_jerk
from twin.people.posture.measures import BodyMeasures
from twin.people.posture.rows import (
    ARMS_FLAT,
    FREE_ANGLES,
    LEGS,
    NECK_PITCH,
    OFF_FEET,
    PELVIS_PITCH,
    PLACE_XY,
    PLACE_YAW,
    PLACE_Z,
    PROP,
    REST,
    SPINE_PITCH,
)
from twin.people.posture.sit import Spot, spot_on
from twin.room.furniture import Bed, Seat

LIE_DOWN_S = 3.0
GET_UP_S = 3.0
"""From sitting on the edge to lying, and back [s] (ours; supine to edge of bed takes adults 2 to 4 s)."""

SINK_M = 0.025
"""How far a body sinks into a mattress [m]."""
_EDGE_DEPTH_M = 0.42
"""How much of the mattress counts as the seat of one who sits on its edge [m]."""
_TOWARDS_HEAD_M = 0.04
"""How far towards the head end the middle of one who lies is from the middle of the bed: feet that point down take room [m]."""


@dataclass(frozen=True)
class Lair:
    """Where one person lies: hips x, y, z [m], yaw towards the feet end [rad], unwrapped from the edge's; the edge: where
    they sit before and after; turns_left: whether they turn left to lie down."""

    hips: tuple[float, float, float]
    yaw: float
    edge: Spot
    turns_left: bool


def lair_in(bed: Bed, measures: BodyMeasures, person: int, beside: complex) -> Lair:
    """Where this person lies in this bed, who comes from the place `beside` x + iy [m]: on the long side nearest to it.

    On the back, the middle of the body in the middle of the bed; in a bed too short the feet hang over its end.
    """
    along = np.exp(1j * bed.yaw)
    middle = complex(bed.place[0], bed.place[1])
    left = ((beside - middle) * along.conjugate()).imag >= 0
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
    edge = spot_on(Seat(bed.name, place, yaw, bed.furniture, bed.geoms, 0.5 * _EDGE_DEPTH_M), measures, person)
    # facing outwards from the bed's left side, the feet end is to the left
    turn = 0.5 * np.pi if left else -0.5 * np.pi
    height = top + float(max(measures.behind[person], measures.back[person])) - SINK_M
    return Lair((where.real, where.imag, height), yaw + turn, edge, left)


def lay_lying(rows: Array, progress: Array, spot: Array, lair: Array, turns_left: Array, drop: Array) -> None:
    """Lay lying down over sitting; rows (POSTURE_ROWS, m) hold sitting on the edge.

    progress (m,): 0 seated, 1 on the back; spot, lair (4, m): hips x, y, z, yaw there and here; turns_left (m,): 1 or 0;
    drop (m,): slope of the legs from the hips down to heels on the mattress [rad]. The legs leave the floor, the one
    towards the feet end first, and swing up while the trunk turns and goes down; the arms prop it from behind.
    """
    way = lair - spot
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
        hung = rows[leg].copy()  # of one whose feet hang already
        rows[leg] += (1.0 - hung) * free
        rows[leg + 1 : leg + 1 + FREE_ANGLES] *= 1.0 - free
        rows[leg + 1 : leg + 1 + FREE_ANGLES] += free * angles
    rows[OFF_FEET] += (1.0 - rows[OFF_FEET]) * minimum_jerk(progress, 0.04, 0.36)
