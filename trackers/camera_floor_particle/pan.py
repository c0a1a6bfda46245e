"""Head filter (section 5): x, y, z and pan, some particles drawn about the body, weighted by appearance from all sides.

The appearance of a head from every side is learned as people walk, and their direction. In the paper the pan is a component of
the head's particles. Here (ours) it is a distribution over a grid of directions: every camera's picture at the head's
estimate is compared, part by part of the window, with the references of all sides. Walking people mostly look ahead, which
separates the front of a head from its back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackers.area import Area
from trackers.arrays import AnyArray, Array, Bool, Complex, Float, Index, Int, Mask
from trackers.camera_floor_particle.body_filter import FILTER, PAN_BINS, BodyTracks, in_room, redrawn, smoothed, spread
from trackers.camera_floor_particle.options import CameraFloorParticleOptions, FacingOptions, HeadOptions
from trackers.filters.circular import circular_mean, diffused, drawn, grid_of, mean_direction
from trackers.filters.particle import Cloud, LikelihoodStage, MixtureProposal, cascade
from trackers.likelihood.colour import point_log_likelihood, window_log_likelihood
from trackers.vision.views import BINS, ProjectedPoints, Views, padded_roots

PAN_STEPS = 72
"""Directions of the grid."""
GRID = grid_of(PAN_STEPS)
SIDES = np.linspace(0, 2 * np.pi, PAN_BINS, endpoint=False)
"""Angles from the face of the references."""
SURE_M_S = 0.5
"""Speed from which the course gives the forward direction, in which people mostly look."""
_AHEAD = 2.0
"""Factor on the angle between velocity and course: the course lags behind turns, and heads precede the walk."""
_CLEAR = 0.6
"""Similarity to one of the sides above which a view shows the head itself, and is learned."""
_NARROW = 6.0
"""Concentration of a view about its angle, in learned references."""
_SURE = 0.8
"""Mean resultant length of a pan that is certain enough for learning."""
_HARDLY = 0.25
"""Share of the cameras that show what is no head as if it were one, at most."""
_SKIN_LOOKS = 20
"""Number of views in the average of the skin's agreement with the walking direction."""
_LEAST = 1e-4
"""Least share of the belief in every direction, so that none is ruled out."""


class HeadViews(NamedTuple):
    """Views of heads by cameras: rows of tracks, bearings [rad], colours as roots, part by part, similarity to each side,
    skin, and whether more of the silhouette is above.
    """

    rows: Int[Index, "k"]
    bearing: Float[Array, "k"]
    roots: Float[Array, "k colours"]
    alike: Float[Array, "k sides"]
    skin: Complex[AnyArray, "k"]  # its share, in the direction that it faces, e^iφ in the room
    covered: Bool[Mask, "k"]  # whether a point over the crown is foreground too: it may be no head


class Sights(NamedTuple):
    """Heads where they are estimated, and points over their crowns, in every picture."""

    head: ProjectedPoints
    above: ProjectedPoints

    @classmethod
    def of(cls, people: BodyTracks, views: Views) -> Sights:
        """Look at the heads of all tracks."""
        return cls(views.look(people.head_place.T), views.look(people.head_place.T + _CROWN_M))


def looks(people: BodyTracks, views: Views, sights: Sights, options: HeadOptions) -> HeadViews | None:
    """Evaluate the head estimates in every view with foreground there; None without any."""
    places = people.head_place.T
    pixels, shown = sights.head.pixels, sights.head.on_foreground
    if not shown.any():
        return None
    window = options.window.model_copy(update={"stride": 1})  # few views, so every pixel
    rows, from_east = shown.nonzero()[1], views.bearings(places)[shown]
    roots = unit(np.sqrt(views.colours(places, pixels, shown, window, options.parts)))
    alike = (unit(people.hair)[rows] @ roots[..., None])[..., 0]
    skin = views.skin(places, pixels, shown, options.window) * np.exp(1j * from_east)
    return HeadViews(rows, from_east, roots, alike, skin, sights.above.on_foreground[shown])


