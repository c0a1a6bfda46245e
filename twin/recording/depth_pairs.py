"""Colour and depth of one moment come as two messages; here they find each other again."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S, DepthImage, Image

TOLERANCE_NS = round(0.016 * NS_PER_S)
"""Stamps that differ by no more belong together: half a period at 30 Hz. Many devices stamp the two apart."""

_HELD = 30


class DepthPairs:
    """Joins the colour and depth pictures of one sensor, in whatever order they come.

    A picture is joined with the one of the other kind whose stamp is nearest, within `TOLERANCE_NS`; the pair has
    the stamp of its colour. One that finds none within the next 30 of its kind is left out.
    """

    def __init__(self) -> None:
        self._colour: deque[Image] = deque(maxlen=_HELD)
        self._depth: deque[tuple[int, NDArray[np.float32]]] = deque(maxlen=_HELD)

    def colour(self, image: Image) -> DepthImage | None:
        """Take a colour picture; the pair, when its depth has come already."""
        place = _nearest([stamp_ns for stamp_ns, _ in self._depth], image.stamp_ns)
        if place is None:
            self._colour.append(image)
            return None
        _, depth_m = self._depth[place]
        del self._depth[place]
        return DepthImage(image.sensor, image.stamp_ns, image.rgb, depth_m)

    def depth(self, stamp_ns: int, depth_m: NDArray[np.float32]) -> DepthImage | None:
        """Take a depth picture (height, width) [m]; the pair, when its colour has come already."""
        place = _nearest([image.stamp_ns for image in self._colour], stamp_ns)
        if place is None:
            self._depth.append((stamp_ns, depth_m))
            return None
        image = self._colour[place]
        del self._colour[place]
        return DepthImage(image.sensor, image.stamp_ns, image.rgb, depth_m)


def _nearest(stamps_ns: list[int], stamp_ns: int) -> int | None:
    """The place of the stamp nearest to this one, None where none is near enough."""
    away, place = min(((abs(each - stamp_ns), place) for place, each in enumerate(stamps_ns)), default=(None, None))
    return place if away is not None and away <= TOLERANCE_NS else None
