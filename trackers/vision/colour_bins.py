"""Colours of pixels in HSV, their histogram bins, and histograms of many windows from one binned picture.

A picture is binned once; each of hundreds of windows (one per particle of a filter, for example) then costs a look-up and a
count, independent of the number of bins.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, NonNegativeInt, PositiveInt

from trackers.arrays import (
    Array,
    Bool,
    Bytes,
    Float,
    Index,
    Int,
    Integer,
    Mask,
    UInt8,
)
from trackers.configuration import Strict

FULL = 255
HALF_TURNS = 180
"""Number of hue steps, of two degrees."""


class Hsv(NamedTuple):
    """The channels of one picture."""

    hue: UInt8[Bytes, "height width"]
    saturation: UInt8[Bytes, "height width"]
    value: UInt8[Bytes, "height width"]


def hsv_of(rgb: UInt8[Bytes, "height width 3"]) -> Hsv:
    """Convert a picture of red, green and blue."""
    hue, saturation, value = (np.empty(rgb.shape[:2], np.uint8) for _ in Hsv._fields)
    # into preallocated memory: OpenCV's own allocation takes several times as long
    cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV), [hue, saturation, value])
    return Hsv(hue, saturation, value)


Bins = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class BinnedSamples:
    """Bins of k sets of n pixels, `size` for uncounted ones."""

    number: Integer[Bins, "k n"]
    size: int

    def histograms(self) -> Float[Array, "k {self.size}"]:
        """Count each set in each bin."""
        return self.counts()[:, : self.size].astype(float)

    def counts(self) -> Int[Index, "k padded"]:
        """Count as `histograms`, with a last column for uncounted pixels."""
        k = len(self.number)
        row = (self.size + 1) * np.arange(k)[:, None]  # one more bin, for uncounted pixels
        counts = np.bincount(np.add(self.number, row, dtype=np.intp).ravel(), minlength=k * (self.size + 1))
        return counts.reshape(k, self.size + 1)


@dataclass(frozen=True, eq=False)
class BinnedPicture:
    """Bin of each pixel, `size` if uncounted."""

    number: Integer[Bins, "height width"]
    size: int

    def windows(self, centres: ArrayLike, sizes: ArrayLike, samples: tuple[int, int]) -> BinnedSamples:
        """Sample k upright windows around centres (k, 2) [px], of widths and heights (2,) or (k, 2) [px].

        `samples`: evenly spaced columns and rows, at most the window's pixels. Pixels outside the picture, and windows with
        a NaN centre, count in no bin.
        """
        centres, sizes = np.asarray(centres, dtype=float), np.asarray(sizes, dtype=float)
        across, down = (_middles(count)[:, None] for count in samples)
        # numpy is fastest along long rows: all windows' first sample, then all their second
        column = self._within(centres[:, 0] + sizes[..., 0] * across, 1)
        row = self._within(centres[:, 1] + sizes[..., 1] * down, 0) * (self.number.shape[1] + 2)
        index = (column[:, None] + row).reshape(samples[0] * samples[1], len(centres))
        number = self._bordered.take(index, mode="clip")  # nothing to clip, but it spares numpy's check
        return BinnedSamples(np.ascontiguousarray(number.T), self.size)

    def _within(self, coordinates: Float[Array, "k n"], axis: int) -> Int[Index, "k n"]:
        """Return the index in the bordered picture of the pixel at each coordinate; that of the border beyond the edges."""
        place = coordinates + 1.5  # pixel i covers [i − ½, i + ½), and the border comes first
        np.floor(place, out=place)
        np.fmax(place, 0.0, out=place)  # the border for NaN
        np.fmin(place, self.number.shape[axis] + 1, out=place)
        return place.astype(np.intp)

    @cached_property
    def _bordered(self) -> Integer[Bins, "size"]:
        """Bins with an uncounted border of one pixel, size (height + 2) (width + 2); a fast `np.pad`."""
        height, width = self.number.shape
        bordered = np.full((height + 2, width + 2), self.size, self.number.dtype)
        bordered[1:-1, 1:-1] = self.number
        return bordered.ravel()


class HueSaturationValueBins(Strict):
    """Bins of hue and saturation for coloured pixels, and of value alone for the rest.

    The defaults are the 110 bins of Pérez et al. (Color-based probabilistic tracking, ECCV 2002): 10 × 10 for pixels more
    saturated than 0.1 and lighter than 0.07, 10 of value. `value=0` omits the rest: hue and saturation alone, for skin.
    Computed on OpenCV's 8-bit HSV.
    """

    hue: PositiveInt = Field(default=10, le=HALF_TURNS, description="bins of hue")
    saturation: PositiveInt = Field(default=10, le=FULL + 1, description="bins of saturation")
    value: NonNegativeInt = Field(
        default=10, le=FULL + 1, description="bins of value for pixels without colour; 0: these count in none"
    )
    saturation_above: float = Field(default=0.1, ge=0, lt=1, description="a pixel with colour is more saturated")
    value_above: float = Field(default=0.07, ge=0, lt=1, description="a pixel with colour is lighter")

    @property
    def size(self) -> int:
        """Number of bins: hue × saturation in rows of hue, then value."""
        return self.hue * self.saturation + self.value

    def binned(self, hsv: Hsv, mask: Bool[Mask, "height width"] | None = None) -> BinnedPicture:
        """Bin a picture, or only the pixels of a mask, at a cost proportional to their number."""
        if mask is None:
            return BinnedPicture(self._numbers(hsv), self.size)
        there = np.flatnonzero(mask)
        number = np.full(mask.shape, self.size, np.uint8 if self.size <= FULL else np.uint16)
        if there.size:
            number.ravel()[there] = self._numbers(Hsv(*(each.ravel()[there, None] for each in hsv)))[:, 0]
        return BinnedPicture(number, self.size)

    def _numbers(self, hsv: Hsv) -> Integer[Bins, "height width"]:
        """Return the bin of each pixel."""
        hue, saturation, value = hsv
        hue_bin, saturation_bin, value_bin = _bin_tables(self.hue, self.saturation, self.value)
        coloured = cv2.LUT(hue, hue_bin) + cv2.LUT(saturation, saturation_bin)
        has_colour = (saturation > int(FULL * self.saturation_above)) & (value > int(FULL * self.value_above))
        return np.where(has_colour, coloured, cv2.LUT(value, value_bin))


@lru_cache
def _middles(count: int) -> Float[Array, "{count}"]:
    """Return the middles of `count` equal pieces of the interval [−½, ½]."""
    return (np.arange(count) + 0.5) / count - 0.5


@lru_cache
def _bin_tables(hues: int, saturations: int, values: int) -> tuple[NDArray[np.integer], ...]:
    """Return the contributions of each 8-bit hue, saturation, and value of uncoloured pixels to the bin's number."""
    step, size = np.arange(FULL + 1), hues * saturations + values
    kind = np.uint8 if size <= FULL else np.uint16
    grey = step * values // (FULL + 1) + hues * saturations if values else np.full_like(step, size)
    hue = np.minimum(step * hues // HALF_TURNS, hues - 1) * saturations
    return tuple(table.astype(kind) for table in (hue, step * saturations // (FULL + 1), grey))
