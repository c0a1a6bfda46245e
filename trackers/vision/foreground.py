"""Foreground: pixels of a camera that differ from the empty room in HSV, without shadows and small regions.

A pixel has changed if its value, saturation or hue differ from the background's by more than a threshold; saturation and hue
count only in sufficient light, and hue only for coloured pixels. A changed pixel darker than the background by a factor
within bounds, with the same hue and saturation, is a cast shadow (Cucchiara et al. 2003, Detecting moving objects, ghosts,
and shadows in video streams, eq. 6; compared with others by Prati et al. 2003). The rest is eroded, dilated, and freed of
small regions. A grey shirt before a lighter grey wall looks like a shadow: if the lights cast none, `shadows: false` keeps
it, and `may_be_shaded` says where one can fall.

Without pictures of the empty room the background is learned, each channel drifting towards the current picture (the
approximate median of McFarlane and Schofield 1995). A person who stands still from the start is background until they leave,
and then their place is foreground until it has drifted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import cv2
import numpy as np
from pydantic import Field, NonNegativeInt

from trackers.area import Area
from trackers.arrays import Bool, Bytes, Float, Floats, Mask, Singles, UInt8
from trackers.cameras.intrinsics import Intrinsics
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.observations import DepthImage, Image
from trackers.vision.colour_bins import FULL, HALF_TURNS, Hsv, hsv_of

_MOST_PICTURES = 25
"""Number of pictures of the empty room that suffices for a median."""
_HUE_CHANGE_DEG = 20.0
"""Difference of hue above which a pixel has changed."""
_COLOUR_FROM_VALUE, _HUE_FROM_SATURATION = 0.25, 0.2
"""Value from which saturation counts, since dark colours are noisy, and saturation from which hue counts."""
_SHADOW_DARKEST, _SHADOW_LIGHTEST = 0.5, 0.95
"""Shares α and β of the background's value between which a pixel may be a shadow (Cucchiara et al., eq. 6)."""
_SHADOW_SATURATION, _SHADOW_HUE_DEG = 0.1, 15.0
"""Changes τ_S of saturation and τ_H of hue that a shadow makes at most."""
_LEARNED_LEVELS_PER_S = 12.0
"""Drift rate of a learned background [8-bit levels/s]."""
_LONGEST_DRIFT_S = 1.0
"""Greatest time between pictures that counts for the drift."""


class ForegroundOptions(Strict):
    """Options of the difference from the empty room, and of the size of regions."""

    fixed_values: ClassVar[Mapping[str, Any]] = {
        "hue_change_deg": 20.0,
        "colour_from_value": 0.25,
        "hue_from_saturation": 0.2,
        "shadow_darkest": 0.5,
        "shadow_lightest": 0.95,
        "shadow_saturation": 0.1,
        "shadow_hue_deg": 15.0,
        "learned_levels_per_s": 12.0,
    }

    value_change: float = Field(
        default=0.1, gt=0, lt=1, description="difference of value from which a pixel has changed"
    )
    saturation_change: float = Field(
        default=0.2, gt=0, le=1, description="difference of saturation from which a pixel has changed"
    )
    shadows: bool = Field(default=True, description="whether what may be a cast shadow is left out")
    erode_px: NonNegativeInt = Field(default=1, le=20, description="radius by which regions are eroded [px]")
    dilate_px: NonNegativeInt = Field(default=2, le=20, description="radius by which they are dilated after it [px]")
    least_area_px: NonNegativeInt = Field(default=60, description="a smaller region is removed [px]")


def checked_rgb(image: Image | DepthImage, intrinsics: Intrinsics) -> Bytes:
    """Return the colours of a picture (height, width, 3). Raises InputError for another size than the camera's."""
    shape = (intrinsics.height, intrinsics.width, 3)
    if image.rgb.shape != shape:
        raise InputError(f"image of {image.sensor!r} has shape {image.rgb.shape}; the rig's intrinsics say {shape}")
    return image.rgb


