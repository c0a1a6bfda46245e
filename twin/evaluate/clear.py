"""CLEAR MOT and identity scores: correspondence frame by frame, MOTA, MOTP, IDF1 and their counts.

Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", 2008, as in
py-motmetrics 1.4: a person and the track last matched with them are matched again while within the gate; the rest is
assigned with as many pairs as possible, of these the nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.filters.gating import global_nearest_neighbour
from trackers.scipy_functions import linear_sum_assignment


@dataclass(frozen=True, eq=False)
class PairMatrix:
    """All people against all tracks of one frame.

    `values` (n, m) are distances (any unit; NaN: never a pair) for CLEAR and identity, similarities from 0 to 1 for HOTA.
    """

    person_ids: NDArray[np.int64]  # (n,)
    track_ids: NDArray[np.int64]  # (m,)
    values: NDArray[np.float64]  # (n, m)

    def __post_init__(self) -> None:
        if self.values.shape != (self.person_ids.size, self.track_ids.size):
            raise ValueError(
                f"values have shape {self.values.shape}; ({self.person_ids.size}, {self.track_ids.size}) is needed"
            )


@dataclass(frozen=True, eq=False)
class FrameMatches:
    """Pairs of one frame: row of the person and column of the track in the frame's `PairMatrix`, their distance."""

    rows: NDArray[np.intp]  # (k,)
    columns: NDArray[np.intp]  # (k,)
    distances: NDArray[np.float64]  # (k,)


@dataclass(frozen=True)
class IdSwitch:
    """Frame from which a person is matched with another track than at their last match."""

    frame: int
    person_id: int
    previous_track_id: int
    track_id: int


@dataclass(frozen=True)
class ClearScores:
    """CLEAR counts of one run, or of several added together."""

    persons: int  # true positions, summed over frames
    matches: int  # pairs, those of a switch included
    misses: int
    false_positives: int
    id_switches: int
    distance_sum: float  # of all matches, in the unit of the distances

    def __add__(self, other: ClearScores) -> ClearScores:
        return ClearScores(*(mine + theirs for mine, theirs in zip(_fields(self), _fields(other), strict=True)))

    @property
    def mota(self) -> float | None:
        """1 − (misses + false positives + switches) / true positions; None without people."""
        if not self.persons:
            return None
        return 1.0 - (self.misses + self.false_positives + self.id_switches) / self.persons

    @property
    def motp(self) -> float | None:
        """Mean distance of the matches; None without any."""
        return self.distance_sum / self.matches if self.matches else None


def match_frames(frames: Sequence[PairMatrix], gate: float) -> list[FrameMatches]:
    """Match people and tracks of a run by the CLEAR correspondence: pairs at most `gate` apart, earlier pairs kept.

    Of two persons last matched with the same track, the later one comes first, so that the result does not depend on the
    order of the persons (py-motmetrics prefers the first in the list).
    """
    partner: dict[int, int] = {}
    last_matched: dict[int, int] = {}
    matches = []
    for index, frame in enumerate(frames):
        allowed = frame.values <= gate  # NaN is no pair
        rows, columns = _kept_pairs(frame, allowed, partner, last_matched)
        if len(rows) < min(allowed.shape):  # else nothing is left to assign
            allowed[rows, :] = False
            allowed[:, columns] = False
            new_rows, new_columns = global_nearest_neighbour(frame.values, allowed)
            rows, columns = rows + new_rows.tolist(), columns + new_columns.tolist()
        all_rows, all_columns = np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)
        for person, track in zip(
            frame.person_ids[all_rows].tolist(), frame.track_ids[all_columns].tolist(), strict=True
        ):
            partner[person] = track
            last_matched[person] = index
        order = np.argsort(all_rows)
        all_rows, all_columns = all_rows[order], all_columns[order]
        matches.append(FrameMatches(all_rows, all_columns, frame.values[all_rows, all_columns]))
    return matches


