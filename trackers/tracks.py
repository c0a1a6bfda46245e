"""What a tracker reports, and the two calls that make something a tracker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import nan
from typing import Literal, Protocol, runtime_checkable

from trackers.observations import Observation
from trackers.order import StampOrder
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
    """Takes observations in order of their stamps, each once, and reports tracks.

    Built as `Class(rig, background, rng, **options)`: the rig, the observations of the empty room (may be none: then
    the tracker learns the background as it goes), a `numpy.random.Generator` of its own. `background` is a
    `trackers.knowledge.Knowledge`: a sequence of those observations that has the room's `environment`, or None, beside.

    `update` may return the frames that the observation completed, oldest first (a tracker that waits for several
    sensors of one moment completes a frame late), or None: then `tracks()` is read after each observation of
    the rig's main sensor. A tracker that holds frames back has `finish()`, which returns the rest.

    Who feeds a tracker holds observations back into order (`trackers.order`). One with `takes_any_order = True` gets them
    as they arrive, late ones and doubles among them, and counts what it drops in `discarded`. One that leaves sensors of the rig
    alone may name them in `unused_sensors`: whoever starts a run is told.
    """

    def update(self, observation: Observation) -> list[TrackFrame] | None: ...

    def tracks(self) -> list[Track]: ...


class FedTracker:
    """A tracker and what stands between it and the observations: their order, and the reading of its frames."""

    def __init__(self, tracker: Tracker, rig: Rig) -> None:
        self.tracker = tracker
        self._main_sensor = rig.main_sensor
        self._order = None if getattr(tracker, "takes_any_order", False) else StampOrder()

    @property
    def discarded(self) -> int:
        """Observations dropped so far because they came too late or twice."""
        held_back = self._order.discarded if self._order is not None else 0
        return held_back + getattr(self.tracker, "discarded", 0)

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Take one observation in order of arrival; the frames that are complete with it, oldest first."""
        return self._frames([observation] if self._order is None else self._order.add(observation))

    def finish(self) -> list[TrackFrame]:
        """The frames still to come when the observations have ended."""
        frames = self._frames([] if self._order is None else self._order.finish())
        finish = getattr(self.tracker, "finish", None)
        return frames + (finish() if finish is not None else [])

    def _frames(self, observations: Iterable[Observation]) -> list[TrackFrame]:
        completed: list[TrackFrame] = []
        for observation in observations:
            frames = self.tracker.update(observation)
            if frames is not None:
                completed += frames
            elif observation.sensor == self._main_sensor:
                completed.append(TrackFrame(observation.stamp_ns, tuple(self.tracker.tracks())))
        return completed


def track_frames(tracker: Tracker, rig: Rig, observations: Iterable[Observation]) -> Iterator[TrackFrame]:
    """Feed observations, in order of arrival, to a tracker and yield its frames as they are completed."""
    fed = FedTracker(tracker, rig)
    for observation in observations:
        yield from fed.update(observation)
    yield from fed.finish()
