"""Re-identification by learning: identities after people met, by classifiers that learned while they were separate.

Pictures are evaluated only while people interact. A picture trains the classifiers of interacting but separate people, and
draws the particles of correlated people to the score maps (eq. 1). When a group splits, the scores of its members, summed
over a few pictures, decide their identities, which are then exchanged among the group's tracks, so that trajectories are
linked through the merge. With doubtful or untrained appearance, or without pictures, identities follow motion; `Decision`
says which.

Ours: a merged group keeps a set of particles for each member, all of them at its place, rather than one for the group, since two
scanners seldom lose a body wholly; to change identities at a split is then to exchange those of tracks. A picture tells of a
member only where a scanner or the camera shows it, alone; the decision waits for such pictures. Who is new or back beside others
is decided on with them, as after a split.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from pydantic import Field

from trackers.arrays import Array, Bytes, Index, Mask
from trackers.configuration import Strict
from trackers.errors import InputError
from trackers.filters.gating import linked
from trackers.filters.rows import written
from trackers.laser_vision_learning.identities import Identities, IdentityOptions, decided
from trackers.laser_vision_learning.looks import Learner, Looks, LooksOptions
from trackers.laser_vision_learning.score_maps import ScoreMaps, in_levels
from trackers.laser_vision_learning.situations import Situations
from trackers.laser_vision_learning.walking import People
from trackers.observations import NS_PER_S, DepthImage, Image
from trackers.rig import CameraSensor, placed_camera
from trackers.tracking.track_manager import measured_now, nanoseconds
from trackers.vision.foreground import Foreground


class RecognitionOptions(Strict):
    """Options of re-identification: the use of appearance, and its weight against motion."""

    at_splits: bool = Field(
        default=True, description="looks decide who is who when a group splits; no: motion (ablation)"
    )
    correlated: bool = Field(default=True, description="score maps draw the particles of who is correlated (eq. 1)")
    drawn: Literal["missed", "all"] = Field(
        default="missed",
        description="which of the correlated score maps draw: those that no scanner shows (ours), or all (paper, V.A)",
    )
    within_s: float = Field(default=2.0, gt=0, description="how long a decision waits for its pictures [s] (ours)")
    back_after_s: float | None = Field(
        default=0.3,
        gt=0,
        description="looks decide too who a track is that nothing showed for longer, or that is new, when it is seen beside "
        "others [s]; null: at splits alone (ours)",
    )
    spread_m: ClassVar[float] = 0.02
    """Standard deviation of particles drawn to one position [m] (ours)."""


@dataclass(frozen=True)
class Decision:
    """Identities after a split: ids in the order of the tracks, before and after."""

    stamp_ns: int
    before: tuple[int, ...]
    after: tuple[int, ...]
    by_looks: tuple[bool, ...]  # else by motion
    margin: tuple[float, ...]


@dataclass
class _Split:
    """Group that split, until its q members are identified."""

    serial: Int[Index, "q"]
    since_ns: int
    score: Float[Array, "q q"]  # sum over pictures
    n_score: Float[Array, "q q"]  # number of pictures

    @classmethod
    def of(cls, serial: Int[Index, "q"], ns: int) -> _Split:
        """Make a split without pictures yet."""
        return cls(serial, ns, np.zeros((serial.size,) * 2), np.zeros((serial.size,) * 2))

    def add(self, score: Float[Array, "q q"]) -> None:
        """Add the scores of one more picture; NaN without effect."""
        scored = np.isfinite(score)
        self.score, self.n_score = self.score + np.where(scored, score, 0.0), self.n_score + scored

    @property
    def n_picture(self) -> int:
        """Number of pictures of the body with fewest."""
        return int(self.n_score.max(axis=1).min())

    @property
    def mean(self) -> Float[Array, "q q"]:
        """Mean over the pictures; NaN without any."""
        return np.where(self.n_score > 0, self.score / np.maximum(self.n_score, 1), np.nan)

    def among(self, serial: Int[Index, "n"]) -> _Split:
        """Return the split without deleted tracks."""
        kept = np.isin(self.serial, serial)
        both = np.ix_(kept, kept)
        return _Split(self.serial[kept], self.since_ns, self.score[both], self.n_score[both])


@dataclass(frozen=True, eq=False)
class _Shown:
    """A picture, and the positions of all tracks at its stamp."""

    rgb: UInt8[Bytes, "height width 3"]
    foreground: Bool[Mask, "height width"] | None
    places: Float[Array, "n 2"]


class Recognition:
    """Appearance, by one camera, of the scanners' tracks.

    empty_room: pictures of the room without people; without any, everything counts as foreground.
    """

    def __init__(
        self,
        camera: CameraSensor,
        empty_room: Sequence[Image | DepthImage],
        options: RecognitionOptions,
        looks: LooksOptions,
        identities: IdentityOptions,
        rng: np.random.Generator,
    ) -> None:
        self.options, self._identities, self._rng = options, identities, rng
        self.learner = Learner(placed_camera(camera), looks)
        self._intrinsics, self._last_rgb = camera.intrinsics, np.zeros(0, np.uint8)
        masked = self.learner.needs_foreground and len(empty_room) > 0
        self._foreground = Foreground(camera.intrinsics, empty_room) if masked else None
        self._looks, self._serial = Looks.unknown(0, looks), np.zeros(0, np.int64)
        self._before = Situations.none(self._serial)
        self._seen_ns = np.zeros(0, np.int64)
        self._splits: list[_Split] = []
        self.decisions: list[Decision] = []
        """Decisions of the last call of `work`."""
        self.maps: list[tuple[Int[Index, "m"], ScoreMaps]] = []
        """Score maps of the last call of `work`, each with the serial numbers of its tracks."""

    def deciding(self, serial: Int[Index, "n"]) -> Bool[Mask, "n"]:
        """Return a mask of tracks from a split that are not yet identified."""
        waiting = [each.serial for each in self._splits]
        return np.isin(serial, np.concatenate(waiting)) if waiting else np.zeros(serial.size, np.bool_)

    def work(self, people: People, now: Situations, image: Image | DepthImage | None, ns: int) -> People:
        """Return the tracks updated for a frame [ns] with its situations, and its picture if any.

        The picture is not evaluated without interaction. Raises InputError for one of another size than the camera's.
        """
        self.decisions, self.maps = [], []
        now = now.of(people.serial)
        self._align(people.serial)
        self._note_splits(people, now, ns)
        shown = None
        if image is not None and (now.interacting.any() or self._splits):
            shown = self._shown(image, people, ns)
        if shown is not None:
            self._look(people, now, shown, ns)
            people = self._drawn(people, now, shown, ns)
        people = self._decide(people, ns)
        if shown is not None:
            alone = people.roster.confirmed & measured_now(people.roster, ns) & ~self.deciding(people.serial)
            alone &= ~(now.merged | now.correlated).any(axis=1)
            self._looks = self.learner.trained(
                self._looks, shown.rgb, shown.places, now.interacting, alone, ns, self._rng, shown.foreground
            )
        self._before, self._seen_ns = now, _seen_ns(people)
        return people

    def _shown(self, image: Image | DepthImage, people: People, ns: int) -> _Shown | None:
        """Return the picture; None if it repeats the last one to the bit, from a frozen camera."""
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
        return _Shown(image.rgb, foreground, people.places + late_s * people.velocities)

    def _align(self, serial: Int[Index, "n"]) -> None:
        """Add appearances of new tracks, and drop those of deleted ones."""
        if np.array_equal(serial, self._serial):
            return
        kept = np.isin(self._serial, serial)
        new = np.setdiff1d(serial, self._serial)  # serial numbers rise, so new ones come last
        self._looks = self._looks.select(kept).joined(Looks.unknown(new.size, self.learner.options))
        seen_ns = np.concatenate([self._seen_ns[kept], np.zeros(new.size, np.int64)])
        self._serial, self._seen_ns = serial, seen_ns
        left = [each.among(serial) for each in self._splits]
        self._splits = [each for each in left if each.serial.size > 1]

    def _note_splits(self, people: People, now: Situations, ns: int) -> None:
        """Note groups that came apart since the moment before, and who is back or new beside others.

        All who were in a group, or may be taken for one who is back, are decided on together.
        """
        before, known = self._before.of(people.serial).group, people.roster.confirmed
        apart = (before[:, None] == before) & (now.group[:, None] != now.group) & known & known[:, None]
        doubtful = (before[:, None] == before) & apart.any(axis=1)[:, None]
        if self.options.back_after_s is not None:
            missed = ns - self._seen_ns > nanoseconds(self.options.back_after_s)
            doubtful |= now.interacting & (known & missed & (_seen_ns(people) == ns))[:, None]
        doubtful &= known & known[:, None] & ~np.eye(known.size, dtype=np.bool_)
        if not doubtful.any():
            return
        label = linked(doubtful | doubtful.T)
        for each in np.unique(label[doubtful.any(axis=1)]).tolist():
            members = [people.serial[label == each]]
            overlap = [np.isin(each.serial, members[0]).any() for each in self._splits]
            members += [each.serial for each, with_them in zip(self._splits, overlap, strict=True) if with_them]
            self._splits = [each for each, with_them in zip(self._splits, overlap, strict=True) if not with_them]
            self._splits.append(_Split.of(np.unique(np.concatenate(members)), ns))

    def _look(self, people: People, now: Situations, shown: _Shown, ns: int) -> None:
        """Add the scores in one more picture of split members that are measured and alone."""
        if not self.options.at_splits:
            return
        alone = (_seen_ns(people) == ns) & ~now.confused.any(axis=1)
        others = shown.places[people.roster.confirmed]
        for split in self._splits:
            rows = np.searchsorted(people.serial, split.serial)
            if alone[rows].any():
                score = self.learner.scores(
                    self._looks, shown.rgb, shown.places[rows], rows, self._rng, shown.foreground, others
                )
                split.add(np.where(alone[rows, None], score, np.nan))

    def _decide(self, people: People, ns: int) -> People:
        """Assign identities after enough pictures, or after a long time without any."""
        waiting = []
        for split in self._splits:
            patient = self.options.at_splits and ns - split.since_ns < nanoseconds(self.options.within_s)
            if split.n_picture < self._identities.pictures and patient:
                waiting.append(split)
                continue
            stays = np.eye(split.serial.size)
            found = decided(split.mean, 1 - stays, self._identities)
            people = self._dealt_out(people, np.searchsorted(people.serial, split.serial), found, ns)
        self._splits = waiting
        return people

    def _dealt_out(self, people: People, rows: Int[Index, "q"], found: Identities, ns: int) -> People:
        source, ids = rows[found.member], people.roster.id
        self._looks = self._looks.replaced(rows, self._looks.select(source))
        decided = (ids[rows], ids[source], found.by_looks, found.margin)
        self.decisions.append(Decision(ns, *(tuple(each.tolist()) for each in decided)))
        return people.changed(roster=people.roster.changed(id=written(ids, rows, ids[source])))

    def _drawn(self, people: People, now: Situations, shown: _Shown, ns: int) -> People:
        """Draw the particles of correlated people, all or the missed ones, to the score maps of a picture."""
        known = self._looks.known & people.roster.confirmed & ~self.deciding(people.serial)
        moved = known & now.correlated.any(axis=1)
        if self.options.drawn == "missed":
            moved &= ~measured_now(people.roster, ns)
        if not (self.options.correlated and moved.any()):
            return people
        label = linked(now.correlated & known & known[:, None])
        cloud, levels = people.cloud, self.learner.options.maps.levels
        for each in np.unique(label[moved]).tolist():
            rows = np.flatnonzero((label == each) & known)
            maps = self.learner.score_maps(
                self._looks, shown.rgb, shown.places[rows], rows, self._rng, shown.foreground
            )
            self.maps.append((people.serial[rows], maps))
            drawn = in_levels(cloud.select(rows), self.learner.likelihood(maps), levels, self._spread, self._rng)
            cloud = cloud.replaced(rows[moved[rows]], drawn.select(moved[rows]))
        return people.changed(roster=people.roster.changed(state=cloud))

    def _spread(self, state: Array, rng: np.random.Generator) -> Array:
        moved = state.copy()
        moved[:2] += self.options.spread_m * rng.standard_normal(moved[:2].shape)
        return moved


def _seen_ns(people: People) -> Int[Index, "n"]:
    """Stamps at which a scanner or the camera showed each track last."""
    return np.maximum(people.roster.measured_ns, people.pictured_ns)
