"""Tracks: the output of trackers, the tracker interface of two calls, and its optional parts."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import isfinite, nan
from typing import Any, Literal, Protocol, TypeVar, get_args, runtime_checkable
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from trackers.cameras.placed import PlacedCamera
from trackers.errors import InputError
from trackers.observations import Observation
from trackers.rig import Rig

Status = Literal["confirmed", "coasting"]
_STATUSES = get_args(Status)
_NUMBERS = (int, float, np.integer, np.floating, np.ndarray)
_Frame = TypeVar("_Frame")


class NanEqual:
    """Base of a dataclass (`eq=False`) whose NaN fields mean "unknown": equal if all other fields are, with NaN in the same
    ones.

    NaN differs from itself; tuples, and so the comparisons of dataclasses before Python 3.13, hide that for the same object
    only.
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._known() == other._known()

    def __hash__(self) -> int:
        return hash((type(self), self._known()))

    def _known(self) -> tuple[object, ...]:
        """Return the fields in order, None for NaN."""
        values = (getattr(self, each.name) for each in fields(self))  # pyright: ignore[reportArgumentType]
        return tuple(None if isinstance(value, float) and value != value else value for value in values)


@dataclass(frozen=True, slots=True, eq=False)
class Track(NanEqual):
    """One tracked person, in the room frame; NaN for quantities not estimated.

    x, y: ground point under the pelvis [m]; z: height of the pelvis [m]; vx, vy: velocity [m/s]; head_*: centre of the head
    [m] and its yaw [rad]; status: measured lately ("confirmed") or only predicted ("coasting"); situation: relation to
    others in a word or two for the preview, if known; radius95_m: radius about (x, y) that holds the person with a
    probability of 95 % by the tracker's posterior [m].
    """

    id: int  # from 1 up, of one person as long as the tracker keeps them
    x: float  # ground point under the pelvis [m]
    y: float  # the same [m]
    vx: float = nan  # velocity [m/s]
    vy: float = nan  # the same [m/s]
    z: float = nan  # height of the pelvis [m]
    head_x: float = nan  # centre of the head [m]
    head_y: float = nan  # the same [m]
    head_z: float = nan  # its height [m]
    head_yaw: float = nan  # direction of the head, counter-clockwise from x [rad]
    status: Status = "confirmed"  # or "coasting": predicted without a measurement
    situation: str = ""  # relation to others, for the preview
    radius95_m: float = nan  # radius about (x, y) that holds the person with 95 % [m]

    def __post_init__(self) -> None:
        """Make an integer of numpy a plain one, which has no bounds and can be written as JSON."""
        if isinstance(self.id, np.integer):
            object.__setattr__(self, "id", int(self.id))


@dataclass(frozen=True, slots=True, eq=False)
class ScoreMap:
    """Map of the score of a person's position in a camera's picture, for the preview."""

    id: int  # of the track
    sensor: str  # the camera
    corner: tuple[int, int]  # column and row of the map's first pixel in the picture
    score: NDArray[np.floating]  # (height, width) ≥ 0
    patches: NDArray[np.floating]  # (k, 2) [px]: centres of the evaluated patches


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """Some hypotheses of the position of a person, or their head, for the preview.

    window: evaluated part of a camera's picture about their middle: left, top, width, height [px], None outside it.
    """

    id: int  # of the track
    places: NDArray[np.floating]  # (k, 3) [m]
    window: Callable[[PlacedCamera], tuple[float, float, float, float] | None] | None = None  # [px]


@dataclass(frozen=True, slots=True)
class Detection:
    """Detection of a person or a part of one, in the room frame; NaN for unknown values.

    stamp_ns: of the frame [ns]; sensors: those that detected it; role: what was detected ("waist": a trunk, "knee": legs);
    x, y: ground point [m]; variance_m2: of the position on each axis [m²]; width_m: measured width [m].
    """

    stamp_ns: int  # of the frame [ns]
    sensors: tuple[str, ...]  # those that detected it
    role: str  # "waist": a trunk, "knee": legs
    x: float  # ground point [m]
    y: float  # the same [m]
    variance_m2: float = nan  # of the position on each axis [m²]
    width_m: float = nan  # measured width [m]


