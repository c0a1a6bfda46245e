"""Packed pictures of a stereo camera, and a plan view of their foreground.

Packed: one number per pixel with all inputs of head likelihoods, for look-ups in many ellipses. Plan view: heads at the tops
of heaps of points, seen from above. After M. Harville, "Stereo person tracking with adaptive plan-view templates of height
and occupancy statistics" (2004): points are counted by the area that each shows, in cells of the floor; the highest of a heap
show the head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from trackers.arrays import AnyArray, Array, Bool, Bytes, Float, Int16, Int32, Mask, Shaped, Singles, UInt8
from trackers.observations import DepthImage
from trackers.rig import StereoSensor
from trackers.vision.front_end import CameraFrontEnd, PreparedPicture
from trackers.vision.head_colours import SkinRegion, colour_numbers
from trackers.vision.head_outlines import Outlines

FOREGROUND, SKIN, IN_PICTURE = 1 << 10, 1 << 11, 1 << 12
_RANGE_BITS = 16
"""First bit of the pixel's range."""
_LEAST_DEPTH = 0.02
"""Least share of pixels with depth in an intact depth picture."""
_EMPTY = 5
"""Number of depth pictures used of the empty room."""
_BEFORE_M = 0.3
"""Distance from the empty room's surface within which a surface belongs to it: the rim of a mask shows the wall behind."""
_EVERY = 4
"""Distance along rows and columns of the pixels searched for unassigned foreground."""
_LONGEST = 32767
"""Greatest number of columns of OpenCV's look-up pictures."""


@dataclass(frozen=True, eq=False)
class PackedPicture:
    """pixels: per pixel the number of its colour, flags for foreground, skin and within the picture, and from `_RANGE_BITS`
    on its range along the ray [mm], 0 if unknown. mask: foreground. knows_depth: False if the depth picture is empty.
    """

    pixels: Int32[AnyArray, "height width"]
    mask: Bool[Mask, "height width"]
    knows_depth: bool

    def at(
        self, columns: Float[Singles, "points n"], rows: Float[Singles, "points n"], out: Int32[AnyArray, "points n"]
    ) -> None:
        """Write the pixels at these columns and rows to `out`; 0 beyond the picture's edges."""
        for first in range(0, columns.shape[1], _LONGEST - 1):
            part = slice(first, first + _LONGEST - 1)
            cv2.remap(self.pixels, columns[:, part], rows[:, part], cv2.INTER_NEAREST, out[:, part], borderValue=0)


