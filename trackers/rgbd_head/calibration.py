"""Whether a camera hangs as the rig says: its empty room against the environment that a scanner saw (ours)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from trackers.arrays import Singles
from trackers.cameras.placed import PlacedCamera
from trackers.environment.model import Environment

TURN_DEG = 5.0
"""A camera that is turned by less is tolerated."""
_BETTER_BY = 0.03
"""A pose fits better where so much more of the points lie at known surfaces; how many do at all depends on noise and room."""
_NEAR_M = 4.0
"""Distances from here on say little."""
_EVERY = 4


def is_turned(camera: PlacedCamera, depth_m: Float[Singles, "height width"], environment: Environment) -> bool:
    """Whether the camera's depth of the empty room fits the environment better when it is turned about one of its axes."""
    known = (depth_m > 0) & (depth_m < _NEAR_M)
    points = camera.points(np.where(known, depth_m, np.float32(0)))[::_EVERY, ::_EVERY].reshape(-1, 3)
    off = points[np.isfinite(points).all(axis=1)] - camera.eye_m
    if not len(off):
        return False
    turns = np.radians(TURN_DEG) * np.concatenate([camera.rotation.T, -camera.rotation.T])
    turned = max(environment.agreement(turn.apply(off) + camera.eye_m) for turn in Rotation.from_rotvec(turns))
    return turned > environment.agreement(off + camera.eye_m) + _BETTER_BY
