"""Checks of the trackers' contract, for authors of plug-ins; recordings are replayed with every sensor fault."""

from __future__ import annotations

import copy
import itertools
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from math import isinf, isnan
from pathlib import Path
from typing import Any, TypeVar, get_args

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
_PLAIN = "plain run"
"""Run whose faults are not repeated for the runs with a fault of a sensor."""


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

    def frames_of(what: str, fed: Iterable[Observation]) -> list[TrackFrame]:
        seen: list[Any] = []
        try:
            tracker = make(rig, background, np.random.default_rng(_SEED))
            at_work = FedTracker(tracker, rig, on_worked=lambda: seen.extend(_seen(tracker)))
            frames = [frame for observation in fed for frame in at_work.update(observation)] + at_work.finish()
            faults = [*_faults(frames), *_faults_of_seen(seen, rig), *misreported(tracker, rig)]
        except PLUG_IN_ERRORS as error:  # whatever a plug-in raises is what its author wants to read
            violations.append(f"{what}: {raised(error)}")
            return []
        violations.extend(f"{what}: {fault}" for fault in faults if f"{_PLAIN}: {fault}" not in violations)
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
    if repr(frames_of("second run", given)) != repr(first):
        violations.append("second run: other tracks from the same observations and the same generator")
    for what, corrupt in CORRUPTIONS.items():
        corrupted = corrupt(given)
        if not given or corrupted is not given:
            frames_of(what, corrupted)
    return violations


def raised(error: BaseException) -> str:
    """Return the error and the line of its author: the last outside of installed packages; a sentence of ours as it is."""
    if isinstance(error, InputError):
        return str(error)
    steps = traceback.extract_tb(error.__traceback__)
    own = [step for step in steps if "site-packages" not in step.filename] or steps
    where = "".join(f" ({Path(step.filename).name}, line {step.lineno})" for step in own[-1:])
    return f"raised {type(error).__name__}: {error}{where}"


def _faults(frames: Sequence[TrackFrame]) -> list[str]:
    wrong = {type(frame).__name__ for frame in frames if not isinstance(frame, TrackFrame)}
    if wrong:
        return [f"update or finish gave {', '.join(sorted(wrong))}; a list of TrackFrame is expected"]
    faults = []
    stamps = [frame.stamp_ns for frame in frames]
    if any(later <= earlier for earlier, later in itertools.pairwise(stamps)):
        faults.append("stamps do not rise from frame to frame")
    if any(not isinstance(stamp, int) for stamp in stamps):
        faults.append("a stamp is not an int")
    tracks = [track for frame in frames for track in frame.tracks]
    if wrong := {type(track).__name__ for track in tracks if not isinstance(track, Track)}:
        return [*faults, f"a track is of type {', '.join(sorted(wrong))}; trackers.tracks.Track is expected"]
    for name in _NUMBERS:
        values = [getattr(track, name) for track in tracks]
        if no_numbers := {type(each).__name__ for each in values if not isinstance(each, int | float | np.number)}:
            faults.append(f"{name} of a track is of type {', '.join(sorted(no_numbers))}; a number is expected")
    if faults:
        return faults
    if any(type(track.id) is not int or not 1 <= track.id < _IDS_END for track in tracks):
        faults.append("an id is not an int from 1 up to 2**63 - 1")
    if any(len({track.id for track in frame.tracks}) < len(frame.tracks) for frame in frames):
        faults.append("an id stands twice in a frame")
    if any(isnan(track.x) or isnan(track.y) for track in tracks):
        faults.append("x or y is NaN")
    if any(isinf(value) for track in tracks for value in _numbers(track)):
        faults.append("a track holds an infinite number")
    if any(track.radius95_m <= 0 for track in tracks):
        faults.append("a radius95_m is not above 0")
    if any(track.status not in get_args(Status) for track in tracks):
        faults.append(f"a status is none of {', '.join(get_args(Status))}")
    return faults


def _seen(tracker: Tracker) -> list[Any]:
    detections = detections_of(tracker)
    seen: Any = detections() if detections is not None else []
    return seen if isinstance(seen, list) else [seen]


def _faults_of_seen(seen: Sequence[Any], rig: Rig) -> list[str]:
    wrong = {type(each).__name__ for each in seen if not isinstance(each, Detection)}
    if wrong:
        return [f"detections() gave {', '.join(sorted(wrong))}; a list of Detection is expected"]
    faults = []
    if any(not each.sensors or not set(each.sensors) <= rig.sensors.keys() for each in seen):
        faults.append("a detection is of no sensor of the rig")
    if any(isnan(each.x) or isnan(each.y) for each in seen):
        faults.append("a detection's x or y is NaN")
    return faults


_IDS_END = 2**63
_NUMBERS = [item.name for item in fields(Track) if item.name not in ("id", "status", "situation")]


def _numbers(track: Track) -> list[float]:
    return [getattr(track, name) for name in _NUMBERS]


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
