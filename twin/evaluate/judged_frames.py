"""Judged frames: truth and tracks at the same stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.errors import InputError
from trackers.observations import NS_PER_S
from twin.evaluate.clear import FrameMatches, PairMatrix, match_frames
from twin.evaluate.report_clock import (
    JITTER_SHARE,
    MAX_TRUTH_GAP_NS,
    describe_silence,
    is_covered,
    longest_gap_ns,
    paired_stamps,
    pairing_ns,
    people_at,
    report_clock,
    silent_stamps,
    span_of,
    usual_gap_ns,
    usual_interval_ns,
    with_stamps_between,
)
from twin.recording.tables import TrackTable, TruthTable

NOTED_SHARE = 0.02  # share of frames not judged above which a note is made
MOST_BETWEEN = 64  # stamps between two rows of sparse truth: bounds the work
LEAST_SHARE = 0.5  # share of judged frames below which metrics mean little


@dataclass(frozen=True, eq=False)
class Frame:
    """One judged frame: n true people, m reported tracks; room frame, metres, radians."""

    stamp_ns: int
    person_ids: NDArray[np.int64]  # (n,)
    person_xy: NDArray[np.float64]  # (n, 2)
    person_pose: NDArray[np.float64]  # (n, 5) head x, y, z, yaw; height of the pelvis
    in_area: NDArray[np.bool_]  # (n,)
    track_ids: NDArray[np.int64]  # (m,)
    track_xy: NDArray[np.float64]  # (m, 2)
    track_pose: NDArray[np.float64]  # (m, 5) the same; NaN where not estimated
    confirmed: NDArray[np.bool_]  # (m,) False: coasting
    radius95_m: NDArray[np.float64]  # (m,) stated radius that holds the person with 95 % [m]; NaN: not stated

    @cached_property
    def distances_m(self) -> NDArray[np.float64]:
        """Ground distance of every person and track, (n, m)."""
        x, y = (self.person_xy[:, None, axis] - self.track_xy[None, :, axis] for axis in (0, 1))
        return np.hypot(x, y)

    def pair_matrix(self) -> PairMatrix:
        """Return the distances [m] with their ids."""
        return PairMatrix(self.person_ids, self.track_ids, self.distances_m)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Judged frames in order of time, the total number, and notes for the reader."""

    frames: list[Frame]
    n_total: int  # frames of the tracks, and those in which they are silent
    notes: tuple[str, ...]

    def counts(self) -> dict[str, Any]:
        """Count frames for `judged` of `metrics.json`: judged, total, and the share."""
        n_frame = len(self.frames)
        return {"frames": n_frame, "frames_total": self.n_total, "share": n_frame / self.n_total}


def _is_one_by_one(tracks: TrackTable) -> bool:
    """Return whether each row has a stamp of its own though ids alternate, as where rows keep the stamps of detections."""
    is_alone = tracks.id.size == np.unique(tracks.stamps_ns).size
    return bool(is_alone and 2 * np.count_nonzero(np.diff(tracks.id)) > tracks.id.size)


