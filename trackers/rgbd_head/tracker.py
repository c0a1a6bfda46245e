"""Heads in 3-D, place and direction, from stereo RGB-D cameras and a model of the room.

After T. Suzuki, S. Iwasaki, Y. Kobayashi, Y. Sato and A. Sugimoto: "Incorporating environment models for improving
vision-based tracking of people" (Systems and Computers in Japan 38(2), 2007). A particle filter a head; every picture weighs
every hypothesis by colours and by distances (eq. 4 to 7), the room weighs it once a moment (eq. 8), the product counts (eq. 9)
and the expectation is the estimate. What is ours and not the paper's is an option each, "(ours)" in `options`.

A track's x and y are the ground under the head, not under the pelvis; its z is not estimated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from math import nan
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.circular import grid_of
from trackers.filters.particle import LogWeights, ParticleFilter
from trackers.knowledge import Knowledge
from trackers.observations import NS_PER_S, DepthImage, Observation
from trackers.rgbd_head.colours import HeadColours
from trackers.rgbd_head.doubts import FEWEST, OFF_RAD
from trackers.rgbd_head.evaluators import Evaluator, Evaluators
from trackers.rgbd_head.learned import SHIPPED, load_learned
from trackers.rgbd_head.life import Life
from trackers.rgbd_head.motion import Motion
from trackers.rgbd_head.newcomers import newcomers
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.people import People
from trackers.rgbd_head.picture import Watcher
from trackers.rgbd_head.room import Room
from trackers.rgbd_head.weighing import Weights
from trackers.rig import Rig, StereoSensor
from trackers.tracking.moment_tracker import MomentTracker
from trackers.tracking.moments import Moment, MomentRules
from trackers.tracks import Hypotheses, Track, TrackFrame
from trackers.vision.camera_doubts import CameraDoubts

FILTER = ParticleFilter(threshold=0.7)
LEARNED = "heads"
"""Name under which `background.learned` may hold another file than the shipped one (`scripts/learn-heads` makes one)."""
_USUAL = 0.2
"""Share of a new picture in what a person's heads usually weigh."""
_SURE = 0.6
"""How sure a direction has to be for colours to be learned at it."""
_LONGEST_S = 0.5
"""However long nothing came, heads move for no longer at once."""
_OTHERS = 4.0
"""What the logarithm of a hypothesis's weight loses in another person's head."""
_SHOWN = 64
"""About so many hypotheses of each person are handed out for the preview."""
_BESIDE_M = 0.4
"""So far beside the tracked area there is floor that shadows fall on."""


class Inside(NamedTuple):
    """What the tracker knew at the moment worked last: everybody's hypotheses, and what each picture made of them."""

    people: People
    weighed: dict[str, Weights]


