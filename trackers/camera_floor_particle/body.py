"""The body's filter (section 4): particles x, y, z that move as the person did, and the paper's order of weighting."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from trackers.area import Area
from trackers.arrays import Array, Index, Mask
from trackers.camera_floor_particle.exclusion import excluded
from trackers.camera_floor_particle.loads import Loads
from trackers.camera_floor_particle.options import (
    BodyOptions,
    CameraFloorParticleOptions,
    HeadOptions,
    MotionOptions,
    Ruling,
)
from trackers.camera_floor_particle.people import People
from trackers.camera_floor_particle.views import Views, padded_roots
from trackers.filters.particle import Cloud, ParticleFilter
from trackers.filters.staged import LikelihoodStage, staged

FILTER = ParticleFilter(threshold=1.0)
CROWN_M = 0.12
"""How far the crown is above the middle of a head."""
_COURSE_S = 0.3
"""Time over which the velocity is averaged that tells where somebody walks."""


def spread(velocity: Float[Array, "n 3"], dt: float, motion: MotionOptions) -> Float[Array, "3 n"]:
    """Standard deviations of ω in x, y, z over `dt` [s], which grow with the person's speed [m]."""
    aside = motion.still_m + motion.per_speed_s * np.hypot(velocity[:, 0], velocity[:, 1])
    return np.sqrt(motion.steps(dt)) * np.stack([aside, aside, np.full(len(velocity), motion.up_m)])


def smoothed(
    velocity: Float[Array, "n 3"], way: Float[Array, "n 3"], dt: float, motion: MotionOptions
) -> Float[Array, "n 3"]:
    """The velocity after a way [m] that took `dt` [s], some of it as before [m/s]."""
    kept = motion.memory ** motion.steps(dt)
    return kept * velocity + (1 - kept) * way / dt


def ruled(kept: Bool[Mask, "*k"], ruling: Ruling) -> Float[Array, "*k"]:
    """Log-likelihoods: 0 where a check is passed, what the ruling says where it is not."""
    return np.where(kept, 0.0, -np.inf if ruling == "drop" else ruling)


def checked(
    seen: Bool[Mask, "cameras k"], on_foreground: Bool[Mask, "cameras k"], options: BodyOptions | HeadOptions
) -> Float[Array, "k"]:
    """Log-likelihoods of particles by which cameras see them, and see foreground there."""
    unseen = ruled(seen, options.unseen).sum(axis=0)
    return unseen + ruled(on_foreground | ~seen, options.no_foreground).sum(axis=0)


def in_room(area: Area | None) -> LikelihoodStage:
    """The first check: a particle out of the room, or under its floor, is dropped."""

    def log_likelihood(state: Array, of: Index) -> Array:
        inside = state[2] > 0
        return np.where(inside if area is None else inside & area.contains(state[:2].T), 0.0, -np.inf)

    return log_likelihood


class BodyFilter:
    """Moves and weights the body particles of everybody at once."""

    def __init__(self, options: CameraFloorParticleOptions, area: Area | None) -> None:
        self._options = options
        self._area = area

    def step(self, people: People, dt: float, loads: Loads | None, views: Views, rng: np.random.Generator) -> People:
        """Everybody `dt` seconds later, by the floor and the cameras that say something."""
        options = self._options.body
        sigma = spread(people.velocity, dt, options.motion)[..., None]
        shift = (people.velocity * dt).T[..., None]

        def move(state: Array, rng: np.random.Generator) -> Array:
            return state + shift + sigma * rng.standard_normal(state.shape)

        def log_likelihood(state: Array) -> Array:
            out = excluded(state[:2], people.body.weights.log_mean, self._options.exclusion).ravel()
            stages: list[LikelihoodStage] = [
                lambda _, __: np.where(out, -np.inf, 0.0),
                in_room(self._area),
            ]
            if len(views) > 1 and options.under_head_m:  # one picture does not tell how far off a head is
                stages.append(self._under_head(people, dt))
            if loads is not None and self._options.use_floor:
                stages.append(self._over(loads))
            stages.append(self._seen_by(views, people))
            return staged(stages)(state)

        cloud = FILTER.step(people.body, move, log_likelihood, rng)
        place = cloud.expectation(cloud.state).T
        velocity = smoothed(people.velocity, place - people.place, dt, options.motion)
        kept = np.exp(-dt / _COURSE_S)
        course = kept * people.course + (1 - kept) * (place - people.place)[:, :2] / dt
        return people.changed(body=cloud, place=place, velocity=velocity, course=course, lost=cloud.weights.lost)

    def _under_head(self, people: People, dt: float) -> LikelihoodStage:
        """The head's part (ours): bodies are under their heads, the less surely the lower a head is held."""
        head = people.head_place + people.head_velocity * dt
        drop_m = np.maximum(people.height_m - CROWN_M - head[:, 2], 0.0)
        sigma = self._options.body.under_head_m + drop_m

        def log_likelihood(state: Array, of: Index) -> Array:
            off = (state[:2] - head[of, :2].T) / sigma[of]
            return -0.5 * np.einsum("ck,ck->k", off, off)

        return log_likelihood

    def _over(self, loads: Loads) -> LikelihoodStage:
        """The floor's part."""
        return lambda state, _: loads.log_likelihood(state[:2], self._options.body)

    def _seen_by(self, views: Views, people: People) -> LikelihoodStage:
        """The cameras' part: in their views, on foreground, in the person's colours."""
        options = self._options.body

        def log_likelihood(state: Array, of: Index) -> Array:
            pixels, seen, on_foreground = views.look(state)
            total = checked(seen, on_foreground, options)
            left = ~np.isneginf(total)
            for view, at, here in zip(views, pixels, seen & left, strict=True):
                looked = np.flatnonzero(here)
                clothes = padded_roots(people.clothes[:, view.number])
                alike = view.similarity(state[:, looked], at[looked], options.window, clothes, of[looked])
                total[looked] += options.colour * (alike - 1)
            return total

        return log_likelihood


def started(place: Float[Array, "n 3"], n_particle: int, rng: np.random.Generator) -> Cloud:
    """Body particles about places where people were detected [m]: 8 cm about in x and y, 5 cm in z."""
    covariance = np.broadcast_to(np.diag([0.08, 0.08, 0.05]) ** 2, (len(place), 3, 3))
    return Cloud.normal(place, covariance, n_particle, rng)
