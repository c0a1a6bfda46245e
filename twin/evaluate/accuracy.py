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
from dataclasses import dataclass
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
    inside, _ = _padded([frame.in_area for frame in frames], False)
    owner_of = _owners(frames, matches)
    each = [_in_frame(frame, owner_of(frame.track_ids), gate_m) for frame in frames]
    track, of, is_astray, n_nowhere = (list(part) for part in zip(*each, strict=True))
    track, of = (_padded(part, NO_ID)[0] for part in (track, of))
    astray = _padded(is_astray, False)[0]
    followed = track != NO_ID
    own = followed & (of == person_id)
    wrong = followed & ~own & (of != NO_ID)
    wrong |= _switches(person_id, track, own)
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
        false_locations=np.array(n_nowhere, dtype=np.int64),
    )


def _in_frame(
    frame: Frame, owner: NDArray[np.int64], gate_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_], int]:
    """Return the track nearest to each person (n,), its owner (NO_ID: no track near), who is astray, and the false locations.

    owner: of each track (m,). Of several tracks at one place a person's own is the nearest.
    """
    distance = frame.distances_m  # (n, m)
    near = distance <= gate_m
    followed, nowhere = near.any(axis=1), ~near.any(axis=0)
    theirs = owner == frame.person_ids[:, None]
    if not distance.size:
        none = np.full(frame.person_ids.shape, NO_ID, dtype=np.int64)
        return none, none, none == 0, int(nowhere.sum())
    at_place = near & (distance == np.where(near, distance, np.inf).min(axis=1, keepdims=True))
    own = theirs & at_place
    which = np.where(own.any(axis=1), own.argmax(axis=1), at_place.argmax(axis=1))
    track, of = (np.where(followed, each[which], NO_ID) for each in (frame.track_ids, owner))
    return track, of, ~followed & (theirs & nowhere).any(axis=1), int(nowhere.sum())


def _padded(rows: Sequence[NDArray[Any]], fill: float) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Pad f rows (n_i, ...) to one array (f, n, ...) of the longest; return it and its filled slots (f, n)."""
    count = np.array([len(row) for row in rows], dtype=np.intp)
    theirs = np.arange(count.max(initial=0)) < count[:, None]
    whole = np.full((*theirs.shape, *rows[0].shape[1:]), fill, dtype=rows[0].dtype)
    whole[theirs] = np.concatenate(rows)
    return whole, theirs


def _owners(
    frames: Sequence[Frame], matches: Sequence[FrameMatches]
) -> Callable[[NDArray[np.int64]], NDArray[np.int64]]:
    """Return a function that finds the person each track id belongs to; NO_ID for tracks never matched while confirmed."""
    pairs = [
        np.stack([frame.track_ids[found.columns], frame.person_ids[found.rows]])[:, frame.confirmed[found.columns]]
        for frame, found in zip(frames, matches, strict=True)
    ]
    tracks, persons = np.concatenate(pairs, axis=1)
    known, first = np.unique(tracks, return_index=True)

    def owner_of(track_ids: NDArray[np.int64]) -> NDArray[np.int64]:
        if not known.size:
            return np.full(track_ids.shape, NO_ID, dtype=np.int64)
        place = np.minimum(np.searchsorted(known, track_ids), known.size - 1)
        return np.where(known[place] == track_ids, persons[first][place], NO_ID)

    return owner_of


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
