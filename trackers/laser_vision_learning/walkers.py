"""Everybody as laser points alone show them: a particle filter a person, batched, with the two-feet walking model as proposal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from trackers.area import Area
from trackers.arrays import Array
from trackers.filters.absence import cloud_not_seen
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud, ParticleFilter
from trackers.filters.rows import Rows
from trackers.laser.group import ScannerGroup
from trackers.laser_vision_learning.options import LaserVisionLearningOptions
from trackers.laser_vision_learning.points import log_likelihood, newcomers, shares
from trackers.laser_vision_learning.walking import HEADING, SPEED, STATE_SIZE, WalkingModel
from trackers.observations import NS_PER_S, Observation
from trackers.tracking.lifecycle import clear_of, measured_now, measured_often
from trackers.tracking.roster import Roster


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, oldest first."""

    roster: Roster[Cloud]
    missing_s: Float[Array, "n"]  # for how long they should have been seen and were not, less what they were seen since

    @classmethod
    def started(cls, state: Cloud, ns: int) -> Self:
        """Tentative tracks in `state`, first measured at stamp ns."""
        return cls(Roster.started(state, ns), np.zeros(len(state)))

    @property
    def cloud(self) -> Cloud:
        """Their particles."""
        return self.roster.state

    @property
    def places(self) -> Float[Array, "n 2"]:
        """Where everybody is [m]."""
        return self.cloud.expectation(self.cloud.state[:2]).T

    @property
    def velocities(self) -> Float[Array, "n 2"]:
        """How everybody goes [m/s]."""
        heading, speed = self.cloud.state[[HEADING, SPEED]].astype(np.float32)
        return self.cloud.expectation(np.stack([speed * np.cos(heading), speed * np.sin(heading)])).T


class Walkers:
    """The people that the scanners of a role follow; `step` is called with moments in order.

    area: where they are followed (None: everywhere).
    """

    def __init__(
        self, scanners: ScannerGroup, area: Area | None, options: LaserVisionLearningOptions, rng: np.random.Generator
    ) -> None:
        self.options, self._scanners, self._area, self._rng = options, scanners, area, rng
        self._model = WalkingModel(options.walking)
        self._filter = ParticleFilter(options.resampling, options.resample_below)
        self.people = People.started(Cloud.of(np.empty((STATE_SIZE, 0, options.particles))), 0)
        self._next_id, self.ns = 1, 0

    def step(self, observations: Mapping[str, Observation], ns: int) -> None:
        """Everybody at a moment [ns] that its scans show."""
        options, life, before = self.options, self.options.life, self.ns
        elapsed_s, self.ns = (ns - before) / NS_PER_S, ns
        points = self._scanners.points(observations, ns)
        if self._area is not None:
            points = points.select(self._area.contains(points.place))
        if elapsed_s > life.coast_hidden_s:
            self.people = self.people.select(np.zeros(len(self.people), bool))
        unseen = (self.people.roster.measured_ns < before).astype(float)
        cloud = self._filter.resampled(self.people.cloud, self._rng)
        cloud = Cloud(self._model.move(cloud.state, elapsed_s, unseen, self._rng), cloud.weights)
        legs = self._model.legs(cloud.state)
        whose = shares(points, cloud.expectation(legs), options.points)
        seen = whose.legs >= life.seen_legs
        weights = cloud.weights.updated(log_likelihood(points, whose, legs, options.points))
        roster = self.people.roster.measured(np.flatnonzero(seen), ns, Cloud(cloud.state, weights))
        self.people = self._missed(self.people.changed(roster=roster), observations, elapsed_s)
        self._confirm()
        self._end()
        self._start(*newcomers(points, whose.unknown, options.points))

    def _missed(self, people: People, observations: Mapping[str, Observation], elapsed_s: float) -> People:
        """Whoever was not seen is likelier where nothing would show them, and missing the more, the likelier it would have."""
        life, seen = self.options.life, measured_now(people.roster, self.ns)
        missing_s = np.where(
            seen, np.maximum(people.missing_s - life.found * elapsed_s, 0), people.missing_s + elapsed_s
        )
        missed = (people.roster.confirmed & ~seen).nonzero()[0]
        if missed.size == 0:
            return people.changed(missing_s=missing_s)
        cloud, hidden = cloud_not_seen(
            people.cloud.select(missed), lambda places: self._scanners.missed(observations, places)
        )
        missing_s[missed] -= elapsed_s * hidden * (1 - life.coast_s / life.coast_hidden_s)
        roster = people.roster.changed(state=people.cloud.replaced(missed, cloud))
        return people.changed(roster=roster, missing_s=missing_s)

    def _confirm(self) -> None:
        roster = self.people.roster
        new = np.flatnonzero(measured_often(roster, self.ns, self.options.life.confirm_hits))
        self.people = self.people.changed(roster=roster.confirm(new, self._next_id))
        self._next_id += new.size

    def _end(self) -> None:
        life, people, places = self.options.life, self.people, self.people.places
        sure = people.roster.confirmed
        # the younger of two who are where one is has never been anybody
        near = np.tril(distances(places, places) < life.apart_m, -1).any(axis=1)
        kept = (people.missing_s <= np.where(sure, life.coast_s, life.tentative_s)) & (sure | ~near)
        if self._area is not None:
            kept &= self._area.contains(places)
        self.people = people.select(kept)

    def _start(self, place: Float[Array, "m 2"], legs: Float[Array, "m"]) -> None:
        life = self.options.life
        new = (legs >= life.new_legs) & clear_of(place, self.people.places, life.apart_m)
        if new.any():
            state = Cloud.of(self._model.start(place[new], self.options.particles, self._rng))
            self.people = self.people.joined(People.started(state, self.ns))
