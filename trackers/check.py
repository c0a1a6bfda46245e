"""Checks of the trackers' contract, for authors of plug-ins; recordings are replayed with every sensor fault."""

from __future__ import annotations

import copy
import itertools
import reprlib
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from math import isinf, isnan
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args

import numpy as np

from trackers.errors import PLUG_IN_ERRORS, InputError
from trackers.feeding import FedTracker
from trackers.observations import NS_PER_S, DepthImage, FloorFrame, Image, LaserScan, Observation
from trackers.rig import Rig
from trackers.tracks import Detection, Status, Track, Tracker, TrackFrame, detections_of, misreported

Make = Callable[[Rig, Iterable[Observation], np.random.Generator], Tracker]
Recording = list[Observation]
Corruption = Callable[[Recording], Recording]
Kind = TypeVar("Kind", bound=Observation)

_SEED = 0
_PLAIN, _SECOND = "plain run", "second run"
"""Runs without a fault of a sensor; faults of the first are not repeated for the others."""


class _Violation(NamedTuple):
    """A broken rule of the contract, and the first case of it, where there is one."""

    rule: str
    first: str = ""

    def __str__(self) -> str:
        return f"{self.rule}; the first: {self.first}" if self.first else self.rule


def check_tracker(
    make: Make, rig: Rig, observations: Sequence[Observation], background: Sequence[Observation] = ()
) -> list[str]:
    """Return one sentence per contract violation of trackers made by `make(rig, background, rng)` on a recording.

    observations: in order of arrival; a few seconds with people are best. Checked: the two calls; the same input gives the
    same tracks; inputs stay unchanged; stamps rise; ids are whole numbers, from 1 up, once per frame; x and y are numbers,
    and the rest numbers or NaN; valid status; the optional parts of `trackers.tracks.Reporting`, before and after a run;
    detections are of the rig's sensors; and the tracker survives every fault of `CORRUPTIONS`: observations that are late,
    repeated, missing or of a failing sensor. Repeated and late ones reach only a tracker with `takes_any_order`, as
    everywhere.
    """
    violations: list[str] = []
    of_plain: set[str] = set()

    def frames_of(what: str, fed: Iterable[Observation]) -> list[TrackFrame]:
        seen: list[Any] = []
        try:
            tracker = make(rig, background, np.random.default_rng(_SEED))
            at_work = FedTracker(tracker, rig, on_worked=lambda: seen.extend(_seen(tracker)))
            frames = [frame for observation in fed for frame in at_work.update(observation)] + at_work.finish()
            faults = [*_faults(frames), *_faults_of_seen(seen, rig), *map(_Violation, misreported(tracker, rig))]
        except PLUG_IN_ERRORS as error:  # whatever a plug-in raises is what its author wants to read
            violations.append(f"{what}: {raised(error)}")
            return []
        violations.extend(f"{what}: {fault}" for fault in faults if fault.rule not in of_plain)
        if what == _PLAIN:
            of_plain.update(fault.rule for fault in faults)
        return frames

    try:
        tracker = make(rig, background, np.random.default_rng(_SEED))
    except InputError:
        raise
    except PLUG_IN_ERRORS as error:
        return [f"its constructor {raised(error)}"]
    if not isinstance(tracker, Tracker):
        return [f"{type(tracker).__name__} has not both update(observation) and tracks()"]
    if faults := misreported(tracker, rig):
        return faults

    given = list(observations)
    before = copy.deepcopy([_arrays(item) for item in given])
    first = frames_of(_PLAIN, given)
    if violations and not first:
        return violations
    if not all(_same(_arrays(item), old) for item, old in zip(given, before, strict=True)):
        violations.append(f"{_PLAIN}: an observation's array was written to")
    if not violations and not any(frame.tracks for frame in first):
        violations.append(f"{_PLAIN}: nobody was ever tracked; a recording with people is needed to check the rest")
    if repr(frames_of(_SECOND, given)) != repr(first):
        violations.append(f"{_SECOND}: other tracks from the same observations and the same generator")
    for what, corrupted in _corrupted(given):
        frames_of(what, corrupted)
    return violations


def runs_of(observations: Sequence[Observation]) -> list[str]:
    """List the runs that `check_tracker` makes of a recording: plain, again, and with each fault that its sensors can have."""
    return [_PLAIN, _SECOND, *(what for what, _ in _corrupted(list(observations)))]


def _corrupted(given: Recording) -> Iterator[tuple[str, Recording]]:
    for what, corrupt in CORRUPTIONS.items():
        corrupted = corrupt(given)
        if not given or corrupted is not given:
            yield what, corrupted


