"""Two colour distributions per head: of face and of hair or hat, separated by position on the head (ours).

The position of skin on a head is similar for most people; the colours of skin and hair are learned per person. A pixel of
colour b at cell c of a head is face with probability s(c), learned beforehand:

    p(b | c) = s(c) F(b) + (1 − s(c)) H(b)

F and H are the person's histograms of colours, initially those common among people. Each good observation adds its pixels to
both, weighted by the probability of each (a step of expectation maximisation). As s is fixed, the colours cannot drift
around the head, unlike a head image updated with itself.

The model learned beforehand holds the colours of skin, its position on a head, and the colours of face and hair. It is
shipped as `heads.npz`; `scripts/learn-heads` learns it from the twin alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from trackers.arrays import AnyArray, Array, Bool, Bytes, Float, Index, Int, Int16, Mask, Singles, UInt8
from trackers.errors import InputError
from trackers.filters.rows import Rows
from trackers.user_input.array_files import ArraySpec, read_arrays
from trackers.user_input.text_file import AnyPath
from trackers.vision.head_outlines import CELLS

STEPS = (16, 8, 8)
"""Steps of lightness, red and blue chroma, fine in the range of skin and hair."""
COLOURS = 1024
"""Number of colours."""
SHARES = 8
"""Number of steps of s, the probability that a cell is face."""
_SHARE = np.clip(np.arange(SHARES) / (SHARES - 1), 0.04, 0.96)[:, None]
_ANYTHING = 0.05
"""Share of outlier pixels: glasses, eyes, noise, background."""
COMMON_PIXELS = 60.0
"""Weight of the common histogram, in pixels of the person's own."""
_MOST_PIXELS = 3000.0
"""Greatest number of remembered pixels of a person, of face and of hair."""


def _blur(steps: int) -> Float[Array, "m m"]:
    """Return the smoothing matrix over `steps` steps, whose ends repeat the outermost."""
    blur = 0.6 * np.eye(steps) + 0.2 * (np.eye(steps, k=1) + np.eye(steps, k=-1))
    blur[[0, -1], [0, -1]] += 0.2
    return blur


_BLUR_LUMA, _BLUR_CHROMA = _blur(STEPS[0]), np.kron(_blur(STEPS[1]), _blur(STEPS[2]))


@lru_cache(maxsize=1)
def _numbers() -> Int16[AnyArray, "65536"]:
    """Return the number of every 16-bit colour (5, 6 and 5), by the middle of its cell."""
    every = np.arange(1 << 16, dtype=np.uint16).view(np.uint8).reshape(256, 256, 2)
    rgb = cv2.cvtColor(every, cv2.COLOR_BGR5652RGB) + np.array([4, 2, 4], np.uint8)
    luma, red, blue = np.moveaxis(cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb).astype(np.int16), -1, 0)
    return (((luma >> 4) << 6) + (((red - 112) >> 3).clip(0, 7) << 3) + ((blue - 84) >> 3).clip(0, 7)).ravel()


def colour_numbers(rgb: UInt8[Bytes, "height width 3"]) -> Int16[AnyArray, "height width"]:
    """Return the number of each pixel's colour: by Y, Cr and Cb, of the first 5 or 6 bits of red, green and blue."""
    code = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR565), np.uint8).view(np.uint16)[..., 0]
    return np.asarray(cv2.LUT(code, _numbers()), np.int16)


@dataclass(frozen=True, eq=False)
class HeadColours(Rows):
    """Counts of each colour in the face and the hair of n people, beyond the common histogram."""

    face: Float[Array, "n colours"]
    hair: Float[Array, "n colours"]

    @classmethod
    def unknown(cls, n: int) -> HeadColours:
        """Make the colours of people not seen yet."""
        return cls(np.zeros((n, COLOURS)), np.zeros((n, COLOURS)))

    def shares(self, common: Float[Array, "2 colours"]) -> tuple[Float[Array, "n colours"], Float[Array, "n colours"]]:
        """Return F and H."""
        return _over(self.face, common[0], COMMON_PIXELS), _over(self.hair, common[1], COMMON_PIXELS)

    def expected(self, common: Float[Array, "2 colours"]) -> ExpectedColours:
        """Return the same in single precision, as sent to cameras."""
        return ExpectedColours(*(each.astype(np.float32) for each in self.shares(common)))

    def forgotten(self, those: Bool[Mask, "n"]) -> HeadColours:
        """Return the colours without what was learned of those marked."""
        keeps = ~those[:, None]
        return HeadColours(self.face * keeps, self.hair * keeps) if those.any() else self

    def learned(
        self,
        person: Int[Index, "k"],
        share: Int[Index, "k"],
        colour: Int[Index, "k"],
        common: Float[Array, "2 colours"],
    ) -> HeadColours:
        """Learn pixels of these people, at cells of this step of s, of these colours; the weight of old pixels is capped."""
        face, hair = self.shares(common)
        s = _SHARE[share, 0]
        as_face, as_hair = s * face[person, colour], (1 - s) * hair[person, colour]
        total = as_face + as_hair + _ANYTHING / COLOURS
        entry, size = person * COLOURS + colour, len(self) * COLOURS
        added = [
            _BLUR_LUMA
            @ np.bincount(entry, each / total, size).reshape(-1, STEPS[0], STEPS[1] * STEPS[2])
            @ _BLUR_CHROMA
            for each in (as_face, as_hair)
        ]
        return HeadColours(
            *(
                _capped(old + new.reshape(-1, COLOURS), _MOST_PIXELS)
                for old, new in zip((self.face, self.hair), added, strict=True)
            )
        )


@dataclass(frozen=True, eq=False)
class ExpectedColours:
    """F and H of n people, as sent to the cameras that weigh heads."""

    face: Float[Singles, "n colours"]
    hair: Float[Singles, "n colours"]

    @cached_property
    def tables(self) -> Float[Singles, "n entries"]:
        """log(p(b | c) · COLOURS) for every step of s, flattened rows of colours; noise has 0."""
        share = ((1 - _ANYTHING) * COLOURS * _SHARE).astype(np.float32)
        likely = share * (self.face - self.hair)[:, None]
        likely += np.float32((1 - _ANYTHING) * COLOURS) * self.hair[:, None] + np.float32(_ANYTHING)
        return np.log(likely, out=likely).reshape(len(self.face), SHARES * COLOURS)


def _over(
    counts: Float[Array, "n colours"], common: Float[Array, "colours"], pixels: float
) -> Float[Array, "n colours"]:
    return (counts + pixels * common) / (counts.sum(axis=1, keepdims=True) + pixels)


def _capped(counts: Float[Array, "n colours"], most: float) -> Float[Array, "n colours"]:
    return counts * np.minimum(1.0, most / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9))


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
