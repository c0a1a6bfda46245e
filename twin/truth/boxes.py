"""From a picture of people's ids to the box of each: truth for detectors."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from twin.instant.snapshot import Snapshot
from twin.truth.frames import Box

OUTSIDE = -1
"""What an id picture holds where the lens sees nothing."""


@runtime_checkable
class SeesPeople(Protocol):
    """A camera that can tell which person each of its pixels shows."""

    def person_image(self, snapshot: Snapshot) -> NDArray[np.int16]:
        """The id of the person at each pixel's centre, 0 for the room, -1 outside the lens's field, (height, width).

        In the pixels of the pictures that it reports, distortion included; sharp and without noise.
        """
        ...


def person_boxes(people: NDArray[np.int16]) -> tuple[Box, ...]:
    """The boxes of all people in an id picture (height, width), in the order of their ids."""
    inside = np.maximum(people, 0)
    count = np.bincount(inside.ravel())
    if len(count) < 2:
        return ()
    cut = set(np.unique(people[_rim(people)]).tolist())
    boxes = []
    for place, slices in enumerate(find_objects(inside), start=1):
        if slices is not None:
            rows, columns = slices
            width, height = columns.stop - columns.start, rows.stop - rows.start
            boxes.append(Box(place, columns.start, rows.start, width, height, int(count[place]), place in cut))
    return tuple(boxes)


def _rim(people: NDArray[np.int16]) -> NDArray[np.bool_]:
    """The pixels at the border of the picture and beside the outside of the lens's field, (height, width)."""
    outside = np.ones((people.shape[0] + 2, people.shape[1] + 2), dtype=np.uint8)
    outside[1:-1, 1:-1] = people == OUTSIDE
    beside = cv2.dilate(outside, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
    return beside[1:-1, 1:-1].astype(np.bool_)
