"""Colour histograms instead of patches: an ablation of the classifiers.

A track has one histogram of its body's colours, averaged over the pictures that would train a classifier. Similarity is that
of histograms. There are no score maps.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.cameras import PlacedCamera
from trackers.filters.rows import written
from trackers.laser_vision_learning.looks import HISTOGRAM, Learner, Looks, LooksOptions, Picture
from trackers.laser_vision_learning.score_maps import ScoreMaps
from trackers.vision.histogram import chi_squared_distance, updated_reference

_POINTS = 300
"""Number of a body's points whose pixels are counted."""


def learner_of(camera: PlacedCamera, options: LooksOptions) -> Learner:
    """Make the learner of appearance chosen by the options."""
    return HistogramLearner(camera, options) if options.by == "histogram" else Learner(camera, options)


class HistogramLearner(Learner):
    """`Learner` by histograms."""

    def __init__(self, camera: PlacedCamera, options: LooksOptions | None = None) -> None:
        super().__init__(camera, options)
        patches = self.options.patches.model_copy(update={"count": _POINTS})
        self.sampler = type(self.sampler)(camera, patches)

    def trained(
        self,
        looks: Looks,
        rgb: Picture,
        positions_m: Float[Array, "n 2"],
        near: Bool[Mask, "n n"],
        clear: Bool[Mask, "n"],
        ns: int,
        rng: np.random.Generator,
        foreground: Bool[Mask, "height width"] | None = None,
    ) -> Looks:
        """Return the appearances updated by a picture, of clear tracks near another clear one."""
        waiting = (near & clear & clear[:, None]).any(axis=1)
        if not waiting.any():
            return looks
        histogram, seen = self._seen(rgb, positions_m, rng)
        rows = (waiting & seen).nonzero()[0]
        before = looks.reference[rows]
        blended = updated_reference(before, histogram[rows], HISTOGRAM.options.memory)
        reference = np.where(looks.known[rows, None], blended, histogram[rows])
        return looks.changed(
            reference=written(looks.reference, rows, reference), learned_ns=written(looks.learned_ns, rows, ns)
        )

    def scores(
        self,
        looks: Looks,
        rgb: Picture,
        positions_m: Float[Array, "q 2"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
        foreground: Bool[Mask, "height width"] | None = None,
        others_m: Float[Array, "others 2"] | None = None,
    ) -> Float[Array, "q m"]:
        """Return 1 for equal histograms, −1 for disjoint ones, NaN for unknown or hidden ones."""
        histogram, seen = self._seen(rgb, positions_m, rng, others_m)
        chosen = looks.select(rows)
        alike = 1 - 2 * chi_squared_distance(histogram, chosen.reference)
        return np.where(seen[:, None] & chosen.known, alike, np.nan)

    def score_maps(
        self,
        looks: Looks,
        rgb: Picture,
        positions_m: Float[Array, "m 2"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
        foreground: Bool[Mask, "height width"] | None = None,
    ) -> ScoreMaps:
        """Return uninformative maps."""
        return ScoreMaps.of(np.empty((0, 2)), np.empty((len(rows), 0)), 0.0, self.options.maps)

    def _seen(
        self,
        rgb: Picture,
        positions_m: Float[Array, "n 2"],
        rng: np.random.Generator,
        others_m: Float[Array, "others 2"] | None = None,
    ) -> tuple[Float[Array, "n bins"], Bool[Mask, "n"]]:
        """Return all histograms, and a mask of tracks with enough pixels visible."""
        points = self.sampler.drawn(positions_m, rng, None, others_m)
        histogram = HISTOGRAM.of_windows(rgb, points.centre[:, :, None], points.shown[:, :, None])
        return histogram, points.shown.mean(axis=1) >= self.options.least_patches / self.options.patches.count
