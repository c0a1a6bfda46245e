"""Learned model of heads: the colours of skin, its position on a head, and the colours of face and hair.

Shipped as `heads.npz`; `scripts/learn-heads` learns it from the twin alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from trackers.array_files import ArraySpec, read_arrays
from trackers.arrays import Array, Bytes, Index, Mask
from trackers.errors import InputError
from trackers.text_file import AnyPath
from trackers.vision.head_colours import COLOURS, SHARES
from trackers.vision.head_outlines import CELLS

HUES, SATURATIONS = 180, 256
"""Steps of OpenCV's 8-bit hue and saturation."""
SHIPPED = Path(__file__).with_name("heads.npz")
_ARRAYS = {
    "skin": ArraySpec("b", (HUES, SATURATIONS)),
    "share": ArraySpec("f", (CELLS[0] * CELLS[1],), 0, 1),
    "common": ArraySpec("f", (2, COLOURS), 0, 1),
}


@dataclass(frozen=True, eq=False)
class SkinRegion:
    """Hues (rows, in steps of two degrees) and saturations (columns, of 256) of skin (Suzuki et al., section 3.2).

    darkest: least value of a pixel.
    """

    region: Bool[Mask, "180 256"]
    darkest: int = 0

    @classmethod
    def box(cls, hues: tuple[int, int], saturations: tuple[int, int], darkest: int) -> SkinRegion:
        """Make the region between two hues and two saturations, both included, of at least this value."""
        region = np.zeros((HUES, SATURATIONS), np.bool_)
        region[hues[0] : hues[1] + 1, saturations[0] : saturations[1] + 1] = True
        return cls(region, darkest)

    def shown_in(self, rgb: UInt8[Bytes, "height width 3"]) -> Bool[Mask, "height width"]:
        """Return the mask of a picture's pixels in the colour of skin."""
        hue, saturation, value = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV))
        shown = self._flat.take(np.asarray(hue, np.int32) * SATURATIONS + np.asarray(saturation, np.int32))
        return shown if not self.darkest else shown & (np.asarray(value) >= self.darkest)

    @cached_property
    def _flat(self) -> Bool[Mask, "m"]:
        return self.region.ravel()


LIT_SKIN = SkinRegion.box((2, 17), (50, 165), 100)
"""Skin in the light: reddish to orange, neither grey nor garish, brighter than hair."""


@dataclass(frozen=True, eq=False)
class HeadModel:
    """skin: region of hue and saturation. share: s of each cell. common: distribution of colours of faces, and of hair."""

    skin: SkinRegion
    share: Float[Array, "cells"]
    common: Float[Array, "2 colours"]

    @cached_property
    def share_steps(self) -> Int[Index, "cells"]:
        """Step of s of each cell."""
        return np.rint(self.share * (SHARES - 1)).astype(np.intp)


@lru_cache(maxsize=4)
def load_head_model(path: AnyPath = SHIPPED) -> HeadModel:
    """Read a model; raises InputError for a file that is missing, damaged or of something else."""
    arrays = read_arrays(path, _ARRAYS, "a file that scripts/learn-heads wrote")
    sums = arrays["common"].sum(axis=1, dtype=float)
    if not np.allclose(sums, 1, atol=1e-3):
        raise InputError(f"{path}: common has rows that sum to {sums}; shares that sum to 1 are expected")
    return HeadModel(SkinRegion(arrays["skin"]), arrays["share"].astype(float), arrays["common"].astype(float))
