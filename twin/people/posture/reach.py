"""Reaching: arm angles that bring a hand to a point, and the help of the trunk."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array
from twin.people.body.kinematics import about_x, about_y, about_z, turned
from twin.people.posture.body_measures import SEATED_PELVIS_RAD, SEATED_SPINE_RAD, BodyMeasures
from twin.people.posture.minimum_jerk import minimum_jerk

STRAIGHTEST = 0.992
"""Longest distance from shoulder to hand as a share of the arm: the elbow keeps 15 degrees."""
PELVIS_SHARE = 0.5
"""Share of the pelvis in a bend of the trunk; the rest is the spine's. (Lumbar-pelvic rhythm: M. A. Esola et al., Spine 21,
1996, about half each over a whole bend.)
"""
BACK_PER_BEND_M = 0.20
"""Displacement of the hips back for a level trunk, for the reference leg, so that the mass stays over the feet [m]."""
BACK_PER_DROP = 0.45
"""Displacement of the hips back per metre of lowering by the knees."""

_SPARE_M = 0.01
_MOST_ELBOW_RAD = 2.58
_ELBOW_OUT = 0.32
"""Outward turn of the upper arm per bend of the elbow."""
_SIDEWAYS = (0.6, 0.85)
"""Sideways share of the direction over which an arm comes to be stretched to the side."""
_FARTHEST_BACK_RAD = 5 * np.pi / 6
_BENDS = np.linspace(0.0, 1.75, 29)
_TURNS = np.linspace(-0.6, 0.6, 9)
_LEANS = np.linspace(0.0, 0.45, 5)
_DROPS = np.linspace(0.0, 0.45, 8)
"""Candidates: bend, turn, lean to the hand's side [rad], lowering by the knees [shares of the leg]."""


def arm_angles(point: Array, side: float, measures: BodyMeasures) -> tuple[Array, Array, Array, Array]:
    """Return shoulder pitch, roll, yaw and elbow [rad], (m,) each, that bring the middle of the hand to a point.

    point (m, 3): from the shoulder, in the trunk's frame [m]; side: 1 left, -1 right. A point out of reach is met in
    direction only. The remaining freedom is the upper arm's turn about itself: the elbow points down, and outwards the more
    it is bent; for a point far to the side it points down, the forearm up. The angles change fast only where the arm points
    nearly along the line of the shoulders.
    """
    upper, lower = measures.upper_arm, measures.grip
    distance = np.maximum(np.linalg.norm(point, axis=-1), 1e-9)
    nearest = np.sqrt(upper**2 + lower**2 + 2 * upper * lower * np.cos(_MOST_ELBOW_RAD))
    length = np.minimum(np.maximum(distance, nearest), STRAIGHTEST * (upper + lower))
    x, y, z = (point * (length / distance)[:, None]).T
    y = side * y  # mirror a right arm to the left
    elbow = -np.arccos((length**2 - upper**2 - lower**2) / (2 * upper * lower))
    off_line = -lower * np.sin(elbow)  # hand off the line of the upper arm
    # for small x and z the forearm must turn out of the plane ahead, either way, by at least arccos(k); the line lies
    # above that, so that the turn begins early enough
    k = np.hypot(x, z) / np.maximum(off_line, 1e-9)
    needed = 0.5 * np.pi * np.maximum(1.0 - k / 1.6, 0.0)
    sideways = minimum_jerk(y / length, *_SIDEWAYS)
    turn = np.minimum(_ELBOW_OUT * elbow, -needed) * (1.0 - sideways) + needed * sideways
    turn = np.copysign(np.maximum(np.abs(turn), np.arccos(np.minimum(k, 1.0))), turn)
    ahead, lateral, down = off_line * np.cos(turn), off_line * np.sin(turn), upper + lower * np.cos(elbow)
    # Ry(pitch) Rx(roll) takes (ahead, aside, -down) to the point
    share = y / np.hypot(lateral, down)
    roll = np.arcsin(np.minimum(np.maximum(share, -1.0), 1.0)) - np.arctan2(lateral, down)
    pitch = np.arctan2(x, z) - np.arctan2(ahead, lateral * np.sin(roll) - down * np.cos(roll))
    # arms go up in front, not round behind: pitch is between -210 and 150 degrees
    pitch = (pitch - _FARTHEST_BACK_RAD) % (-2 * np.pi) + _FARTHEST_BACK_RAD
    return pitch, side * roll, side * turn, elbow


def help_of_trunk(point: Array, left: bool, hips_up: float, measures: BodyMeasures, person: int, stands: bool) -> Array:
    """Return turn, bend, lean to the right [rad] and lowering of the hips [m], (4,), with which one hand reaches a point.

    point (3,): from the ground under the hips, x ahead, y left [m]; hips_up: height of the hip joints [m]; stands: False for
    a seated person, who does not lower the hips. The least effort of all sufficient candidates; where none suffices, the one
    that brings the hand nearest.
    """
    side = 1.0 if left else -1.0
    one = measures.of_people(np.array([person]))
    leg, scale, arm = one.leg[0], one.scale[0], STRAIGHTEST * one.arm[0]
    drops = _DROPS * leg if stands else np.zeros(1)
    pelvis_now, spine_now = (0.0, 0.0) if stands else (SEATED_PELVIS_RAD, SEATED_SPINE_RAD)
    candidates = np.meshgrid(_TURNS, _BENDS, -side * _LEANS, drops, indexing="ij")
    turn, bend, lean, drop = (axis.ravel() for axis in candidates)
    back = (BACK_PER_BEND_M * scale * np.sin(np.minimum(bend, 0.5 * np.pi)) + BACK_PER_DROP * drop) * stands
    leg_up = hips_up - one.ankle_height[0]
    up = hips_up + (np.sqrt(np.maximum(leg_up**2 - back**2, 0.0)) - leg_up) * stands - drop
    shoulder = np.array([one.shoulder_ahead[0], side * one.shoulder_lateral[0], one.shoulder_up[0]])
    spine = about_z(turn) @ about_y((1 - PELVIS_SHARE) * bend + spine_now) @ about_x(lean)
    above_hips = turned(spine, np.broadcast_to(shoulder, (len(bend), 3))) + np.array([0.0, 0.0, one.waist[0]])
    place = turned(about_y(PELVIS_SHARE * bend + pelvis_now), above_hips) + np.stack(
        [-back, np.zeros_like(back), up], axis=-1
    )
    # a little short of the arm's reach, because the body is not quite at its nominal pose
    short = np.maximum(np.linalg.norm(point - place, axis=-1) - (arm - _SPARE_M), 0.0)
    effort = bend**2 + 0.6 * turn**2 + 1.5 * lean**2 + (3.0 * drop / leg) ** 2
    best = int(np.argmin(effort + 1e3 * short))
    return np.array([turn[best], bend[best], lean[best], drop[best]])
