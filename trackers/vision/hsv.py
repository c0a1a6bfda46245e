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
    hue, saturation, value = (np.empty(rgb.shape[:2], np.uint8) for _ in Hsv._fields)
    # into memory at hand: what OpenCV hands out itself takes several times as long
    cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV), [hue, saturation, value])
    return Hsv(hue, saturation, value)
