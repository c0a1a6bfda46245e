"""A body's pose in few numbers that may be interpolated, and the joint coordinates that follow from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.people.body import JOINT_PLACE, LEG, NECK, NQ_PERSON, SIDES, SPINE
from twin.people.legs import leg_angles
from twin.people.proportions import Proportions

Array = NDArray[np.float64]

# Columns of a pose (n, POSE_SIZE). Angles are unwrapped, so that every column may be interpolated linearly.
PELVIS = slice(0, 3)  # x, y, z, room frame [m]
PELVIS_YAW = 3
PELVIS_ROLL = 4
SPINE_ANGLES = slice(5, 8)
NECK_ANGLES = slice(8, 10)
SHOULDER_PITCH = slice(10, 12)  # left, right
ELBOW = slice(12, 14)
VELOCITY = slice(14, 16)  # of the ground point under the pelvis [m/s]
HEADING = 16  # where the person faces [rad]
FEET = slice(17, 27)  # left, then right: x, y, height, pitch, yaw
POSE_SIZE = 27

_SHOULDER_ROLL_RAD = 0.10
_LEGS = np.array([[JOINT_PLACE[f"{side}_{joint}"] for joint in LEG] for side in SIDES])  # (2, 7)
_SPINE = [JOINT_PLACE[name] for name in SPINE]
_NECK = [JOINT_PLACE[name] for name in NECK]
_SHOULDER_PITCH = [JOINT_PLACE[f"{side}_shoulder_pitch"] for side in SIDES]
_SHOULDER_ROLL = [JOINT_PLACE[f"{side}_shoulder_roll"] for side in SIDES]
_ELBOW = [JOINT_PLACE[f"{side}_elbow"] for side in SIDES]


class Skeleton:
    """The segment lengths of n people [m], as arrays."""

    def __init__(self, proportions: Sequence[Proportions]) -> None:
        def column(name: str) -> Array:
            return np.array([getattr(person, name) for person in proportions], dtype=float)

        self.ankle_height = column("ankle_height")  # (n,)
        self.hip_height = column("hip_height")
        self.thigh = column("thigh")
        self.shank = column("shank")
        self.heel = column("heel_behind_ankle")
        self.ball = column("ball_before_ankle")
        half = column("hip_joint_width") / 2
        self.hip_offset = half[:, None] * np.array([1.0, -1.0])  # (n, 2) to the left of the pelvis
        self.leg = self.thigh + self.shank


def ankles(feet: Array, skeleton: Skeleton) -> Array:
    """Ankle joints (n, 2, 3) [m] of feet (n, 2, 5): x, y, height, pitch, yaw.

    x, y, height place the sole's point under the ankle as if the foot were flat. A foot with its heel up (pitch > 0)
    turns about the ball, one with its toes up about the heel, so that a standing foot's pivot stays where it is.
    """
    pitch, yaw = feet[..., 3], feet[..., 4]
    pivot = np.where(pitch > 0, skeleton.ball[:, None], -skeleton.heel[:, None])
    height = skeleton.ankle_height[:, None]
    cosine, sine = np.cos(pitch), np.sin(pitch)
    ahead = pivot * (1 - cosine) + height * sine
    out = np.empty((*feet.shape[:2], 3))
    out[..., 0] = feet[..., 0] + ahead * np.cos(yaw)
    out[..., 1] = feet[..., 1] + ahead * np.sin(yaw)
    out[..., 2] = feet[..., 2] + pivot * sine + height * cosine
    return out


def pelvis_rotation(yaw: Array, roll: Array) -> Array:
    """Rz(yaw) Rx(roll), (n, 3, 3)."""
    cy, sy, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(roll), np.sin(roll)
    out = np.zeros((len(yaw), 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = cy, -sy * cr, sy * sr
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = sy, cy * cr, -cy * sr
    out[:, 2, 1], out[:, 2, 2] = sr, cr
    return out


def joint_coordinates(pose: Array, skeleton: Skeleton) -> Array:
    """`qpos` (n, NQ_PERSON) of each person from poses (n, POSE_SIZE)."""
    count = len(pose)
    feet = pose[:, FEET].reshape(count, 2, 5)
    yaw, roll = pose[:, PELVIS_YAW], pose[:, PELVIS_ROLL]
    rotation = pelvis_rotation(yaw, roll)
    hips = pose[:, None, PELVIS] + skeleton.hip_offset[..., None] * rotation[:, None, :, 1]
    legs = leg_angles(
        hips,
        np.broadcast_to(rotation[:, None], (count, 2, 3, 3)),
        ankles(feet, skeleton),
        feet[..., 4],
        feet[..., 3],
        skeleton.thigh[:, None],
        skeleton.shank[:, None],
    )
    out = np.zeros((count, NQ_PERSON))
    out[:, 0:3] = pose[:, PELVIS]
    half_yaw, half_roll = yaw / 2, roll / 2
    out[:, 3] = np.cos(half_yaw) * np.cos(half_roll)
    out[:, 4] = np.cos(half_yaw) * np.sin(half_roll)
    out[:, 5] = np.sin(half_yaw) * np.sin(half_roll)
    out[:, 6] = np.sin(half_yaw) * np.cos(half_roll)
    out[:, _SPINE] = pose[:, SPINE_ANGLES]
    out[:, _NECK] = pose[:, NECK_ANGLES]
    out[:, _SHOULDER_PITCH] = pose[:, SHOULDER_PITCH]
    out[:, _SHOULDER_ROLL] = (_SHOULDER_ROLL_RAD, -_SHOULDER_ROLL_RAD)
    out[:, _ELBOW] = pose[:, ELBOW]
    out[:, _LEGS[:, :6]] = legs
    # the toes stay level while the heel is up
    out[:, _LEGS[:, 6]] = -np.maximum(feet[..., 3], 0.0)
    return out
