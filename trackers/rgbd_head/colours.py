"""Two colours a head: what is face and what is hair or hat, by where on a head each is (ours).

Where on a head skin is seen is the same for most people; which colours skin and hair are is learned for each. A pixel of colour
b at cell c of a head is face with the chance s(c), learned beforehand:

    p(b | c) = s(c) F(b) + (1 − s(c)) H(b)

F and H are histograms of colours, of the person; both begin as what is common among people. Each good look adds its pixels,
each to both by the chance that it is of one or the other (a step of expectation maximisation). As s stays what it is, the
person's colours cannot turn around the head, as a picture of the head would that is updated with itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, Int16, UInt8
from numpy.typing import NDArray
from scipy import ndimage

from trackers.arrays import Array, Bytes, Index, Singles
from trackers.filters.rows import Rows
from trackers.rgbd_head.options import ColourOptions

STEPS = (16, 8, 8)
"""Steps of lightness, red and blue chroma, fine where skin and hair are."""
COLOURS = 1024
"""Numbers of colours."""
SHARES = 8
"""Steps of s, the chance that a cell is face."""
_SHARE = np.clip(np.arange(SHARES) / (SHARES - 1), 0.04, 0.96)[:, None]
_ANYTHING = 0.05
"""Share of pixels that are neither: glasses, eyes, noise, what is behind."""
_BLUR = np.array([0.2, 0.6, 0.2])

_LEVEL = np.arange(256)
_OF_CHANNEL = [
    np.asarray(each, np.int16)
    for each in (
        (_LEVEL >> 4) << 6,
        np.clip((_LEVEL - 112) >> 3, 0, 7) << 3,
        np.clip((_LEVEL - 84) >> 3, 0, 7),
    )
]


def colour_numbers(rgb: UInt8[Bytes, "height width 3"]) -> Int16[NDArray, "height width"]:
    """The number of each pixel's colour, (height, width): by Y, Cr and Cb."""
    channels = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb))
    luma, red, blue = (
        of.take(np.asarray(channel, np.uint8)) for of, channel in zip(_OF_CHANNEL, channels, strict=True)
    )
    luma += red
    luma += blue
    return luma


@dataclass(frozen=True, eq=False)
class HeadColours(Rows):
    """How often each colour was seen as the face and as the hair of n people, beside what is common among people."""

    face: Float[Array, "n colours"]
    hair: Float[Array, "n colours"]

    @classmethod
    def unknown(cls, n: int) -> HeadColours:
        """Of people who have not been seen yet."""
        return cls(np.zeros((n, COLOURS)), np.zeros((n, COLOURS)))

    def shares(
        self, common: Float[Array, "2 colours"], options: ColourOptions
    ) -> tuple[Float[Array, "n colours"], Float[Array, "n colours"]]:
        """F and H."""
        face = _over(self.face, common[0], options.common_pixels)
        return face, _over(self.hair, common[1], options.common_pixels)

    def tables(self, common: Float[Array, "2 colours"], options: ColourOptions) -> Float[Singles, "n entries"]:
        """log(p(b | c) · COLOURS) for every step of s, in rows of colours, one after another: 0 is what noise gets."""
        face, hair = (each[:, None] for each in self.shares(common, options))
        likely = (1 - _ANYTHING) * COLOURS * (_SHARE * face + (1 - _SHARE) * hair) + _ANYTHING
        return np.log(likely).astype(np.float32).reshape(len(self), SHARES * COLOURS)

    def learned(
        self,
        person: Int[Index, "k"],
        share: Int[Index, "k"],
        colour: Int[Index, "k"],
        common: Float[Array, "2 colours"],
        options: ColourOptions,
    ) -> HeadColours:
        """After pixels of these people, at cells of this step of s, of these colours; of old ones a cap is kept."""
        face, hair = self.shares(common, options)
        s = _SHARE[share, 0]
        as_face, as_hair = s * face[person, colour], (1 - s) * hair[person, colour]
        total = as_face + as_hair + _ANYTHING / COLOURS
        entry, size = person * COLOURS + colour, len(self) * COLOURS
        added = [np.bincount(entry, each / total, size).reshape(-1, *STEPS) for each in (as_face, as_hair)]
        for axis in (1, 2, 3):
            added = [ndimage.convolve1d(each, _BLUR, axis=axis) for each in added]
        return HeadColours(
            *(
                _capped(old + new.reshape(-1, COLOURS), options.most_pixels)
                for old, new in zip((self.face, self.hair), added, strict=True)
            )
        )


def _over(
    counts: Float[Array, "n colours"], common: Float[Array, "colours"], pixels: float
) -> Float[Array, "n colours"]:
    return (counts + pixels * common) / (counts.sum(axis=1, keepdims=True) + pixels)


def _capped(counts: Float[Array, "n colours"], most: float) -> Float[Array, "n colours"]:
    return counts * np.minimum(1.0, most / np.maximum(counts.sum(axis=1, keepdims=True), 1e-9))
