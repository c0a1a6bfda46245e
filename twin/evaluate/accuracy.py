"""Accuracy: the share of person-frames in which nothing failed, the failures told apart by kind.

The kinds are those of Song et al. (laser and vision by on-line learning): target missed, false location, identity switch.
A person-frame is a person inside the tracked area in a judged frame. In it

- the identity is wrong while the nearest track within the gate belongs to somebody else. A track belongs to the person it
  was confirmed on for as long as it lives: whom it is matched with (CLEAR correspondence, people outside the area too) in
  its first confirmed frame, or, where it has no match there, in the first later one that has. So after a swap both people
  are wrong until the tracks end or swap back. A further track that is confirmed on somebody counts once, in the first frame
  in which it is the nearest to them: a switch;
- the person is missed where no track at all is within the gate, unless a track of theirs is counted as a false location.

A false location is a track within the gate of nobody, inside the area or outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.evaluate.clear import FrameMatches
from twin.evaluate.frames import Frame

NOBODY = -1
"""Instead of an id: in places of an array that stand for nobody, and of a track that belongs to nobody."""


@dataclass(frozen=True, eq=False)
class PersonFrames:
    """What became of each of p people in each of f judged frames."""

    person_ids: NDArray[np.int64]  # (p,) ascending
    judged: NDArray[np.bool_]  # (p, f) there, and inside the area
    missed: NDArray[np.bool_]  # (p, f)
    wrong: NDArray[np.bool_]  # (p, f) identity wrong, switches included
    astray: NDArray[np.bool_]  # (p, f) no track near them, and one of theirs near nobody
    false_locations: NDArray[np.int64]  # (f,)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether nothing failed of a person, (p, f)."""
        return self.judged & ~(self.missed | self.wrong | self.astray)

    @property
    def failures(self) -> NDArray[np.int64]:
        """Failures of all kinds in each frame, (f,)."""
        return (self.missed | self.wrong).sum(axis=0) + self.false_locations

    def figures(self) -> dict[str, Any]:
        """`accuracy` and `failures` of `metrics.json`; accuracy is None where nobody was there."""
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
    """Judge frames that hold everybody; `matches`: their correspondence at the same gate."""
    person_id, there = _laid_out([frame.person_ids for frame in frames], NOBODY)  # (f, n): n places a frame
    track_id, _ = _laid_out([frame.track_ids for frame in frames], NOBODY)  # (f, m)
    person_xy, _ = _laid_out([frame.person_xy for frame in frames], np.nan)
    track_xy, _ = _laid_out([frame.track_xy for frame in frames], np.nan)
    inside, _ = _laid_out([frame.in_area for frame in frames], False)
    gap = person_xy[:, :, None] - track_xy[:, None]
    distance = np.hypot(gap[..., 0], gap[..., 1])  # (f, n, m)
    near = distance <= gate_m  # NaN is near nobody
    owner = _owners(frames, matches, track_id)  # (f, m)
    followed = near.any(axis=2)
    nearest = np.where(near, distance, np.inf).argmin(axis=2) if near.size else np.zeros(person_id.shape, dtype=int)
    track, of = (np.where(followed, _taken(each, nearest), NOBODY) for each in (track_id, owner))
    own = of == person_id
    wrong = followed & ~own & (of != NOBODY)
    wrong |= _switches(person_id, track, followed & own)
    nowhere = (track_id != NOBODY) & ~near.any(axis=1)
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


def _laid_out(rows: Sequence[NDArray[Any]], fill: float) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Rows (n_i, ...) as one array (f, n, ...) of the longest one's length, and what of it is theirs (f, n)."""
    count = np.array([len(row) for row in rows], dtype=np.intp)
    theirs = np.arange(count.max(initial=0)) < count[:, None]
    whole = np.full((*theirs.shape, *rows[0].shape[1:]), fill, dtype=rows[0].dtype)
    whole[theirs] = np.concatenate(rows)
    return whole, theirs


def _taken(of_track: NDArray[np.int64], which: NDArray[np.intp]) -> NDArray[np.int64]:
    """Of each person's track `which` (f, n) its entry in (f, m)."""
    if not of_track.size:
        return np.full(which.shape, NOBODY, dtype=np.int64)
    return np.take_along_axis(of_track, which, axis=1)


def _owners(frames: Sequence[Frame], matches: Sequence[FrameMatches], track_id: NDArray[np.int64]) -> NDArray[np.int64]:
    """Whom each track (f, m) belongs to, NOBODY for those that were never matched while confirmed."""
    pairs = [
        np.stack([frame.track_ids[found.columns], frame.person_ids[found.rows]])[:, frame.confirmed[found.columns]]
        for frame, found in zip(frames, matches, strict=True)
    ]
    tracks, persons = np.concatenate(pairs, axis=1)
    known, first = np.unique(tracks, return_index=True)
    if not known.size:
        return np.full(track_id.shape, NOBODY, dtype=np.int64)
    place = np.minimum(np.searchsorted(known, track_id), known.size - 1)
    return np.where(known[place] == track_id, persons[first][place], NOBODY)


def _switches(person_id: NDArray[np.int64], track_id: NDArray[np.int64], own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The places (f, n) of the first frame of each own track of a person but their first; `track_id`: their nearest."""
    switched = np.zeros(own.shape, dtype=np.bool_)
    places = np.flatnonzero(own)  # in order of time
    pairs = np.stack([person_id.ravel()[places], track_id.ravel()[places]])
    _, first = np.unique(pairs, axis=1, return_index=True)
    first = np.sort(first)
    _, earliest = np.unique(pairs[0, first], return_index=True)
    switched.ravel()[places[np.delete(first, earliest)]] = True
    return switched
