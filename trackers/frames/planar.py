"""Poses in the plane: arrays (*n, 3) of x, y [m] and yaw [rad], composed like transforms."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array

HERE = np.zeros(3)
"""The pose that changes nothing."""


def compose(first: Float[Array, "*n 3"], second: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose `second`, given in the frame of `first`, in the frame that `first` is given in; yaw is not wrapped."""
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = second[..., 0], second[..., 1]
    return np.stack(
        [first[..., 0] + cos * x - sin * y, first[..., 1] + sin * x + cos * y, first[..., 2] + second[..., 2]], axis=-1
    )


def inverse(pose: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose that takes this one back."""
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = pose[..., 0], pose[..., 1]
    return np.stack([-cos * x - sin * y, sin * x - cos * y, -pose[..., 2]], axis=-1)


def between(first: Float[Array, "*n 3"], second: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Return the pose `second` in the frame of `first`, its yaw within half a turn."""
    moved = compose(inverse(first), second)
    moved[..., 2] = (moved[..., 2] + np.pi) % (2 * np.pi) - np.pi
    return moved


def placed(pose: Float[Array, "*n 3"], points: Float[Array, "*n 2"]) -> Float[Array, "*m 2"]:
    """Return points (n, 2) of the frame of a pose, one for all or one each, in the frame that it is given in [m]."""
    return pose[..., :2] + turned(pose[..., 2], points)


def turned(yaw: Float[Array, "*n"] | float, vectors: Float[Array, "*n 2"]) -> Float[Array, "*m 2"]:
    """Return vectors (n, 2) turned by a yaw [rad], one for all or one each."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def planar(transform: Float[Array, "4 4"]) -> Float[Array, "3"]:
    """Return the part of a rigid transform (4, 4) that lies in the plane: x, y [m] and the yaw of its x axis [rad]."""
    return np.array([transform[0, 3], transform[1, 3], np.arctan2(transform[1, 0], transform[0, 0])])
