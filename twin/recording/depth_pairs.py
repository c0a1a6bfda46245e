"""Colour and depth of one moment come as two messages; here they find each other again."""

from __future__ import annotations

from typing import Any

import numpy as np

from trackers.arrays import Index, Nanoseconds, Singles
from trackers.observations import NS_PER_S, DepthImage, Image

_UNKNOWN_GAP_NS = round(NS_PER_S / 30)
"""For pictures that came once: the period of most devices."""
_HELD = 30


def tolerance_ns(colour_ns: Nanoseconds, depth_ns: Nanoseconds) -> int:
    """How far apart the stamps of a pair may be [ns]: half a period of the slower of the two, by their stamps."""
    gaps = [np.diff(np.unique(each)) for each in (colour_ns, depth_ns)]
    usual = [float(np.median(each)) for each in gaps if each.size]
    return round((max(usual) if usual else _UNKNOWN_GAP_NS) / 2)


def partners(colour_ns: Nanoseconds, depth_ns: Nanoseconds) -> Index:
    """The depth picture that belongs to each colour picture, by their stamps in any order; -1 for none.

    They belong together that are nearest to each other, both ways, within `tolerance_ns`. Many devices stamp the two apart.
    """
    found = np.full(colour_ns.size, -1, np.intp)
    if not colour_ns.size or not depth_ns.size:
        return found
    depth_of, colour_of = _nearest(colour_ns, depth_ns), _nearest(depth_ns, colour_ns)
    colours = np.arange(colour_ns.size)
    mutual = colour_of[depth_of] == colours
    near = np.abs(depth_ns[depth_of] - colour_ns) <= tolerance_ns(colour_ns, depth_ns)
    found[mutual & near] = depth_of[mutual & near]
    return found


def _nearest(of_ns: Nanoseconds, among_ns: Nanoseconds) -> Index:
    """The place of the nearest among the others for each stamp, the earlier of two as near."""
    order = np.argsort(among_ns, kind="stable")
    ordered = among_ns[order]
    right = (
        np.searchsorted(ordered, of_ns).clip(1, max(ordered.size - 1, 1))
        if ordered.size > 1
        else np.zeros(of_ns.size, np.intp)
    )
    left = np.maximum(right - 1, 0)
    right = np.minimum(right, ordered.size - 1)
    return order[np.where(of_ns - ordered[left] <= ordered[right] - of_ns, left, right)]


class DepthPairs:
    """Joins the colour and depth pictures of one sensor as they come, in whatever order; the pair has its colour's stamp.

    A picture whose partner is not among the next 30 that wait is left out.
    """

    def __init__(self, depth_of: Index) -> None:
        self._depth_of = depth_of
        self._colour_of = {int(depth): colour for colour, depth in enumerate(depth_of) if depth >= 0}
        self._colour: dict[int, Image] = {}
        self._depth: dict[int, Singles] = {}
        self.paired = 0

    def colour(self, number: int, image: Image) -> DepthImage | None:
        """Take the colour picture of this number; the pair, when its depth has come already."""
        depth = int(self._depth_of[number])
        if depth < 0:
            return None
        if depth in self._depth:
            return self._pair(image, self._depth.pop(depth))
        self._colour[number] = image
        _hold_few(self._colour)
        return None

    def depth(self, number: int, depth_m: Singles) -> DepthImage | None:
        """Take the depth picture of this number, (height, width) [m]; the pair, when its colour has come already."""
        colour = self._colour_of.get(number)
        if colour is None:
            return None
        if colour in self._colour:
            return self._pair(self._colour.pop(colour), depth_m)
        self._depth[number] = depth_m
        _hold_few(self._depth)
        return None

    def _pair(self, image: Image, depth_m: Singles) -> DepthImage:
        pair = DepthImage(image.sensor, image.stamp_ns, image.rgb, depth_m)
        self.paired += 1
        return pair


def _hold_few(held: dict[int, Any]) -> None:
    while len(held) > _HELD:
        del held[next(iter(held))]
