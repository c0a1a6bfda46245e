"""The pictures of one moment as particles look at them: foreground, colours, and windows of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Complex, Float, Float32, Int
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import AnyArray, Array, Floats, Index, Mask, Singles
from trackers.camera_floor_particle.options import CameraFloorParticleOptions, WindowOptions
from trackers.cameras.placed import CameraGroup, PlacedCamera
from trackers.observations import DepthImage, Image, Observation
from trackers.rig import CameraSensor, placed_camera
from trackers.vision.colour_bins import BinnedPicture, BinnedSamples, HueSaturationValueBins
from trackers.vision.foreground import Foreground, shows_floor
from trackers.vision.hsv import Hsv, hsv_of
from trackers.vision.steady import SteadyCamera

_BLIND_FROM = 0.6
"""Share of a picture that is foreground from which it shows no people but a covered lens, or another light."""
_ACROSS = np.linspace(-0.5, 0.5, 12, endpoint=False) + 1 / 24
"""Columns and rows of a window in which skin is looked for, from its middle, in widths and heights."""
_TURNED = np.exp(1j * np.arcsin(2 * _ACROSS)) / len(_ACROSS)
_DARKEST, _LIGHTEST = (2, 50, 100), (17, 165, 255)
"""Skin in OpenCV's HSV: reddish to orange, neither grey nor garish, neither dark nor shaded as hair."""


@dataclass(frozen=True, eq=False)
class View:
    """One camera's picture at one moment. number: of the camera, as references count them."""

    number: int
    camera: PlacedCamera
    rgb: NDArray[np.uint8]
    hsv: Hsv
    mask: Bool[Mask, "height width"]
    bins: HueSaturationValueBins

    @cached_property
    def _all_binned(self) -> BinnedPicture:
        return self.bins.binned(self.hsv)

    @cached_property
    def _foreground_binned(self) -> BinnedPicture:
        return self.bins.binned(self.hsv, self.mask)

    def samples(
        self, places: Float[Array, "3 k"], pixels: Float[Array, "k 2"], window: WindowOptions, number: tuple[int, int]
    ) -> BinnedSamples:
        """The bins of pixels, `number` columns and rows of them, in windows about places [m] shown at these pixels."""
        binned = self._foreground_binned if window.pixels == "foreground" else self._all_binned
        return binned.windows(pixels, window.size_px(self.camera, places), number)

    def similarity(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "k 2"],
        window: WindowOptions,
        root_references: Float32[Singles, "n padded"],
        of: Int[Index, "k"],
    ) -> Float[Floats, "k"]:
        """Σ √(p q), 1 − D² of eq. 4, of the colours in windows and the reference `of` each (`padded_roots`).

        Colours are shares of the window's pixels, or of those of the foreground as a share of all the window.
        """
        counts = self.samples(places, pixels, window, window.samples).counts()
        alike = np.einsum("kb,kb->k", np.sqrt(counts.astype(np.float32)), root_references[of])
        if window.pixels == "foreground":
            return alike / np.sqrt(np.float32(prod(window.samples)))
        return alike / np.sqrt(np.maximum(counts[:, :-1].sum(axis=1), 1))


