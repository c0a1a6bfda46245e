"""The people that `fusion` follows: body, head, existence, posture, and what tells them from others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.imm import ImmState
from trackers.filters.rows import Rows, marked, written
from trackers.fusion.heads import WALKS_M_S, Heads
from trackers.fusion.look import Expected
from trackers.fusion.options import HeadEvidenceOptions
from trackers.fusion.person_state import CROWN_M, HEAD, PLACE, crowns_over, drifted, seen_over_modes
from trackers.fusion.posture import OFF_BODY, Posture
from trackers.fusion.weights import Weights
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS, ImmTracks, Roster
from trackers.vision.histogram import chi_squared_distance

_USUAL_STATURE_M, _STATURE_M, _LEAST_STATURE_M = 1.7, 0.2, 1.0
"""Mean and standard deviation of statures that are not known, and that of small children [m]: who is lower does not stand."""
_SHOWN_S, _HEAD_UP = 0.5, 0.84
"""A head that a picture showed no longer ago [s] is that of who stands from this share of the stature on."""
_REST_S = 2.0
"""Time constant of the mean of places that a source measures of people who rest [s]."""
_STILL_M_S = 0.15
"""Standard deviation of the speed of trunks over their seats: who moves is sitting or lying down, or gets up [m/s]."""
_LEANING = 0.25
"""Share of the time in which seats of who leans are learned: the head of who tips over draws the trunk along; some sit low."""
_TRUNK, _LEANS_BELOW = 0.42, 0.71
"""Distance of the middle of a head from the pelvis, and its height below which a trunk leans, in the stature: a little less than
that of who sits upright."""
_STANDS = 0.9
"""Probability of standing from which a head tells a stature that is not known."""
_SINKS_S, _SURE_M = 20.0, 0.06
"""Time constant in which a stature sinks to a lower head [s], and standard deviation of a height by which one is known [m]."""


@dataclass(frozen=True, eq=False)
class Clothes(Rows):
    """Colours of the clothes of n people: of each identity, and as its track has shown them lately."""

    LATELY_S: ClassVar[float] = 0.4
    """Time constant of what a track has shown lately [s]; no look counts more than half."""

    reference: Float[Array, "n bins"]  # histogram of the person's clothes
    n_look: Int[Index, "n"]  # looks learned; 0: not known
    learned_ns: Int[Index, "n"]  # stamp of the last of them
    learned_at: Float[Array, "n 2"]  # and where the person was then [m]
    lately: Float[Array, "n bins"]  # histogram of the last looks
    looked_ns: Int[Index, "n"]  # stamp of the last of them

    @classmethod
    def unknown(cls, n: int, n_colour: int) -> Self:
        """Make clothes at which nobody has looked."""
        none, never = np.zeros((n, n_colour)), np.full(n, NEVER_NS)
        return cls(none, np.zeros(n, np.int64), never, np.full((n, 2), np.nan), none, never)

    @property
    def known(self) -> Bool[Mask, "n"]:
        """Mark the clothes that have been looked at."""
        return self.n_look > 0

    def looked(
        self,
        row: Int[Index, "k"],
        histogram: Float[Array, "k bins"],
        place: Float[Array, "k 2"],
        doubtful: Bool[Mask, "k"],
        ns: int,
        learns_s: float,
    ) -> Self:
        """Return the clothes after clear looks at those at `row`, at places [m]; doubtful: that may be at another person's."""
        since_s = (ns - self.looked_ns[row]) / NS_PER_S
        first = self.n_look[row] == 0
        kept = np.where(first, 0.0, np.maximum(np.exp(-since_s / self.LATELY_S), 0.5))[:, None]
        lately = written(self.lately, row, kept * self.lately[row] + (1 - kept) * histogram)
        looked_ns = written(self.looked_ns, row, ns)
        row, histogram, place = row[~doubtful], histogram[~doubtful], place[~doubtful]
        since_s, n_look = (ns - self.learned_ns[row]) / NS_PER_S, self.n_look[row]
        kept = np.minimum(np.exp(-since_s / learns_s), 1 - 1 / (n_look + 1))[:, None]  # a mean at first
        return type(self)(
            reference=written(self.reference, row, kept * self.reference[row] + (1 - kept) * histogram),
            n_look=written(self.n_look, row, n_look + 1),
            learned_ns=written(self.learned_ns, row, ns),
            learned_at=written(self.learned_at, row, place),
            lately=lately,
            looked_ns=looked_ns,
        )

    def distance(self, tracks: Self) -> Float[Array, "n k"]:
        """Return χ² distances of these clothes and those that tracks have shown lately, NaN where either are not known."""
        away = chi_squared_distance(self.reference, tracks.lately)
        return np.where(self.known[:, None] & tracks.known, away, np.nan)

    def of(self, identity: Self, taken: Bool[Mask, "n"]) -> Self:
        """Return the clothes of identities on tracks that have shown these lately; others than those taken keep their own."""
        return self.changed(
            reference=np.where(taken[:, None], identity.reference, self.reference),
            n_look=np.where(taken, identity.n_look, self.n_look),
            learned_ns=np.where(taken, identity.learned_ns, self.learned_ns),
            learned_at=np.where(taken[:, None], identity.learned_at, self.learned_at),
        )


