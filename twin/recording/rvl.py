"""RVL, lossless compression of depth pictures, as compressed_depth_image_transport writes it.

Source: Wilson, Fast Lossless Depth Image Compression, ISS 2017. The picture is a row of runs: how many pixels are 0, how many
are not, and of each of these the difference to the one before. Numbers are cut into groups of three bits, the lowest first; a
group and a bit that says that more follow make four bits. Eight of these fill a word of 32 bits, the first highest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError

_MOST_GROUPS = 11
"""A number of 32 bits has no more groups."""


def decode_rvl(data: bytes, rows: int, columns: int) -> NDArray[np.uint16]:
    """Return the picture (rows, columns) in RVL data; raises InputError for data that hold another number of pixels."""
    numbers = _numbers(data)
    zero, values = 0, np.zeros(rows * columns, dtype=np.int64)
    place = 0  # in the picture
    differences, held = [np.empty(0, np.int64)], [np.empty(0, np.intp)]
    while place < values.size:
        if zero + 1 >= numbers.size:
            raise InputError(f"RVL data end after {place} of {values.size} pixels")
        n_empty, n_held = int(numbers[zero]), int(numbers[zero + 1])
        first = place + n_empty
        place = first + n_held
        if place > values.size or zero + 2 + n_held > numbers.size or n_empty + n_held == 0:
            raise InputError(f"RVL data are damaged at pixel {min(first, values.size)} of {values.size}")
        held.append(np.arange(first, place))
        differences.append(numbers[zero + 2 : zero + 2 + n_held])
        zero += 2 + n_held
    zigzag = np.concatenate(differences)
    values[np.concatenate(held)] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1))
    return values.astype(np.uint16).reshape(rows, columns)


def _numbers(data: bytes) -> NDArray[np.int64]:
    """Return all numbers in the data, whatever they mean; those of the padding at the end are 0."""
    words = np.frombuffer(data[: len(data) // 4 * 4], dtype="<u4").astype(">u4").view(np.uint8)
    halves = np.stack([words >> 4, words & 15], axis=-1).ravel()
    last = np.flatnonzero(halves < 8)  # the groups that no other follows
    halves = halves[: last[-1] + 1] if last.size else halves[:0]
    starts = np.concatenate([[0], last[:-1] + 1]) if last.size else np.empty(0, np.intp)
    place = np.arange(halves.size) - np.repeat(starts, np.diff(np.append(starts, halves.size)))
    if place.size and place.max() >= _MOST_GROUPS:
        raise InputError("RVL data are damaged: a number of more than 32 bits")
    groups = (halves & 7).astype(np.int64) << (3 * place)
    return np.add.reduceat(groups, starts) if starts.size else np.empty(0, np.int64)
