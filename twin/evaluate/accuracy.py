"""Accuracy: the share of person-frames in which nothing failed, by kind of failure.

The kinds are those of Song et al. (laser and vision by on-line learning): target missed, false location, identity switch.
A person-frame is a person inside the tracked area in a judged frame. In it

- the identity is wrong while the nearest track within the gate belongs to another person. A track belongs to the person it
  was confirmed on for as long as it lives: the one it is matched with (CLEAR correspondence, people outside the area too) in
  its first confirmed frame, or, where it has no match there, in the first later one that has. So after a swap both people
  are wrong until the tracks end or swap back. A further track that is confirmed on a person counts once, in the first frame
  in which it is the nearest to them: a switch. Of tracks at the same place, as a tracker reports people that it follows as
  one target, the person's own is the nearest;
- the person is missed where no track at all is within the gate, unless a track of theirs is counted as a false location.

A false location is a track within the gate of no person, inside the area or outside.

Calibration of stated radii: how often a person is within the radius that a tracker states for 95 %. A track's person is its
match (CLEAR correspondence). Remaining tracks get the nearest remaining people by optimal assignment without a gate, so that
a person beyond the gate but within a wide radius counts as within it; a track without a remaining person has it nowhere. For
other probabilities the radius is that of a circular normal distribution, whose distance from the centre has the distribution
function F(d) = 1 − exp(−d² / 2σ²): r(p) = r₉₅ √(ln(1 − p) / ln 0.05). A tracker is calibrated if the share found within r(p)
is p (A. P. Dawid, "The well-calibrated Bayesian", J. American Statistical Association 77, 1982).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.filters.gating import global_nearest_neighbour
from trackers.observations import NS_PER_S
from twin.evaluate.clear import FrameMatches
from twin.evaluate.judged_frames import Frame
from twin.recording.situation_table import SituationTable

NO_ID = -1
"""Fill value for ids, and the owner of a track that belongs to no person."""


@dataclass(frozen=True, eq=False)
class PersonFrames:
    """Judgement of p people in f judged frames."""

    person_ids: NDArray[np.int64]  # (p,) ascending
    judged: NDArray[np.bool_]  # (p, f) present and inside the area
    missed: NDArray[np.bool_]  # (p, f)
    wrong: NDArray[np.bool_]  # (p, f) identity wrong, switches included
    astray: NDArray[np.bool_]  # (p, f) no track near them, and one of theirs near no person
    false_locations: NDArray[np.int64]  # (f,)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Person-frames without a failure, (p, f)."""
        return self.judged & ~(self.missed | self.wrong | self.astray)

    @property
    def failures(self) -> NDArray[np.int64]:
        """Failures of all kinds in each frame, (f,)."""
        return (self.missed | self.wrong).sum(axis=0) + self.false_locations

    def metrics(self) -> dict[str, Any]:
        """Compute `accuracy` and `failures` of `metrics.json`; accuracy is None without a person-frame."""
        count = int(self.judged.sum())
        return {
            "accuracy": 1.0 - int(self.failures.sum()) / count if count else None,
            "failures": {
                "person_frames": count,
                "missed": int(self.missed.sum()),
                "false_location": int(self.false_locations.sum()),
                "identity_wrong": int(self.wrong.sum()),
            },
        }


