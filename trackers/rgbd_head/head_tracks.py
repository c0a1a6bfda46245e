"""Tracks of heads: a roster of clouds of hypotheses (x, y, z, yaw), their motion, their management, and learned states.

Motion (ours: the paper gives no model): diffusion growing with speed and time, turns, alignment with the walk. Management:
known starts as in the paper, else initiation by foreground, re-identification by position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from trackers.arrays import Array, Bool, Float, Mask
from trackers.filters.circular import circular_mean, diffused, drawn, mean_direction
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows, written
from trackers.observations import NS_PER_S
from trackers.rgbd_head.options import HeadMotionOptions, RgbdHeadOptions
from trackers.tracking.roster import Roster
from trackers.tracking.track_manager import TrackManager
from trackers.vision.head_colours import HeadColours
from trackers.vision.head_outlines import ASPECTS


@dataclass(frozen=True, eq=False)
class HeadTracks(Rows):
    """n tracks, oldest first, including tentative ones. usual: running mean log-likelihoods of their heads in each camera."""

    roster: Roster[Cloud]
    velocity: Float[Array, "n 3"]  # [m/s]
    colours: HeadColours
    usual: Float[Array, "n cameras"]  # logarithms; NaN before the first picture
    facing: Float[Array, "n directions"]  # a distribution; without directions each hypothesis has its own

    @classmethod
    def started(cls, cloud: Cloud, ns: int, n_camera: int, n_direction: int) -> Self:
        """Start tentative tracks of standing people, with the directions of the hypotheses."""
        n = len(cloud)
        usual = np.full((n, n_camera), np.nan)
        facing = np.zeros((n, n_direction))
        if n_direction:
            step = np.rint(cloud.state[3] * (n_direction / (2 * np.pi))).astype(np.intp) % n_direction
            np.add.at(facing, (np.arange(n)[:, None], step), cloud.weights.normalised)
        return cls(Roster.started(cloud, ns), np.zeros((n, 3)), HeadColours.unknown(n), usual, facing)

    @property
    def place(self) -> Float[Array, "n 3"]:
        """Middle of each head, the expectation [m]."""
        cloud = self.roster.state
        return cloud.expectation(cloud.state[:3]).T

    def heads(self, later_s: float, yaw_rad: Float[Array, "n"] | float) -> Float[Array, "4 n"]:
        """Predict heads (x, y, z [m], yaw [rad]) some time later, at their present velocity."""
        place = self.place + later_s * self.velocity
        return np.column_stack([place, np.broadcast_to(yaw_rad, len(place))]).T

    def direction(self) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Return the direction of each head [rad], averaged on the circle, and its certainty, 0 to 1."""
        if self.facing.shape[1]:
            return mean_direction(self.facing)
        cloud = self.roster.state
        yaw, length = circular_mean(cloud.state[3], cloud.weights.normalised)
        return np.asarray(yaw), np.asarray(length)


def around(
    place: Float[Array, "n 3"],
    yaw_rad: Float[Array, "n"] | None,
    spread_m: float,
    n_heads: int,
    rng: np.random.Generator,
) -> Cloud:
    """Draw hypotheses about places [m], in random directions if the yaw is unknown."""
    n = len(place)
    state = np.empty((4, n, n_heads))
    state[:3] = place.T[..., None] + spread_m * rng.standard_normal((3, n, n_heads))
    turned = rng.uniform(-np.pi, np.pi, (n, n_heads))
    state[3] = turned if yaw_rad is None else yaw_rad[:, None] + np.radians(15) * rng.standard_normal((n, n_heads))
    return Cloud.of(state)


