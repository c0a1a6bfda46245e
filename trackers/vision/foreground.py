"""Which pixels of a camera show what is not the empty room: HSV difference, shadows left out, small regions removed.

A pixel has changed where its value, saturation or hue differ from the background's by more than a threshold; saturation
and hue only count where there is light enough, and hue where there is colour, to know them. A changed pixel that is darker
than the background by a factor within bounds while its hue and saturation stayed is a cast shadow (Cucchiara et al. 2003,
Detecting moving objects, ghosts, and shadows in video streams, eq. 6; compared with others by Prati et al. 2003). What is
left is eroded, dilated, and rid of small regions. A grey shirt before a lighter grey wall passes for a shadow: where the
lights throw none, `shadows: false` keeps it, and who knows where none can fall says so (`may_be_shaded`).

Without pictures of the empty room the background is learned as pictures come, each channel drifting towards what is seen (the
approximate median of McFarlane and Schofield 1995). Whoever stands still from the start is background until they leave, and
then their place is foreground until it has drifted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from pydantic import Field, NonNegativeInt, model_validator

from trackers.area import Area
from trackers.arrays import Bytes, Floats, Mask, Singles
from trackers.cameras.intrinsics import Intrinsics
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import DepthImage, Image
from trackers.vision.hsv import FULL, HALF_TURNS, Hsv, hsv_of

_MOST_PICTURES = 25
"""So many of the empty room are enough for a median."""
_LONGEST_DRIFT_S = 1.0
"""However long no picture came, the background drifts by no more than this long's worth at one."""


class ForegroundOptions(Strict):
    """How far a pixel is from the empty room's before it is foreground, and what regions are too small to be somebody."""

    value_change: float = Field(
        default=0.1, gt=0, lt=1, description="difference of value from which a pixel has changed"
    )
    saturation_change: float = Field(
        default=0.2, gt=0, le=1, description="difference of saturation from which a pixel has changed"
    )
    hue_change_deg: float = Field(
        default=20.0, gt=0, le=180, description="difference of hue from which a pixel has changed [°]"
    )
    colour_from_value: float = Field(
        default=0.25, ge=0, lt=1, description="value from which saturation counts: noise makes colours of the dark"
    )
    hue_from_saturation: float = Field(default=0.2, ge=0, lt=1, description="saturation from which hue counts")
    shadows: bool = Field(default=True, description="whether what may be a cast shadow is left out")
    shadow_darkest: float = Field(
        default=0.5, gt=0, lt=1, description="share of the background's value down to which it may be a shadow (α)"
    )
    shadow_lightest: float = Field(
        default=0.95, gt=0, le=1, description="share of the background's value up to which it may be a shadow (β)"
    )
    shadow_saturation: float = Field(
        default=0.1, ge=0, le=1, description="how much a shadow changes saturation at most (τ_S)"
    )
    shadow_hue_deg: float = Field(
        default=15.0, ge=0, le=180, description="how much a shadow changes hue at most [°] (τ_H)"
    )
    erode_px: NonNegativeInt = Field(default=1, le=20, description="radius by which regions are eroded [px]")
    dilate_px: NonNegativeInt = Field(default=2, le=20, description="radius by which they are dilated after it [px]")
    least_area_px: NonNegativeInt = Field(default=60, description="a smaller region is removed [px]")
    learned_levels_per_s: float = Field(
        default=12.0,
        gt=0,
        allow_inf_nan=False,
        description="how fast a learned background drifts to what is seen [8-bit levels/s]",
    )

    @model_validator(mode="after")
    def _shadow_bounds_in_order(self) -> ForegroundOptions:
        if self.shadow_darkest >= self.shadow_lightest:
            raise ValueError(f"shadow_darkest must be less than shadow_lightest = {self.shadow_lightest}")
        return self


