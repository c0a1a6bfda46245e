"""Colour histograms of torso windows: hue, their chi-squared distance, and the references of tracks.

The paper uses 360 hue bins, but the hue of white and black shirts is noise. So here (ours) a pixel counts in its hue bin by
its chroma, and for the rest in one of a few bins of brightness; bins may be smoothed, as a window may hold few pixels.
`grey_bins=0`, `smoothing_deg=0` is the paper's histogram. A track's reference is learned from clear views, without doubtful ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import cv2
import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from trackers.arrays import Array, Bool, Bytes, Float, Index, Int, Mask, UInt8
from trackers.configuration import Strict
from trackers.filters.rows import Rows, written
from trackers.vision.colour_bins import FULL


class HistogramOptions(Strict):
    """Options of counting and remembering the colours of a torso."""

    hue_bins: PositiveInt = Field(default=360, description="bins of hue over the full circle (paper: 360)")
    grey_bins: NonNegativeInt = Field(
        default=20, description="bins of brightness for pixels without hue; 0: hue alone, as in the paper"
    )
    grey_below: float = Field(
        default=0.06, ge=0, description="chroma (saturation × value) up to which a pixel has no hue"
    )
    coloured_above: float = Field(default=0.2, gt=0, description="chroma from which a pixel counts in its hue alone")
    smoothing_deg: float = Field(
        default=5.0, ge=0, description="standard deviation of the smoothing over hue [°]; 0: none"
    )
    memory: ClassVar[float] = 0.4
    """Share of the old reference kept at an update (α, eq. 7), the default of systems that have it as an option."""

    @model_validator(mode="after")
    def _chroma_limits_in_order(self) -> HistogramOptions:
        if self.coloured_above <= self.grey_below:
            raise ValueError(f"coloured_above must be more than grey_below = {self.grey_below}")
        return self


class ColourHistogram:
    """Histograms of k windows at once, each of `size` bins that sum to 1."""

    def __init__(self, options: HistogramOptions | None = None) -> None:
        self.options = options or HistogramOptions()
        self.size = self.options.hue_bins + self.options.grey_bins
        self._hue_kernel = _gaussian_kernel(self.options.smoothing_deg * self.options.hue_bins / 360)

    def of_windows(
        self,
        rgb: UInt8[Bytes, "height width 3"],
        pixels: Float[Array, "k rows columns 2"],
        inside: Bool[Mask, "k rows columns"],
    ) -> Float[Array, "k {self.size}"]:
        """Return histograms of the image at pixels that are `inside`; all-zero for a window with none.

        Pixels of points behind the camera may be NaN.
        """
        k, pixels = len(pixels), np.where(inside[..., None], pixels, 0.0)
        if k == 0:
            return np.empty((0, self.size))
        column = np.clip(np.rint(pixels[..., 0]), 0, rgb.shape[1] - 1).astype(np.intp)
        row = np.clip(np.rint(pixels[..., 1]), 0, rgb.shape[0] - 1).astype(np.intp)
        # twice as fast as two indices
        sampled = rgb.reshape(-1, 3).take(row * rgb.shape[1] + column, axis=0).reshape(k, -1, 3)
        return self.of_pixels(sampled, inside.reshape(k, -1))

    def of_pixels(self, rgb: UInt8[Bytes, "k n 3"], inside: Bool[Mask, "k n"]) -> Float[Array, "k {self.size}"]:
        """Return histograms of k sets of n pixels, counting those `inside`."""
        options = self.options
        counts = self._counts(rgb, inside)
        if options.smoothing_deg > 0:
            hue_counts, grey_counts = counts[:, : options.hue_bins], counts[:, options.hue_bins :]
            counts = np.concatenate(
                [_smoothed(hue_counts, self._hue_kernel, "wrap"), _smoothed(grey_counts, _GREY_KERNEL, "constant")],
                axis=1,
            )
        return normalised(counts)

    def _counts(self, rgb: UInt8[Bytes, "k n 3"], inside: Bool[Mask, "k n"]) -> Float[Array, "k {self.size}"]:
        """Count the pixels in bins of hue, each by its chroma, and in bins of brightness, each by the remainder.

        Chroma is saturation × value: up to `grey_below` a pixel has no hue, from `coloured_above` on only hue. Without bins
        of brightness there is hue alone, at any chroma.
        """
        options, k = self.options, len(rgb)
        hsv = cv2.cvtColor(np.ascontiguousarray(rgb, np.float32) / np.float32(FULL), cv2.COLOR_RGB2HSV)
        hue, saturation, value = hsv[..., 0], hsv[..., 1], hsv[..., 2]
        bins = [(hue * (options.hue_bins / 360)).astype(np.intp) % options.hue_bins]
        weight = None
        if options.grey_bins:
            grey_bin = np.minimum((value * options.grey_bins).astype(np.intp), options.grey_bins - 1)
            bins.append(options.hue_bins + grey_bin)
            chroma = saturation * value
            coloured = np.clip((chroma - options.grey_below) / (options.coloured_above - options.grey_below), 0, 1)
            weight = np.stack([coloured, 1 - coloured]).ravel()
        number = np.where(inside, np.stack(bins), self.size)
        row = (self.size + 1) * np.arange(k)[:, None]  # one more bin, for pixels not inside
        counts = np.bincount((number + row).ravel(), weight, k * (self.size + 1))
        return counts.reshape(k, self.size + 1)[:, : self.size].astype(float)


def normalised(counts: Float[Array, "k bins"]) -> Float[Array, "k bins"]:
    """Scale histograms to sum 1; an empty one stays all-zero."""
    total = counts.sum(axis=1, keepdims=True)
    return np.divide(counts, total, out=np.zeros_like(counts), where=total > 0)


def chi_squared_distance(references: Float[Array, "n bins"], histograms: Float[Array, "k bins"]) -> Float[Array, "n k"]:
    """Return E: ½ Σ (u − v)² / (u + v) between each reference and each histogram, in [0, 1] (eq. 6, inferred)."""
    return chi_squared(references[:, None], histograms[None])


def chi_squared(references: Float[Array, "*#n bins"], histograms: Float[Array, "*#n bins"]) -> Float[Array, "*n"]:
    """Return that distance between histograms at the same place of two arrays."""
    difference, total = references - histograms, references + histograms
    return 0.5 * np.divide(difference**2, total, out=np.zeros_like(total), where=total > 0).sum(axis=-1)


def bhattacharyya_distance(
    references: Float[Array, "n bins"], histograms: Float[Array, "k bins"]
) -> Float[Array, "n k"]:
    """Return D = √(1 − Σ √(p q)) between each reference and each histogram, in [0, 1].

    After Comaniciu, Ramesh and Meer (2003) and Pérez et al. (2002), whose likelihood is ∝ exp(−λ D²). An all-zero histogram
    has distance 1 from all others.
    """
    alike = np.sqrt(references) @ np.sqrt(histograms).T
    return np.sqrt(np.maximum(1 - alike, 0.0))  # of equal ones rounding leaves 1 ± 1e-16


def updated_reference(
    reference: Float[Array, "n bins"], histogram: Float[Array, "n bins"], memory: float
) -> Float[Array, "n bins"]:
    """Return V̄_t = α V̄_{t−1} + (1 − α) V_t with α = `memory` (eq. 7)."""
    return memory * reference + (1 - memory) * histogram


def _gaussian_kernel(deviation_bins: float) -> Float[Array, "width"]:
    """Return weights that sum to 1 out to three standard deviations."""
    reach = int(np.ceil(3 * deviation_bins))
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / max(deviation_bins, 1e-9)) ** 2)
    return weights / weights.sum()


# one bin of brightness to either side, as lighting varies over a room
_GREY_KERNEL = _gaussian_kernel(1.0)


def _smoothed(
    counts: Float[Array, "k bins"], kernel: Float[Array, "width"], mode: Literal["wrap", "constant"]
) -> Float[Array, "k bins"]:
    """Smooth rows of counts with a kernel; the circle of hues closes (wrap), brightness ends (constant)."""
    if counts.shape[1] == 0:
        return counts
    reach = kernel.size // 2
    if mode == "wrap":
        padded = counts.take(np.arange(-reach, counts.shape[1] + reach), axis=1, mode="wrap")
    else:
        padded = np.zeros((len(counts), counts.shape[1] + 2 * reach))
        padded[:, reach : reach + counts.shape[1]] = counts
    return np.einsum("kbw,w->kb", np.lib.stride_tricks.sliding_window_view(padded, kernel.size, axis=1), kernel)


@dataclass(frozen=True, eq=False)
class Appearance(Rows):
    """The appearance memory of n tracks."""

    reference: Float[Array, "n bins"]  # colour histogram
    n_look: Int[Index, "n"]  # number of views learned; 0: no reference
    n_refused: Int[Index, "n"]  # number of consecutive doubtful views, not learned

    @classmethod
    def started(cls, reference: Float[Array, "n bins"], n_look: Int[Index, "n"]) -> Self:
        """Make appearances of new tracks, with a first view (n_look 1) or none (0)."""
        return cls(reference, n_look, np.zeros(len(reference), np.int64))

    @property
    def known(self) -> Bool[Mask, "n"]:
        """Mask of tracks with at least one clear view."""
        return self.n_look > 0

    def learned(
        self,
        track: Int[Index, "p"],
        histogram: Float[Array, "p bins"],
        doubtful: Bool[Mask, "p"],
        patience: int,
        memory: float,
    ) -> Self:
        """Return the appearances after clear views with these histograms of the tracks at `track`.

        A `doubtful` view, possibly of another person, is not learned; but after `patience` of them in a row the clothes, or
        the light, have changed. memory: retained share of the old reference.
        """
        refused = doubtful & (self.n_refused[track] < patience)
        n_refused = written(self.n_refused, track, np.where(refused, self.n_refused[track] + 1, 0))
        if refused.any():
            track, histogram = track[~refused], histogram[~refused]
        blended = updated_reference(self.reference[track], histogram, memory)
        return type(self)(
            reference=written(self.reference, track, np.where(self.known[track, None], blended, histogram)),
            n_look=written(self.n_look, track, self.n_look[track] + 1),
            n_refused=n_refused,
        )

    def distance(self, histograms: Float[Array, "k bins"], comparable: Bool[Mask, "k"]) -> Float[Array, "n k"] | None:
        """Return the χ² distance of every track and each of k views, in [0, 1], NaN where either has no colours; None: all
        have none.
        """
        known = self.known
        if not known.any() or not comparable.any():
            return None
        distance = np.full((known.size, comparable.size), np.nan)
        distance[np.ix_(known, comparable)] = chi_squared_distance(self.reference[known], histograms[comparable])
        return distance
