"""Overlay of postures on standing and walking bodies: pelvis, legs, trunk, arms and head.

Arms reach: their angles bring a hand to a point, with the help of the trunk.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Planar
from twin.people.body.person_spec import ARM, JOINT_PLACE, LEG, SIDES
from twin.people.body.proportions import (
    about_x,
    about_y,
    about_z,
    hip_angles,
    leg_angles,
    matrix_of,
    quaternion_about,
    quaternion_product,
    turned,
)
from twin.people.posture.body_measures import SEATED_PELVIS_RAD, SEATED_SPINE_RAD, BodyMeasures
from twin.people.posture.gaze import NECK_PITCH_MOST_RAD, NECK_YAW_MOST_RAD
from twin.people.posture.posture_rows import (
    ARMS_FLAT,
    ARMS_PITCH,
    BACK,
    DROP,
    FREE_ANGLES,
    HANDS,
    HELD,
    HELD_HIGH,
    LEGS,
    LOOK,
    LOOK_TO,
    NECK_PITCH,
    PELVIS_PITCH,
    PLACE_XY,
    PLACE_YAW,
    PLACE_Z,
    PROP,
    REST,
    SPINE,
    SPINE_YAW,
    active,
    minimum_jerk,
)

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


def help_of_trunk(
    point: Array, left: bool, hips_up: float, measures: BodyMeasures, person: int, stands: bool
) -> tuple[Array, float]:
    """Return turn, bend, lean to the right [rad] and lowering of the hips [m], (4,), with which one hand reaches a point, and
    how much too far that is [m].

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
    return np.array([turn[best], bend[best], lean[best], drop[best]]), float(short[best])


_SIDES = np.array([1.0, -1.0])
_LEG = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in LEG] for side in SIDES])
_ARM = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in ARM] for side in SIDES])
_SPINE = [JOINT_PLACE[name] for name in ("spine_yaw", "spine_pitch", "spine_roll")]
_NECK = [JOINT_PLACE["neck_yaw"], JOINT_PLACE["neck_pitch"]]
_FLAT_ARM = np.array([0.10, 0.20, 0.0, -0.16])  # shoulder pitch, roll (left), yaw, elbow when lying [rad]
_HAND_ON_THIGH = 0.66
_HAND_OVER_M = 0.015


def overlay_postures(qpos: Array, rows: Array, measures: BodyMeasures) -> Array:
    """Overlay postures on joint coordinates; return (n, NQ_PERSON).

    qpos (n, NQ_PERSON): standing or walking, not modified; rows (POSTURE_ROWS, n), see `twin.people.posture.posture_rows`.
    Feet on the floor stay exactly where qpos has them; people without a posture keep their numbers.
    """
    who = active(rows)
    if not len(who):
        return qpos
    out = qpos.copy()
    out[who] = _overlaid(qpos[who], rows[:, who], measures.of_people(who))
    return out


def _overlaid(standing: Array, rows: Array, measures: BodyMeasures) -> Array:
    q = standing.copy()
    stands = matrix_of(standing[:, 3:7])
    pelvis, thighs = stands, None
    if rows[:SPINE_YAW].any() or rows[LEGS:ARMS_FLAT].any():
        feet = [_foot(standing, stands, number, measures) for number in range(2)]
        _move_pelvis(q, stands, feet, rows)
        pelvis = matrix_of(q[:, 3:7])
        thighs = [_place_leg(q, pelvis, feet[number], number, rows, measures) for number in range(2)]
    q[:, _SPINE] += rows[SPINE].T
    trunk, waist = _trunk(q, pelvis, measures)
    for number in range(2):
        _place_arm(q, trunk, waist, None if thighs is None else thighs[number], number, rows, measures)
    q[:, _NECK[1]] += rows[NECK_PITCH]
    _turn_head(q, trunk, rows)
    return q


def _move_pelvis(q: Array, stands: Array, feet: list[tuple[Array, Array]], rows: Array) -> None:
    """Move the pelvis to its held position, then back and down over the feet, and tilt it."""
    q[:, :2], aback, yaw, new_yaw = _over_floor(q[:, :2], stands, rows)
    q[:, 2] = (1 - rows[HELD_HIGH]) * q[:, 2] + rows[PLACE_Z]
    # no leg gets longer as the hips go back: the pelvis comes down for it, not the knees
    up = np.full(len(q), np.inf)
    for ankle, _ in feet:
        gap = q[:, :3] - ankle
        farther = np.sum((gap[:, :2] - aback) ** 2, axis=-1) - np.sum(gap[:, :2] ** 2, axis=-1)
        up = np.minimum(up, ankle[:, 2] + np.sqrt(np.maximum(gap[:, 2] ** 2 - farther, 0.0)))
    q[:, 2] = np.where(rows[BACK] > 0, up, q[:, 2]) - rows[DROP]
    q[:, :2] -= aback
    tilt = quaternion_product(quaternion_about(2, -yaw), q[:, 3:7])
    turn = quaternion_product(quaternion_about(2, new_yaw), quaternion_about(1, rows[PELVIS_PITCH]))
    q[:, 3:7] = quaternion_product(turn, tilt)