class RgbdHead(MomentTracker):
    """Stereo cameras open a moment; every head is weighed by all of its pictures, each at its own stamp.

    Raises InputError for a rig without a stereo camera, for wrong options, for pictures of another size than the rig says, and
    for a scheduler that does not answer or has too few workers.
    """

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(RgbdHeadOptions, options, "tracker rgbd-head")
        sensors = _stereo_cameras(rig, self.options.cameras)
        self.unused_sensors = [name for name in rig.sensors if name not in sensors]
        known = Knowledge.of(background)
        area = Area(rig.area, _BESIDE_M) if rig.area else None
        self._learned = load_learned(known.learned.get(LEARNED, SHIPPED))
        watchers = {
            name: Watcher(
                sensor, [each for each in known if each.sensor == name], self._learned, self.options.weights, area
            )
            for name, sensor in sensors.items()
        }
        self._room = Room(known.environment, self.options.environment)
        self._warnings = self._room.warnings(watchers)
        self.background_learned_causally = any(each.foreground.learns_background for each in watchers.values())
        main = rig.main_sensor if rig.main_sensor in sensors else None
        super().__init__(MomentRules(tuple(sensors), main=main, period_s=0.25))
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._life = Life(self.options, len(sensors), self._rng)
        self._people = self._life.nobody()
        self._numbers = {name: number for number, name in enumerate(sensors)}
        self._doubts = CameraDoubts(len(sensors), OFF_RAD, FEWEST)
        self._ns, self._turn = 0, 0
        self._weights: dict[str, Weights] = {}
        here = {name: Evaluator(each) for name, each in watchers.items()}
        self._evaluators = _evaluators_of(here, self.options.scheduler)

    @property
    def warnings(self) -> list[str]:
        """What is lacking or doubtful, and which camera's Dask worker was lost."""
        lost, cameras = self._evaluators.taken_over, list(self._numbers)
        return [
            *self._warnings,
            *(
                f"{cameras[number]} shows heads elsewhere than the other cameras do, and cannot hang as the rig says"
                for number in self._doubts.doubted
            ),
            *(f"the Dask worker of {name} was lost; its pictures are weighed here" for name in lost),
        ]

    def finish(self) -> list[TrackFrame]:
        """The frames still held back; workers are left."""
        frames = super().finish()
        self._evaluators.close()
        return frames

    def tracks(self) -> list[Track]:
        """Everybody confirmed, as of the moment worked last; x and y are the ground under the head."""
        people = self._people
        place, (yaw, _), shown = people.place, people.direction(), people.roster.measured_ns == self._ns
        rows = np.column_stack([place[:, :2], people.velocity[:, :2], np.full(len(place), nan), place, yaw]).tolist()
        return [
            Track(int(people.roster.id[k]), *rows[k], status="confirmed" if shown[k] else "coasting")
            for k in np.flatnonzero(people.roster.confirmed)
        ]

    def inside(self) -> Inside:
        """What was known at the moment worked last, for drawings."""
        return Inside(self._people, self._weights)

    def _maps(self) -> tuple[Hypotheses, ...]:
        """Some hypotheses of everybody confirmed."""
        roster = self._people.roster
        return tuple(
            Hypotheses(int(roster.id[k]), roster.state.state[:3, k, :: max(1, self.options.heads // _SHOWN)].T)
            for k in np.flatnonzero(roster.confirmed)
        )

    def _work(self, moment: Moment) -> None:
        dt = min((moment.ns - self._ns) / NS_PER_S, _LONGEST_S) if self._ns else 0.0
        self._ns = moment.ns
        later_s = self._taken(moment)
        if len(self._people):
            self._follow(dt, later_s)
        self._people = self._life.begun(self._people, self._ns)
        if not self.options.start and later_s:
            self._find(later_s)

    def _taken(self, moment: Moment) -> dict[str, float]:
        """The cameras whose pictures show anything, in the rig's order, and how much later than the moment each was taken [s]."""
        images = {name: each for name, each in moment.observations.items() if isinstance(each, DepthImage)}
        shown = self._evaluators.take(images)
        if not self.options.own_stamps:
            return dict.fromkeys(shown, 0.0)
        return {name: (images[name].stamp_ns - moment.ns) / NS_PER_S for name in shown}

    def _follow(self, dt: float, later_s: dict[str, float]) -> None:
        """Everybody `dt` later, by what the pictures show."""
        options, people = self.options, self._people
        motion, colour = Motion(people, dt, options.motion), options.weights.colour
        if colour.used and colour.by_person:
            self._evaluators.expect(later_s, people.colours.expected(self._learned.common, colour))
        weighed: dict[str, Weights] = {}

        def log_likelihood(state: Array) -> Array:
            weighed.update(self._weighed(state, later_s))
            return self._total(state, weighed, motion) / options.motion.layers

        cloud = people.roster.state
        for layer in range(options.motion.layers):
            cloud = FILTER.step(cloud, partial(motion.moved, layer=layer), log_likelihood, self._rng)
        people = people.changed(roster=people.roster.changed(state=cloud))
        facing = self._faced(people, motion, later_s) if motion.facing.size else motion.facing
        velocity, usual = motion.velocity(people.place), self._usual(people, weighed)
        self._people = people.changed(velocity=velocity, usual=usual, facing=facing)
        self._weights = weighed
        self._look(later_s, weighed)

    def _faced(self, people: People, motion: Motion, later_s: dict[str, float]) -> Float[Array, "n g"]:
        """Where everybody faces after what the pictures show at their expected places, and by where they walk."""
        facing = motion.facing
        log = motion.walking(np.broadcast_to(grid_of(facing.shape[1]), facing.shape))
        if self.options.weights.colour.used:
            heads = {name: _heads(people, later, 0.0) for name, later in later_s.items()}
            log = log + sum(self._evaluators.facing(heads))
        with np.errstate(divide="ignore"):
            return LogWeights.of(np.log(facing) + log).normalised

    def _weighed(self, state: Float[Array, "4 n p"], later_s: dict[str, float]) -> dict[str, Weights]:
        """What each picture makes of hypotheses, moved to its own stamp."""
        velocity, heads = self._people.velocity.T[..., None].astype(np.float32), {}
        for name, later in later_s.items():
            heads[name] = state.astype(np.float32)
            heads[name][:3] += np.float32(later) * velocity
        return self._evaluators.weights(heads)

    def _total(self, state: Float[Array, "4 n p"], weighed: dict[str, Weights], motion: Motion) -> Float[Array, "n p"]:
        """The logarithm of the product of all weights (eq. 9)."""
        people, options = self._people, self.options
        n, p = state.shape[1:]
        total = np.zeros((n, p))
        for name, weights in weighed.items():
            usual = np.nan_to_num(people.usual[:, self._numbers[name], None]) - options.life.unseen
            seen = weights.seen.reshape(n, p)
            total += np.where(seen, (weights.colour + weights.depth).reshape(n, p), usual)
        total += self._room.log_weight(state[:3].reshape(3, n * p).T).reshape(n, p)
        if not people.facing.size:
            total += motion.walking(state[3])
        if n > 1:
            away = np.sqrt(((state[:3, :, :, None] - people.place.T[:, None, None]) ** 2).sum(axis=0))
            away[np.arange(n), :, np.arange(n)] = np.inf
            total -= _OTHERS * (away.min(axis=2) < options.life.same_head_m)
        return total

    def _usual(self, people: People, weighed: dict[str, Weights]) -> Float[Array, "n cameras"]:
        """What a person's heads usually weigh in each camera's pictures, after these."""
        usual, cloud = people.usual.copy(), people.roster.state
        for name, weights in weighed.items():
            number, share = (
                self._numbers[name],
                cloud.weights.normalised * weights.seen.reshape(cloud.weights.log.shape),
            )
            total = share.sum(axis=1)
            mean = (share * (weights.colour + weights.depth).reshape(share.shape)).sum(axis=1) / np.maximum(total, 1e-9)
            old = np.where(np.isnan(usual[:, number]), mean, usual[:, number])
            usual[:, number] = np.where(total > 0.5, old + _USUAL * (mean - old), usual[:, number])
        return usual

    def _look(self, later_s: dict[str, float], weighed: dict[str, Weights]) -> None:
        """Who is shown; their colours are learned; who is not shown for long is gone."""
        people, options = self._people, self.options
        share, n_seen, shown = people.roster.state.weights.normalised, np.zeros(len(people)), np.zeros(len(people))
        for weights in weighed.values():
            n_seen += np.einsum("np,np->n", share, weights.seen.reshape(share.shape))
            shown += np.einsum("np,np->n", share, weights.shown.reshape(share.shape))
        is_shown = (n_seen > 0.5) & (shown >= options.life.least_shown * n_seen)
        if later_s:
            self._turn += 1
            name = list(later_s)[self._turn % len(later_s)]  # one camera after another
            if len(self._numbers) > 2:  # two cannot tell which of them is wrong
                self._doubt(people, name, later_s[name])
            if options.weights.colour.by_person:
                people = people.changed(colours=self._learned_colours(people, is_shown, name, later_s[name]))
        self._people = self._life.shown(people, is_shown, self._ns)

    def _doubt(self, people: People, name: str, later_s: float) -> None:
        """Where a camera has the silhouettes of everybody confirmed."""
        heads = _heads(people, later_s, 0.0)[:, people.roster.confirmed]
        if heads.size:
            off = self._evaluators.asides(name, heads)
            for each in off[np.isfinite(off[:, 0])]:
                self._doubts.take(self._numbers[name], each)

    def _learned_colours(self, people: People, is_shown: Bool[Mask, "n"], name: str, later_s: float) -> HeadColours:
        """After a camera's look at who is shown and faces surely somewhere."""
        yaw, sure = people.direction()
        person, step, colour = pixels = self._evaluators.look(name, _heads(people, later_s, yaw))
        person, step, colour = pixels[:, (is_shown & (sure > _SURE))[person]]
        return people.colours.learned(person, step, colour, self._learned.common, self.options.weights.colour)

    def _find(self, later_s: dict[str, float]) -> None:
        """Begin heads where the foreground shows somebody whom nobody follows."""
        people, life = self._people, self.options.life
        known = people.place[people.roster.measured_ns == self._ns, :2]
        points = self._evaluators.strangers(later_s, known, life.apart_m)
        found = newcomers(points, life)
        if len(found):
            found = found[np.isfinite(self._room.log_weight(found))]
            self._people = self._life.found(people, found, self._ns)


def _heads(people: People, later_s: float, yaw: Float[Array, "n"] | float) -> Float[Array, "4 n"]:
    """Everybody's head some time later."""
    place = people.place + later_s * people.velocity
    return np.column_stack([place, np.broadcast_to(yaw, len(place))]).T


def _evaluators_of(here: Mapping[str, Evaluator], scheduler: str | None) -> Evaluators:
    """Those that are asked: here, or on the workers of a Dask scheduler, which is loaded then alone."""
    if scheduler is None:
        return Evaluators(here)
    from trackers.rgbd_head.scheduled import ScheduledEvaluators

    return ScheduledEvaluators(here, scheduler)


def _stereo_cameras(rig: Rig, chosen: Sequence[str]) -> dict[str, StereoSensor]:
    """The rig's stereo cameras, or those chosen; raises InputError where there is none of that name, or none at all."""
    found = {name: each for name, each in rig.sensors.items() if isinstance(each, StereoSensor)}
    if not found:
        raise InputError(
            f"tracker rgbd-head: none of the rig's sensors ({', '.join(rig.sensors)}) is a stereo camera; one of kind "
            "stereo, with colour and depth, is needed"
        )
    for name in chosen:
        if name not in found:
            raise InputError(
                f"tracker rgbd-head: cameras: there is no stereo camera {name!r}; valid are {', '.join(found)}"
            )
    return {name: each for name, each in found.items() if not chosen or name in chosen}
