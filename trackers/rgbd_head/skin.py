"""Which hues and saturations are skin: a region of the HS plane, learned beforehand (section 3.2 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from trackers.arrays import Bytes, Mask

HUES, SATURATIONS = 180, 256
"""Steps of OpenCV's 8-bit hue and saturation."""


@dataclass(frozen=True, eq=False)
class SkinRegion:
    """Which hue (rows, in steps of two degrees) and saturation (columns, of 256) is skin."""

    region: Bool[Mask, "180 256"]

    def shown_in(self, rgb: UInt8[Bytes, "height width 3"]) -> Bool[Mask, "height width"]:
        """Which pixels of a picture are skin-coloured."""
        hue, saturation, _ = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV))
        return self._flat.take(np.asarray(hue, np.int32) * SATURATIONS + np.asarray(saturation, np.int32))

    @cached_property
    def _flat(self) -> Bool[Mask, "m"]:
        return self.region.ravel()
