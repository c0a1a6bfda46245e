"""Re-identification by learning: identities after people met, by looks learned while they were separate.

Pictures are evaluated only while people interact or an identity is uncertain. A picture teaches the looks of interacting but
separate people, and draws the particles of correlated people to the score maps (eq. 1). After a group has split, the mean
scores of all tracks decide their identities together (`identities`), so that trajectories are linked through the merge. With
doubtful or unlearned looks, or without pictures, identities follow motion.

Ours: a merged group keeps a set of particles for each member, all of them at its place, rather than one for the group, since two
scanners seldom lose a body wholly; to change identities at a split is then to exchange those of tracks. Looks belong to
identities, and outlive tracks: a new track may be a person whose track was deleted. A picture tells of a track only where a
scanner or the camera shows it, alone. A track with more than one possible identity is not learned from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.filters.gating import linked
from trackers.filters.rows import written
from trackers.laser_vision_learning.colours import learner_of
from trackers.laser_vision_learning.identities import Beliefs, Calibration, IdentityOptions, decided
from trackers.laser_vision_learning.looks import Looks, LooksOptions, PeopleInPicture
from trackers.laser_vision_learning.score_maps import ScoreMaps, in_levels
from trackers.laser_vision_learning.situations import Situations
from trackers.laser_vision_learning.walking_model import WalkerTracks
from trackers.observations import NS_PER_S, DepthImage, Image
from trackers.rig import CameraSensor, placed_camera
from trackers.tracking.track_manager import measured_now, nanoseconds
from trackers.vision.foreground import Foreground

_NEVER = -1e4
"""Log-odds of the impossible."""
_LEAVES_S = 0.5
"""A person whose velocity leads out of the area within this time has left it [s]: no later track is that person."""


class RecognitionOptions(Strict):
    """Options of re-identification: the use of appearance."""

    fixed_values: ClassVar[Mapping[str, Any]] = {"within_s": 2.0, "back_after_s": None}

    at_splits: bool = Field(
        default=True, description="looks decide who is who when a group splits; no: motion (ablation)"
    )
    correlated: bool = Field(default=True, description="score maps draw the particles of who is correlated (eq. 1)")
    drawn: Literal["missed", "all"] = Field(
        default="missed",
        description="which of the correlated score maps draw: those that no scanner shows (ours), or all (paper, V.A)",
    )
    remember_s: float = Field(
        default=60.0,
        ge=0,
        description="how long the looks of a deleted track are remembered, for one that may be it [s] (ours)",
    )
    spread_m: ClassVar[float] = 0.02
    """Standard deviation of particles drawn to one position [m] (ours)."""


@dataclass(frozen=True)
class Decision:
    """Identities that were uncertain or changed: ids in the order of the tracks, before and after."""

    stamp_ns: int
    before: tuple[int, ...]
    after: tuple[int, ...]
    by_looks: tuple[bool, ...]  # else by motion
    margin: tuple[float, ...]


class Recognition:
    """Appearance, by one camera, of the scanners' tracks.

    empty_room: pictures of the room without people; without any, everything counts as foreground. inside: marks the places [m]
    that are in the area in which tracks are reported.
    """

    def __init__(
        self,
        camera: CameraSensor,
        empty_room: Sequence[Image | DepthImage],
        options: RecognitionOptions,
        looks: LooksOptions,
        identities: IdentityOptions,
        rng: np.random.Generator,
        inside: Callable[[Float[Array, "k 2"]], Bool[Mask, "k"]],
    ) -> None:
        self.options, self._identities, self._rng, self._inside = options, identities, rng, inside
        self.learner = learner_of(placed_camera(camera), looks)
        self._intrinsics, self._last_rgb = camera.intrinsics, np.zeros(0, np.uint8)
        masked = self.learner.needs_foreground and len(empty_room) > 0
        self._foreground = Foreground(camera.intrinsics, empty_room) if masked else None
        self._looks = Looks.unknown(0, looks)  # of the identities
        self._held_ns = np.zeros(0, np.int64)  # stamp at which a track held each of them last
        self._bound_for = np.zeros((0, 2))  # where that track was about to be [m]
        self._shown_ns = np.zeros(0, np.int64)  # stamp at which a track showed each of them last, for certain
        self._own = np.zeros(0, np.intp)  # place of each confirmed track's identity among them
        self._beliefs, self._calibration = Beliefs.none(), Calibration()
        self.decisions: list[Decision] = []
        """Decisions of the last call of `work`."""
        self.maps: list[tuple[Int[Index, "m"], ScoreMaps]] = []
        """Score maps of the last call of `work`, each with the serial numbers of its tracks."""

    def deciding(self, serial: Int[Index, "n"]) -> Bool[Mask, "n"]:
        """Return a mask of tracks from a split that are not yet identified."""
        return np.isin(serial, self._beliefs.serial[self._beliefs.doubtful])

    def work(self, people: WalkerTracks, now: Situations, image: Image | DepthImage | None, ns: int) -> WalkerTracks:
        """Return the tracks updated for a frame [ns] with its situations, and its picture if any.

        The picture is not evaluated without interaction. Raises InputError for one of another size than the camera's.
        """
        self.decisions, self.maps = [], []
        now, sure = now.of(people.serial), np.flatnonzero(people.roster.confirmed)
        self._note(people, now, sure, ns)
        shown = None
        if image is not None and (now.interacting.any() or self._beliefs.doubtful.any()):
            shown = self._shown(image, people, sure, ns)
        if shown is None:
            return people
        agree = np.ones(sure.size, np.bool_)
        if self.options.at_splits:
            score = self._look(people, now, sure, shown, ns)
            people = self._decide(people, sure, ns)
            agree = self._agree(score)
        people = self._drawn(people, now, sure, shown, ns)
        self._learn(people, now, sure, agree & ~self._beliefs.doubtful, shown, ns)
        return people

    def _shown(
        self, image: Image | DepthImage, people: WalkerTracks, sure: Int[Index, "n"], ns: int
    ) -> PeopleInPicture | None:
        """Return the picture with the confirmed tracks; None if it repeats the last one to the bit, from a frozen camera."""
        expected = (self._intrinsics.height, self._intrinsics.width, 3)
        if image.rgb.shape != expected:
            raise InputError(
                f"picture of {image.sensor!r} at {image.t:.3f} s is {image.rgb.shape[1]} x {image.rgb.shape[0]}; "
                f"{expected[1]} x {expected[0]}, as its intrinsics in the rig say, is expected"
            )
        if np.array_equal(image.rgb, self._last_rgb):
            return None
        self._last_rgb = image.rgb
        foreground = None if self._foreground is None else self._foreground.mask(image)
        late_s = (image.stamp_ns - ns) / NS_PER_S
        return PeopleInPicture(image.rgb, (people.places + late_s * people.velocities)[sure], foreground)

    def _note(self, people: WalkerTracks, now: Situations, sure: Int[Index, "n"], ns: int) -> None:
        """Add new identities, drop forgotten ones, and note which of them each confirmed track may have."""
        ids, before = people.roster.id[sure], self._beliefs
        remembered = self._looks.known & (ns - self._held_ns <= nanoseconds(self.options.remember_s))
        remembered &= self._inside(self._bound_for)
        kept = remembered | np.isin(before.number, ids)
        number = np.union1d(before.number[kept], ids)
        if not np.array_equal(number, before.number):
            old = np.isin(number, before.number[kept])
            looks = Looks.unknown(number.size, self.learner.options)
            self._looks = looks.replaced(old, self._looks.select(kept))
            self._held_ns = written(np.full(number.size, ns), old, self._held_ns[kept])
            self._bound_for = written(np.zeros((number.size, 2)), old, self._bound_for[kept])
            self._shown_ns = written(np.full(number.size, ns), old, self._shown_ns[kept])
        held = before.number[self._own]
        self._own = own = np.searchsorted(number, ids)
        self._held_ns = written(self._held_ns, own, ns)
        self._bound_for = written(self._bound_for, own, (people.places + _LEAVES_S * people.velocities)[sure])
        beliefs, known, rows = before.of(people.serial[sure], number), self._looks.known, np.arange(sure.size)
        # whose track has ended may be who has come up since that person was last shown
        new = ~np.isin(beliefs.serial, before.serial)
        since = people.roster.born_ns[sure].reshape(-1, 1) > self._shown_ns
        free = known & ~np.isin(number, ids)
        possible = beliefs.possible | (free & (new.reshape(-1, 1) | (np.isin(number, held) & since)))
        possible[rows, own] = True
        alone = measured_now(people.roster, ns)[sure] & ~now.interacting[sure].any(axis=1) & (possible.sum(axis=1) == 1)
        self._shown_ns = written(self._shown_ns, own[alone], ns)
        confused = now.confused[np.ix_(sure, sure)]
        beliefs = replace(beliefs, possible=possible).shared(confused)
        # where no classifier can tell, motion has decided
        moot = ~confused.any(axis=1) & ~(beliefs.possible & known).any(axis=1) | (not self.options.at_splits)
        only = number == ids[:, None]
        self._beliefs = replace(beliefs, possible=np.where(moot.reshape(-1, 1), only, beliefs.possible))

    def _look(
        self, people: WalkerTracks, now: Situations, sure: Int[Index, "n"], shown: PeopleInPicture, ns: int
    ) -> Float[Array, "n m"]:
        """Add the scores in one more picture of tracks that are measured and alone, and return them; NaN for others."""
        score = np.full(self._beliefs.possible.shape, np.nan)
        known = np.flatnonzero(self._looks.known)
        rows = np.flatnonzero((_seen_ns(people)[sure] == ns) & ~now.confused[sure].any(axis=1))
        if known.size == 0 or rows.size == 0:
            return score
        score[np.ix_(rows, known)] = self.learner.scores(self._looks, shown, rows, known, self._rng)
        self._beliefs = beliefs = self._beliefs.scored(score, self._identities.memory)
        certain = ~beliefs.doubtful & self._agree(score)
        mean = np.where(np.isfinite(score), beliefs.mean(self._identities.pictures), np.nan)[certain]
        place = np.arange(beliefs.number.size)
        own, scored = place == self._own[certain, None], np.isfinite(mean)
        others = ~own & np.isin(place, self._own[certain])
        self._calibration = self._calibration.updated(mean[scored & own], mean[scored & others])
        return score

    def _decide(self, people: WalkerTracks, sure: Int[Index, "n"], ns: int) -> WalkerTracks:
        """Assign identities to all tracks by their mean scores and their continuity."""
        beliefs, rules = self._beliefs, self._identities
        doubtful, mean, before = beliefs.doubtful, beliefs.mean(rules.pictures), people.roster.id[sure]
        scored = np.logical_or.reduce(np.isfinite(mean), axis=1)
        if not scored.any():
            return people
        log_odds = self._calibration.log_ratio(mean)
        log_odds[~beliefs.possible] += _NEVER
        # a track that may be somebody who was lost has taught the looks of its own identity itself
        free = self._looks.known & ~np.isin(beliefs.number, before)
        row = np.flatnonzero((beliefs.possible & free).any(axis=1))
        log_odds[row, self._own[row]] = np.minimum(log_odds[row, self._own[row]], 0.0)
        found = decided(log_odds, self._own, rules.margin)
        certain, ids = found.by_looks & scored, beliefs.number[found.column]
        if rules.jointly:
            certain &= ~doubtful | beliefs.compared(scored)
        self._own = found.column
        self._beliefs = beliefs.resolved(certain, self._own)
        news = np.flatnonzero((ids != before) | (certain & doubtful))
        if news.size:
            columns = (before[news], ids[news], found.by_looks[news], found.margin[news])
            self.decisions.append(Decision(ns, *(tuple(each.tolist()) for each in columns)))
        return people.changed(roster=people.roster.changed(id=written(people.roster.id, sure, ids)))

    def _agree(self, score: Float[Array, "n m"]) -> Bool[Mask, "n"]:
        """Return a mask of the tracks whose identity is unknown by looks, or resembles them most in a picture."""
        known = self._looks.known[self._own]
        own = np.where(known, self._own, 0)  # identities of nobody known before have no scores yet
        return ~known | (score[np.arange(own.size), own] >= np.fmax.reduce(score, axis=1, initial=-np.inf))

    def _learn(
        self,
        people: WalkerTracks,
        now: Situations,
        sure: Int[Index, "n"],
        certain: Bool[Mask, "n"],
        shown: PeopleInPicture,
        ns: int,
    ) -> None:
        """Let the classifiers learn of tracks that are measured and alone, and whose identity is certain."""
        alone = measured_now(people.roster, ns) & ~(now.merged | now.correlated).any(axis=1)
        near = now.interacting[np.ix_(sure, sure)]
        looks, certain = self._looks.select(self._own), alone[sure] & certain
        self._shown_ns = written(self._shown_ns, self._own[certain], ns)
        looks = self.learner.trained(looks, shown, near, certain, ns, self._rng)
        self._looks = self._looks.replaced(self._own, looks)

    def _drawn(
        self, people: WalkerTracks, now: Situations, sure: Int[Index, "n"], shown: PeopleInPicture, ns: int
    ) -> WalkerTracks:
        """Draw the particles of correlated people, all or the missed ones, to the score maps of a picture."""
        known = self._looks.known[self._own] & ~self._beliefs.doubtful
        moved = known & now.correlated[sure].any(axis=1)
        if self.options.drawn == "missed":
            moved &= ~measured_now(people.roster, ns)[sure]
        if not (self.options.correlated and moved.any()):
            return people
        label = linked(now.correlated[np.ix_(sure, sure)] & known & known[:, None])
        cloud, levels = people.cloud, self.learner.options.maps.levels
        for each in np.unique(label[moved]).tolist():
            rows = np.flatnonzero((label == each) & known)
            maps = self.learner.score_maps(self._looks, shown, rows, self._own[rows], self._rng)
            self.maps.append((people.serial[sure[rows]], maps))
            drawn = in_levels(cloud.select(sure[rows]), self.learner.likelihood(maps), levels, self._spread, self._rng)
            cloud = cloud.replaced(sure[rows[moved[rows]]], drawn.select(moved[rows]))
        return people.changed(roster=people.roster.changed(state=cloud))

    def _spread(self, state: Array, rng: np.random.Generator) -> Array:
        moved = state.copy()
        moved[:2] += self.options.spread_m * rng.standard_normal(moved[:2].shape)
        return moved


def _seen_ns(people: WalkerTracks) -> Int[Index, "n"]:
    """Stamps at which a scanner or the camera showed each track last."""
    return np.maximum(people.roster.measured_ns, people.pictured_ns)
