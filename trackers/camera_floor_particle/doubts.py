"""Cameras that cannot hang where the rig says: what they show of heads is aside of where all cameras together have them (ours).

Of everybody who walks, each camera's silhouette is searched for the top nearest to the head's estimate, and how far that is from
where the crown should be is averaged. Errors of the estimate turn with the walk and cancel out; those of a camera's pose stay.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.camera_floor_particle.body import CROWN_M
from trackers.camera_floor_particle.people import People
from trackers.camera_floor_particle.views import View, Views

_WALKS_M_S = 0.3
_SEARCHED_M = 0.35
"""So far about a crown its silhouette's top is searched for."""
_TOP_M = 0.12
"""So much of a silhouette, from its top down, is the head whose middle counts."""
_APART_M = 0.7
"""Heads with another so near, as a camera sees them, are left out."""
_REMEMBERED = 80
"""Looks over which the mean goes, exponentially."""
_FEWEST = 25
_OFF_M = 0.05
"""A camera whose mean is farther off than this hangs elsewhere."""


class CameraDoubts:
    """How far off each camera shows heads, on average, and whom that makes doubtful."""

    def __init__(self, n_camera: int) -> None:
        self.off_m: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))  # to the right, down
        self._n_look = np.zeros(n_camera)
        self.doubted: list[int] = []

    def look(self, people: People, views: Views) -> None:
        """Take in a moment. Two cameras cannot tell which of them is wrong."""
        walking = np.flatnonzero((np.hypot(*people.velocity[:, :2].T) > _WALKS_M_S) & ~people.lost)
        if len(views) < 3 or not walking.size:
            return
        crowns = people.head_place.T + np.array([[0.0], [0.0], [CROWN_M]])
        pixels, seen, _ = views.look(crowns)
        for view, at, here in zip(views, pixels, seen, strict=True):
            away_m = np.linalg.norm(crowns.T - view.camera.eye_m, axis=1)
            for row in walking[here[walking]].tolist():
                m_per_px = away_m[row] / view.camera.intrinsics.fx
                others = np.delete(at, row, axis=0)
                if (np.abs(others - at[row]).max(axis=1) * m_per_px < _APART_M).any():
                    continue
                off = _off_px(view, at[row], m_per_px)
                if off is not None:
                    self._take(view.number, off * m_per_px)

    def _take(self, number: int, off_m: Float[Array, "2"]) -> None:
        self._n_look[number] += 1
        share = 1 / min(self._n_look[number], _REMEMBERED)
        self.off_m[number] += share * (off_m - self.off_m[number])
        if self._n_look[number] >= _FEWEST and number not in self.doubted:
            off = np.linalg.norm(self.off_m, axis=1)
            if off[number] > _OFF_M and off[number] == off.max():
                self.doubted.append(number)


def _off_px(view: View, crown: Float[Array, "2"], m_per_px: float) -> Float[Array, "2"] | None:
    """How far the top of the silhouette nearest to a crown is from it [px]; none: there is none, or it goes on above."""
    reach = max(2, round(_SEARCHED_M / m_per_px))
    left, top = (round(each) - reach for each in crown.tolist())
    if left < 0 or top < 0:
        return None
    window = view.mask[top : top + 2 * reach + 1, left : left + 2 * reach + 1]
    rows = np.flatnonzero(window.any(axis=1))
    if not rows.size or rows[0] == 0:
        return None
    columns = window[rows[0] : rows[0] + max(2, round(_TOP_M / m_per_px))].nonzero()[1]
    return np.array([columns.mean() - reach, float(rows[0] - reach)])
