"""Whether a camera hangs as the rig says: its empty room against the environment that a scanner saw (ours)."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from trackers.arrays import Singles
from trackers.cameras.placed import PlacedCamera
from trackers.environment.model import Environment

TURNS_DEG = (5.0, 9.0)
"""A camera whose empty room fits better after one of these turns than after none or a tolerated one hangs otherwise."""
_TOLERATED_DEG = 2.0
_NEAR_M = 4.0
"""Distances from here on say little."""
_WITHIN_M = 0.1
"""Points so near to a known surface are at it."""
_EVERY = 8
_AXES = np.array([axis for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)], float)
"""The cube's: of the picture, and between them, both ways round."""


def is_turned(camera: PlacedCamera, depth_m: Float[Singles, "height width"], environment: Environment) -> bool:
    """Whether the camera's depth of the empty room fits the environment best when it is turned by more than is tolerated."""
    known = (depth_m > 0) & (depth_m < _NEAR_M)
    points = camera.points(np.where(known, depth_m, np.float32(0)))[::_EVERY, ::_EVERY].reshape(-1, 3)
    off = points[np.isfinite(points).all(axis=1)] - camera.eye_m
    if not len(off):
        return False
    axes = _AXES / np.linalg.norm(_AXES, axis=1, keepdims=True) @ camera.rotation.T

    def agreement(turn_deg: float) -> float:
        turns = Rotation.from_rotvec(np.radians(turn_deg) * (axes if turn_deg else axes[:1]))
        return max(environment.agreement(turn.apply(off) + camera.eye_m, _WITHIN_M) for turn in turns)

    return max(map(agreement, TURNS_DEG)) > max(agreement(0.0), agreement(_TOLERATED_DEG))
