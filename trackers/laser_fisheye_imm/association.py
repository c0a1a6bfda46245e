"""Who was measured where: trunks to tracks, then legs, by distance and by colour; nothing is changed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.gating import distances, mahalanobis, validation_region
from trackers.filters.imm import Imm
from trackers.laser.grouping import pair_off, take_legs
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.people import People
from trackers.observations import NS_PER_S
from trackers.tracking.association import Stage, associate, left_over
from trackers.tracking.lifecycle import nanoseconds

_NOBODY = np.empty(0, np.intp)


@dataclass(frozen=True, eq=False)
class Matches:
    """Which track was measured where, and what was left over."""

    track: Int[Index, "p"]
    position: Float[Array, "p 2"]
    variance: Float[Array, "p"]  # of the position on each axis
    trunk: Int[Index, "p"]  # the trunk, or -1 where legs were used
    new_position: Float[Array, "q 2"]  # measurements that no track took
    new_trunk: Int[Index, "q"]
    new_clearance: Float[Array, "q"]  # how far from everybody else somebody new must be to be believed [m]


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
        )

    def _match(
        self,
        tracks: Int[Index, "p"],
        position: Float[Array, "k 2"],
        radius_m: float,
        whole: Bool[Mask, "k"],
        colour: Float[Array, "n k"] | None,
    ) -> tuple[Int[Index, "pairs"], Int[Index, "pairs"]]:
        """Pairs (track, measurement) among `tracks` and measurements: first whom a prediction explains.

        `whole`: what is a person rather than one leg, which may be anything; `colour`: E of all tracks, NaN where unknown.
        """
        if tracks.size == 0 or len(position) == 0:
            return _NOBODY, _NOBODY
        people = self.people
        state = people.state if tracks.size == len(people) else people.state.select(tracks)
        distance = mahalanobis(state.positions, self.imm.innovation_covariance(state), position)
        out_of_gate = ~validation_region(state.positions, position, radius_m)
        if self.options.max_deviations is not None:
            out_of_gate |= distance > self.options.max_deviations
        terms = [distance]
        if colour is not None:
            terms.append(self.options.colour_weight * np.nan_to_num(colour[tracks]))
        hidden = people.confirmed[tracks] & self._hidden(tracks)
        stages = [Stage(np.ones_like(hidden), terms, [out_of_gate])]
        if hidden.any() and self.options.reach_m_s is not None:
            recognised = self._recognised(tracks, hidden, position, radius_m, colour) & whole
            explained = ((distance <= self.options.expected_below) & ~hidden[:, None]).any(axis=0)
            stages.append(Stage(hidden, terms, [~recognised | explained]))
        rows, columns = associate(stages)
        return tracks[rows], columns

    def _recognised(
        self,
        tracks: Int[Index, "p"],
        hidden: Bool[Mask, "p"],
        position: Float[Array, "k 2"],
        radius_m: float,
        colour: Float[Array, "n k"] | None,
    ) -> Bool[Mask, "p k"]:
        """Pairs of a `hidden` track and somebody whom it can have become meanwhile, by all that tells.

        Its prediction says little after a while: what it can have walked since it was measured is asked instead, and what
        shirt it wears; nothing tells whose legs they are but that only one of the hidden can be there.
        """
        unseen_s = (self.ns - self.people.roster.measured_ns[tracks]) / NS_PER_S
        reach_m = radius_m + (self.options.reach_m_s or 0.0) * unseen_s
        can_be = distances(self.people.measured_at[tracks], position) <= reach_m[:, None]
        can_be &= hidden[:, None]
        if colour is not None:
            return can_be & (colour[tracks] <= self.options.recognised_below)
        return can_be & (np.count_nonzero(can_be, axis=0) == 1)

    def _hidden(self, tracks: Int[Index, "p"]) -> Bool[Mask, "p"]:
        """Which of `tracks` were not measured at the last scan either."""
        return self.ns - self.people.roster.measured_ns[tracks] > nanoseconds(1.5 * self.options.period_s)

    def _walkers(self, seen: Seen, unmatched: Int[Index, "u"]) -> tuple[Float[Array, "p 2"], Int[Index, "p"]]:
        """People as their legs show them, and how many legs each shows.

        Nobody whose trunk is seen: every trunk takes its own legs first.
        """
        knee, legs = self.options.knee, seen.legs.position
        wide_cost = knee.wide_cost if self.sees_waists else 0.0  # legs alone are everybody's, runners' too
        rules = knee.stride_m, knee.claim_m, knee.single_leg_cost_m, knee.wide_above_m, wide_cost
        _, _, free = take_legs(legs, seen.trunks.position, *rules)
        legs = legs[free]
        if len(legs) == 0:
            return legs, _NOBODY
        hidden = unmatched[self.people.confirmed[unmatched]]
        known, n_leg, free = take_legs(legs, self.people.positions[hidden], *rules)
        strangers, n_leg_of_strangers = pair_off(legs[free], knee.pair_m)
        walkers = np.concatenate([known[n_leg > 0], strangers])
        return walkers, np.concatenate([n_leg[n_leg > 0], n_leg_of_strangers])
