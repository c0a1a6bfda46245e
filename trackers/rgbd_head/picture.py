"""One camera's pictures made ready: what of each pixel weighs heads (`trackers.rgbd_head.weighing`), and where strangers are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int32, UInt8

from trackers.area import Area
from trackers.arrays import AnyArray, Array, Bytes, Mask, Singles
from trackers.observations import DepthImage, Observation
from trackers.rgbd_head.colours import colour_numbers
from trackers.rgbd_head.learned import Learned
from trackers.rgbd_head.options import WeightOptions
from trackers.rig import StereoSensor, placed_camera
from trackers.vision.foreground import Foreground, shows_floor
from trackers.vision.steady import SteadyCamera

FOREGROUND, SKIN, INSIDE = 1 << 10, 1 << 11, 1 << 12
_RANGE_BITS = 16
"""From this bit on a pixel says how far away it is."""
_BLIND_FROM = 0.6
"""Share of a picture that is foreground from which it shows no people but a covered lens, or another light."""
_LEAST_DEPTH = 0.02
"""A depth picture with less than this share of its pixels is broken."""
_EMPTY = 5
"""So many depth pictures of the empty room are looked at."""
_BEFORE_M = 0.3
"""What is not so far before the empty room belongs to it: the rim of a mask shows the wall behind."""
_EVERY = 4
"""So many pixels apart, along rows and columns, are those that are asked for newcomers."""
_LONGEST = 32767
"""OpenCV's pictures to look up pixels by have fewer columns."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture made ready. pixels: of each, one number for all that is looked at together.

    The number of its colour, whether it is foreground, skin-coloured, inside at all; and from `_RANGE_BITS` on how far along
    its ray it is [mm], 0 where unknown. mask: the foreground alone. knows_depth: false where the whole depth picture is empty.
    """

    pixels: Int32[AnyArray, "height width"]
    mask: Bool[Mask, "height width"]
    knows_depth: bool

    def at(
        self, columns: Float[Singles, "points n"], rows: Float[Singles, "points n"], out: Int32[AnyArray, "points n"]
    ) -> None:
        """Write the pixels at these columns and rows; 0 beyond the picture's edges."""
        for first in range(
            0, columns.shape[1], _LONGEST - 1
        ):  # of OpenCV's pictures, which the pixels looked at are to it
            part = slice(first, first + _LONGEST - 1)
            cv2.remap(self.pixels, columns[:, part], rows[:, part], cv2.INTER_NEAREST, out[:, part], borderValue=0)