@dataclass(frozen=True, slots=True)
class TrackFrame:
    """All tracks at one stamp at which the tracker reports; an empty tuple: none.

    maps: score maps and hypotheses, if provided.
    """

    stamp_ns: int  # [ns]
    tracks: tuple[Track, ...]  # one per person
    maps: tuple[ScoreMap | Hypotheses, ...] = field(default=(), compare=False)  # for the preview

    def __post_init__(self) -> None:
        """Make a stamp of numpy's integers a plain one, as `Track` does with its id, and any other iterable a tuple."""
        if isinstance(self.tracks, Iterable) and not isinstance(self.tracks, tuple):
            object.__setattr__(self, "tracks", tuple(self.tracks))
        if isinstance(self.stamp_ns, np.integer):
            object.__setattr__(self, "stamp_ns", int(self.stamp_ns))


@runtime_checkable
class Tracker(Protocol):
    """Tracker: takes observations in order of their stamps, each once, and reports tracks.

    Built as `Class(rig, background, rng, **options)`: the rig, the observations of the empty room (if empty, the tracker
    learns the background during the run), its own `numpy.random.Generator`. `background` is a `trackers.prior.Prior`: a
    sequence of those observations with the room's `environment`, or None.

    `update` may return the frames that the observation completed, oldest first (a tracker that waits for several sensors
    completes a frame late), or None: then `tracks()` is read after each observation of the rig's main sensor. Optional parts
    are in `Reporting`.
    """

    def update(self, observation: Observation) -> list[TrackFrame] | None: ...

    def tracks(self) -> list[Track]: ...


def listed(frames: Iterable[_Frame], kind: type[_Frame]) -> list[_Frame]:
    """Return frames as a list; raises InputError for objects of another class than `kind`.

    Warns (UserWarning) of an iterator that gives none, as one that is used up does.
    """
    if not isinstance(frames, Iterable):
        raise InputError(f"frames are {reprlib.repr(frames)}; an iterable of {kind.__name__} is expected")
    found = list(frames)
    if not found and isinstance(frames, Iterator):
        warn_user(used_iterator("frames"))
    for frame in found:
        if not isinstance(frame, kind):
            raise InputError(f"{reprlib.repr(frame)} is among the frames; an iterable of {kind.__name__} is expected")
    return found


def warn_user(warning: str) -> None:
    """Show a warning as Python does (UserWarning), at the line of the user's own code."""
    frame, level = sys._getframe(1), 2  # pyright: ignore[reportPrivateUsage]
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] in ("trackers", "twin"):
        frame, level = frame.f_back, level + 1
    warn(warning, stacklevel=level)


def used_iterator(of: str) -> str:
    """Format the warning that an iterator gave nothing, and why that may be."""
    return (
        f"no {of} came: an iterator gives what it has once; a new one, or a list of {of} for several uses, is expected"
    )


def check_frame(frame: TrackFrame) -> None:
    """Raise InputError for a frame whose stamp, or a track in it, is not as `Track` and `TrackFrame` describe."""
    where = f"frame at {frame.stamp_ns!r} ns"
    if not isinstance(frame.stamp_ns, int):
        raise InputError(f"{where}: the stamp of an observation, a whole number of ns, is expected")
    known: set[int] = set()
    for track in frame.tracks if isinstance(frame.tracks, tuple) else (frame.tracks,):
        if not isinstance(track, Track):
            raise InputError(f"{where}: {reprlib.repr(track)} is among its tracks; objects of Track are expected")
        if not (isinstance(track.id, int) and 1 <= track.id < 2**63):
            raise InputError(f"{where}: id {track.id!r}; a whole number from 1 to 2**63 - 1 is expected")
        if track.id in known:
            raise InputError(f"{where}: id {track.id} stands there twice; each id once is expected")
        known.add(track.id)
        if not all(isinstance(each, _NUMBERS) and np.ndim(each) == 0 and isfinite(each) for each in (track.x, track.y)):
            raise InputError(
                f"{where}: id {track.id} is at ({track.x!r}, {track.y!r}); finite numbers [m] are expected"
            )
        if track.status not in _STATUSES:
            valid = " or ".join(map(repr, _STATUSES))
            raise InputError(f"{where}: id {track.id} has the status {track.status!r}; {valid} is expected")


