"""Track management with existence: the probability that a missed track still exists, near enough to be reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.imm import Imm
from trackers.filters.negative_information import (
    existence_after_miss,
    miss_probability,
    probability_within,
    update_missed,
)
from trackers.filters.rows import written
from trackers.laser_fisheye_imm.laser_tracks import LaserTracks
from trackers.laser_fisheye_imm.options import LaserFisheyeImmOptions
from trackers.likelihood.legs import PositionLikelihood
from trackers.tracking.roster import Stage, associate
from trackers.tracking.track_manager import TrackManager, clear_of, measured_now, nanoseconds, reachable

SeenBehind = Callable[[Array], Mask]
"""Returns a mask (k,) of room points (k, 2) [m]."""
_AT_REST = 0.01
"""Variance of a lying person's speed [m²/s²]."""
_LIKELY = 0.5


class ImmTrackManager(TrackManager):
    """Common track management with rules of existence and posture, and the stamp of the last scan.

    corners: (c, 2) of the area of people [m] (None: unlimited).
    """

    def __init__(self, options: LaserFisheyeImmOptions, corners: ArrayLike | None, imm: Imm) -> None:
        super().__init__(options.track_management, corners)
        self._options, self._imm = options, imm
        self._scanned_ns: dict[str, int] = {}  # stamp of the frame with each scanner's last scan

    def looked(self, ns: int, scanners: Iterable[str]) -> None:
        """Note the scans of these scanners in the frame at stamp ns."""
        self._scanned_ns |= dict.fromkeys(scanners, ns)

    def confirmed(self, people: LaserTracks, ns: int, seen_behind: SeenBehind | None) -> LaserTracks:
        """Confirm tracks that were measured long enough, and have moved if only that distinguishes them from the room.

        seen_behind: selects places behind which something was measured; None where the background is known.
        """
        if people.confirmed.all():
            return people
        rules, step_ns = self._options.track_management, int(nanoseconds(self._options.step_s))
        if seen_behind is None:
            new = known = self.to_confirm(people.roster, ns, step_ns)
        else:
            may_be = self.to_confirm(people.roster, ns, step_ns, max(rules.confirm_s, rules.confirm_learned_s))
            known = written(may_be, may_be, seen_behind(people.positions[may_be]))
            new = known | self.to_confirm(people.roster, ns, step_ns, max(rules.confirm_s, rules.confirm_open_s))
        old, again = self._re_identified(people, new.nonzero()[0], ns)  # who stands still may be a hidden person
        moved = people.positions - people.born_at
        new = np.delete(new & (known | (np.hypot(moved[:, 0], moved[:, 1]) >= rules.confirm_moved_m)), again)
        people = people.continued(old, again)
        return people.changed(roster=self.confirm(people.roster, new))

    def confirmed_at_once(
        self, people: LaserTracks, n_sample: Int[Index, "k"], ns: int, seen_behind: SeenBehind | None
    ) -> LaserTracks:
        """Confirm those of the last k tracks, first measured at ns, that so many samples show that they are no noise.

        One that a hidden track can have become waits until it was measured long enough.
        """
        least = self._options.track_management.confirm_samples
        if least is None or not (n_sample >= least).any():
            return people
        new = np.append(np.zeros(len(people) - n_sample.size, np.bool_), n_sample >= least)
        if seen_behind is not None:
            new = written(new, new, seen_behind(people.positions[new]))
        new[self._re_identified(people, new.nonzero()[0], ns)[1]] = False
        return people.changed(roster=self.confirm(people.roster, new))

    def _re_identified(
        self, people: LaserTracks, new: Int[Index, "k"], ns: int
    ) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
        """Pair hidden tracks with those about to be confirmed that they can have become, the likeliest by their predictions.

        A track that was measured after the other began is another person.
        """
        rules, no_track = self._options.track_management, np.empty(0, np.intp)
        hidden = (
            people.confirmed & ~measured_now(people.roster, ns) & ~people.posture.lying & self._exists(people)
        ).nonzero()[0]
        if new.size == 0 or hidden.size == 0:
            return no_track, no_track
        coasted_ns, places = ns - people.roster.measured_ns[hidden], people.positions[new]
        can_be = reachable(people.measured_at[hidden], coasted_ns, places, rules)
        can_be &= people.roster.measured_ns[hidden, None] < people.roster.born_ns[new]
        clothes = people.clothes.select(new)
        colour = people.clothes.select(hidden).distance(clothes.reference, clothes.known)
        if colour is not None:
            can_be &= np.isnan(colour) | (colour <= self._options.appearance.same_below)
        variance_m2 = np.full(new.size, self._options.trunk.variance_m2)
        measured = PositionLikelihood(places, variance_m2, self._options.trunk.gate_m)
        cost = -2 * measured.log_likelihood(people.state.select(hidden))
        rows, columns = associate([Stage(np.ones(hidden.size, np.bool_), [cost], [~can_be])])
        return hidden[rows], new[columns]

    def update_missed_tracks(
        self,
        people: LaserTracks,
        ns: int,
        elapsed_s: float,
        missed: Callable[[Float[Array, "2 *n"]], Float[Array, "*n"]],
    ) -> LaserTracks:
        """Update missed tracks: likelier at undetectable positions, and less likely to exist.

        missed: miss probability of the frame, a share of a period, at room points [m].
        """
        rules = self._options.track_management
        measured = measured_now(people.roster, ns)
        coasting = (people.confirmed & ~measured).nonzero()[0]
        if coasting.size == 0:
            return people
        taken = people.positions[measured & people.confirmed]

        def not_shown(points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
            free = clear_of(points.reshape(2, -1).T, taken, rules.apart_m).reshape(points.shape[1:])
            return missed(points) * free

        state = people.state.select(coasting)
        along = self._imm.velocity(state)
        beyond = miss_probability(state, self.beyond, along)
        state, chance = update_missed(state, not_shown, along)
        sitting, posture = self._options.posture, people.posture.select(coasting)
        seated, seat = posture.seated(people.measured_at[coasting], sitting), np.nan_to_num(posture.seat)
        alone = clear_of(seat, taken, clearance_m=rules.apart_m)
        posture, chance = posture.missed(seated, chance, alone, elapsed_s, sitting)
        at_rest = self._imm.start(seat, None, sitting.place_m**2, _AT_REST)
        state = state.replaced(posture.lying, at_rest.select(posture.lying))
        existence = people.existence
        if rules.survival_s is not None:
            stays_s = np.where(seated, sitting.stays_s, rules.survival_s)
            beyond = np.where(seated, 0.0, beyond)
            still = existence_after_miss(existence[coasting], chance, elapsed_s, stays_s, beyond)
            existence = written(existence, coasting, still)
        posture = people.posture.replaced(coasting, posture)
        return people.in_state(people.state.replaced(coasting, state)).changed(existence=existence, posture=posture)

    def to_report(self, people: LaserTracks, ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the confirmed tracks that are measured, or whose person probably exists near the reported
        position.

        A coasting track is reported if its person exists within `within_m` of the mean with more than `exists_above` by the
        posterior. One that spreads too far, in a shadow, is kept for re-identification without being reported.
        """
        reported, measured = self.reported(people.roster, ns), measured_now(people.roster, ns)
        if measured.all():  # in the area, or the track would have been deleted
            return reported
        there = self.inside(people.positions) & self._exists(people)
        within_m = self._options.track_management.within_m
        if within_m is not None:
            chance = people.existence * probability_within(
                people.state, people.positions, within_m, self._imm.velocity(people.state)
            )
            there &= chance > self._options.track_management.exists_above
        return reported & (measured | there)

    def remaining(
        self, people: LaserTracks, ns: int, missed: Callable[[Float[Array, "2 *n"]], Float[Array, "*n"]]
    ) -> LaserTracks:
        """Delete tracks that have left the area, or were missed for long; missed: as in `update_missed_tracks`."""
        # a prediction outside the area is not yet a person who has left
        inside = self.inside(people.positions) | ~measured_now(people.roster, ns)
        return people.select((self._kept(people, ns) | self._awaits_scan(people, ns, missed)) & inside)

    def _awaits_scan(
        self, people: LaserTracks, ns: int, missed: Callable[[Float[Array, "2 *n"]], Float[Array, "*n"]]
    ) -> Bool[Mask, "n"]:
        """Return a mask of the tentative tracks that a scanner, slower than others, may still confirm.

        It has not scanned since the track was measured, and the scans of this frame would rather not have shown the person.
        """
        rules, roster = self._options.track_management, people.roster
        due_ns = [each for each in self._scanned_ns.values() if ns - each <= nanoseconds(rules.coast_s)]
        awaits = ~roster.confirmed & ~measured_now(roster, ns) & (roster.measured_ns >= min(due_ns, default=ns))
        if rules.survival_s is None or not awaits.any():
            return np.zeros(len(people), np.bool_)
        return written(awaits, awaits, missed(people.positions[awaits].T) > _LIKELY)

    def before(self, people: LaserTracks, last_ns: int, ns: int) -> LaserTracks:
        """Return the tracks kept at the frame of stamp ns, if the one before was at `last_ns`.

        Time without scans is no evidence against a track; after a gap longer than `coast_s` all tracks are deleted.
        """
        gap = ns - last_ns > nanoseconds(self._options.track_management.coast_s)
        return people.select(np.zeros(len(people), np.bool_)) if gap else people

    def _kept(self, people: LaserTracks, ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the tracks kept after a frame: recently measured ones, and longer if they probably exist."""
        rules, roster = self._options.track_management, people.roster
        kept = self.lasting(roster, ns)
        looked = ns - max(self._scanned_ns.values(), default=0) <= nanoseconds(rules.coast_s)
        # without an area there is always room behind the walls
        if looked and rules.survival_s is not None and self.area is not None:
            kept |= roster.confirmed & self._exists(people)
        return kept

    def _exists(self, people: LaserTracks) -> Bool[Mask, "n"]:
        """Return a mask of the tracks that probably exist."""
        return people.exist(self._options.track_management.exists_above)
