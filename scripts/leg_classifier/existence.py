"""Tracks of drives in drawn rooms, with the truth about each: a person's or not. Taught is the existence of `laser-legs`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from leg_classifier.drives import Drive, drives
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.filters.gating import distances, max_weight_assignment
from trackers.laser_legs.evidence import TRACK_FEATURES
from trackers.laser_legs.tracker import LaserLegs
from trackers.pose import Pose
from trackers.rig import LaserSensor, Rig

_EVERY = 2
"""Scans of which the tracks of one are taken; those between are much the same."""
_ON_M = 0.45
_GATE_M = 0.5
_LEAST_BEAMS = 3
_EMPTY_SHARE = 0.25
"""Share of drives where there is no person."""


@dataclass(frozen=True, eq=False)
class TrackSamples:
    """k tracks at some scan: their features and whether they are a person's, each person having one."""

    features: Array
    is_person: NDArray[np.bool_]


def track_samples(seed: int) -> TrackSamples:
    """Track the drive of a seed; every fourth has no people."""
    features, is_person = [np.empty((0, len(TRACK_FEATURES)))], [np.empty(0, np.bool_)]
    for place, (drive, tracker) in enumerate(tracked(seed, people=seed % round(1 / _EMPTY_SHARE) != 0)):
        if place % _EVERY or len(tracker.roster) == 0:
            continue
        updated = len(tracker.features)
        places = tracker.places()[:updated]
        features.append(tracker.features[:updated])
        is_person.append(_of_people(places, drive))
    return TrackSamples(np.concatenate(features), np.concatenate(is_person))


def tracked(
    seed: int, *, people: bool = True, is_driving: bool | None = None, **options: Any
) -> Iterator[tuple[Drive, LaserLegs]]:
    """Yield every sweep of a drive, and the tracker once it has taken it; by its rig the scanner stands where it begins."""
    tracker = None
    for drive in drives(seed, people=people, is_driving=is_driving):
        if tracker is None:
            x, y, yaw = (float(each) for each in drive.pose)
            sensor = LaserSensor(topic="/scan", room_from_sensor=Pose(xyz=(x, y, 0.35), rpy=(0, 0, yaw)))
            tracker = LaserLegs(Rig(sensors={"scan": sensor}), **{"report_in": "matched"} | options)
        tracker.update(drive.scan)
        yield drive, tracker


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


def counted(seed: int, *, people: bool) -> DriveCounts:
    """Count the errors of a scanner that drives, with its own poses alone; gate 0.5 m, last scan's pairs are kept.

    A person that fewer than `_LEAST_BEAMS` beams meet is not owed, and a track of them is not false.
    """
    counts, last = DriveCounts(), dict[int, int]()
    for drive, tracker in tracked(seed, people=people, is_driving=True):
        tracks = tracker.tracks()
        apart = distances(drive.places, np.array([[each.x, each.y] for each in tracks]).reshape(-1, 2))
        kept = np.array([[last.get(int(each)) == track.id for track in tracks] for each in drive.ids]).reshape(
            apart.shape
        )
        person, track = max_weight_assignment(np.where(apart < _GATE_M, _GATE_M - apart + kept, 0.0))
        missed = drive.beams >= _LEAST_BEAMS
        counts.people += int(missed.sum())
        missed[person] = False
        for one, other in zip(drive.ids[person].tolist(), [tracks[k].id for k in track], strict=True):
            counts.switches += last.get(one, other) != other
            last[one] = other
        counts.misses += int(missed.sum())
        counts.false += len(tracks) - len(track)
        counts.scans += 1
    return counts


def _of_people(places: Array, drive: Drive) -> NDArray[np.bool_]:
    """Select the tracks nearest to a person, one each."""
    found = np.zeros(len(places), np.bool_)
    if len(places) and len(drive.places):
        apart = distances(places, drive.places)
        nearest = apart.argmin(axis=0)
        found[nearest[apart.min(axis=0) < _ON_M]] = True
    return found