def _first(rule: str, cases: Iterable[str]) -> list[_Violation]:
    """Return the fault of a rule that has any case; none without."""
    return [_Violation(rule, case) for case in itertools.islice(cases, 1)]


def raised(error: BaseException) -> str:
    """Return the error and the line of its author: the last outside of installed packages; a sentence of ours as it is."""
    if isinstance(error, InputError):
        return str(error)
    steps = traceback.extract_tb(error.__traceback__)
    own = [step for step in steps if "site-packages" not in step.filename] or steps
    where = "".join(f" ({Path(step.filename).name}, line {step.lineno})" for step in own[-1:])
    return f"raised {type(error).__name__}: {error}{where}"


def _faults(frames: Sequence[TrackFrame]) -> list[_Violation]:
    wrong = {type(frame).__name__ for frame in frames if not isinstance(frame, TrackFrame)}
    if wrong:
        return [_Violation(f"update or finish gave {', '.join(sorted(wrong))}; a list of TrackFrame is expected")]
    stamps = [frame.stamp_ns for frame in frames]
    if faults := _first("a stamp is not an int", (_shown(each) for each in stamps if not isinstance(each, int))):
        return faults
    pairs = itertools.pairwise(stamps)
    faults = _first(
        "stamps do not rise from frame to frame",
        (f"{later} ns after {earlier} ns" for earlier, later in pairs if later <= earlier),
    )
    tracks = [track for frame in frames for track in frame.tracks]
    if wrong := {type(track).__name__ for track in tracks if not isinstance(track, Track)}:
        return [
            *faults,
            _Violation(f"a track is of type {', '.join(sorted(wrong))}; trackers.tracks.Track is expected"),
        ]
    for name in _NUMBERS:
        values = [getattr(track, name) for track in tracks]
        if no_numbers := {type(each).__name__ for each in values if not isinstance(each, int | float | np.number)}:
            faults.append(
                _Violation(f"{name} of a track is of type {', '.join(sorted(no_numbers))}; a number is expected")
            )
    if faults:
        return faults
    ids = ((frame, [track.id for track in frame.tracks]) for frame in frames)
    twice = (f"{each} at {_seconds(frame)}" for frame, each in ids if len(set(each)) < len(each))
    return [*_first("an id stands twice in a frame", twice), *_faults_of_tracks(frames)]


def _faults_of_tracks(frames: Sequence[TrackFrame]) -> list[_Violation]:
    """Return a fault per rule that a track breaks, with the first one that does."""
    rules: dict[str, tuple[Sequence[str], Callable[[Any], bool]]] = {
        "an id is not an int from 1 up to 2**63 - 1": (["id"], lambda id_: type(id_) is int and 1 <= id_ < _IDS_END),
        "x or y is NaN": (["x", "y"], lambda value: not isnan(value)),
        "a track holds an infinite number": (_NUMBERS, lambda value: not isinf(value)),
        "a radius95_m is not above 0": (["radius95_m"], lambda radius_m: not radius_m <= 0),
        f"a status is none of {', '.join(get_args(Status))}": (["status"], lambda status: status in get_args(Status)),
    }
    faults = []
    for rule, (names, holds) in rules.items():
        cases = (
            f"{name}{'' if name == 'id' else f' of track {track.id}'} is {_shown(value)} at {_seconds(frame)}"
            for frame in frames
            for track in frame.tracks
            for name in names
            if not holds(value := getattr(track, name))
        )
        faults += _first(rule, cases)
    return faults


def _shown(value: object) -> str:
    return f"{reprlib.repr(value)} ({type(value).__name__})"


def _seconds(frame: TrackFrame) -> str:
    return f"{frame.stamp_ns / NS_PER_S:.3f} s"


def _seen(tracker: Tracker) -> list[Any]:
    detections = detections_of(tracker)
    seen: Any = detections() if detections is not None else []
    return seen if isinstance(seen, list) else [seen]


def _faults_of_seen(seen: Sequence[Any], rig: Rig) -> list[_Violation]:
    wrong = {type(each).__name__ for each in seen if not isinstance(each, Detection)}
    if wrong:
        return [_Violation(f"detections() gave {', '.join(sorted(wrong))}; a list of Detection is expected")]
    unknown = (each for each in seen if not each.sensors or not set(each.sensors) <= rig.sensors.keys())
    return [
        *_first(
            f"a detection is of no sensor of the rig ({', '.join(rig.sensors)})",
            (f"sensors is {reprlib.repr(each.sensors)}" for each in unknown),
        ),
        *_first(
            "a detection's x or y is NaN",
            (f"x {each.x}, y {each.y}" for each in seen if isnan(each.x) or isnan(each.y)),
        ),
    ]


