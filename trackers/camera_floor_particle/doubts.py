"""Cameras that cannot hang where the rig says: what they show of heads is aside of where all cameras together have them (ours).

Of everybody who walks, each camera's silhouette is searched for the top nearest to the head's estimate, and how far that is from
where the crown should be is remembered; the median counts. Errors of the estimate turn with the walk and cancel out; those of a
camera's pose stay.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.camera_floor_particle.body import CROWN_M
from trackers.camera_floor_particle.people import People
from trackers.camera_floor_particle.views import View, Views

_WALKS_M_S = 0.3
_BENT_M = 0.1
"""Whose head is lower than upright by more than this is left out: what is topmost may not be the head."""
_SEARCHED_M = 0.35
"""So far about a crown its silhouette's top is searched for."""
_TOP_M = 0.12
"""So much of a silhouette, from its top down, is the head whose middle counts."""
_APART_M = 0.7
"""Heads with another so near, as a camera sees them, are left out."""
_REMEMBERED = 160
"""Looks of a camera whose median counts: furniture, or somebody who bends, is beside a head for a while."""
_FEWEST = 40
"""Looks of a camera, two seconds of one walker, that a doubt takes: fewer are off by chance."""
_EVERY = 4
"""So many looks apart the median is worked out."""
_OFF_M = 0.04
"""A camera whose median is farther off than this hangs elsewhere."""


class CameraDoubts:
    """How far off each camera shows heads, by the median, and whom that makes doubtful."""

    def __init__(self, n_camera: int) -> None:
        self.off_m: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))  # to the right, down
        self._looks = np.zeros((n_camera, _REMEMBERED, 2))
        self._n_look = np.zeros(n_camera, np.intp)

    @property
    def doubted(self) -> list[int]:
        """The camera that is farthest off, if that is too far: it draws the estimates, and so the others seem off as well."""
        off = np.linalg.norm(self.off_m, axis=1)
        return np.flatnonzero((off > _OFF_M) & (off == off.max(initial=0.0))).tolist()

    def look(self, people: People, views: Views) -> None:
        """Take in a moment. Two cameras cannot tell which of them is wrong."""
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
            off = _off_px(views[number], pixels[number, row], m_per_px[number, row])
            if off is not None:
                self._take(views[number].number, off * m_per_px[number, row])

    def _take(self, number: int, off_m: Float[Array, "2"]) -> None:
        self._looks[number, self._n_look[number] % _REMEMBERED] = off_m
        count = self._n_look[number] = self._n_look[number] + 1
        if count >= _FEWEST and count % _EVERY == 0:
            self.off_m[number] = np.median(self._looks[number, :count], axis=0)


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
