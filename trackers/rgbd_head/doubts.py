"""What tells of a camera that it cannot hang where the rig says: its silhouettes of heads (`trackers.vision.camera_doubts`)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.vision.camera_doubts import silhouette_top

OFF_RAD = np.radians(3.5)
"""A camera whose median look is farther off than this hangs elsewhere: one that is turned by 5°, and not by 1° or 2°."""
FEWEST = 10
"""Looks of a camera that a doubt takes."""
_SEARCHED_RAD = np.radians(10)
"""So far about a crown its silhouette's top is searched for; heads with another so near, as a camera sees them, are left out."""
_TOP_M = 0.12
"""So much of a silhouette, from its top down, is the head whose middle counts."""


def asides(
    camera: PlacedCamera, mask: Bool[Mask, "height width"], heads: Float[Array, "4 n"], up_m: float
) -> Float[Array, "n 2"]:
    """How far the tops of silhouettes are to the right of heads' crowns, and below them [rad]; NaN where there is none.

    up_m: how high above their middles heads go.
    """
    crowns = heads[:3].T + np.array([0.0, 0.0, up_m])
    pixels, seen = camera.project(crowns)
    fx = camera.intrinsics.fx
    reach = round(fx * np.tan(_SEARCHED_RAD))
    near = (np.abs(pixels[:, None] - pixels).max(axis=2) < reach).sum(axis=1) > 1  # than themselves
    top_px = _TOP_M * fx / np.linalg.norm(crowns - camera.eye_m, axis=1)
    found = np.full((len(crowns), 2), np.nan)
    for row in np.flatnonzero(seen & ~near):  # at most a few people
        off = silhouette_top(mask, pixels[row], reach, max(2, round(top_px[row])))
        if off is not None:
            found[row] = off / fx
    return found