_IDS_END = 2**63
_NUMBERS = [item.name for item in fields(Track) if item.name not in ("id", "status", "situation")]


def _arrays(observation: Observation) -> list[np.ndarray]:
    values: list[Any] = [getattr(observation, item.name) for item in fields(observation)]
    return [value for value in values if isinstance(value, np.ndarray)]


def _same(first: list[np.ndarray], second: list[np.ndarray]) -> bool:
    return all(one.tobytes() == other.tobytes() for one, other in zip(first, second, strict=True))


def _middle_third(kind: type[Kind] | tuple[type[Kind], ...], change: Callable[[Kind], Kind]) -> Corruption:
    """Corrupt the observations of a kind in the middle third; return the same recording without any."""

    def corrupt(recording: Recording) -> Recording:
        n = len(recording)
        corrupted = [
            change(item) if isinstance(item, kind) and n // 3 <= place < 2 * n // 3 else item  # type: ignore[arg-type]
            for place, item in enumerate(recording)
        ]
        return corrupted if any(new is not old for new, old in zip(corrupted, recording, strict=True)) else recording

    return corrupt


def _pictures(value: int) -> Corruption:
    """Make pictures uniformly grey, without depth: a covered lens, a blinding light."""

    def change(picture: Image | DepthImage) -> Image | DepthImage:
        grey = np.full_like(picture.rgb, value)
        if isinstance(picture, DepthImage):
            return replace(picture, rgb=grey, depth_m=np.zeros_like(picture.depth_m))
        return replace(picture, rgb=grey)

    return _middle_third((Image, DepthImage), change)


def _without_sensor(recording: Recording) -> Recording:
    """Silence the sensor that reports first, after a third."""
    if len({item.sensor for item in recording}) < 2:
        return recording
    silent, third = recording[0].sensor, len(recording) // 3
    return [item for place, item in enumerate(recording) if place < third or item.sensor != silent]


def _frozen(recording: Recording) -> Recording:
    """Repeat each sensor's last reading under new stamps from the middle on."""
    last: dict[str, Observation] = {}
    frozen = []
    for place, item in enumerate(recording):
        if place < len(recording) // 2 or item.sensor not in last:
            last[item.sensor] = item
        frozen.append(replace(last[item.sensor], stamp_ns=item.stamp_ns))
    return frozen


def _with_gap(recording: Recording) -> Recording:
    half = len(recording) // 2
    later = [replace(item, stamp_ns=item.stamp_ns + 3 * NS_PER_S) for item in recording[half:]]
    return [*recording[:half], *later]


def _with_late(recording: Recording) -> Recording:
    """Delay the observation at a third of the recording until after those of the next second."""
    if not recording:
        return recording
    fed = list(recording)
    late = fed.pop(len(fed) // 3)
    place = next((i for i, item in enumerate(fed) if item.stamp_ns >= late.stamp_ns + NS_PER_S), len(fed))
    return [*fed[:place], late, *fed[place:]]


def _ranges(value: float) -> Corruption:
    return _middle_third(LaserScan, lambda scan: replace(scan, ranges_m=np.full_like(scan.ranges_m, value)))


def _floor(change: Callable[[np.ndarray], np.ndarray]) -> Corruption:
    return _middle_third(FloorFrame, lambda frame: replace(frame, values=change(frame.values)))


def _stuck(values: np.ndarray) -> np.ndarray:
    stuck = values.copy()
    stuck[0, 0] = 200
    return stuck


CORRUPTIONS: Mapping[str, Corruption] = {
    "no observations": lambda recording: [],
    "scans that meet nothing": _ranges(np.inf),
    "scans without a reading": _ranges(np.nan),
    "black pictures": _pictures(0),
    "white pictures": _pictures(255),
    "pictures without depth": _middle_third(
        DepthImage, lambda picture: replace(picture, depth_m=np.zeros_like(picture.depth_m))
    ),
    "a depth of 1 mm throughout": _middle_third(
        DepthImage, lambda picture: replace(picture, depth_m=np.full_like(picture.depth_m, 0.001))
    ),
    "a floor that feels nothing": _floor(np.zeros_like),
    "a saturated floor": _floor(lambda values: np.full_like(values, 255)),
    "a stuck element of the floor": _floor(_stuck),
    "a sensor that falls silent": _without_sensor,
    "sensors that freeze": _frozen,
    "a gap of 3 s": _with_gap,
    "every observation twice": lambda recording: [item for item in recording for _ in range(2)],
    "an observation that comes a second late": _with_late,
}
"""Fault injection: by name, a function from a recording (in order of arrival) to one with the fault, or to the same
recording if no sensor can have it.
"""
