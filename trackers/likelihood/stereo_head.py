"""Likelihood of heads by pictures of stereo cameras: distances and colours in their ellipses, and silhouettes about them.

A pure function of heads at the picture's stamp, the picture, each person's colours and the options: independent of where,
and with which others, it is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt, model_validator

from trackers.arrays import AnyArray, Array, Bool, Float, Float16, Index, Int, Int32, Mask, Singles
from trackers.cameras.placed import CameraGroup, PlacedCamera
from trackers.configuration import Strict
from trackers.likelihood.colour import Linear, PersonColourOptions, SilhouetteOptions, SkinShareOptions, linear_log
from trackers.user_input.former_options import warn_of_former_name
from trackers.vision.head_colours import COLOURS, SHARES, HeadModel
from trackers.vision.head_outlines import ASPECTS, Outlines, cells_shown, inner_points, outlines
from trackers.vision.stereo_picture import FOREGROUND, PackedPicture, mean_of, pixels_in, range_m, share_of

Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]

_OF_SKIN, _IN_METRES = ("linear", "front", "behind"), ("linear", "most_m")
_LOOKED_AT = 64
"""Number of points in the ellipse at the expected position of a head."""
_SILHOUETTE = SilhouetteOptions()
_NEAR_M = 0.2
"""Distance from the middle of a head up to which a pixel may be on it: noise and hair."""


class RangeOptions(Strict):
    """Options of distances along the rays, with a precision by distance (ours)."""

    sigma_m: float = Field(default=0.02, gt=0, description="standard deviation of a distance close by [m]")
    sigma_per_m: float = Field(
        default=0.006, ge=0, description="what it grows by with the square of the distance [m per m²]"
    )
    most: float = Field(default=3.0, gt=0, description="a pixel is off by no more than so many standard deviations")
    power: float = Field(default=4.0, gt=0, description="what the mean over the ellipse's pixels counts")

    def sigma(self, range_squared: Float[NDArray, "*n"]) -> Float[NDArray, "*n"]:
        """Return standard deviations of distances [m], from their squares [m²]."""
        return self.sigma_m + self.sigma_per_m * range_squared

    def log_likelihood(
        self, seen_as: Outlines, disc: Float[Array, "k 2"], found_m: Float[Singles, "k n"]
    ) -> Float[Singles, "n"]:
        """Return log-likelihoods of heads by the ranges at points of their ellipses [m]; 0 without any."""
        middle = seen_as.range_m
        surface = seen_as.ahead_m(disc)
        surface += middle
        sigma_m = np.float32(self.sigma_m) + np.float32(self.sigma_per_m) * middle * middle
        surface -= found_m
        off = np.minimum(np.abs(surface, out=surface), np.float32(self.most) * sigma_m, out=surface)
        np.copyto(off, np.float32(0), where=found_m <= 0)
        return np.divide(np.float32(-self.power) * mean_of(off), sigma_m, dtype=np.float32)


class DepthInMetresOptions(Strict):
    """Options of the differences of depth in metres, from the middle of the head (the paper, eq. 6 and 7)."""

    linear: Linear = Field(
        default=(1.0, 2.0),
        description="a and b [1/m] of the weight a − b · mean |d − d̂| (eq. 7; the paper gives neither)",
    )
    most_m: float | None = Field(
        default=0.45, gt=0, description="a pixel is off by no more than this (ours) [m]; null: no cap (the paper)"
    )

    def log_likelihood(
        self, seen_as: Outlines, disc: Float[Array, "k 2"], found_m: Float[Singles, "k n"]
    ) -> Float[Singles, "n"]:
        """Return log-likelihoods of heads by the ranges at points of their ellipses [m]; 0 without any."""
        middle = seen_as.range_m
        surface = seen_as.ahead_m(disc)
        surface += middle
        off_ray = seen_as.off_ray_m2(disc)
        along = surface / np.sqrt(surface**2 + off_ray)
        away = np.sqrt(np.maximum(found_m * (found_m - 2 * middle * along) + middle**2, 0))
        off = np.abs(away - np.sqrt((surface - middle) ** 2 + off_ray))
        if self.most_m is not None:
            off = np.minimum(off, np.float32(self.most_m))
        known = found_m > 0
        share, mean = mean_of(known), mean_of(off * known)
        mean /= np.maximum(share, np.float32(1e-6))
        return np.where(share > 0, linear_log(mean, self.linear), np.float32(0))


class StereoHeadOptions(Strict):
    """Evidence by which one picture weighs heads; null: omitted."""

    semi_axes_m: tuple[Length, Length, Length] = Field(
        default=(0.10, 0.08, 0.125), description="semi-axes of a head: ahead, to the side, up [m]"
    )
    points: PositiveInt = Field(default=20, le=512, description="points looked at in each ellipse")
    person_colour: PersonColourOptions | None = Field(
        default=PersonColourOptions(), description="the person's own colours of face and hair (ours)"
    )
    skin_share: SkinShareOptions | None = Field(default=None, description="the share of skin (the paper)")
    depth: RangeOptions | None = Field(
        default=RangeOptions(), description="distances, by how precise they are so far away (ours)"
    )
    depth_in_metres: DepthInMetresOptions | None = Field(default=None, description="distances in metres (the paper)")
    silhouette: SilhouetteOptions | None = Field(default=SilhouetteOptions(), description="silhouettes (ours)")

    out_of_view: float | None = Field(
        default=0.7,
        ge=0,
        description="a hypothesis that a picture does not show weighs what the person's do on average, less this (ours); "
        "null: it shows no skin there, and no distances (the paper's equations as they stand)",
    )
    whole_picture: bool = Field(
        default=False,
        description="all pixels of a picture count (the paper); false: those beyond the foreground's box are taken from the "
        "empty room, which is known already (ours)",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_former_switches(cls, content: Any) -> Any:
        """Accept the former switches of evidence, for one release."""
        if not isinstance(content, dict):
            return content
        content = dict(content)
        colour, depth, silhouette = (content.get(name) for name in ("colour", "depth", "silhouette"))
        if isinstance(colour, dict):
            warn_of_former_name("", "weights.colour", "stereo_head.person_colour or stereo_head.skin_share")
            del content["colour"]
            by_person = colour.get("by_person", True) and colour.get("used", True)
            power = {"power": colour["power"]} if "power" in colour else content.get("person_colour", {})
            content["person_colour"] = power if by_person else None
            if not colour.get("by_person", True) and colour.get("used", True):
                content["skin_share"] = {name: colour[name] for name in _OF_SKIN if name in colour}
        if isinstance(depth, dict) and depth.keys() & {"used", "by_range", *_IN_METRES}:
            warn_of_former_name("", "weights.depth", "stereo_head.depth or stereo_head.depth_in_metres")
            by_range = depth.get("by_range", True)
            rest = {name: value for name, value in depth.items() if name not in ("used", "by_range", *_IN_METRES)}
            content["depth"] = rest if by_range and depth.get("used", True) else None
            if not by_range and depth.get("used", True):
                content["depth_in_metres"] = {name: depth[name] for name in _IN_METRES if name in depth}
        if isinstance(silhouette, dict) and silhouette.get("power") == 0:
            content["silhouette"] = None
        return content

    @property
    def uses_colours(self) -> bool:
        """True where colours weigh heads."""
        return self.person_colour is not None or self.skin_share is not None


@dataclass(frozen=True, eq=False)
class HeadLikelihoods:
    """Two log-likelihoods of n heads by one picture, and which it sees; others have 0, or that without skin.

    colour: by colours and silhouettes; depth: by distances. p_detect: share of foreground in the ellipse times that of
    background over it, near 1 at a head.
    """

    colour: Float[Singles, "n"]
    depth: Float[Singles, "n"]
    p_detect: Float16[NDArray, "n"]  # sent between processes, and precise enough
    seen: Bool[Mask, "n"]


@dataclass(frozen=True, eq=False)
class CloseLook:
    """Pixels of c pictures at `_LOOKED_AT` points of n heads in each, picture by picture."""

    pixels: Int32[AnyArray, "points c*n"]
    seen_as: Outlines
    yaw: Float[Array, "c n"]  # [rad]
    knows_depth: Bool[Mask, "c"]


class StereoHeads:
    """Likelihood of heads by some stereo cameras, whose pictures of a frame are evaluated together."""

    def __init__(self, cameras: Sequence[PlacedCamera], model: HeadModel, options: StereoHeadOptions) -> None:
        self._cameras = CameraGroup(list(cameras))
        self._model, self._options = model, options

    def log_likelihood(
        self,
        pictures: Sequence[PackedPicture],
        heads: Float[Singles, "4 c n p"],
        tables: Float[Singles, "n entries"] | None,
    ) -> list[HeadLikelihoods]:
        """Weigh p heads (x, y, z [m], yaw [rad] at the picture's stamp) of each of n people, n · p in a row.

        One picture and heads per camera, c in total. tables: log-probability of each colour at each step of s
        (`ExpectedColours.tables`); None: the paper's share of skin.
        """
        options = self._options
        c, n, p = heads.shape[1:]
        seen_as = outlines(self._cameras, heads.reshape(4, c, n * p), options.semi_axes_m)
        inner, silhouette = inner_points(options.points), options.silhouette or _SILHOUETTE
        pixels = pixels_in(pictures, seen_as, self._points)
        pixels, outside = pixels[: len(inner)], pixels[len(inner) :]
        colour, depth = np.zeros(c * n * p, np.float32), np.zeros(c * n * p, np.float32)
        if options.person_colour is not None and tables is not None:
            steps = self._steps_shown.take(seen_as.aspects(), axis=1)
            colour += options.person_colour.log_likelihood(pixels, steps, tables, p)
        if options.skin_share is not None:
            colour += options.skin_share.log_likelihood(options.skin_share.share(pixels), seen_as.facing)
        parts = outside[: silhouette.ring_points], outside[silhouette.ring_points :]
        filled, free = share_of(pixels, FOREGROUND), [1 - share_of(part, FOREGROUND) for part in parts if len(part)]
        if options.silhouette is not None:
            colour += options.silhouette.log_likelihood(filled, free)
        known = np.array([each.knows_depth for each in pictures])
        if known.any():
            for each in (options.depth, options.depth_in_metres):
                if each is not None:
                    depth += each.log_likelihood(seen_as, inner, range_m(pixels))
        seen, not_shown = seen_as.seen.reshape(c, n * p), np.float32(0)
        if options.out_of_view is None and options.skin_share is not None:
            not_shown = options.skin_share.log_likelihood(np.zeros_like(depth), seen_as.facing).reshape(c, n * p)
        colour, depth, p_detect = (
            np.where(counts, each.reshape(c, n * p), other)
            for counts, each, other in (
                (seen, colour, not_shown),
                (seen & known[:, None], depth, np.float32(0)),
                (seen, filled * free[0], np.float32(0)),
            )
        )
        return [HeadLikelihoods(*each) for each in zip(colour, depth, p_detect.astype(np.float16), seen, strict=True)]

    def close_look(self, pictures: Sequence[PackedPicture], heads: Float[Array, "4 c n"]) -> CloseLook:
        """Look up the pictures at many points of n heads (x, y, z [m], yaw [rad]) in each."""
        seen_as = outlines(self._cameras, heads, self._options.semi_axes_m)
        pixels = pixels_in(pictures, seen_as, inner_points(_LOOKED_AT))
        return CloseLook(pixels, seen_as, heads[3], np.array([each.knows_depth for each in pictures]))

    def facing(self, look: CloseLook, tables: Float[Singles, "n entries"] | None) -> Float[Singles, "c n directions"]:
        """Return log-likelihoods by colour of n people's heads in each of `ASPECTS[0]` directions."""
        options, pixels, seen_as = self._options, look.pixels, look.seen_as
        c, n = look.yaw.shape
        east = np.rint((seen_as.facing + look.yaw.ravel()) * (ASPECTS[0] / (2 * np.pi)) - 0.5).astype(np.intp)
        turn = (east[:, None] - np.arange(ASPECTS[0])) % ASPECTS[0]  # as `aspects` counts, of each direction
        log = np.zeros(turn.shape, np.float32)
        if options.skin_share is not None:
            from_nose = (turn * (2 * np.pi / ASPECTS[0])).astype(np.float32)
            log = log + options.skin_share.log_likelihood(options.skin_share.share(pixels)[:, None], from_nose)
        if options.person_colour is not None and tables is not None:
            colour = (pixels & (COLOURS - 1)).T.reshape(c, n, _LOOKED_AT)
            colour += np.arange(0, tables.size, SHARES * COLOURS, dtype=np.int32)[:, None]
            entry = self._steps_turned.take(seen_as.aspects() % ASPECTS[1], axis=0)
            entry += colour.reshape(c * n, _LOOKED_AT, 1)
            by_turn = tables.ravel().take(entry).sum(axis=1)
            log = log + options.person_colour.power / _LOOKED_AT * np.take_along_axis(by_turn, turn, axis=1)
        seen = np.where(seen_as.seen[:, None], log, 0).astype(np.float32)  # sent between processes
        return seen.reshape(c, n, ASPECTS[0])

    def colours_on(self, look: CloseLook, learns: Bool[Mask, "c n"] | bool = True) -> Int[Index, "3 k"]:
        """Return the pixels on n people's heads, picture by picture: person, step of s, colour.

        learns: which heads are asked for in which picture.
        """
        pixels, seen_as, shape = look.pixels, look.seen_as, (_LOOKED_AT, *look.yaw.shape)
        on_head = ((pixels & FOREGROUND) > 0) & seen_as.seen
        if look.knows_depth.any():
            near = np.abs(range_m(pixels) - seen_as.range_m) < _NEAR_M
            on_head &= near | ~look.knows_depth.repeat(shape[2])
        steps = self._steps_looked_at.take(seen_as.aspects(), axis=1) // COLOURS
        by_picture = ((on_head.reshape(shape) & learns).swapaxes(0, 1)).nonzero()
        camera, point, person = by_picture
        at = point, camera * shape[2] + person
        return np.stack([person, steps[at], pixels[at] & (COLOURS - 1)]).astype(np.intp)

    @cached_property
    def _points(self) -> Float[Array, "k 2"]:
        """Points of and about the unit disc that are looked at: those in the ellipse, then those of the silhouette outside."""
        outside = (self._options.silhouette or _SILHOUETTE).outside()
        return np.concatenate([inner_points(self._options.points), outside])

    @cached_property
    def _steps_shown(self) -> Int32[AnyArray, "points aspects"]:
        return self._steps(self._options.points)

    @cached_property
    def _steps_looked_at(self) -> Int32[AnyArray, "points aspects"]:
        return self._steps(_LOOKED_AT)

    @cached_property
    def _steps_turned(self) -> Int32[AnyArray, "rises points turns"]:
        """`_steps_looked_at` by the camera's elevation, for every turn."""
        return np.ascontiguousarray(np.moveaxis(self._steps_looked_at.reshape(_LOOKED_AT, *ASPECTS), -1, 0))

    def _steps(self, points: int) -> Int32[AnyArray, "points aspects"]:
        """Return the first entry of the step of s at each of `points` points of the ellipse for every viewing direction."""
        return (self._model.share_steps.take(cells_shown(points)) * COLOURS).astype(np.int32)
