"""What tells of a camera that it cannot hang where the rig says: the silhouettes of walkers."""

from __future__ import annotations

import numpy as np

from trackers.camera_floor_particle.body import CROWN_M
from trackers.camera_floor_particle.people import People
from trackers.camera_floor_particle.views import Views
from trackers.vision.calibration_monitor import CalibrationMonitor, silhouette_top

OFF_M = 0.04
"""A camera whose median look is farther off than this hangs elsewhere."""
FEWEST = 40
"""Looks of a camera, two seconds of one walker, that a doubt takes: fewer are off by chance."""
_WALKS_M_S = 0.3
_BENT_M = 0.1
"""Whose head is lower than upright by more than this is left out: what is topmost may not be the head."""
_SEARCHED_M = 0.35
"""So far about a crown its silhouette's top is searched for."""
_TOP_M = 0.12
"""So much of a silhouette, from its top down, is the head whose middle counts."""
_APART_M = 0.7
"""Heads with another so near, as a camera sees them, are left out."""


def look(doubts: CalibrationMonitor, people: People, views: Views) -> None:
    """Take in a moment, in metres. Two cameras cannot tell which of them is wrong."""
    upright = people.head_place[:, 2] > people.height_m - CROWN_M - _BENT_M
    walking = upright & (np.hypot(*people.velocity[:, :2].T) > _WALKS_M_S) & ~people.lost
    if len(views) < 3 or not walking.any():
        return
    crowns = people.head_place.T + np.array([[0.0], [0.0], [CROWN_M]])
    pixels, seen, _ = views.look(crowns)
    fx = np.array([[view.camera.intrinsics.fx] for view in views])
    m_per_px = np.linalg.norm(crowns.T - views.eyes_m[:, None], axis=2) / fx  # (cameras, n)
    apart = np.abs(pixels[:, :, None] - pixels[:, None]).max(axis=3) * m_per_px[..., None]
    near = (apart < _APART_M).sum(axis=2) > 1  # than themselves
    for number, row in np.argwhere(seen & walking & ~near).tolist():
        view, size = views[number], m_per_px[number, row]
        reach, head = max(2, round(_SEARCHED_M / size)), max(2, round(_TOP_M / size))
        off = silhouette_top(view.mask, pixels[number, row], reach, head)
        if off is not None:
            doubts.take(view.number, off * size)
