"""Evidence that a track is a person, of the legs that are shared out to it, of the map, of its motion and of its misses.

Each track carries fading sums of what its scans showed. Of these a forest (`trackers.laser.legs.classifier.Forest`) makes the
logarithm of the odds that a person is there [nat]. It was taught on tracks in drawn rooms, by scanners that stand and that drive
(`scripts/learn-legs`). One scan after the other shows nearly the same, so that their evidence cannot be added up; what a longer
look is worth is learned as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.imm import ImmState
from trackers.filters.rows import Rows, written
from trackers.frames.sensor_frame import SightCounts
from trackers.laser.clusters import STRIDE_M, Clusters

TRACK_FEATURES = (
    "legs", "second_leg", "best_leg", "both", "looks_s", "missed", "farthest", "speed", "age", "range",
    "driven", "free_share", "free", "hit", "spread", "beside",
    "varies", "samples", "width", "width_varies", "around", "surprise", "gap", "last", "driving", "spacing", "near", "rival",
    "gap_varies", "period", "stay", "free_here", "hit_here", "others", "people", "leglike",
)  # fmt: skip
"""Names of what the forest is shown of a track, in their order."""
SHOWN = ("look", "leg", "second_leg", "both", "leg²", "samples", "width", "width²", "around", "surprise", "gap", "gap²")
"""Names of what a look adds to a track's sums, in their order."""
MEMORY_S = 1.0
"""Time over which looks are summed [s]."""
NO_LEG = -4.0
"""Evidence of a leg that is not seen [nat]."""
_LEG_M = 0.2
"""Standard deviation of a leg about its person, on each axis [m]."""
_OTHERS_PER_M2 = 0.1
"""Density of clusters that are not this person's legs."""
_MOST = 2.0
"""More evidence says nothing about whose leg it is: another person's leg has it as well [nat]."""
_NO_RIVAL = -6.0
_PLACE_M = 0.4
"""A track farther than this from the place that it came to has left it [m]."""
_KNOWN_S = 0.5
"""Age of a track by which its existence says what the scene is like [s]."""
_PRIOR = (0.3, 2.0)
"""People, of so many tracks, in a scene of which nothing is known."""
_BEFORE_S = 0.3
"""Looks until so long before a track was there do not see it yet [s]."""
_BESIDE_M, _NEAR_M, _RIVAL_M, _AROUND_M = 2.0, 1.5, 1.0, 1.5


