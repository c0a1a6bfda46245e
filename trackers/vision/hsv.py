"""Hue, saturation and value of pictures, as OpenCV has them in 8 bits."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from trackers.arrays import Bytes

FULL = 255
HALF_TURNS = 180
"""Hue counts in steps of two degrees."""


class Hsv(NamedTuple):
    """The channels of one picture."""

    hue: UInt8[Bytes, "height width"]
    saturation: UInt8[Bytes, "height width"]
    value: UInt8[Bytes, "height width"]


def hsv_of(rgb: UInt8[Bytes, "height width 3"]) -> Hsv:
    """Those of a picture of red, green and blue."""
    return Hsv(*(np.asarray(each, np.uint8) for each in cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV))))
