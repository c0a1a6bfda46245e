"""The tracker: legs by a classifier, two to a person, in a fixed frame; existence by evidence in nats.

Each scan of a low scanner gets a pose (`trackers.frames`). Its clusters get evidence of being legs, are assigned to predicted
people by likelihood, two to each, and start tracks where they are left over. What a track has shown so far tells how
probably it is a person (`evidence`): it is confirmed, and reported, by that.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import validate
from trackers.filters.gating import distances, max_weight_assignment
from trackers.filters.imm import Imm
from trackers.filters.motion import VelocityMotion
from trackers.filters.rows import written
from trackers.frames.moving_scanners import FollowingTracker, sight_legs
from trackers.frames.rig_frames import RigFrames
from trackers.frames.sensor_frame import SensorFrame
from trackers.laser.bearings import DetectionModel, DetectionOptions
from trackers.laser.clusters import PAIR_M, Clusters, pair_off
from trackers.laser.group import scanners_by_role
from trackers.laser.legs.classifier import read_forest
from trackers.laser_legs.evidence import TRACK_FEATURES, LegTracks, assigned, measured_places, shown_by
from trackers.laser_legs.options import LaserLegsOptions
from trackers.observations import NS_PER_S, LaserScan, Observation
from trackers.rig import LaserSensor, Rig
from trackers.tracking.roster import Roster
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.track_manager import TrackManager
from trackers.tracks import Detection, Track, TrackFrame

EXISTENCE = Path(__file__).with_name("existence.npz")
"""File that `scripts/learn-legs` wrote."""
_PERIOD_S = 0.1
_EXISTENCE_S = 0.1
"""Time constant with which existence follows the evidence [s]."""
_WALKS_M_S = 1.5
"""Speed with which a person out of sight may have walked on [m/s]."""
_NEW = -2.4
"""Log-odds of a new track, before its first evidence [nat]: on drives every twelfth is a person's."""
_NEW_M = 0.14
"""Standard deviation of the place of a new track, on each axis [m]."""
_OTHER_LEG_M2 = 0.01
"""Variance of a person's place about a single leg [m²]."""
_REACH_GROWS_TO_M = 1.2


