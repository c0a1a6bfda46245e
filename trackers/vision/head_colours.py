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
from functools import cached_property, lru_cache

import cv2
import numpy as np
from jaxtyping import Float, Int, Int16, UInt8

from trackers.arrays import AnyArray, Array, Bytes, Index, Singles
from trackers.filters.rows import Rows

STEPS = (16, 8, 8)
"""Steps of lightness, red and blue chroma, fine where skin and hair are."""
COLOURS = 1024
"""Numbers of colours."""
SHARES = 8
"""Steps of s, the chance that a cell is face."""
_SHARE = np.clip(np.arange(SHARES) / (SHARES - 1), 0.04, 0.96)[:, None]
_ANYTHING = 0.05
"""Share of pixels that are neither: glasses, eyes, noise, what is behind."""
COMMON_PIXELS = 60.0
"""Pixels of a person's own for which counts what is common among people."""
_MOST_PIXELS = 3000.0
"""Pixels of a person that are remembered, of face and of hair."""


def _blur(steps: int) -> Float[Array, "m m"]:
    """Return the shares that each of so many steps takes of its neighbours; beyond the last one it is the last one."""
    blur = 0.6 * np.eye(steps) + 0.2 * (np.eye(steps, k=1) + np.eye(steps, k=-1))
    blur[[0, -1], [0, -1]] += 0.2
    return blur


_BLUR_LUMA, _BLUR_CHROMA = _blur(STEPS[0]), np.kron(_blur(STEPS[1]), _blur(STEPS[2]))


@lru_cache(maxsize=1)
def _numbers() -> Int16[AnyArray, "65536"]:
    """Return the number of every colour of 16 bits (5, 6 and 5), by the middle of its cell."""
    every = np.arange(1 << 16, dtype=np.uint16).view(np.uint8).reshape(256, 256, 2)
    rgb = cv2.cvtColor(every, cv2.COLOR_BGR5652RGB) + np.array([4, 2, 4], np.uint8)
    luma, red, blue = np.moveaxis(cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb).astype(np.int16), -1, 0)
    return (((luma >> 4) << 6) + (((red - 112) >> 3).clip(0, 7) << 3) + ((blue - 84) >> 3).clip(0, 7)).ravel()


def colour_numbers(rgb: UInt8[Bytes, "height width 3"]) -> Int16[AnyArray, "height width"]:
    """Return the number of each pixel's colour: by Y, Cr and Cb, of the first 5 or 6 bits of red, green and blue."""
    return _numbers().take(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR565).view(np.uint16)[..., 0])


@dataclass(frozen=True, eq=False)
class HeadColours(Rows):
    """Counts of each colour as the face and as the hair of n people, beside what is common among people."""

    face: Float[Array, "n colours"]
    hair: Float[Array, "n colours"]

    @classmethod
    def unknown(cls, n: int) -> HeadColours:
        """Make the colours of people who have not been seen yet."""
        return cls(np.zeros((n, COLOURS)), np.zeros((n, COLOURS)))

    def shares(self, common: Float[Array, "2 colours"]) -> tuple[Float[Array, "n colours"], Float[Array, "n colours"]]:
        """Return F and H."""
        return _over(self.face, common[0], COMMON_PIXELS), _over(self.hair, common[1], COMMON_PIXELS)

    def expected(self, common: Float[Array, "2 colours"]) -> ExpectedColours:
        """Return the same in single precision, as it travels to cameras."""
        return ExpectedColours(*(each.astype(np.float32) for each in self.shares(common)))

    def learned(
        self,
        person: Int[Index, "k"],
        share: Int[Index, "k"],
        colour: Int[Index, "k"],
        common: Float[Array, "2 colours"],
    ) -> HeadColours:
        """Learn pixels of these people, at cells of this step of s, of these colours; of old ones a cap is kept."""
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
    """F and H of n people, as they travel to the cameras that weigh heads."""

    face: Float[Singles, "n colours"]
    hair: Float[Singles, "n colours"]

    @cached_property
    def tables(self) -> Float[Singles, "n entries"]:
        """log(p(b | c) · COLOURS) for every step of s, in rows of colours, one after another; noise has 0."""
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