@dataclass(frozen=True, eq=False)
class People(ImmTracks):
    """n tracks, oldest first."""

    roster: Roster[ImmState]
    heads: Heads
    clothes: Clothes
    weights: Weights
    stature_m: Float[Array, "n"]  # NaN: not known
    place: Float[Array, "n 2"]  # after the last measurement [m]
    offset_m2: Float[Array, "n"]  # variance of what stays of the errors, on each axis
    existence: Float[Array, "n"]
    posture: Posture
    doubled_s: Float[Array, "n"]  # for how long they have been where an older track is [s]
    seen_ns: Int[Index, "n s"]  # by each source, the stamp of the last measurement
    seen_at: Float[Array, "n s 2"]  # and its place [m]
    rest_at: Float[
        Array, "n s 2"
    ]  # mean place of its measurements while they sit or lie, else that of the last one [m]

    @classmethod
    def started(cls, state: ImmState, place: Float[Array, "n 2"], ns: int, n_colour: int, n_source: int) -> Self:
        """Make tentative tracks measured at places [m] at stamp ns."""
        n = len(place)
        return cls(
            roster=Roster.started(state, ns),
            heads=Heads.over(n),
            clothes=Clothes.unknown(n, n_colour),
            weights=Weights.unknown(n),
            stature_m=np.full(n, np.nan),
            place=place,
            offset_m2=np.zeros(n),
            existence=np.full(n, 0.5),
            posture=Posture.upright(n),
            doubled_s=np.zeros(n),
            seen_ns=np.full((n, n_source), NEVER_NS),
            seen_at=np.full((n, n_source, 2), np.nan),
            rest_at=np.full((n, n_source, 2), np.nan),
        )

    @property
    def velocity(self) -> Float[Array, "n 2"]:
        """Each track's velocity over its modes [m/s]."""
        return self.state.mean_over_modes[2:4].T

    @property
    def covariance(self) -> Float[Array, "n 2 2"]:
        """Covariance of the place over the modes [m²]."""
        return seen_over_modes(self.state, PLACE)[1]

    @property
    def head(self) -> Float[Array, "n 3"]:
        """Places of heads over the modes [m]."""
        return self.state.mean_over_modes.T @ HEAD.T

    @property
    def head_covariance(self) -> Float[Array, "n 3 3"]:
        """Covariances of places of heads over the modes [m²]."""
        return seen_over_modes(self.state, HEAD)[1]

    @property
    def crowns(self) -> Float[Array, "n 3"]:
        """Places [m], and above them the heights of the crowns: what hides others."""
        return crowns_over(self.positions, self.head)

    @property
    def legs(self) -> Float[Array, "n 2"]:
        """Offsets of the middles of legs from the places, over the modes [m]."""
        return self.state.mean_over_modes[7:].T

    @property
    def stature(self) -> Float[Array, "n"]:
        """Statures [m], the usual one where it is not known."""
        return np.where(np.isnan(self.stature_m), _USUAL_STATURE_M, self.stature_m)

    @property
    def stature_m2(self) -> Float[Array, "n"]:
        """Variances of statures [m²]: 0 of those that are known."""
        return np.where(np.isnan(self.stature_m), _STATURE_M**2, 0.0)

    @property
    def leaning_m2(self) -> Float[Array, "n"]:
        """Variances, on each axis, by which heads may be off the pelvis as trunks lean [m²]; 0: they are upright.

        A head that sinks below that of who sits upright goes aside as well: it stays on the arc of its trunk.
        """
        trunk_m, head_m = _TRUNK * self.stature, self.head[:, 2] + np.sqrt(self.stature_m2)
        up_m = trunk_m - np.clip(_LEANS_BELOW * self.stature - head_m, 0.0, trunk_m)
        return (trunk_m**2 - up_m**2) / 2

    def with_parts_later(self, elapsed_s: float, options: HeadEvidenceOptions) -> Self:
        """Return them with heads and legs where they drift to over their bodies in a time [s], by posture."""
        posture, head_rate = self.posture, np.full(len(self), 1 / options.stays_s)
        height_m, spread_m2 = posture.head_height(self.stature)
        flat_m2 = options.over_body_m**2 * posture.shown(OFF_BODY) + self.leaning_m2
        legs_m2, legs_rate = posture.legs_there()
        kept = np.exp(-elapsed_s * np.stack([head_rate, head_rate, head_rate, legs_rate, legs_rate]))
        variance_m2 = np.stack([flat_m2, flat_m2, spread_m2 + self.stature_m2, legs_m2, legs_m2])
        return self.in_state(drifted(self.state, kept, height_m, variance_m2))

    def expected(self, by_trunk: Bool[Mask, "n"], ns: int) -> Expected:
        """Return what sources get of the tracks at stamp ns; by_trunk: those of whom a trunk was measured lately."""
        angle, length = self.heads.direction
        facing = (length * np.array([np.cos(angle), np.sin(angle)])).T
        speed_m_s, on_feet = np.hypot(*self.velocity.T), self.weights.on_feet(ns)
        weight_n = np.where(self.confirmed, self.weights.newtons, np.nan)
        return Expected(
            self.positions, self.head, self.legs, speed_m_s, facing, by_trunk, weight_n, on_feet, self.confirmed
        )

    def risen(
        self,
        posture: Posture,
        row: Int[Index, "p"],
        off_m: Float[Array, "p"],
        of_legs: Bool[Mask, "p"],
        share: Float[Array, "p"],
        ns: int,
    ) -> Posture:
        """Return postures of who moves, or is measured off where they rested [m]: a head that is up is of nobody who lies down.

        share: of the evidence.
        """
        seen = ns - self.heads.seen_ns <= _SHOWN_S * NS_PER_S
        least_m = _HEAD_UP * np.where(np.isnan(self.stature_m), _LEAST_STATURE_M, self.stature_m)
        is_up = seen & (self.head[:, 2] >= least_m)
        by_row = np.lexsort((-share, row))
        once = marked(
            row.size, by_row[np.unique(row[by_row], return_index=True)[1]]
        )  # all sensors have one speed together
        speed_m_s = np.where(once, np.hypot(*self.velocity[row].T), 0.0)
        return posture.by_place(row, off_m, of_legs, is_up[row], speed_m_s, share)

    def off_rest(
        self,
        row: Int[Index, "p"],
        number: Int[Index, "p"],
        place: Float[Array, "p 2"],
        since_s: Float[Array, "p"],
        ns: int,
    ) -> tuple[Float[Array, "p"], Float[Array, "n s 2"]]:
        """Return how far sources measure people at `row` from where they did while these rest [m], and the means with these.

        place: measured by sources `number` at stamp ns [m]; since_s: time since each measured them last. The part of a body that
        one source shows, and its errors, are alike: its mean tells who moves. The mean begins where the source measured them
        within a second before they rested, or first since then.
        """
        before = np.where(self.posture.rests[row, None], self.rest_at[row, number], np.nan)
        off = np.where(np.isnan(before), 0.0, place - before)
        gain = 1 - np.exp(-since_s / _REST_S)
        rest_at = self.rest_at.copy()
        rest_at[~self.posture.rests[:, None] & (ns - self.seen_ns > NS_PER_S)] = np.nan
        rest_at[row, number] = place - (1 - gain)[:, None] * off
        return np.hypot(*off.T), rest_at

    def settled(self, place: Float[Array, "n 2"], since_s: Float[Array, "n"]) -> Posture:
        """Return postures with seats learned at places [m] of who sits still, slowly of who leans; see `Posture.settled`."""
        still = np.exp(-0.5 * (np.hypot(*self.velocity.T) / _STILL_M_S) ** 2)
        still *= np.where(self.leaning_m2 > 0, _LEANING, 1.0)
        return self.posture.settled(place, self.legs, since_s * still)

    def with_heads(self, heads: Heads, due: Bool[Mask, "n"], ns: int) -> Self:
        """Return the people with their heads after pictures that did not show those due.

        The stature of a walker whose head must be elsewhere is not known any more: a chest was taken for a head. Who does not
        walk may sit down.
        """
        walks = (self.posture.probability[:, 0] > 0.5) & (np.hypot(*self.velocity.T) > WALKS_M_S)
        heads, elsewhere = heads.awaited(due & walks, ns)
        return self.changed(heads=heads, stature_m=np.where(elsewhere, np.nan, self.stature_m))

    def learn_stature(
        self,
        row: Int[Index, "k"],
        height_m: Float[Array, "k"],
        variance_m2: Float[Array, "k"],
        since_s: Float[Array, "k"],
        grows_s: float,
    ) -> Self:
        """Learn the statures of people at `row` by heights of their heads, while they stand: sooner higher ones than lower.

        since_s: since their heads were seen before [s]; no look counts more than half.
        """
        crown, old = height_m + CROWN_M, self.stature_m[row]
        stands = self.posture.probability[row, 0]
        rate = np.where(crown > old, 1 / grows_s, stands / _SINKS_S)
        learned = old + np.minimum(1 - np.exp(-rate * since_s), 0.5) * (crown - old)
        sure = variance_m2 < _SURE_M**2
        first = np.where((stands > _STANDS) & sure & (crown > _LEAST_STATURE_M), crown, np.nan)
        return self.changed(stature_m=written(self.stature_m, row, np.where(np.isnan(old), first, learned)))

    def identified_as(self, identity: Self, *, exchanged: bool = False) -> Self:
        """Return the tracks as those of other identities: numbers and attributes; what they show lately stays theirs.

        exchanged: they have shown other people than these so far. Else what they have learned themselves is of these people too,
        and stays where nothing is known of the identities.
        """
        roster = self.roster.changed(
            id=identity.roster.id, confirmed=identity.confirmed, born_ns=identity.roster.born_ns
        )
        unknown = np.isnan(identity.stature_m) & (not exchanged)
        return self.changed(
            roster=roster,
            clothes=self.clothes.of(identity.clothes, identity.clothes.known | exchanged),
            weights=self.weights.of(identity.weights, identity.weights.known | exchanged),
            stature_m=np.where(unknown, self.stature_m, identity.stature_m),
        )