class LaserLegs(FollowingTracker):
    """Tracker of people by low scanners (see module). Raises InputError for a wrong option, or a rig without a low scanner."""

    Options = LaserLegsOptions

    def __init__(
        self, rig: Rig, background: Iterable[Observation] = (), rng: np.random.Generator | None = None, **options: Any
    ) -> None:
        self.options = validate(LaserLegsOptions, options, "tracker laser-legs")
        self._names = scanners_by_role(rig, ("knee",))["knee"]
        self.scanners = RigFrames(rig, self._names, self.options.matching, background)
        self._detection = DetectionModel(
            LaserSensor(topic="/scan"), DetectionOptions(width_m=0.08, half_width_m=0.25, hidden_up_to=0.5)
        )
        self._existence = read_forest(EXISTENCE, "existence", len(TRACK_FEATURES))
        self.manager = TrackManager(self.options.track_management, rig.area)
        self._imm = Imm(VelocityMotion(), measurement_covariance=np.eye(2) * self.options.measurement_m**2)
        opens = self._names if rig.main_sensor in self._names else (*self._names, rig.main_sensor)
        rules = SyncPolicy(opens, main=rig.main_sensor)
        super().__init__(rules, self.scanners, self.options.report_in, self.options.track_management.coast_s)
        self.unused_sensors = [name for name in rig.sensors if name not in {*self._names, *self.bases}]
        none = LegTracks.started(self._imm.start(np.empty((0, 2))), 0, np.zeros(2), _NEW, 0.0)
        self.roster: Roster[LegTracks] = Roster.started(none, 0)
        self.ns = 0
        self._predicted_ns: int | None = None
        self._scanned_ns: dict[str, int] = {}
        self._frame_ns = self._since_ns = 0  # of the last frame, and of the first of its scans
        self._seen: list[Detection] = []
        self.features = np.empty((0, len(TRACK_FEATURES)))
        """Evidence of the tracks after the last scan."""

    def places(self) -> Float[Array, "n 2"]:
        """Return where all tracks are, tentative ones too, in the matched frame [m]."""
        return self._imm.average(self.roster.state.filter)[:2].T

    def detections(self) -> list[Detection]:
        """Return the legs of the frames of the last `update` or `finish`."""
        return self._seen

    def tracks(self) -> list[Track]:
        """Return the tracks that exist more probably than `existence`, as of the last frame, by id."""
        roster, state = self.roster, self.roster.state
        shown = self._is_there(roster, self.ns)
        average = self._imm.average(state.filter).T
        places, velocities = average[:, :2], average[:, 2:]
        reported_in = "matched" if self.options.report_in == "matched" else "rig"
        shown &= self.manager.inside(self.scanners.reported(places, velocities, reported_in, self.ns)[0])
        places, velocities = self.reported(places, velocities, self.ns)
        shown[shown] = likeliest(places[shown], state.log_odds[shown], self.options.report_apart_m)
        measured = roster.measured_ns >= self._since_ns
        return [
            Track(
                int(roster.id[k]), *places[k].tolist(), *velocities[k].tolist(),
                status="confirmed" if measured[k] else "coasting",
            )
            for k in sorted(shown.nonzero()[0].tolist(), key=lambda k: roster.id[k])
        ]  # fmt: skip

    def _is_there(self, roster: Roster[LegTracks], ns: int) -> Bool[Mask, "n"]:
        """Select the confirmed tracks that were measured lately and still exist by their evidence."""
        return self.manager.reported(roster, ns) & (roster.state.log_odds > _nats(self.options.least_existence))

    def _work_all(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        self._seen = []
        return super()._work_all(synced_frames)

    def _work(self, synced: SyncedFrame) -> None:
        self.ns = self._frame_ns = synced.ns
        scans = [scan for name in self._names if isinstance(scan := synced.observations.get(name), LaserScan)]
        self._since_ns = min((scan.stamp_ns for scan in scans), default=synced.ns)
        for scan in sorted(scans, key=lambda scan: scan.stamp_ns):
            if scan.ranges_m.size and not self.scanners.is_tilted(scan):
                self._take(self.scanners.upright(scan))
        self._predict(synced.ns)
        self._keep_lasting(synced.ns)

    def _keep_lasting(self, ns: int) -> None:
        kept = self.manager.lasting(self.roster, ns)
        self.features = self.features[kept[: len(self.features)]]
        self.roster = self.roster.select(kept)

    def _predict(self, ns: int) -> None:
        """Predict all tracks to a stamp."""
        elapsed = 0.0 if self._predicted_ns is None else max(ns - self._predicted_ns, 0) / NS_PER_S
        self._predicted_ns = ns if self._predicted_ns is None else max(ns, self._predicted_ns)
        if elapsed > 0 and len(self.roster):
            state = self.roster.state
            state = state.changed(filter=self._imm.predict_over(state.filter, min(elapsed, 10.0), _PERIOD_S))
            self.roster = self.roster.changed(state=state.faded(elapsed))

    def _take(self, scan: LaserScan) -> None:
        """Take the tracks on by a scan."""
        options, ns = self.options, scan.stamp_ns
        self._predict(ns)
        elapsed = max(ns - self._scanned_ns.get(scan.sensor, ns), 0) / NS_PER_S
        self._scanned_ns[scan.sensor] = ns
        sight = sight_legs(scan, self.scanners, options.least_evidence, options.start_evidence, options.half_depth_m)
        frame, legs, evidence, places = sight.frame, sight.legs, sight.evidence, sight.places
        self._tell(scan.sensor, places[evidence > options.start_evidence])
        n_known, owner = len(self.roster), self._owners(places, evidence)
        self._initiate(scan, frame, places, evidence, owner)
        self._measure(scan, frame, legs, places, evidence, owner, n_known, elapsed)

    def _owners(self, places: Float[Array, "k 2"], evidence: Float[Array, "k"]) -> Int[Index, "k"]:
        """Assign the legs to the tracks; return the track of each, −1: none."""
        mean, covariance = self._imm.estimate(self.roster.state.filter)
        spread = np.sqrt(np.maximum(covariance[:, 0, 0] + covariance[:, 1, 1], 0.0) / 2)
        reach_m = np.minimum(self.options.reach_m + spread, _REACH_GROWS_TO_M)
        owner = np.full(len(places), -1)
        # who is known takes both legs before a newer track one
        for group in (self.roster.confirmed, ~self.roster.confirmed):
            members, free = group.nonzero()[0], (owner < 0).nonzero()[0]
            taken = assigned(mean[members, :2], spread[members], reach_m[members], places[free], evidence[free])
            owner[free[taken >= 0]] = members[taken[taken >= 0]]
        return owner

    def _initiate(
        self, scan: LaserScan, frame: SensorFrame, places: Float[Array, "k 2"], evidence: Float[Array, "k"],
        owner: Int[Index, "k"],
    ) -> None:  # fmt: skip
        """Start tracks at legs that are nobody's, two to each where they are close; these become their legs."""
        free = (owner < 0).nonzero()[0]
        known, new = self.places(), np.empty((0, 2))
        for place in pair_off(places[free[evidence[free] > self.options.start_evidence]], PAIR_M)[0][:, None]:
            if self.manager.may_start(place, np.concatenate([known, new]))[0]:
                new = np.concatenate([new, place])
        n = len(new)
        taken = assigned(new, np.full(n, _NEW_M), np.full(n, PAIR_M), places[free], evidence[free])
        owner[free[taken >= 0]] = len(known) + taken[taken >= 0]
        state = self._imm.start(new, position_variance_m2=_NEW_M**2, speed_variance=1.0)
        tracks = LegTracks.started(state, self._names.index(scan.sensor), frame.pose[:2], _NEW, scan.t)
        self.roster = self.roster.joined(Roster.started(tracks, scan.stamp_ns))

    def _measure(
        self, scan: LaserScan, frame: SensorFrame, legs: Clusters, places: Float[Array, "k 2"], evidence: Float[Array, "k"],
        owner: Int[Index, "k"], n_known: int, elapsed: float,
    ) -> None:  # fmt: skip
        """Measure the tracks by their legs, all but the first `n_known` of which were initiated at them."""
        options, state = self.options, self.roster.state
        if len(state) == 0:
            self.features = self.features[:0]
            return
        mean, _ = self._imm.estimate(state.filter)
        track, position, first, second, both = measured_places(owner, places, evidence)
        shown = shown_by(legs, places, evidence, first, second, both, np.hypot(*(position - mean[track, :2]).T))
        variance = options.measurement_m**2 + np.where(both, 0.0, _OTHER_LEG_M2)
        known = track < n_known
        filter_ = self._imm.update(
            state.filter, track[known], position[known], (np.eye(2) * variance[:, None, None])[known]
        )
        p_detect = self._detection.seen(scan, frame.seen_from(mean[:, :2]).T)
        state = state.changed(filter=filter_).looked(
            track, shown, p_detect, max(elapsed, 1e-3), self._names.index(scan.sensor)
        )
        n_leglike = int((evidence > options.start_evidence).sum())
        roster = self.roster.measured(track[known], scan.stamp_ns, state)
        self.roster = self._evaluated(roster, scan, frame, elapsed, n_leglike)

    def _evaluated(
        self, roster: Roster[LegTracks], scan: LaserScan, frame: SensorFrame, elapsed: float, n_leglike: int
    ) -> Roster[LegTracks]:
        """Find the existence of the tracks that this scanner measured last, and confirm those that exist."""
        state, scanner = roster.state, self._names.index(scan.sensor)
        own = state.scanner == scanner
        mean, covariance = self._imm.estimate(state.filter)
        places = mean[:, :2]
        born_s = roster.born_ns / NS_PER_S
        state = state.arrived(places, own, born_s, scan.t, frame.looks)
        spread = np.sqrt(np.maximum(covariance[:, 0, 0] + covariance[:, 1, 1], 0.0) / 2)
        scanners = np.array([self.scanners.of[name].pose[:2] for name in self._names])
        self.features = state.features(
            places, np.hypot(mean[:, 2], mean[:, 3]), spread, scan.t - born_s, scan.t - state.came_s, scanner, scanners,
            frame.driving, scan.angle_increment_rad, elapsed, n_leglike,
        )  # fmt: skip
        verdict = self._existence.score(self.features[own])
        follow = 1 - np.exp(-max(elapsed, 1e-3) / _EXISTENCE_S)
        before = state.log_odds[own]
        state = state.changed(log_odds=written(state.log_odds, own, before + follow * (verdict - before)))
        roster = roster.changed(state=state)
        new = self.manager.to_confirm(roster, scan.stamp_ns, round(elapsed * NS_PER_S))
        new &= state.log_odds > _nats(self.options.existence)
        return self.manager.confirm(*self._resumed(roster, places, new, scan.stamp_ns))

    def _resumed(
        self, roster: Roster[LegTracks], places: Float[Array, "n 2"], new: Bool[Mask, "n"], ns: int
    ) -> tuple[Roster[LegTracks], Bool[Mask, "n"]]:
        """Give tracks that are to be confirmed the ids of people lost within reach, who by now are rather not where they were
        expected; return the others of them too.
        """
        is_lost = ~self._is_there(roster, ns) | (roster.state.log_odds < _nats(self.options.existence))
        rows, lost = new.nonzero()[0], (roster.confirmed & is_lost).nonzero()[0]
        hidden_s = np.maximum(roster.born_ns[rows] - roster.measured_ns[lost, None], 0) / NS_PER_S
        reach_m = self.options.reach_m + _WALKS_M_S * hidden_s
        old, again = max_weight_assignment(reach_m - distances(places[lost], places[rows]))
        old, again = lost[old], rows[again]
        id_, confirmed = roster.id.copy(), roster.confirmed.copy()
        id_[again], id_[old] = id_[old], 0
        confirmed[again], confirmed[old] = True, False
        return roster.changed(id=id_, confirmed=confirmed), new & ~confirmed

    def _tell(self, name: str, places: Float[Array, "k 2"]) -> None:
        """Keep the legs of a scan as detections, in the frame of the reports."""
        places, _ = self.reported(places, np.zeros_like(places), self.ns)
        variance = self.options.measurement_m**2
        self._seen += [Detection(self._frame_ns, (name,), "knee", x, y, variance) for x, y in places.tolist()]


def likeliest(places: Float[Array, "n 2"], log_odds: Float[Array, "n"], apart_m: float) -> Bool[Mask, "n"]:
    """Select the tracks without a likelier one nearer than `apart_m`, which has a leg of the same person."""
    order = np.argsort(-log_odds, kind="stable")
    near = np.tril(distances(places[order], places[order]) < apart_m, -1)
    kept = np.ones(len(places), np.bool_)
    kept[order] = ~near.any(axis=1)
    return kept


def _nats(probability: float) -> float:
    return float(np.log(probability / (1 - probability)))
