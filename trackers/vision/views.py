"""Pictures of one frame, evaluated together at many positions in the room: foreground, colours of windows, skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt, model_validator

from trackers.arrays import AnyArray, Array, Bool, Complex, Float, Float32, Floats, Index, Int, Mask, Singles
from trackers.cameras.placed import CameraGroup, PlacedCamera
from trackers.configuration import Strict
from trackers.observations import DepthImage, Image, Observation
from trackers.user_input.former_options import warn_of_former_name
from trackers.vision.colour_bins import BinnedPicture, BinnedSamples, Hsv, HueSaturationValueBins
from trackers.vision.front_end import CameraFrontEnd
from trackers.vision.head_colours import LIT_SKIN

BINS = HueSaturationValueBins()
"""Bins of the colours of windows."""
_NEAREST_M = 0.3
"""Least distance from a camera for the size of windows."""
_ACROSS = np.linspace(-0.5, 0.5, 12, endpoint=False) + 1 / 24
"""Columns and rows of a window searched for skin, from its middle, in widths and heights."""
_TURNED = np.exp(1j * np.arcsin(2 * _ACROSS)) / len(_ACROSS)


class WindowOptions(Strict):
    """Window of pixels about a position."""

    size_px: tuple[PositiveInt, PositiveInt] = Field(
        description="width and height [px]: the window's own (the paper), and by which its pixels are sampled"
    )
    size_m: tuple[float, float] | None = Field(
        description="width and height of what the window shows, so that it is smaller farther off (ours) [m]; none: it has its "
        "width and height in pixels everywhere (the paper)",
    )
    stride: PositiveInt = Field(
        default=4,
        le=8,
        description="of every so many pixels, along rows and columns, one is looked at; as many of a window of another size",
    )
    pixels: Literal["all", "foreground"] = Field(
        default="foreground",
        description="all pixels of the window count (the paper), or those of the foreground, as a share of the window (ours)",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_former_sides(cls, content: Any) -> Any:
        """Accept `width_px` and `height_px`, the former names of the two sides, for one release."""
        if not isinstance(content, dict) or not content.keys() & {"width_px", "height_px"}:
            return content
        width, height = content.get("size_px", (None, None))
        size = content.get("width_px", width), content.get("height_px", height)
        for name in content.keys() & {"width_px", "height_px"}:
            warn_of_former_name("", f"window.{name}", "size_px")
        return {name: each for name, each in content.items() if name not in ("width_px", "height_px")} | {
            "size_px": size
        }

    @property
    def samples(self) -> tuple[int, int]:
        """Columns and rows of the sampled pixels."""
        width, height = self.size_px
        return max(1, width // self.stride), max(1, height // self.stride)

    def sizes_px(self, camera: PlacedCamera, places: Float[Array, "3 k"]) -> Float[Array, "k 2"]:
        """Return width and height of the windows about positions in the room [m], in a camera's picture [px]."""
        if self.size_m is None:
            return np.full((places.shape[1], 2), self.size_px, float)
        off_m = places - camera.eye_m[:, None]
        away_m = np.maximum(np.sqrt(np.einsum("ck,ck->k", off_m, off_m)), _NEAREST_M)
        return np.array(self.size_m) * (camera.intrinsics.fx / away_m)[:, None]

    def box(self, place: Float[Array, "3"], camera: PlacedCamera) -> tuple[float, float, float, float] | None:
        """Return left, top, width and height [px] of the window about a position [m]; None outside the picture."""
        (u, v), seen = camera.project(place)
        width, height = self.sizes_px(camera, place[:, None])[0].tolist()
        return (float(u) - width / 2, float(v) - height / 2, width, height) if seen else None


@dataclass(frozen=True, eq=False)
class View:
    """One camera's picture of one frame. number: index of the camera, as in references."""

    number: int
    camera: PlacedCamera
    rgb: NDArray[np.uint8]
    hsv: Hsv
    mask: Bool[Mask, "height width"]

    @cached_property
    def _all_binned(self) -> BinnedPicture:
        return BINS.binned(self.hsv)

    @cached_property
    def _foreground_binned(self) -> BinnedPicture:
        return BINS.binned(self.hsv, self.mask)

    def samples(
        self, places: Float[Array, "3 k"], pixels: Float[Array, "k 2"], window: WindowOptions, number: tuple[int, int]
    ) -> BinnedSamples:
        """Sample the bins of `number` columns and rows of pixels in windows about positions [m] at these pixels."""
        binned = self._foreground_binned if window.pixels == "foreground" else self._all_binned
        return binned.windows(pixels, window.sizes_px(self.camera, places), number)

    def similarity(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "k 2"],
        window: WindowOptions,
        root_references: Float32[Singles, "n padded"],
        of: Int[Index, "k"],
    ) -> Float[Floats, "k"]:
        """Return Σ √(p q), 1 − D² of eq. 4, of the colours in windows and the reference `of` each (`padded_roots`).

        Colours are shares of the window's pixels, or foreground pixels as shares of the whole window.
        """
        counts = self.samples(places, pixels, window, window.samples).counts()
        alike = np.einsum("kb,kb->k", np.sqrt(counts.astype(np.float32)), root_references[of])
        if window.pixels == "foreground":
            return alike / np.sqrt(np.float32(prod(window.samples)))
        return alike / np.sqrt(np.maximum(counts[:, :-1].sum(axis=1), 1))