class Motion:
    """Motion of all tracks over `dt_s`.

    place: of the heads before. facing (n, directions): predicted; empty if each hypothesis has its own direction.
    """

    def __init__(self, people: HeadTracks, dt_s: float, options: HeadMotionOptions) -> None:
        self._people, self._dt_s, self._options = people, dt_s, options
        self.place: Float[Array, "n 3"] = people.place
        speed = np.linalg.norm(people.velocity[:, :2], axis=1)
        level = options.still_m + options.per_speed_m * speed
        self._turn = np.sqrt(dt_s) * np.radians(options.turn_deg)
        self._sigma = np.sqrt(dt_s) * np.stack([level, level, np.full_like(level, options.up_m)])[..., None]
        self.facing: Float[Array, "n g"] = people.facing
        if self.facing.size:
            anywhere = options.turned / self.facing.shape[1]
            self.facing = (1 - options.turned) * diffused(people.facing, self._turn) + anywhere

    def moved(self, state: Float[Array, "4 n p"], rng: np.random.Generator, layer: int) -> Float[Array, "4 n p"]:
        """Move hypotheses of a layer: the first layer moves and diffuses, later ones diffuse less about their positions."""
        options = self._options
        way = self._dt_s * self._people.velocity.T[..., None] if layer == 0 else 0.0
        moved = np.empty_like(state)
        moved[:3] = state[:3] + way + options.nearer**layer * self._sigma * rng.standard_normal(state[:3].shape)
        moved[3] = drawn(self.facing, state.shape[2], rng) if self.facing.size else self._turned(state[3], rng)
        return moved

    def _turned(self, yaw: Float[Array, "n p"], rng: np.random.Generator) -> Float[Array, "n p"]:
        """Turn hypotheses, a share of them to random directions."""
        yaw = yaw + self._turn * rng.standard_normal(yaw.shape)
        some = rng.permutation(yaw.shape[1])[: round(self._options.turned * yaw.shape[1])]
        yaw[:, some] = rng.uniform(-np.pi, np.pi, (len(yaw), some.size))
        return yaw

    def walking(self, yaw: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Return log-likelihoods of directions given the direction of walking."""
        velocity = self._people.velocity[:, :2]
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        speed = np.minimum(np.linalg.norm(velocity, axis=1), 1.0)
        return self._options.walking * speed[:, None] * np.cos(yaw - heading[:, None])

    def velocity(self, place: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Return the running mean velocities of heads after moving to places [m/s]."""
        before, options = self._people, self._options
        if not (options.velocity_s and self._dt_s):
            return before.velocity
        kept = np.exp(-self._dt_s / options.velocity_s)
        return kept * before.velocity + (1 - kept) * (place - self.place) / self._dt_s


_FAR_M_S = 1.5
"""Speed that bounds the search for a head not shown."""


class HeadTrackManager(TrackManager):
    """Common track management, and the known starts still to come."""

    def __init__(
        self, options: RgbdHeadOptions, corners: ArrayLike | None, n_camera: int, rng: np.random.Generator
    ) -> None:
        super().__init__(options.track_management, corners)
        self._options, self._n_camera, self._rng = options, n_camera, rng
        self._pending = sorted(options.start, key=lambda start: start.at_s)

    def no_tracks(self) -> HeadTracks:
        """Return an empty set of tracks."""
        return self._started(np.empty((0, 3)), None, 0)

    def with_known_starts(self, people: HeadTracks, ns: int) -> HeadTracks:
        """Add the heads whose known start has come."""
        due = [start for start in self._pending if start.at_s * NS_PER_S <= ns]
        self._pending = self._pending[len(due) :]
        if not due:
            return people
        place, yaw = np.array([start.place for start in due]), np.radians([start.yaw_deg for start in due])
        started = self._started(place, yaw, ns)
        roster = self.confirm(started.roster, np.ones(len(due), np.bool_))
        return people.joined(started.changed(roster=roster))

    def updated(self, people: HeadTracks, is_shown: Bool[Mask, "n"], ns: int, frame_ns: int) -> HeadTracks:
        """Update the tracks shown by a frame: confirm those shown often, delete those not shown for long.

        frame_ns: since the frame before.
        """
        roster = people.roster.measured(np.flatnonzero(is_shown), ns, people.roster.state)
        roster = self.confirm(roster, self.to_confirm(roster, ns, frame_ns))
        people = people.changed(roster=roster)
        return people.select(self._staying(people, ns))

    def initiated(self, people: HeadTracks, places: Float[Array, "m 3"], ns: int) -> HeadTracks:
        """Add heads at places of unassigned foreground; re-identify lost ones there."""
        lost = np.flatnonzero(people.roster.measured_ns != ns)
        if lost.size:
            away = distances(places[:, :2], people.place[lost, :2])
            within = self._options.track_management.start_apart_m
            within = within + _FAR_M_S * (ns - people.roster.measured_ns[lost]) / NS_PER_S
            away[away > within] = np.inf
            again = np.isfinite(away.min(axis=1))
            for k in np.flatnonzero(again):  # at most a few per frame
                row = lost[[away[k].argmin()]]
                state = people.roster.state.replaced(row, self._cloud(places[[k]], None))
                # the speed while lost would drive them away again
                velocity = written(people.velocity, row, 0.0)
                people = people.changed(roster=people.roster.changed(state=state), velocity=velocity)
            places = places[~again]
        places = places[self.inside(places[:, :2])]
        return people.joined(self._started(places, None, ns)) if len(places) else people

    def _cloud(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None) -> Cloud:
        return around(place, yaw, self._options.track_management.spread_m, self._options.heads, self._rng)

    def _started(self, place: Float[Array, "n 3"], yaw: Float[Array, "n"] | None, ns: int) -> HeadTracks:
        n_direction = ASPECTS[0] if self._options.motion.directions else 0
        return HeadTracks.started(self._cloud(place, yaw), ns, self._n_camera, n_direction)

    def _staying(self, people: HeadTracks, ns: int) -> Bool[Mask, "n"]:
        """Return a mask of the tracks to keep: shown lately, in the area, and not in the head of an older one."""
        place = people.place
        if self._options.start:  # the paper's: a head of known start stays, coasting if necessary
            return np.ones(len(people), np.bool_)
        stays = self.lasting(people.roster, ns) & self.inside(place[:, :2])
        if len(people) > 1:
            near = distances(place[:, :2], place[:, :2]) < self._options.track_management.same_head_m
            younger = np.tril(near, -1).any(axis=1) & ~(people.roster.confirmed & (people.roster.measured_ns == ns))
            stays &= ~younger
        return stays
