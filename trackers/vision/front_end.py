"""Camera front end: preparation of a camera's picture before tracking, for any lens.

Exposure is normalized to that of the empty room, the foreground is masked, and blind pictures are rejected: those of a
covered lens or of changed light, which are foreground almost everywhere. Repeated pictures are dropped earlier, by
`trackers.tracking.stale_frames`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from pydantic import Field

from trackers.area import Area
from trackers.arrays import Bytes, Mask
from trackers.configuration import Strict
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, placed_camera
from trackers.vision.colour_bins import Hsv, hsv_of
from trackers.vision.foreground import Foreground, ForegroundOptions, shows_floor

Picture = TypeVar("Picture", bound=Image | DepthImage)

_BLIND_FROM = 0.6
"""Share of foreground from which a picture is blind."""
_EVERY = 16
"""Distance along rows and columns of the pixels at which brightness is compared."""
_DARKEST = 0.1
"""Brightness relative to the empty room below which the lens is covered."""


class FrontEndOptions(Strict):
    """Options of a camera's front end."""

    foreground: ForegroundOptions = Field(default=ForegroundOptions(), description="what counts as foreground")
    shadow_region: Literal["floor", "everywhere"] = Field(
        default="floor",
        description="a possible shadow is left out of the foreground everywhere, or only where the camera sees the floor that "
        "people walk on: grey hair before a grey wall is none (ours)",
    )
    exposure_tolerance: float = Field(
        default=0.08,
        ge=0,
        description="exposure is normalized where a picture is lighter or darker than the empty room by more than this share "
        "(ours); 0: never",
    )


@dataclass(frozen=True, eq=False)
class PreparedPicture(Generic[Picture]):
    """A picture of normalized exposure, its channels, and its foreground."""

    image: Picture
    hsv: Hsv
    mask: Bool[Mask, "height width"]


class CameraFrontEnd:
    """One camera of any lens at its pose, with its empty room.

    empty_room: observations of it by all cameras, in order; without pictures of this camera the background is learned. area:
    where people may walk (None: anywhere), for shadows. Raises InputError for a picture of the empty room of another size
    than the rig's.
    """

    def __init__(
        self,
        name: str,
        sensor: CameraSensor,
        empty_room: Sequence[Observation],
        options: FrontEndOptions,
        area: Area | None = None,
    ) -> None:
        self.name, self.camera = name, placed_camera(sensor)
        self.empty_room = [each for each in empty_room if each.sensor == name and isinstance(each, Image | DepthImage)]
        floor = shows_floor(self.camera, area) if options.shadow_region == "floor" else None
        self._foreground = Foreground(sensor.intrinsics, self.empty_room, options.foreground, floor)
        self._brightness = _brightness(self.empty_room[-1].rgb) if self.empty_room else None
        self._tolerance = options.exposure_tolerance

    @property
    def learns_background(self) -> bool:
        """True where the background is learned, without an empty room."""
        return self._foreground.learns_background

    def prepare(self, image: Picture) -> PreparedPicture[Picture] | None:
        """Prepare a picture; None if it is blind. Raises InputError for another size than the rig's."""
        image = self._normalize_exposure(image)
        hsv = hsv_of(image.rgb)
        mask = self._foreground.mask(image, hsv)
        if cv2.countNonZero(mask.view(np.uint8)) > _BLIND_FROM * mask.size:
            return None
        return PreparedPicture(image, hsv, mask)

    def pass_over(self, image: Image | DepthImage) -> None:
        """Learn from a picture as `prepare` does, without preparing it."""
        self._foreground.pass_over(self._normalize_exposure(image))

    def _normalize_exposure(self, image: Picture) -> Picture:
        """Scale the picture's brightness to that of the empty room after a change of light."""
        before, brightness = self._brightness, _brightness(image.rgb)
        if before is None or not self._tolerance or brightness.shape != before.shape:
            return image
        gains = np.sort(brightness / np.maximum(before, 1.0), axis=None)
        gain = float(gains[(gains.size - 1) // 2] + gains[gains.size // 2]) / 2  # np.median, but faster
        if abs(gain - 1) <= self._tolerance or gain < _DARKEST:
            return image
        return replace(image, rgb=cv2.convertScaleAbs(image.rgb, alpha=1 / gain).astype(np.uint8))


def front_ends(
    cameras: Mapping[str, CameraSensor],
    empty_room: Sequence[Observation],
    options: FrontEndOptions,
    area: Area | None = None,
) -> dict[str, CameraFrontEnd]:
    """Make the front end of each camera, by its name (see `CameraFrontEnd`)."""
    return {name: CameraFrontEnd(name, sensor, empty_room, options, area) for name, sensor in cameras.items()}


def _brightness(rgb: UInt8[Bytes, "height width 3"]) -> UInt8[Bytes, "rows columns"]:
    return rgb[::_EVERY, ::_EVERY].max(axis=-1)
