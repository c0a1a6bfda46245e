"""Heads in 3-D, position and direction, from stereo RGB-D cameras and a model of the room.

After T. Suzuki, S. Iwasaki, Y. Kobayashi, Y. Sato and A. Sugimoto: "Incorporating environment models for improving
vision-based tracking of people" (Systems and Computers in Japan 38(2), 2007). One particle filter per head; every picture
weighs every hypothesis by colours and distances (eq. 4 to 7), the room weighs it once per frame (eq. 8), the weights are
multiplied (eq. 9) and the expectation is the estimate. Each of our replacements of the paper's rules is an option, "(ours)"
in `options`.

A track's x and y are the ground under the head, not under the pelvis; its z is not estimated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from math import nan
from typing import Any, NamedTuple

import numpy as np

from trackers.area import Area
from trackers.arrays import Array
from trackers.configuration import validate
from trackers.errors import InputError, valid_names
from trackers.filters.particle import ParticleFilter
from trackers.likelihood.floor import EnvironmentLikelihood, EnvironmentLikelihoodOptions
from trackers.likelihood.stereo_head import HeadLikelihoods
from trackers.observations import NS_PER_S, DepthImage, Observation
from trackers.prior import Prior
from trackers.rgbd_head.calibration import CalibrationCheck, turned
from trackers.rgbd_head.evaluators import Evaluator, Evaluators, ScheduledEvaluators
from trackers.rgbd_head.head_tracks import HeadTrackManager, HeadTracks, Motion
from trackers.rgbd_head.likelihoods import Likelihoods
from trackers.rgbd_head.options import RgbdHeadOptions
from trackers.rig import Rig, StereoSensor
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracks import Hypotheses, Track, TrackFrame
from trackers.vision.front_end import front_ends
from trackers.vision.head_colours import SHIPPED, load_head_model
from trackers.vision.stereo_picture import StereoCamera, heads_in_plan

LEARNED = "heads"
"""Name under which the prior's `learned` may hold another model file than the shipped one (made by `scripts/learn-heads`).
"""
_LONGEST_S = 0.5
"""Greatest time step of the motion after a gap."""
_SHOWN = 64
"""Approximate number of hypotheses per person for the preview."""
_SHADOWS_M = 0.4
"""Distance beside the tracked area up to which shadows fall on the floor."""


class HeadDebugState(NamedTuple):
    """The tracks after the last frame, and the likelihoods of their hypotheses by each picture."""

    people: HeadTracks
    likelihoods: dict[str, HeadLikelihoods]


class RgbdHead(SynchronizedTracker):
    """Stereo cameras trigger a frame; every head is weighed by all pictures, each at its own stamp.

    Raises InputError for a rig without a stereo camera, wrong options, pictures of another size than the rig's, and a
    scheduler without answer or with too few workers.
    """

    Options = RgbdHeadOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(RgbdHeadOptions, options, "tracker rgbd-head")
        sensors = _stereo_cameras(rig, self.options.cameras)
        self.unused_sensors = [name for name in rig.sensors if name not in sensors]
        prior = Prior.of(background)
        area = Area(rig.area, _SHADOWS_M) if rig.area else None
        model = load_head_model(prior.learned.get(LEARNED, SHIPPED))
        skin = None if self.options.stereo_head.skin_share is None else model.skin
        prepared = front_ends(sensors, list(prior), self.options.front_end, area)
        whole = self.options.stereo_head.whole_picture
        cameras = {name: StereoCamera(each, sensors[name], skin, whole) for name, each in prepared.items()}
        self.background_learned_causally = any(each.learns_background for each in prepared.values())
        main = rig.main_sensor if rig.main_sensor in sensors else None
        super().__init__(SyncPolicy(tuple(sensors), main=main, period_s=0.25))
        self._rng = np.random.default_rng(0) if rng is None else rng
        self._manager = HeadTrackManager(self.options, rig.area or None, len(sensors), self._rng)
        self._people = self._manager.no_tracks()
        known = None if self.options.environment is None else prior.environment
        self._lacks_environment = known is None and self.options.environment is not None
        self._calibration = CalibrationCheck(list(sensors), turned(cameras, known), self.options.leave_out)
        self._ns, self._frame_ns, self._turn, self._began = 0, 0, 0, False
        self._found: dict[str, HeadLikelihoods] = {}
        weighed_by, address = self.options.stereo_head, self.options.scheduler
        here = {name: Evaluator(each, model, weighed_by) for name, each in cameras.items()}
        if address is None:
            self._evaluators = Evaluators(here, model, weighed_by)
        else:
            self._evaluators = ScheduledEvaluators(here, model, weighed_by, address)
        self._room = EnvironmentLikelihood(known, self.options.environment or EnvironmentLikelihoodOptions())
        self._likelihoods = Likelihoods(self._evaluators, self._room, model.common, self.options)
        self._filter = ParticleFilter(threshold=self.options.motion.resample_below)

    @property
    def warnings(self) -> list[str]:
        """Missing or doubtful inputs, and cameras whose Dask worker was lost."""
        lost = [
            f"the Dask worker of {name} was lost; its pictures are weighed here" for name in self._evaluators.taken_over
        ]
        room = ["goes without the room's environment (`twin environment` makes one)"] * self._lacks_environment
        return [*room, *self._calibration.warnings, *lost]

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames, and disconnect from the workers."""
        frames = super().finish()
        self._evaluators.close()
        return frames

    def tracks(self) -> list[Track]:
        """Return the confirmed tracks of the last frame; x and y are the ground under the head."""
        people = self._people
        place, (yaw, _), shown = people.place, people.direction(), people.roster.measured_ns == self._ns
        rows = np.column_stack([place[:, :2], people.velocity[:, :2], np.full(len(place), nan), place, yaw]).tolist()
        return [
            Track(int(people.roster.id[k]), *rows[k], status="confirmed" if shown[k] else "coasting")
            for k in np.flatnonzero(self._manager.reported(people.roster, self._ns))
        ]

    def debug_state(self) -> HeadDebugState:
        """Return the state of the last frame, for drawings."""
        return HeadDebugState(self._people, self._found)

    def _maps(self) -> tuple[Hypotheses, ...]:
        """Return some hypotheses of all confirmed tracks."""
        roster = self._people.roster
        return tuple(
            Hypotheses(int(roster.id[k]), roster.state.state[:3, k, :: max(1, self.options.heads // _SHOWN)].T)
            for k in np.flatnonzero(roster.confirmed)
        )

    def _work(self, synced: SyncedFrame) -> None:
        self._frame_ns = synced.ns - self._ns if self._began else 0
        self._ns, self._began = synced.ns, True
        later_s = self._taken(synced)
        if len(self._people):
            self._follow(min(self._frame_ns / NS_PER_S, _LONGEST_S), later_s)
        self._people = self._manager.with_known_starts(self._people, self._ns)
        if not self.options.start and later_s:
            self._initiate(later_s)

    def _taken(self, synced: SyncedFrame) -> dict[str, float]:
        """Send pictures; return the delay after the frame [s] of each usable one.

        Oldest first, so that sums, and the order of learning, do not depend on the order of the rig's sensors.
        """
        images = {
            name: each
            for name, each in synced.observations.items()
            if isinstance(each, DepthImage) and name not in self._calibration.left_out
        }
        shown = sorted(self._evaluators.take(images), key=lambda name: images[name].stamp_ns)
        if not self.options.own_stamps:
            return dict.fromkeys(shown, 0.0)
        return {name: (images[name].stamp_ns - synced.ns) / NS_PER_S for name in shown}

    def _follow(self, dt: float, later_s: dict[str, float]) -> None:
        """Update all tracks, `dt` later, by the pictures."""
        before, likelihoods, options = self._people, self._likelihoods, self.options.motion
        motion = Motion(before, dt, options)
        likelihoods.expect(before, later_s)
        found: dict[str, HeadLikelihoods] = {}

        def log_likelihood(state: Array) -> Array:
            found.update(likelihoods.by_camera(before, state, later_s))
            return likelihoods.log_likelihood(before, state, found, motion) / options.layers

        cloud = before.roster.state
        for layer in range(options.layers):
            cloud = self._filter.step(cloud, partial(motion.moved, layer=layer), log_likelihood, self._rng)
        people = before.changed(roster=before.roster.changed(state=cloud))
        facing = likelihoods.facing(people, motion, later_s) if motion.facing.size else motion.facing
        velocity, usual = motion.velocity(people.place), likelihoods.usual(people, found)
        self._people = people.changed(velocity=velocity, usual=usual, facing=facing)
        self._found = found
        self._learn(later_s, found)

    def _learn(self, later_s: dict[str, float], found: dict[str, HeadLikelihoods]) -> None:
        """Learn calibration, and colours from one camera after another, and manage tracks by their detection."""
        people = self._people
        is_shown = self._likelihoods.is_shown(people, found)
        if later_s:
            self._turn += 1
            name = list(later_s)[self._turn % len(later_s)]
            known = people.roster.confirmed
            if (shown := is_shown[known]).any():  # those not shown may be too near others
                heads = {each: people.heads(later, 0.0)[:, known] for each, later in later_s.items()}
                self._calibration.take(self._evaluators.head_offsets(heads), shown)
            if self._likelihoods.learns_colours:
                people = people.changed(colours=self._likelihoods.colours(people, is_shown, name, later_s[name]))
        self._people = self._manager.updated(people, is_shown, self._ns, self._frame_ns)

    def _initiate(self, later_s: dict[str, float]) -> None:
        """Initiate heads at foreground of a person without a track."""
        people, limits = self._people, self.options.track_management
        known = people.place[people.roster.measured_ns == self._ns, :2]
        points = self._evaluators.unassigned(later_s, known, limits.start_apart_m)
        found = heads_in_plan(points, limits.least_m2, limits.start_apart_m)
        if len(found):
            found = found[np.isfinite(self._room.log_likelihood(found))]
            self._people = self._manager.initiated(people, found, self._ns)


def _stereo_cameras(rig: Rig, chosen: Sequence[str]) -> dict[str, StereoSensor]:
    """Return the rig's stereo cameras, or those chosen; raises InputError for an unknown name, or without any."""
    found = {name: each for name, each in rig.sensors.items() if isinstance(each, StereoSensor)}
    if not found:
        raise InputError(
            f"tracker rgbd-head: none of the rig's sensors ({', '.join(rig.sensors)}) is a stereo camera; one of kind "
            "stereo, with colour and depth, is needed"
        )
    for name in chosen:
        if name not in found:
            raise InputError(
                f"tracker rgbd-head: cameras: there is no stereo camera {name!r}; {valid_names(name, found)}"
            )
    return {name: each for name, each in found.items() if not chosen or name in chosen}
