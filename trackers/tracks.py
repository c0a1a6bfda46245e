"""What a tracker reports, and the two calls that make something a tracker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import nan
from typing import Literal, Protocol, runtime_checkable

from trackers.observations import Observation
from trackers.rig import Rig

Status = Literal["confirmed", "coasting"]


@dataclass(frozen=True, slots=True)
class Track:
    """One person as a tracker sees them, in the room frame; NaN where the tracker does not estimate a quantity.

    x, y: ground point under the pelvis [m]; z: height of the pelvis [m]; vx, vy: velocity [m/s]; head_*: centre of
    the head [m] and its yaw [rad]; status: measured lately ("confirmed") or predicted only ("coasting").
    """

    id: int
    x: float
    y: float
    vx: float = nan
    vy: float = nan
    z: float = nan
    head_x: float = nan
    head_y: float = nan
    head_z: float = nan
    head_yaw: float = nan
    status: Status = "confirmed"


@dataclass(frozen=True, slots=True)
class TrackFrame:
    """All tracks at one stamp of the tracker's main sensor; an empty tuple says that nobody is tracked."""

    stamp_ns: int
    tracks: tuple[Track, ...]


@runtime_checkable
class Tracker(Protocol):
    """Takes observations in order of arrival and reports tracks.

    Built as `Class(rig, background, rng, **options)`: the rig, the observations of the empty room (may be none: then
    the tracker learns the background as it goes), a `numpy.random.Generator` of its own.

    `update` may return the frames that the observation completed, oldest first (a tracker that waits for several
    sensors of one moment completes a frame late), or None: then `tracks()` is read after each observation of
    the rig's main sensor. A tracker that holds frames back has `finish()`, which returns the rest.
    """

    def update(self, observation: Observation) -> list[TrackFrame] | None: ...

    def tracks(self) -> list[Track]: ...


def track_frames(tracker: Tracker, rig: Rig, observations: Iterable[Observation]) -> Iterator[TrackFrame]:
    """Feed observations to a tracker and yield its frames as they are completed."""
    for observation in observations:
        yield from update_frames(tracker, rig, observation)
    yield from finish_frames(tracker)


def update_frames(tracker: Tracker, rig: Rig, observation: Observation) -> list[TrackFrame]:
    """The frames that one observation completes."""
    frames = tracker.update(observation)
    if frames is not None:
        return frames
    if observation.sensor != rig.main_sensor:
        return []
    return [TrackFrame(observation.stamp_ns, tuple(tracker.tracks()))]


def finish_frames(tracker: Tracker) -> list[TrackFrame]:
    """The frames that a tracker still held back when the observations ended."""
    finish = getattr(tracker, "finish", None)
    return finish() if finish is not None else []
