"""Check of calibration by the silhouettes of walkers: a camera that shows them elsewhere does not hang as the rig says."""

from __future__ import annotations

import numpy as np

from trackers.camera_floor_particle.body import CROWN_M
from trackers.camera_floor_particle.people import People
from trackers.vision.calibration_monitor import CalibrationMonitor, silhouette_offsets
from trackers.vision.views import Views

_OFF_M = 0.04
"""A camera whose median offset is larger hangs elsewhere."""
_FEWEST = 40
"""Looks of a camera, two seconds of one walker, that a warning takes: fewer are off by chance."""
_WALKS_M_S = 0.3
_BENT_M = 0.1
"""Heads lower than upright by more than this are left out: what is topmost may not be the head."""
_SEARCHED_M = 0.35
"""Reach about a crown in which its silhouette's top is searched for."""
_APART_M = 0.7
"""Heads with another so near, as a camera sees them, are left out."""


def monitor(n_camera: int) -> CalibrationMonitor:
    """Make the monitor of so many cameras, whose offsets are in metres."""
    return CalibrationMonitor(n_camera, _OFF_M, _FEWEST)


def take(calibration: CalibrationMonitor, people: People, views: Views) -> None:
    """Take in the offsets of one frame. Of two cameras it cannot be told which is wrong."""
    upright = people.head_place[:, 2] > people.height_m - CROWN_M - _BENT_M
    walking = upright & (np.hypot(*people.velocity[:, :2].T) > _WALKS_M_S) & ~people.lost
    if len(views) < 3 or not walking.any():
        return
    crowns = people.head_place + np.array([0.0, 0.0, CROWN_M])
    for view in views:
        m_per_px = np.linalg.norm(crowns - view.camera.eye_m, axis=1) / view.camera.intrinsics.fx
        reach_px = np.maximum(2, np.rint(_SEARCHED_M / m_per_px))
        off_px = silhouette_offsets(view.camera, view.mask, crowns, reach_px, _APART_M / m_per_px)
        for off_m in (off_px * m_per_px[:, None])[walking & np.isfinite(off_px[:, 0])]:
            calibration.take(view.number, off_m)
