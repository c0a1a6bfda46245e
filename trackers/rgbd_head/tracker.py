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

from trackers.area import Area
from trackers.arrays import Array
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.particle import ParticleFilter
from trackers.observations import NS_PER_S, DepthImage, Observation
from trackers.prior import Prior
from trackers.rgbd_head.calibration_check import Doubts
from trackers.rgbd_head.evaluators import Evaluator, Evaluators
from trackers.rgbd_head.initiation import newcomers
from trackers.rgbd_head.learned import SHIPPED, load_learned
from trackers.rgbd_head.motion import Motion
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rgbd_head.people import People
from trackers.rgbd_head.picture import CameraFrontEnd
from trackers.rgbd_head.room import Room
from trackers.rgbd_head.sight import Sight
from trackers.rgbd_head.track_manager import TrackManager
from trackers.rgbd_head.weighing import Weights
from trackers.rig import Rig, StereoSensor
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synced_tracker import SynchronizedTracker
from trackers.tracks import Hypotheses, Track, TrackFrame

FILTER = ParticleFilter(threshold=0.7)
LEARNED = "heads"
"""Name under which `background.learned` may hold another file than the shipped one (`scripts/learn-heads` makes one)."""
_LONGEST_S = 0.5
"""However long nothing came, heads move for no longer at once."""
_SHOWN = 64
"""About so many hypotheses of each person are handed out for the preview."""
_BESIDE_M = 0.4
"""So far beside the tracked area there is floor that shadows fall on."""


class Inside(NamedTuple):
    """What the tracker knew at the moment worked last: everybody's hypotheses, and what each picture made of them."""

    people: People
    weighed: dict[str, Weights]


class RgbdHead(SynchronizedTracker):
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
        known = Prior.of(background)
        area = Area(rig.area, _BESIDE_M) if rig.area else None
        learned = load_learned(known.learned.get(LEARNED, SHIPPED))
        watchers = {
            name: CameraFrontEnd(
                sensor, [each for each in known if each.sensor == name], learned, self.options.weights, area
            )
            for name, sensor in sensors.items()
        }
        self._room = Room(known.environment, self.options.environment)
        self.background_learned_causally = any(each.foreground.learns_background for each in watchers.values())
        main = rig.main_sensor if rig.main_sensor in sensors else None
        super().__init__(SyncPolicy(tuple(sensors), main=main, period_s=0.25))
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._track_manager = TrackManager(self.options, len(sensors), self._rng)
        self._people = self._track_manager.nobody()
        self._doubts = Doubts(list(sensors), self._room.turned(watchers), self.options.leave_out)
        self._ns, self._turn, self._began = 0, 0, False
        self._weights: dict[str, Weights] = {}
        here = {name: Evaluator(each) for name, each in watchers.items()}
        self._evaluators = _evaluators_of(here, self.options.scheduler)
        self._sight = Sight(self._evaluators, self._room, learned.common, self.options)

    @property
    def warnings(self) -> list[str]:
        """What is lacking or doubtful, and which camera's Dask worker was lost."""
        lost = [
            f"the Dask worker of {name} was lost; its pictures are weighed here" for name in self._evaluators.taken_over
        ]
        return [*self._room.warnings, *self._doubts.warnings, *lost]

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

    def _work(self, moment: SyncedFrame) -> None:
        dt = min((moment.ns - self._ns) / NS_PER_S, _LONGEST_S) if self._began else 0.0
        self._ns, self._began = moment.ns, True
        later_s = self._taken(moment)
        if len(self._people):
            self._follow(dt, later_s)
        self._people = self._track_manager.begun(self._people, self._ns)
        if not self.options.start and later_s:
            self._find(later_s)

    def _taken(self, moment: SyncedFrame) -> dict[str, float]:
        """The cameras whose pictures show anything, in the rig's order, and how much later than the moment each was taken [s]."""
        images = {
            name: each
            for name, each in moment.observations.items()
            if isinstance(each, DepthImage) and name not in self._doubts.left_out
        }
        shown = self._evaluators.take(images)
        if not self.options.own_stamps:
            return dict.fromkeys(shown, 0.0)
        return {name: (images[name].stamp_ns - moment.ns) / NS_PER_S for name in shown}

    def _follow(self, dt: float, later_s: dict[str, float]) -> None:
        """Everybody `dt` later, by what the pictures show."""
        before, sight, options = self._people, self._sight, self.options.motion
        motion = Motion(before, dt, options)
        sight.expect(before, later_s)
        weighed: dict[str, Weights] = {}

        def log_likelihood(state: Array) -> Array:
            weighed.update(sight.weighed(before, state, later_s))
            return sight.log_weight(before, state, weighed, motion) / options.layers

        cloud = before.roster.state
        for layer in range(options.layers):
            cloud = FILTER.step(cloud, partial(motion.moved, layer=layer), log_likelihood, self._rng)
        people = before.changed(roster=before.roster.changed(state=cloud))
        facing = sight.facing(people, motion, later_s) if motion.facing.size else motion.facing
        velocity, usual = motion.velocity(people.place), sight.usual(people, weighed)
        self._people = people.changed(velocity=velocity, usual=usual, facing=facing)
        self._weights = weighed
        self._look(later_s, weighed)

    def _look(self, later_s: dict[str, float], weighed: dict[str, Weights]) -> None:
        """Who is shown; their colours are learned; who is not shown for long is gone."""
        people = self._people
        is_shown = self._sight.is_shown(people, weighed)
        if later_s:
            self._turn += 1
            name = list(later_s)[self._turn % len(later_s)]  # one camera after another
            heads = people.heads(later_s[name], 0.0)[:, people.roster.confirmed]
            if heads.size:
                self._doubts.take(name, self._evaluators.silhouette_offsets(name, heads))
            if self.options.weights.colour.by_person:
                people = people.changed(colours=self._sight.colours(people, is_shown, name, later_s[name]))
        self._people = self._track_manager.shown(people, is_shown, self._ns)

    def _find(self, later_s: dict[str, float]) -> None:
        """Begin heads where the foreground shows somebody whom nobody follows."""
        people, life = self._people, self.options.life
        known = people.place[people.roster.measured_ns == self._ns, :2]
        points = self._evaluators.strangers(later_s, known, life.apart_m)
        found = newcomers(points, life)
        if len(found):
            found = found[np.isfinite(self._room.log_weight(found))]
            self._people = self._track_manager.found(people, found, self._ns)


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
