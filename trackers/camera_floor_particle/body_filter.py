"""Body filter (section 4): particles x, y, z moved by the person's velocity, and the paper's order of weighting.

The tracks of people are a roster of these clouds, with the cloud of each head and the appearance in each camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trackers.area import Area
from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.camera_floor_particle.options import CameraFloorParticleOptions, ExclusionOptions, MotionOptions
from trackers.filters.particle import Cloud, LikelihoodStage, ParticleFilter, cascade
from trackers.filters.rows import Rows
from trackers.likelihood.colour import point_log_likelihood, window_log_likelihood
from trackers.likelihood.floor import Loads
from trackers.tracking.roster import Roster
from trackers.vision.views import Views, padded_roots

PAN_BINS = 12
"""References of the head, one per 30° of viewing angle; 0 is the face."""


@dataclass(frozen=True, eq=False)
class BodyTracks(Rows):
    """n tracks, detected when floor or cameras show them. Histograms are stored as roots, for similarity."""

    roster: Roster[Cloud]  # x, y, z of the middle of the body [m]
    head: Cloud  # x, y, z of the middle of the head [m], pan [rad]
    place: Float[Array, "n 3"]  # the body's estimate [m]
    velocity: Float[Array, "n 3"]  # [m/s]
    head_place: Float[Array, "n 3"]
    head_velocity: Float[Array, "n 3"]
    pan: Float[Array, "n"]  # [rad]
    clothes: Float[Array, "n cameras bins"]
    facing: Float[Array, "n steps"]  # probability of each pan in a grid of directions, from 0 on
    hair: Float[Array, "n pans colours"]  # of each part of the head's window, concatenated
    course: Float[Array, "n 2"]  # velocity over the last third of a second [m/s]
    skin_true: Float[Array, "n"]  # agreement of the skin on their heads with their walking direction, from −1 to 1
    pan_known: Bool[Mask, "n"]  # whether steps have shown the forward direction
    weight_n: Float[Array, "n"]  # on the floor, learned [N]
    height_m: Float[Array, "n"]
    lost: Bool[Mask, "n"]  # without particles left: they coast
    slid_s: Float[Array, "n"]  # for how long hardly a camera has shown a head where it is [s]

    @property
    def body(self) -> Cloud:
        """Particles of the middles of bodies, x, y, z [m]."""
        return self.roster.state

    @property
    def ids(self) -> Int[Index, "n"]:
        """Ids of the tracks."""
        return self.roster.id


_GRID_M = 0.02
"""Side of the elements of the grid on which squares are marked."""
_MOST_ELEMENTS = 1000
"""Along each axis: 20 m. Particles farther off count at the border."""


def excluded(
    places: Float[Array, "2 n p"], evidence: Float[Array, "n"], options: ExclusionOptions
) -> Bool[Mask, "n p"]:
    """Return a mask of the particles whose square overlaps that of another person's particle, at x, y [m] (section 3.2).

    Each person's particles are marked on a grid and dilated by the side of a square, without a search over pairs. In the
    paper both people lose their particles there, here (ours) only the one made less likely by the last measurement
    (`evidence`).
    """
    n = places.shape[1]
    if n < 2 or options.side_m == 0:
        return np.zeros(places.shape[1:], np.bool_)
    low, high = places.min(axis=2), places.max(axis=2)
    reach = options.side_m + 2 * _GRID_M
    meet = ((low[:, :, None] - reach < high[:, None]) & (high[:, :, None] + reach > low[:, None])).all(axis=0)
    if meet.sum() == n:  # each track meets only itself
        return np.zeros(places.shape[1:], np.bool_)
    from_corner = (places - places.min(axis=(1, 2), keepdims=True)) / _GRID_M
    column, row = np.minimum(np.floor(from_corner + 1e-9).astype(np.intp), _MOST_ELEMENTS - 1)
    person = np.argsort(-evidence, kind="stable")[:, None]
    column, row = column[person[:, 0]], row[person[:, 0]]
    marked = np.zeros((n, row.max() + 1, column.max() + 1), np.uint8)
    marked[np.arange(n)[:, None], row, column] = 1
    side = 2 * int(options.side_m / _GRID_M + 1e-9) + 1
    spread = np.stack([cv2.dilate(each, np.ones((side, side), np.uint8)) for each in marked]).astype(np.intp)
    before = np.cumsum(spread, axis=0) - spread  # of likelier ones
    others = before if options.likelier_stays else spread.sum(axis=0) - spread
    overlapping = np.empty(places.shape[1:], np.bool_)
    overlapping[person[:, 0]] = others[np.arange(n)[:, None], row, column] > 0
    return overlapping


FILTER = ParticleFilter(threshold=1.0)
CROWN_M = 0.12
"""Height of the crown above the middle of a head."""
_COURSE_S = 0.3
"""Time constant of the velocity average that gives the walking direction."""


def spread(velocity: Float[Array, "n 3"], dt: float, motion: MotionOptions) -> Float[Array, "3 n"]:
    """Return standard deviations of ω in x, y, z over `dt` [s], growing with the person's speed [m]."""
    level = motion.still_m + motion.per_speed_s * np.hypot(velocity[:, 0], velocity[:, 1])
    return np.sqrt(motion.steps(dt)) * np.stack([level, level, np.full(len(velocity), motion.up_m)])


