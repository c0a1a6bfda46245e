"""Static part of a picture: drawn once per camera and kept, so that a picture costs only its moving part.

An opaque picture does not depend on the drawing order: at each pixel the nearest surface shows. So moving geoms are drawn
alone, with the same camera, and drawn over the kept ones where they are at least as near. Every pixel equals that of a
complete drawing.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.sensors.render_scene import RenderView

_MOST_KEPT = 32
"""Greatest number of kept rooms, 8 bytes per pixel each; the least recently used is dropped."""
_EDGE_PX = 1
"""Margin of rectangles around their content, for rounding."""

Rectangle = tuple[int, int, int, int]
"""Column, row, width, height in a buffer [px], rows from the bottom up."""


@dataclass(frozen=True, eq=False)
class StillRoom:
    """Picture of static geoms: `values` (height, width, 4), colours or numbers, None for depth alone, and the depth buffer
    (height, width), 0 at the far plane.
    """

    values: NDArray[np.uint8] | None
    depth: NDArray[np.float32]


@dataclass(eq=False)
class _KeptRoom:
    appearance: bytes
    room: StillRoom | None = None


class StillRooms:
    """Kept rooms of one model, by camera and kind of picture."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, _KeptRoom] = OrderedDict()

    def clear(self) -> None:
        """Drop all rooms."""
        self._kept.clear()

    def find(self, camera: Hashable, appearance: bytes) -> tuple[StillRoom | None, bool]:
        """Return the kept room of a camera, and whether to keep one: when requested again unchanged.

        `appearance`: all that determines the static geoms' look besides the camera, as bytes. Moving cameras and changing
        light are new at every picture: drawing their room separately would cost more.
        """
        kept = self._kept.get(camera)
        if kept is None or kept.appearance != appearance:
            self._kept[camera] = _KeptRoom(appearance)
            self._kept.move_to_end(camera)
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
            return None, False
        self._kept.move_to_end(camera)
        return kept.room, kept.room is None

    def keep(self, camera: Hashable, room: StillRoom) -> StillRoom:
        """Keep the room of a camera last passed to `find`."""
        self._kept[camera].room = room
        return room


def covered_rectangle(
    view: RenderView, eye_m: NDArray[np.float64], middle_m: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> Rectangle:
    """Return a rectangle of the view's pixels that contains spheres, middles (k, 3) and radii (k,) [m]; never too small.

    `eye_m` (3,): the common eye of all views. A sphere within depths z ± r and positions x ± r reaches at most (x + r) / (z
    - r) to the right, and likewise elsewhere.
    """
    first_column, first_row, width, height = view.viewport
    if not len(middle_m):
        return first_column, first_row, 0, 0
    local = (middle_m - eye_m - view.offset_m) @ view.axes.T  # (k, 3): right, up, ahead
    nearest = local[:, 2] - radius_m
    if not (np.isfinite(radius_m).all() and nearest.min() > 0):
        return view.viewport
    farthest = local[:, 2] + radius_m
    low, high = local[:, :2] - radius_m[:, None], local[:, :2] + radius_m[:, None]
    lowest = (low / np.where(low < 0, nearest[:, None], farthest[:, None])).min(axis=0)
    highest = (high / np.where(high > 0, nearest[:, None], farthest[:, None])).max(axis=0)
    origin, size = np.array([view.left, view.bottom]), np.array([width, height])
    scale = size / np.array([view.right - view.left, view.top - view.bottom])  # [px] per unit of tangent
    start = np.clip(np.floor((lowest - origin) * scale) - _EDGE_PX, 0, size).astype(int).tolist()
    end = np.clip(np.ceil((highest - origin) * scale) + _EDGE_PX, 0, size).astype(int).tolist()
    return first_column + start[0], first_row + start[1], max(end[0] - start[0], 0), max(end[1] - start[1], 0)


def lay_over(
    room: StillRoom,
    covered: Sequence[tuple[Rectangle, NDArray[np.uint8] | None, NDArray[np.float32]]],
    values: NDArray[np.uint8] | None,
    depth: NDArray[np.float32] | None,
) -> None:
    """Write the room and the moving geoms before it into `values` (height, width, 4) and `depth` (height, width), if given.

    `covered`: rectangles with values and depth buffer of the moving geoms alone.
    """
    if values is not None and room.values is not None:
        values[:] = room.values
    if depth is not None:
        depth[:] = room.depth
    for (column, row, width, height), moving_values, moving_depth in covered:
        at = np.s_[row : row + height, column : column + width]
        nearer = (moving_depth >= room.depth[at]) & (moving_depth > 0)
        if values is not None and moving_values is not None:
            whole, part = values.view(np.uint32)[..., 0], moving_values.view(np.uint32)[..., 0]
            np.copyto(whole[at], part, where=nearer)
        if depth is not None:
            np.copyto(depth[at], moving_depth, where=nearer)
