"""Conversion of a drawing of geom numbers to a camera's image of person ids."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

_FRACTION = 32
"""Fractions of a pixel in cv2's fixed-point tables."""


class PersonPixels:
    """Converter of the numbers drawn by `OffscreenRenderer.render` to id images, by the table that remaps the camera's
    colours.

    `maps`: the camera's table for `cv2.remap`, fixed point, negative outside the lens's field; None if the drawing is the
    picture, its rows from the bottom up. A pixel takes the id of the nearest drawn pixel: ids, unlike colours, are not
    mixed.
    """

    def __init__(self, maps: tuple[NDArray, NDArray] | None) -> None:
        self._maps = maps

    def people(
        self, drawn: NDArray[np.uint8], geom_of_number: NDArray[np.intp], person_of_geom: NDArray[np.int16]
    ) -> NDArray[np.int16]:
        """Return the id image (height, width) in a drawing (rows, columns, 4): 0 the room, -1 outside the field."""
        person_of_number = np.where(geom_of_number >= 0, person_of_geom[geom_of_number], np.int16(0))
        if self._maps is None:
            return person_of_number[_numbers(drawn)[::-1]]
        nearest, outside = self._nearest
        bent = cv2.remap(drawn, nearest, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # pyright: ignore[reportCallIssue, reportArgumentType]
        people = person_of_number[_numbers(bent)]
        people[outside] = -1
        return people

    @cached_property
    def _nearest(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        """Nearest drawn pixel of each of the picture's, (height, width, 2), and a mask of those without one."""
        assert self._maps is not None
        whole, fraction = self._maps
        steps = np.stack([fraction % _FRACTION, fraction // _FRACTION], axis=-1)
        return whole + (steps >= _FRACTION // 2).astype(np.int16), np.any(whole < 0, axis=-1)


def _numbers(drawn: NDArray) -> NDArray[np.integer]:
    """Return red + 256 green + 65536 blue of RGBA pixels, (rows, columns)."""
    return np.ascontiguousarray(drawn).view("<u4")[..., 0] & 0xFFFFFF
