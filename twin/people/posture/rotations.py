"""Rotations of many bodies at a time, and the angles of a body's joints that make them."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array


def _about(angle: Array, first: int, second: int) -> Array:
    out = np.zeros((*angle.shape, 3, 3))
    cosine, sine = np.cos(angle), np.sin(angle)
    fixed = 3 - first - second
    out[..., fixed, fixed] = 1.0
    out[..., first, first] = out[..., second, second] = cosine
    out[..., second, first], out[..., first, second] = sine, -sine
    return out


def about_x(angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about x by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 1, 2)


def about_y(angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about y by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 2, 0)


def about_z(angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about z by angles (...) [rad]."""
    return _about(np.asarray(angle, dtype=float), 0, 1)


def turned(rotation: Array, vector: Array) -> Array:
    """Vectors (..., 3) turned by rotations (..., 3, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def matrix_of(quaternion: Array) -> Array:
    """Rotation matrices (m, 3, 3) of unit quaternions (m, 4), w first."""
    w, x, y, z = quaternion.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def quaternion_about(axis: int, angle: Array) -> Array:
    """Quaternions (m, 4), w first, of rotations about x (0), y (1) or z (2) by angles (m,) [rad]."""
    out = np.zeros((len(angle), 4))
    out[:, 0], out[:, 1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return out


def quaternion_product(first: Array, second: Array) -> Array:
    """Hamilton products (m, 4): the second rotation, then the first."""
    a, b, c, d = first.T
    e, f, g, h = second.T
    return np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )


def hip_angles(rotation: Array) -> tuple[Array, Array, Array]:
    """Yaw, roll, pitch [rad] of Rz Rx Ry (..., 3, 3): the thigh as the pelvis sees it."""
    roll = np.arcsin(np.minimum(np.maximum(rotation[..., 2, 1], -1.0), 1.0))
    pitch = np.arctan2(-rotation[..., 2, 0], rotation[..., 2, 2])
    return np.arctan2(-rotation[..., 0, 1], rotation[..., 1, 1]), roll, pitch


def direction(yaw: Array, pitch: Array) -> Array:
    """Unit vectors (..., 3) along x turned by Rz(yaw) Ry(pitch): a positive pitch points down."""
    return np.stack([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1)