def _over_floor(place: Array, stands: Array, rows: Array) -> tuple[Array, Array, Array, Array]:
    """Return where pelvises are held over the floor and how far they are back from there, (m, 2) each [m]; yaw before and then.

    place (m, 2): before [m]; stands (m, 3, 3): room_from_pelvis before.
    """
    yaw = np.arctan2(stands[:, 1, 0], stands[:, 0, 0])
    over, _, faces = rows[HELD]
    new_yaw = (1 - faces) * yaw + rows[PLACE_YAW]
    new_yaw = np.where(faces > 0, new_yaw + faces * 2 * np.pi * _windings(yaw, rows, faces), new_yaw)
    aback = rows[BACK][:, None] * np.stack([np.cos(new_yaw), np.sin(new_yaw)], axis=-1)
    return (1 - over)[:, None] * place + rows[PLACE_XY].T, aback, yaw, new_yaw


def pelvis_over_floor(place: Planar, yaw: Array, rows: Array) -> Planar:
    """Return where postures bring pelvises over the floor, as `overlay_postures` does, x + iy (n,) [m].

    place (n,) and yaw (n,) [rad]: standing or walking.
    """
    stands = matrix_of(quaternion_about(2, yaw))
    held, aback, *_ = _over_floor(np.stack([place.real, place.imag], axis=-1), stands, rows)
    x, y = (held - aback).T
    return x + 1j * y


def _windings(yaw: Array, rows: Array, faces: Array) -> Array:
    """Return the turns to add to the posture's yaw, known only modulo a full turn, to lie next to the body's."""
    held = rows[PLACE_YAW] / np.where(faces > 0, faces, 1.0)
    return np.round((yaw - held) / (2 * np.pi))


def _place_leg(
    q: Array, pelvis: Array, foot: tuple[Array, Array], number: int, rows: Array, measures: BodyMeasures
) -> tuple[Array, Array]:
    """Write one leg's angles; return hip joint (m, 3) and room_from_thigh (m, 3, 3)."""
    hip = q[:, :3] + turned(pelvis, _hip(_SIDES[number], measures))
    ankle, turn = foot
    foot_yaw, foot_pitch = _yaw_pitch(turn)
    yaw = np.arctan2(pelvis[:, 1, 0], pelvis[:, 0, 0])
    gap = hip - ankle
    angles = leg_angles(
        gap[:, 0] + 1j * gap[:, 1], gap[:, 2], yaw, foot_yaw, foot_pitch, measures.thigh, measures.shank
    )
    level = about_z(yaw + angles[0]) @ about_x(angles[1]) @ about_y(angles[2])
    angles = np.stack([*hip_angles(pelvis.transpose(0, 2, 1) @ level), *angles[3:]])
    first = LEGS + number * (1 + FREE_ANGLES)
    free = rows[first]
    angles *= 1 - free
    angles[:FREE_ANGLES] += rows[first + 1 : first + 1 + FREE_ANGLES]
    q[:, _LEG[number, :6]] = angles.T
    q[:, _LEG[number, 6]] *= 1 - free
    thigh = pelvis @ about_z(angles[0]) @ about_x(angles[1]) @ about_y(angles[2])
    return hip, thigh