@dataclass(frozen=True, eq=False)
class ProjectedPoints:
    """k positions in the pictures of all cameras: pixels, whether shown, and whether foreground."""

    views: Views
    pixels: Float[Array, "cameras k 2"]
    seen: Bool[Mask, "cameras k"]
    on_foreground: Bool[Mask, "cameras k"]


class Views(Sequence[View]):
    """The pictures of one frame, looked at together."""

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
        """Positions of the cameras [m]."""
        return np.array([view.camera.eye_m for view in self]).reshape(-1, 3)

    def look(self, places: Float[Array, "3 k"]) -> ProjectedPoints:
        """Project positions in the room [m] into every picture."""
        pixels, seen = self._group.project(places)
        column, row = (np.where(seen[:, None], pixels, 0.0) + 0.5).astype(np.intp).swapaxes(0, 1)
        on_foreground = seen & self._mask[self._start + row * self._width + column]
        return ProjectedPoints(self, pixels.swapaxes(1, 2), seen, on_foreground)

    def bearings(self, places: Float[Array, "c k"]) -> Float[Array, "cameras k"]:
        """Return the directions from positions to the cameras, seen from above [rad]."""
        x, y = self.eyes_m[:, :2].T[..., None]
        return np.arctan2(y - places[1], x - places[0])

    def colours(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "cameras k 2"],
        shown: Bool[Mask, "cameras k"],
        window: WindowOptions,
        parts: tuple[int, int] = (1, 1),
    ) -> Float[Array, "windows colours"]:
        """Count the pixels of each colour in the windows about positions `shown` in pictures, camera by camera.

        parts: columns and rows into which a window is cut; their colours are concatenated.
        """
        number = (window.samples[0] // parts[0] * parts[0], window.samples[1] // parts[1] * parts[1])
        found = [
            view.samples(places[:, here], at[here], window, number)
            for view, at, here in zip(self, pixels, shown, strict=True)
        ]
        numbers = np.concatenate([each.number for each in found])
        windows = BinnedSamples(_parted(numbers, number, parts), BINS.size)
        return windows.histograms().reshape(len(numbers), parts[0] * parts[1] * windows.size)

    def skin(
        self,
        places: Float[Array, "3 k"],
        pixels: Float[Array, "cameras k 2"],
        shown: Bool[Mask, "cameras k"],
        window: WindowOptions,
    ) -> Complex[AnyArray, "windows"]:
        """Locate skin on heads at positions [m]: the mean over a window's pixels of e^iφ for skin, 0 elsewhere.

        φ is the angle of the head's surface from the camera there, seen from above, as if it were round [rad].
        """
        rgb, mask = [], []
        for view, at, here in zip(self, pixels, shown, strict=True):
            size, middle = window.sizes_px(view.camera, places[:, here]), at[here]
            column = np.rint(middle[:, :1] + size[:, :1] * _ACROSS).clip(0, view.mask.shape[1] - 1).astype(np.intp)
            row = np.rint(middle[:, 1:] + size[:, 1:] * _ACROSS).clip(0, view.mask.shape[0] - 1).astype(np.intp)
            rgb.append(view.rgb[row[:, :, None], column[:, None, :]])
            mask.append(view.mask[row[:, :, None], column[:, None, :]])
        windows = np.concatenate(rgb)
        found = LIT_SKIN.shown_in(windows.reshape(-1, len(_ACROSS), 3)).reshape(windows.shape[:3])
        return (found & np.concatenate(mask)).mean(axis=1) @ _TURNED


class CameraViews:
    """Maker of views of a frame's pictures, by the cameras' front ends."""

    def __init__(self, front_ends: Mapping[str, CameraFrontEnd]) -> None:
        self._front_ends = dict(front_ends)
        self._groups: dict[tuple[int, ...], CameraGroup] = {}  # by the indices of the cameras that are not blind
        self.learns_background = any(each.learns_background for each in front_ends.values())

    def views(self, observations: Mapping[str, Observation]) -> Views:
        """Prepare the pictures among the observations, and leave out blind ones.

        Raises InputError for pictures of another size than the rig's.
        """
        found = []
        for number, (name, front_end) in enumerate(self._front_ends.items()):
            image = observations.get(name)
            prepared = front_end.prepare(image) if isinstance(image, Image | DepthImage) else None
            if prepared is not None:
                found.append(View(number, front_end.camera, prepared.image.rgb, prepared.hsv, prepared.mask))
        seeing = tuple(view.number for view in found)
        if seeing not in self._groups:
            self._groups[seeing] = CameraGroup([view.camera for view in found])
        return Views(found, self._groups[seeing])


def padded_roots(roots: Float[Array, "n bins"]) -> Float32[Singles, "n padded"]:
    """Pad roots of references for `View.similarity` by a zero bin for uncounted pixels."""
    padded = np.zeros((len(roots), roots.shape[1] + 1), np.float32)
    padded[:, :-1] = roots
    return padded


def _parted(windows: AnyArray, samples: tuple[int, int], parts: tuple[int, int]) -> AnyArray:
    """Cut windows (k, n), sampled column by column, into concatenated windows of their parts."""
    columns, rows = samples[0] // parts[0], samples[1] // parts[1]
    parted = np.moveaxis(windows.reshape(-1, parts[0], columns, parts[1], rows), 3, 2)
    return parted.reshape(-1, columns * rows)