def smoothed(
    velocity: Float[Array, "n 3"], way: Float[Array, "n 3"], dt: float, motion: MotionOptions
) -> Float[Array, "n 3"]:
    """Return the velocity smoothed after a displacement [m] over `dt` [s] [m/s]."""
    kept = motion.memory ** motion.steps(dt)
    return kept * velocity + (1 - kept) * way / dt


def in_room(area: Area | None) -> LikelihoodStage:
    """Make the first stage: drop particles outside the room, or under its floor."""

    def log_likelihood(state: Array, of: Index) -> Array:
        inside = state[2] > 0
        return np.where(inside if area is None else inside & area.contains(state[:2].T), 0.0, -np.inf)

    return log_likelihood


class BodyFilter:
    """Filter that moves and weights the body particles of all tracks at once."""

    def __init__(self, options: CameraFloorParticleOptions, area: Area | None) -> None:
        self._options = options
        self._area = area

    def step(
        self, people: BodyTracks, dt: float, loads: Loads | None, views: Views, rng: np.random.Generator
    ) -> BodyTracks:
        """Return the tracks `dt` seconds later, weighted by the floor and the usable cameras."""
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
            if len(views) > 1 and options.under_head_m:  # one picture does not show a head's distance
                stages.append(self._under_head(people, dt))
            if loads is not None and self._options.use_floor:
                over = loads.likelihood
                stages.append(lambda places, _: over.log_likelihood(places[:2]))
            stages.append(self._seen_by(views, people))
            return cascade(stages)(state)

        cloud = FILTER.step(people.body, move, log_likelihood, rng)
        place = cloud.expectation(cloud.state).T
        velocity = smoothed(people.velocity, place - people.place, dt, options.motion)
        kept = np.exp(-dt / _COURSE_S)
        course = kept * people.course + (1 - kept) * (place - people.place)[:, :2] / dt
        roster = people.roster.changed(state=cloud)
        return people.changed(roster=roster, place=place, velocity=velocity, course=course, lost=cloud.weights.lost)

    def _under_head(self, people: BodyTracks, dt: float) -> LikelihoodStage:
        """Return the head's stage (ours): bodies are under their heads, less certainly for a lower head."""
        head = people.head_place + people.head_velocity * dt
        drop_m = np.maximum(people.height_m - CROWN_M - head[:, 2], 0.0)
        sigma = self._options.body.under_head_m + drop_m

        def log_likelihood(state: Array, of: Index) -> Array:
            off = (state[:2] - head[of, :2].T) / sigma[of]
            return -0.5 * np.einsum("ck,ck->k", off, off)

        return log_likelihood

    def _seen_by(self, views: Views, people: BodyTracks) -> LikelihoodStage:
        """Return the cameras' stage: in their views, on foreground, in the person's colours."""
        options = self._options.body

        def log_likelihood(state: Array, of: Index) -> Array:
            look = views.look(state)
            total = point_log_likelihood(look.seen, look.on_foreground, options.checks, -options.colour)
            clothes = [(padded_roots(people.clothes[:, view.number]), of) for view in views]
            return window_log_likelihood(total, state, look, options.window, clothes, options.colour)

        return log_likelihood


def redrawn(cloud: Cloud, state: Float[Array, "c n p"]) -> Cloud:
    """Return a cloud with particles redrawn at equal weight, in sets without any left."""
    lost = cloud.weights.lost
    return Cloud(np.where(lost[:, None], state, cloud.state), cloud.weights.resampled(lost))


def started(place: Float[Array, "n 3"], n_particle: int, rng: np.random.Generator) -> Cloud:
    """Draw body particles about detected positions [m]: deviation 8 cm in x and y, 5 cm in z."""
    covariance = np.broadcast_to(np.diag([0.08, 0.08, 0.05]) ** 2, (len(place), 3, 3))
    return Cloud.normal(place, covariance, n_particle, rng)
