"""Tracks by laser points alone: one particle filter per person, batched, with the two-feet walking model as proposal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import distances, global_nearest_neighbour
from trackers.filters.negative_information import update_missed_particles
from trackers.filters.particle import Cloud, ParticleFilter
from trackers.laser.group import ScannerGroup
from trackers.laser_vision_learning.merged_target import as_one, clusters_of
from trackers.laser_vision_learning.options import LaserVisionLearningOptions
from trackers.laser_vision_learning.situations import Situations, assessed
from trackers.laser_vision_learning.walking import STATE_SIZE, WalkerTracks, WalkingModel
from trackers.likelihood.laser_points import log_likelihood, shares, unexplained_people
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

    def new_ids(self, count: int) -> Int[Index, "k"]:
        """Return the next ids."""
        return self._manager.new_ids(count)

    @property
    def recently_measured(self) -> Bool[Mask, "n"]:
        """Mask of the tracks missing for less time than they are reported."""
        limit_s = self.options.track_management.report_s
        return self.people.missing_s <= (np.inf if limit_s is None else limit_s)

    def step(self, observations: Mapping[str, Observation], ns: int) -> None:
        """Move all tracks to a frame [ns], and weight them by its scans; without any they only move."""
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
        weights = cloud.weights.updated(log_likelihood(points, whose, legs, options.points))
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
        missed_rows = np.flatnonzero(roster.confirmed & ~measured_now(roster, self.ns))
        places, missed_ns = people.places, self.ns - roster.measured_ns[missed_rows]
        allowed = reachable(places[missed_rows], missed_ns, places[new], rules)
        known, again = global_nearest_neighbour(distances(places[missed_rows], places[new]), allowed)
        people = people.continued_as(missed_rows[known], new[again])
        is_new = often.copy()
        is_new[new[again]] = False
        people = people.changed(roster=self._manager.confirm(people.roster, is_new))
        self.people = people.select(np.delete(np.arange(len(people)), new[again]))

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