def person_frames(frames: Sequence[Frame], matches: Sequence[FrameMatches], gate_m: float) -> PersonFrames:
    """Judge every person in every frame; `matches`: correspondence at the same gate of people inside the area and outside."""
    person_id, there = _padded([frame.person_ids for frame in frames], NO_ID)  # (f, n): n slots per frame
    track_id, _ = _padded([frame.track_ids for frame in frames], NO_ID)  # (f, m)
    person_xy, _ = _padded([frame.person_xy for frame in frames], np.nan)
    track_xy, _ = _padded([frame.track_xy for frame in frames], np.nan)
    inside, _ = _padded([frame.in_area for frame in frames], False)
    gap = person_xy[:, :, None] - track_xy[:, None]
    distance = np.hypot(gap[..., 0], gap[..., 1])  # (f, n, m)
    near = distance <= gate_m  # NaN is near no person
    owner = _owners(frames, matches, track_id)  # (f, m)
    followed = near.any(axis=2)
    nearest = _nearest(np.where(near, distance, np.inf), owner[:, None] == person_id[..., None])
    track, of = (np.where(followed, _pick(each, nearest), NO_ID) for each in (track_id, owner))
    own = of == person_id
    wrong = followed & ~own & (of != NO_ID)
    wrong |= _switches(person_id, track, followed & own)
    nowhere = (track_id != NO_ID) & ~near.any(axis=1)
    theirs = (owner[:, None] == person_id[..., None]) & nowhere[:, None]
    astray = ~followed & theirs.any(axis=2)
    ids = np.unique(person_id[there])
    row, column = np.searchsorted(ids, person_id[there]), np.nonzero(there)[0]

    def by_person(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        spread = np.zeros((ids.size, len(frames)), dtype=np.bool_)
        spread[row, column] = (flags & inside)[there]
        return spread

    return PersonFrames(
        person_ids=ids,
        judged=by_person(there),
        missed=by_person(~followed & ~astray),
        wrong=by_person(wrong),
        astray=by_person(astray),
        false_locations=nowhere.sum(axis=1),
    )


def _padded(rows: Sequence[NDArray[Any]], fill: float) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Pad f rows (n_i, ...) to one array (f, n, ...) of the longest; return it and its filled slots (f, n)."""
    count = np.array([len(row) for row in rows], dtype=np.intp)
    theirs = np.arange(count.max(initial=0)) < count[:, None]
    whole = np.full((*theirs.shape, *rows[0].shape[1:]), fill, dtype=rows[0].dtype)
    whole[theirs] = np.concatenate(rows)
    return whole, theirs


def _nearest(distance: NDArray[np.float64], own: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Find each person's nearest track (f, n) by distances (f, n, m); of several at one place an own one."""
    if not distance.size:
        return np.zeros(distance.shape[:2], dtype=np.intp)
    at_place = distance == distance.min(axis=2, keepdims=True)
    own = own & at_place
    return np.where(own.any(axis=2), own.argmax(axis=2), at_place.argmax(axis=2))


def _pick(of_track: NDArray[np.int64], which: NDArray[np.intp]) -> NDArray[np.int64]:
    """Index `of_track` (f, m) with each person's track `which` (f, n)."""
    if not of_track.size:
        return np.full(which.shape, NO_ID, dtype=np.int64)
    return np.take_along_axis(of_track, which, axis=1)


def _owners(frames: Sequence[Frame], matches: Sequence[FrameMatches], track_id: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the person each track (f, m) belongs to; NO_ID for tracks never matched while confirmed."""
    pairs = [
        np.stack([frame.track_ids[found.columns], frame.person_ids[found.rows]])[:, frame.confirmed[found.columns]]
        for frame, found in zip(frames, matches, strict=True)
    ]
    tracks, persons = np.concatenate(pairs, axis=1)
    known, first = np.unique(tracks, return_index=True)
    if not known.size:
        return np.full(track_id.shape, NO_ID, dtype=np.int64)
    place = np.minimum(np.searchsorted(known, track_id), known.size - 1)
    return np.where(known[place] == track_id, persons[first][place], NO_ID)


def _switches(person_id: NDArray[np.int64], track_id: NDArray[np.int64], own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask (f, n) of the first frame of each own track of a person except their first; `track_id`: their nearest."""
    switched = np.zeros(own.shape, dtype=np.bool_)
    places = np.flatnonzero(own)  # in order of time
    pairs = np.stack([person_id.ravel()[places], track_id.ravel()[places]])
    _, first = np.unique(pairs, axis=1, return_index=True)
    first = np.sort(first)
    _, earliest = np.unique(pairs[0, first], return_index=True)
    switched.ravel()[places[np.delete(first, earliest)]] = True
    return switched


AFTER_S = 1.0


def disposal(people: PersonFrames, stamps_ns: NDArray[np.int64], situations: SituationTable) -> dict[str, Any]:
    """Compute `disposal` of `metrics.json`: per kind of challenging situation its count and the share disposed of (None
    without any).

    After Song et al., table I. Correlated: counted per pair and frame, disposed of if both people are right in that frame.
    Merge/split: counted per merge for the rig whose end, and the second after it, are in the run; disposed of if both people
    are right from its start to `AFTER_S` after its end. Identity after: of the merges whose people are both judged in the
    first frame from `AFTER_S` after their end on, the share with both right in that frame; a tracker that tracks merged
    people as one, as the paper's does, is thus judged by the result of the split. Frames with one of the two outside the
    tracked area are not counted; a merge counts if both are inside in at least one of its frames.

    stamps_ns (f,): of the judged frames, in order.
    """
    correlated = situations.select("correlated")
    both, right = _of_pairs(people, correlated)
    holding = correlated.frames(stamps_ns) & both
    merged = situations.select("merged_rig")
    both, right_too = _of_pairs(people, merged)
    during, until_after = merged.frames(stamps_ns) & both, merged.frames(stamps_ns, AFTER_S) & both
    last_ns = stamps_ns[-1] if stamps_ns.size else 0
    after_ns = merged.end_ns + round(AFTER_S * NS_PER_S)
    seen = merged.complete & (after_ns <= last_ns) & during.any(axis=1)
    rows = np.flatnonzero(seen)
    frame = np.searchsorted(stamps_ns, after_ns[rows])
    judged_after = both[rows, frame]
    return {
        "correlated": _share(holding.sum(), (holding & right).sum()),
        "merge_split": _share(seen.sum(), (seen & ~(until_after & ~right_too).any(axis=1)).sum()),
        "identity_after": _share(judged_after.sum(), (judged_after & right_too[rows, frame]).sum()),
    }


def _of_pairs(people: PersonFrames, situations: SituationTable) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return, for the pair of each of n situations in f judged frames: both people judged, both right, (n, f) each."""
    known = np.isin(situations.first_id, people.person_ids) & np.isin(situations.second_id, people.person_ids)
    judged, right = (np.zeros((len(situations), people.judged.shape[1]), dtype=np.bool_) for _ in range(2))
    first, second = (
        np.searchsorted(people.person_ids, ids[known]) for ids in (situations.first_id, situations.second_id)
    )
    judged[known] = people.judged[first] & people.judged[second]
    right[known] = people.right[first] & people.right[second]
    return judged, right


def _share(total: np.integer, disposed: np.integer) -> dict[str, Any]:
    return {"total": int(total), "disposed": int(disposed), "share": float(disposed / total) if total else None}


CLAIMED_PERCENT = (10, 20, 30, 40, 50, 60, 70, 80, 90, 95, 99)
"""Probabilities of a calibration curve."""
WITHIN = "within_radius"


def within_radius(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> dict[str, Any] | None:
    """Compute `within_radius` of `metrics.json`: by probability, in per cent, the share found, and `n` tracks in all frames.

    None where no track states a radius. `judged`, `matches`: frames inside the area and their correspondence.
    """
    share = claimed_at_person(judged, matches)
    if share.size == 0:
        return None
    return {"n": int(share.size)} | {str(each): float((share <= each / 100).mean()) for each in CLAIMED_PERCENT}


def claimed_at_person(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> NDArray[np.float64]:
    """Compute the probability of the circle through its person under each of n stated radii; 1 without a person.

    Uniform from 0 to 1 for a calibrated tracker.
    """
    distance, radius = [np.empty(0)], [np.empty(0)]
    for frame, pairs in zip(judged, matches, strict=True):
        states = ~np.isnan(frame.radius95_m)
        if not states.any():
            continue
        gap = np.full(frame.track_ids.size, np.inf)
        gap[pairs.columns] = pairs.distances
        left = np.ones((frame.person_ids.size, frame.track_ids.size), np.bool_)
        left[pairs.rows] = left[:, pairs.columns] = False
        rows, columns = global_nearest_neighbour(frame.distances_m, left)
        gap[columns] = frame.distances_m[rows, columns]
        distance.append(gap[states])
        radius.append(frame.radius95_m[states])
    return 1 - 0.05 ** np.square(np.concatenate(distance) / np.concatenate(radius))


def calibration_curve(metrics: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Return the stated and found shares of a tracker's metrics, flattened or not; empty without radii."""
    nested = metrics.get(WITHIN) or {}
    found = [(each, metrics.get(f"{WITHIN}.{each}", nested.get(str(each)))) for each in CLAIMED_PERCENT]
    return [(each / 100, share) for each, share in found if share is not None]


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
