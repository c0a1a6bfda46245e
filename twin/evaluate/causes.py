"""Errors by cause: misses, false positives, and long occlusions.

A miss is a person inside the area, in a judged frame, matched with no track (CLEAR correspondence). Its cause is the first
of: `unseen`, no sensor's ray reaches the body (every `visible_<sensor>` is 0), so that no tracker can know; `unused`, only
sensors see them that the tracker does not use; `start_up`, they were matched with no track yet since they entered the area;
else `seen`.

A false positive is a track matched with no person: a `double` within the gate of a person matched with another track; a
`ghost` while it coasts, `ghost_unseen` if the person it was matched with last is unseen then; else `clutter`.

Tracks that are near nobody have one cause: a table in another unit, frame or clock.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.observations import NS_PER_S
from twin.evaluate.clear import FrameMatches
from twin.evaluate.judged_frames import Frame
from twin.recording.tables import TruthTable

MISSES = ("unseen", "unused", "start_up", "seen")
FALSE_POSITIVES = ("ghost", "ghost_unseen", "double", "clutter")
POSTURES = ("upright", "low", "lying")

_LOW_SHARE = 0.8  # of a person's own greatest height of the pelvis: below, they sit, crouch or bend
_LYING_M = 0.3  # from pelvis to head, in height: below, they lie


@dataclass(frozen=True, eq=False)
class Errors:
    """The e misses and false positives of a run, by stamp."""

    stamps_ns: NDArray[np.int64]  # (e,)
    xy: NDArray[np.float64]  # (e, 2) the missed person, or the track [m]
    cause: NDArray[np.str_]  # (e,) one of MISSES or FALSE_POSITIVES
    posture: NDArray[np.str_]  # (e,) of the missed person, one of POSTURES; "" for a track

    def counts(self, *, sight: bool = True, status: bool = True) -> dict[str, Any]:
        """Count frames per kind and cause: `errors` of `metrics.json`.

        Without `sight` the truth lacks visibility, without `status` the tracks lack coasting: the causes that need it are
        None.
        """
        count: dict[str, int | None] = dict(Counter(self.cause.tolist()))
        if not sight:
            count |= dict.fromkeys(("unseen", "unused", "ghost_unseen"))
        if not status:
            count |= dict.fromkeys(("ghost", "ghost_unseen"))
        return {
            "missed": {cause: count.get(cause, 0) for cause in MISSES},
            "false_positive": {cause: count.get(cause, 0) for cause in FALSE_POSITIVES},
        }


def errors_by_cause(
    truth: TruthTable,
    judged: Sequence[Frame],
    matches: Sequence[FrameMatches],
    gate_m: float,
    unused: Collection[str] = (),
) -> Errors:
    """Find the cause of every error in frames inside the area, given their correspondence. `unused`: sensors the tracker
    does not use.
    """
    rows = _TruthRows(truth, unused)
    found: list[tuple[int, NDArray[np.float64], str, str]] = []
    followed: set[int] = set()  # matched since they entered the area
    last_person: dict[int, int] = {}
    for frame, pairs in zip(judged, matches, strict=True):
        people, tracks = frame.person_ids.tolist(), frame.track_ids.tolist()
        followed.intersection_update(people)
        for row, column in zip(pairs.rows.tolist(), pairs.columns.tolist(), strict=True):
            followed.add(people[row])
            last_person[tracks[column]] = people[row]
        for row in _others(len(people), pairs.rows):
            sight, posture = rows.at(people[row], frame.stamp_ns)
            started = "seen" if people[row] in followed else "start_up"
            found.append((frame.stamp_ns, frame.person_xy[row], started if sight == "seen" else sight, posture))
        for column in _others(len(tracks), pairs.columns):
            doubled = bool(frame.distances_m[:, column].min(initial=np.inf) <= gate_m)
            cause = "double" if doubled else "clutter"
            if not doubled and not frame.confirmed[column]:
                person = last_person.get(tracks[column])
                hidden = person is not None and rows.at(person, frame.stamp_ns)[0] == "unseen"
                cause = "ghost_unseen" if hidden else "ghost"
            found.append((frame.stamp_ns, frame.track_xy[column], cause, ""))
    stamps, places, causes, postures = zip(*found, strict=True) if found else ((), (), (), ())
    return Errors(
        np.array(stamps, dtype=np.int64),
        np.reshape(np.array(places, dtype=np.float64), (-1, 2)),
        np.array(causes, dtype=np.str_),
        np.array(postures, dtype=np.str_),
    )


def _others(count: int, paired: NDArray[np.intp]) -> list[int]:
    """List the places from 0 to `count` - 1 that are in no pair, ascending."""
    return sorted(set(range(count)).difference(paired.tolist())) if paired.size < count else []


class _TruthRows:
    """Visibility and posture of each person at any stamp, from the row nearest in time."""

    def __init__(self, truth: TruthTable, unused: Collection[str]) -> None:
        self._truth = truth
        self._rows = {int(person): np.flatnonzero(truth.id == person) for person in np.unique(truth.id)}
        self._highest_m = {person: float(truth.z[rows].max()) for person, rows in self._rows.items()}
        seen = {name: share > 0 for name, share in truth.visible.items()}
        nothing = np.zeros(truth.id.size, dtype=np.bool_) if seen else np.ones(truth.id.size, dtype=np.bool_)
        self._seen = np.logical_or.reduce([nothing, *seen.values()])
        self._seen_by_used = np.logical_or.reduce(
            [nothing, *(share for name, share in seen.items() if name not in unused)]
        )

    def at(self, person: int, stamp_ns: int) -> tuple[str, str]:
        """Look up visibility (`seen`, `unused` or `unseen`) and posture; a person whose truth has ended is unseen."""
        rows = self._rows[person]
        stamps = self._truth.stamps_ns[rows]
        after = min(int(np.searchsorted(stamps, stamp_ns)), rows.size - 1)
        before = max(after - 1, 0)
        nearest = rows[before if abs(stamps[before] - stamp_ns) < abs(stamps[after] - stamp_ns) else after]
        sight = "seen" if self._seen_by_used[nearest] else "unused" if self._seen[nearest] else "unseen"
        z, head_z = float(self._truth.z[nearest]), float(self._truth.head_z[nearest])
        if head_z - z < _LYING_M:
            return sight, "lying"
        return sight, "low" if z < _LOW_SHARE * self._highest_m[person] else "upright"


@dataclass(frozen=True)
class PersonOcclusion:
    """Time span in which no ray of the sensors reaches a person in the area [s]."""

    person_id: int
    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.end_s - self.start_s


def long_occlusions(truth: TruthTable, sensors: Sequence[str], longer_than_s: float) -> tuple[PersonOcclusion, ...]:
    """Find occlusions from all of these sensors at once that last longer than this, by start, then person.

    No tracker that coasts for less can bridge them. Hidden: `visible_<sensor>` is 0 for every one of them. Absence, or
    presence outside the area, ends an occlusion. Raises KeyError for a sensor that is not in the truth.
    """
    hidden = truth.in_area.copy()
    for sensor in sensors:
        hidden &= truth.visible[sensor] == 0
    frame = np.searchsorted(truth.frame_stamps_ns, truth.stamps_ns)
    found = []
    for person in np.unique(truth.id).tolist():
        frames = frame[hidden & (truth.id == person)]
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
            if run.size:
                start_s, end_s = (truth.frame_stamps_ns[run[[0, -1]]] / NS_PER_S).tolist()
                if end_s - start_s > longer_than_s:
                    found.append(PersonOcclusion(person, start_s, end_s))
    return tuple(sorted(found, key=lambda each: (each.start_s, each.person_id)))


_NEARLY_ALL, _EXPLAINED, _FEW, _LEAST_ROWS = 0.9, 0.5, 0.1, 10
"""Shares of tracks near people with which their stamps, and their places, are as they should be, the share with which they cannot
be, and the tracks needed to say so."""


def misplaced(judged: Sequence[Frame], gate_m: float, source: str) -> str:
    """Return a note where the tracks of the table `source` are near nobody, or where another unit or frame explains them better.

    Tried are other units of length, quarter turns and mirrored axes, another origin, and an offset between the clocks. Empty
    where the places are as they should be, or the tracks too few to say.
    """
    frames = [each for each in judged if each.person_ids.size and each.track_ids.size]
    if sum(each.track_ids.size for each in frames) < _LEAST_ROWS:
        return ""
    distance_m = _nearest_m(frames, lambda xy: xy)
    is_near = float((distance_m <= gate_m).mean())
    if is_near >= _NEARLY_ALL:
        return ""
    near, median_m = _near_later(frames, gate_m)
    is_late = median_m <= 0.5 * np.median(distance_m) and max(near.values()) >= (1 + is_near) / 2
    if is_near >= _EXPLAINED and not is_late:
        return ""
    people, tracks = (np.median(np.concatenate(places), axis=0) for places in _places(frames))
    changes: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
        "lengths in dm": lambda xy: xy / 10,
        "lengths in cm": lambda xy: xy / 100,
        "lengths in mm": lambda xy: xy / 1000,
        "x and y in each other's place": lambda xy: xy[:, ::-1],
        "x the other way round": lambda xy: xy * (-1, 1),
        "y the other way round": lambda xy: xy * (1, -1),
        "both axes the other way round": lambda xy: -xy,
        "a quarter turn to the left": lambda xy: xy[:, ::-1] * (-1, 1),
        "a quarter turn to the right": lambda xy: xy[:, ::-1] * (1, -1),
        "-y for x and -x for y": lambda xy: -xy[:, ::-1],
        f"an origin {np.hypot(*(tracks - people)):.3g} m away": lambda xy: xy - (tracks - people),
    }
    near |= {how: float((_nearest_m(frames, changed) <= gate_m).mean()) for how, changed in changes.items()}
    best = max(near, key=lambda how: near[how])  # the first of several: the time
    is_explained = is_late or near[best] >= max(_EXPLAINED, 2 * is_near)
    if not is_explained and is_near > _FEW:
        return ""
    text = f"{source}: {is_near:.0%} of {distance_m.size} tracks are within {gate_m:g} m of a person, "
    text += f"half of them farther than {np.median(distance_m):.3g} m"
    if is_explained:
        text += f"; {best} would bring {near[best]:.0%} there"
        if best.startswith("t "):
            return f"{text}; t on the clock of the truth is expected"
    return f"{text}; x and y in metres, in the frame of the truth, are expected"


_MOST_LATE_S, _SAMPLED = 3.0, 100
"""Greatest offset between the clocks of truth and tracks that is tried [s], and the frames that it is tried on."""


def _near_later(frames: Sequence[Frame], gate_m: float) -> tuple[dict[str, float], float]:
    """Return the share of tracks near people of other frames, by the change of t that brings most of them nearest.

    And their median distance then [m]; nothing and infinity where the frames are too few.
    """
    stamps_s = np.array([each.stamp_ns for each in frames]) / NS_PER_S
    period_s = float(np.median(np.diff(stamps_s))) if len(frames) > 1 else 0.0
    most = min(len(frames) // 2, int(_MOST_LATE_S / period_s)) if period_s else 0
    found: list[tuple[float, int, float]] = []
    for later in (*range(-most, 0), *range(1, most + 1)):
        first = np.arange(max(0, -later), len(frames) - max(0, later))
        first = first[:: -(-len(first) // _SAMPLED)]
        first = first[np.abs(stamps_s[first + later] - stamps_s[first] - later * period_s) < 0.5 * period_s]
        moved = [replace(frames[number], person_xy=frames[number + later].person_xy) for number in first]
        if sum(each.track_ids.size for each in moved) >= _LEAST_ROWS:
            distance_m = _nearest_m(moved, lambda xy: xy)
            found.append((float(np.median(distance_m)), later, float((distance_m <= gate_m).mean())))
    if not found:
        return {}, inf
    median_m, later, share = min(found)
    return {f"t of the tracks {abs(later) * period_s:.3g} s {'later' if later > 0 else 'earlier'}": share}, median_m


def _places(frames: Sequence[Frame]) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    return [each.person_xy for each in frames], [each.track_xy for each in frames]


def _nearest_m(
    frames: Sequence[Frame], changed: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the distance of each track, its place changed, from the nearest person [m]."""
    gaps = [each.person_xy[:, None] - changed(each.track_xy)[None] for each in frames]
    return np.concatenate([np.hypot(gap[..., 0], gap[..., 1]).min(axis=0) for gap in gaps])