def find_switches(frames: Sequence[PairMatrix], matches: Sequence[FrameMatches]) -> list[IdSwitch]:
    """Find every identity switch, by time, then person; a gap of any length in between does not undo a switch."""
    partner: dict[int, int] = {}
    switches = []
    for index, (frame, pairs) in enumerate(zip(frames, matches, strict=True)):
        found = zip(frame.person_ids[pairs.rows].tolist(), frame.track_ids[pairs.columns].tolist(), strict=True)
        for person, track in sorted(found):
            previous = partner.get(person)
            if previous is not None and previous != track:
                switches.append(IdSwitch(index, person, previous, track))
            partner[person] = track
    return switches


def clear(frames: Sequence[PairMatrix], gate: float, matches: Sequence[FrameMatches] | None = None) -> ClearScores:
    """Compute the CLEAR scores of one run; `matches`: the result of `match_frames`, if available."""
    if matches is None:
        matches = match_frames(frames, gate)
    persons = sum(frame.person_ids.size for frame in frames)
    n_matches = sum(pairs.rows.size for pairs in matches)
    return ClearScores(
        persons=persons,
        matches=n_matches,
        misses=persons - n_matches,
        false_positives=sum(frame.track_ids.size for frame in frames) - n_matches,
        id_switches=len(find_switches(frames, matches)),
        distance_sum=float(sum(pairs.distances.sum() for pairs in matches)),
    )


def _kept_pairs(
    frame: PairMatrix, allowed: NDArray[np.bool_], partner: dict[int, int], last_matched: dict[int, int]
) -> tuple[list[int], list[int]]:
    column_of = {track: column for column, track in enumerate(frame.track_ids.tolist())}
    candidates = []
    for row, person in enumerate(frame.person_ids.tolist()):
        column = column_of.get(partner.get(person, -1))
        if column is not None and allowed[row, column]:
            candidates.append((-last_matched[person], row, column))
    rows: list[int] = []
    columns: list[int] = []
    for _, row, column in sorted(candidates):
        if column not in columns:
            rows.append(row)
            columns.append(column)
    return rows, columns


def _fields(scores: ClearScores) -> tuple:
    return tuple(getattr(scores, name) for name in scores.__dataclass_fields__)


@dataclass(frozen=True)
class IdentityScores:
    """Identity counts of one run, or of several added together."""

    true_positives: int
    misses: int
    false_positives: int

    def __add__(self, other: IdentityScores) -> IdentityScores:
        return IdentityScores(
            self.true_positives + other.true_positives,
            self.misses + other.misses,
            self.false_positives + other.false_positives,
        )

    @property
    def idf1(self) -> float | None:
        """Harmonic mean of identity precision and recall; None without people and tracks."""
        total = 2 * self.true_positives + self.misses + self.false_positives
        return 2 * self.true_positives / total if total else None


def identity(frames: Sequence[PairMatrix], gate: float) -> IdentityScores:
    """Compute the identity scores of one run; a position counts for a pair where person and track are at most `gate` apart.

    Ristani et al., "Performance measures and a data set for multi-target, multi-camera tracking", 2016.
    """
    n_person, n_track = (sum(ids.size for ids in all_ids) for all_ids in _ids(frames))
    persons, tracks = (np.unique(np.concatenate(all_ids)) if all_ids else np.zeros(0) for all_ids in _ids(frames))
    together = np.zeros((persons.size, tracks.size))
    for frame in frames:
        rows, columns = np.nonzero(frame.values <= gate)
        # Ids do not repeat within a frame, so plain indexing adds each pair.
        together[
            np.searchsorted(persons, frame.person_ids[rows]), np.searchsorted(tracks, frame.track_ids[columns])
        ] += 1
    # Fewest misses and false positives = most positions in pairs; a pair never together adds nothing.
    true_positives = int(together[linear_sum_assignment(together, maximize=True)].sum())
    return IdentityScores(true_positives, n_person - true_positives, n_track - true_positives)


def _ids(frames: Sequence[PairMatrix]) -> tuple[list, list]:
    return [frame.person_ids for frame in frames], [frame.track_ids for frame in frames]