def turned(
    people: BodyTracks, dt: float, turns_rad: float, seen: HeadViews | None, options: FacingOptions
) -> BodyTracks:
    """Update pans `dt` seconds later: by turns, views, and the walking direction.

    turns_rad: standard deviation of turns in that time.
    """
    belief = diffused(people.facing, turns_rad)
    log = np.log(belief + _LEAST / PAN_STEPS)
    if seen is not None:
        face = np.zeros(len(people), complex)
        np.add.at(face, seen.rows, seen.skin)
        at = ((seen.bearing[:, None] - GRID) * (PAN_BINS / (2 * np.pi))) % PAN_BINS
        below = at.astype(np.intp) % PAN_BINS
        share = at - np.floor(at)
        side = np.arange(len(seen.rows))[:, None]
        alike = (1 - share) * seen.alike[side, below] + share * seen.alike[side, (below + 1) % PAN_BINS]
        np.add.at(log, seen.rows, options.colour * alike)
        people = _trusting_skin(people, face)
        face = face * np.maximum(people.skin_true, 0.0)
        log += options.skin * (face[:, None] * np.exp(-1j * GRID)).real
    heading, speed = walk(people)
    sure = options.walking * np.where(speed > SURE_M_S, speed, 0.0) * dt
    log += sure[:, None] * np.cos(GRID - heading[:, None])
    belief = np.exp(log - log.max(axis=1, keepdims=True))
    belief /= belief.sum(axis=1, keepdims=True)
    return people.changed(facing=belief, pan=mean_direction(belief)[0])


def _trusting_skin(people: BodyTracks, face: Complex[AnyArray, "n"]) -> BodyTracks:
    """Learn from walking people whether skin shows the face, and not hair of its colour or light on it: the mean cosine."""
    heading, speed = walk(people)
    right = np.cos(np.angle(face) - heading) - people.skin_true
    taught = (speed > SURE_M_S) & (face != 0)
    return people.changed(skin_true=people.skin_true + np.where(taught, right / _SKIN_LOOKS, 0.0))


