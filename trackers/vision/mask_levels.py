"""Shares of the cells of windows that a mask fills: averaged over squares of a few sizes once, then one look-up a cell.

The mask is halved again and again and averaged over squares of three by three at each level (the sum-pooled channels of
Dollár et al., "Fast feature pyramids for object detection", 2014, of which the mask is the only one here). A cell is read at
the level whose squares are nearest to its size, so that hundreds of windows of any size cost the same.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from trackers.arrays import AnyArray, Array, Bytes, Mask

_SQUARE = 3
"""Averages go over squares of this side [px of the level]."""
_MOST_LEVELS = 6


def level_of(cell_px: Float[Array, "n"]) -> Int[AnyArray, "n"]:
    """The level whose squares come nearest to cells of this side; of one that is not in the picture (NaN) the finest."""
    wanted = np.log2(np.maximum(np.nan_to_num(cell_px), 1.0) / _SQUARE)
    return np.clip(np.rint(wanted), 0, _MOST_LEVELS - 1).astype(np.intp)


class MaskLevels:
    """Some levels of the masks of one size, one after another in one table, each with a border that is empty."""

    def __init__(self, width: int, height: int, levels: Iterable[int]) -> None:
        self._shape = {level: (max(height >> level, 1), max(width >> level, 1)) for level in sorted(set(levels))}
        lengths = [(rows + 2) * (columns + 2) for rows, columns in self._shape.values()]
        self._start = dict(zip(self._shape, np.cumsum([0, *lengths]).tolist(), strict=False))
        self._length = sum(lengths)

    def index(self, pixels: Float[Array, "n *cells 2"], level: Int[AnyArray, "n"]) -> Int[AnyArray, "n *cells"]:
        """Return the indices in the table of the squares about pixels; outside the picture, or for NaN, on the border."""
        index = np.zeros(pixels.shape[:-1], np.int32)
        for each, (rows, columns) in self._shape.items():
            of = level == each
            place = np.floor(np.nan_to_num(pixels[of] + 0.5, nan=-1.0) / 2**each) + 1
            column, row = np.clip(place[..., 0], 0, columns + 1), np.clip(place[..., 1], 0, rows + 1)
            index[of] = self._start[each] + row * (columns + 2) + column
        return index

    def table(self, mask: Bool[Mask, "height width"]) -> UInt8[Bytes, "size"]:
        """Return the share of each square that a mask fills, 0 to 255."""
        table = np.zeros(self._length, np.uint8)
        plane, level = np.asarray(mask).view(np.uint8) * np.uint8(255), 0
        for each, (rows, columns) in self._shape.items():
            for _ in range(level, each):
                size = (max(plane.shape[1] >> 1, 1), max(plane.shape[0] >> 1, 1))
                plane = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.uint8)
            level = each
            bordered = table[self._start[each] :][: (rows + 2) * (columns + 2)].reshape(rows + 2, columns + 2)
            bordered[1:-1, 1:-1] = cv2.blur(plane, (_SQUARE, _SQUARE), borderType=cv2.BORDER_REPLICATE)
        return table
