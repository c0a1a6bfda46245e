"""Scanners on a base that moves: from their scans to detections in a frame that stands, and trackers that take odometry.

A background as a range per beam is void there. Each scan gets a pose (`RigFrames`), and the memory of scans takes the
background's place. Of what is at a place now, ln (free + 1) / (hit + 1) are the log-odds that it has come there [nat], after so
many looks that saw the place free, and so many that saw something: Laplace's rule of succession. At knee height the evidence
of the leg classifier is added to it, cluster by cluster. At waist height it decides alone, sample by sample: people who have
stood there all the time are not detected before they walk on.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from trackers.area import wrap_angle
from trackers.arrays import Array, Bool, Float, Mask
from trackers.frames.rig_frames import ReportFrame, RigFrames
from trackers.frames.scan_matching import MatchingOptions
from trackers.frames.sensor_frame import SensorFrame
from trackers.laser.bearings import beams_of_turn, returns
from trackers.laser.clusters import Clusters, directions, pushed_back
from trackers.laser.group import MakeLayer
from trackers.laser.layer import KneeOptions, LaserLayer, LayerOptions
from trackers.laser.legs.classifier import shipped
from trackers.laser.legs.features import leg_clusters, own_samples
from trackers.observations import LaserScan, Observation, Odometry
from trackers.rig import LaserSensor, Pose, Rig
from trackers.tracking.missing_frames import FrameClock
from trackers.tracking.synced_frames import SyncedFrame, SyncPolicy
from trackers.tracking.synchronized_tracker import SynchronizedTracker
from trackers.tracks import Detection, TrackFrame

ReportIn = Annotated[
    Literal["rig", "matched"],
    Field(
        description="frame of the reports where scanners are on a base that moves. rig: the one that the rig is given in, "
        "odometry's; matched: the fixed frame that scan matching finds. Where all scanners stand, both are the rig's"
    ),
]
_WIDEST_M = 0.7
"""Wider clusters are no leg [m]."""
_BEFORE_S = 0.3
"""Looks until so long before a scan do not see yet what has just come [s]."""
_ROOM_NATS = 0.0
"""Evidence of a leg up to which a cluster may be of the room [nat]."""
_LEG_NATS = 2.5
"""Evidence of a leg that has come to its place, from which it is detected: the best of drawn drives for `sort` and `laser-imm`,
which take a detection for a person wherever a few of them come in turn [nat]."""
_CAME_NATS = 1.0
"""Evidence that something has come to a place, from which a sample at waist height is detected [nat]."""

_TAKEN = 0.5
"""Share of the legs in full view that are detected, in one scan after the other: on drawn drives a fifth of the people in view
are missed in a scan, and of these two thirds in the next one again, so that several misses in turn tell little."""


@dataclass(frozen=True, eq=False)
class LegSight:
    """Clusters of a scan that may be legs, and where the scanner is."""

    frame: SensorFrame
    legs: Clusters
    evidence: Float[Array, "k"]  # of being a leg [nat]
    places: Float[Array, "k 2"]  # of their axes in the fixed frame [m]


def sight_legs(
    scan: LaserScan, frames: RigFrames, least_nats: float, room_nats: float, half_depth_m: float
) -> LegSight:
    """Find the pose of an `upright` scan, and its clusters that may be legs, parts of the robot left out.

    least_nats: evidence of a leg below which a cluster is none; room_nats: evidence up to which it may be of the room, by which
    scans are matched; half_depth_m: how far a leg's axis lies behind its samples.
    """
    clusters = leg_clusters(scan)
    evidence = shipped().evidence(scan, clusters)
    still = np.ones(scan.ranges_m.size, np.bool_)
    if len(clusters):
        beam, _ = own_samples(scan, clusters)
        still[beam] = np.repeat(evidence <= room_nats, clusters.n_sample)
    frame = frames.located(scan, still)
    own = frame.own_parts(scan)[: beams_of_turn(scan)]
    kept = (evidence > least_nats) & (clusters.width_m < _WIDEST_M)
    kept &= ~own[clusters.first_beam] & ~own[clusters.last_beam]
    legs, count = clusters.select(kept), scan.ranges_m.size
    across_seam = count * (legs.last_beam < legs.first_beam)
    beam = (legs.first_beam + legs.last_beam + across_seam) / 2 % count
    return LegSight(frame, legs, evidence[kept], frame.placed(scan, pushed_back(legs.middle, half_depth_m), beam))


class MovingLayer(LaserLayer):
    """Scanner on a base that moves; points are in the fixed frame of `frames`, as of its last scan."""

    def __init__(self, frames: RigFrames, name: str, sensor: LaserSensor, options: LayerOptions) -> None:
        self._is_upside_down = bool(sensor.room_from_sensor.rotation[2, 2] < 0)
        upright_from_scan = Pose(rpy=(np.pi if self._is_upside_down else 0.0, 0.0, 0.0))
        super().__init__(LaserSensor(topic=sensor.topic, room_from_sensor=upright_from_scan), [], options)
        self.learns_background = False
        self._frames, self._name, self._sees_legs = frames, name, isinstance(options, KneeOptions)
        self._ns: int | None = None  # stamp of the last scan
        self._scan: LaserScan | None = None  # that scan, `upright`; None where it is empty, or the base tilts it
        self._mask = np.empty(0, np.bool_)

    @property
    def is_learning(self) -> bool:
        """False: the memory of scans stands in for scans of the empty room."""
        return False

    def missed(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Float[Array, "*n"]:
        """Return the probability that the last scan does not detect a person at points; 1 where the base tilts it."""
        if self._scan is None:
            return np.ones(points.shape[1:])
        return 1 - (_TAKEN if self._sees_legs else 1.0) * (1 - super().missed(scan, points))

    def passes(self, scan: LaserScan, points: Float[Array, "2 *n"]) -> Bool[Mask, "*n"]:
        """Return a mask of points behind which the last scan's beams continue on either side; none where the base tilts it."""
        return np.zeros(points.shape[1:], np.bool_) if self._scan is None else super().passes(scan, points)

    def seen_behind(self, points: Float[Array, "k 2"]) -> Bool[Mask, "k"]:
        """Select the points [m] that a scan has seen free."""
        return self._frame.looks(points, np.full(len(points), np.inf)).free > 0

    @property
    def _frame(self) -> SensorFrame:
        return self._frames.of[self._name]

    def _foreground(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        if scan.stamp_ns != self._ns:
            self._ns, self._scan, self._mask = scan.stamp_ns, None, np.zeros(scan.ranges_m.size, np.bool_)
            if scan.ranges_m.size and not self._frames.is_tilted(scan):
                self._scan = self._frames.upright(scan)
                self._mask = self._of_legs(self._scan) if self._sees_legs else self._of_what_came(self._scan)
                self.origin_m = self._frame.pose[:2]
        return self._mask[::-1] if self._is_upside_down else self._mask

    def _of_legs(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Find the pose of an upright scan; select the samples of its legs that have come to their places."""
        sight = sight_legs(scan, self._frames, -np.inf, _ROOM_NATS, self.options.half_depth_m)
        legs = sight.legs.select(sight.evidence + came_nats(sight.frame, sight.places, scan.t) > _LEG_NATS)
        mask = np.zeros(scan.ranges_m.size, np.bool_)
        if len(legs):
            mask[own_samples(scan, legs)[0]] = True
        return mask

    def _of_what_came(self, scan: LaserScan) -> Bool[Mask, "n_beam"]:
        """Find the pose of an upright scan; select the samples of all that has come to its place."""
        ranges, hit, _ = returns(scan)
        frame, mask = self._frames.located(scan, np.ones(ranges.size, np.bool_)), np.zeros(ranges.size, np.bool_)
        beams = (hit & ~frame.own_parts(scan)).nonzero()[0]
        places = frame.placed(scan, (ranges[beams] * directions(scan)[:, beams]).T, beams.astype(float))
        mask[beams] = came_nats(frame, places, scan.t) > _CAME_NATS
        return mask

    def _in_room(self, points: Float[Array, "k 2"]) -> Float[Array, "k 2"]:
        """Return points of the last scan in the fixed frame, each from where the scanner was when it took them."""
        if self._scan is None:
            return np.full_like(points, np.nan)
        points = points @ self._room_from_scan
        middle = 0.5 * (self._scan.ranges_m.size - 1)
        ahead = self._scan.angle_min_rad + middle * self._scan.angle_increment_rad
        bearing = wrap_angle(np.arctan2(points[:, 1], points[:, 0]) - ahead)
        return self._frame.placed(self._scan, points, bearing / self._scan.angle_increment_rad + middle)

    def _as_scanned(self, points: Float[Array, "2 *n"]) -> Float[Array, "2 *n"]:
        return self._frame.seen_from(points.reshape(2, -1).T).T.reshape(points.shape)


def came_nats(frame: SensorFrame, places: Float[Array, "n 2"], t: float) -> Float[Array, "n"]:
    """Return the log-odds that what is at places [m] at a time [s] has come there, by the looks before (see module)."""
    looks = frame.looks(places, np.full(len(places), t - _BEFORE_S))
    return np.log((looks.free + 1) / (looks.hit + 1))


def frames_of(rig: Rig, names: Sequence[str]) -> RigFrames | None:
    """Return the frames of a rig's scanners of these names; None where all of them stand."""
    return RigFrames(rig, names, MatchingOptions()) if rig.mounted().keys() & names else None


def moving_layers(frames: RigFrames | None) -> MakeLayer | None:
    """Return a function that makes the layer of a scanner on a base; None where all scanners stand."""
    return None if frames is None else partial(MovingLayer, frames)


class FollowingTracker(SynchronizedTracker):
    """Base of trackers whose scanners may be on bases that move: odometry tells their poses, and where a scan is lost.

    frames: of the scanners, None where all of them stand; longest_s: time after the last scan for which frames of lost ones are
    given.
    """

    def __init__(self, rules: SyncPolicy, frames: RigFrames | None, report_in: ReportFrame, longest_s: float) -> None:
        super().__init__(rules)
        self.frames = frames
        self._report_in: ReportFrame = report_in
        self._clock = FrameClock(longest_s)
        self._stood_in_ns = 0  # stamp of the last frame that stood in for a lost scan's
        self._late_ns: set[int] = set()  # stamps of frames that came after all

    @property
    def bases(self) -> Collection[str]:
        """The bases whose odometry is used."""
        return () if self.frames is None else self.frames.bases

    @property
    def report_frame(self) -> str | None:
        """The frame that scan matching finds, or the scanner's, by its name, where tracks leave in that."""
        if self.frames is None or self._report_in == "rig":
            return None
        return self.frames.main if self._report_in == "sensor" else "matched"

    def reported(
        self, places: Float[Array, "n 2"], velocities: Float[Array, "n 2"], ns: int
    ) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"]]:
        """Return places and velocities of the fixed frame in that of the reports, as of a stamp [ns]."""
        if self.frames is None:
            return places, velocities
        return self.frames.reported(places, velocities, self._report_in, ns)

    def reported_detections(self, found: list[Detection]) -> list[Detection]:
        """Return detections in the fixed frame in that of the reports."""
        if self.frames is None or not found:
            return found
        places = np.array([(each.x, each.y) for each in found])
        places, _ = self.reported(places, np.zeros_like(places), found[-1].stamp_ns)
        return [replace(each, x=x, y=y) for each, (x, y) in zip(found, places.tolist(), strict=True)]

    @property
    def warnings(self) -> list[str]:
        """Scanners whose poses could not be found, or that were tilted, and how often."""
        return [] if self.frames is None else self.frames.warnings

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Process one observation; return the completed frames. Poses of bases are kept until scans ask for them."""
        if not isinstance(observation, Odometry):
            return self._processed(self._synchronizer.add(observation))
        if self.frames is None or not self.frames.add(observation):
            return self.on_time(self._work_all([]))
        stamps = self._clock.owed(observation.stamp_ns)
        self._stood_in_ns = stamps[-1] if stamps else self._stood_in_ns
        return self.on_time(self._work_all([SyncedFrame(ns) for ns in stamps]))

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames after the last observation."""
        return self._processed(self._synchronizer.finish())

    def on_time(self, frames: list[TrackFrame]) -> list[TrackFrame]:
        """Return the frames without those of scans that came after others had stood in for them."""
        late = self._late_ns & {each.stamp_ns for each in frames}
        self._late_ns -= late
        return [each for each in frames if each.stamp_ns not in late]

    def _processed(self, synced_frames: list[SyncedFrame]) -> list[TrackFrame]:
        worked = list(synced_frames)
        for k, each in enumerate(synced_frames):
            if not self._clock.take(each.ns):
                self._stood_in_ns = max(each.ns, self._stood_in_ns + 1)
                self._late_ns.add(self._stood_in_ns)
                worked[k] = replace(each, ns=self._stood_in_ns)
        return self.on_time(self._work_all(worked))
