"""Closed-form inverse kinematics of legs: three angles at the hip, one at the knee, two at the ankle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array

Planar = NDArray[np.complex128]


def leg_angles(
    over_floor: Planar, up: Array, pelvis_yaw: Array, foot_yaw: Array, foot_pitch: Array, thigh: Array, shank: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Hip yaw, roll, pitch, knee, ankle pitch, roll [rad] that hold each foot where it is asked.

    over_floor, up: from ankle to hip joint, x + iy and z in the room frame [m]; the pelvis is turned by
    Rz(pelvis_yaw), the foot by Rz(foot_yaw) Ry(foot_pitch), so pitch > 0 lifts the heel; thigh, shank [m]. Any shapes
    that broadcast. The knee bends backwards only. A hip farther than the straight leg is met in direction only. Source:
    S. Kajita et al., "Introduction to Humanoid Robotics", section 2.5 (analytical solution).
    """
    # the hip as the foot sees it: turned by -yaw, then -pitch
    seen = over_floor * np.exp(-1j * foot_yaw)
    cosine, sine = np.cos(foot_pitch), np.sin(foot_pitch)
    x, y, z = cosine * seen.real - sine * up, seen.imag, sine * seen.real + cosine * up
    square = x * x + y * y + z * z
    bend = (square - thigh**2 - shank**2) / (2 * thigh * shank)
    knee = np.arccos(np.minimum(np.maximum(bend, -1.0), 1.0))
    ankle_roll = np.arctan2(y, z)
    # where the hip is for the shank, the knee bent so
    toward_hip = np.arctan2(-thigh * np.sin(knee), shank + thigh * np.cos(knee))
    ankle_pitch = toward_hip - np.arctan2(x, np.hypot(y, z))
    # what is left for the hip: Rz(turn) Ry(foot pitch) Rx(-ankle roll) Ry(-(ankle pitch + knee)) = Rz Rx Ry
    turn = foot_yaw - pelvis_yaw
    c1, s1 = np.cos(turn), np.sin(turn)
    c4, s4 = np.cos(ankle_roll), np.sin(ankle_roll)
    below = ankle_pitch + knee
    c5, s5 = np.cos(below), np.sin(below)
    # Ry(foot pitch) Rx(-ankle roll): its second column, and the last entry of its third
    mid_x, mid_y, mid_z = -sine * s4, c4, -cosine * s4
    last_z = cosine * c4
    hip_yaw = np.arctan2(-(c1 * mid_x - s1 * mid_y), s1 * mid_x + c1 * mid_y)
    hip_roll = np.arcsin(np.minimum(np.maximum(mid_z, -1.0), 1.0))
    # bottom row of the product with Ry(-below): first and third entry
    first = -sine * c5 + last_z * s5
    third = sine * s5 + last_z * c5
    hip_pitch = np.arctan2(-first, third)
    return hip_yaw, hip_roll, hip_pitch, knee, ankle_pitch, ankle_roll
