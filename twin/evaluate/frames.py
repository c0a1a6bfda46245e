"""Truth and tracks brought to the same moments: which moments are judged, and where everybody is in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.evaluate.clear import FrameMatches, PairMatrix, match_frames
from twin.recording.tables import TrackTable, TruthTable

MAX_TRUTH_GAP_NS = NS_PER_S // 4
SILENCE_FACTOR = 1.5
JITTER_SHARE = 0.25  # of a period: how far a missing frame may stand outside the truth's span


@dataclass(frozen=True, eq=False)
class Frame:
    """Everybody at one judged moment: n people as they are, m tracks as reported; room frame, metres, radians."""

    stamp_ns: int
    person_ids: NDArray[np.int64]  # (n,)
    person_xy: NDArray[np.float64]  # (n, 2)
    person_pose: NDArray[np.float64]  # (n, 5) head x, y, z, yaw; height of the pelvis
    in_area: NDArray[np.bool_]  # (n,)
    track_ids: NDArray[np.int64]  # (m,)
    track_xy: NDArray[np.float64]  # (m, 2)
    track_pose: NDArray[np.float64]  # (m, 5) the same; NaN where not estimated
    confirmed: NDArray[np.bool_]  # (m,) false: coasting

    @property
    def distances_m(self) -> NDArray[np.float64]:
        """Ground distance of every person and track, (n, m)."""
        gap = self.person_xy[:, None] - self.track_xy[None]
        return np.hypot(gap[..., 0], gap[..., 1])

    def pair_matrix(self) -> PairMatrix:
        """The distances [m] with their ids."""
        return PairMatrix(self.person_ids, self.track_ids, self.distances_m)


def align(truth: TruthTable, tracks: TrackTable) -> list[Frame]:
    """The judged frames, in order of time.

    Judged is every stamp of the tracks at which the truth is known: one of the truth's own stamps, or one between two
    of them at most 0.25 s apart. Where the tracker was silent for more than 1.5 of its median periods, the truth's
    stamps in that silence, thinned to that period, are judged too, with no track in them. Without any frame of
    tracks, every stamp of the truth is judged. A person is where their row says at that stamp, else linearly between
    the person's own neighbouring rows at most 0.25 s apart (inside the area as in the nearer row), else not there.

    Raises InputError where the truth holds no moment at all, or the tracks none at which the truth is known.
    """
    if truth.frame_stamps_ns.size == 0:
        raise InputError(f"{truth.source}: holds no rows; at least one moment of truth is expected")
    reported = tracks.frame_stamps_ns[_is_covered(truth.frame_stamps_ns, tracks.frame_stamps_ns)]
    if tracks.frame_stamps_ns.size and reported.size == 0:
        raise InputError(
            f"{tracks.source}: no stamp from {_span(tracks.frame_stamps_ns)} is covered by {truth.source} "
            f"from {_span(truth.frame_stamps_ns)}; t of both tables is expected on the same clock"
        )
    silent = _silent_stamps(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    stamps = np.union1d(reported, silent)
    persons, xy, head, in_area, present = _people_at(truth, stamps)
    track_numbers = np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z, tracks.head_yaw, tracks.z])
    track_xy = np.column_stack([tracks.x, tracks.y])
    confirmed = tracks.status == "confirmed"
    first = np.searchsorted(tracks.stamps_ns, stamps, side="left")
    last = np.searchsorted(tracks.stamps_ns, stamps, side="right")
    frames = []
    for index, stamp in enumerate(stamps.tolist()):
        here = present[:, index]
        rows = slice(int(first[index]), int(last[index]))
        frames.append(
            Frame(
                stamp_ns=stamp,
                person_ids=persons[here],
                person_xy=xy[here, index],
                person_pose=head[here, index],
                in_area=in_area[here, index],
                track_ids=tracks.id[rows],
                track_xy=track_xy[rows],
                track_pose=track_numbers[rows],
                confirmed=confirmed[rows],
            )
        )
    return frames


def everybody_matched(frames: Sequence[Frame], gate_m: float) -> list[FrameMatches]:
    """The tracks of each frame matched with all people, inside the area and outside (CLEAR correspondence)."""
    return match_frames([frame.pair_matrix() for frame in frames], gate_m)


def inside_area(frames: Sequence[Frame], matches: Sequence[FrameMatches]) -> list[Frame]:
    """The frames without the people outside the tracked area and without the tracks that follow them.

    `matches`: of everybody (see `everybody_matched`); a track whose match is outside is left out there, neither owed nor
    punished.
    """
    kept = []
    for frame, pairs in zip(frames, matches, strict=True):
        judged = np.ones(frame.track_ids.size, dtype=np.bool_)
        judged[pairs.columns[~frame.in_area[pairs.rows]]] = False
        kept.append(
            replace(
                frame,
                person_ids=frame.person_ids[frame.in_area],
                person_xy=frame.person_xy[frame.in_area],
                person_pose=frame.person_pose[frame.in_area],
                in_area=frame.in_area[frame.in_area],
                track_ids=frame.track_ids[judged],
                track_xy=frame.track_xy[judged],
                track_pose=frame.track_pose[judged],
                confirmed=frame.confirmed[judged],
            )
        )
    return kept


def _is_covered(truth_stamps: NDArray[np.int64], stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether the truth is known at each stamp, (n,)."""
    before = np.searchsorted(truth_stamps, stamps, side="right") - 1
    after = np.searchsorted(truth_stamps, stamps, side="left")
    bracketed = (before >= 0) & (after < truth_stamps.size)
    gap = truth_stamps[np.minimum(after, truth_stamps.size - 1)] - truth_stamps[np.maximum(before, 0)]
    return bracketed & (gap <= MAX_TRUTH_GAP_NS)


