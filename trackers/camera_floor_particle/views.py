"""The pictures of one moment as particles look at them: foreground, colours, and windows of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array, Index, Mask
from trackers.camera_floor_particle.options import CameraFloorParticleOptions, WindowOptions
from trackers.cameras.placed import PlacedCamera
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, placed_camera
from trackers.vision.colour_bins import BinnedPicture, BinnedSamples, HueSaturationValueBins
from trackers.vision.foreground import Foreground

_BLIND_FROM = 0.6
"""Share of a picture that is foreground from which it shows no people but a covered lens, or another light."""
_ACROSS = np.linspace(-0.5, 0.5, 12, endpoint=False) + 1 / 24
"""Columns and rows of a window in which skin is looked for, from its middle, in widths and heights."""
_DARKEST, _LIGHTEST = (2, 50, 100), (17, 165, 255)
"""Skin in OpenCV's HSV: reddish to orange, neither grey nor garish, neither dark nor shaded as hair."""
_EVERY = 8
"""So many pixels apart, along rows and columns, are the samples by which brightness is compared."""
_FROZEN_AFTER = 2
"""So many times the same picture again are not the world's stillness."""


@dataclass(frozen=True, eq=False)
class View:
    """One camera's picture at one moment. number: of the camera, as references count them."""

    number: int
    camera: PlacedCamera
    rgb: NDArray[np.uint8]
    mask: Bool[Mask, "height width"]
    bins: HueSaturationValueBins

    @cached_property
    def binned(self) -> BinnedPicture:
        """The bins of all pixels."""
        return self.bins.picture(self.rgb)

    @cached_property
    def binned_foreground(self) -> BinnedPicture:
        """The bins of the foreground alone."""
        return self.bins.picture(self.rgb, self.mask)

    def look(self, places: Float[Array, "3 k"]) -> tuple[Float[Array, "k 2"], Bool[Mask, "k"], Bool[Mask, "k"]]:
        """Pixels of places in the room [m], which of them the picture shows, and at which it shows foreground."""
        pixels, seen = self.camera.project(places.T)
        at = np.rint(np.where(seen[:, None], pixels, 0.0)).astype(np.intp)
        at = np.minimum(at, np.array(self.mask.shape)[::-1] - 1)
        return pixels, seen, seen & self.mask[at[:, 1], at[:, 0]]

    def histograms(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "k 2"],
        window: WindowOptions,
        parts: tuple[int, int] = (1, 1),
    ) -> Float[Array, "k colours"]:
        """The colours in windows about places [m] that the picture shows at these pixels, as shares of the window's pixels.

        parts: into how many columns and rows a window is cut; the colours of one part come after those of another.
        """
        width, height = window.width_px, window.height_px
        size = window.size_px(self.camera, places)
        samples = (max(1, width // window.stride), max(1, height // window.stride))
        binned = self.binned_foreground if window.pixels == "foreground" else self.binned
        samples = (samples[0] // parts[0] * parts[0], samples[1] // parts[1] * parts[1])
        windows = _parted(binned.windows(pixels, size, samples), samples, parts)
        counts = windows.histograms().reshape(len(pixels), parts[0] * parts[1] * windows.size)
        if window.pixels == "foreground":
            return counts / (samples[0] * samples[1])
        return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)

    def skin(
        self, places: Float[Array, "3 k"], pixels: Float[Array, "k 2"], window: WindowOptions
    ) -> Complex[NDArray, "k"]:
        """Where skin is on heads at places [m]: the mean over a window's pixels of e^iφ where there is skin, 0 elsewhere.

        φ is how far the head's surface is turned from the camera there, seen from above, as if it were round [rad].
        """
        size = window.size_px(self.camera, places)
        column = np.rint(pixels[:, :1] + size[:, :1] * _ACROSS).clip(0, self.mask.shape[1] - 1).astype(np.intp)
        row = np.rint(pixels[:, 1:] + size[:, 1:] * _ACROSS).clip(0, self.mask.shape[0] - 1).astype(np.intp)
        at = row[:, :, None], column[:, None, :]
        rgb = self.rgb[at].reshape(-1, len(_ACROSS), 3)
        found = cv2.inRange(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV), _DARKEST, _LIGHTEST).reshape(self.mask[at].shape) > 0
        return (found & self.mask[at]).mean(axis=1) @ np.exp(1j * np.arcsin(2 * _ACROSS)) / len(_ACROSS)


def similarity(
    histograms: Float[Array, "k bins"], root_references: Float[Array, "n bins"], of: Int[Index, "k"]
) -> Float[Array, "k"]:
    """Σ √(p q), 1 − D² of eq. 4, of each histogram and the reference (as its root) at `of`."""
    return np.einsum("kb,kb->k", np.sqrt(histograms), root_references[of])


def _parted(windows: BinnedSamples, samples: tuple[int, int], parts: tuple[int, int]) -> BinnedSamples:
    """The parts of windows, whose samples come column by column, as windows of their own, those of one after another."""
    if parts == (1, 1):
        return windows
    columns, rows = samples[0] // parts[0], samples[1] // parts[1]
    number = windows.number.reshape(len(windows.number), -1, parts[0], columns, parts[1], rows)
    number = np.moveaxis(number, 4, 3).reshape(len(windows.number), -1, columns * rows)
    return BinnedSamples(number, None, windows.size)


class Watchers:
    """The cameras of a rig, each with its empty room; makes views of a moment's pictures.

    Raises InputError for pictures of the empty room of another size than the rig says.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraSensor],
        background: Sequence[Observation],
        options: CameraFloorParticleOptions,
        area: Area | None = None,
    ) -> None:
        self._options = options
        self._placed = {name: placed_camera(sensor) for name, sensor in cameras.items()}
        empty = {name: [each for each in background if each.sensor == name] for name in cameras}
        pictures = {name: [each for each in empty[name] if isinstance(each, Image | DepthImage)] for name in cameras}
        self._foreground = {
            name: Foreground(
                sensor.intrinsics,
                pictures[name],
                options.foreground,
                shows_floor(self._placed[name], area) if options.shadows == "floor" else None,
            )
            for name, sensor in cameras.items()
        }
        self._brightness = {name: _brightness(pictures[name][-1]) for name in cameras if pictures[name]}
        self._shapes = {name: each[-1].rgb.shape for name, each in pictures.items() if each}
        self._last: dict[str, tuple[NDArray[np.uint8], int]] = {}  # the picture, how often it came again
        self.learns_background = any(each.learns_background for each in self._foreground.values())

    def views(self, observations: Mapping[str, Observation]) -> list[View]:
        """What the cameras show that see anything. Raises InputError for pictures of another size than the rig says."""
        found = []
        for number, (name, camera) in enumerate(self._placed.items()):
            image = observations.get(name)
            if not isinstance(image, Image | DepthImage) or self._is_frozen(name, image):
                continue
            image = self._set_right(name, image)
            mask = self._foreground[name].mask(image)
            if cv2.countNonZero(mask.view(np.uint8)) > _BLIND_FROM * mask.size:
                continue
            found.append(View(number, camera, image.rgb, mask, self._options.histogram))
        return found

    def _is_frozen(self, name: str, image: Image | DepthImage) -> bool:
        """Whether the very same picture, as far as samples of it tell, comes for the third time."""
        samples = image.rgb[::_EVERY, ::_EVERY]
        last, again = self._last.get(name, (None, 0))
        again = again + 1 if last is not None and np.array_equal(last, samples) else 0
        self._last[name] = samples, again
        return again >= _FROZEN_AFTER

    def _set_right(self, name: str, image: Image | DepthImage) -> Image | DepthImage:
        """The picture as bright as the empty room was, where the light has changed."""
        before = self._brightness.get(name)
        if before is None or not self._options.gain_from or image.rgb.shape != self._shapes[name]:
            return image
        gain = float(np.median(_brightness(image) / np.maximum(before, 1.0)))
        if abs(gain - 1) <= self._options.gain_from or gain < 0.1:
            return image
        return replace(image, rgb=cv2.convertScaleAbs(image.rgb, alpha=1 / gain).astype(np.uint8))


def shows_floor(camera: PlacedCamera, area: Area | None) -> Bool[Mask, "height width"]:
    """Which pixels show the floor of an area (None: any of it), but for what stands on it."""
    down = -camera.pixel_rays[..., 2]
    away_m = camera.eye_m[2] / np.where(down > 0, down, np.nan)  # NaN, which is nowhere, where a ray goes up
    place = camera.eye_m[:2] + away_m[..., None] * camera.pixel_rays[..., :2]
    return down > 0 if area is None else area.contains(place.reshape(-1, 2)).reshape(down.shape)


def _brightness(image: Image | DepthImage) -> NDArray[np.uint8]:
    return image.rgb[::_EVERY, ::_EVERY].max(axis=-1)
