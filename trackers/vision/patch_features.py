"""Features of patches of a picture, a vector each: colours, edge orientations, texture; from integral images of a crop.

Edge orientation histogram after Levi and Weiss ("Learning object detection from a small number of examples", 2004): Sobel
gradients of the grey picture, their magnitudes summed by orientation, each orientation's share of the sum of all. Texture after
Haralick ("Textural features for image classification", 1973): how often grey levels lie side by side, in a few levels, and
contrast, energy, homogeneity, correlation and entropy of that.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from pydantic import Field, PositiveInt

from trackers.arrays import Array, Bytes, Index, Singles
from trackers.configuration import Strict

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
    """Describes patches of pictures by `size` numbers each."""

    def __init__(self, options: FeatureOptions | None = None) -> None:
        self.options = options or FeatureOptions()
        of_kind = {"rgb": 3 * self.options.rgb_cells**2, "edges": self.options.orientations, "texture": 5}
        self.size = sum(of_kind[kind] for kind in self.options.kinds)

    def described(
        self, rgb: UInt8[Bytes, "height width 3"], centre: Float[Array, "k 2"], side: Float[Array, "k"]
    ) -> Float[Array, "k features"]:
        """Features of k square patches by their centres and sides [px], which are moved inside where they leave the picture.

        At least one; the centres lie in the picture.
        """
        height, width = rgb.shape[:2]
        size = np.clip(np.rint(side), 2, min(height, width)).astype(np.intp)[:, None]
        corner = np.rint(centre - 0.5 * (size - 1)).astype(np.intp)
        corner = np.minimum(np.maximum(corner, 0), (width, height) - size)
        # a pixel more all around, for the gradients
        left, top = np.maximum(corner.min(axis=0) - 1, 0)
        right, bottom = (corner + size).max(axis=0) + 1
        crop = rgb[top:bottom, left:right]
        corner = corner - (left, top)
        makers = {"rgb": self._colours, "edges": self._edges, "texture": self._texture}
        return np.concatenate([makers[kind](crop, corner, size[:, 0]) for kind in self.options.kinds], axis=1)

    def _colours(
        self, crop: UInt8[Bytes, "height width 3"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
    ) -> Float[Array, "k colours"]:
        """Mean red, green and blue of each cell."""
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
        """Shares of the orientations: of nothing, where there are no edges."""
        options = self.options
        along_u, along_v = cv2.spatialGradient(cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY))
        magnitude, turn = cv2.cartToPolar(along_u.astype(np.float32), along_v.astype(np.float32))
        bins = (turn * (options.orientations / np.pi)).astype(np.intp) % options.orientations
        planes = np.zeros((*bins.shape, options.orientations), np.float32)
        np.put_along_axis(planes, bins[..., None], magnitude[..., None] / 8, axis=2)  # Sobel's weights are 8 a level
        sums = _sums(planes, corner, size)
        return sums / (sums.sum(axis=1) + options.least_edge * size**2)[:, None]

    def _texture(
        self, crop: UInt8[Bytes, "height width 3"], corner: Int[Index, "k 2"], size: Int[Index, "k"]
    ) -> Float[Array, "k 5"]:
        """Five of Haralick's features of the pairs of grey levels side by side and one above the other."""
        n = self.options.grey_levels
        level = (cv2.cvtColor(crop, cv2.COLOR_RGB2GRAY).astype(np.intp) * n) // 256
        planes = np.zeros((*level.shape, n * n), np.float32)
        for other in (np.roll(level, -1, axis=1), np.roll(level, -1, axis=0)):  # what comes around lies in the border
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
    """Sums of planes over squares."""
    integral = np.asarray(cv2.integral(planes, sdepth=cv2.CV_64F), float)
    (u, v), far_u, far_v = corner.T, corner[:, 0] + size, corner[:, 1] + size
    return integral[far_v, far_u] - integral[v, far_u] - integral[far_v, u] + integral[v, u]
