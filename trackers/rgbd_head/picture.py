"""One camera's part (the paper's client): a picture made ready, and the weights that it gives heads.

The weights are a pure function of heads at the picture's stamp, the picture, what is known of each person's colours, and the
options: the same wherever it is worked out. All weights are logarithms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float16, Int, Int32, Shaped, UInt8
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array, Bytes, Index, Mask, Singles
from trackers.observations import DepthImage, Observation
from trackers.rgbd_head.colours import COLOURS, SHARES, colour_numbers
from trackers.rgbd_head.learned import Learned
from trackers.rgbd_head.options import WeightOptions
from trackers.rgbd_head.outline import ASPECTS, Outlines, cells_shown, inner_points, outlines, ring_points
from trackers.rig import StereoSensor, placed_camera
from trackers.vision.foreground import Foreground, shows_floor
from trackers.vision.steady import SteadyCamera

_FOREGROUND, _SKIN, _INSIDE = 1 << 10, 1 << 11, 1 << 12
_RANGE_BITS = 16
"""From this bit on a pixel says how far away it is."""
_BLIND_FROM = 0.6
"""Share of a picture that is foreground from which it shows no people but a covered lens, or another light."""
_LEAST_DEPTH = 0.02
"""A depth picture with less than this share of its pixels is broken."""
_NOTHING = 1e-3
"""A linear weight (eq. 5, 7) is never less: a floor of 0 would let one blocked camera kill a right hypothesis."""
_EMPTY = 5
"""So many depth pictures of the empty room are looked at."""
_LOOKED_AT = 64
"""Points looked at in the ellipse at the expected place of a head."""
_NEAR_M = 0.2
"""A pixel this far from the middle of a head may still be on it: noise and hair."""
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

    pixels: Int32[NDArray, "height width"]
    mask: Bool[Mask, "height width"]
    knows_depth: bool

    def at(self, seen_as: Outlines, disc: Float[Array, "k 2"]) -> Int32[NDArray, "k n"]:
        """The pixels at points of the unit disc in each ellipse; 0 beyond the picture's edges."""
        columns, rows = seen_as.pixels(disc)
        shape = columns.shape
        if shape[1] >= _LONGEST:  # of OpenCV's pictures, which the pixels looked at are to it
            parts = [slice(k, k + _LONGEST - 1) for k in range(0, shape[1], _LONGEST - 1)]
            return np.concatenate([self._nearest(columns[:, part], rows[:, part]) for part in parts], axis=1)
        return self._nearest(columns, rows)

    def _nearest(self, columns: Float[Singles, "k n"], rows: Float[Singles, "k n"]) -> Int32[NDArray, "k n"]:
        return np.asarray(cv2.remap(self.pixels, columns, rows, cv2.INTER_NEAREST, borderValue=0), np.int32)


@dataclass(frozen=True, eq=False)
class Weights:
    """The logarithms of a picture's two weights of n heads, and which it shows; those it does not show get 0.

    shown: share of foreground in the ellipse times that of background over it: near 1 where a head is.
    """

    colour: Float[Singles, "n"]
    depth: Float[Singles, "n"]
    shown: Float16[NDArray, "n"]  # it travels, and is precise enough
    seen: Bool[Mask, "n"]


