"""Who was measured where: trunks and legs to tracks, by distance and by colour; nothing is changed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.rows import written
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.legs import find_walkers
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.pairing import Costs, costs, existence_paired, unpaired
from trackers.laser_fisheye_imm.people import People
from trackers.tracking.association import Stage, associate, left_over
from trackers.tracking.track_manager import nanoseconds, reachable


@dataclass(frozen=True, eq=False)
class Matches:
    """Which track was measured where, and what was left over."""

    track: Int[Index, "p"]
    position: Float[Array, "p 2"]
    variance: Float[Array, "p"]  # of the position on each axis
    lone: Bool[Mask, "p"]  # by a single leg alone
    trunk: Int[Index, "p"]  # the trunk, or -1 where legs were used
    legs: Float[Array, "p 2"]  # the middle of the legs under that trunk [m], NaN where none is seen
    existence: Float[Array, "p"]  # how probably they are still there, now that this is taken for theirs
    new_position: Float[Array, "q 2"]  # measurements that no track took
    new_trunk: Int[Index, "q"]
    new_lone: Bool[Mask, "q"]


@dataclass(frozen=True, eq=False)
class Association:
    """The pairing of one moment: global nearest neighbour on likelihood ratios, or d = N + w E, within the validation regions.

    people: predicted to stamp ns (the moment before was at last_ns);
    unseen: how probably the moment would not show each of them; knee_radius_m: the validation
    radius of legs; sees_waists: whether trunks are looked for, without which legs are all there is to know anybody by;
    knows_room: whether the background was captured, or else is learned from the scans, so that what is tentative may be a
    flicker of the room, and takes no legs before they are somebody's.
    """

    people: People
    unseen: Float[Array, "n"]
    options: LaserFisheyeImmOptions
    knee_radius_m: float
    ns: int
    last_ns: int
    sees_waists: bool = True
    knows_room: bool = True

    def matches(self, seen: Seen) -> Matches:
        """Trunks to tracks, and legs to those whom no trunk shows: waist, else knee, never both."""
        people, options, knee, n_trunk = self.people, self.options, self.options.knee, len(seen.trunks)
        variance = options.measurement_variance_m2 + seen.trunks.variance_m2
        cost = costs(people, seen.trunks.position, variance, options.waist.radius_m, False, options)
        colour = people.clothes.distance(seen.histograms, seen.comparable)
        if colour is None:
            colour = np.full((len(people), n_trunk), np.nan)
        trunk_of = written(np.full(len(people), -1), *associate([self._explained(cost, colour)]))
        known = np.ones(len(people), np.bool_) if self.knows_room else people.confirmed
        walkers = find_walkers(seen, people.select(known), trunk_of[known], self.knee_radius_m, self.ns, options)
        n_walker = len(walkers.position)
        trunk = np.concatenate([np.arange(n_trunk), np.full(n_walker, -1)])
        position = np.concatenate([seen.trunks.position, walkers.position])
        lone = np.concatenate([np.zeros(n_trunk, np.bool_), walkers.n_leg == 1])
        # in a rig that sees waists a leg alone may be anything
        part = lone & self.sees_waists
        by_legs = knee.legs_variance_m2 + np.where(walkers.n_leg == 1, knee.single_leg_variance_m2, 0.0)
        by_legs += options.measurement_variance_m2
        cost = cost.beside(costs(people, walkers.position, by_legs, self.knee_radius_m, part[n_trunk:], options))
        colour = np.pad(colour, ((0, 0), (0, n_walker)), constant_values=np.nan)
        track, taken = associate(
            [
                self._explained(cost, colour, trunk < 0),
                self._explained(cost, colour, trunk >= 0),
                self._known_again(cost, colour, position, part),
            ]
        )
        new = left_over(len(position), taken)
        return Matches(
            track=track,
            position=position[taken],
            variance=np.concatenate([variance, by_legs])[taken],
            lone=lone[taken],
            trunk=trunk[taken],
            legs=np.concatenate([walkers.under_trunk, np.full((n_walker, 2), np.nan)])[taken],
            existence=existence_paired(people.existence[track], cost.pair[track, taken], options),
            new_position=position[new],
            new_trunk=trunk[new],
            new_lone=lone[new],
        )

    def _explained(self, cost: Costs, colour: Float[Array, "n k"], without: Bool[Mask, "k"] | bool = False) -> Stage:
        """Pairs that predictions explain, but for the measurements `without`; colour: E, NaN where unknown."""
        alone, everybody = unpaired(self.people, self.unseen, self.options), np.ones(len(self.people), np.bool_)
        return Stage(everybody, [cost.pair, self._by_colour(colour)], [cost.out_of_gate | without], alone)

    def _known_again(
        self, cost: Costs, colour: Float[Array, "n k"], position: Float[Array, "k 2"], part: Bool[Mask, "k"]
    ) -> Stage:
        """Pairs of the occluded, with what no prediction explains, but for what is but a `part` of a person."""
        people, options = self.people, self.options
        hidden = people.confirmed & self._hidden() & (options.track_management.reid_speed_m_s is not None)
        existing = hidden & people.exist(options.track_management.exists_above)
        explained = ((options.expected_below >= cost.deviations) & ~hidden[:, None]).any(axis=0)
        cannot_be = ~self._recognised(existing, position, colour) | part | explained
        return Stage(hidden, [cost.pair, self._by_colour(colour)], [cannot_be])

    def _by_colour(self, colour: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """What a look costs, −2 ln of how much likelier it is the person's own than anybody's, or E by its weight.

        Now and then it is of what stands before them, so that no shirt rules anybody out.
        """
        wrong = self.options.wrong_look
        cost = self.options.colour_weight * np.nan_to_num(colour - self.options.even_at)
        return -2 * np.logaddexp(np.log(wrong) if wrong else -np.inf, np.log1p(-wrong) - 0.5 * cost)

    def _recognised(
        self, hidden: Bool[Mask, "n"], position: Float[Array, "k 2"], colour: Float[Array, "n k"]
    ) -> Bool[Mask, "n k"]:
        """Pairs of a `hidden` track and somebody whom it can have become meanwhile, by all that tells.

        Its prediction says little after a while: what it can have walked since it was measured is asked instead, and what
        shirt it wears; where no shirt is seen nothing tells but that only one of the hidden can be there.
        """
        unseen_ns, rules = self.ns - self.people.roster.measured_ns, self.options.track_management
        can_be = reachable(self.people.measured_at, unseen_ns, position, rules) & hidden[:, None]
        alone = can_be & (np.count_nonzero(can_be, axis=0) == 1)
        return np.where(np.isnan(colour), alone, can_be & (colour <= self.options.recognised_below))

    def _hidden(self) -> Bool[Mask, "n"]:
        """Who was not measured at the last scan either, and may be on their way: whoever lies is not."""
        measured_ns = self.people.roster.measured_ns
        unseen = (self.ns - measured_ns > nanoseconds(1.5 * self.options.step_s)) & (measured_ns < self.last_ns)
        return unseen & ~self.people.posture.lying