class Views(Sequence[View]):
    """The pictures of one moment, looked at together."""

    def __init__(self, views: Sequence[View], group: CameraGroup | None = None) -> None:
        self._views = tuple(views)
        self._group = CameraGroup([view.camera for view in views]) if group is None else group
        sizes = [view.mask.size for view in views]
        self._start = np.cumsum([0, *sizes])[:-1, None]
        self._width = np.array([view.mask.shape[1] for view in views], np.intp).reshape(-1, 1)
        self._mask = np.concatenate([view.mask.ravel() for view in views] or [np.zeros(1, np.bool_)])

    def __getitem__(self, number: Any) -> Any:
        return self._views[number]

    def __len__(self) -> int:
        return len(self._views)

    @property
    def eyes_m(self) -> Float[Array, "c 3"]:
        """Where the cameras are [m]."""
        return np.array([view.camera.eye_m for view in self]).reshape(-1, 3)

    def look(self, places: Float[Array, "3 k"]) -> tuple[Float[Array, "c k 2"], Bool[Mask, "c k"], Bool[Mask, "c k"]]:
        """Pixels of places in the room [m], which of them each picture shows, and at which it shows foreground."""
        pixels, seen = self._group.project(places)
        column, row = (np.where(seen[:, None], pixels, 0.0) + 0.5).astype(np.intp).swapaxes(0, 1)
        return pixels.swapaxes(1, 2), seen, seen & self._mask[self._start + row * self._width + column]

    def bearings(self, places: Float[Array, "c k"]) -> Float[Array, "cameras k"]:
        """The directions from places to the cameras, seen from above [rad]."""
        x, y = self.eyes_m[:, :2].T[..., None]
        return np.arctan2(y - places[1], x - places[0])

    def colours(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "cameras k 2"],
        shown: Bool[Mask, "cameras k"],
        window: WindowOptions,
        parts: tuple[int, int] = (1, 1),
    ) -> Float[Array, "looks colours"]:
        """How many pixels of each colour there are in the windows about places that pictures have `shown`, camera by camera.

        parts: into how many columns and rows a window is cut; the colours of one part come after those of another.
        """
        number = (window.samples[0] // parts[0] * parts[0], window.samples[1] // parts[1] * parts[1])
        found = [
            view.samples(places[:, here], at[here], window, number)
            for view, at, here in zip(self, pixels, shown, strict=True)
        ]
        numbers = np.concatenate([each.number for each in found], axis=1)
        windows = _parted(BinnedSamples(numbers, None, self[0].bins.size), number, parts)
        return windows.histograms().reshape(numbers.shape[1], parts[0] * parts[1] * windows.size)

    def skin(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "cameras k 2"],
        shown: Bool[Mask, "cameras k"],
        window: WindowOptions,
    ) -> Complex[AnyArray, "looks"]:
        """Where skin is on heads at places [m]: the mean over a window's pixels of e^iφ where there is skin, 0 elsewhere.

        φ is how far the head's surface is turned from the camera there, seen from above, as if it were round [rad].
        """
        rgb, mask = [], []
        for view, at, here in zip(self, pixels, shown, strict=True):
            size, middle = window.size_px(view.camera, places[:, here]), at[here]
            column = np.rint(middle[:, :1] + size[:, :1] * _ACROSS).clip(0, view.mask.shape[1] - 1).astype(np.intp)
            row = np.rint(middle[:, 1:] + size[:, 1:] * _ACROSS).clip(0, view.mask.shape[0] - 1).astype(np.intp)
            rgb.append(view.rgb[row[:, :, None], column[:, None, :]])
            mask.append(view.mask[row[:, :, None], column[:, None, :]])
        shares = np.concatenate(rgb)
        found = cv2.inRange(
            cv2.cvtColor(shares.reshape(-1, len(_ACROSS), 3), cv2.COLOR_RGB2HSV), _DARKEST, _LIGHTEST
        ).reshape(shares.shape[:3])
        return ((found > 0) & np.concatenate(mask)).mean(axis=1) @ _TURNED


def padded_roots(roots: Float[Array, "n bins"]) -> Float32[Singles, "n padded"]:
    """Roots of references as `View.similarity` takes them: a last bin, of what counts in none, that is like nothing."""
    padded = np.zeros((len(roots), roots.shape[1] + 1), np.float32)
    padded[:, :-1] = roots
    return padded


def _parted(windows: BinnedSamples, samples: tuple[int, int], parts: tuple[int, int]) -> BinnedSamples:
    """The parts of windows, whose samples come column by column, as windows of their own, those of one after another."""
    columns, rows = samples[0] // parts[0], samples[1] // parts[1]
    number = windows.number.reshape(len(windows.number), -1, parts[0], columns, parts[1], rows)
    number = np.moveaxis(number, 4, 3).reshape(len(windows.number), -1, columns * rows)
    return BinnedSamples(number, None, windows.size)


class CameraFrontEnds:
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
        self._steady = {name: SteadyCamera(pictures[name], options.gain_from) for name in cameras}
        self._groups: dict[tuple[int, ...], CameraGroup] = {}  # by the numbers of the cameras that see anything
        self.learns_background = any(each.learns_background for each in self._foreground.values())

    def views(self, observations: Mapping[str, Observation]) -> Views:
        """What the cameras show that see anything. Raises InputError for pictures of another size than the rig says."""
        found = []
        for number, (name, camera) in enumerate(self._placed.items()):
            image = observations.get(name)
            if not isinstance(image, Image | DepthImage) or self._steady[name].is_frozen(image):
                continue
            image = self._steady[name].normalize_exposure(image)
            hsv = hsv_of(image.rgb)
            mask = self._foreground[name].mask(image, hsv)
            if cv2.countNonZero(mask.view(np.uint8)) > _BLIND_FROM * mask.size:
                continue
            found.append(View(number, camera, image.rgb, hsv, mask, self._options.histogram))
        seeing = tuple(view.number for view in found)
        if seeing not in self._groups:
            self._groups[seeing] = CameraGroup([view.camera for view in found])
        return Views(found, self._groups[seeing])
