"""Feeding of trackers: observations ordered by stamp, each once, and a new tracker after a clock was set."""

from __future__ import annotations

import reprlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from trackers.arrival_order import StampOrder
from trackers.errors import InputError
from trackers.observations import DepthImage, FloorFrame, Image, LaserScan, Observation, Odometry
from trackers.rig import Rig, RigSensor, check_arguments
from trackers.tracks import (
    Detection,
    Track,
    Tracker,
    TrackFrame,
    check_frame,
    detections_of,
    discarded,
    finish_of,
    listed,
    losses,
    takes_any_order,
    used_iterator,
    warn_user,
)

NOTED_LOSS = 0.02
"""Share of dropped observations above which a warning is due."""


class FedTracker:
    """Tracker with ordered input and checked frames.

    on_worked: called after each `update` and `finish` of the tracker, to read its report on that call.
    """

    def __init__(self, tracker: Tracker, rig: Rig, on_worked: Callable[[], object] = lambda: None) -> None:
        self.tracker = tracker
        self._main_sensor = rig.main_sensor
        self._order = None if takes_any_order(tracker) else StampOrder()
        self._on_worked = on_worked

    @property
    def discarded(self) -> int:
        """Observations dropped so far: too late, twice, or repeated."""
        late = self._order.discarded if self._order is not None else 0
        return late + discarded(self.tracker)

    @property
    def losses(self) -> Counter[tuple[str, str]]:
        """Dropped observations by sensor ('': unknown) and reason."""
        return Counter(self._order.losses if self._order is not None else {}) + Counter(losses(self.tracker))

    def update(self, observation: Observation) -> list[TrackFrame]:
        """Process one observation in order of arrival; return the completed frames, oldest first."""
        return self._frames([observation] if self._order is None else self._order.add(observation))

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames after the last observation."""
        frames = self._frames([] if self._order is None else self._order.finish())
        finish = finish_of(self.tracker)
        if finish is None:
            return frames
        last = finish()
        if not isinstance(last, list):
            raise TypeError(f"finish() gave {type(last).__name__}; a list of TrackFrame is expected")
        self._on_worked()
        return frames + last

    def _frames(self, observations: Iterable[Observation]) -> list[TrackFrame]:
        completed: list[TrackFrame] = []
        for observation in observations:
            frames = self.tracker.update(observation)
            self._on_worked()
            if frames is not None:
                completed += _frames_of(frames)
            elif observation.sensor == self._main_sensor:
                if not hasattr(self.tracker, "tracks"):
                    raise InputError("update() gave None; a list of TrackFrame, or a method tracks(), is expected")
                completed.append(TrackFrame(observation.stamp_ns, self._tracks()))
        return completed

    def _tracks(self) -> tuple[Track, ...]:
        """Return the tracker's tracks; raises InputError for anything else."""
        if not callable(self.tracker.tracks):
            raise InputError(
                f"tracks is {reprlib.repr(self.tracker.tracks)}; a method that returns a list of Track is expected"
            )
        tracks = self.tracker.tracks()
        if not isinstance(tracks, Iterable) or isinstance(tracks, Mapping):
            raise InputError(f"tracks() gave {reprlib.repr(tracks)}; a list of Track is expected")
        for each in (held := tuple(tracks)):
            if not isinstance(each, Track):
                raise InputError(f"tracks() gave {reprlib.repr(each)} among them; a list of Track is expected")
        return held


_CLASSES: dict[str, tuple[type, ...]] = {
    "laser": (LaserScan,),
    "fisheye": (Image,),
    "camera": (Image, DepthImage),
    "stereo": (DepthImage, Image),
    "floor": (FloorFrame,),
    "odometry": (Odometry,),
}
"""Observations of each kind of sensor."""


def _check_kind(observation: Observation, sensor: RigSensor) -> None:
    """Raise InputError for an observation of another kind than its sensor's."""
    if not isinstance(observation, valid := _CLASSES[sensor.kind]):
        raise InputError(
            f"{type(observation).__name__} of {observation.sensor!r}: sensors.{observation.sensor} of the rig is of kind "
            f"{sensor.kind}; {' or '.join(each.__name__ for each in valid)} is expected"
        )


def _frames_of(given: Iterable[TrackFrame]) -> list[TrackFrame]:
    """Return what update() gave as frames; raises InputError for anything else."""
    try:
        return listed(given, TrackFrame)
    except InputError as error:
        raise InputError(f"what update() gave: {error}") from error


def _checked(frames: list[TrackFrame]) -> list[TrackFrame]:
    for frame in frames:
        check_frame(frame)
    return frames


_FEW, _DENSEST_NS = 10, 200_000
"""Observations too few to judge their rate, and the mean time between two that no rig goes below: 5 kHz."""


