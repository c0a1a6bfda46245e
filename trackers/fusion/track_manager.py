"""Track management of `fusion`: existence by likelihood ratios, whatever sensor shows a person or does not."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances
from trackers.filters.imm import Imm
from trackers.filters.negative_information import (
    existence_after_detection,
    existence_after_miss,
    miss_probability,
    probability_within,
    update_missed,
)
from trackers.filters.rows import marked, written
from trackers.fusion.association import EXPLAINED, LEAST_EXISTENCE, Pairs, explained
from trackers.fusion.identity import IdentityMemory
from trackers.fusion.look import APART_M, NEW, Look, most_nats, round_covariance
from trackers.fusion.options import FusionOptions
from trackers.fusion.person_tracks import People
from trackers.fusion.posture import REACH
from trackers.observations import NS_PER_S
from trackers.tracking.roster import NEVER_NS
from trackers.tracking.track_manager import TrackManager, clear_of, nanoseconds

_START_SPEED_M_S, _UNKNOWN_M = 1.0, 3.0
"""Standard deviations of the speed [m/s] and of the place [m] of a person before the first measurement."""
_FRESH_S = 0.25
"""A track measured no longer ago is confirmed, else it coasts [s]."""
_BODY_S = 3.0
"""Time without a measurement of the body after which it is not known where the person lies [s]."""
_SURE = 0.9
"""Existence from which a track is confirmed."""
_LEAST_CONFIRMED, _LEAST_TENTATIVE = 0.2, 0.05
"""Existence at which confirmed and tentative tracks end."""
_LEAST_MISSED = 1e-3
"""Probability at least that a source misses a person."""
_SAME_M, _SAME_S = 0.25, 0.7
"""Two tracks nearer than this for so long are one person's [m, s]."""
_SEAT_M = 0.2
"""Standard deviation of a sitting person's pelvis from the seat, in each step [m]; half as much of a lying one's."""
_STAYS = 20.0
"""A person who sits or lies stays so many times as long as another."""
_LIES_ALIKE_S = 20.0
"""All looks in this time that do not show who lies tell of existence what one tells [s]: furniture hides them all the while."""


