"""Calibration monitor: a camera that shows heads elsewhere than all cameras together have them hangs elsewhere (ours).

Each camera's silhouette is searched for the top nearest to the estimate of a head. Its offset from the projected crown is
remembered, and the median counts. Errors of an estimate change as people move and cancel out; those of a camera's pose stay.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera

_REMEMBERED = 160
"""Looks of a camera whose median counts: furniture, or a person who bends, is beside a head for a while."""
_EVERY = 4
"""So many looks apart the median is worked out."""
_TOP_M = 0.12
"""Height of a silhouette, from its top down, whose middle counts: a head."""


class CalibrationMonitor:
    """off: median offset at which each camera shows heads, to the right and down, in the unit of the offsets handed in.

    off_from: a camera of a larger median hangs elsewhere. fewest: looks of a camera that a warning takes.
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
        """Remember the offset at which a camera shows a head."""
        self._looks[number, self._n_look[number] % _REMEMBERED] = off
        count = self._n_look[number] = self._n_look[number] + 1
        if count >= self._fewest and (count - self._fewest) % _EVERY == 0:
            self.off[number] = np.median(self._looks[number, :count], axis=0)


def silhouette_offsets(
    camera: PlacedCamera,
    mask: Bool[Mask, "height width"],
    crowns_m: Float[Array, "n 3"],
    reach_px: Float[Array, "n"],
    apart_px: Float[Array, "n"],
) -> Float[Array, "n 2"]:
    """Return the offsets of the tops of silhouettes from projected crowns, to the right and down [px]; NaN where there is none.

    reach_px: each crown's silhouette is searched for so far about it. Heads with another within `apart_px` have none.
    """
    pixels, seen = camera.project(crowns_m)
    near = (np.abs(pixels[:, None] - pixels).max(axis=2) < apart_px[:, None]).sum(axis=1) > 1  # than themselves
    top_px = _TOP_M * camera.intrinsics.fx / np.linalg.norm(crowns_m - camera.eye_m, axis=1)
    found = np.full((len(crowns_m), 2), np.nan)
    for row in np.flatnonzero(seen & ~near):  # at most a few people
        off = _silhouette_top(mask, pixels[row], int(reach_px[row]), max(2, round(float(top_px[row]))))
        if off is not None:
            found[row] = off
    return found


def _silhouette_top(
    mask: Bool[Mask, "height width"], crown_px: Float[Array, "2"], reach_px: int, head_px: int
) -> Float[Array, "2"] | None:
    """Return the offset of the top of the silhouette nearest to a crown, to the right and down [px].

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
