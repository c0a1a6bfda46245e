"""Head filter (section 5): x, y, z and pan, some particles drawn about the body, weighted by appearance from all sides."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from trackers.area import Area
from trackers.arrays import Array, Index
from trackers.camera_floor_particle.body import FILTER, in_room, redrawn, smoothed, spread
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import aligned, learned, looks, pan_bin, turned, whole
from trackers.camera_floor_particle.people import PAN_BINS, People
from trackers.filters.circular import circular_mean, drawn
from trackers.filters.particle import Cloud, LikelihoodStage, MixtureProposal, cascade
from trackers.likelihood.colour import point_log_likelihood, window_log_likelihood
from trackers.vision.views import BINS, Views, padded_roots

_CROWN_M = np.array([[0.0], [0.0], [0.15]])
"""From the middle of a head to a point above it."""


class HeadFilter:
    """Filter that moves and weights the head particles of all tracks at once, about estimated bodies.

    area: the room, None: no limit.
    """

    def __init__(self, options: CameraFloorParticleOptions, area: Area | None) -> None:
        self._options = options
        self._area = area

    def step(
        self,
        people: People,
        offset: Float[Array, "n 3"],
        dt: float,
        views: Views,
        rng: np.random.Generator,
    ) -> People:
        """Return the tracks with their heads `dt` seconds later. offset: from body to head before, h_{t−1} (eq. 7) [m]."""
        options = self._options.head
        turn = np.full((1, len(people)), np.deg2rad(options.turn_deg) * np.sqrt(options.motion.steps(dt)))
        sigma = np.concatenate([spread(people.velocity, dt, options.motion), turn])[..., None]
        shift = np.concatenate([(people.head_velocity * dt).T, np.zeros((1, len(people)))])[..., None]
        about = np.concatenate([(people.place + offset).T, people.pan[None]])[..., None]

        def move(state: Array, rng: np.random.Generator) -> Array:
            return state + shift + sigma * rng.standard_normal(state.shape)

        def draw(count: int, rng: np.random.Generator) -> Array:
            return about + sigma * rng.standard_normal((4, len(people), count))

        stages = [in_room(self._area), self._near_body(people), self._seen_by(views, people)]
        cloud = FILTER.step_proposed(people.head, MixtureProposal(options.share, move, draw), cascade(stages), rng)
        place = cloud.expectation(cloud.state[:3]).T
        velocity = smoothed(people.head_velocity, place - people.head_place, dt, options.motion)
        if (lost := cloud.weights.lost).any():  # no head particle is left: the head stays at its offset from the body
            cloud = redrawn(cloud, draw(options.particles, rng))
            place = np.where(lost[:, None], people.place + offset, place)
            velocity = np.where(lost[:, None], 0.0, velocity)
        people = people.changed(head=cloud, head_place=place, head_velocity=velocity)
        if options.facing is None:
            pan, _ = circular_mean(cloud.state[3], cloud.weights.normalised)
            return people.changed(pan=np.atleast_1d(pan))
        seen = looks(people, views, options)
        turns = np.deg2rad(options.turn_deg) * np.sqrt(options.motion.steps(dt))
        people = aligned(turned(people, dt, turns, seen, options.facing))
        if options.facing.learning and seen is not None:
            people = learned(people, seen, options.facing.learning)
        state = cloud.state.copy()
        state[3] = drawn(people.facing, options.particles, rng)
        return people.changed(head=Cloud(state, cloud.weights))

    def _near_body(self, people: People) -> LikelihoodStage:
        options = self._options.head

        def log_likelihood(state: Array, of: Index) -> Array:
            off = state[:3] - people.place[of].T
            away = np.sqrt(np.einsum("ck,ck->k", off, off))
            return np.where((away >= options.nearest_m) & (away <= options.farthest_m), 0.0, -np.inf)

        return log_likelihood

    def _seen_by(self, views: Views, people: People) -> LikelihoodStage:
        options = self._options.head
        hair = whole(people.hair, options.parts[0] * options.parts[1]).reshape(-1, BINS.size)
        hair = padded_roots(hair)

        def log_likelihood(state: Array, of: Index) -> Array:
            look = views.look(state[:3])
            total = point_log_likelihood(look.seen, look.on_foreground, options.checks, -options.colour)
            reference = of * PAN_BINS + pan_bin(views.bearings(state) - state[3])
            references = [(hair, number) for number in reference]
            total = window_log_likelihood(total, state[:3], look, options.window, references, options.colour)
            if options.covered:
                total += options.covered * views.look(state[:3] + _CROWN_M).on_foreground.sum(axis=0)
            return total

        return log_likelihood