class FusionTrackManager(TrackManager):
    """The rules of every tracker, and existence."""

    def __init__(self, options: FusionOptions, corners: ArrayLike | None, imm: Imm) -> None:
        super().__init__(options.track_management, corners)
        self._rules, self._step_s, self._imm = options.track_management, options.step_s, imm
        room_m2 = 0.0 if self.area is None else self.area.size_m2
        self.identities = IdentityMemory(options.identity, room_m2)
        self._scanned_ns: dict[str, int] = {}

    def initiated(self, people: People, looks: dict[int, Look], paired: list[Int[Index, "p"]], ns: int) -> People:
        """Return the tracks and those that begin at measurements that no track explains, one of each person."""
        place, number, R, hits, evidence, near = [], [], [], [], [], [people.positions]
        for (source, look), column in zip(looks.items(), paired, strict=True):
            near.append(look.position[column])
            start = (look.starts > 0) & ~marked(len(look.starts), column)
            if not start.any():
                continue
            start &= ~explained(people, look) | (look.owner == NEW)
            start &= self.clear_of_seats(people, look.position, look.covariance)
            place.append(look.position[start])
            number.append(np.full(start.sum(), source))
            R.append(look.covariance[start])
            hits.append(look.starts[start])
            evidence.append(look.evidence_of(np.flatnonzero(start)))
        if not sum(map(len, place)):
            return people
        place, number, R, hits, evidence = (np.concatenate(each) for each in (place, number, R, hits, evidence))
        free = self.may_start(place, np.concatenate(near))
        for k in np.lexsort((*place.T, R.trace(axis1=1, axis2=2))):  # the sharpest first
            if free[k]:
                off = place - place[k]
                same = np.einsum("ka,kab,kb->k", off, np.linalg.inv(R + R[k]), off) < EXPLAINED**2
                _, own = np.unique(np.where(same & free, number, -1), return_index=True)
                own = np.union1d(own[(same & free)[own]], [k])
                by = np.repeat(own, hits[own])
                p_detect = [looks[k].kind.p_detect for k in number[by].tolist()]
                existence = self.existence_of_new(np.array(p_detect), evidence[by])
                people = people.joined(self._started(people, place[own], R[own], ns, number[own], by.size, existence))
                free &= ~same & self.may_start(place, place[[k]])
        return people

    def _started(
        self,
        others: People,
        place: Float[Array, "k 2"],
        R: Float[Array, "k 2 2"],
        ns: int,
        number: Int[Index, "k"],
        n_hit: int,
        existence: float,
    ) -> People:
        """Make a tentative track of measurements by sources, each with a covariance."""
        information = np.linalg.inv(R)
        covariance = np.linalg.inv(information.sum(axis=0, keepdims=True)).astype(np.float64)
        at = np.einsum("zab,kbc,kc->za", covariance, information, place)
        state = self._imm.start(at, None, _UNKNOWN_M**2, _START_SPEED_M_S**2)
        people = People.started(
            self._imm.update(state, np.zeros(1, np.intp), at, covariance),
            at,
            ns,
            others.clothes.reference.shape[1],
            others.seen_ns.shape[1],
        )
        people.seen_ns[0, number], people.seen_at[0, number] = ns, place
        roster = people.roster.changed(n_measured=np.array([n_hit]))
        return people.changed(roster=roster, existence=np.array([existence]))

    def after_gap(self, people: People, last_ns: int, ns: int) -> People:
        """Return the tracks still followed at a look; none after a gap in all sensors longer than `coast_s`."""
        gap = ns - last_ns > nanoseconds(self._rules.coast_s)
        return self._ended(people, np.full(len(people), gap), ns)

    def aged(self, people: People, elapsed_s: float) -> People:
        """Return the tracks some time later: people sit and lie down now and then."""
        people = people.changed(posture=people.posture.later(elapsed_s, self._rules.lies_down_s).lain_down())
        seat = people.posture.seat
        row = np.flatnonzero(~np.isnan(seat[:, 0]))
        if not row.size:
            return people
        sigma_m = np.where(people.posture.lies[row], _SEAT_M / 2, _SEAT_M)
        R = round_covariance(sigma_m**2 * max(self._step_s / elapsed_s, 1.0))
        return people.in_state(self._imm.update(people.state, row, seat[row], R))

    def missed(self, people: People, look: Look) -> Float[Array, "n"]:
        """Return how probably a look would not show each track."""
        if not len(people):
            return np.empty(0)
        if look.is_sharp:
            chance = miss_probability(people.state, look.missed, people.velocity.T)
        else:
            chance = look.missed(people.positions.T) if look.known is None else look.known
        return 1 - people.posture.shown(look.by_posture) * (1 - chance)

    def detected(
        self,
        people: People,
        row: Int[Index, "p"],
        log_ratio: Float[Array, "p"],
        share: Float[Array, "p"],
        p_detect: Float[Array, "p"],
    ) -> People:
        """Return the tracks with those at `row` measured, some repeatedly, at log-likelihood ratios against other causes.

        share: of the evidence; p_detect: of the sensor.
        """
        most = most_nats(p_detect)
        log_ratio = np.where(
            share < 0, np.maximum(log_ratio, 0.0), log_ratio
        )  # what speaks against it never speaks for it
        log = np.bincount(row, share * np.clip(log_ratio, -most, most), len(people))[row]
        before = np.maximum(people.existence[row], LEAST_EXISTENCE)
        existence = existence_after_detection(before, np.exp(np.minimum(log, 50.0)))
        return people.changed(existence=written(people.existence, row, np.minimum(existence, 1 - 1e-6)))

    def felt(self, people: People, look: Look, pairs: Pairs, ns: int) -> People:
        """Return the tracks after the loads of a floor, with the postures and identities that they tell."""
        if look.load_n is None:
            return people
        load_n = look.load_n[pairs.column]
        row, load_n = pairs.row[~np.isnan(load_n)], load_n[~np.isnan(load_n)]
        if not row.size:
            return people
        share = np.clip((ns - people.weights.felt_ns[row]) / NS_PER_S / look.alike_s, 0.0, 1.0)
        posture = people.posture.weighed(row, share[:, None] * people.weights.log_postures(row, load_n))
        return self.identities.felt(people.changed(posture=posture), row, load_n, ns)

    @staticmethod
    def existence_of_new(p_detect: Float[Array, "hits"], evidence: Float[Array, "hits"]) -> float:
        """Return the existence of a track initiated by hits of sensors of these P_D: 1/2 by the first of a whole person."""
        most = most_nats(p_detect)
        return max(float(1 / (1 + np.exp(most[0] - (evidence * most).sum()))), 2 * _LEAST_TENTATIVE)

    def updated_missed(self, people: People, look: Look, share: float, elapsed_s: float, ns: int) -> People:
        """Update the tracks that neither a look nor another one of its stamp showed: likelier hidden, or not to exist.

        share: of a look's evidence.
        """
        row = np.flatnonzero(people.roster.measured_ns < ns)
        if not row.size:
            return people
        others = people.positions[people.confirmed & (people.roster.measured_ns == ns)]

        def not_shown(points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
            at = points.reshape(2, -1).T
            free = (clear_of(at, others, APART_M) & self.inside(at)).reshape(points.shape[1:])
            return np.maximum(look.missed(points) ** share * free, _LEAST_MISSED)

        state, along = people.state.select(row), people.velocity[row].T
        position = state.mean_over_modes[:2].T
        beyond = miss_probability(state, self.beyond, along) * ~people.posture.rests[row]
        if look.is_sharp:
            state, chance = update_missed(state, not_shown, along)
        else:
            chance = not_shown(position.T)
        alone = clear_of(people.place[row], others, APART_M) & self.inside(position)
        by_posture = np.where(alone[:, None], 1 - np.array(look.by_posture) * (1 - chance[:, None]), chance[:, None])
        posture = people.posture.weighed(row, look.kind.lasts_s / look.alike_s * np.log(by_posture))
        by_posture[:, 2] **= look.kind.lasts_s / _LIES_ALIKE_S
        whole = (people.posture.probability[row] * by_posture).sum(axis=1)
        # a person who may have left undetected may be anywhere where nothing would show them
        stays_s = self._rules.survival_s * np.where(posture.rests[row], _STAYS, 1.0)
        existence = existence_after_miss(
            people.existence[row], whole, elapsed_s / people.seen_ns.shape[1], stays_s, beyond
        )
        people = people.changed(existence=written(people.existence, row, existence), posture=posture)
        return people.in_state(people.state.replaced(row, state))

    def contradicted(self, people: People, number: int, missed: Float[Array, "n"], ns: int) -> People:
        """Return the tracks, less likely to exist where source `number` does not show what another one measured at stamp ns.

        missed: how probably it would not show each of them, before that.
        """
        now = people.seen_ns == ns
        row = np.flatnonzero(now.any(axis=1) & ~now[:, number])
        if not row.size:
            return people
        existence = existence_after_miss(people.existence[row], np.maximum(missed[row], _LEAST_MISSED), 0.0, np.inf)
        return people.changed(existence=written(people.existence, row, existence))

    def without_noise(self, people: People, looks: dict[int, Look], ns: int) -> People:
        """Delete tentative tracks that scanners alone have shown, once each has scanned again and not shown them.

        Beams that are split between an edge and what is behind it make clusters of few samples: behind people, where a miss
        is no evidence, but not twice at one place. One waits for slower scanners where these rather would not show it.
        """
        for look in looks.values():
            if look.is_sharp:
                self._scanned_ns |= dict.fromkeys(look.sensors, ns)
        tentative = ~people.confirmed & (people.roster.measured_ns < ns) & (people.roster.n_measured == 1)
        if not tentative.any():
            return people
        by = people.seen_ns > NEVER_NS
        due_ns = [each for each in self._scanned_ns.values() if ns - each <= nanoseconds(self._rules.coast_s)]
        noise = np.zeros(len(people), np.bool_)
        for number, look in looks.items():
            if look.is_sharp:
                waits = (people.roster.measured_ns >= min(due_ns)) & (look.missed(people.positions.T) > 0.5)
                noise |= tentative & by[:, number] & (by.sum(axis=1) == 1) & ~waits
        return people.select(~noise)

    def clear_of_seats(
        self, people: People, position: Float[Array, "k 2"], covariance: Float[Array, "k 2 2"]
    ) -> Bool[Mask, "k"]:
        """Mark measurements [m, m²] that cannot be of the body of a person who sits or lies: it has many parts.

        They are out of its reach from the place and the seat by more than their standard deviation along the line from there.
        """
        rests = people.confirmed & people.posture.rests & (people.existence > 0.5) & self.inside(people.place)
        clear = np.ones((2, len(position), np.count_nonzero(rests)), np.bool_)
        for k, at in enumerate((people.place[rests], people.posture.seat[rests])):
            off = position[:, None] - at
            away_m = np.hypot(off[..., 0], off[..., 1])
            along = off / np.maximum(away_m, 1e-9)[..., None]
            sigma_m = np.sqrt(np.einsum("kra,kab,krb->kr", along, covariance, along))
            clear[k] = ~(away_m - sigma_m <= REACH * people.stature[rests])  # no seat: NaN, clear
        return np.logical_and.reduce(clear[0] & clear[1], axis=1)

    def confirmed(self, people: People, ns: int, elapsed_s: float) -> People:
        """Confirm tracks that were measured long and often enough, and that exist; and let them go on as who they are.

        Tentative ones that may be parts of who has sat down since then, or was known to sit only then, end.
        """
        people = people.select(people.confirmed | self.clear_of_seats(people, people.positions, people.covariance))
        new = self.to_confirm(people.roster, ns, round(elapsed_s * NS_PER_S)) & (people.existence > _SURE)
        people, new = self.identities.recognized(people, new, ns)
        return people.changed(roster=self.confirm(people.roster, new))

    def is_fresh(self, people: People, ns: int) -> Bool[Mask, "n"]:
        """Mark the tracks that were measured lately."""
        return ns - people.roster.measured_ns <= nanoseconds(_FRESH_S)

    def to_report(self, people: People, ns: int, of_legs: Bool[Mask, "s"]) -> Bool[Mask, "n"]:
        """Select the confirmed tracks that are measured, or whose person is probably there and near the reported place.

        of_legs: the sources that measure legs. Of who lies and was measured by these alone it is not known where: half a bed off.
        """
        reported, fresh = self.reported(people.roster, ns), self.is_fresh(people, ns)
        row = np.flatnonzero(reported & ~fresh)
        if not row.size:
            return reported
        state, position = people.state.select(row), people.positions[row]
        within = probability_within(state, position, self._rules.within_m, people.velocity[row].T)
        posture, seen_ns = people.posture.select(row), people.seen_ns[row][:, ~of_legs].max(axis=1, initial=NEVER_NS)
        by_legs = people.roster.measured_ns[row] - seen_ns > nanoseconds(_BODY_S)
        within[posture.lies & ~posture.faces & by_legs] = 0.0
        there = (people.existence[row] * within > 0.5) & self.inside(position)
        return written(reported, row, there)

    def without_doubles(self, people: People, elapsed_s: float) -> People:
        """Delete the younger of two tracks that are known to have been at one place for long; tentative ones at once.

        Known: by their mean squared distance, of the means and of both covariances.
        """
        if len(people) < 2:
            return people
        variance_m2 = people.covariance.trace(axis1=1, axis2=2)
        square_m2 = distances(people.positions, people.positions) ** 2 + variance_m2[:, None] + variance_m2
        near = np.tril(square_m2 < _SAME_M**2, -1) & people.confirmed
        doubled_s = np.where(near.any(axis=1), people.doubled_s + elapsed_s, 0.0)
        people = people.changed(doubled_s=doubled_s)
        return people.select(doubled_s <= np.where(people.confirmed, _SAME_S, 0.0))

    def kept(self, people: People, ns: int) -> People:
        """Delete tracks that have left the area, or that probably do not exist."""
        inside = self.inside(people.positions) | (people.roster.measured_ns < ns) | people.posture.rests
        lasting = self.lasting(people.roster, ns)
        exists = people.existence > np.where(people.confirmed, _LEAST_CONFIRMED, _LEAST_TENTATIVE)
        if self.area is not None:
            lasting |= people.confirmed & (people.existence > 0.5)
        return self._ended(people, ~(inside & lasting & exists), ns)

    def _ended(self, people: People, ends: Bool[Mask, "n"], ns: int) -> People:
        """Return the tracks without those that end, whose people are remembered."""
        if not ends.any():
            return people
        self.identities.remember(people.select(ends), ns)
        return people.select(~ends)
