"""Continuity of tracks: misidentifications, lost tracks and identity switches as events.

Counted as in the tables of the laser-and-fisheye paper: "a track carries on with another person", "a track ends while its
person is inside".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from trackers.observations import NS_PER_S
from twin.evaluate.clear import FrameMatches, IdSwitch
from twin.evaluate.judged_frames import Frame
from twin.recording.tables import TrackTable

LEAVING_GRACE_NS = NS_PER_S // 2


@dataclass(frozen=True)
class TrackEvent:
    """Break between a track and a person.

    switch: the person continues under `track_id`, before it was `previous_track_id`. misidentification: the track continues
    with `person_id`, before it was `previous_person_id`. lost: the track's last frame, in which its person stays.
    """

    kind: Literal["switch", "misidentification", "lost"]
    stamp_ns: int
    person_id: int
    track_id: int
    previous_person_id: int | None = None
    previous_track_id: int | None = None


def switch_events(frames: Sequence[Frame], switches: Sequence[IdSwitch]) -> list[TrackEvent]:
    """Convert the identity switches of CLEAR to events."""
    return [
        TrackEvent("switch", frames[s.frame].stamp_ns, s.person_id, s.track_id, previous_track_id=s.previous_track_id)
        for s in switches
    ]


def continuity(
    frames: Sequence[Frame], judged: Sequence[Frame], matches: Sequence[FrameMatches]
) -> tuple[list[TrackEvent], list[TrackEvent]]:
    """Find misidentifications and lost tracks, each in order of time.

    `frames` hold all people, `judged` the same frames restricted to the area, `matches` their correspondence.

    Misidentification: a track's person is its match in the first frame with status confirmed, or else in the first later one
    with a match. Each time the confirmed track is matched with another person, one misidentification is counted, and that
    person becomes its person. Coasting frames do not count: a track predicted past another person has not taken them for its
    own yet.

    Lost: a track that has had a person is in its last frame, which is not the last of the run, and its person (the last one,
    as above) is inside the area then and in all frames up to 0.5 s later, at least the next one. A person who leaves, or
    whose truth ends, within that time counts as left.
    """
    person_of: dict[int, int] = {}
    last_seen: dict[int, int] = {}
    misidentifications = []
    for index, (frame, inside, pairs) in enumerate(zip(frames, judged, matches, strict=True)):
        last_seen.update(dict.fromkeys(frame.track_ids.tolist(), index))
        persons = inside.person_ids[pairs.rows].tolist()
        tracks = inside.track_ids[pairs.columns].tolist()
        confirmed = inside.confirmed[pairs.columns].tolist()
        for track, person, is_confirmed in sorted(zip(tracks, persons, confirmed, strict=True)):
            if not is_confirmed:
                continue
            previous = person_of.setdefault(track, person)
            if previous != person:
                misidentifications.append(
                    TrackEvent("misidentification", inside.stamp_ns, person, track, previous_person_id=previous)
                )
                person_of[track] = person
    ended = sorted((index, track) for track, index in last_seen.items() if track in person_of)
    lost = [
        TrackEvent("lost", frames[index].stamp_ns, person_of[track], track)
        for index, track in ended
        if index < len(frames) - 1 and _stays(frames, index, person_of[track])
    ]
    return misidentifications, lost


def right_at_end(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> float | None:
    """Compute the share of the people inside the area in the last frame who have their own track there; None without people.

    One's own is the track that one was matched with first, if that had been no other person's before.
    """
    if not judged or not judged[-1].person_ids.size:
        return None
    first_track: dict[int, int] = {}
    first_person: dict[int, int] = {}
    last: list[tuple[int, int]] = []
    for frame, pairs in zip(judged, matches, strict=True):
        last = list(zip(frame.person_ids[pairs.rows].tolist(), frame.track_ids[pairs.columns].tolist(), strict=True))
        for person, track in last:
            first_track.setdefault(person, track)
            first_person.setdefault(track, person)
    right = sum(first_track[person] == track and first_person[track] == person for person, track in last)
    return right / judged[-1].person_ids.size


def _stays(frames: Sequence[Frame], index: int, person: int) -> bool:
    """Tell whether a person is inside the area in this frame and until the grace is over."""
    until_ns = frames[index].stamp_ns + LEAVING_GRACE_NS
    for later in range(index, len(frames)):
        frame = frames[later]
        if later > index + 1 and frame.stamp_ns > until_ns:
            break
        if not (frame.in_area & (frame.person_ids == person)).any():
            return False
    return True


def track_counts(tracks: TrackTable) -> dict[str, Any]:
    """Count tracks without any truth: ids, tracks per frame, and how long tracks last.

    frames; track_count; tracks_per_frame and most_per_frame (None without a frame); duration_s: median and longest, from a
    track's first frame to its last [s] (None without a track); coasting: the share of rows that are predictions.
    """
    n_frame = tracks.frame_stamps_ns.size
    per_frame = np.bincount(np.searchsorted(tracks.frame_stamps_ns, tracks.stamps_ns), minlength=n_frame)
    _, first, of_row = np.unique(tracks.id, return_index=True, return_inverse=True)
    last = np.zeros(first.size, dtype=np.int64)
    np.maximum.at(last, of_row.ravel(), tracks.stamps_ns)
    lasted_s = (last - tracks.stamps_ns[first]) / NS_PER_S
    return {
        "frames": n_frame,
        "track_count": int(first.size),
        "tracks_per_frame": float(per_frame.mean()) if n_frame else None,
        "most_per_frame": int(per_frame.max()) if n_frame else None,
        "duration_s": {
            "median": float(np.median(lasted_s)) if first.size else None,
            "longest": float(lasted_s.max()) if first.size else None,
        },
        "coasting": float((tracks.status == "coasting").mean()) if tracks.id.size else None,
    }
