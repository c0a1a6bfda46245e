"""A tracker that starts anew where the clock of a recording was set, its ids going on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from trackers.detections import Detection
from trackers.observations import Observation
from trackers.tracks import Track, Tracker, TrackFrame, detections_of, discarded, finish_of, losses


class RestartedTracker:
    """A tracker until the first of `jumps_ns`, then one that `make` makes, and so on; it reports as the one at work does.

    At each stamp in `jumps_ns` [ns] the tracker hands out what it holds back and ends, as nothing it knows of people holds over
    a clock that was set. Ids are never used again: those of a new tracker go on behind the largest reported.
    """

    def __init__(self, first: Tracker, make: Callable[[], Tracker], jumps_ns: Iterable[int], main_sensor: str) -> None:
        self._tracker: Any = first
        self._make = make
        self._jumps_ns = sorted(jumps_ns)
        self._main_sensor = main_sensor
        self._ids_above = self._largest_id = 0
        self._losses_before: Counter[tuple[str, str]] = Counter()
        self._detections_before: list[Detection] = []  # of this call, by a tracker that ended in it

    def __getattr__(self, name: str) -> Any:
        """Return what else the tracker at work tells of itself (`trackers.tracks.Reporting`)."""
        told = getattr(self._tracker, name)
        return self._detections if name == "detections" else told

    @property
    def discarded(self) -> int:
        """Observations dropped so far, by all of them."""
        return self._losses_before.total() + discarded(self._tracker)

    @property
    def losses(self) -> Mapping[tuple[str, str], int]:
        """The same by sensor and reason."""
        return self._losses_before + Counter(losses(self._tracker))

    def update(self, observation: Observation) -> list[TrackFrame] | None:
        """Take one observation; the frames it completes, behind those that a tracker which ends here had held back."""
        self._detections_before = []
        ended: list[TrackFrame] = []
        while self._jumps_ns and observation.stamp_ns >= self._jumps_ns[0]:
            self._jumps_ns.pop(0)
            ended += self._held_back()
            self._detections_before += self._told_of()
            self._losses_before.update(losses(self._tracker))
            self._ids_above = self._largest_id
            self._tracker = self._make()
        frames = self._tracker.update(observation)
        if frames is not None:
            return ended + [self._renumbered(frame) for frame in frames]
        if ended and observation.sensor == self._main_sensor:
            return [*ended, TrackFrame(observation.stamp_ns, tuple(self.tracks()))]
        return ended or None

    def tracks(self) -> list[Track]:
        """Everybody that the tracker at work follows."""
        tracks = [replace(track, id=track.id + self._ids_above) for track in self._tracker.tracks()]
        self._largest_id = max([self._largest_id, *(track.id for track in tracks)])
        return tracks

    def finish(self) -> list[TrackFrame]:
        """The frames that the tracker at work still holds back."""
        self._detections_before = []
        return self._held_back()

    def _held_back(self) -> list[TrackFrame]:
        finish = finish_of(self._tracker)
        return [] if finish is None else [self._renumbered(frame) for frame in finish()]

    def _told_of(self) -> list[Detection]:
        told = detections_of(self._tracker)
        return [] if told is None else told()

    def _detections(self) -> list[Detection]:
        return self._detections_before + self._told_of()

    def _renumbered(self, frame: TrackFrame) -> TrackFrame:
        """Return a frame whose ids, those of its maps too, no tracker before has used."""
        tracks = tuple(replace(each, id=each.id + self._ids_above) for each in frame.tracks)
        maps = tuple(replace(each, id=each.id + self._ids_above) for each in frame.maps)
        self._largest_id = max([self._largest_id, *(each.id for each in tracks)])
        return replace(frame, tracks=tracks, maps=maps)
