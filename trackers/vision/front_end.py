"""Camera front end: preparation of a camera's picture before tracking, for any lens; and the monitor of its calibration.

Exposure is normalized to that of the empty room, the foreground is masked, and blind pictures are rejected: those of a
covered lens or of changed light, which are foreground almost everywhere. Repeated pictures are dropped earlier, by
`trackers.tracking.stale_frames`.

The monitor (ours) detects a camera whose heads are consistently displaced from the estimates of all cameras. Each camera's
silhouette is searched for the top nearest to an estimated head. The median of its offsets from the projected crown counts.
Errors of estimates change as people move and cancel; those of a camera's pose remain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from pydantic import Field

from trackers.area import Area
from trackers.arrays import Array, Bytes, Mask
from trackers.cameras.placed import PlacedCamera
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


_REMEMBERED = 160
"""Number of offsets per camera in the median: furniture, or a bent person, may be beside a head for a while."""
_CHECKED_EVERY = 4
"""Number of offsets between two medians."""
_TOP_M = 0.12
"""Height of the head at the top of a silhouette, whose middle counts."""


class CalibrationMonitor:
    """Median offset `off` of each camera's heads, to the right and down, in the unit of the offsets given.

    off_from: greatest median of a correct camera. fewest: offsets needed for a warning.
    """

    def __init__(self, n_camera: int, off_from: float, fewest: int) -> None:
        self.off: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))
        self._off_from, self._fewest = off_from, fewest
        self._looks = np.zeros((n_camera, _REMEMBERED, 2))
        self._n_look = np.zeros(n_camera, np.intp)

    @property
    def doubted(self) -> list[int]:
        """Camera with the largest median offset, if too large: it draws the estimates, so the others seem off as well."""
        off = np.linalg.norm(self.off, axis=1)
        return np.flatnonzero((off > self._off_from) & (off == off.max(initial=0.0))).tolist()

    def take(self, number: int, off: Float[Array, "2"]) -> None:
        """Add the offset of a head in a camera."""
        self._looks[number, self._n_look[number] % _REMEMBERED] = off
        count = self._n_look[number] = self._n_look[number] + 1
        if count >= self._fewest and (count - self._fewest) % _CHECKED_EVERY == 0:
            self.off[number] = np.median(self._looks[number, :count], axis=0)


def silhouette_offsets(
    camera: PlacedCamera,
    mask: Bool[Mask, "height width"],
    crowns_m: Float[Array, "n 3"],
    reach_px: Float[Array, "n"],
    apart_px: Float[Array, "n"],
) -> Float[Array, "n 2"]:
    """Return the offsets of the tops of silhouettes from projected crowns, to the right and down [px]; NaN without one.

    reach_px: search radius about each crown. Heads with another within `apart_px` have none.
    """
    pixels, seen = camera.project(crowns_m)
    near = (np.abs(pixels[:, None] - pixels).max(axis=2) < apart_px[:, None]).sum(axis=1) > 1  # besides themselves
    top_px = _TOP_M * camera.intrinsics.fx / np.linalg.norm(crowns_m - camera.eye_m, axis=1)
    found = np.full((len(crowns_m), 2), np.nan)
    for row in np.flatnonzero(seen & ~near):  # at most a few people
        off = _silhouette_top(mask, pixels[row], int(reach_px[row]), max(2, round(float(top_px[row]))))
        if off is not None:
            found[row] = off
    return found


def _silhouette_top(
    mask: Bool[Mask, "height width"], crown_px: Float[Array, "2"], reach_px: int, head_px: int
) -> Float[Array, "2"] | None:
    """Return the offset of the top of the silhouette nearest to a crown, to the right and down [px].

    reach_px: search radius. head_px: height of the head, whose middle counts. None: no silhouette, or one that continues
    above.
    """
    left, top = (round(each) - reach_px for each in crown_px.tolist())
    if left < 0 or top < 0:
        return None
    window = mask[top : top + 2 * reach_px + 1, left : left + 2 * reach_px + 1]
    rows = np.flatnonzero(window.any(axis=1))
    if not rows.size or rows[0] == 0:
        return None
    columns = window[rows[0] : rows[0] + head_px].nonzero()[1]
    return np.array([columns.mean() - reach_px, float(rows[0] - reach_px)])
