"""Appearance by colours: a naive Bayes classifier of a body's pixels by colour and height, instead of boosted patches (ours).

Points drawn on a body are counted by CIE L*a*b* colour and height; counts are shared among neighbouring colours, so that
no border between two matters. A track's reference is the mean of its counts in the pictures that would train a classifier. The
score of a point is log (p + α q) / (q + α p): p its share in the track's reference, q its mean share in those of all other
people known and a uniform one. α bounds the score, as a share that nothing was counted for is not 0. The score of a body is
the mean over its points, and tells it from everybody, not from its neighbours alone.
"""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.cameras import PlacedCamera
from trackers.filters.rows import written
from trackers.laser_vision_learning.looks import (
    COLOUR_LEVELS,
    COLOURS,
    HEIGHTS,
    Learner,
    Looks,
    LooksOptions,
    PeopleInPicture,
)
from trackers.laser_vision_learning.score_maps import ScoreMaps
from trackers.vision.patches import Patches, PatchSampler

_POINTS = 300
"""Number of points on a body."""
_LEAST_SHARE = 0.15
"""Least share of them that the picture must show."""
_LARGEST_AB = 50.0
"""Largest |a*| and |b*| told apart."""
_MEMORY = 0.95
"""Weight of earlier pictures in a reference; of .9 to .99 told people apart best on seeds 1702 and 1703."""
_OUTLIER = 0.05
"""α; of .02 to .1 likewise."""
_CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Of a cell of colours, (8, 3)."""


def learner_of(camera: PlacedCamera, options: LooksOptions) -> Learner:
    """Make the learner of appearance chosen by the options."""
    return ColourLearner(camera, options) if options.by == "colours" else Learner(camera, options)


class ColourLearner(Learner):
    """`Learner` by colours."""

    def __init__(self, camera: PlacedCamera, options: LooksOptions | None = None) -> None:
        super().__init__(camera, options)
        self.sampler = PatchSampler(camera, self.options.patches.model_copy(update={"count": _POINTS}))

    @property
    def needs_foreground(self) -> bool:
        """True: the room's colours are nobody's."""
        return True

    def trained(
        self,
        looks: Looks,
        people: PeopleInPicture,
        near: Bool[Mask, "n n"],
        clear: Bool[Mask, "n"],
        ns: int,
        rng: np.random.Generator,
    ) -> Looks:
        """Return the appearances of all clear tracks updated by a picture, if one of them is near another track."""
        if not (near.any(axis=1) & clear).any():
            return looks
        counts, seen = self._counted(people, self.sampler.drawn(people.places, rng))
        rows = np.flatnonzero(clear & seen)
        weight = np.maximum(1 - _MEMORY, 1 / (looks.n_learned[rows] + 1))[:, None]
        reference = looks.reference[rows] * (1 - weight) + weight * counts[rows]
        return looks.changed(
            reference=written(looks.reference, rows, reference),
            learned_ns=written(looks.learned_ns, rows, ns),
            n_learned=written(looks.n_learned, rows, looks.n_learned[rows] + 1),
        )

    def scores(
        self,
        looks: Looks,
        people: PeopleInPicture,
        whose: Int[Index, "q"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
    ) -> Float[Array, "q m"]:
        """Return the mean log-likelihood ratios of the bodies' points, NaN for unknown tracks and hidden bodies."""
        counts, seen = self._counted(people, self.sampler.drawn(people.places[whose], rng, None, people.places))
        return np.where(seen[:, None] & looks.known[rows], counts @ _log_ratios(looks, rows).T, np.nan)

    def score_maps(
        self,
        looks: Looks,
        people: PeopleInPicture,
        whose: Int[Index, "m"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
    ) -> ScoreMaps:
        """Return the score maps of a group of tracks at `rows`: of each point 2 P(own) − 1."""
        options = self.options.maps
        patches = self.sampler.drawn_around(people.places[whose], options.reach_m, options.patches, rng)
        cell, share, usable = self._cells(people, patches)
        log_ratio = (_log_ratios(looks, rows)[:, cell[usable]] * share[usable]).sum(axis=2)
        return ScoreMaps.of(patches.centre[usable], np.tanh(0.5 * log_ratio), float(patches.side.mean()), options)

    def _counted(self, people: PeopleInPicture, points: Patches) -> tuple[Float[Array, "n bins"], Bool[Mask, "n"]]:
        """Return the share of each colour and height on n bodies, and a mask of those with enough points in sight."""
        cell, share, usable = self._cells(people, points)
        n = len(usable)
        at = cell + COLOURS * np.arange(n)[:, None, None]
        counts = np.bincount(at.ravel(), (share * usable[..., None]).ravel(), n * COLOURS).reshape(n, COLOURS)
        count = usable.sum(axis=1)
        return counts / np.maximum(count, 1)[:, None], count >= _LEAST_SHARE * usable.shape[1]

    def _cells(
        self, people: PeopleInPicture, points: Patches
    ) -> tuple[Int[Index, "n k 8"], Float[Array, "n k 8"], Bool[Mask, "n k"]]:
        """Return the eight colours at a height nearest to each point's, its shares in them, and which points count."""
        rgb, foreground = people.rgb, people.foreground
        height, width = rgb.shape[:2]
        pixel = np.rint(np.nan_to_num(points.centre)).astype(np.intp)
        u, v = np.clip(pixel[..., 0], 0, width - 1), np.clip(pixel[..., 1], 0, height - 1)
        usable = points.shown if foreground is None else points.shown & foreground[v, u]
        scaled = rgb[v, u].reshape(1, -1, 3).astype(np.float32) / 255
        lightness, *ab = np.moveaxis(cv2.cvtColor(scaled, cv2.COLOR_RGB2LAB).reshape(*u.shape, 3), -1, 0)
        colour = np.stack([lightness / 100, *(each / (2 * _LARGEST_AB) + 0.5 for each in ab)], axis=-1)
        colour = np.clip(colour * COLOUR_LEVELS - 0.5, 0, COLOUR_LEVELS - 1.001)
        low = np.floor(colour).astype(np.intp)
        beyond = (colour - low)[..., None, :]
        share = np.where(_CORNERS, beyond, 1 - beyond).prod(axis=-1)
        corner = low[..., None, :] + _CORNERS
        rules = self.sampler.options
        part = HEIGHTS * (points.height_m - rules.low_m) / (rules.high_m - rules.low_m)
        cell = np.clip(part.astype(np.intp), 0, HEIGHTS - 1)[..., None]
        for axis in range(3):
            cell = cell * COLOUR_LEVELS + corner[..., axis]
        return cell, share, usable


def _log_ratios(looks: Looks, rows: Int[Index, "m"]) -> Float[Array, "m bins"]:
    """Return the scores of every colour and height by the tracks at `rows`."""
    known = looks.reference[looks.known]
    own = looks.reference[rows]
    others = (known.sum(axis=0) + 1 / COLOURS - own * looks.known[rows, None]) / max(len(known), 1)
    return np.log((own + _OUTLIER * others) / (others + _OUTLIER * own))