def aligned(people: BodyTracks) -> BodyTracks:
    """Turn pans and references to the forward direction of the first steps."""
    heading, speed = walk(people)
    due = ~people.pan_known & (speed > SURE_M_S)
    if not due.any():
        return people
    turns = np.where(due, pan_bin(heading - people.pan), 0)
    state = people.head.state.copy()
    state[3] += (turns * (2 * np.pi / PAN_BINS))[:, None]
    sides = (np.arange(PAN_BINS) + turns[:, None]) % PAN_BINS
    steps = (np.arange(PAN_STEPS) - turns[:, None] * (PAN_STEPS // PAN_BINS)) % PAN_STEPS
    return people.changed(
        head=Cloud(state, people.head.weights),
        pan=people.pan + turns * (2 * np.pi / PAN_BINS),
        facing=np.take_along_axis(people.facing, steps, axis=1),
        hair=np.take_along_axis(people.hair, sides[..., None], axis=1),
        pan_known=people.pan_known | due,
    )


def _sliding(people: BodyTracks, dt: float, sights: Sights) -> BodyTracks:
    """Count the time for which hardly a camera shows a head there: no foreground, or more of the person above."""
    is_head = sights.head.on_foreground & ~sights.above.on_foreground
    n_seen, n_head = sights.head.seen.sum(axis=0), is_head.sum(axis=0)
    slides = (n_seen >= 2) & (n_head <= _HARDLY * n_seen)
    return people.changed(slid_s=np.where(slides, people.slid_s + dt, 0.0))


def learned(people: BodyTracks, seen: HeadViews, most_looks: float) -> BodyTracks:
    """Learn the visible sides of heads with a certain pan: references are means of the last views at each.

    Not where more of the silhouette is above: references would slide down the body.
    """
    _, sure = mean_direction(people.facing)
    clear = people.pan_known & (sure > _SURE) & ~people.lost
    own = clear[seen.rows] & (seen.alike.max(axis=1) > _CLEAR) & ~seen.covered
    rows = seen.rows[own]
    about = np.exp(_NARROW * (np.cos(SIDES - (seen.bearing[own] - people.pan[rows])[:, None]) - 1))
    of_person = np.zeros((len(people), PAN_BINS, len(rows)))
    of_person[rows, :, np.arange(len(rows))] = about
    hair = people.hair + of_person @ seen.roots[own]
    n_look = _length(hair)
    return people.changed(hair=hair * np.minimum(1.0, most_looks / np.maximum(n_look, 1.0)))


def walk(people: BodyTracks) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Return headings of the walk [rad] and speeds [m/s]."""
    x, y = (people.course + _AHEAD * (people.velocity[:, :2] - people.course)).T
    return np.arctan2(y, x), np.hypot(*people.course.T)


def pan_bin(angle: Float[Array, "*n"]) -> Int[Index, "*n"]:
    """Return the index of the reference of a head seen at this angle from its face [rad]."""
    return np.rint(angle * (PAN_BINS / (2 * np.pi))).astype(np.intp) % PAN_BINS


def unit(roots: Float[Array, "*k b"]) -> Float[Array, "*k b"]:
    """Scale roots of histograms to length 1, so that squares sum to 1; all-zero ones stay."""
    length = _length(roots)
    return roots / np.where(length > 0, length, 1.0)


def _length(roots: Float[Array, "*k b"]) -> Float[Array, "*k 1"]:
    return np.sqrt(np.einsum("...b,...b->...", roots, roots))[..., None]


def around(seen: Float[Array, "k b"], from_face: Float[Array, "k"], *, mixed: bool = True) -> Float[Array, "pans b"]:
    """Make references for every pan from views (roots) at these angles from the face [rad].

    Between views less than 90° away they are mixed; farther off, or not `mixed`, the nearest view is used.
    """
    away = np.abs(np.angle(np.exp(1j * (SIDES[:, None] - from_face))))
    share = 1e-6 * (away == away.min(axis=1, keepdims=True))
    if mixed:
        share = share + np.maximum(1 - away / (np.pi / 2), 0.0)
    return unit(share @ seen)


def whole(hair: Float[Array, "n pans colours"], n_part: int) -> Float[Array, "n pans b"]:
    """Make references of the whole window, as roots, from those of its parts."""
    n, n_pan, n_colour = hair.shape
    return unit(np.sqrt((hair.reshape(n, n_pan, n_part, n_colour // n_part) ** 2).sum(axis=2)))


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
        people: BodyTracks,
        offset: Float[Array, "n 3"],
        dt: float,
        views: Views,
        rng: np.random.Generator,
    ) -> BodyTracks:
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
        sights = Sights.of(people, views)
        seen = looks(people, views, sights, options)
        turns = np.deg2rad(options.turn_deg) * np.sqrt(options.motion.steps(dt))
        people = aligned(turned(_sliding(people, dt, sights), dt, turns, seen, options.facing))
        if options.facing.learning and seen is not None:
            people = learned(people, seen, options.facing.learning)
        state = cloud.state.copy()
        state[3] = drawn(people.facing, options.particles, rng)
        return people.changed(head=Cloud(state, cloud.weights))

    def _near_body(self, people: BodyTracks) -> LikelihoodStage:
        options = self._options.head

        def log_likelihood(state: Array, of: Index) -> Array:
            off = state[:3] - people.place[of].T
            away = np.sqrt(np.einsum("ck,ck->k", off, off))
            return np.where((away >= options.nearest_m) & (away <= options.farthest_m), 0.0, -np.inf)

        return log_likelihood

    def _seen_by(self, views: Views, people: BodyTracks) -> LikelihoodStage:
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
