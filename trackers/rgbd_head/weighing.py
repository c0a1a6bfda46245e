"""What pictures make of heads: each weighs those at its stamp, and those of several cameras are weighed at once.

The weights are a pure function of heads at the picture's stamp, the picture, what is known of each person's colours, and the
options: the same wherever it is worked out, and together with whichever others. All weights are logarithms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float16, Int, Int32, Shaped
from numpy.typing import NDArray

from trackers.arrays import AnyArray, Array, Index, Mask, Singles
from trackers.cameras.placed import CameraGroup
from trackers.rgbd_head.colours import COLOURS, SHARES
from trackers.rgbd_head.options import WeightOptions
from trackers.rgbd_head.outline import ASPECTS, Outlines, cells_shown, inner_points, outlines, ring_points
from trackers.rgbd_head.picture import FOREGROUND, INSIDE, SKIN, CameraFrontEnd, Picture, range_m

_NOTHING = 1e-3
"""A linear weight (eq. 5, 7) is never less: a floor of 0 would let one blocked camera kill a right hypothesis."""
_LOOKED_AT = 64
"""Points looked at in the ellipse at the expected place of a head."""
_NEAR_M = 0.2
"""A pixel this far from the middle of a head may still be on it: noise and hair."""


@dataclass(frozen=True, eq=False)
class Weights:
    """The logarithms of a picture's two weights of n heads, and which it shows; those it does not show get 0.

    shown: share of foreground in the ellipse times that of background over it: near 1 where a head is.
    """

    colour: Float[Singles, "n"]
    depth: Float[Singles, "n"]
    shown: Float16[NDArray, "n"]  # it travels, and is precise enough
    seen: Bool[Mask, "n"]


class Weigher:
    """Some stereo cameras, whose pictures of a moment weigh heads together."""

    def __init__(self, watchers: Sequence[CameraFrontEnd]) -> None:
        self._cameras = CameraGroup([each.camera for each in watchers])
        self._learned, self._options = watchers[0].learned, watchers[0].options

    def weights(
        self,
        pictures: Sequence[Picture],
        heads: Float[Singles, "4 c n p"],
        tables: Float[Singles, "n entries"] | None,
    ) -> list[Weights]:
        """The weights of p heads (x, y, z [m], yaw [rad] at the picture's stamp) of each of n people, n · p in a row.

        A picture and heads of each of c cameras. tables: how likely each colour is at each step of s
        (`ExpectedColours.tables`); None: the paper's share of skin.
        """
        options = self._options
        c, n, p = heads.shape[1:]
        seen_as = outlines(self._cameras, heads.reshape(4, c, n * p), options.semi_axes_m)
        inner = inner_points(options.points)
        ring = ring_points(options.silhouette.ring_points, options.silhouette.ring)
        pixels = _pixels(pictures, seen_as, np.concatenate([inner, ring]))
        pixels, around = pixels[: len(inner)], pixels[len(inner) :]
        colour = np.zeros(c * n * p, np.float32)
        if options.colour.used and tables is not None:
            entry = pixels & (COLOURS - 1)
            entry += self._steps_shown.take(seen_as.aspects(), axis=1)
            entry.reshape(-1, n, p)[...] += np.arange(0, tables.size, SHARES * COLOURS, dtype=np.int32)[:, None]
            colour += np.float32(options.colour.power) * _mean(tables.ravel().take(entry))
        elif options.colour.used:
            n_inside = np.maximum(_share(pixels, INSIDE), np.float32(1 / len(inner)))
            skin = _share(pixels, SKIN) / n_inside
            colour += _linear(np.abs(skin - expected_share(seen_as.facing, options)), options.colour.linear)
        # the share of foreground in each ellipse, and of background in a half ring over it (ours)
        filled, free = _share(pixels, FOREGROUND), 1 - _share(around, FOREGROUND)
        if options.silhouette.power:
            floor = np.float32(options.silhouette.floor)
            both = np.maximum(filled, floor) * np.maximum(free, floor)
            colour += np.float32(options.silhouette.power) * np.log(both)
        known, depth = np.array([each.knows_depth for each in pictures]), np.zeros(c * n * p, np.float32)
        if options.depth.used and known.any():
            depth += self._depth(seen_as, inner, range_m(pixels))
        seen = seen_as.seen.reshape(c, n * p)
        colour, depth, shown = (
            np.where(told, each.reshape(c, n * p), np.float32(0))
            for told, each in ((seen, colour), (seen & known[:, None], depth), (seen, filled * free))
        )
        return [Weights(*each) for each in zip(colour, depth, shown.astype(np.float16), seen, strict=True)]

    def facing(
        self, pictures: Sequence[Picture], heads: Float[Array, "4 c n"], tables: Float[Singles, "n entries"] | None
    ) -> Float[Singles, "c n directions"]:
        """The logarithms of the weights by colour of n people's heads if they faced in each of `ASPECTS[0]` directions."""
        options = self._options
        c, n = heads.shape[1:]
        seen_as = outlines(self._cameras, heads, options.semi_axes_m)
        pixels = _pixels(pictures, seen_as, inner_points(_LOOKED_AT))
        east = np.rint((seen_as.facing + heads[3].ravel()) * (ASPECTS[0] / (2 * np.pi)) - 0.5).astype(np.intp)
        turn = (east[:, None] - np.arange(ASPECTS[0])) % ASPECTS[0]  # as `aspects` counts, of each direction
        if tables is None:
            skin = _share(pixels, SKIN) / np.maximum(_share(pixels, INSIDE), np.float32(1 / _LOOKED_AT))
            from_nose = (turn * (2 * np.pi / ASPECTS[0])).astype(np.float32)
            log = _linear(np.abs(skin[:, None] - expected_share(from_nose, options)), options.colour.linear)
        else:
            colour = (pixels & (COLOURS - 1)).T.reshape(c, n, _LOOKED_AT)
            colour += np.arange(0, tables.size, SHARES * COLOURS, dtype=np.int32)[:, None]
            entry = self._steps_turned.take(seen_as.aspects() % ASPECTS[1], axis=0)
            entry += colour.reshape(c * n, _LOOKED_AT, 1)
            by_turn = tables.ravel().take(entry).sum(axis=1)
            log = options.colour.power / _LOOKED_AT * np.take_along_axis(by_turn, turn, axis=1)
        told = np.where(seen_as.seen[:, None], log, 0).astype(np.float32)  # it travels
        return told.reshape(c, n, ASPECTS[0])

    def look(self, pictures: Sequence[Picture], heads: Float[Array, "4 1 n"]) -> Int[Index, "3 k"]:
        """Pixels of one camera on a head (x, y, z [m], yaw [rad] there) of each of n people: person, step of s, colour."""
        seen_as = outlines(self._cameras, heads, self._options.semi_axes_m)
        pixels = _pixels(pictures, seen_as, inner_points(_LOOKED_AT))
        on_head = ((pixels & FOREGROUND) > 0) & seen_as.seen
        if pictures[0].knows_depth:
            on_head &= np.abs(range_m(pixels) - seen_as.range_m) < _NEAR_M
        steps = self._steps_looked_at.take(seen_as.aspects(), axis=1) // COLOURS
        person = np.broadcast_to(np.arange(heads.shape[2]), pixels.shape)
        return np.stack([person[on_head], steps[on_head], pixels[on_head] & (COLOURS - 1)]).astype(np.intp)

    @cached_property
    def _steps_shown(self) -> Int32[AnyArray, "points aspects"]:
        return self._steps(self._options.points)

    @cached_property
    def _steps_looked_at(self) -> Int32[AnyArray, "points aspects"]:
        return self._steps(_LOOKED_AT)

    @cached_property
    def _steps_turned(self) -> Int32[AnyArray, "rises points turns"]:
        """`_steps_looked_at` by the camera's height angle, for every turn."""
        return np.ascontiguousarray(np.moveaxis(self._steps_looked_at.reshape(_LOOKED_AT, *ASPECTS), -1, 0))

    def _steps(self, points: int) -> Int32[AnyArray, "points aspects"]:
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


def _pixels(
    pictures: Sequence[Picture], seen_as: Outlines, disc: Float[Array, "points 2"]
) -> Int32[AnyArray, "points n"]:
    """Each picture's pixels at points of the unit disc in its ellipses, one picture's after another's."""
    columns, rows = seen_as.pixels(disc)
    found, n = np.empty(columns.shape, np.int32), columns.shape[1] // len(pictures)
    for number, each in enumerate(pictures):
        own = slice(number * n, number * n + n)
        each.at(columns[:, own], rows[:, own], found[:, own])
    return found


def expected_share(facing: Float[Singles, "*n"], options: WeightOptions) -> Float[Singles, "*n"]:
    """ĉ: the share of skin of a head whose nose points `facing` away from the camera [rad], largest from the front."""
    colour = options.colour
    return np.float32(colour.behind) + np.float32((colour.front - colour.behind) / 2) * (1 + np.cos(facing))


def _linear(off: Float[Singles, "*n"], slope: tuple[float, float]) -> Float[Singles, "*n"]:
    """log(a − b · off), with a floor (eq. 5 and 7)."""
    a, b = slope
    return np.log(np.maximum(a - b * off, _NOTHING)).astype(np.float32)


def _mean(rows: Shaped[AnyArray, "k n"]) -> Float[Singles, "n"]:
    """The mean over the first axis; by a product, which numpy does fastest."""
    return np.full(len(rows), 1 / len(rows), np.float32) @ rows.astype(np.float32, copy=False)


def _share(pixels: Int32[AnyArray, "k n"], flag: int) -> Float[Singles, "n"]:
    """The share of pixels that have a flag."""
    return _mean(pixels & flag) / np.float32(flag)
