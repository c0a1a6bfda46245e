"""Appearance: per track a classifier that separates patches of its own from those of people around it.

While a person is near enough to others to be confused, and the scanners separate all of them, patches are cut at their
positions: their own are positive samples, those of the others negative, and the classifier learns one frame
(`trackers.learning.boosting`). It lives as long as its track. A frame trains only a few classifiers, those that have waited
longest first, which bounds its cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from trackers.arrays import Array, Bool, Bytes, Float, Index, Int, Mask, UInt8
from trackers.cameras import PlacedCamera
from trackers.configuration import Strict, leaves_of
from trackers.filters.particle import LogLikelihood
from trackers.filters.rows import Rows, written
from trackers.laser_vision_learning.score_maps import ScoreMapOptions, ScoreMaps
from trackers.learning.boosting import BoostingOptions, OnlineBoosting, StrongClassifiers
from trackers.tracking.roster import NEVER_NS
from trackers.vision.patches import Feature, FeatureOptions, PatchDescriber, Patches, PatchOptions, PatchSampler

Picture = UInt8[Bytes, "height width 3"]
COLOUR_LEVELS, HEIGHTS = 10, 4
"""Levels of each of L*, a*, b*, and parts of a body's height, that `colours` tells apart."""
COLOURS = HEIGHTS * COLOUR_LEVELS**3


class LooksOptions(Strict):
    """Options of the learning of appearances."""

    former_names: ClassVar[Mapping[str, str]] = {
        "patches.count": "patch_count",
        "patches.size_m": "patch_m",
        "features.kinds": "kinds",
    }
    fixed_values: ClassVar[Mapping[str, Any]] = {
        **{f"patches.{name}": value for name, value in leaves_of(PatchOptions()) if name not in ("count", "size_m")},
        **{f"features.{name}": value for name, value in leaves_of(FeatureOptions()) if name != "kinds"},
        "least_foreground": 0.0,
    }

    by: Literal["colours", "classifier"] = Field(
        default="colours",
        description="what tells people apart: naive Bayes by colour and height (ours), or boosted trees on patches (paper)",
    )
    patch_count: PositiveInt = Field(default=PatchOptions().count, description="patches drawn on a body")
    patch_m: float = Field(default=PatchOptions().size_m, gt=0, description="side of a patch on the body [m]")
    kinds: tuple[Feature, ...] = Field(
        default=FeatureOptions().kinds,
        min_length=1,
        description="features that describe a patch: rgb, edges, texture (paper: rgb and edges)",
    )
    height: bool = Field(default=True, description="how high on the body a patch was drawn is a feature too (ours)")
    boosting: BoostingOptions = Field(
        default=BoostingOptions(first_a_frame=10), description="the classifier of a track"
    )
    maps: ScoreMapOptions = Field(default=ScoreMapOptions(), description="score maps of people who meet")
    classifiers_a_frame: PositiveInt = Field(
        default=5, description="classifiers that a picture trains at most, those first that have waited longest (ours)"
    )
    least_patches: ClassVar[int] = 10
    """Least number of visible patches of a body for learning or scoring (ours)."""
    background: NonNegativeInt = Field(
        default=20, description="patches beside a body, on nobody, that are negative samples too (ours)"
    )

    @property
    def patches(self) -> PatchOptions:
        """Options of a body's patches."""
        return PatchOptions(count=self.patch_count, size_m=self.patch_m)

    @property
    def features(self) -> FeatureOptions:
        """Options of a patch's features."""
        return FeatureOptions(kinds=self.kinds)


@dataclass(frozen=True, eq=False)
class Looks(Rows):
    """Appearance of n tracks."""

    strong: StrongClassifiers
    learned_ns: Int[Index, "n"]  # stamp of the last picture learned from; before any: `NEVER_NS`
    n_learned: Int[Index, "n"]  # number of these pictures
    reference: Float[Array, "n bins"]  # shares of colours (`colours`); of the classifier without bins

    @classmethod
    def unknown(cls, n: int, options: LooksOptions) -> Self:
        """Make the appearance of new tracks."""
        bins, trees = (COLOURS, 0) if options.by == "colours" else (0, options.boosting.trees)
        strong = StrongClassifiers.untrained(n, trees)
        return cls(strong, np.full(n, NEVER_NS), np.zeros(n, np.int64), np.zeros((n, bins)))

    @property
    def known(self) -> Bool[Mask, "n"]:
        """Mask (n,) of tracks whose classifier has learned."""
        return self.learned_ns != NEVER_NS


@dataclass(frozen=True, eq=False)
class PeopleInPicture:
    """A picture, and the positions of n people at its stamp, any of whom may hide others. foreground: None if unknown."""

    rgb: Picture
    places: Float[Array, "n 2"]  # [m]
    foreground: Bool[Mask, "height width"] | None = None


@dataclass(frozen=True, eq=False)
class Described:
    """Patches on n bodies in one picture."""

    features: Float[Array, "n k features"]  # 0 where a patch is not `usable`
    usable: Bool[Mask, "n k"]