class CameraFrontEnd:
    """One stereo camera with its empty room. Raises InputError for pictures of another size than the rig says."""

    def __init__(
        self,
        sensor: StereoSensor,
        empty_room: Sequence[Observation],
        learned: Learned,
        options: WeightOptions,
        area: Area | None = None,
    ) -> None:
        self.camera = placed_camera(sensor)
        self.learned, self.options = learned, options
        pictures = [each for each in empty_room if isinstance(each, DepthImage)]
        floor = shows_floor(self.camera, area) if options.shadows == "floor" else None
        self.foreground = Foreground(sensor.intrinsics, pictures, options.foreground, floor)
        self._steady = SteadyCamera(pictures, options.gain_from)
        per_depth = np.linalg.norm(sensor.intrinsics.directions(), axis=-1).astype(np.float32)
        self.empty_depth_m, wall_m = _empty_room(pictures)
        self.crown_m = options.semi_axes_m[2]
        self._mm_per_depth = 1000 * per_depth
        self._stranger_rays = np.ascontiguousarray(self.camera.pixel_rays[::_EVERY, ::_EVERY])
        self._before_m = np.ascontiguousarray((wall_m * per_depth)[::_EVERY, ::_EVERY]) - _BEFORE_M
        self._empty = None
        if pictures:
            known = np.where(np.isfinite(wall_m), wall_m, np.float32(0))
            nobody = np.zeros(known.shape, np.uint8)
            self._empty = self._packed(pictures[-1].rgb, known, nobody, self._mm_per_depth)

    def ready(self, image: DepthImage) -> Picture | None:
        """The picture made ready; None where it is blind, as nearly all of it has changed, or frozen."""
        if self._steady.is_frozen(image):
            return None
        image = self._steady.normalize_exposure(image)
        foreground = self.foreground.mask(image)
        mask = foreground.view(np.uint8)
        if cv2.countNonZero(mask) > _BLIND_FROM * mask.size:
            return None
        knows_depth = bool((image.depth_m[::_EVERY, ::_EVERY] > 0).mean() >= _LEAST_DEPTH)
        if self._empty is None:
            return Picture(self._packed(image.rgb, image.depth_m, mask, self._mm_per_depth), foreground, knows_depth)
        # beyond the foreground it is the empty room
        left, top, width, height = cv2.boundingRect(mask)
        box = slice(top, top + height), slice(left, left + width)
        pixels = self._empty.copy()
        if width:
            pixels[box] = self._packed(image.rgb[box], image.depth_m[box], mask[box], self._mm_per_depth[box])
        return Picture(pixels, foreground, knows_depth)

    def _packed(
        self,
        rgb: UInt8[Bytes, "height width 3"],
        depth_m: Float[Singles, "height width"],
        mask: UInt8[Bytes, "height width"],
        mm_per_depth: Float[Singles, "height width"],
    ) -> Int32[AnyArray, "height width"]:
        """A part of a picture as `Picture.pixels` holds it."""
        rgb = np.ascontiguousarray(rgb)
        code = colour_numbers(rgb)
        code += np.int16(INSIDE)
        code += mask * np.int16(FOREGROUND)
        if not self.options.colour.by_person:
            code += self.learned.skin.shown_in(rgb).view(np.uint8) * np.int16(SKIN)
        # rounded, and not more than 16 bits hold with a sign
        range_mm = np.asarray(cv2.multiply(depth_m, mm_per_depth, dtype=cv2.CV_16S), np.int16)
        pixels = np.left_shift(range_mm, _RANGE_BITS, dtype=np.int32)
        pixels |= code
        return pixels

    def pass_over(self, image: DepthImage) -> None:
        """Remember of a picture what later ones are compared with, as `ready` does, and nothing else."""
        if not self._steady.is_frozen(image):
            self.foreground.pass_over(self._steady.normalize_exposure(image))

    def strangers(self, picture: Picture) -> Float[Array, "4 k"]:
        """Places (x, y, z) [m] of pixels of the foreground before the empty room's, and the area that each shows [m²]."""
        foreground = np.flatnonzero(picture.mask[::_EVERY, ::_EVERY])
        away = range_m(picture.pixels[::_EVERY, ::_EVERY].reshape(-1).take(foreground))
        shown = (away > 0) & (away < self._before_m.reshape(-1).take(foreground))
        away = away[shown]
        places = (
            self._stranger_rays.reshape(-1, 3).take(foreground[shown], axis=0).T * away + self.camera.eye_m[:, None]
        )
        pixel = _EVERY**2 / (self.camera.intrinsics.fx * self.camera.intrinsics.fy)
        return np.concatenate([places, [pixel * away**2]]).astype(float)


def _empty_room(
    pictures: Sequence[DepthImage],
) -> tuple[Float[Singles, "height width"], Float[Singles, "height width"]]:
    """How far the empty room is at each pixel along the axis, by the median and at most [m]; inf where no picture knows."""
    if not pictures:
        nothing = np.full((1, 1), np.inf, np.float32)
        return nothing, nothing
    depth = np.array([each.depth_m for each in pictures[:_EMPTY]])
    depth = np.sort(np.where(depth > 0, depth, np.float32(np.inf)), axis=0)
    last = np.maximum(np.isfinite(depth).sum(axis=0) - 1, 0)
    median, most = (np.take_along_axis(depth, each[None], axis=0)[0] for each in (last // 2, last))
    return median, most


def range_m(pixels: Int32[AnyArray, "*n"]) -> Float[Singles, "*n"]:
    """How far along its ray each pixel is [m], 0 where unknown."""
    return (pixels >> _RANGE_BITS) * np.float32(1e-3)