def track_frames(
    tracker: Tracker,
    rig: Rig,
    observations: Iterable[Observation],
    on_warning: Callable[[str], object] = warn_user,
) -> Iterator[TrackFrame]:
    """Feed observations, in order of arrival, to a tracker and yield its frames as completed.

    Those of sensors that the rig does not have are left out. Warns (UserWarning, or `on_warning`) of them, and where more than
    2 % of the observations were dropped. Raises InputError for what is no observation, or does not fit its sensor.
    """
    check_arguments(rig, tracker=tracker, observations=observations)
    fed = FedTracker(tracker, rig)
    n_fed, unknown, span_ns = 0, Counter[str](), (0, 0)
    for observation in observations:
        if not isinstance(observation, Observation):
            raise InputError(
                f"observation {n_fed + unknown.total() + 1} is {reprlib.repr(observation)}; an object of a class of "
                "trackers.observations, like LaserScan, is expected"
            )
        if (sensor := rig.sensors.get(observation.sensor)) is None:
            unknown[observation.sensor] += 1
            continue
        _check_kind(observation, sensor)
        span_ns = (span_ns[0] if n_fed else observation.stamp_ns), observation.stamp_ns
        n_fed += 1
        yield from _checked(fed.update(observation))
    yield from _checked(fed.finish())
    if not n_fed + unknown.total() and isinstance(observations, Iterator):
        on_warning(used_iterator("observations"))
    if n_fed > _FEW and 0 < (gap_ns := (span_ns[1] - span_ns[0]) / n_fed) < _DENSEST_NS:
        on_warning(
            f"observations come every {gap_ns:.3g} ns on average; stamp_ns in nanoseconds, s * 10**9, is expected"
        )
    if unknown:
        of = ", ".join(f"{n} of {name!r}" for name, n in unknown.items())
        on_warning(
            f"{unknown.total()} of {n_fed + unknown.total()} observations were left out ({of}): the rig has no such sensor; its "
            f"sensors are {', '.join(rig.sensors)}"
        )
    if fed.losses.total() > NOTED_LOSS * n_fed:
        reasons = "; ".join(f"{sensor or 'unknown sensor'}: {n} {why}" for (sensor, why), n in fed.losses.items())
        on_warning(
            f"{fed.losses.total()} of {n_fed} observations were dropped ({reasons}); observations in order of arrival, and a "
            "new tracker for each run, are expected"
        )


class RestartedTracker:
    """Tracker that is replaced by a new one from `make` at each of `jumps_ns`, and reports as the current one.

    At each stamp in `jumps_ns` [ns] the tracker returns its remaining frames and ends, as its state is invalid after a clock
    was set. Ids are never reused: those of a new tracker follow the largest reported.
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
        """Return other attributes of the current tracker (`trackers.tracks.Reporting`)."""
        value = getattr(self._tracker, name)
        return self._detections if name == "detections" else value

    @property
    def discarded(self) -> int:
        """Observations dropped so far by all trackers."""
        return self._losses_before.total() + discarded(self._tracker)

    @property
    def losses(self) -> Mapping[tuple[str, str], int]:
        """Dropped observations by sensor and reason."""
        return self._losses_before + Counter(losses(self._tracker))

    def update(self, observation: Observation) -> list[TrackFrame] | None:
        """Process one observation; return the completed frames after the remaining ones of a tracker that ends here."""
        self._detections_before = []
        ended: list[TrackFrame] = []
        while self._jumps_ns and observation.stamp_ns >= self._jumps_ns[0]:
            self._jumps_ns.pop(0)
            ended += self._finished()
            self._detections_before += self._detected()
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
        """Return all tracks of the current tracker."""
        tracks = [replace(track, id=track.id + self._ids_above) for track in self._tracker.tracks()]
        self._largest_id = max([self._largest_id, *(track.id for track in tracks)])
        return tracks

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames of the current tracker."""
        self._detections_before = []
        return self._finished()

    def _finished(self) -> list[TrackFrame]:
        finish = finish_of(self._tracker)
        return [] if finish is None else [self._renumbered(frame) for frame in finish()]

    def _detected(self) -> list[Detection]:
        detections = detections_of(self._tracker)
        return [] if detections is None else detections()

    def _detections(self) -> list[Detection]:
        return self._detections_before + self._detected()

    def _renumbered(self, frame: TrackFrame) -> TrackFrame:
        """Return a frame with ids, also in its maps, that no earlier tracker has used."""
        tracks = tuple(replace(each, id=each.id + self._ids_above) for each in frame.tracks)
        maps = tuple(replace(each, id=each.id + self._ids_above) for each in frame.maps)
        self._largest_id = max([self._largest_id, *(each.id for each in tracks)])
        return replace(frame, tracks=tracks, maps=maps)
