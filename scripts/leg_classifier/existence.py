"""Tracks of drives in drawn rooms, with the truth about each: a person's or not. Taught is the existence of `laser-legs`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from leg_classifier.drives import ROBOTS, Sweep, drives
from numpy.typing import NDArray

from trackers.area import Pose
from trackers.arrays import Array
from trackers.filters.gating import distances, max_weight_assignment
from trackers.frames.scan_matching import compose, inverse, placed
from trackers.laser_legs.evidence import TRACK_FEATURES
from trackers.laser_legs.tracker import LaserLegs
from trackers.observations import NS_PER_S, Odometry
from trackers.rig import LaserSensor, OdometrySensor, Rig

_EVERY_S = 0.2
"""Time from scans whose tracks are taken to the next ones; those between are much the same."""
_ON_M = 0.45
_GATE_M = 0.5
_LEAST_BEAMS = 3


@dataclass(frozen=True, eq=False)
class TrackSamples:
    """k tracks at some scan: their features and whether they are a person's, each person having one."""

    features: Array
    is_person: NDArray[np.bool_]


def track_samples(seed: int) -> TrackSamples:
    """Track the drives in the room of a seed; tracks of people who are hardly met are left out, as they are not owed."""
    features, is_person = [np.empty((0, len(TRACK_FEATURES)))], [np.empty(0, np.bool_)]
    for robot in tracked(seed):
        next_ns = 0
        for sweep, tracker in robot:
            if sweep.scan.stamp_ns < next_ns or len(tracker.roster) == 0:
                continue
            next_ns = sweep.scan.stamp_ns + round(_EVERY_S * NS_PER_S)
            updated = len(tracker.features)
            found, is_owed = _of_people(in_room(tracker, sweep, tracker.places()[:updated]), sweep)
            features.append(tracker.features[is_owed])
            is_person.append(found[is_owed])
    return TrackSamples(np.concatenate(features), np.concatenate(is_person))


def tracked(
    seed: int,
    *,
    people: bool | None = None,
    is_driving: bool | None = None,
    rate_hz: float | None = None,
    **options: Any,
) -> Iterator[Iterator[tuple[Sweep, LaserLegs]]]:
    """Yield each robot's sweeps, and the tracker once it has taken them.

    Every other robot tells its odometry; by the rigs of the others the scanner stands where it begins.
    """
    every = drives(seed, people=people, is_driving=is_driving, rate_hz=rate_hz)
    for robot, sweeps in enumerate(every, start=ROBOTS * seed):
        has_odometry = robot % 2 == 0
        given: dict[str, Any] = {"report_in": "matched", **options}
        tracker = LaserLegs(_rig(sweeps[0].pose, has_odometry), **given)
        yield _taken(sweeps, tracker, has_odometry)


def _rig(pose: Array, has_odometry: bool) -> Rig:
    if has_odometry:
        scanner = LaserSensor(topic="/scan", mounted_on="base", room_from_sensor=Pose(xyz=(0, 0, 0.35)))
        return Rig(sensors={"base": OdometrySensor(topic="/odom"), "scan": scanner})
    x, y, yaw = (float(each) for each in pose)
    start = Pose(xyz=(x, y, 0.35), rpy=(0, 0, yaw))
    return Rig(sensors={"scan": LaserSensor(topic="/scan", room_from_sensor=start)})


def _taken(sweeps: list[Sweep], tracker: LaserLegs, has_odometry: bool) -> Iterator[tuple[Sweep, LaserLegs]]:
    for sweep in sweeps:
        if has_odometry:
            for t, x, y, yaw in sweep.odometry.tolist():
                pose = Pose(xyz=(x, y, 0), rpy=(0, 0, yaw % (2 * np.pi)))
                tracker.update(Odometry("base", round(t * NS_PER_S), pose.matrix))
        tracker.update(sweep.scan)
        yield sweep, tracker


def in_room(tracker: LaserLegs, sweep: Sweep, places: Array) -> Array:
    """Return places (n, 2) of the matched frame in the room's [m], by where the scanner truly is.

    What a tracker says is compared about the scanner, as labels of real recordings are: where a scan shows no walls, the
    matched frame cannot be known.
    """
    return placed(compose(sweep.pose, inverse(tracker.scanners.of["scan"].pose)), places)


@dataclass
class DriveCounts:
    """CLEAR counts of a drive: people that enough beams met, and of them the missed; false tracks, identity switches, scans."""

    people: int = 0
    misses: int = 0
    false: int = 0
    switches: int = 0
    scans: int = 0

    def add(self, other: DriveCounts) -> None:
        """Add those of another drive."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def counted(seed: int, *, people: bool, rate_hz: float | None = None) -> DriveCounts:
    """Count the errors of scanners that drive; gate 0.5 m, last scan's pairs are kept.

    A person that fewer than `_LEAST_BEAMS` beams meet is not owed, and a track of them is not false.
    """
    counts = DriveCounts()
    for robot in tracked(seed, people=people, is_driving=True, rate_hz=rate_hz):
        last: dict[int, int] = {}
        for sweep, tracker in robot:
            _count(counts, last, sweep, tracker)
    return counts


def _count(counts: DriveCounts, last: dict[int, int], sweep: Sweep, tracker: LaserLegs) -> None:
    """Add the errors of one sweep; last: the track that each person had."""
    tracks = tracker.tracks()
    places = in_room(tracker, sweep, np.array([[each.x, each.y] for each in tracks]).reshape(-1, 2))
    apart = distances(sweep.places, places)
    kept = np.array([[last.get(int(each)) == track.id for track in tracks] for each in sweep.ids]).reshape(apart.shape)
    person, track = max_weight_assignment(np.where(apart < _GATE_M, _GATE_M - apart + kept, 0.0))
    missed = sweep.beams >= _LEAST_BEAMS
    counts.people += int(missed.sum())
    missed[person] = False
    for one, other in zip(sweep.ids[person].tolist(), [tracks[k].id for k in track], strict=True):
        counts.switches += last.get(one, other) != other
        last[one] = other
    counts.misses += int(missed.sum())
    counts.false += len(tracks) - len(track)
    counts.scans += 1


def _of_people(places: Array, sweep: Sweep) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Select the tracks nearest to a person, one each; and those that are not such a track of a person hardly met."""
    found, is_owed = np.zeros(len(places), np.bool_), np.ones(len(places), np.bool_)
    if len(places) and len(sweep.places):
        apart = distances(places, sweep.places)
        nearest, near = apart.argmin(axis=0), apart.min(axis=0) < _ON_M
        owed = sweep.beams >= _LEAST_BEAMS
        found[nearest[near & owed]] = True
        is_owed[nearest[near & ~owed]] = False
    return found, is_owed | found