def _silent_stamps(truth_stamps: NDArray[np.int64], track_stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """The truth's stamps that stand for frames which the tracker did not report, ascending."""
    if track_stamps.size == 0:
        return truth_stamps
    periods = np.diff(track_stamps if track_stamps.size > 1 else truth_stamps)
    if periods.size == 0:
        return np.zeros(0, dtype=np.int64)
    period = float(np.median(periods))
    start, end = int(truth_stamps[0]), int(truth_stamps[-1])
    wanted = []
    for before, after in zip(track_stamps[:-1].tolist(), track_stamps[1:].tolist(), strict=True):
        if after - before > SILENCE_FACTOR * period:
            steps = np.arange(1, int((after - before) / period + 0.5))  # the last at least half a period before `after`
            wanted.append(before + steps * period)
    first, last = int(track_stamps[0]), int(track_stamps[-1])
    if first - start > SILENCE_FACTOR * period:
        wanted.append(first - np.arange(1, int((first - start) / period + JITTER_SHARE) + 1) * period)
    if end - last > SILENCE_FACTOR * period:
        wanted.append(last + np.arange(1, int((end - last) / period + JITTER_SHARE) + 1) * period)
    if not wanted:
        return np.zeros(0, dtype=np.int64)
    times = np.concatenate(wanted)
    after = np.clip(np.searchsorted(truth_stamps, times), 1, max(truth_stamps.size - 1, 1))
    low, high = truth_stamps[after - 1], truth_stamps[np.minimum(after, truth_stamps.size - 1)]
    nearest = np.where(times - low <= high - times, low, high)
    # Where the truth has a hole of its own, nothing near the wanted time can be judged.
    near = nearest[np.abs(nearest - times) <= period / 2]
    return np.setdiff1d(near, track_stamps)


def _people_at(
    truth: TruthTable, stamps: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Ids (p,), ground points (p, f, 2) [m], poses (p, f, 5), in the area (p, f), and whether there at all (p, f)."""
    persons = np.unique(truth.id)
    values = np.column_stack([truth.x, truth.y, truth.head_x, truth.head_y, truth.head_z, truth.head_yaw, truth.z])
    positions = np.full((persons.size, stamps.size, 7), np.nan)
    in_area = np.zeros((persons.size, stamps.size), dtype=np.bool_)
    present = np.zeros((persons.size, stamps.size), dtype=np.bool_)
    for index, person in enumerate(persons):
        rows = np.flatnonzero(truth.id == person)
        own = truth.stamps_ns[rows]
        before = np.searchsorted(own, stamps, side="right") - 1
        after = np.searchsorted(own, stamps, side="left")
        there = np.flatnonzero(_is_covered(own, stamps))
        low, high = rows[before[there]], rows[after[there]]
        span = truth.stamps_ns[high] - truth.stamps_ns[low]
        share = (stamps[there] - truth.stamps_ns[low]) / np.maximum(span, 1)  # 0 at a stamp of the person's own
        change = values[high] - values[low]
        change[:, 5] = wrap_angle(change[:, 5])
        positions[index, there] = values[low] + share[:, None] * change
        in_area[index, there] = truth.in_area[np.where(share <= 0.5, low, high)]
        present[index, there] = True
    return persons, positions[..., :2], positions[..., 2:], in_area, present


def wrap_angle(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same angles in [−π, π) [rad]."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def _span(stamps: NDArray[np.int64]) -> str:
    return f"{stamps[0] / NS_PER_S:.3f} to {stamps[-1] / NS_PER_S:.3f} s"
