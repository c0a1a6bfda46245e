"""Camera front end: preparation of a camera's picture before tracking, for any lens; and the monitor of its calibration.

Exposure is normalized to that of the empty room, a dark room's to a lit one's, the foreground is masked, and blind pictures
are rejected: those of a covered lens or of changed light, which are foreground almost everywhere. Repeated pictures are
dropped earlier, by `trackers.tracking.missing_frames`.

The monitor (ours) detects a camera whose silhouettes disagree with those of the other cameras. Each camera's silhouette is
searched for the top nearest to an estimated head. The tops of three or more cameras fix the crown by least squares, so that
an error of the estimate, such as a head that is consistently too low, explains itself and counts for no camera
(`residual_offsets`). The median of a camera's residuals counts: tops of furniture or raised arms come and go; the error of a
camera's pose remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

import cv2
import numpy as np
from pydantic import Field

from trackers.area import Area
from trackers.arrays import Array, Bool, Bytes, Float, Mask, UInt8
from trackers.cameras.placed import PlacedCamera
from trackers.configuration import Strict
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, placed_camera
from trackers.vision.colour_bins import Hsv, hsv_of
from trackers.vision.foreground import Differences, Foreground, ForegroundOptions, checked_rgb, shows_floor

Picture = TypeVar("Picture", bound=Image | DepthImage)

_BLIND_FROM = 0.6
"""Share of foreground from which a picture is blind."""
_EVERY = 16
"""Distance along rows and columns of the pixels at which brightness is compared."""
_LIT = 115.0
"""Median of the pixels' values of a lit room; pictures of a darker one are lightened to it: thresholds are for lit ones."""
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
        description="exposure is normalized where a picture is lighter or darker than the empty room by more than this share, "
        "and where the room itself is dark (ours); 0: never",
    )


