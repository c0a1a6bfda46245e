"""The head's filter (section 5): x, y, z and pan, some particles drawn about the body, weighted by how heads look around."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from trackers.area import Area
from trackers.arrays import Array, Index
from trackers.camera_floor_particle.body import FILTER, in_room, ruled, spread
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.people import PAN_BINS, People, pan_bin
from trackers.camera_floor_particle.views import View, similarity
from trackers.filters.circular import circular_mean
from trackers.filters.particle import Cloud
from trackers.filters.proposal import MixtureProposal
from trackers.filters.staged import LikelihoodStage, staged

_SURE_M_S = 0.5
"""Who walks faster than this knows where forward is, and looks there more often than not."""
_CLEAR = 0.6
"""Similarity from which a look at a head is its own, and is learned from."""


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

        wide = sigma.copy()
        wide[3] = np.deg2rad(options.turn_about_deg)

        def draw(count: int, rng: np.random.Generator) -> Array:
            return about + wide * rng.standard_normal((4, len(people), count))

        stages: list[LikelihoodStage] = [in_room(self._area), self._near_body(people), self._ahead(people)]
        stages += [self._seen_by(view, people) for view in views]
        cloud = FILTER.step_proposed(people.head, MixtureProposal(options.share, move, draw), staged(stages), rng)
        place = cloud.expectation(cloud.state[:3]).T
        pan, _ = circular_mean(cloud.state[3], cloud.weights.normalised)
        memory = options.motion.memory
        velocity = memory * people.head_velocity + (1 - memory) * (place - people.head_place) / dt
        people = people.changed(head=cloud, head_place=place, head_velocity=velocity, pan=np.atleast_1d(pan))
        people = self._aligned(people)
        return self._learned(people, views) if options.learning else people

    def _near_body(self, people: People) -> LikelihoodStage:
        options = self._options.head

        def log_likelihood(state: Array, of: Index) -> Array:
            away = np.linalg.norm(state[:3] - people.place[of].T, axis=0)
            return np.where((away >= options.nearest_m) & (away <= options.farthest_m), 0.0, -np.inf)

        return log_likelihood

    def _ahead(self, people: People) -> LikelihoodStage:
        """Who walks looks ahead, more or less: a von Mises density about the heading, narrower the faster."""
        heading, speed = _walk(people)
        sure = self._options.head.walking * np.where(speed > _SURE_M_S, speed, 0.0)
        return lambda state, of: sure[of] * np.cos(state[3] - heading[of])

    def _seen_by(self, view: View, people: People) -> LikelihoodStage:
        options = self._options.head
        hair = people.hair.reshape(-1, people.hair.shape[-1])

        def log_likelihood(state: Array, of: Index) -> Array:
            pixels, seen, on_foreground = view.look(state[:3])
            total = ruled(seen, options.unseen)
            total = np.where(seen & ~on_foreground, ruled(on_foreground, options.no_foreground), total)
            looked = np.flatnonzero(seen & ~np.isneginf(total))
            if looked.size:
                histograms = view.histograms(state[:3, looked], pixels[looked], options.window)
                from_face = pan_bin(_bearing(state[:, looked], view) - state[3, looked])
                alike = similarity(histograms, hair, of[looked] * PAN_BINS + from_face)
                total[looked] += options.colour * (alike - 1)
            if options.crown_m:
                _, seen, covered = view.look(state[:3] + np.array([[0.0], [0.0], [options.crown_m]]))
                total += np.where(seen & covered, options.covered, 0.0)
            return total

        return log_likelihood

    def _aligned(self, people: People) -> People:
        """Whose first steps tell where forward is: their pan is turned to it, and their references with it."""
        heading, speed = _walk(people)
        due = ~people.pan_known & (speed > _SURE_M_S) if self._options.head.walking else np.zeros(len(people), np.bool_)
        if not due.any():
            return people
        turns = np.where(due, pan_bin(heading - people.pan), 0)
        turn = turns * (2 * np.pi / PAN_BINS)
        state = people.head.state.copy()
        state[3] += turn[:, None]
        bins = (np.arange(PAN_BINS) + turns[:, None]) % PAN_BINS
        return people.changed(
            head=Cloud(state, people.head.weights),
            pan=people.pan + turn,
            hair=np.take_along_axis(people.hair, bins[..., None], axis=1),
            pan_known=people.pan_known | due,
        )

    def _learned(self, people: People, views: Sequence[View]) -> People:
        """The references of the pans that cameras see of who walks, ahead, a little more like what they see."""
        heading, speed = _walk(people)
        walks = (speed > _SURE_M_S) & ~people.lost
        if not walks.any():
            return people
        hair, options = people.hair.copy(), self._options.head
        state = np.concatenate([people.head_place.T, heading[None]])
        for view in views:
            pixels, seen, on_foreground = view.look(state[:3])
            looked = np.flatnonzero(seen & on_foreground & walks)
            if not looked.size:
                continue
            root = np.sqrt(view.histograms(state[:3, looked], pixels[looked], options.window))
            at = pan_bin(_bearing(state, view) - state[3])[looked]
            before = hair[looked, at]
            clear = np.einsum("kb,kb->k", root, before) > _CLEAR
            blended = unit(before + options.learning * (unit(root) - before))
            hair[looked[clear], at[clear]] = blended[clear]
        return people.changed(hair=hair)


def _walk(people: People) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Where everybody walks [rad], and how fast [m/s]."""
    x, y = people.course.T
    return np.arctan2(y, x), np.hypot(x, y)


def _bearing(state: Float[Array, "4 k"], view: View) -> Float[Array, "k"]:
    """The direction from heads to a camera, seen from above [rad]."""
    return np.arctan2(view.camera.eye_m[1] - state[1], view.camera.eye_m[0] - state[0])


def unit(roots: Float[Array, "*k b"]) -> Float[Array, "*k b"]:
    """Roots of histograms of length 1, whose squares sum to 1; all-zero ones stay."""
    length = np.linalg.norm(roots, axis=-1, keepdims=True)
    return np.divide(roots, length, out=np.zeros_like(roots), where=length > 0)


def around(seen: Float[Array, "k b"], from_face: Float[Array, "k"]) -> Float[Array, "pans b"]:
    """References for every pan from looks (roots) at these angles from the face [rad].

    In between looks that are less than 90° off they are mixed; farther off it is the nearest look.
    """
    middles = np.arange(PAN_BINS) * (2 * np.pi / PAN_BINS)
    away = np.abs(np.angle(np.exp(1j * (middles[:, None] - from_face))))
    share = np.maximum(1 - away / (np.pi / 2), 0.0) + 1e-6 * (away == away.min(axis=1, keepdims=True))
    return unit(share @ seen)
