"""Closed-form inverse kinematics of a leg: three angles at the hip, one at the knee, two at the ankle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def leg_angles(
    hip: Array, pelvis: Array, ankle: Array, foot_yaw: Array, foot_pitch: Array, thigh: Array, shank: Array
) -> Array:
    """Angles (..., 6) [rad] hip yaw, roll, pitch, knee, ankle pitch, roll, that hold the foot where it is asked.

    hip, ankle: joint centres (..., 3) in the room frame [m]; pelvis: rotation matrix (..., 3, 3) room from pelvis;
    foot_yaw, foot_pitch: the foot is turned by Rz(yaw) Ry(pitch), so pitch > 0 lifts the heel; thigh, shank: segment
    lengths [m]. The knee bends backwards only. A target farther than the straight leg is met in direction only.
    Source: S. Kajita et al., "Introduction to Humanoid Robotics", section 2.5 (analytical solution).
    """
    foot = _rotation_zy(foot_yaw, foot_pitch)
    reach = np.einsum("...ji,...j->...i", foot, hip - ankle)  # hip from ankle, in the foot's frame
    square = np.einsum("...i,...i->...", reach, reach)
    bend = (square - thigh**2 - shank**2) / (2 * thigh * shank)
    knee = np.arccos(np.clip(bend, -1.0, 1.0))
    upright = np.hypot(reach[..., 1], reach[..., 2])
    ankle_roll = np.arctan2(reach[..., 1], reach[..., 2])
    # direction of the hip as the shank sees it, the knee bent
    seen = np.arctan2(-thigh * np.sin(knee), shank + thigh * np.cos(knee))
    ankle_pitch = seen - np.arctan2(reach[..., 0], upright)
    relative = np.einsum("...ji,...jk->...ik", pelvis, foot)
    hip_rotation = relative @ _rotation_xy(-ankle_roll, -(ankle_pitch + knee))
    hip_yaw = np.arctan2(-hip_rotation[..., 0, 1], hip_rotation[..., 1, 1])
    hip_roll = np.arcsin(np.clip(hip_rotation[..., 2, 1], -1.0, 1.0))
    hip_pitch = np.arctan2(-hip_rotation[..., 2, 0], hip_rotation[..., 2, 2])
    return np.stack([hip_yaw, hip_roll, hip_pitch, knee, ankle_pitch, ankle_roll], axis=-1)


def _rotation_zy(yaw: Array, pitch: Array) -> Array:
    """Rz(yaw) Ry(pitch), (..., 3, 3)."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    out = np.zeros((*yaw.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = cy * cp, -sy, cy * sp
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = sy * cp, cy, sy * sp
    out[..., 2, 0], out[..., 2, 2] = -sp, cp
    return out


def _rotation_xy(roll: Array, pitch: Array) -> Array:
    """Rx(roll) Ry(pitch), (..., 3, 3)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    out = np.zeros((*roll.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 2] = cp, sp
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = sr * sp, cr, -sr * cp
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = -cr * sp, sr, cr * cp
    return out