@dataclass(frozen=True, eq=False)
class LegTracks(Rows):
    """State of n tracks: the filter's, and the sums of evidence; positions are in the fixed frame."""

    filter: ImmState
    sums: Float[Array, "n shown"]  # fading sums over time [s] of `SHOWN`
    missed: Float[Array, "n"]  # fading mean of the detection probability of misses
    best: Float[Array, "n"]  # highest evidence of a leg [nat]
    last: Float[Array, "n"]  # evidence in the last scan [nat]
    born_at: Float[Array, "n 2"]  # first position [m]
    seen_from: Float[Array, "n 2"]  # where the scanner was then [m]
    born_by: Int[Index, "n"]  # which scanner started it
    scanner: Int[Index, "n"]  # which scanner measured it last: only its scans tell whether the person exists
    farthest: Float[Array, "n"]  # greatest distance from the first position [m]
    free: Float[Array, "n"]  # looks before the track that saw its place free
    hit: Float[Array, "n"]  # looks before the track that saw something there
    place: Float[Array, "n 2"]  # that it came to last, and has been about since [m]
    came_s: Float[Array, "n"]  # when it came there [s]
    free_here: Float[Array, "n"]  # looks before it came there that saw its place free
    hit_here: Float[Array, "n"]  # looks before it came there that saw something
    log_odds: Float[Array, "n"]  # of existence [nat]

    def __len__(self) -> int:
        return len(self.missed)

    @classmethod
    def started(cls, state: ImmState, scanner: int, seen_from: Float[Array, "2"], log_odds: float, at_s: float) -> Self:
        """Return new tracks before their first look, at a time; seen_from: where the scanner is [m]."""
        n = len(state)
        place = state.mean[:2, 0].T.copy()
        zeros, none, by = np.zeros(n), np.full(n, NO_LEG), np.full(n, scanner)
        return cls(
            state, np.zeros((n, len(SHOWN))), zeros, none, none, place, np.tile(seen_from, (n, 1)), by, by, zeros,
            zeros, zeros, place, np.full(n, at_s), zeros, zeros, np.full(n, log_odds),
        )  # fmt: skip

    def faded(self, elapsed_s: float) -> Self:
        """Return the tracks with what they were shown `elapsed_s` older."""
        return self.changed(sums=self.sums * np.exp(-elapsed_s / MEMORY_S))

    def looked(
        self, track: Int[Index, "p"], shown: Float[Array, "p shown"], p_detect: Float[Array, "n"], elapsed_s: float,
        scanner: int,
    ) -> Self:  # fmt: skip
        """Return the tracks after a scan in which those at `track` were measured.

        p_detect: of all of them; elapsed_s: since this scanner's last scan, which may have seen whom no other one sees.
        """
        sums = self.sums.copy()
        sums[track] += min(elapsed_s, MEMORY_S) * shown
        missed = p_detect.copy()
        missed[track] = 0.0
        # a track that could not be seen is shown nothing
        certain = np.maximum(p_detect, 0.0)
        certain[track] = 1.0
        share = 1 - np.exp(-elapsed_s / MEMORY_S)
        leg = shown[:, SHOWN.index("leg")]
        return self.changed(
            sums=sums,
            missed=self.missed + share * certain * (missed - self.missed),
            best=written(self.best, track, np.maximum(self.best[track], leg)),
            last=written(np.where(self.scanner == scanner, NO_LEG, self.last), track, leg),
            scanner=written(self.scanner, track, np.full(len(track), scanner)),
        )

    def arrived(
        self, places: Float[Array, "n 2"], own: Bool[Mask, "n"], born_s: Float[Array, "n"], at_s: float,
        looks: Callable[[Float[Array, "n 2"], Float[Array, "n"]], SightCounts],
    ) -> Self:  # fmt: skip
        """Return the tracks at these places [m], and what looks saw there before: before each track, and before it came there.

        A track that left its place came to another one. own: the tracks that this scan tells about, at this time; looks: of
        places before times, as `SensorFrame.looks`.
        """
        came = own & (np.hypot(*(places - self.place).T) > _PLACE_M)
        came_s = np.where(came, at_s, self.came_s)
        before, here = (looks(places, since_s - _BEFORE_S) for since_s in (born_s, came_s))
        known, known_here = (own & (each.free + each.hit > 0) for each in (before, here))
        return self.changed(
            place=np.where(came[:, None], places, self.place),
            came_s=came_s,
            farthest=np.maximum(self.farthest, np.hypot(*(places - self.born_at).T)),
            free=np.where(known, before.free, self.free),
            hit=np.where(known, before.hit, self.hit),
            free_here=np.where(known_here, here.free, np.where(came, 0.0, self.free_here)),
            hit_here=np.where(known_here, here.hit, np.where(came, 0.0, self.hit_here)),
        )

    def _scene(self, age: Float[Array, "n"]) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Return how many of all other tracks are people, by their existence so far, and the share of them."""
        weight = np.minimum(age / _KNOWN_S, 1.0)
        exists = weight / (1 + np.exp(-np.clip(self.log_odds, -30, 30)))
        people, known = exists.sum() - exists, weight.sum() - weight
        return people, (people + _PRIOR[0]) / (known + _PRIOR[1])

    def features(
        self, places: Float[Array, "n 2"], speed: Float[Array, "n"], spread: Float[Array, "n"], age: Float[Array, "n"],
        stay: Float[Array, "n"], scanner: int, scanners: Float[Array, "s 2"], driving: float, step_rad: float, period_s: float,
        n_leglike: int,
    ) -> Float[Array, "n features"]:  # fmt: skip
        """Return `TRACK_FEATURES` of the tracks at these places [m], as one scanner sees them.

        stay: time in the place that it came to last [s]; scanners: where all of them are [m]; driving: its speed [m/s] and turn
        rate [rad/s] together; step_rad: between its beams; period_s: since its scan before, for a slow scanner says as much about
        a track in one look as a fast one in many; n_leglike: clusters of its scan that look like legs.
        """
        look, *others = self.sums.T
        leg, second, both, square, samples, width, width_square, around, surprise, *_ = (
            each / np.maximum(look, 1e-6) for each in others
        )
        both_s = np.maximum(self.sums[:, SHOWN.index("both")], 1e-6)
        gap, gap_square = (self.sums[:, SHOWN.index(name)] / both_s for name in ("gap", "gap²"))
        apart = distances(places, places)
        better = (self.log_odds > self.log_odds[:, None]) | (
            (self.log_odds == self.log_odds[:, None]) & (age > age[:, None])
        )
        beside = np.where(better, apart, _BESIDE_M).min(axis=1, initial=_BESIDE_M)
        rival = np.where(better & (apart < _RIVAL_M), self.log_odds, _NO_RIVAL).max(axis=1, initial=_NO_RIVAL)
        away = np.hypot(*(places - scanners[scanner]).T)
        # in a room full of posts a post is likelier, among people a person
        people, others = self._scene(age)
        driven = np.hypot(*(self.seen_from - scanners[self.born_by]).T)
        return np.column_stack([
            leg, second, self.best, both, look, self.missed, self.farthest, speed, np.minimum(age, 10.0), away,
            driven, (self.free + 0.5) / (self.free + self.hit + 1), np.log1p(self.free),
            np.log1p(self.hit), spread, beside, np.sqrt(np.maximum(square - leg**2, 0)), samples, width,
            np.sqrt(np.maximum(width_square - width**2, 0)), around, surprise, gap, self.last,
            np.full(len(self), driving), away * step_rad, (apart < _NEAR_M).sum(axis=1) - 1.0, rival,
            np.sqrt(np.maximum(gap_square - gap**2, 0)), np.full(len(self), min(period_s, MEMORY_S)),
            np.minimum(stay, 10.0), np.log1p(self.free_here), np.log1p(self.hit_here),
            others, people, np.full(len(self), np.log1p(n_leglike)),
        ])  # fmt: skip


def shown_by(
    legs: Clusters, places: Float[Array, "k 2"], evidence: Float[Array, "k"], first: Int[Index, "p"],
    second: Int[Index, "p"], both: Bool[Mask, "p"], surprise: Float[Array, "p"],
) -> Float[Array, "p shown"]:  # fmt: skip
    """Return what one look shows of people with these legs (`SHOWN`); surprise: distance from where they were expected [m]."""
    strong = evidence > 0
    around = (
        ((distances(places[first], places) < _AROUND_M) & strong).sum(axis=1) - strong[first] - (both & strong[second])
    )
    width = legs.width_m[first]
    gap = np.where(both, np.hypot(*(places[first] - places[second]).T), 0.0)
    return np.column_stack([
        np.ones(len(first)), evidence[first], np.where(both, evidence[second], NO_LEG), both.astype(float), evidence[first] ** 2,
        np.log2(legs.n_sample[first]), width, width**2, around, surprise,
        gap, gap**2,
    ])  # fmt: skip


def assigned(
    expected: Float[Array, "n 2"], spread_m: Float[Array, "n"], reach_m: Float[Array, "n"], legs: Float[Array, "k 2"],
    evidence: Float[Array, "k"],
) -> Int[Index, "k"]:  # fmt: skip
    """Assign legs to people by likelihood, two to each; return the person of each leg, −1: nobody's.

    A leg is worth ln p(place | this person's) / p(place | anything else's), and its evidence. spread_m: standard deviation of the
    expected places, on each axis: who was not seen for a while takes no leg from one who is known to stand there. Worth nothing,
    or out of reach, a leg is nobody's. Of two legs farther apart than a stride the one worth less is set free.
    """
    n, owner = len(expected), np.full(len(legs), -1)
    if n == 0 or len(legs) == 0:
        return owner
    away = distances(expected, legs)
    variance = _LEG_M**2 + spread_m[:, None] ** 2
    worth = -0.5 * away**2 / variance - np.log(2 * np.pi * variance * _OTHERS_PER_M2) + np.minimum(evidence, _MOST)
    worth = np.where(away < reach_m[:, None], np.maximum(worth, 0.0), 0.0)
    slot, leg = max_weight_assignment(np.tile(worth, (2, 1)))
    owner[leg] = slot % n
    for person in np.flatnonzero(np.bincount(owner[leg], minlength=n) == 2):
        one, other = np.flatnonzero(owner == person)
        if np.hypot(*(legs[one] - legs[other])) > STRIDE_M:
            owner[one if worth[person, one] < worth[person, other] else other] = -1
    return owner


def measured_places(
    owner: Int[Index, "k"], places: Float[Array, "k 2"], evidence: Float[Array, "k"]
) -> tuple[Int[Index, "p"], Float[Array, "p 2"], Int[Index, "p"], Int[Index, "p"], Bool[Mask, "p"]]:
    """Return the people with legs, their places by evidence, the better leg of each, the other one, and who has both."""
    legs = np.flatnonzero(owner >= 0)
    legs = legs[np.lexsort((-evidence[legs], owner[legs]))]
    track, index, count = np.unique(owner[legs], return_index=True, return_counts=True)
    both = count == 2
    first = legs[index]
    other = legs[np.minimum(index + both, len(legs) - 1)] if len(legs) else legs
    weight = 1 / (1 + np.exp(-evidence))
    share = np.where(both, weight[other] / (weight[first] + weight[other]), 0.0)[:, None]
    position = (1 - share) * places[first] + share * places[other]
    return track, position, first, other, both