class Learner:
    """Learner and scorer of appearance from one camera's pictures; the appearances are passed in and returned."""

    def __init__(self, camera: PlacedCamera, options: LooksOptions | None = None) -> None:
        self.options = options or LooksOptions()
        self.boosting = OnlineBoosting(self.options.boosting)
        self.describer = PatchDescriber(self.options.features)
        self.sampler = PatchSampler(camera, self.options.patches)

    @property
    def needs_foreground(self) -> bool:
        """True where pictures come with a foreground mask."""
        return False

    def trained(
        self,
        looks: Looks,
        people: PeopleInPicture,
        near: Bool[Mask, "n n"],
        clear: Bool[Mask, "n"],
        ns: int,
        rng: np.random.Generator,
    ) -> Looks:
        """Return the appearances updated by a picture. near: pairs that may be confused; clear: tracks whose position is
        certainly theirs alone.

        Trained are clear tracks near another clear one; without any, the picture is not evaluated.
        """
        confusable = near & clear & clear[:, None]
        waiting = confusable.any(axis=1).nonzero()[0]
        if waiting.size == 0:
            return looks
        # of those who have waited equally long, none is always last
        longest_first = np.lexsort((rng.random(waiting.size), looks.learned_ns[waiting]))
        served = np.sort(waiting[longest_first[: self.options.classifiers_a_frame]])
        pictured = np.flatnonzero(clear)
        # all people present may hide others, also those not learned from
        described = self._looked_at(people.rgb, self.sampler.drawn(people.places, rng).select(pictured))
        samples, label = self._samples(described, np.searchsorted(pictured, served), served[:, None] != pictured, rng)
        taught = (label > 0).any(axis=1) & (label < 0).any(axis=1)
        if self.options.background:
            background = self.sampler.drawn_next_to(people.places, self.options.background, rng)
            room = self._looked_at(people.rgb, background.select(served))
            samples = np.concatenate([samples, room.features], axis=1)
            label = np.concatenate([label, np.where(room.usable, -1.0, 0.0)], axis=1)
        strong = self.boosting.learned(looks.strong.select(served[taught]), samples[taught], label[taught])
        # tracks hidden from the camera queue behind the others
        return looks.changed(
            strong=looks.strong.replaced(served[taught], strong),
            learned_ns=written(looks.learned_ns, served[taught], ns),
            n_learned=written(looks.n_learned, served[taught], looks.n_learned[served[taught]] + 1),
        )

    def scores(
        self,
        looks: Looks,
        people: PeopleInPicture,
        whose: Int[Index, "q"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
    ) -> Float[Array, "q m"]:
        """Score the bodies of the people at `whose` against each of the tracks at `rows`, from −1 to 1.

        The mean score of its patches. NaN for an unknown track, or a body with too few visible patches.
        """
        drawn = self.sampler.drawn(people.places[whose], rng, self.options.maps.patches, people.places)
        described = self._looked_at(people.rgb, drawn)
        usable, chosen = described.usable, looks.select(rows)
        scores = np.full((len(usable), len(rows)), np.nan)
        if not usable.any() or len(rows) == 0:
            return scores
        each = np.zeros((len(rows), *usable.shape))
        each[:, usable] = chosen.strong.scores(described.features[usable])
        count = usable.sum(axis=1)
        mean = each.sum(axis=2).T / np.maximum(count, 1)[:, None]
        in_sight = usable.mean(axis=1) >= self.options.least_patches / self.options.patches.count
        return np.where(in_sight[:, None] & chosen.known, mean, np.nan)

    def score_maps(
        self,
        looks: Looks,
        people: PeopleInPicture,
        whose: Int[Index, "m"],
        rows: Int[Index, "m"],
        rng: np.random.Generator,
    ) -> ScoreMaps:
        """Return the score maps of a group of tracks at `rows`, expected where the people at `whose` are."""
        options, chosen = self.options.maps, looks.select(rows)
        patches = self.sampler.drawn_around(people.places[whose], options.reach_m, options.patches, rng)
        described = self._looked_at(people.rgb, patches)
        usable = described.usable
        features = described.features[usable]
        score = chosen.strong.scores(features) if len(features) else np.zeros((len(rows), 0))
        return ScoreMaps.of(patches.centre[usable], score, float(patches.side.mean()), options)

    def likelihood(self, maps: ScoreMaps) -> LogLikelihood:
        """Return the likelihood of the group's particles (components, m, p), the first two of them x and y [m], by its score
        maps.
        """

        def log_likelihood(state: Array) -> Array:
            places = state[:2].reshape(2, -1).T
            return maps.log_likelihood(
                self.sampler.middles(places).reshape(*state.shape[1:], 2), self.options.maps.outlier
            )

        return log_likelihood

    def _looked_at(self, rgb: Picture, patches: Patches) -> Described:
        usable = patches.shown.copy()
        side = np.broadcast_to(patches.side[:, None], usable.shape)
        size = self.describer.size
        features = np.zeros((*usable.shape, size + self.options.height))
        if usable.any():
            features[usable, :size] = self.describer.described(rgb, patches.centre[usable], side[usable])
        if self.options.height:
            features[..., size] = np.where(usable, patches.height_m, 0.0)
        return Described(features, usable)

    def _samples(
        self, described: Described, served: Int[Index, "s"], others: Bool[Mask, "s n"], rng: np.random.Generator
    ) -> tuple[Float[Array, "s k features"], Float[Array, "s k"]]:
        """Return for each trained track equal numbers of the others' patches and its own, and their labels; 0: no sample."""
        usable, count = described.usable, described.usable.shape[1]
        enough = usable.sum(axis=1) >= self.options.least_patches
        own = np.where(usable & enough[:, None], 1.0, 0.0)[served]
        allowed = (others[:, :, None] & (usable & enough[:, None])).reshape(len(served), -1)
        order = np.where(allowed, rng.random(allowed.shape), 2.0).argpartition(count - 1, axis=1)[:, :count]
        features = described.features.reshape(-1, described.features.shape[2])
        negative = np.where(np.take_along_axis(allowed, order, axis=1), -1.0, 0.0)
        samples = np.concatenate([described.features[served], features[order]], axis=1)
        return samples, np.concatenate([own, negative], axis=1)
