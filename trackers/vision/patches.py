"""Random patches on a body, and features of their pixels (Lu and Hager, "Dynamic foreground/background extraction from
images and videos using random patches", 2006).

A body is an upright rectangle over its position on the floor that faces the camera. Points drawn on it are projected to the
picture, so that patches lie along the body's axis for any camera pose and lens. A patch is a square of fixed size on the
body.

Edge orientation histogram (Levi and Weiss, "Learning object detection from a small number of examples", 2004): Sobel
gradient magnitudes of the grey picture summed by orientation, as shares of their total. Texture (Haralick, "Textural
features for image classification", 1973): contrast, energy, homogeneity, correlation and entropy of the co-occurrence of a
few grey levels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from pydantic import Field, PositiveInt, model_validator

from trackers.arrays import Array, Bool, Bytes, Float, Float32, Index, Int, Mask, Singles, UInt8
from trackers.cameras import PlacedCamera
from trackers.configuration import Strict
from trackers.filters.rows import Rows

Feature = Literal["rgb", "edges", "texture"]


class FeatureOptions(Strict):
    """Options of the features of a patch."""

    kinds: tuple[Feature, ...] = Field(
        default=("rgb", "edges"),
        min_length=1,
        description="what describes a patch: rgb, edges, texture (paper: rgb and edges)",
    )
    rgb_cells: PositiveInt = Field(
        default=2, description="cells to a side of a patch whose mean red, green and blue are features each"
    )
    orientations: PositiveInt = Field(default=8, description="bins of edge orientation over the half turn")
    least_edge: float = Field(
        default=8.0,
        gt=0,
        description="mean magnitude of gradients [levels a pixel] below which a patch has hardly an orientation",
    )
    grey_levels: int = Field(default=4, ge=2, le=16, description="levels of grey that texture tells apart")


class PatchDescriber:
    """Describer of patches of pictures by `size` features each."""

    def __init__(self, options: FeatureOptions | None = None) -> None:
        self.options = options or FeatureOptions()
        of_kind = {"rgb": 3 * self.options.rgb_cells**2, "edges": self.options.orientations, "texture": 5}
        self.size = sum(of_kind[kind] for kind in self.options.kinds)

    def described(
        self, rgb: UInt8[Bytes, "height width 3"], centre: Float[Array, "k 2"], side: Float[Array, "k"]
    ) -> Float[Array, "k features"]:
        """Describe k square patches by centres and sides [px], moved inside where they leave the picture.

        At least one; the centres lie in the picture.
        """
        height, width = rgb.shape[:2]
        size = np.clip(np.rint(side), 2, min(height, width)).astype(np.intp)[:, None]
        corner = np.rint(centre - 0.5 * (size - 1)).astype(np.intp)
        corner = np.minimum(np.maximum(corner, 0), (width, height) - size)
        # one more pixel all around, for the gradients
        left, top = np.maximum(corner.min(axis=0) - 1, 0)
        right, bottom = (corner + size).max(axis=0) + 1
        crop = rgb[top:bottom, left:right]
        corner = corner - (left, top)
        makers = {"rgb": self._colours, "edges": self._edges, "texture": self._texture}
        return np.concatenate([makers[kind](crop, corner, size[:, 0]) for kind in self.options.kinds], axis=1)

    def _colours(
        self, crop: UInt8[Bytes, "height width 3"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
    ) -> Float[Array, "k colours"]:
        """Return mean red, green and blue of each cell."""
        cells = self.options.rgb_cells
        edges = size[:, None] * np.arange(cells + 1) // cells
        u, v = corner[:, :1] + edges, corner[:, 1:] + edges
        at = cv2.integral(crop)[v[:, :, None], u[:, None]]  # (k, cells + 1, cells + 1, 3)
        sums = np.diff(np.diff(at, axis=1), axis=2)
        extent = np.diff(edges, axis=1)
        area = np.maximum(extent[:, :, None] * extent[:, None], 1)
        return (sums / area[..., None]).reshape(len(size), -1)

    def _edges(
        self, crop: UInt8[Bytes, "height width 3"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
    ) -> Float[Array, "k orientations"]:
        """Return the shares of the orientations, all 0 without edges."""
        options = self.options
        along_u, along_v = cv2.spatialGradient(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY))
        magnitude, turn = cv2.cartToPolar(along_u.astype(np.float32), along_v.astype(np.float32))
        bins = (turn * (options.orientations / np.pi)).astype(np.intp) % options.orientations
        planes = np.zeros((*bins.shape, options.orientations), np.float32)
        np.put_along_axis(
            planes, bins[..., None], magnitude[..., None] / 8, axis=2
        )  # Sobel's weights sum to 8 per level
        sums = _sums(planes, corner, size)
        return sums / (sums.sum(axis=1) + options.least_edge * size**2)[:, None]

    def _texture(
        self, crop: UInt8[Bytes, "height width 3"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
    ) -> Float[Array, "k 5"]:
        """Return five of Haralick's features of horizontally and vertically adjacent grey levels."""
        n = self.options.grey_levels
        level = (cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY).astype(np.intp) * n) // 256
        planes = np.zeros((*level.shape, n * n), np.float32)
        for other in (
            np.roll(level, -1, axis=1),
            np.roll(level, -1, axis=0),
        ):  # wrapped-around values lie in the border
            for pair in (level * n + other, other * n + level):
                np.put_along_axis(planes, pair[..., None], np.take_along_axis(planes, pair[..., None], 2) + 1, axis=2)
        counts = _sums(planes, corner, size).reshape(-1, n, n)
        p = counts / counts.sum(axis=(1, 2), keepdims=True)
        i = np.arange(n) - (n - 1) / 2
        apart = np.abs(i[:, None] - i)
        side = p.sum(axis=2)
        mean = side @ i
        variance = side @ i**2 - mean**2
        product = np.einsum("kij,i,j->k", p, i, i) - mean**2
        entropy = -(p * np.log(np.maximum(p, 1e-12))).sum(axis=(1, 2))
        return np.stack(
            [
                (p * apart**2).sum(axis=(1, 2)),
                (p**2).sum(axis=(1, 2)),
                (p / (1 + apart**2)).sum(axis=(1, 2)),
                np.where(variance > 1e-9, product / np.maximum(variance, 1e-9), 1.0),
                entropy,
            ],
            axis=1,
        )


