"""Who was measured where: trunks and legs to tracks, by distance and by colour; nothing is changed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import deviations, distances, validation_region
from trackers.laser.grouping import pair_off, take_legs
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.observations import NS_PER_S
from trackers.tracking.association import Stage, associate, left_over
from trackers.tracking.lifecycle import clear_of, nanoseconds

_NOBODY = np.empty(0, np.intp)


@dataclass(frozen=True, eq=False)
class Matches:
    """Which track was measured where, and what was left over."""

    track: Int[Index, "p"]
    position: Float[Array, "p 2"]
    variance: Float[Array, "p"]  # of the position on each axis
    lone: Bool[Mask, "p"]  # by a single leg alone
    trunk: Int[Index, "p"]  # the trunk, or -1 where legs were used
    legs: Float[Array, "p 2"]  # the middle of the legs under that trunk [m], NaN where none is seen
    new_position: Float[Array, "q 2"]  # measurements that no track took
    new_trunk: Int[Index, "q"]
    new_clearance: Float[Array, "q"]  # how far from everybody else somebody new must be to be believed [m]


@dataclass(frozen=True, eq=False)
class Association:
    """The pairing of one moment: global nearest neighbour on d = N + w E, or on likelihoods, within the validation regions.

    people: predicted to stamp ns; knee_radius_m: the validation radius of legs; sees_waists: whether trunks are looked for,
    without which legs are all there is to know anybody by; knows_room: whether the background was captured, or else is learned
    from the scans, so that what is tentative may be a flicker of the room, and takes no legs before they are somebody's.
    """

    people: People
    options: LaserFisheyeImmOptions
    knee_radius_m: float
    ns: int
    sees_waists: bool = True
    knows_room: bool = True

    def matches(self, seen: Seen) -> Matches:
        """Trunks, and legs where no trunk is seen, to tracks: waist, else knee, never both."""
        walkers, n_leg, own_legs = self._walkers(seen)
        options, knee, n_trunk = self.options, self.options.knee, len(seen.trunks)
        trunk = np.concatenate([np.arange(n_trunk), np.full(len(walkers), -1)])
        position = np.concatenate([seen.trunks.position, walkers])
        lone = np.concatenate([np.zeros(n_trunk, np.bool_), n_leg == 1])
        by_legs = knee.legs_variance_m2 + np.where(n_leg == 1, knee.single_leg_variance_m2, 0.0)
        variance = options.measurement_variance_m2 + np.concatenate([seen.trunks.variance_m2, by_legs])
        radius_m = np.where(trunk >= 0, options.waist.radius_m, self.knee_radius_m)
        colour = self.people.clothes.distance(seen.histograms, seen.comparable)
        if colour is not None:
            colour = np.pad(colour, ((0, 0), (0, len(walkers))), constant_values=np.nan)
        tracks, taken = self._match(position, variance, radius_m, trunk < 0, ~(lone & self.sees_waists), colour)
        new = left_over(len(position), taken)
        # a lone leg within a stride of somebody is likelier theirs than somebody new
        body = options.management.body_radius_m
        return Matches(
            track=tracks,
            position=position[taken],
            variance=variance[taken],
            lone=lone[taken],
            trunk=trunk[taken],
            legs=np.concatenate([own_legs, np.full((len(walkers), 2), np.nan)])[taken],
            new_position=position[new],
            new_trunk=trunk[new],
            new_clearance=np.where(lone[new], max(body, knee.stride_m), body),
        )

    def _match(
        self,
        position: Float[Array, "k 2"],
        variance_m2: Float[Array, "k"],
        radius_m: Float[Array, "k"],
        by_legs: Bool[Mask, "k"],
        whole: Bool[Mask, "k"],
        colour: Float[Array, "n k"] | None,
    ) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"]]:
        """Pairs (track, measurement): first whom a prediction explains, those known before somebody new.

        `whole`: what is a person rather than one leg, which may be anything; `colour`: E of all tracks, NaN where unknown.
        """
        people, options = self.people, self.options
        if len(people) == 0 or len(position) == 0:
            return _NOBODY, _NOBODY
        modes = people.state.positions
        N, unlikely = deviations(modes, people.state.covariance[:2, :2].T, position, variance_m2)
        out_of_gate = ~validation_region(modes, position, radius_m)
        if options.max_deviations is not None:
            # so near there is nobody else: whoever stood starts to walk
            theirs = validation_region(modes, position, options.management.apart_m)
            out_of_gate |= (options.max_deviations < N) & ~theirs
        terms = [unlikely - unlikely.min() if options.by_likelihood else N]
        if colour is not None:
            terms.append(options.colour_weight * np.nan_to_num(colour - options.even_at))
        hidden = people.confirmed & self._hidden()
        if options.at_once:
            stages = [Stage(who, terms, [out_of_gate]) for who in (people.confirmed, ~people.confirmed)]
        else:
            everybody = np.ones_like(hidden)
            stages = [Stage(everybody, terms, [out_of_gate | other]) for other in (by_legs, ~by_legs)]
        if hidden.any() and options.reach_m_s is not None:
            recognised = self._recognised(hidden, position, colour) & whole
            explained = ((options.expected_below >= N) & ~hidden[:, None]).any(axis=0)
            stages.append(Stage(hidden, terms, [~recognised | explained]))
        return associate(stages)

    def _recognised(
        self, hidden: Bool[Mask, "n"], position: Float[Array, "k 2"], colour: Float[Array, "n k"] | None
    ) -> Bool[Mask, "n k"]:
        """Pairs of a `hidden` track and somebody whom it can have become meanwhile, by all that tells.

        Its prediction says little after a while: what it can have walked since it was measured is asked instead, and what
        shirt it wears; where no shirt is seen nothing tells but that only one of the hidden can be there.
        """
        unseen_s = (self.ns - self.people.roster.measured_ns) / NS_PER_S
        reach_m = (self.options.reach_m_s or 0.0) * unseen_s
        can_be = (distances(self.people.measured_at, position) <= reach_m[:, None]) & hidden[:, None]
        alone = can_be & (np.count_nonzero(can_be, axis=0) == 1)
        if colour is None:
            return alone
        return np.where(np.isnan(colour), alone, can_be & (colour <= self.options.recognised_below))

    def _hidden(self) -> Bool[Mask, "n"]:
        """Who was not measured at the last scan either, and may be on their way: whoever lies is not."""
        unseen = self.ns - self.people.roster.measured_ns > nanoseconds(1.5 * self.options.period_s)
        return unseen & ~self.people.posture.lying

    def _walkers(self, seen: Seen) -> tuple[Float[Array, "p 2"], Int[Index, "p"], Float[Array, "k 2"]]:
        """People as their legs show them, how many legs each shows, and the middle of the legs under each of k trunks, NaN: none.

        Nobody whose trunk is seen: every trunk takes its own legs first, and what else hangs there. Whoever sits is as far behind
        the knees as before.
        """
        knee, legs = self.options.knee, seen.legs.position
        people = self.people if self.knows_room else self.people.select(self.people.confirmed)
        seated = people.posture.seated(people.measured_at, self.options.posture)
        before = np.where(seated[:, None], people.posture.knees, 0.0)
        trunks = seen.trunks.position
        expected = trunks + self._of_nearest(people.posture.knees, people.positions, trunks)
        wide = seen.legs.width_m > knee.both_legs_m
        own, n_own, free = take_legs(legs, wide, expected, knee.claim_m, knee.stride_m)
        own[n_own < 2] = np.nan  # a lone leg is up to half a stride from the middle
        free &= clear_of(legs, expected, self.options.management.apart_m)  # a third under a trunk is a bag
        legs, firm, wide = legs[free], seen.firm[free], wide[free]
        if len(legs) == 0:
            return legs, _NOBODY, own
        half_seen = self.ns - people.whole_ns > nanoseconds(knee.single_leg_s)
        known, n_leg, free = take_legs(
            legs,
            wide,
            people.positions + before,
            self.knee_radius_m,
            knee.stride_m,
            knee.opposite,
            np.where(half_seen, knee.half_seen_m2, 0.0),
        )
        strangers, n_leg_of_strangers = pair_off(legs[free], knee.pair_m, firm[free])
        walkers = np.concatenate([(known - before)[n_leg > 0], strangers])
        return walkers, np.concatenate([n_leg[n_leg > 0], n_leg_of_strangers]), own

    def _of_nearest(
        self, before: Float[Array, "n 2"], people: Float[Array, "n 2"], trunks: Float[Array, "k 2"]
    ) -> Float[Array, "k 2"]:
        """How far before each trunk the knees of the person expected nearest to it are, nought where nobody is [m]."""
        if len(people) == 0 or len(trunks) == 0:
            return np.zeros_like(trunks)
        apart = distances(trunks, people)
        nearest = apart.argmin(axis=1)
        return np.where(apart.min(axis=1)[:, None] < self.options.knee.claim_m, before[nearest], 0.0)
