"""People tracking with a two-layer laser and a fisheye camera, after Bai and Takahashi: "Identification and Tracking Using
Laser and Vision of Maneuvering People".

Per frame: gather the sensors' observations; detect trunks and legs in front of the room; predict every track under every
motion model; associate by global nearest neighbour trunks, and legs for tracks without a trunk (never both); update measured
tracks, coast the others; delete tracks; start tracks.

Late and repeated observations are dropped and counted, also after time jumps back. Empty scans and scans with hundreds of
clusters need no special handling. A gap longer than `coast_s` terminates all tracks. With a learned background, a person
who was there at the first scan is not detected before they walk on.

Simplified: the observations of one frame are taken as simultaneous (they differ by up to half a scan period), and a scan as
instantaneous.

Ours, not the paper's, each an option: the correction from a cluster's middle to the body's axis, the completion of partly
occluded clusters, the grouping of arms and legs, no track from a single leg, acceleration in any direction, rejection of
unlikely measurements, negative information, re-identification of occluded people by colour or likelihood, and lying people.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import validate
from trackers.errors import InputError
from trackers.filters.imm import Imm, Motion
from trackers.filters.motion import AGILE, IMM_MODELS, KALMAN_MODELS, HeadingMotion, VelocityMotion
from trackers.filters.negative_information import miss_probability, radius_containing
from trackers.filters.rows import written
from trackers.frames.moving_scanners import FollowingTracker
from trackers.laser_fisheye_imm.association import Association, Matches
from trackers.laser_fisheye_imm.detection import Detector, Seen
from trackers.laser_fisheye_imm.laser_tracks import LaserTracks
from trackers.laser_fisheye_imm.options import START_SPEED_M_S, LaserFisheyeImmOptions
from trackers.laser_fisheye_imm.track_manager import ImmTrackManager, SeenBehind
from trackers.likelihood.legs import full_stride, legs_ahead_m, may_be_new
from trackers.observations import NS_PER_S, LaserScan, Observation
from trackers.rig import Rig
from trackers.tracking.fixed_lag_smoother import FixedLagSmoother, Held, by_id
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.track_manager import clear_of, measured_now
from trackers.tracks import Detection, Track, TrackFrame

logger = logging.getLogger(__name__)

_ISOTROPIC = np.eye(2)


class LaserFisheyeImm(FollowingTracker):
    """Tracker of people from a waist scanner, a knee scanner and a fisheye camera, or a subset (see module).

    background: observations of the empty room; a scanner without any learns its background. Options:
    `LaserFisheyeImmOptions`. Frames leave when complete, with the main sensor's stamp; `finish` returns the remaining ones.
    Deterministic: `rng` is not used.

    Raises InputError for an unknown or wrong option, for one without effect beside the others, and for a rig without a
    usable laser scanner.
    """

    Options = LaserFisheyeImmOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(LaserFisheyeImmOptions, options, "tracker laser-fisheye-imm")
        if idle := [f"tracker laser-fisheye-imm: {each}" for each in self.options.idle()]:
            raise InputError("\n".join(idle))
        self._rig = rig
        self._imm = filter_of(self.options)
        self._track_manager = ImmTrackManager(self.options, rig.area, self._imm)
        self._detector = Detector(rig, list(background), self.options, self._track_manager.area)
        used = self._detector.sensors
        scanners = tuple(name for name in used if name in rig.lasers())
        super().__init__(
            SyncPolicy(
                triggers=scanners,
                attached=tuple(name for name in used if name not in scanners),
                main=rig.main_sensor if rig.main_sensor in used else None,
                period_s=self.options.step_s,
                max_wait_s=self.options.max_wait_s,
            ),
            self._detector.frames,
            self.options.report_in,
            self.options.track_management.coast_s,
        )
        self._next_serial = 0
        no_colours = np.empty((0, self._detector.histogram.size))
        self._people = self._born(np.empty((0, 2)), np.empty(0), 0, no_colours, np.empty(0, np.bool_))
        self._smoother = self._made_to_wait()
        self._ns: int | None = None
        self._last_ns = 0  # of the frame before
        self._seen: list[tuple[int, Seen]] = []
        if self.background_learned_causally:
            learning = ", ".join(self._detector.learning)
            which = f" by {learning}, as there are by the others" if learning else ""
            logger.warning("no scans of the empty room%s: the background is learned from the scans as they come", which)

    @property
    def unused_sensors(self) -> list[str]:
        """Unused sensors of the rig: a scanner of no wanted role, a camera without a waist scanner, a floor."""
        return [name for name in self._rig.sensors if name not in {*self._detector.sensors, *self.bases}]

    @property
    def background_learned_causally(self) -> bool:
        """True with a scanner without scans of the empty room."""
        return self._detector.learns_background

    @property
    def warnings(self) -> list[str]:
        """Note on smoothed output, if enabled."""
        late_s = self.options.smoothed_s
        late = [f"its frames leave {late_s:g} s late, smoothed by what was measured meanwhile"] if late_s else []
        return late + super().warnings

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames after the last observation."""
        frames = super().finish()
        return frames + self.on_time(self._smoother.finish()) if self._smoother is not None else frames

    def detections(self) -> list[Detection]:
        """Return the detections of the frames processed by the last `update` or `finish`, see `trackers.tracks`."""
        found = [each for ns, seen in self._seen for each in self._detector.to_detections(seen, ns)]
        return self.reported_detections(found)

    def tracks(self) -> list[Track]:
        """Return the confirmed tracks in the area, of the last frame, by id, without those missed for long."""
        people = self._people
        if self._ns is None:
            return []
        roster = people.roster
        measured, shown = measured_now(roster, self._ns), self._track_manager.to_report(people, self._ns).nonzero()[0]
        shown = shown[roster.id[shown].argsort()]
        mean = self._imm.average(people.state)[:, shown]
        velocity = self._imm.motion.velocity(mean)
        sitting = people.posture.seated(people.measured_at, self.options.posture)[shown]
        constant_m2 = np.where(sitting, self.options.posture.lean_m**2, 0.0)
        if self._detector.sees_waists:
            constant_m2 += (1 - full_stride(np.hypot(*velocity))) * self.options.trunk.standing_m**2
        radius_m = radius_containing(people.state.select(shown), mean[:2].T, 0.95, constant_m2)
        places, velocities = self.reported(mean[:2].T, velocity.T, self._ns)
        columns = roster.id[shown], *places.T, *velocities.T, radius_m, measured[shown]
        return [
            Track(number, x, y, vx, vy, status="confirmed" if is_measured else "coasting", radius95_m=radius_m)
            for number, x, y, vx, vy, radius_m, is_measured in zip(*(each.tolist() for each in columns), strict=True)
        ]

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        self._seen = []
        if self._smoother is None:
            return super()._work_all(synced_frames)
        frames = []
        for synced in synced_frames:
            self._work(synced)
            people, roster = self._people, self._people.roster
            seen = measured_now(roster, synced.ns)
            places, _ = self.reported(people.measured_at, people.measured_at, synced.ns)
            held = Held(synced.ns, people.serial, seen, places, people.variance_m2, by_id(self.tracks()))
            frames += self._smoother.add(held, roster.id)
        return frames

    def _work(self, synced: SyncedFrame) -> None:
        seen = self._detector.detect(synced)
        self._seen.append((synced.ns, seen))
        elapsed_s = self._predict(synced.ns)
        waists = self._detector.sees_waists
        scans = synced.observations.items()
        self._track_manager.looked(synced.ns, [name for name, each in scans if isinstance(each, LaserScan)])
        knows_room = not self._detector.is_learning
        share = min(elapsed_s / self.options.step_s, 1.0)

        def missed(points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
            return self._detector.missed(synced, points) ** share

        state, velocity = self._people.state, self._imm.velocity(self._people.state)

        def chance_missed(track: Int[Index, "k"]) -> Float[Array, "k"]:
            return miss_probability(state.select(track), missed, velocity[:, track])

        times = synced.ns, self._last_ns
        knees, origins = self._knees(velocity), self._detector.origins
        at = Association(self._people, chance_missed, knees, self.options, *times, waists, knows_room, origins)
        matches = at.matches(seen)
        self._update(matches, synced.ns)
        self._learn_colours(matches, seen)
        people = self._track_manager.confirmed(self._people, synced.ns, self._seen_behind)
        people = self._track_manager.update_missed_tracks(people, synced.ns, elapsed_s, missed)
        self._people = self._track_manager.remaining(people, synced.ns, missed)
        self._start(matches, seen, synced.ns)

    @property
    def _seen_behind(self) -> SeenBehind | None:
        return self._detector.seen_behind if self._detector.is_learning else None

    # --- predict

    def _predict(self, ns: int) -> float:
        """Predict all tracks to stamp ns; return the time since the last frame [s]."""
        last_ns = ns if self._ns is None else self._ns
        self._ns = ns
        self._last_ns, elapsed_s = last_ns, (ns - last_ns) / NS_PER_S
        self._people = self._track_manager.before(self._people, last_ns, ns)
        self._people = self._people.in_state(self._imm.predict_over(self._people.state, elapsed_s, self.options.step_s))
        return elapsed_s

    # --- update

    def _update(self, matches: Matches, ns: int) -> None:
        people, track = self._people, matches.track
        # gait and clothes persist: views within one step together count as one
        last_ns, lasts_s = people.roster.measured_ns[track], np.full(track.size, self.options.step_s)
        if not self._detector.sees_waists:  # without trunks, a body may show only its standing leg
            last_ns = np.where(matches.single, people.single_ns[track], last_ns)
            lasts_s[matches.single] = self.options.legs.single_leg_s
        shares = np.minimum(np.maximum((ns - last_ns) / (lasts_s * NS_PER_S), 1e-6), 1.0)
        variance = matches.variance / shares
        state = self._imm.update(people.state, track, matches.position, variance[:, None, None] * _ISOTROPIC)
        posture = people.posture.measured(track, matches.position, matches.legs, self.options.posture)
        people = people.measured(track, matches.position, matches.variance, ns, state, matches.existence)
        people = people.turned(self._imm.velocity(state))
        self._people = people.changed(posture=posture, single_ns=written(people.single_ns, track[matches.single], ns))

    def _knees(self, velocity: Float[Array, "2 n"]) -> Float[Array, "n 2"]:
        """Return where the legs of upright people at these velocities [m/s] are expected from the body's axis [m]."""
        ahead_m = legs_ahead_m(np.hypot(velocity[0], velocity[1]), self._detector.knee_height_m, self.options.legs)
        return self._people.facing * ahead_m[:, None]

    def _learn_colours(self, matches: Matches, seen: Seen) -> None:
        looked = (matches.trunk >= 0).nonzero()[0]
        looked = looked[seen.clear[matches.trunk[looked]]]
        if looked.size == 0:
            return
        track = matches.track[looked]
        clothes = self._people.clothes.learned(
            track,
            seen.histograms[matches.trunk[looked]],
            np.zeros(track.size, np.bool_),
            0,
            self.options.appearance.memory,
        )
        self._people = self._people.changed(clothes=clothes)

    # --- start

    def _start(self, matches: Matches, seen: Seen, ns: int) -> None:
        if len(matches.new_position) == 0:
            return
        people, sitting = self._people, self.options.posture
        exist = people.exist(self.options.track_management.exists_above)
        bodies = np.concatenate([people.positions[exist], matches.position])
        # a single leg, or knees without a trunk where waists are seen, within a stride of somebody are likelier theirs
        waist_seen = self._detector.waists_seen(matches.new_position)
        maybe_theirs = matches.new_single | (waist_seen & (matches.new_trunk < 0))
        free = clear_of(matches.new_position, bodies, self.options.track_management.start_apart_m)
        seats = people.posture.seat[people.posture.seated(people.measured_at, sitting)]
        free &= clear_of(matches.new_position, seats, sitting.length_m)  # trunk and legs of who lies or gets up
        if self.options.legs.pair_m > 0:
            free &= ~(matches.new_single & waist_seen)
        free = may_be_new(matches.new_position, maybe_theirs, free, bodies, self.options.legs.start_apart_m)
        position, variance, trunk = matches.new_position[free], matches.new_variance[free], matches.new_trunk[free]
        histograms = np.zeros((len(position), self._detector.histogram.size))
        by_trunk = trunk >= 0
        has_reference = by_trunk.copy()
        has_reference[by_trunk] = seen.clear[trunk[by_trunk]]
        histograms[has_reference] = seen.histograms[trunk[has_reference]]
        people = self._people.joined(self._born(position, variance, ns, histograms, has_reference))
        self._people = self._track_manager.confirmed_at_once(people, matches.new_sample[free], ns, self._seen_behind)

    def _born(
        self,
        position: Float[Array, "n 2"],
        variance: Float[Array, "n"],
        ns: int,
        reference: Float[Array, "n bins"],
        has_reference: Bool[Mask, "n"],
    ) -> LaserTracks:
        state = self._imm.start(position, None, variance, START_SPEED_M_S**2)
        self._next_serial += len(position)
        n_look = has_reference.astype(np.int64)
        return LaserTracks.started(state, position, ns, reference, n_look, self._next_serial - len(position), variance)

    # --- set up

    def _made_to_wait(self) -> FixedLagSmoother | None:
        options = self.options
        if not options.smoothed_s:
            return None
        return FixedLagSmoother(options.smoothed_s, START_SPEED_M_S)


def filter_of(options: LaserFisheyeImmOptions) -> Imm:
    """Return a track's filter: several models or one, over velocities or the paper's over heading and speed."""
    single = options.filter == "kalman"
    motion: Motion = HeadingMotion(KALMAN_MODELS if single else IMM_MODELS)
    if options.motion == "velocities":
        motion = VelocityMotion((AGILE,)) if single else VelocityMotion()
    return Imm(motion, measurement_covariance=np.eye(2) * options.trunk.variance_m2)
