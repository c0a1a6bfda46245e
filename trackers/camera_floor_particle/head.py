"""The head's filter (section 5): x, y, z and pan, some particles drawn about the body, weighted by how heads look around."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from trackers.area import Area
from trackers.arrays import Array, Index
from trackers.camera_floor_particle.body import FILTER, in_room, ruled, spread
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.pan import aligned, bearing, drawn, learned, looks, pan_bin, turned, whole
from trackers.camera_floor_particle.people import PAN_BINS, People
from trackers.camera_floor_particle.views import View, similarity
from trackers.filters.circular import circular_mean
from trackers.filters.particle import Cloud
from trackers.filters.proposal import MixtureProposal
from trackers.filters.staged import LikelihoodStage, staged


class HeadFilter:
    """Moves and weights the head particles of everybody at once, about bodies that have been estimated."""

    def __init__(self, options: CameraFloorParticleOptions, area: Area | None) -> None:
        self._options = options
        self._area = area

    def step(
        self,
        people: People,
        offset: Float[Array, "n 3"],
        dt: float,
        views: Sequence[View],
        rng: np.random.Generator,
    ) -> People:
        """Everybody's head `dt` seconds later. offset: from body to head before, h_{t−1} (eq. 7) [m]."""
        options = self._options.head
        turn = np.full((1, len(people)), np.deg2rad(options.turn_deg))
        sigma = np.concatenate([spread(people.velocity, options.motion), turn])[..., None]
        shift = np.concatenate([(people.head_velocity * dt).T, np.zeros((1, len(people)))])[..., None]
        about = np.concatenate([(people.place + offset).T, people.pan[None]])[..., None]

        def move(state: Array, rng: np.random.Generator) -> Array:
            return state + shift + sigma * rng.standard_normal(state.shape)

        def draw(count: int, rng: np.random.Generator) -> Array:
            return about + sigma * rng.standard_normal((4, len(people), count))

        stages: list[LikelihoodStage] = [in_room(self._area), self._near_body(people)]
        stages += [self._seen_by(view, people) for view in views]
        cloud = FILTER.step_proposed(people.head, MixtureProposal(options.share, move, draw), staged(stages), rng)
        place = cloud.expectation(cloud.state[:3]).T
        memory = options.motion.memory
        velocity = memory * people.head_velocity + (1 - memory) * (place - people.head_place) / dt
        people = people.changed(head=cloud, head_place=place, head_velocity=velocity)
        if options.pan == "particles":
            pan, _ = circular_mean(cloud.state[3], cloud.weights.normalised)
            return people.changed(pan=np.atleast_1d(pan))
        seen = list(looks(people, views, options))
        people = aligned(turned(people, dt, seen, options))
        if options.learning:
            people = learned(people, seen, options)
        state = cloud.state.copy()
        state[3] = drawn(people.facing, options.particles, rng)
        return people.changed(head=Cloud(state, cloud.weights))

    def _near_body(self, people: People) -> LikelihoodStage:
        options = self._options.head

        def log_likelihood(state: Array, of: Index) -> Array:
            away = np.linalg.norm(state[:3] - people.place[of].T, axis=0)
            return np.where((away >= options.nearest_m) & (away <= options.farthest_m), 0.0, -np.inf)

        return log_likelihood

    def _seen_by(self, view: View, people: People) -> LikelihoodStage:
        options = self._options.head
        hair = whole(people.hair, options.parts[0] * options.parts[1]).reshape(-1, self._options.histogram.size)

        def log_likelihood(state: Array, of: Index) -> Array:
            pixels, seen, on_foreground = view.look(state[:3])
            total = ruled(seen, options.unseen)
            total = np.where(seen & ~on_foreground, ruled(on_foreground, options.no_foreground), total)
            looked = np.flatnonzero(seen & ~np.isneginf(total))
            if looked.size:
                histograms = view.histograms(state[:3, looked], pixels[looked], options.window)
                from_face = pan_bin(bearing(state[:, looked], view) - state[3, looked])
                alike = similarity(histograms, hair, of[looked] * PAN_BINS + from_face)
                total[looked] += options.colour * (alike - 1)
            if options.crown_m:
                _, seen, covered = view.look(state[:3] + np.array([[0.0], [0.0], [options.crown_m]]))
                total += np.where(seen & covered, options.covered, 0.0)
            return total

        return log_likelihood
