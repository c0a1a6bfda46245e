"""Who was measured where: trunks to tracks, then legs, by distance and by colour; nothing is changed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import distances, global_nearest_neighbour, mahalanobis, validation_region
from trackers.filters.imm import Imm
from trackers.laser.grouping import pair_off, take_legs
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.observations import NS_PER_S
from trackers.tracking.association import Stage, associate, left_over
from trackers.tracking.lifecycle import nanoseconds
from trackers.vision.histogram import chi_squared_distance

_NOBODY = np.empty(0, np.intp)


@dataclass(frozen=True, eq=False)
class Matches:
    """Which track was measured where, and what was left over."""

    track: Index  # (p,)
    position: Array  # (p, 2)
    variance: Array  # (p,) of the position on each axis
    trunk: Index  # (p,) the trunk, or -1 where legs were used
    new_position: Array  # (q, 2) measurements that no track took
    new_trunk: Index  # (q,)
    new_clearance: Array  # (q,) how far from everybody else somebody new must be to be believed [m]
    colour: Array | None  # (n, k) E of every track and trunk, NaN where unknown; None where nobody's is known

    def like_anothers(self, below: float) -> Mask:
        """In which pairs (p,) the shirt is like another track's, by an E up to `below`, and not like the track's own.

        Then the window is on whoever stands before the person. (Where the light fails all shirts grow alike, but none
        grows unlike itself from one look to the next.)
        """
        if self.colour is None:
            return np.zeros(self.track.size, np.bool_)
        E, pair = np.where(np.isnan(self.colour), np.inf, self.colour)[:, self.trunk], np.arange(self.track.size)
        own = E[self.track, pair]
        E[self.track, pair] = np.inf
        return (self.trunk >= 0) & (E.min(axis=0) <= below) & (own > below)


@dataclass(frozen=True, eq=False)
class Association:
    """The pairing of one moment: global nearest neighbour on d = N + w E within the validation regions.

    people: predicted to stamp ns; knee_radius_m: the validation radius of legs; sees_waists: whether trunks are looked for,
    without which legs are all there is to know anybody by.
    """

    people: People
    imm: Imm
    options: LaserFisheyeImmOptions
    knee_radius_m: float
    ns: int
    sees_waists: bool = True

    def matches(self, seen: Seen) -> Matches:
        """Trunks to tracks, then legs to the tracks left over: waist, else knee, never both."""
        everyone = np.arange(len(self.people))
        colour = self.people.clothes.distance(seen.histograms, seen.comparable)
        whole = np.ones(len(seen.trunks), np.bool_)
        tracks, trunks = self._match(everyone, seen.trunks.position, self.options.waist.radius_m, whole, colour)
        left = left_over(len(everyone), tracks)
        walkers, n_leg = self._walkers(seen, left)
        knee, R = self.options.knee, self.options.measurement_variance_m2
        one_legged = n_leg == 1
        by_legs, legs = self._match(left, walkers, self.knee_radius_m, ~(one_legged & self.sees_waists), None)
        new_trunk = left_over(len(seen.trunks), trunks)
        new_walker = left_over(len(walkers), legs)
        # a lone leg within a stride of somebody is likelier theirs than somebody new
        body = self.options.management.body_radius_m
        clearance = np.where(one_legged[new_walker], max(body, knee.stride_m), body)
        return Matches(
            track=np.concatenate([tracks, by_legs]),
            position=np.concatenate([seen.trunks.position[trunks], walkers[legs]]),
            variance=np.concatenate(
                [R + seen.trunks.variance_m2[trunks], R + one_legged[legs] * knee.single_leg_variance_m2]
            ),
            trunk=np.concatenate([trunks, np.full(legs.size, -1)]),
            new_position=np.concatenate([seen.trunks.position[new_trunk], walkers[new_walker]]),
            new_trunk=np.concatenate([new_trunk, np.full(new_walker.size, -1)]),
            new_clearance=np.concatenate([np.full(new_trunk.size, body), clearance]),
            colour=colour,
        )

    def _match(
        self, tracks: Index, position: Array, radius_m: float, whole: Mask, colour: Array | None
    ) -> tuple[Index, Index]:
        """Pairs (track, measurement) among `tracks` (p,) and measurements (k, 2); confirmed tracks choose first.

        `whole` (k,): what is a person rather than one leg, which may be anything; `colour`: E of all tracks (n, k), NaN
        where unknown.
        """
        if tracks.size == 0 or len(position) == 0:
            return _NOBODY, _NOBODY
        people = self.people
        state = people.state if tracks.size == len(people) else people.state.select(tracks)
        distance = mahalanobis(state.positions, self.imm.innovation_covariance(state), position)
        out_of_gate = ~validation_region(state.positions, position, radius_m)
        if self.options.max_deviations is not None:
            out_of_gate |= distance > self.options.max_deviations
        confirmed = people.confirmed[tracks]
        if not self.options.confirmed_first:
            confirmed = np.ones_like(confirmed)
        hidden = people.confirmed[tracks] & self._hidden(tracks)
        terms, vetoes = [distance], [out_of_gate]
        if colour is not None:
            terms.append(self.options.colour_weight * np.nan_to_num(colour[tracks], nan=self.options.unknown_colour))
            vetoes.append(self._foreign(tracks, colour, distance))
        # first whom a prediction explains, then the occluded by what else tells them, then who is tentative
        stages = [Stage(confirmed, terms, vetoes)]
        if hidden.any() and self.options.reach_m_s is not None:
            recognised = self._recognised(tracks, hidden, position, radius_m, colour) & whole
            in_sight = confirmed & ~hidden
            explained = ((distance <= self.options.expected_below) & in_sight[:, None]).any(axis=0)
            stages.append(Stage(hidden, terms, [~recognised | explained]))
        stages.append(Stage(~confirmed, terms, vetoes))
        rows, columns = associate(stages)
        return tracks[rows], columns

    def _foreign(self, tracks: Index, colour: Array, distance: Array) -> Mask:
        """Pairs (p, k) in which the shirt is another's: not the track's own, and known well, somebody else's, or far off.

        A reference from a few looks may be of an arm or of whoever stood before the person.
        """
        E = colour[tracks]
        anothers = (colour <= self.options.recognised_below).any(axis=0)
        known_well = self.people.clothes.n_look[tracks] >= self.options.looks_to_know
        return (self.options.foreign_above < E) & (
            anothers | known_well[:, None] | (distance > self.options.expected_below)
        )

    def _recognised(self, tracks: Index, hidden: Mask, position: Array, radius_m: float, colour: Array | None) -> Mask:
        """Pairs (p, k) of a `hidden` track (p,) and somebody whom it can have become meanwhile, by all that tells.

        Its prediction says little after a while: what it can have walked since it was seen is asked instead, and what
        shirt it wears. Nothing tells whose legs they are but that only one of the hidden can be there.
        """
        unseen_s = (self.ns - self.people.roster.measured_ns[tracks]) / NS_PER_S
        reach_m = radius_m + (self.options.reach_m_s or 0.0) * unseen_s
        can_be = distances(self.people.measured_at[tracks], position) <= reach_m[:, None]
        can_be &= hidden[:, None]
        if colour is not None:
            return can_be & (colour[tracks] <= self.options.recognised_below)
        return can_be & (np.count_nonzero(can_be, axis=0) == 1)

    def _hidden(self, tracks: Index) -> Mask:
        """Which of `tracks` (p,) were not measured at the last scan either."""
        return self.ns - self.people.roster.measured_ns[tracks] > nanoseconds(1.5 * self.options.period_s)

    def _walkers(self, seen: Seen, unmatched: Index) -> tuple[Array, Index]:
        """People (p, 2) as their legs show them, and how many legs each shows, (p,).

        Nobody whose trunk is seen, and nobody who may as well be one as another of the `unmatched`: better no one's legs
        than the wrong one's.
        """
        knee, legs = self.options.knee, seen.legs.position
        # nobody hidden stands inside somebody in sight
        apart = (distances(legs, seen.trunks.position) > knee.under_m).all(axis=1)
        if not apart.any():
            return np.empty((0, 2)), _NOBODY
        rules = knee.stride_m, knee.claim_m, knee.single_leg_cost_m, knee.wide_above_m, knee.wide_cost
        _, _, free = take_legs(legs, seen.trunks.position, *rules)
        legs = legs[free & apart]
        if len(legs) == 0:
            return legs, _NOBODY
        hidden = unmatched[self.people.confirmed[unmatched]]
        known, n_leg, free = take_legs(legs, self.people.positions[hidden], *rules)
        strangers, n_leg_of_strangers = pair_off(legs[free], knee.pair_m)
        walkers = np.concatenate([known[n_leg > 0], strangers])
        clear = self._clear(hidden, walkers)
        return walkers[clear], np.concatenate([n_leg[n_leg > 0], n_leg_of_strangers])[clear]

    def _clear(self, hidden: Index, walkers: Array) -> Mask:
        """Which walkers (p, 2) one of the hidden explains clearly better than any other does, or none explains, (p,)."""
        if hidden.size < 2 or len(walkers) == 0:
            return np.ones(len(walkers), np.bool_)
        state, farthest = self.people.state.select(hidden), self.options.max_deviations or np.inf
        distance = mahalanobis(state.positions, self.imm.innovation_covariance(state), walkers)
        can_be = validation_region(state.positions, walkers, self.knee_radius_m) & (distance <= farthest)
        distance[~can_be] = np.inf
        best, second = np.partition(distance, 1, axis=0)[:2]
        return second >= best + self.options.knee.clear_by


def known_again(people: People, new: Index, options: LaserFisheyeImmOptions) -> tuple[Index, Index]:
    """Who of the `new` tracks that would be confirmed now is somebody known: pairs (confirmed track, new track).

    A track may be astray, on another's legs or on what shows no shirt. If its shirt is seen on somebody new where it can
    have walked to, more than anybody else's, and was not seen on itself since, then the new one is the same person.
    """
    known, new = _known(people, options), new[people.clothes.known[new]]
    if options.reach_m_s is None or known.size == 0 or new.size == 0:
        return _NOBODY, _NOBODY
    E = chi_squared_distance(people.clothes.reference[known], people.clothes.reference[new])
    can_be = _can_be(people, known, new, options) & (options.recognised_below >= E) & (E.min(axis=0) >= E)
    rows, columns = global_nearest_neighbour(E, can_be)
    return known[rows], new[columns]


def may_be_known(people: People, options: LaserFisheyeImmOptions) -> Mask:
    """Which tracks began where somebody known can have come unseen, (n,)."""
    can_be = _can_be(people, _known(people, options), np.arange(len(people)), options)
    return np.count_nonzero(can_be, axis=0) > 0


def _known(people: People, options: LaserFisheyeImmOptions) -> Index:
    """Whose shirts are known well."""
    return (people.confirmed & (people.clothes.n_look >= options.looks_to_know)).nonzero()[0]


def _can_be(people: People, known: Index, new: Index, options: LaserFisheyeImmOptions) -> Mask:
    """Which of the `new` (k,) began where the `known` (p,) can have walked to since their shirts were last seen, (p, k)."""
    since_s = (people.roster.born_ns[new] - people.clothes.looked_ns[known, None]) / NS_PER_S
    reach_m = options.waist.radius_m + (options.reach_m_s or 0.0) * since_s
    return (since_s > 0) & (distances(people.clothes.looked_at[known], people.born_at[new]) <= reach_m)