class Watcher:
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
        self._learned, self._options = learned, options
        pictures = [each for each in empty_room if isinstance(each, DepthImage)]
        floor = shows_floor(self.camera, area) if options.shadows == "floor" else None
        self.foreground = Foreground(sensor.intrinsics, pictures, options.foreground, floor)
        self._steady = SteadyCamera(pictures, options.gain_from)
        per_depth = np.linalg.norm(sensor.intrinsics.directions(), axis=-1).astype(np.float32)
        self.empty_depth_m, wall_m = _empty_room(pictures)
        self.crown_m = options.semi_axes_m[2]
        self._wall_m = wall_m * per_depth
        self._mm_per_depth = 1000 * per_depth
        self._empty = None
        if pictures:
            known = np.where(np.isfinite(wall_m), wall_m, np.float32(0))
            nobody = np.zeros(known.shape, np.uint8)
            self._empty = self._packed(pictures[-1].rgb, known, nobody, self._mm_per_depth)

    def ready(self, image: DepthImage) -> Picture | None:
        """The picture made ready; None where it is blind, as nearly all of it has changed, or frozen."""
        if self._steady.is_frozen(image):
            return None
        image = self._steady.set_right(image)
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
    ) -> Int32[NDArray, "height width"]:
        """A part of a picture as `Picture.pixels` holds it."""
        rgb = np.ascontiguousarray(rgb)
        code = colour_numbers(rgb)
        code += np.int16(_INSIDE)
        code += mask * np.int16(_FOREGROUND)
        if not self._options.colour.by_person:
            code += self._learned.skin.shown_in(rgb).view(np.uint8) * np.int16(_SKIN)
        # rounded, and not more than 16 bits hold with a sign
        range_mm = np.asarray(cv2.multiply(depth_m, mm_per_depth, dtype=cv2.CV_16S), np.int16)
        pixels = np.left_shift(range_mm, _RANGE_BITS, dtype=np.int32)
        pixels |= code
        return pixels

    def pass_over(self, image: DepthImage) -> None:
        """Remember of a picture what later ones are compared with, as `ready` does, and nothing else."""
        if not self._steady.is_frozen(image):
            self.foreground.pass_over(self._steady.set_right(image))

    def weights(
        self, picture: Picture, heads: Float[Singles, "4 n p"], tables: Float[Singles, "n entries"] | None
    ) -> Weights:
        """The weights of p heads (x, y, z [m], yaw [rad] at the picture's stamp) of each of n people, n · p in a row.

        tables: how likely each colour is at each step of s (`ExpectedColours.tables`); None: the paper's share of skin.
        """
        options = self._options
        n, p = heads.shape[1:]
        seen_as = outlines(self.camera, heads.reshape(4, n * p), options.semi_axes_m)
        inner = inner_points(options.points)
        ring = ring_points(options.silhouette.ring_points, options.silhouette.ring)
        pixels = picture.at(seen_as, np.concatenate([inner, ring]))
        pixels, around = pixels[: len(inner)], pixels[len(inner) :]
        colour = np.zeros(n * p, np.float32)
        if options.colour.used and tables is not None:
            entry = pixels & (COLOURS - 1)
            entry += self._steps_shown.take(seen_as.aspects(), axis=1)
            entry.reshape(-1, n, p)[...] += np.arange(0, tables.size, SHARES * COLOURS, dtype=np.int32)[:, None]
            colour += np.float32(options.colour.power) * _mean(tables.ravel().take(entry))
        elif options.colour.used:
            n_inside = np.maximum(_share(pixels, _INSIDE), np.float32(1 / len(inner)))
            skin = _share(pixels, _SKIN) / n_inside
            colour += _linear(np.abs(skin - expected_share(seen_as.facing, options)), options.colour.linear)
        # the share of foreground in each ellipse, and of background in a half ring over it (ours)
        filled, free = _share(pixels, _FOREGROUND), 1 - _share(around, _FOREGROUND)
        if options.silhouette.power:
            floor = np.float32(options.silhouette.floor)
            both = np.maximum(filled, floor) * np.maximum(free, floor)
            colour += np.float32(options.silhouette.power) * np.log(both)
        depth = np.zeros(n * p, np.float32)
        if options.depth.used and picture.knows_depth:
            depth += self._depth(seen_as, inner, _range_m(pixels))
        seen = seen_as.seen
        colour, depth, shown = (np.where(seen, each, np.float32(0)) for each in (colour, depth, filled * free))
        return Weights(colour, depth, shown.astype(np.float16), seen)

    def facing(
        self, picture: Picture, heads: Float[Array, "4 n"], tables: Float[Singles, "n entries"] | None
    ) -> Float[Singles, "n directions"]:
        """The logarithms of the weights by colour of n people's heads if they faced in each of `ASPECTS[0]` directions."""
        options = self._options
        seen_as = outlines(self.camera, heads, options.semi_axes_m)
        pixels = picture.at(seen_as, inner_points(_LOOKED_AT))
        east = np.rint((seen_as.facing + heads[3]) * (ASPECTS[0] / (2 * np.pi)) - 0.5).astype(np.intp)
        turn = (east[:, None] - np.arange(ASPECTS[0])) % ASPECTS[0]  # as `aspects` counts, of each direction
        if tables is None:
            skin = _share(pixels, _SKIN) / np.maximum(_share(pixels, _INSIDE), np.float32(1 / _LOOKED_AT))
            from_nose = (turn * (2 * np.pi / ASPECTS[0])).astype(np.float32)
            log = _linear(np.abs(skin[:, None] - expected_share(from_nose, options)), options.colour.linear)
        else:
            # a pixel's step of s picks a row of its colour's column: for all turns at once a product with zeros and ones
            person = np.arange(heads.shape[1])
            rows = tables.reshape(-1, SHARES, COLOURS)[person, :, pixels & (COLOURS - 1)]  # points, people, steps
            picked = self._picked[seen_as.aspects() % ASPECTS[1]]
            by_turn = np.einsum("ne,net->nt", rows.transpose(1, 0, 2).reshape(len(person), -1), picked)
            log = options.colour.power / _LOOKED_AT * np.take_along_axis(by_turn, turn, axis=1)
        return np.where(seen_as.seen[:, None], log, 0).astype(np.float32)  # it travels

    def look(self, picture: Picture, heads: Float[Array, "4 n"]) -> Int[Index, "3 k"]:
        """The pixels on a head (x, y, z [m], yaw [rad] at the picture's stamp) of each of n people: person, step of s, colour."""
        seen_as = outlines(self.camera, heads, self._options.semi_axes_m)
        pixels = picture.at(seen_as, inner_points(_LOOKED_AT))
        on_head = ((pixels & _FOREGROUND) > 0) & seen_as.seen
        if picture.knows_depth:
            on_head &= np.abs(_range_m(pixels) - seen_as.range_m) < _NEAR_M
        steps = self._steps_looked_at.take(seen_as.aspects(), axis=1) // COLOURS
        person = np.broadcast_to(np.arange(heads.shape[1]), pixels.shape)
        return np.stack([person[on_head], steps[on_head], pixels[on_head] & (COLOURS - 1)]).astype(np.intp)

    def strangers(self, picture: Picture) -> Float[Array, "4 k"]:
        """Places (x, y, z) [m] of pixels of the foreground before the empty room's, and the area that each shows [m²]."""
        pixels = picture.pixels[::_EVERY, ::_EVERY]
        range_m = _range_m(pixels)
        shown = ((pixels & _FOREGROUND) > 0) & (range_m > 0)
        shown &= range_m < self._wall_m[::_EVERY, ::_EVERY] - _BEFORE_M
        away = range_m[shown]
        places = self.camera.pixel_rays[::_EVERY, ::_EVERY][shown].T * away + self.camera.eye_m[:, None]
        pixel = _EVERY**2 / (self.camera.intrinsics.fx * self.camera.intrinsics.fy)
        return np.concatenate([places, [pixel * away**2]]).astype(float)

    @cached_property
    def _steps_shown(self) -> Int32[NDArray, "points aspects"]:
        return self._steps(self._options.points)

    @cached_property
    def _steps_looked_at(self) -> Int32[NDArray, "points aspects"]:
        return self._steps(_LOOKED_AT)

    @cached_property
    def _picked(self) -> Float[Singles, "rises entries turns"]:
        """Which step of s each point looked at shows, zeros and ones (points · steps), by the camera's height angle and turn."""
        step = (self._steps_looked_at // COLOURS).reshape(_LOOKED_AT, ASPECTS[0], ASPECTS[1])
        is_step = step[:, None] == np.arange(SHARES)[:, None, None]
        return np.moveaxis(is_step, -1, 0).reshape(ASPECTS[1], -1, ASPECTS[0]).astype(np.float32)

    def _steps(self, points: int) -> Int32[NDArray, "points aspects"]:
        """The first entry of the step of s that each of so many points of the ellipse shows in every aspect."""
        return (self._learned.share_steps.take(cells_shown(points)) * COLOURS).astype(np.int32)

    def _depth(
        self, seen_as: Outlines, inner: Float[Array, "k 2"], range_m: Float[Singles, "k n"]
    ) -> Float[Singles, "n"]:
        """What the distances of the pixels say; nothing where there are none."""
        options = self._options.depth
        middle = seen_as.range_m
        surface = seen_as.ahead_m(inner)
        surface += middle
        if options.by_range:
            sigma_m = np.float32(options.sigma_m) + np.float32(options.sigma_per_m) * middle * middle
            surface -= range_m
            off = np.minimum(np.abs(surface, out=surface), np.float32(options.most) * sigma_m, out=surface)
            np.copyto(off, np.float32(0), where=range_m <= 0)
            return np.divide(np.float32(-options.power) * _mean(off), sigma_m, dtype=np.float32)
        aside = seen_as.aside_m2(inner)
        along = surface / np.sqrt(surface**2 + aside)
        away = np.sqrt(np.maximum(range_m * (range_m - 2 * middle * along) + middle**2, 0))
        off = np.minimum(np.abs(away - np.sqrt((surface - middle) ** 2 + aside)), np.float32(options.most_m))
        known = range_m > 0
        share, mean = _mean(known), _mean(off * known)
        mean /= np.maximum(share, np.float32(1e-6))
        return np.where(share > 0, _linear(mean, options.linear), np.float32(0))


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


def expected_share(facing: Float[Singles, "*n"], options: WeightOptions) -> Float[Singles, "*n"]:
    """ĉ: the share of skin of a head whose nose points `facing` away from the camera [rad], largest from the front."""
    colour = options.colour
    return np.float32(colour.behind) + np.float32((colour.front - colour.behind) / 2) * (1 + np.cos(facing))


def _linear(off: Float[Singles, "*n"], slope: tuple[float, float]) -> Float[Singles, "*n"]:
    """log(a − b · off), with a floor (eq. 5 and 7)."""
    a, b = slope
    return np.log(np.maximum(a - b * off, _NOTHING)).astype(np.float32)


def _mean(rows: Shaped[NDArray, "k n"]) -> Float[Singles, "n"]:
    """The mean over the first axis; by a product, which numpy does fastest."""
    return np.full(len(rows), 1 / len(rows), np.float32) @ rows.astype(np.float32, copy=False)


def _share(pixels: Int32[NDArray, "k n"], flag: int) -> Float[Singles, "n"]:
    """The share of pixels that have a flag."""
    return _mean(pixels & flag) / np.float32(flag)


def _range_m(pixels: Int32[NDArray, "k n"]) -> Float[Singles, "k n"]:
    """How far along its ray each pixel is [m], 0 where unknown."""
    return (pixels >> _RANGE_BITS) * np.float32(1e-3)
