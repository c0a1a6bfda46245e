"""Calibration monitor: detects a camera whose heads are consistently displaced from the estimates of all cameras (ours).

Each camera's silhouette is searched for the top nearest to an estimated head. The median of its offsets from the projected
crown counts. Errors of estimates change as people move and cancel; those of a camera's pose remain.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.cameras.placed import PlacedCamera

_REMEMBERED = 160
"""Number of offsets per camera in the median: furniture, or a bent person, may be beside a head for a while."""
_EVERY = 4
"""Number of offsets between two medians."""
_TOP_M = 0.12
"""Height of the head at the top of a silhouette, whose middle counts."""


class CalibrationMonitor:
    """Median offset `off` of each camera's heads, to the right and down, in the unit of the offsets given.

    off_from: greatest median of a correct camera. fewest: offsets needed for a warning.
    """

    def __init__(self, n_camera: int, off_from: float, fewest: int) -> None:
        self.off: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))
        self._off_from, self._fewest = off_from, fewest
        self._looks = np.zeros((n_camera, _REMEMBERED, 2))
        self._n_look = np.zeros(n_camera, np.intp)

    @property
    def doubted(self) -> list[int]:
        """Camera with the largest median offset, if too large: it draws the estimates, so the others seem off as well."""
        off = np.linalg.norm(self.off, axis=1)
        return np.flatnonzero((off > self._off_from) & (off == off.max(initial=0.0))).tolist()

    def take(self, number: int, off: Float[Array, "2"]) -> None:
        """Add the offset of a head in a camera."""
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
    """Return the offsets of the tops of silhouettes from projected crowns, to the right and down [px]; NaN without one.

    reach_px: search radius about each crown. Heads with another within `apart_px` have none.
    """
    pixels, seen = camera.project(crowns_m)
    near = (np.abs(pixels[:, None] - pixels).max(axis=2) < apart_px[:, None]).sum(axis=1) > 1  # besides themselves
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

    reach_px: search radius. head_px: height of the head, whose middle counts. None: no silhouette, or one that continues
    above.
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