class Foreground:
    """Foreground masks of one camera, with a background from pictures of the empty room or learned.

    intrinsics: of the camera, for the size of its pictures; may_be_shaded: pixels that may show a shadow, None: all. Raises
    InputError for an empty-room picture of another size.
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
        self._intrinsics = intrinsics
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
        """Return the mask of a picture's foreground; `hsv`: its channels, if available.

        A learned background is that of earlier pictures; the first has no foreground. Raises InputError for a picture of
        another size than the camera's.
        """
        return self.mask_of(self.differences(image, hsv))

    def differences(self, image: Image | DepthImage, hsv: Hsv | None = None) -> Differences:
        """Return how a picture differs from the background, for `mask_of`; learns and raises as `mask` does."""
        rgb = self._checked(image)
        background = self._learned(rgb, image.t) if self._background is None else self._background
        return background.differences(hsv_of(rgb) if hsv is None else hsv)

    def mask_of(self, differences: Differences) -> Bool[Mask, "height width"]:
        """Return the mask of the foreground of a picture with these differences."""
        return self._cleaned(differences.changed(self.options))

    def pass_over(self, image: Image | DepthImage) -> None:
        """Learn from a picture as `mask` does, without a mask."""
        if self._background is None:
            self._learned(self._checked(image), image.t)

    def _checked(self, image: Image | DepthImage) -> Bytes:
        return checked_rgb(image, self._intrinsics)

    def _learned(self, rgb: UInt8[Bytes, "height width 3"], t: float) -> _Background:
        """Return the background before this picture, and learn from it if it is newer than the last."""
        if self._levels is None or self._t is None:
            self._levels, self._t = rgb.astype(np.float32), t
        background = self._background_of(self._levels)
        if t > self._t:
            step = np.float32(_LEARNED_LEVELS_PER_S * min(t - self._t, _LONGEST_DRIFT_S))
            self._levels += np.clip(rgb - self._levels, -step, step)
            self._t = t
        return background

    def _background_of(self, levels: Float[Floats, "height width 3"]) -> _Background:
        background = _Background.of(np.rint(levels).astype(np.uint8))
        if self._may_be_shaded is None:
            return background
        return replace(background, lightest=np.where(self._may_be_shaded, background.lightest, np.uint8(0)))

    def _cleaned(self, changed: Bool[Mask, "height width"]) -> Bool[Mask, "height width"]:
        options = self.options
        mask = cv2.dilate(cv2.erode(changed.view(np.uint8), _disc(options.erode_px)), _disc(options.dilate_px))
        mask = np.asarray(mask, np.uint8)
        if options.least_area_px > 1:
            _remove_small(mask, options.least_area_px)
        return mask.view(np.bool_)


def _remove_small(mask: UInt8[Bytes, "height width"], least_px: int) -> None:
    """Set regions of ones of fewer pixels to 0; those that touch by a corner are one.

    Pixels are counted by Pick's theorem: a polygon through the middles of its border's B pixels, of area A, holds A + B / 2 + 1,
    and within a hole's there are A − B / 2 + 1. Where regions are few it takes a fraction of the time of labelling them.
    """
    outlines, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return
    outer, number = tree[0, :, 3], np.arange(len(outlines))  # around a hole, −1 for a region
    area = np.array([cv2.contourArea(each) for each in outlines])
    steps = np.array([len(each) if len(each) > 1 else 0 for each in outlines])
    size = np.where(outer < 0, area + steps / 2 + 1, steps / 2 - area - 1)
    region = np.where(outer < 0, number, outer)
    small = (np.bincount(region, size, len(outlines)) < least_px)[region]
    if small.any():
        cv2.drawContours(mask, [outlines[k] for k in np.flatnonzero(small).tolist()], -1, 0, cv2.FILLED)


def shows_floor(camera: PlacedCamera, area: Area | None) -> Bool[Mask, "height width"]:
    """Return the mask of pixels on the floor of an area (None: any floor), ignoring objects on it."""
    down = -camera.pixel_rays[..., 2]
    away_m = camera.eye_m[2] / np.where(down > 0, down, np.nan)  # NaN for rays that rise
    place = camera.eye_m[:2] + away_m[..., None] * camera.pixel_rays[..., :2]
    return down > 0 if area is None else area.contains(place.reshape(-1, 2)).reshape(down.shape)


@dataclass(frozen=True, eq=False)
class _Background:
    """Empty room in 8-bit HSV, and the range of values of a shadow on it."""

    hue: UInt8[Bytes, "height width"]
    saturation: UInt8[Bytes, "height width"]
    value: UInt8[Bytes, "height width"]
    darkest: UInt8[Bytes, "height width"]
    lightest: UInt8[Bytes, "height width"]

    @classmethod
    def of(cls, rgb: UInt8[Bytes, "height width 3"]) -> _Background:
        hue, saturation, value = hsv_of(rgb)
        level = np.arange(FULL + 1)
        darkest, lightest = np.ceil(level * _SHADOW_DARKEST), np.floor(level * _SHADOW_LIGHTEST)
        return cls(hue, saturation, value, *(each.astype(np.uint8)[value] for each in (darkest, lightest)))

    def differences(self, hsv: Hsv) -> Differences:
        """Return how a picture differs from the empty room."""
        hue, saturation, value = hsv
        hue_off = cv2.absdiff(hue, self.hue)
        hue_off = np.minimum(hue_off, HALF_TURNS - hue_off)
        saturation_off = np.asarray(cv2.absdiff(saturation, self.saturation), np.uint8)
        value_off = np.asarray(cv2.absdiff(value, self.value), np.uint8)
        # integer thresholds: numpy would compare with fractions in double precision
        lit = np.minimum(value, self.value) > int(FULL * _COLOUR_FROM_VALUE)
        hued = lit & (np.minimum(saturation, self.saturation) > int(FULL * _HUE_FROM_SATURATION))
        saturation_off *= lit.view(np.uint8)
        hue_off *= hued.view(np.uint8)
        return Differences(hue_off, saturation_off, value_off, value, self)


@dataclass(frozen=True, eq=False)
class Differences:
    """Differences of a picture from a background in 8-bit HSV, each 0 where it does not count."""

    hue: UInt8[Bytes, "height width"]
    saturation: UInt8[Bytes, "height width"]
    value: UInt8[Bytes, "height width"]
    level: UInt8[Bytes, "height width"]  # value of the picture
    background: _Background

    def changed(self, options: ForegroundOptions) -> Bool[Mask, "height width"]:
        """Return the mask of changed pixels that no shadow explains."""
        changed = self.value > int(FULL * options.value_change)
        changed |= self.saturation > int(FULL * options.saturation_change)
        changed |= self.hue > int(_HUE_CHANGE_DEG / 2)
        if not options.shadows:
            return changed
        shadow = (self.level >= self.background.darkest) & (self.level <= self.background.lightest)
        shadow &= self.saturation <= int(FULL * _SHADOW_SATURATION)
        shadow &= self.hue <= int(_SHADOW_HUE_DEG / 2)
        return changed & ~shadow


def _disc(radius_px: int) -> UInt8[Bytes, "side side"]:
    side = 2 * radius_px + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)).astype(np.uint8)