def align(truth: TruthTable, tracks: TrackTable) -> Alignment:
    """Find the judged frames, and the people and tracks in each.

    Judged is every stamp of the tracks at which the truth is known: one of the truth's own stamps, or one between two of
    them at most 0.25 s or 2.5 usual intervals between a person's rows apart, or nearer than half a period to one of them (of the
    truth or the tracks, the shorter), where people are as at that one. Where the tracker was silent (see
    `report_clock`), one stamp per period of the silence is judged too, without tracks: the nearest of the truth's stamps, or
    one between two if the truth's rows are rarer than the tracker's frames. An isolated stamp of the truth is not judged.
    Without any frame of tracks, every stamp of the truth is judged. A person is at their row's position at that stamp, else
    interpolated linearly between their neighbouring rows within that interval (inside the area as in the nearer row), else
    absent.

    Raises InputError where the truth has no row, or the tracks no stamp at which the truth is known.
    """
    if truth.frame_stamps_ns.size == 0:
        raise InputError(f"{truth.source}: holds no rows; at least one row of truth is expected")
    usual_ns = usual_interval_ns(truth)
    gap_ns = longest_gap_ns(truth)
    near_ns = pairing_ns(truth, usual_gap_ns(tracks.frame_stamps_ns))
    paired = paired_stamps(truth.frame_stamps_ns, tracks.frame_stamps_ns, near_ns)
    reported = tracks.frame_stamps_ns[is_covered(truth.frame_stamps_ns, paired, gap_ns)]
    if tracks.frame_stamps_ns.size and reported.size == 0:
        raise _nothing_shared(truth, tracks, gap_ns)
    near = _drop_isolated_stamps(truth.frame_stamps_ns, gap_ns)
    clock = report_clock(tracks.frame_stamps_ns, near)
    if clock is not None:
        # Truth as frequent as the tracker's frames has holes where a sensor failed: no frame was owed there.
        as_often = usual_ns <= (1 + JITTER_SHARE) * clock.period_ns
        longest_ns = min(gap_ns, clock.silence_ns) if as_often else gap_ns
        near = with_stamps_between(near, longest_ns, max(clock.period_ns, usual_ns / MOST_BETWEEN))
    silent = silent_stamps(near, tracks.frame_stamps_ns, clock)
    stamps = np.union1d(reported, silent)
    frames = _frames_at(truth, tracks, stamps, gap_ns, near_ns)
    n_total = int(tracks.frame_stamps_ns.size + silent.size)
    notes = []
    if gap_ns > MAX_TRUTH_GAP_NS and not np.isin(reported, truth.frame_stamps_ns).all():
        notes.append(
            f"{truth.source}: a person's rows come every {usual_ns / NS_PER_S:.3g} s; between rows at most "
            f"{gap_ns / NS_PER_S:.3g} s apart people are taken to walk straight on{_finer_unit(truth, tracks)}"
        )
    if _is_one_by_one(tracks):
        notes.append(
            f"{tracks.source}: no two tracks share a stamp though their rows alternate, so that each is evaluated alone and "
            "all others count as missed; the rows of one frame need the same t"
        )
    elif clock is not None and silent.size > NOTED_SHARE * n_total:
        notes.append(describe_silence(truth, tracks, silent, n_total, clock))
    if len(frames) < (1 - NOTED_SHARE) * n_total:
        unknown = np.setdiff1d(tracks.frame_stamps_ns, reported)
        remedy = "truth around the stamps of all tracks is needed"
        if len(frames) < LEAST_SHARE * n_total:
            remedy = (
                f"metrics of less than half of the frames say little{_other_clock(truth, tracks, gap_ns)}; {remedy}"
            )
        notes.append(
            f"{tracks.source}: evaluated in {len(frames)} of {n_total} frames ({len(frames) / n_total:.1%}); at the others, "
            f"the first of them at {unknown[0] / NS_PER_S:.3f} s, {truth.source} does not say where people are; {remedy}"
        )
    return Alignment(frames, n_total, tuple(notes))


def _frames_at(
    truth: TruthTable, tracks: TrackTable, stamps: NDArray[np.int64], gap_ns: int, near_ns: int
) -> list[Frame]:
    """Collect the people and tracks at each of these stamps (f,)."""
    people = people_at(truth, stamps, gap_ns, near_ns)
    xy = np.column_stack([people.x, people.y])
    pose = np.column_stack([people.head_x, people.head_y, people.head_z, people.head_yaw, people.z])
    bounds = np.searchsorted(people.stamps_ns, np.append(stamps, stamps[-1:] + 1))
    track_numbers = np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z, tracks.head_yaw, tracks.z])
    track_xy = np.column_stack([tracks.x, tracks.y])
    confirmed = tracks.status != "coasting"
    first = np.searchsorted(tracks.stamps_ns, stamps, side="left")
    last = np.searchsorted(tracks.stamps_ns, stamps, side="right")
    frames = []
    for index, stamp in enumerate(stamps.tolist()):
        here = slice(int(bounds[index]), int(bounds[index + 1]))
        rows = slice(int(first[index]), int(last[index]))
        frames.append(
            Frame(
                stamp_ns=stamp,
                person_ids=people.id[here],
                person_xy=xy[here],
                person_pose=pose[here],
                in_area=people.in_area[here],
                track_ids=tracks.id[rows],
                track_xy=track_xy[rows],
                track_pose=track_numbers[rows],
                confirmed=confirmed[rows],
                radius95_m=tracks.radius95_m[rows],
            )
        )
    return frames


def describe_judged(judged_ns: NDArray[np.int64], n_total: int) -> str:
    """Format the number of judged frames, of how many, and their time span."""
    if not len(judged_ns):
        return "no frame was judged"
    first_s, last_s = judged_ns.min() / NS_PER_S, judged_ns.max() / NS_PER_S
    frames = "1 frame" if len(judged_ns) == 1 else f"{len(judged_ns)} frames"
    return f"{frames} judged, {first_s:.12g} to {last_s:.12g} s; the tracks have {n_total}"