class Reporting(Protocol):
    """Optional parts of a tracker read by runs, replays and reports, each with a default.

    They are read only by the functions below; `misreported` lists invalid ones.
    """

    takes_any_order: bool
    """Observations are passed on as they arrive, including late and repeated ones. Default: no, they are sorted
    (`trackers.feeding`), each once.
    """

    @property
    def discarded(self) -> int:
        """Observations dropped by the tracker itself so far: too late, twice, or repeating the one before. Default: 0."""
        ...

    @property
    def losses(self) -> Mapping[tuple[str, str], int]:
        """`discarded` by sensor and reason, a clause like 'too late'. Default: all of them, of no particular sensor."""
        ...

    @property
    def unused_sensors(self) -> Sequence[str]:
        """Sensors of the rig that the tracker does not use, shown at a run. Default: none."""
        ...

    @property
    def warnings(self) -> Sequence[str]:
        """Warnings about missing or doubtful inputs, one clause each, shown at a run. Default: none."""
        ...

    @property
    def background_learned_causally(self) -> bool:
        """The background is learned from the observations of the run, without an empty room. Default: no."""
        ...

    @property
    def report_frame(self) -> str | None:
        """Name of the frame of the tracks, where it is not the one of the rig's poses. Default: that one."""
        ...

    def finish(self) -> list[TrackFrame]:
        """Return the remaining frames after the last observation. Default: none."""
        ...

    def detections(self) -> list[Detection]:
        """Return the detections in the frames of the last `update` or `finish`, oldest first. Default: none."""
        ...


def takes_any_order(tracker: Tracker) -> bool:
    """Return whether the tracker takes observations as they arrive."""
    return getattr(tracker, "takes_any_order", False)


def discarded(tracker: Tracker) -> int:
    """Return the number of observations dropped by the tracker itself."""
    return getattr(tracker, "discarded", 0)


def losses(tracker: Tracker) -> Mapping[tuple[str, str], int]:
    """Return the observations dropped by the tracker itself, by sensor ('': unknown) and reason."""
    counted: Mapping[tuple[str, str], int] | None = getattr(tracker, "losses", None)
    if counted is not None:
        return counted
    count = discarded(tracker)
    return {("", "dropped by the tracker"): count} if count else {}


def unused_sensors(tracker: Tracker) -> Sequence[str]:
    """Return the sensors that the tracker does not use."""
    return getattr(tracker, "unused_sensors", ())


def warnings(tracker: Tracker) -> Sequence[str]:
    """Return the tracker's warnings."""
    return getattr(tracker, "warnings", ())


def background_learned_causally(tracker: Tracker) -> bool:
    """Return whether the tracker learns the background during the run."""
    return getattr(tracker, "background_learned_causally", False)


def report_frame(tracker: Tracker) -> str | None:
    """Return the frame of the tracks; None for the one of the rig's poses."""
    return getattr(tracker, "report_frame", None)


def finish_of(tracker: Tracker) -> Callable[[], list[TrackFrame]] | None:
    """Return the method that yields the remaining frames; None if the tracker has none."""
    return getattr(tracker, "finish", None)


def detections_of(tracker: Tracker) -> Callable[[], list[Detection]] | None:
    """Return the method that yields the detections; None if the tracker has none."""
    return getattr(tracker, "detections", None)


def misreported(tracker: Tracker, rig: Rig) -> list[str]:
    """Return one sentence per invalid part of `Reporting` of the tracker."""
    count, unused = discarded(tracker), unused_sensors(tracker)
    listed = isinstance(unused, list | tuple) and all(isinstance(name, str) and name in rig.sensors for name in unused)
    yes_or_no = "True or False is expected"
    parts: list[tuple[str, Any, bool, str]] = [
        ("takes_any_order", order := takes_any_order(tracker), isinstance(order, bool), yes_or_no),
        ("losses", lost := getattr(tracker, "losses", {}), _is_count_by_reason(lost), _BY_REASON),
        ("discarded", count, type(count) is int and count >= 0, "an int from 0 up is expected"),
        ("unused_sensors", unused, listed, f"a list of the rig's sensors ({', '.join(rig.sensors)}) is expected"),
        (
            "warnings",
            doubtful := warnings(tracker),
            isinstance(doubtful, list | tuple) and all(isinstance(each, str) for each in doubtful),
            "a list of words is expected",
        ),
        (
            "background_learned_causally",
            known := background_learned_causally(tracker),
            isinstance(known, bool),
            yes_or_no,
        ),
        ("report_frame", frame := report_frame(tracker), isinstance(frame, str | None), "a text or None is expected"),
        ("finish", end := finish_of(tracker), end is None or callable(end), "a method is expected"),
        ("detections", seen := detections_of(tracker), seen is None or callable(seen), "a method is expected"),
    ]
    return [f"{name} is {value!r}; {expected}" for name, value, is_right, expected in parts if not is_right]


_BY_REASON = "a mapping from (sensor, reason) to an int from 0 up is expected"


def _is_count_by_reason(counted: object) -> bool:
    return isinstance(counted, Mapping) and all(
        isinstance(key, tuple) and len(key) == 2 and all(isinstance(part, str) for part in key) and type(n) is int
        for key, n in counted.items()
    )