def _place_arm(
    q: Array,
    trunk: Array,
    waist: Array,
    leg: tuple[Array, Array] | None,
    number: int,
    rows: Array,
    measures: BodyMeasures,
) -> None:
    """Write one arm's angles: hanging, beside the body or on the thigh, then reaching."""
    side = _SIDES[number]
    arm = _ARM[number]
    q[:, arm[0]] += rows[ARMS_PITCH]
    flat = rows[ARMS_FLAT]
    if flat.any():
        adjacent = _FLAT_ARM * np.array([1.0, side, 1.0, 1.0])
        q[:, arm] += flat[:, None] * (adjacent - q[:, arm])
    rest, prop, reach = rows[REST + number], rows[PROP], rows[HANDS + 4 * number]
    if not (rest.any() or prop.any() or reach.any()):
        return
    shoulder = waist + turned(trunk, _shoulder(side, measures))
    into_trunk = trunk.transpose(0, 2, 1)
    if leg is not None and rest.any():
        hip, thigh = leg
        on_thigh = np.zeros((len(q), 3))
        on_thigh[:, 0] = measures.thigh_over + _HAND_OVER_M
        on_thigh[:, 1] = 0.012 * side
        on_thigh[:, 2] = -_HAND_ON_THIGH * measures.thigh
        _blend_arm(q, arm, turned(into_trunk, hip + turned(thigh, on_thigh) - shoulder), side, rest, measures)
    if prop.any():
        yaw = np.arctan2(trunk[:, 1, 1], trunk[:, 0, 1]) - 0.5 * np.pi
        behind = np.stack(
            [*(np.array([[-0.3], [0.28 * side]]) * measures.scale), _HAND_OVER_M - measures.behind], axis=-1
        )
        on_bed = q[:, :3] + turned(about_z(yaw), behind)
        _blend_arm(q, arm, turned(into_trunk, on_bed - shoulder), side, prop, measures)
    if reach.any():
        point = rows[HANDS + 4 * number + 1 : HANDS + 4 * number + 4] / np.where(reach > 0, reach, 1.0)
        _blend_arm(q, arm, turned(into_trunk, point.T - shoulder), side, reach, measures)


def _blend_arm(
    q: Array, arm: NDArray[np.intp], point: Array, side: float, weight: Array, measures: BodyMeasures
) -> None:
    wanted = np.stack(arm_angles(point, side, measures), axis=-1)
    q[:, arm] += weight[:, None] * (wanted - q[:, arm])


def _turn_head(q: Array, trunk: Array, rows: Array) -> None:
    """Turn the head to the gaze as far as the neck goes; the eyes' share is not modelled."""
    weight = rows[LOOK]
    if not weight.any():
        return
    seen = turned(trunk.transpose(0, 2, 1), rows[LOOK_TO].T)
    yaw = np.arctan2(seen[:, 1], seen[:, 0])
    pitch = -np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
    least, most = NECK_PITCH_MOST_RAD
    yaw = np.minimum(np.maximum(yaw, -NECK_YAW_MOST_RAD), NECK_YAW_MOST_RAD)
    q[:, _NECK[0]] += weight * (yaw - q[:, _NECK[0]])
    q[:, _NECK[1]] += weight * (np.minimum(np.maximum(pitch, least), most) - q[:, _NECK[1]])


def _foot(q: Array, pelvis: Array, number: int, measures: BodyMeasures) -> tuple[Array, Array]:
    """Return ankle joint (m, 3) and room_from_foot (m, 3, 3)."""
    yaw, roll, pitch, knee, ankle_pitch, ankle_roll = q[:, _LEG[number, :6]].T
    thigh = pelvis @ about_z(yaw) @ about_x(roll) @ about_y(pitch)
    shank = thigh @ about_y(knee)
    ankle = q[:, :3] + turned(pelvis, _hip(_SIDES[number], measures))
    ankle = ankle + turned(thigh, _down(measures.thigh)) + turned(shank, _down(measures.shank))
    return ankle, shank @ about_y(ankle_pitch) @ about_x(ankle_roll)


def _trunk(q: Array, pelvis: Array, measures: BodyMeasures) -> tuple[Array, Array]:
    """Return room_from_trunk (m, 3, 3) and the bend of the trunk (m, 3)."""
    yaw, pitch, roll = q[:, _SPINE].T
    waist = q[:, :3] + turned(pelvis, -_down(measures.waist))
    return pelvis @ about_z(yaw) @ about_y(pitch) @ about_x(roll), waist


def _yaw_pitch(rotation: Array) -> tuple[Array, Array]:
    sine = np.minimum(np.maximum(-rotation[:, 2, 0], -1.0), 1.0)
    return np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]), np.arcsin(sine)


def _down(length: Array) -> Array:
    zero = np.zeros_like(length)
    return np.stack([zero, zero, -length], axis=-1)


def _hip(side: float, measures: BodyMeasures) -> Array:
    zero = np.zeros_like(measures.hip_lateral)
    return np.stack([zero, side * measures.hip_lateral, zero], axis=-1)


def _shoulder(side: float, measures: BodyMeasures) -> Array:
    return np.stack([measures.shoulder_ahead, side * measures.shoulder_lateral, measures.shoulder_up], axis=-1)