class StereoCamera:
    """Packer of one stereo camera's pictures. skin: region of colours to flag; None: none.

    whole: pack the whole picture; else the empty room is used beyond the foreground's box.
    """

    def __init__(
        self, front_end: CameraFrontEnd, sensor: StereoSensor, skin: SkinRegion | None, whole: bool = False
    ) -> None:
        self.front_end, self.camera = front_end, front_end.camera
        self._skin = skin
        per_depth = np.linalg.norm(sensor.intrinsics.directions(), axis=-1).astype(np.float32)
        pictures = [each for each in front_end.empty_room if isinstance(each, DepthImage)]
        self.empty_depth_m, wall_m = _empty_room(pictures)
        self._mm_per_depth = 1000 * per_depth
        self._rays = np.ascontiguousarray(self.camera.pixel_rays[::_EVERY, ::_EVERY])
        self._before_m = np.ascontiguousarray((wall_m * per_depth)[::_EVERY, ::_EVERY]) - _BEFORE_M
        self._empty = None
        if pictures and not whole:
            known = np.where(np.isfinite(wall_m), wall_m, np.float32(0))
            self._empty = self._packed(pictures[-1].rgb, known, np.zeros(known.shape, np.uint8), self._mm_per_depth)

    def pack(self, image: DepthImage) -> PackedPicture | None:
        """Pack a picture; None if it is blind."""
        prepared = self.front_end.prepare(image)
        return None if prepared is None else self.packed(prepared)

    def packed(self, prepared: PreparedPicture[DepthImage]) -> PackedPicture:
        """Pack a prepared picture."""
        image, mask = prepared.image, prepared.mask.view(np.uint8)
        knows_depth = bool((image.depth_m[::_EVERY, ::_EVERY] > 0).mean() >= _LEAST_DEPTH)
        if self._empty is None:
            pixels = self._packed(image.rgb, image.depth_m, mask, self._mm_per_depth)
            return PackedPicture(pixels, prepared.mask, knows_depth)
        # beyond the foreground it is the empty room
        left, top, width, height = cv2.boundingRect(mask)
        box = slice(top, top + height), slice(left, left + width)
        pixels = self._empty.copy()
        if width:
            pixels[box] = self._packed(image.rgb[box], image.depth_m[box], mask[box], self._mm_per_depth[box])
        return PackedPicture(pixels, prepared.mask, knows_depth)

    def _packed(
        self,
        rgb: UInt8[Bytes, "height width 3"],
        depth_m: Float[Singles, "height width"],
        mask: UInt8[Bytes, "height width"],
        mm_per_depth: Float[Singles, "height width"],
    ) -> Int32[AnyArray, "height width"]:
        """Pack a part of a picture as `PackedPicture.pixels` holds it."""
        rgb = np.ascontiguousarray(rgb)
        code = _codes(rgb, mask)
        if self._skin is not None:
            code += self._skin.shown_in(rgb).view(np.uint8) * np.int16(SKIN)
        # rounded, and limited to 16 bits with a sign
        range_mm = np.asarray(cv2.multiply(depth_m, mm_per_depth, dtype=cv2.CV_16S), np.int16)
        pixels = np.left_shift(range_mm, _RANGE_BITS, dtype=np.int32)
        pixels |= code
        return pixels

    def foreground_points(self, picture: PackedPicture) -> Float[Array, "4 k"]:
        """Return positions (x, y, z) [m] of foreground before the empty room's surfaces, and the area of each [m²]."""
        foreground = np.flatnonzero(picture.mask[::_EVERY, ::_EVERY])
        away = range_m(picture.pixels[::_EVERY, ::_EVERY].reshape(-1).take(foreground))
        shown = (away > 0) & (away < self._before_m.reshape(-1).take(foreground))
        away = away[shown]
        places = self._rays.reshape(-1, 3).take(foreground[shown], axis=0).T * away + self.camera.eye_m[:, None]
        pixel = _EVERY**2 / (self.camera.intrinsics.fx * self.camera.intrinsics.fy)
        return np.concatenate([places, [pixel * away**2]]).astype(float)


def packed_without_depth(rgb: UInt8[Bytes, "height width 3"], mask: Bool[Mask, "height width"]) -> PackedPicture:
    """Pack a picture of a camera without depth: colours are looked up where there is foreground alone."""
    pixels = np.full(mask.shape, IN_PICTURE, np.int32)
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    if width:
        box = slice(top, top + height), slice(left, left + width)
        pixels[box] = _codes(np.ascontiguousarray(rgb[box]), mask[box].view(np.uint8))
    return PackedPicture(pixels, mask, knows_depth=False)


def _codes(rgb: UInt8[Bytes, "height width 3"], mask: UInt8[Bytes, "height width"]) -> Int16[AnyArray, "height width"]:
    """Return the number of each pixel's colour, with the flags of the picture and of its foreground."""
    code = colour_numbers(rgb)
    code += np.int16(IN_PICTURE)
    code += mask * np.int16(FOREGROUND)
    return code


