"""Tracks by laser points alone: one particle filter per person, batched, with the two-feet walking model as proposal.

A merged group is one target (Song et al., section V.B): one set of particles that the middle of the group's points weighs. A
group is a connected component of the pairs that are merged. While their points form one cluster, all members share the
particles and have their place. Clusters that stay apart are a split: each goes on as a target of its own, about its middle.
The scanners do not tell which member is in which cluster, so that the order of tracks decides it, and after them the
classifiers (`reidentification`). A cluster gets one member, the remaining ones go to the widest. A person hidden as the
group parted comes up later: a new target is a member of a merged one that can have walked there since it was alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, global_nearest_neighbour, linked
from trackers.filters.negative_information import update_missed_particles
from trackers.filters.particle import Cloud, ParticleFilter
from trackers.laser.group import Points, ScannerGroup
from trackers.laser_vision_learning.options import LaserVisionLearningOptions
from trackers.laser_vision_learning.situations import SituationOptions, Situations, assessed
from trackers.laser_vision_learning.walking_model import STATE_SIZE, WalkerTracks, WalkingModel, log_apart
from trackers.likelihood.laser_points import Shares, log_likelihood, shares, unexplained_people
from trackers.observations import NS_PER_S, Observation
from trackers.tracking.track_manager import TrackManager, measured_now, measured_often, reachable


class Walkers:
    """Tracks by the scanners of a role; `step` is called with frames in order.

    corners: (c, 2) of the tracked area [m] (None: unlimited).
    """

    def __init__(
        self,
        scanners: ScannerGroup,
        corners: ArrayLike | None,
        options: LaserVisionLearningOptions,
        rng: np.random.Generator,
    ) -> None:
        self.options, self.rng, self._scanners = options, rng, scanners
        self._manager = TrackManager(options.track_management, corners)
        self._model = WalkingModel(options.walking)
        self._filter = ParticleFilter()
        self.people = WalkerTracks.started(Cloud.of(np.empty((STATE_SIZE, 0, options.particles))), 0, 0)
        self.situations = Situations.none(self.people.serial)
        self._next_serial, self.ns = 0, 0
        self._looked_ns = 0  # stamp of the last scan
        self._has_started = False

    @property
    def recently_measured(self) -> Bool[Mask, "n"]:
        """Mask of the tracks missing for less time than they are reported."""
        limit_s = self.options.track_management.report_s
        return self.people.missing_s <= (np.inf if limit_s is None else limit_s)

    def step(self, observations: Mapping[str, Observation], ns: int) -> None:
        """Move all tracks to a frame [ns], and weight them by its scans; without any they only move."""
        if not self._has_started:
            self.ns, self._looked_ns, self._has_started = ns, ns, True
        options, rules, last_look_ns = self.options, self.options.track_management, self._looked_ns
        step_s, elapsed_s, self.ns = (ns - self.ns) / NS_PER_S, (ns - last_look_ns) / NS_PER_S, ns
        if not observations.keys() & self._scanners.names:
            self._walk_on(step_s)
            return
        self._looked_ns = ns
        points = self._scanners.points(observations)
        if self._manager.area is not None:
            points = points.select(self._manager.area.contains(points.place))
        if elapsed_s > rules.coast_hidden_s:
            self.people = self.people.select(np.zeros(len(self.people), bool))
        cloud = self._moved(self._filter.resampled(self.people.cloud, self.rng), step_s, last_look_ns)
        legs = self._model.legs(cloud.state)
        whose = shares(points, cloud.expectation(legs), options.points, self._unscanned_s(ns))
        before, clusters, unknown = self.situations.of(self.people.serial), None, whose.unknown
        seen = whose.legs >= rules.detect_legs
        if options.situations.merged == "one":
            clusters = clusters_of(before, self.people.places, points, whose, rules.start_legs)
            seen |= np.isfinite(clusters.middle[:, 0])
            unknown = np.where(clusters.taken, 0.0, unknown)
        likelihood = log_likelihood(points, whose, legs, options.points)
        if options.walking.apart_m:
            places = cloud.expectation(cloud.state[:2]).T
            likelihood += log_apart(cloud.state, places, self._two_bodies(before), options.walking.apart_m)
        weights = cloud.weights.updated(likelihood)
        roster = self.people.roster.measured(np.flatnonzero(seen), ns, Cloud(cloud.state, weights))
        self.people = self._missed(self.people.changed(roster=roster), observations, elapsed_s)
        self.situations = now = assessed(
            before,
            self.people.serial,
            self.people.places,
            roster.confirmed,
            (ns - roster.measured_ns) / NS_PER_S,
            points,
            whose.owner,
            ns,
            options.situations,
            None if clusters is None else clusters.together,
        )
        alone = ~np.logical_or.reduce(now.merged, axis=1)
        self.people = self.people.changed(alone_ns=np.where(alone, ns, self.people.alone_ns))
        if clusters is not None:
            one = as_one(self.people.cloud, cloud, before.merged, now.merged, clusters)
            self.people = self.people.changed(roster=self.people.roster.changed(state=one))
        self._confirm()
        self._end(elapsed_s)
        self._start(*unexplained_people(points, unknown, options.points))

    def _walk_on(self, step_s: float) -> None:
        """Move all tracks in a frame without a scan, which is no evidence."""
        cloud = self._moved(self.people.cloud, step_s, self._looked_ns)
        self.people = self.people.changed(roster=self.people.roster.changed(state=cloud))

    def _moved(self, cloud: Cloud, step_s: float, last_look_ns: int) -> Cloud:
        """Return the particles `step_s` later; a person missed by the last scan is likelier to stop."""
        seen_ns = np.maximum(self.people.roster.measured_ns, self.people.pictured_ns)
        missed = (seen_ns < last_look_ns).astype(float)
        return Cloud(self._model.move(cloud.state, step_s, missed, self.rng), cloud.weights)

    def _unscanned_s(self, ns: int) -> Float[Array, "n"]:
        """Return for how long scanners have missed each track [s], whatever a camera shows; infinite for tentative ones."""
        people, measured_ns = self.people, self.people.roster.measured_ns
        scanned_s = (ns - measured_ns) / NS_PER_S
        missing_s = np.where(
            people.pictured_ns > measured_ns, np.maximum(scanned_s, people.missing_s), people.missing_s
        )
        return np.where(people.roster.confirmed, missing_s, np.inf)

    def _missed(self, people: WalkerTracks, observations: Mapping[str, Observation], elapsed_s: float) -> WalkerTracks:
        """Update missed tracks: likelier where they are undetectable, with a missing time growing with their detection
        probability.
        """
        rules, seen = self.options.track_management, measured_now(people.roster, self.ns)
        missing_s = np.where(
            seen, np.maximum(people.missing_s - rules.regained * elapsed_s, 0), people.missing_s + elapsed_s
        )
        missed = (people.roster.confirmed & ~seen).nonzero()[0]
        if missed.size == 0:
            return people.changed(missing_s=missing_s)
        cloud, hidden = update_missed_particles(
            people.cloud.select(missed), lambda places: self._scanners.missed(observations, places)
        )
        missing_s[missed] -= elapsed_s * hidden * (1 - rules.coast_s / rules.coast_hidden_s)
        roster = people.roster.changed(state=people.cloud.replaced(missed, cloud))
        return people.changed(roster=roster, missing_s=missing_s)

    def _confirm(self) -> None:
        """Confirm tracks measured often enough: as new ones, or as missing people nearby."""
        people, roster, rules = self.people, self.people.roster, self.options.track_management
        often = measured_often(roster, self.ns, rules.confirm_early_hits)
        often |= self._manager.to_confirm(roster, self.ns, 0)
        new = np.flatnonzero(often)
        if new.size == 0:
            return
        merged = self._merged
        rows = np.flatnonzero(roster.confirmed & (merged | ~measured_now(roster, self.ns)))
        places, missed_ns = people.places, self.ns - roster.measured_ns[rows]
        away_m = distances(places[rows], places[new])
        allowed = reachable(places[rows], missed_ns, places[new], rules)
        merged_s = (self.ns - people.alone_ns[rows]) / NS_PER_S
        reach_m = self.options.situations.interacting_m + SituationOptions.parts_m_s * merged_s
        allowed |= merged[rows, None] & (away_m < reach_m[:, None])
        known, again = global_nearest_neighbour(away_m, allowed)
        found = rows[known]
        people = people.continued_as(found, new[again])
        self.situations = self.situations.without(people.serial[found[merged[found]]])
        is_new = often.copy()
        is_new[new[again]] = False
        people = people.changed(roster=self._manager.confirm(people.roster, is_new))
        self.people = people.select(np.delete(np.arange(len(people)), new[again]))

    def _two_bodies(self, before: Situations) -> Bool[Mask, "n n"]:
        """Mask of the pairs of tracks that are two people, each of them a target: confirmed, and not merged to one."""
        sure = self.people.roster.confirmed
        pairs = sure & sure[:, None] & ~np.eye(sure.size, dtype=np.bool_)
        return pairs & ~before.merged if self.options.situations.merged == "one" else pairs

    @property
    def _merged(self) -> Bool[Mask, "n"]:
        """Mask of the members of merged targets, of whom any may come up beside the others; none where each is a target."""
        if self.options.situations.merged == "each":
            return np.zeros(len(self.people), np.bool_)
        return np.logical_or.reduce(self.situations.of(self.people.serial).merged, axis=1)

    def _end(self, elapsed_s: float) -> None:
        rules, people, places = self.options.track_management, self.people, self.people.places
        sure = people.roster.confirmed
        kept = people.missing_s <= np.where(sure, rules.coast_s, max(rules.tentative_coast_s, elapsed_s))
        if not sure.all():
            # the younger of two tracks at one position was never a person
            kept &= sure | ~np.tril(distances(places, places) < rules.start_apart_m, -1).any(axis=1)
        kept &= self._manager.inside(places)
        if not kept.all():
            self.people = people.select(kept)

    def _start(self, place: Float[Array, "m 2"], legs: Float[Array, "m"]) -> None:
        new = legs >= self.options.track_management.start_legs
        if new.any():
            new &= self._manager.may_start(place, self.people.places)
        if new.any():
            state = Cloud.of(self._model.start(place[new], self.options.particles, self.rng))
            self.people = self.people.joined(WalkerTracks.started(state, self.ns, self._next_serial))
            self._next_serial += len(state)


_SIGMA_M = 0.1
"""Standard deviation of the middle of a group's points about its particles [m]."""


