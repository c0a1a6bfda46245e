"""Overlay of postures on standing and walking bodies: pelvis, legs, trunk, arms and head."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.body.kinematics import (
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
from twin.people.body.person_spec import ARM, JOINT_PLACE, LEG, SIDES
from twin.people.posture.body_measures import BodyMeasures
from twin.people.posture.gaze import NECK_PITCH_MOST_RAD, NECK_YAW_MOST_RAD
from twin.people.posture.posture_rows import (
    ARMS_FLAT,
    ARMS_PITCH,
    BACK,
    DROP,
    FREE_ANGLES,
    HANDS,
    HELD,
    LEGS,
    LOOK,
    LOOK_TO,
    NECK_PITCH,
    PELVIS_PITCH,
    PLACE_X,
    PLACE_Y,
    PLACE_YAW,
    PLACE_Z,
    PROP,
    REST,
    SPINE,
    SPINE_YAW,
    active,
)
from twin.people.posture.reach import arm_angles

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
    yaw = np.arctan2(stands[:, 1, 0], stands[:, 0, 0])
    over, high, faces = rows[HELD]
    new_yaw = (1 - faces) * yaw + rows[PLACE_YAW]
    new_yaw = np.where(faces > 0, new_yaw + faces * 2 * np.pi * _windings(yaw, rows, faces), new_yaw)
    q[:, 0] = (1 - over) * q[:, 0] + rows[PLACE_X]
    q[:, 1] = (1 - over) * q[:, 1] + rows[PLACE_Y]
    q[:, 2] = (1 - high) * q[:, 2] + rows[PLACE_Z]
    # no leg gets longer as the hips go back: the pelvis comes down for it, not the knees
    back = rows[BACK]
    aback = np.stack([back * np.cos(new_yaw), back * np.sin(new_yaw)], axis=-1)
    up = np.full(len(q), np.inf)
    for ankle, _ in feet:
        gap = q[:, :3] - ankle
        farther = np.sum((gap[:, :2] - aback) ** 2, axis=-1) - np.sum(gap[:, :2] ** 2, axis=-1)
        up = np.minimum(up, ankle[:, 2] + np.sqrt(np.maximum(gap[:, 2] ** 2 - farther, 0.0)))
    q[:, 2] = np.where(back > 0, up, q[:, 2]) - rows[DROP]
    q[:, :2] -= aback
    tilt = quaternion_product(quaternion_about(2, -yaw), q[:, 3:7])
    turn = quaternion_product(quaternion_about(2, new_yaw), quaternion_about(1, rows[PELVIS_PITCH]))
    q[:, 3:7] = quaternion_product(turn, tilt)


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