@dataclass(frozen=True, eq=False)
class PreparedPicture(Generic[Picture]):
    """A picture of normalized exposure, its channels, how it differs from the empty room, and its foreground."""

    image: Picture
    hsv: Hsv
    differences: Differences
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
        self.camera = placed_camera(sensor)
        shown = [each for each in empty_room if each.sensor == name and isinstance(each, Image | DepthImage)]
        self._tolerance = options.exposure_tolerance
        last = [checked_rgb(each, sensor.intrinsics) for each in shown][-1:]
        self._gain = _gain_of(last[0]) if last and self._tolerance else 1.0
        self.empty_room = [_scaled(each, self._gain) for each in shown]
        floor = shows_floor(self.camera, area) if options.shadow_region == "floor" else None
        self._foreground = Foreground(sensor.intrinsics, self.empty_room, options.foreground, floor)
        self._brightness = _brightness(self.empty_room[-1].rgb) if self.empty_room else None

    @property
    def learns_background(self) -> bool:
        """True where the background is learned, without an empty room."""
        return self._foreground.learns_background

    def prepare(self, image: Picture) -> PreparedPicture[Picture] | None:
        """Prepare a picture; None if it is blind. Raises InputError for another size than the rig's."""
        image = self.normalize_exposure(image)
        hsv = hsv_of(image.rgb)
        differences = self._foreground.differences(image, hsv)
        mask = self._foreground.mask_of(differences)
        if cv2.countNonZero(mask.view(np.uint8)) > _BLIND_FROM * mask.size:
            return None
        return PreparedPicture(image, hsv, differences, mask)

    def pass_over(self, image: Image | DepthImage) -> None:
        """Learn from a picture as `prepare` does, without preparing it."""
        self._foreground.pass_over(self.normalize_exposure(image))

    def normalize_exposure(self, image: Picture) -> Picture:
        """Scale the picture's brightness to that of a lit room, and to that of the empty one after a change of light."""
        checked_rgb(image, self.camera.intrinsics)
        image = _scaled(image, self._gain)
        before, brightness = self._brightness, _brightness(image.rgb)
        if before is None or not self._tolerance or brightness.shape != before.shape:
            return image
        gains = np.sort(brightness / np.maximum(before, 1.0), axis=None)
        gain = float(gains[(gains.size - 1) // 2] + gains[gains.size // 2]) / 2  # np.median, but faster
        if abs(gain - 1) <= self._tolerance or gain < _DARKEST:
            return image
        return _scaled(image, 1 / gain)


def front_ends(
    cameras: Mapping[str, CameraSensor],
    empty_room: Sequence[Observation],
    options: FrontEndOptions,
    area: Area | None = None,
) -> dict[str, CameraFrontEnd]:
    """Make the front end of each camera, by its name (see `CameraFrontEnd`)."""
    return {name: CameraFrontEnd(name, sensor, empty_room, options, area) for name, sensor in cameras.items()}


def _scaled(image: Picture, gain: float) -> Picture:
    if gain == 1:
        return image
    return replace(image, rgb=cv2.convertScaleAbs(image.rgb, alpha=gain).astype(np.uint8))


def _gain_of(rgb: UInt8[Bytes, "height width 3"]) -> float:
    """Return the factor by which a room is darker than a lit one."""
    return max(1.0, _LIT / max(float(np.median(_brightness(rgb))), _DARKEST * _LIT))


def _brightness(rgb: UInt8[Bytes, "height width 3"]) -> UInt8[Bytes, "rows columns"]:
    red, green, blue = np.moveaxis(rgb[::_EVERY, ::_EVERY], -1, 0)
    return np.maximum(np.maximum(red, green), blue)  # numpy is slow along short rows


_REMEMBERED = 160
"""Number of offsets per camera in the median: furniture, or a bent person, may be beside a head for a while."""
_FEWEST = 16
"""Number of offsets of a camera needed for a warning: fewer are off by chance."""
_CHECKED_EVERY = 4
"""Number of offsets between two medians."""
_TOP_M = 0.12
"""Height of the head at the top of a silhouette, whose middle counts."""
_STEP_M = 1e-3
_LEAST_FREE = 1e-6
"""Least share of an offset that the other cameras check; below, the camera alone fixes the crown in that direction."""


class CalibrationMonitor:
    """Median residual `off` of each camera's heads (`residual_offsets`), in the unit of the offsets given.

    off_from: greatest median of a correct camera.
    """

    def __init__(self, n_camera: int, off_from: float) -> None:
        self.n_camera = n_camera
        self.off: Float[Array, "cameras 2"] = np.zeros((n_camera, 2))
        self._explained = np.zeros(n_camera)
        self._off_from = off_from
        self._looks = np.zeros((n_camera, _REMEMBERED, 3))
        self._n_look = np.zeros(n_camera, np.intp)

    @property
    def suspect(self) -> list[int]:
        """Camera that explains most of the disagreement, of those with too large a median: the others seem off as well.

        None before all cameras that show heads about as often as the others have enough offsets to be compared.
        """
        if ((self._n_look < _FEWEST) & (2 * self._n_look > self._n_look.max(initial=0))).any():
            return []
        off = np.linalg.norm(self.off, axis=1)
        far = np.flatnonzero(off > self._off_from).tolist()
        return [max(far, key=lambda number: (self._explained[number], off[number]))] if far else []

    def take_heads(self, off: Float[Array, "cameras n 2"], jacobian: Float[Array, "cameras n 2 3"]) -> None:
        """Add the offsets of one frame's heads, NaN without a silhouette's top (see `residual_offsets`)."""
        residual, explained = residual_offsets(off, jacobian)
        for number, head in zip(*np.isfinite(explained).nonzero(), strict=True):
            self.take(int(number), residual[number, head], float(explained[number, head]))

    def take(self, number: int, off: Float[Array, "2"], explained: float = 1.0) -> None:
        """Add the residual of a head in a camera. explained: share of the sum of squares that falls without it."""
        self._looks[number, self._n_look[number] % _REMEMBERED] = *off, explained
        count = self._n_look[number] = self._n_look[number] + 1
        if count >= _FEWEST and (count - _FEWEST) % _CHECKED_EVERY == 0:
            *self.off[number], self._explained[number] = np.median(self._looks[number, :count], axis=0)


def residual_offsets(
    off: Float[Array, "cameras n 2"], jacobian: Float[Array, "cameras n 2 3"]
) -> tuple[Float[Array, "cameras n 2"], Float[Array, "cameras n"]]:
    """Return offsets that no displacement of the crown explains, and the share of their sum of squares due to each camera.

    NaN below three cameras.

    off: of tops from projected crowns, NaN without one. jacobian: of the projection in the unit of the offsets per metre.
    With e = off − J δ for the least-squares δ and the leverage H of a camera, the residual is (I − H)^(−1/2) e: it has the
    noise of the offsets whatever the geometry. Its square is the fall of the sum of squares Σ e² without the camera, all of
    it where this camera alone is displaced (Cook and Weisberg, Residuals and Influence in Regression, 1982, 2.2).
    """
    used = np.isfinite(off[..., 0])
    used &= used.sum(axis=0) > 2
    rows = np.where(used[..., None, None], jacobian, 0.0)
    inverse = np.linalg.pinv(np.einsum("cnij,cnik->njk", rows, rows), hermitian=True)
    off = np.where(used[..., None], off, 0.0)
    crown = np.einsum("njk,cnik,cni->nj", inverse, rows, off)
    free = np.eye(2) - np.einsum("cnij,njk,cnlk->cnil", rows, inverse, rows)
    values, vectors = np.linalg.eigh(free)
    scale = np.where(values > _LEAST_FREE, 1 / np.sqrt(np.maximum(values, _LEAST_FREE)), 0.0)
    left = off - np.einsum("cnij,nj->cni", rows, crown)
    residual = np.einsum("cnij,cnj,cnkj,cnk->cni", vectors, scale, vectors, left)
    total = np.maximum(np.square(left).sum(axis=(0, 2)), np.finfo(float).tiny)
    explained = np.where(used, np.square(residual).sum(axis=2) / total, np.nan)
    return np.where(used[..., None], residual, np.nan), explained


def projection_jacobian(camera: PlacedCamera, points_m: Float[Array, "n 3"]) -> Float[Array, "n 2 3"]:
    """Return the derivatives of pixels by places [px/m], by central differences, so for any lens."""
    steps = _STEP_M * np.eye(3)
    ahead, behind = (camera.project(points_m[:, None] + each)[0] for each in (steps, -steps))
    return np.swapaxes(ahead - behind, 1, 2) / (2 * _STEP_M)


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