def _empty_room(
    pictures: Sequence[DepthImage],
) -> tuple[Float[Singles, "height width"], Float[Singles, "height width"]]:
    """Return the empty room's depth at each pixel, median and greatest [m]; inf where unknown."""
    if not pictures:
        nothing = np.full((1, 1), np.inf, np.float32)
        return nothing, nothing
    depth = np.array([each.depth_m for each in pictures[:_EMPTY]])
    depth = np.sort(np.where(depth > 0, depth, np.float32(np.inf)), axis=0)
    last = np.maximum(np.isfinite(depth).sum(axis=0) - 1, 0)
    median, most = (np.take_along_axis(depth, each[None], axis=0)[0] for each in (last // 2, last))
    return median, most


def pixels_in(
    pictures: Sequence[PackedPicture], ellipses: Outlines, disc: Float[Array, "points 2"]
) -> Int32[AnyArray, "points n"]:
    """Look up each picture's pixels at points of the unit disc in its ellipses, concatenated picture by picture."""
    columns, rows = ellipses.pixels(disc)
    found, n = np.empty(columns.shape, np.int32), columns.shape[1] // len(pictures)
    for number, each in enumerate(pictures):
        own = slice(number * n, number * n + n)
        each.at(columns[:, own], rows[:, own], found[:, own])
    return found


def range_m(pixels: Int32[AnyArray, "*n"]) -> Float[Singles, "*n"]:
    """Return the range of each pixel along its ray [m], 0 where unknown."""
    return (pixels >> _RANGE_BITS) * np.float32(1e-3)


def share_of(pixels: Int32[AnyArray, "k n"], flag: int) -> Float[Singles, "n"]:
    """Return the share of pixels with a flag."""
    return mean_of(pixels & flag) / np.float32(flag)


def mean_of(rows: Shaped[AnyArray, "k n"]) -> Float[Singles, "n"]:
    """Average over the first axis, by a matrix product, which is fastest."""
    return np.full(len(rows), 1 / len(rows), np.float32) @ rows.astype(np.float32, copy=False)


_CELL_M = 0.1
_ABOUT_M = 0.3
"""Points this near to the middle of a heap are one person's."""
_CROWN = 0.93
"""Share of a person's area up to which the crown's level is looked for: what is above is noise of the distances."""
_HEAD_M = 0.25
"""Height of a head with its neck."""
_BELOW_CROWN_M = 0.1
_MOST = 3
"""Greatest number of new heads per frame."""


def heads_in_plan(points: Float[Array, "4 k"], least_m2: float, apart_m: float) -> Float[Array, "m 3"]:
    """Return middles of heads [m] that points (x, y, z [m], area [m²]) of unassigned foreground show.

    least_m2: area of a heap that shows a person [m²]; apart_m: points nearer to a head than this belong to it [m].
    """
    found: list[Array] = []
    for _ in range(_MOST):
        if found:
            points = points[:, np.hypot(*(points[:2] - found[-1][:2, None])) > apart_m]
        if points.shape[1] == 0 or points[3].sum() < least_m2:
            break
        low = points[:2].min(axis=1) - 2 * _CELL_M
        cell = ((points[:2] - low[:, None]) / _CELL_M).astype(np.intp)
        size = cell.max(axis=1) + 3
        heap = np.bincount(cell[0] * size[1] + cell[1], points[3], size.prod()).reshape(size)
        heap = ndimage.uniform_filter(heap, 5, mode="constant") * 25
        top = np.unravel_index(heap.argmax(), heap.shape)
        if heap[top] < least_m2:
            break
        middle = low + (np.array(top) + 0.5) * _CELL_M
        found.append(head_of(points[:, np.hypot(*(points[:2] - middle[:, None])) < _ABOUT_M]))
    return np.array(found).reshape(-1, 3)


def head_of(points: Float[Array, "4 k"]) -> Float[Array, "3"]:
    """Return the middle of a person's head [m] from at least one point (x, y, z [m], area [m²])."""
    x, y, z, area = points
    order = np.argsort(z)
    crown = z[order][np.searchsorted(np.cumsum(area[order]), _CROWN * area.sum())]
    head = z > crown - _HEAD_M
    at = np.average(x[head], weights=area[head]), np.average(y[head], weights=area[head])
    return np.array([*at, crown - _BELOW_CROWN_M])