@dataclass(frozen=True, eq=False)
class GroupClusters:
    """Clusters of points of n tracks, of which those of merged groups matter, in a frame."""

    together: Bool[Mask, "n n"]  # pairs of one group whose points are in one cluster, or in none
    middle: Float[Array, "n 2"]  # of each member's cluster; NaN of others [m]
    taken: Bool[Mask, "k"]  # points of groups


def clusters_of(
    before: Situations, places: Float[Array, "n 2"], points: Points, whose: Shares, least_legs: float
) -> GroupClusters:
    """Cluster the points of each group that was merged before, and allot its members to the clusters.

    places: of the tracks [m]; least_legs: legs' widths of points from which a cluster is somebody.
    """
    n, rules = len(places), SituationOptions
    group, owner = linked(before.merged), whose.owner
    together, middle, taken = before.merged.copy(), np.full((n, 2), np.nan), np.zeros(owner.size, np.bool_)
    for each in np.flatnonzero(np.bincount(group, minlength=n) > 1).tolist():
        rows = np.flatnonzero(group == each)
        near = distances(points.place, places[rows]).min(axis=1, initial=np.inf) < rules.lateral_m
        own = np.flatnonzero(np.isin(owner, rows) | ((owner < 0) & near))
        taken[own] = True
        label = linked(distances(points.place[own], points.place[own]) < rules.link_m)
        legs = np.bincount(label, whose.weight[own], minlength=own.size)
        wide = np.flatnonzero(legs >= least_legs)
        wide = np.sort(wide[(-legs[wide]).argsort(kind="stable")[: rows.size]])
        if wide.size == 0:
            continue
        members = np.ones(wide.size, np.intp)
        for _ in range(rows.size - wide.size):
            members[(legs[wide] / members).argmax()] += 1
        part = np.repeat(np.arange(wide.size), members)
        together[np.ix_(rows, rows)] = (part[:, None] == part) & ~np.eye(rows.size, dtype=np.bool_)
        for number, cluster in enumerate(wide.tolist()):
            its = own[label == cluster]
            middle[rows[part == number]] = np.average(points.place[its], axis=0, weights=whose.weight[its])
    return GroupClusters(together, middle, taken)