def _sums(
    planes: Float32[Singles, "height width p"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
) -> Float[Array, "k p"]:
    """Sum planes over squares."""
    integral = np.asarray(cv2.integral(planes, sdepth=cv2.CV_64F), float)
    (u, v), far_u, far_v = corner.T, corner[:, 0] + size, corner[:, 1] + size
    return integral[far_v, far_u] - integral[v, far_u] - integral[far_v, u] + integral[v, u]


_SAME_M = 1e-6


class PatchOptions(Strict):
    """Options of the number and positions of patches on a body."""

    count: PositiveInt = Field(default=40, description="patches drawn on a body")
    size_m: float = Field(default=0.2, gt=0, description="side of a patch on the body [m]")
    width_m: float = Field(
        default=0.36, ge=0, description="breadth of the body over which centres of patches are drawn [m]"
    )
    low_m: float = Field(default=0.15, ge=0, description="lowest centre of a patch above the floor [m]")
    high_m: float = Field(default=1.65, gt=0, description="highest centre of a patch above the floor [m]")

    @model_validator(mode="after")
    def _upright(self) -> PatchOptions:
        if self.high_m <= self.low_m:
            raise ValueError(f"high_m must be more than low_m = {self.low_m}")
        return self


@dataclass(frozen=True, eq=False)
class Patches(Rows):
    """k patches on each of n bodies."""

    centre: Float[Array, "n k 2"]  # [px]
    height_m: Float[Array, "n k"]  # above the floor, on the body that it was drawn on
    side: Float[Array, "n"]  # [px], at least 2
    shown: Bool[Mask, "n k"]  # whether the picture shows the patch, without another of the bodies before it


class PatchSampler:
    """Sampler of patches on bodies before one camera."""

    def __init__(self, camera: PlacedCamera, options: PatchOptions | None = None) -> None:
        self.camera, self.options = camera, options or PatchOptions()

    def drawn(
        self,
        positions_m: Float[Array, "n 2"],
        rng: np.random.Generator,
        count: int | None = None,
        others_m: Float[Array, "m 2"] | None = None,
    ) -> Patches:
        """Draw `count` patches (None: the options' number) on bodies at these positions; not shown where another stands
        before.

        others_m: all people who may stand before them (None: only these themselves).
        """
        count, half_m = count or self.options.count, 0.5 * self.options.width_m
        centre, heights_m, shown = self._drawn(positions_m, rng, count, 0.0, half_m)
        all_m = positions_m if others_m is None else others_m
        distance, theirs = (np.hypot(*(each - self.camera.eye_m[:2]).T) for each in (positions_m, all_m))
        nearer = theirs < distance[:, None] - _SAME_M  # a body does not hide itself
        hidden = (self._covered(centre, *self._axes(all_m)) & nearer[:, None]).any(axis=-1)
        return Patches(centre, heights_m, self._axes(positions_m)[1], shown & ~hidden)

    def drawn_next_to(self, positions_m: Float[Array, "n 2"], count: int, rng: np.random.Generator) -> Patches:
        """Draw patches beside each body, within its breadth of its sides; not shown where they are on another body."""
        half = 0.5 * (self.options.width_m + self.options.size_m)
        centre, heights_m, shown = self._drawn(positions_m, rng, count, half, 3 * half)
        axis, side = self._axes(positions_m)
        return Patches(centre, heights_m, side, shown & ~self._covered(centre, axis, side).any(axis=-1))

    def drawn_around(
        self, positions_m: Float[Array, "n 2"], reach_m: float, count: int, rng: np.random.Generator
    ) -> Patches:
        """Draw patches for each position, each on its own body at most `reach_m` from it."""
        options, n = self.options, len(positions_m)
        turn, out, across, up = rng.random((4, n, count))
        off = reach_m * np.sqrt(out) * np.exp(2j * np.pi * turn)
        places = (positions_m[:, None] + np.stack([off.real, off.imag], axis=-1)).reshape(-1, 2)
        off_axis_m = (across - 0.5) * options.width_m
        heights_m = options.low_m + up * (options.high_m - options.low_m)
        centre, shown = self._projected(places, off_axis_m.reshape(-1, 1), heights_m.reshape(-1, 1))
        return Patches(centre.reshape(n, count, 2), heights_m, self._axes(positions_m)[1], shown.reshape(n, count))

    def middles(self, positions_m: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Project the middles of bodies to pixels."""
        heights = np.full((len(positions_m), 1), 0.5 * (self.options.low_m + self.options.high_m))
        return self._projected(positions_m, np.zeros_like(heights), heights)[0][:, 0]

    def _projected(
        self, positions_m: Float[Array, "n 2"], off_axis_m: Float[Array, "n k"], heights_m: Float[Array, "n k"]
    ) -> tuple[Float[Array, "n k 2"], Bool[Mask, "n k"]]:
        """Project points at offsets to one side of bodies' axes, seen from the camera, and heights; return pixels and
        whether shown.
        """
        towards = positions_m - self.camera.eye_m[:2]
        distance = np.hypot(towards[:, 0], towards[:, 1])[:, None]
        across = towards[:, ::-1] * (-1, 1) / np.maximum(distance, 1e-9)  # directly below the camera a body has no side
        points = np.empty((*heights_m.shape, 3))
        points[..., :2] = positions_m[:, None] + off_axis_m[..., None] * across[:, None]
        points[..., 2] = heights_m
        return self.camera.project(points)

    def _axes(self, positions_m: Float[Array, "n 2"]) -> tuple[Float[Array, "n 2 2"], Float[Array, "n"]]:
        """Return the pixels of the lower and upper ends of bodies' axes, and the side of a patch half-way up, [px]."""
        options, n = self.options, len(positions_m)
        half, middle = 0.5 * options.size_m, 0.5 * (options.low_m + options.high_m)
        across, heights = np.array([0.0, 0.0, -half, half]), np.array([options.low_m, options.high_m, middle, middle])
        pixels, _ = self._projected(positions_m, np.tile(across, (n, 1)), np.tile(heights, (n, 1)))
        return pixels[:, :2], np.maximum(np.hypot(*(pixels[:, 3] - pixels[:, 2]).T), 2.0)

    def _drawn(
        self, positions_m: Float[Array, "n 2"], rng: np.random.Generator, count: int, least_m: float, most_m: float
    ) -> tuple[Float[Array, "n k 2"], Float[Array, "n k"], Bool[Mask, "n k"]]:
        """Draw random points between two distances from bodies' axes, on either side, at any height: pixels, heights, shown."""
        options = self.options
        across, up = rng.random((2, len(positions_m), count))
        across = 2 * across - 1
        off_axis_m = np.copysign(least_m, across) + across * (most_m - least_m)
        heights_m = options.low_m + up * (options.high_m - options.low_m)
        centre, shown = self._projected(positions_m, off_axis_m, heights_m)
        return centre, heights_m, shown

    def _covered(
        self, centre: Float[Array, "n k 2"], axis: Float[Array, "m 2 2"], side: Float[Array, "m"]
    ) -> Bool[Mask, "n k m"]:
        """Return which of m bodies have each patch within half their breadth of their axes."""
        low, along = axis[:, 0], axis[:, 1] - axis[:, 0]
        off = centre[:, :, None] - low
        share = (off * along).sum(axis=-1) / np.maximum((along**2).sum(axis=-1), 1e-9)
        off -= np.clip(share, 0, 1)[..., None] * along
        half_px = 0.5 * side / self.options.size_m * (self.options.width_m + self.options.size_m)
        with np.errstate(invalid="ignore"):  # points behind a pinhole have no pixels, and hide nothing
            return (off**2).sum(axis=-1) < half_px**2
