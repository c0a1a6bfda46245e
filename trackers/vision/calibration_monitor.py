"""Cameras that cannot hang where the rig says: what they show of heads is aside of where all cameras together have them (ours).

Each camera's silhouette is searched for the top nearest to the estimate of a head; how far that is from where the crown should be
is remembered, and the median counts. Errors of an estimate change as people move and cancel out; those of a camera's pose stay.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask

_REMEMBERED = 160
"""Looks of a camera whose median counts: furniture, or somebody who bends, is beside a head for a while."""
_EVERY = 4
"""So many looks apart the median is worked out."""


class CalibrationMonitor:
    """off: how far off each camera shows heads, by the median, to the right and down, in the unit of the looks handed in.

    off_from: a camera whose median is farther off hangs elsewhere. fewest: looks of a camera that a doubt takes.
    """

    def __init__(self, n_camera: int, off_from: float, fewest: int) -> None:
        self.off: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))
        self._off_from, self._fewest = off_from, fewest
        self._looks = np.zeros((n_camera, _REMEMBERED, 2))
        self._n_look = np.zeros(n_camera, np.intp)

    @property
    def doubted(self) -> list[int]:
        """The camera that is farthest off, if that is too far: it draws the estimates, and so the others seem off as well."""
        off = np.linalg.norm(self.off, axis=1)
        return np.flatnonzero((off > self._off_from) & (off == off.max(initial=0.0))).tolist()

    def take(self, number: int, off: Float[Array, "2"]) -> None:
        """Remember how far off a camera shows a head."""
        self._looks[number, self._n_look[number] % _REMEMBERED] = off
        count = self._n_look[number] = self._n_look[number] + 1
        if count >= self._fewest and (count - self._fewest) % _EVERY == 0:
            self.off[number] = np.median(self._looks[number, :count], axis=0)


def silhouette_top(
    mask: Bool[Mask, "height width"], crown_px: Float[Array, "2"], reach_px: int, head_px: int
) -> Float[Array, "2"] | None:
    """How far the top of the silhouette nearest to a crown is from it, to the right and down [px].

    reach_px: so far about the crown it is searched for. head_px: so much of the silhouette, from its top down, is the head
    whose middle counts. None: there is none, or it goes on above.
    """
    left, top = (round(each) - reach_px for each in crown_px.tolist())
    if left < 0 or top < 0:
        return None
    window = mask[top : top + 2 * reach_px + 1, left : left + 2 * reach_px + 1]
    rows = np.flatnonzero(window.any(axis=1))
    if not rows.size or rows[0] == 0:
        return None
    columns = window[rows[0] : rows[0] + head_px].nonzero()[1]
    return np.array([columns.mean() - reach_px, float(rows[0] - reach_px)])
