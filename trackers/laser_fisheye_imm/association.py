"""Association of trunks and legs with tracks, by distance and colour, without side effects.

Costs are −2 ln of likelihood ratios (S. Blackman and R. Popoli, "Design and Analysis of Modern Tracking Systems", 1999,
chapter 6). A measurement at z belongs to a track with e p(z), e the track's existence probability and p its predicted
density; or to a new person or clutter, with their density λ. The track without it was missed, with 1 − e + e m, m the miss
probability of the frame (D. Mušicki, R. Evans and S. Stanković, "Integrated probabilistic data association", IEEE Trans.
Automatic Control 39, 1994). So a hidden track is not dragged along by leftover measurements, and a visible one takes its
measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.negative_information import existence_after_detection
from trackers.filters.rows import written
from trackers.laser.clusters import pair_off
from trackers.laser_fisheye_imm.detection import Seen
from trackers.laser_fisheye_imm.laser_tracks import LaserTracks
from trackers.laser_fisheye_imm.options import EVEN_AT, EXPLAINED_BELOW, WRONG_LOOK, LaserFisheyeImmOptions
from trackers.likelihood.legs import (
    LegPairs,
    PositionLikelihood,
    pair_legs,
    trunk_likelihood,
)
from trackers.rig import Role
from trackers.tracking.roster import Stage, associate, left_over
from trackers.tracking.track_manager import nanoseconds, reachable

_LEAST_MISSED, _LEAST_EXISTENCE = 1e-3, 1e-4
"""Floors of miss probability, the accuracy of the detection model, and of existence probability."""


@dataclass(frozen=True, eq=False)
class Costs:
    """Costs of pairs of n tracks and k measurements, and the impossible pairs."""

    mahalanobis: Float[Array, "n k"]  # N
    pair: Float[Array, "n k"]  # −2 ln p(z) / λ; N in the paper's system
    out_of_gate: Bool[Mask, "n k"]

    @classmethod
    def of(cls, people: LaserTracks, measured: PositionLikelihood, options: LaserFisheyeImmOptions) -> Costs:
        """Return the costs of k measurements of one kind."""
        if not len(measured.position):
            nothing = np.empty((len(people), 0))
            return cls(nothing, nothing, nothing > 0)
        distance, log_likelihood = measured.evaluated(people.state)
        pair = distance
        if options.clutter_density_m2 is not None:
            pair = 2 * (np.log(options.clutter_density_m2) - log_likelihood)
        return cls(distance, pair, ~measured.in_gate(people.state))

    def joined(self, other: Costs) -> Costs:
        """Return these measurements followed by the others."""
        return Costs(
            np.concatenate([self.mahalanobis, other.mahalanobis], axis=1),
            np.concatenate([self.pair, other.pair], axis=1),
            np.concatenate([self.out_of_gate, other.out_of_gate], axis=1),
        )


@dataclass(frozen=True, eq=False)
class Matches:
    """Matches of tracks with measurements, and unassigned measurements."""

    track: Int[Index, "p"]
    position: Float[Array, "p 2"]
    variance: Float[Array, "p"]  # of the position on each axis
    single: Bool[Mask, "p"]  # by a single leg only
    trunk: Int[Index, "p"]  # the trunk, or -1 if legs were used
    legs: Float[Array, "p 2"]  # the middle of the legs under that trunk [m], NaN if not detected
    existence: Float[Array, "p"]  # probability of existence, given this measurement
    new_position: Float[Array, "q 2"]  # unassigned measurements
    new_variance: Float[Array, "q"]  # of the position on each axis
    new_trunk: Int[Index, "q"]
    new_single: Bool[Mask, "q"]
    new_sample: Int[Index, "q"]  # samples of the trunk, or of the legs


@dataclass(frozen=True, eq=False)
class Association:
    """Pairing of one frame: global nearest neighbour on likelihood ratios, or d = N + w E, within the validation regions.

    people: predicted to stamp ns (the frame before was at last_ns); missed: how probably the frame would not show those at an
    index, asked only where it decides; sees_waists: whether trunks are looked for, without which legs are all that shows a
    person; knows_room: whether the background was captured, or else is learned from the scans, so that a tentative track may be
    a flicker of the room, and takes no legs; knees: where the middle of the legs of each upright person is from the body's
    axis [m]; origins: where the scanners of each role are [m]. Without these, nothing is known of what a leg hides.
    """

    people: LaserTracks
    missed: Callable[[Int[Index, "k"]], Float[Array, "k"]]
    knees: Float[Array, "n 2"]
    options: LaserFisheyeImmOptions
    ns: int
    last_ns: int
    sees_waists: bool = True
    knows_room: bool = True
    origins: Mapping[Role, Float[Array, "s 2"]] = field(default_factory=dict)

    def matches(self, seen: Seen) -> Matches:
        """Associate trunks with tracks, and legs with those without a trunk: waist, else knee, never both."""
        people, options, n_trunk = self.people, self.options, len(seen.trunks)
        trunks = trunk_likelihood(seen.trunks, options.trunk)
        cost = Costs.of(people, trunks, options)
        colour = people.clothes.distance(seen.histograms, seen.comparable)
        looks = self._unknown_colour if colour is None else self._by_colour(colour)
        by_trunks = associate([self._explained(cost, looks)])
        trunk_of = written(np.full(len(people), -1), *by_trunks)
        walkers = self._walkers(seen, trunk_of)
        n_walker = len(walkers.position)
        no_legs = np.ones((len(people), n_trunk + n_walker), np.bool_)
        no_legs[:, n_trunk:] = walkers.of_known & ~self._known[:, None]
        trunk = np.concatenate([np.arange(n_trunk), np.full(n_walker, -1)])
        position = np.concatenate([seen.trunks.position, walkers.position])
        single = np.concatenate([np.zeros(n_trunk, np.bool_), walkers.n_leg == 1])
        by_legs = walkers.likelihood(options.legs, self._leg_gate_m)
        weak = np.concatenate([seen.trunks.n_sample < options.waist.min_samples, np.zeros(n_walker, np.bool_)])
        n_sample = np.concatenate([seen.trunks.n_sample, walkers.n_sample])
        cost = cost.joined(Costs.of(people, by_legs, options))
        if colour is not None:
            unknown = np.full((len(people), n_walker), np.nan)  # of legs no colours are seen
            colour = np.concatenate([colour, unknown], axis=1)
            looks = np.concatenate([looks, np.full(unknown.shape, self._unknown_colour)], axis=1)
        stages = self._re_identified(cost, looks, colour, position, single | weak)
        if n_walker:
            stages.insert(0, self._explained(cost, looks, no_legs))
        track, taken = associate(stages, by_trunks)
        new = left_over(len(position), taken)
        new = new[~weak[new]]
        variance = np.concatenate([trunks.variance_m2, by_legs.variance_m2])
        return Matches(
            track=track,
            position=position[taken],
            variance=variance[taken],
            single=single[taken],
            trunk=trunk[taken],
            legs=np.concatenate([walkers.under_trunk, np.full((n_walker, 2), np.nan)])[taken],
            existence=_existence_paired(people.existence[track], cost.pair[track, taken], options),
            new_position=position[new],
            new_variance=variance[new],
            new_trunk=trunk[new],
            new_single=single[new],
            new_sample=n_sample[new],
        )

    @cached_property
    def _all(self) -> Bool[Mask, "n"]:
        return np.ones(len(self.people), np.bool_)

    @property
    def _known(self) -> Bool[Mask, "n"]:
        """Mask of the tracks that take legs, and those of whom no other takes: people, not perhaps a flicker of the room."""
        return self._all if self.knows_room else self.people.confirmed

    @property
    def _leg_gate_m(self) -> float:
        legs = self.options.legs
        return legs.gate_m if self.sees_waists else legs.gate_alone_m

    def _walkers(self, seen: Seen, trunk_of: Int[Index, "n"]) -> LegPairs:
        """Assign the legs to the trunks and to people without a trunk; trunk_of: the trunk of each track, or −1."""
        options = self.options
        if options.legs.assignment == "nearest":
            return self._nearest(seen, trunk_of)
        people, known = self.people, self._known
        posture, shown = people.posture, known & (trunk_of >= 0)
        under = seen.trunks.position.copy()
        under[trunk_of[shown]] += posture.knees[shown]
        hidden = known & ~shown
        seated = posture.seated(people.measured_at, options.posture)
        knees = np.where(seated[:, None], posture.knees, self.knees)[hidden]
        apart_m = options.track_management.apart_m
        gate_m = self._leg_gate_m
        lines = seen.legs.sight_lines(self.origins["knee"]) if "knee" in self.origins else None
        return pair_legs(
            seen.legs, seen.sufficient, under, people.positions[hidden], knees, apart_m, gate_m, options.legs, lines
        )

    def _nearest(self, seen: Seen, trunk_of: Int[Index, "n"]) -> LegPairs:
        """Drop the knees of tracks with a trunk, which take theirs first (the paper, fig. 4 d); close legs are one person's."""
        legs = self.options.legs
        position, n_leg = pair_off(seen.legs.position, legs.pair_m)
        new = np.full(len(position), -1)
        none = np.zeros_like(n_leg)
        groups = LegPairs(position, np.full_like(n_leg, 2), np.full((len(seen.trunks), 2), np.nan), new, none)
        cost = Costs.of(self.people, groups.likelihood(legs, self._leg_gate_m), self.options)
        shown = np.broadcast_to((trunk_of >= 0)[:, None], cost.pair.shape)
        looks = self._unknown_colour
        track, taken = associate([self._explained(cost, looks, ~shown), self._explained(cost, looks, shown)])
        left = left_over(len(position), taken[trunk_of[track] >= 0])
        return LegPairs(position[left], groups.n_leg[left], groups.under_trunk, new[left], none[left])

    def _explained(
        self, cost: Costs, looks: Float[Array, "n k"] | float, without: Bool[Mask, "*#n k"] | bool = False
    ) -> Stage:
        """Pair tracks with explained measurements, except those in `without`; looks: the cost of their colours."""
        total, impossible = cost.pair + looks, cost.out_of_gate | without
        return Stage(self._all, [total], [impossible], self._unpaired(total, impossible))

    def _unpaired(self, cost: Float[Array, "n k"], impossible: Bool[Mask, "n k"]) -> Float[Array, "n"] | None:
        """Return the cost of each track without a measurement, by its m; None: as many pairs as possible (paper).

        A measurement that costs more than by the least m is never taken, and one that costs less than by m = 1 always, where no
        other competes. So few tracks need their m, which costs more than all the rest here; the others have the least.
        """
        if self.options.clutter_density_m2 is None:
            return None
        existence = np.maximum(self.people.existence, _LEAST_EXISTENCE)
        unpaired, least = (_cost_unpaired(existence, m) for m in (_LEAST_MISSED, 1.0))
        possible = ~impossible & (cost < unpaired[:, None])
        n_track, n_measurement = possible.sum(axis=0), possible.sum(axis=1)
        taken = (n_measurement == 1) & (possible & (n_track == 1) & (cost < least[:, None])).any(axis=1)
        unsure = ((n_measurement > 0) & ~taken).nonzero()[0]
        if unsure.size:
            unpaired[unsure] = _cost_unpaired(existence[unsure], np.maximum(self.missed(unsure), _LEAST_MISSED))
        return unpaired

    def _re_identified(
        self,
        cost: Costs,
        looks: Float[Array, "n k"] | float,
        colour: Float[Array, "n k"] | None,
        position: Float[Array, "k 2"],
        part: Bool[Mask, "k"],
    ) -> list[Stage]:
        """Pair occluded tracks, if any, with what no prediction explains, but for what is only a `part` of a person, or of none.

        What starts from a part is re-identified when it is confirmed. looks: the cost of the colours; colour: E, NaN if unknown.
        """
        people, rules = self.people, self.options.track_management
        hidden = people.confirmed & self._hidden() & (rules.reid_speed_m_s is not None)
        if not np.count_nonzero(hidden):
            return []
        existing = hidden & people.exist(rules.exists_above)
        explained = ((cost.mahalanobis <= EXPLAINED_BELOW) & ~hidden[:, None]).any(axis=0)
        cannot_be = ~self._same_person(existing, position, colour) | part | explained
        return [Stage(hidden, [cost.pair + looks], [cannot_be])]

    def _by_colour(self, colour: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Return the cost of a colour: −2 ln of the likelihood ratio of own and other track, or w E as in the paper.

        Some views show an occluder instead, so colour excludes no track.
        """
        weight, known = self.options.appearance.weight, ~np.isnan(colour)
        if self.options.clutter_density_m2 is None:
            return weight * np.where(known, colour, 0.0)
        return _colour_cost(weight * np.where(known, colour - EVEN_AT, 0.0))

    @property
    def _unknown_colour(self) -> float:
        """Cost of a colour that is not known, of the track or of the measurement."""
        return 0.0 if self.options.clutter_density_m2 is None else _UNKNOWN_COLOUR

    def _same_person(
        self, hidden: Bool[Mask, "n"], position: Float[Array, "k 2"], colour: Float[Array, "n k"] | None
    ) -> Bool[Mask, "n k"]:
        """Return a mask of pairs of a `hidden` track and a measurement of the same possible person, by reach and colour.

        Predictions become uninformative after a while: the reachable distance since the last measurement counts instead, and
        the colour if known. Of several candidates, the likeliest by prediction is taken.
        """
        coasted_ns, rules = self.ns - self.people.roster.measured_ns, self.options.track_management
        can_be = reachable(self.people.measured_at, coasted_ns, position, rules) & hidden[:, None]
        if colour is None:
            return can_be
        return can_be & (np.isnan(colour) | (colour <= self.options.appearance.same_below))

    def _hidden(self) -> Bool[Mask, "n"]:
        """Return a mask of the tracks also missed by the last scan, except lying people, who do not walk."""
        measured_ns = self.people.roster.measured_ns
        hidden = (self.ns - measured_ns > nanoseconds(1.5 * self.options.step_s)) & (measured_ns < self.last_ns)
        return hidden & ~self.people.posture.lying


def _cost_unpaired(existence: Float[Array, "n"], missed: Float[Array, "n"] | float) -> Float[Array, "n"]:
    """Return the cost of tracks without a measurement, −2 ln (1 − e + e m) / e."""
    return -2 * np.log((1 - existence + existence * missed) / existence)


def _colour_cost(cost: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Return −2 ln of the likelihood ratio of own and other track, where it is `cost` but some views show an occluder."""
    return -2 * np.logaddexp(np.log(WRONG_LOOK), np.log1p(-WRONG_LOOK) - 0.5 * cost)


_UNKNOWN_COLOUR = float(_colour_cost(np.zeros((1, 1)))[0, 0])


def _existence_paired(
    existence: Float[Array, "p"], cost: Float[Array, "p"], options: LaserFisheyeImmOptions
) -> Float[Array, "p"]:
    """Return the existence probability of tracks with a measurement at that cost; 1 as in the paper."""
    if options.clutter_density_m2 is None or options.track_management.survival_s is None:
        return np.ones_like(existence)
    return existence_after_detection(np.maximum(existence, _LEAST_EXISTENCE), np.exp(-0.5 * cost))