def match_all_people(frames: Sequence[Frame], gate_m: float) -> list[FrameMatches]:
    """Match the tracks of each frame with all people, inside the area and outside (CLEAR correspondence)."""
    return match_frames([frame.pair_matrix() for frame in frames], gate_m)


def restrict_to_area(frames: Sequence[Frame], matches: Sequence[FrameMatches]) -> list[Frame]:
    """Leave out the people outside the tracked area and the tracks matched with them; a frame without any is itself.

    `matches`: of all people (see `match_all_people`).
    """
    kept = []
    for frame, pairs in zip(frames, matches, strict=True):
        judged = np.ones(frame.track_ids.size, dtype=np.bool_)
        judged[pairs.columns[~frame.in_area[pairs.rows]]] = False
        if frame.in_area.all() and judged.all():
            kept.append(frame)
            continue
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
                radius95_m=frame.radius95_m[judged],
            )
        )
    return kept


def _drop_isolated_stamps(stamps: NDArray[np.int64], gap_ns: int) -> NDArray[np.int64]:
    """Keep the stamps (n,) that have another within `gap_ns`; all of them if none has."""
    if stamps.size < 2:
        return stamps
    near = np.diff(stamps) <= gap_ns
    together = np.append(near, False) | np.insert(near, 0, False)
    return stamps[together] if together.any() else stamps


def _nothing_shared(truth: TruthTable, tracks: TrackTable, gap_ns: int) -> InputError:
    """Explain why no frame can be judged: two clocks, or no truth where the tracks report."""
    theirs, ours = tracks.frame_stamps_ns, truth.frame_stamps_ns
    apart = theirs[-1] < ours[0] or theirs[0] > ours[-1]
    where = f"{tracks.source}: no stamp from {span_of(theirs)} is covered by {truth.source} from {span_of(ours)}"
    if apart:
        return InputError(
            f"{where}{_other_clock(truth, tracks, gap_ns)}; t of both tables is expected on the same clock"
        )
    return InputError(
        f"{where}: none is a stamp of the truth, or between two of them at most {gap_ns / NS_PER_S:.3g} s apart; "
        "truth around the stamps of the tracks is expected"
    )


def _other_clock(truth: TruthTable, tracks: TrackTable, gap_ns: int) -> str:
    """Return a clause on the unit of t, or the start of the clock, by which most frames of the tracks would be covered."""
    theirs, ours = tracks.frame_stamps_ns, truth.frame_stamps_ns
    changes = {
        f"t of the tracks in {unit}": theirs // per_s
        for unit, per_s in _UNITS.items()
        if usual_gap_ns(theirs) > per_s * _LEAST_NS
    }
    if usual_gap_ns(ours) > 1000 * _LEAST_NS:
        changes["t of the truth in ms"] = np.clip(theirs, -_MOST_NS, _MOST_NS) * 1000
    changes["t of both from their first rows on"] = theirs - theirs[0] + ours[0]
    share = {
        how: float(is_covered(ours, stamps, gap_ns).mean()) * np.unique(stamps).size / stamps.size
        for how, stamps in changes.items()
    }
    best = max(share, key=lambda how: share[how])
    is_better = share[best] >= max(LEAST_SHARE, 2 * float(is_covered(ours, theirs, gap_ns).mean()))
    return f"; {best} would cover {share[best]:.0%} of the frames" if is_better else ""


_MOST_NS = np.iinfo(np.int64).max // 1000
_LEAST_NS = NS_PER_S // 1000
"""Least time between two frames [ns]: a unit by which they come faster is not that of t."""
_UNITS = {"ms": 1000, "µs": 1_000_000, "ns": 1_000_000_000}


def _finer_unit(truth: TruthTable, tracks: TrackTable) -> str:
    """Return a clause on the unit of the truth's t by which both tables are about as long, though they begin alike."""
    ours, theirs = (each[-1] - each[0] for each in (truth.frame_stamps_ns, tracks.frame_stamps_ns))
    for unit, per_s in _UNITS.items():
        if _ALIKE * theirs <= ours / per_s <= theirs / _ALIKE:
            return (
                f"; its t spans {ours / NS_PER_S:.4g} s and that of {tracks.source} {theirs / NS_PER_S:.4g} s: t in s is "
                f"expected, and in {unit} the two would span about the same"
            )
    return ""


_ALIKE = 0.5
"""Least ratio of two tables' spans of time that are of one recording."""