class Foreground:
    """The foreground masks of one camera, its background given by pictures of the empty room or learned as pictures come.

    intrinsics: those of the camera, for the size of its pictures; may_be_shaded: pixels that may show a shadow, None: all.
    Raises InputError for an empty-room picture of another size.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        empty_room: Sequence[Image | DepthImage] = (),
        options: ForegroundOptions = ForegroundOptions(),
        may_be_shaded: Bool[Mask, "height width"] | None = None,
    ) -> None:
        self.options = options
        self._may_be_shaded = may_be_shaded
        self._shape = (intrinsics.height, intrinsics.width, 3)
        self.learns_background = not empty_room
        self._levels: Singles | None = None  # of the learned background, RGB
        self._t: float | None = None
        self._background: _Background | None = None
        if empty_room:
            shown = [self._checked(image) for image in empty_room]
            every = -(-len(shown) // _MOST_PICTURES)
            median = np.median(np.stack(shown[::every]), axis=0)
            self._background = self._background_of(median)

    def mask(self, image: Image | DepthImage, hsv: Hsv | None = None) -> Bool[Mask, "height width"]:
        """Where a picture, whose channels may be at hand (`hsv`), shows what is not the empty room.

        A learned background is that of the pictures before it; of the first, nothing is foreground. Raises InputError for
        a picture of another size than the camera's.
        """
        rgb = self._checked(image)
        background = self._learned(rgb, image.t) if self._background is None else self._background
        return self._cleaned(background.differs(hsv_of(rgb) if hsv is None else hsv, self.options))

    def pass_over(self, image: Image | DepthImage) -> None:
        """Learn from a picture as `mask` does, without one."""
        if self._background is None:
            self._learned(self._checked(image), image.t)

    def _checked(self, image: Image | DepthImage) -> Bytes:
        if image.rgb.shape != self._shape:
            raise InputError(
                f"image of {image.sensor!r} has shape {image.rgb.shape}; the rig's intrinsics say {self._shape}"
            )
        return image.rgb

    def _learned(self, rgb: UInt8[Bytes, "height width 3"], t: float) -> _Background:
        """The background before this picture, which it learns from; one that is no newer than another teaches nothing."""
        if self._levels is None or self._t is None:
            self._levels, self._t = rgb.astype(np.float32), t
        background = self._background_of(self._levels)
        if t > self._t:
            step = np.float32(self.options.learned_levels_per_s * min(t - self._t, _LONGEST_DRIFT_S))
            self._levels += np.clip(rgb - self._levels, -step, step)
            self._t = t
        return background

    def _background_of(self, levels: Float[Floats, "height width 3"]) -> _Background:
        background = _Background.of(np.rint(levels).astype(np.uint8), self.options)
        if self._may_be_shaded is None:
            return background
        return replace(background, lightest=np.where(self._may_be_shaded, background.lightest, np.uint8(0)))

    def _cleaned(self, changed: Bool[Mask, "height width"]) -> Bool[Mask, "height width"]:
        options = self.options
        mask = changed.view(np.uint8)
        mask = cv2.dilate(cv2.erode(mask, _disc(options.erode_px)), _disc(options.dilate_px))
        if options.least_area_px <= 1:
            return mask.astype(np.bool_)
        left, top, width, height = cv2.boundingRect(mask)
        there = slice(top, top + height), slice(left, left + width)
        cleaned = np.zeros(mask.shape, np.bool_)
        if width:
            # no more regions than a quarter of the pixels touch by a corner; 16 bits are thrice as fast
            ltype = cv2.CV_16U if mask.size < 4 * np.iinfo(np.uint16).max else cv2.CV_32S
            _, label, stats, _ = cv2.connectedComponentsWithStats(mask[there], connectivity=8, ltype=ltype)
            kept = stats[:, cv2.CC_STAT_AREA] >= options.least_area_px
            kept[0] = False  # what is not foreground
            if kept[1:].all():
                cleaned[there] = mask[there] > 0
            elif len(kept) <= FULL + 1:  # numpy's look-up of a whole picture takes several times as long
                table = np.pad(kept, (0, FULL + 1 - len(kept))).view(np.uint8)
                cleaned[there] = cv2.LUT(np.asarray(label, np.uint8), table) > 0
            else:
                cleaned[there] = kept.take(np.asarray(label, np.intp))
        return cleaned


def shows_floor(camera: PlacedCamera, area: Area | None) -> Bool[Mask, "height width"]:
    """Which pixels show the floor of an area (None: any of it), but for what stands on it."""
    down = -camera.pixel_rays[..., 2]
    away_m = camera.eye_m[2] / np.where(down > 0, down, np.nan)  # NaN, which is nowhere, where a ray goes up
    place = camera.eye_m[:2] + away_m[..., None] * camera.pixel_rays[..., :2]
    return down > 0 if area is None else area.contains(place.reshape(-1, 2)).reshape(down.shape)


@dataclass(frozen=True, eq=False)
class _Background:
    """The empty room in 8-bit HSV, and between which values something is a shadow on it."""

    hue: UInt8[Bytes, "height width"]
    saturation: UInt8[Bytes, "height width"]
    value: UInt8[Bytes, "height width"]
    darkest: UInt8[Bytes, "height width"]
    lightest: UInt8[Bytes, "height width"]

    @classmethod
    def of(cls, rgb: UInt8[Bytes, "height width 3"], options: ForegroundOptions) -> _Background:
        hue, saturation, value = hsv_of(rgb)
        level = np.arange(FULL + 1)
        darkest, lightest = np.ceil(level * options.shadow_darkest), np.floor(level * options.shadow_lightest)
        return cls(hue, saturation, value, *(each.astype(np.uint8)[value] for each in (darkest, lightest)))

    def differs(self, hsv: Hsv, options: ForegroundOptions) -> Bool[Mask, "height width"]:
        """Where a picture has changed and no shadow explains it."""
        hue, saturation, value = hsv
        hue_off = cv2.absdiff(hue, self.hue)
        hue_off = np.minimum(hue_off, HALF_TURNS - hue_off)
        saturation_off, value_off = cv2.absdiff(saturation, self.saturation), cv2.absdiff(value, self.value)
        # whole thresholds: numpy would compare with broken ones in double precision
        lit = np.minimum(value, self.value) > int(FULL * options.colour_from_value)
        hued = lit & (np.minimum(saturation, self.saturation) > int(FULL * options.hue_from_saturation))
        changed = value_off > int(FULL * options.value_change)
        changed |= lit & (saturation_off > int(FULL * options.saturation_change))
        changed |= hued & (hue_off > int(options.hue_change_deg / 2))
        if not options.shadows:
            return changed
        shadow = (value >= self.darkest) & (value <= self.lightest)
        shadow &= ~lit | (saturation_off <= int(FULL * options.shadow_saturation))
        shadow &= ~hued | (hue_off <= int(options.shadow_hue_deg / 2))
        return changed & ~shadow


def _disc(radius_px: int) -> UInt8[Bytes, "side side"]:
    side = 2 * radius_px + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)).astype(np.uint8)
