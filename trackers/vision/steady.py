"""One camera's pictures before anything looks at them: frozen ones are told, and the light is set right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np
from jaxtyping import UInt8

from trackers.arrays import Bytes
from trackers.observations import DepthImage, Image

Kind = TypeVar("Kind", bound=Image | DepthImage)

_EVERY = 16
"""So many pixels apart, along rows and columns, are the samples by which pictures are compared."""
_FROZEN_AFTER = 2
"""So many times the same picture again are not the world's stillness."""
_DARKEST = 0.1
"""What is darker than this share of the empty room is no other light but a covered lens."""


class SteadyCamera:
    """gain_from: a picture lighter or darker than the empty room by more than this share is set right; 0: never."""

    def __init__(self, empty_room: Sequence[Image | DepthImage], gain_from: float) -> None:
        self._brightness = _brightness(empty_room[-1].rgb) if empty_room else None
        self._gain_from = gain_from
        self._last: UInt8[Bytes, "rows columns 3"] | None = None
        self._again = 0

    def is_frozen(self, image: Image | DepthImage) -> bool:
        """Whether the very same picture, as far as samples of it tell, comes for the third time."""
        samples = image.rgb[::_EVERY, ::_EVERY]
        same = self._last is not None and np.array_equal(self._last, samples)
        self._last, self._again = samples, self._again + 1 if same else 0
        return self._again >= _FROZEN_AFTER

    def normalize_exposure(self, image: Kind) -> Kind:
        """The picture as bright as the empty room was, where the light has changed."""
        before, brightness = self._brightness, _brightness(image.rgb)
        if before is None or not self._gain_from or brightness.shape != before.shape:
            return image
        gains = np.sort(brightness / np.maximum(before, 1.0), axis=None)
        gain = float(gains[(gains.size - 1) // 2] + gains[gains.size // 2]) / 2  # np.median, without what it costs
        if abs(gain - 1) <= self._gain_from or gain < _DARKEST:
            return image
        return replace(image, rgb=cv2.convertScaleAbs(image.rgb, alpha=1 / gain).astype(np.uint8))


def _brightness(rgb: UInt8[Bytes, "height width 3"]) -> UInt8[Bytes, "rows columns"]:
    return rgb[::_EVERY, ::_EVERY].max(axis=-1)