def as_one(
    cloud: Cloud, moved: Cloud, before: Bool[Mask, "n n"], now: Bool[Mask, "n n"], clusters: GroupClusters
) -> Cloud:
    """Return the particles with one set for each merged group, and of each track that has split from one.

    cloud: weighed by points; moved: the same before. before, now: pairs that were, and are, merged.
    """
    places, places_before = (each.expectation(each.state[:2]).T for each in (cloud, moved))
    group, group_before = linked(now), linked(before)
    size = np.bincount(group, minlength=len(group))
    for each in np.flatnonzero(size).tolist():
        rows: Int[Index, "m"] = np.flatnonzero(group == each)
        was = np.flatnonzero(group_before == group_before[rows[0]])
        if rows.size == 1 and was.size == 1:
            continue
        known = np.isfinite(clusters.middle[rows, 0])
        middle = np.where(known[:, None], clusters.middle[rows], places[rows]).mean(axis=0)
        one = moved.select(rows[:1])
        if not np.array_equal(rows, was):
            state = one.state.copy()
            state[:2] += (middle - places_before[rows[0]])[:, None, None]
            one = replace(one, state=state)
        elif known.any():
            square = ((one.state[:2] - middle[:, None, None]) ** 2).sum(axis=0)
            one = replace(one, weights=one.weights.updated(-0.5 * square / _SIGMA_M**2))
        cloud = cloud.replaced(rows, one.select(np.zeros(rows.size, np.intp)))
    return cloud
