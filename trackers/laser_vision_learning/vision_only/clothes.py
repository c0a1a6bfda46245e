"""The colours of people at places of the floor: a histogram of the upper and one of the lower half of each."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from trackers.arrays import Array, Bytes, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.vision.histogram import ColourHistogram, HistogramOptions
from trackers.vision.person_windows import largest_overlap, person_windows

_ROWS, _COLUMNS = 14, 8
_BODY = (slice(None), slice(2, 12), slice(2, 6))
"""Cells of a window that show shirt (the upper half of them) and trousers, without arms and what is beside."""
_HALF = (5, 4)
_LEAST_SEEN = 0.25
"""Of the samples of each half so many must be foreground."""


class Clothes:
    """Looks at the colours of people in the pictures of one camera; a look is `size` numbers that sum to 1."""

    def __init__(self, camera: PlacedCamera, options: HistogramOptions) -> None:
        self._camera, self._histogram = camera, ColourHistogram(options)
        self.size = 2 * self._histogram.size

    def looks(
        self, rgb: UInt8[Bytes, "h w 3"], mask: Mask, places_m: Float[Array, "k 2"]
    ) -> tuple[Float[Array, "k bins"], Bool[Mask, "k"], Float[Array, "k"]]:
        """Colours at places [m], whether enough of them is seen, and how much of each window another covers."""
        windows = person_windows(self._camera, places_m, _ROWS, _COLUMNS)
        shown, k = windows.inside.copy(), len(places_m)
        at = np.rint(windows.pixels[shown]).astype(np.intp)
        shown[shown] = mask[at[:, 1], at[:, 0]]
        pixels, inside = windows.pixels[_BODY].reshape(2 * k, *_HALF, 2), shown[_BODY].reshape(2 * k, *_HALF)
        colours = self._histogram.of_windows(rgb, pixels, inside).reshape(k, self.size)
        known = (inside.mean(axis=(1, 2)) >= _LEAST_SEEN).reshape(k, 2).all(axis=1)
        return 0.5 * colours, known, largest_overlap(windows.pixels[:, :, 2:6])
