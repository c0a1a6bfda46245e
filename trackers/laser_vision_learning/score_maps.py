"""Score maps of each member of a group over the picture, and particles drawn to them.

The likelihood of a person k at x is Σ_i β_i exp(−‖d(x) − d_i‖² / σ²) (Song et al., eq. 1): d(x) the pixel of the middle of a
body at x, d_i the centre of patch i, β_i its normalised score, σ from the side of a patch. As all centres are pixels, the
sum is a picture of the β smoothed by a Gaussian of standard deviation σ / √2, at a cost independent of the number of
particles.

Beyond eq. 1 (ours): a negative score means that a patch is another person's, not that the person is less likely there than
elsewhere, so it counts as 0; the others are divided by their sum. Without positive scores the map is uninformative, and the
likelihood is 1 everywhere. Otherwise it is at least `outlier` times its mean over the map, so that no score excludes a
position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import cv2
import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from trackers.arrays import Array, Bool, Float, Int, Mask
from trackers.configuration import Strict
from trackers.filters.particle import Cloud, LogLikelihood, Move, ParticleFilter

_REACH = 3.0
"""Margin of the map beyond the patches, in standard deviations."""


class ScoreMapOptions(Strict):
    """Options of score maps and of the particles drawn to them."""

    patches: PositiveInt = Field(default=100, description="patches for each person of a group, over where it may be")
    reach_m: float = Field(
        default=0.4, ge=0, description="how far from a person's predicted place patches are drawn [m]"
    )
    deviation: float = Field(default=1.0, gt=0, description="σ of eq. 1, in sides of a patch")
    outlier: ClassVar[float] = 0.1
    """Least likelihood of a position, as a share of the mean over the map (ours)."""
    levels: NonNegativeInt = Field(
        default=3,
        description="times that particles are weighted and resampled in a picture; 0: weighted alone (ablation)",
    )


@dataclass(frozen=True, eq=False)
class ScoreMaps:
    """Score maps of m people over the same part of the picture; 0 for an unknown person."""

    maps: Float[Array, "m height width"]  # the sum of eq. 1 at every pixel
    corner: Int[np.ndarray, "2"]  # u, v of the first pixel
    informative: Bool[Mask, "m"]  # maps with any information
    centre: Float[Array, "k 2"]  # of the patches [px]

    @classmethod
    def of(
        cls, centre: Float[Array, "k 2"], score: Float[Array, "m k"], side_px: float, options: ScoreMapOptions
    ) -> Self:
        """Make maps from patches in the picture with scores from −1 to 1; `side_px`: side of a patch."""
        m, k = score.shape
        if k == 0:
            return cls(np.zeros((m, 1, 1)), np.zeros(2, np.intp), np.zeros(m, bool), centre)
        positive = np.maximum(score, 0.0)
        total = positive.sum(axis=1)
        beta = positive / np.where(total > 0, total, 1.0)[:, None]
        deviation = options.deviation * side_px / np.sqrt(2)
        reach = int(np.ceil(_REACH * deviation))
        pixel = np.rint(centre).astype(np.intp)
        corner = pixel.min(axis=0) - reach
        width, height = pixel.max(axis=0) - corner + reach + 1
        at = ((pixel[:, 1] - corner[1]) * width + pixel[:, 0] - corner[0]) + height * width * np.arange(m)[:, None]
        maps = np.bincount(at.ravel(), beta.ravel(), m * height * width).reshape(m, height, width)
        for each in maps:
            cv2.GaussianBlur(each, (2 * reach + 1,) * 2, deviation, dst=each, borderType=cv2.BORDER_CONSTANT)
        return cls(2 * np.pi * deviation**2 * maps, corner, total > 0, centre)

    def log_likelihood(self, middle: Float[Array, "m p 2"], outlier: float) -> Float[Array, "m p"]:
        """Return log-likelihoods of p positions per person, by the pixel of a body's middle there; 0 without a map."""
        m, height, width = self.maps.shape
        pixel = np.nan_to_num(np.rint(middle), nan=-1e6, posinf=1e6, neginf=-1e6).astype(np.intp) - self.corner
        within = ((pixel >= 0) & (pixel < (width, height))).all(axis=2)
        u, v = np.where(within, pixel[..., 0], 0), np.where(within, pixel[..., 1], 0)
        likelihood = np.where(within, self.maps[np.arange(m)[:, None], v, u], 0.0)
        least = outlier * self.maps.mean(axis=(1, 2))
        likelihood = np.maximum(likelihood, least[:, None])
        return np.where(self.informative[:, None], np.log(np.where(self.informative[:, None], likelihood, 1.0)), 0.0)


def in_levels(
    cloud: Cloud, log_likelihood: LogLikelihood, levels: int, spread: Move, rng: np.random.Generator
) -> Cloud:
    """Weight and resample a cloud by a likelihood, level by level, then weight once more: it concentrates at high values.

    spread: separates particles that resampling has duplicated. Without levels particles are only weighted.
    """
    crowd = ParticleFilter("systematic", threshold=1.0)
    for _ in range(levels):
        cloud = Cloud(cloud.state, cloud.weights.updated(log_likelihood(cloud.state)))
        cloud = crowd.resampled(cloud, rng)
        cloud = Cloud(spread(cloud.state, rng), cloud.weights)
    return Cloud(cloud.state, cloud.weights.updated(log_likelihood(cloud.state)))
