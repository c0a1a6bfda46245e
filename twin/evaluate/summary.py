"""Evaluation of one tracker: the metrics of `metrics.json`, and the frames, pairs and events that a report draws."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackers.area import wrap_angle
from trackers.errors import InputError
from trackers.scipy_functions import linear_sum_assignment
from trackers.user_input.text_file import check_limit
from twin.evaluate.accuracy import PersonFrames, disposal, person_frames, within_radius
from twin.evaluate.causes import Errors, errors_by_cause, misplaced
from twin.evaluate.clear import ClearScores, FrameMatches, PairMatrix, clear, find_switches, identity, match_frames
from twin.evaluate.continuity import TrackEvent, continuity, right_at_end, switch_events
from twin.evaluate.hota import hota, hota_cap
from twin.evaluate.judged_frames import Alignment, Frame, align, match_all_people, restrict_to_area
from twin.recording.situation_table import SituationTable
from twin.recording.tables import TrackTable, TruthTable

DEFAULT_GATE_M = 0.5
WIDE_GATE_M = 1.0
CUTOFF_M = 1.0
OSPA_ORDER = 1.0
GOSPA_ORDER = 2.0


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of one tracker's run: the metrics, and the frames, pairs and events behind them.

    f frames, k pairs in all frames together, without people outside the area and the tracks matched with them.
    """

    metrics: dict[str, Any]
    stamps_ns: NDArray[np.int64]  # (f,) judged frames
    misses: NDArray[np.int64]  # (f,)
    false_positives: NDArray[np.int64]  # (f,)
    ospa_m: NDArray[np.float64]  # (f,)
    gospa_m: NDArray[np.float64]  # (f,)
    match_stamps_ns: NDArray[np.int64]  # (k,)
    match_person_ids: NDArray[np.int64]  # (k,)
    match_track_ids: NDArray[np.int64]  # (k,)
    match_distances_m: NDArray[np.float64]  # (k,)
    events: tuple[TrackEvent, ...]  # by stamp
    people: PersonFrames  # the failures behind the accuracy
    situations: SituationTable | None  # of pairs of people, for the disposal
    errors: Errors  # every miss and false positive, by cause
    notes: tuple[str, ...] = ()  # what a reader must know about the judged frames
    is_misplaced: bool = False  # the tracks are near nobody


def evaluate_tracks(
    truth: TruthTable, tracks: TrackTable, gate_m: float = DEFAULT_GATE_M, situations: SituationTable | None = None
) -> dict[str, Any]:
    """Compute the metrics of one tracker as in `metrics.json` (without ms_per_frame); None where one does not apply.

    Raises InputError for a gate that is not positive and for tables that share no stamp (see `judged_frames.align`).
    """
    return evaluate_with_details(truth, tracks, gate_m, situations).metrics


def evaluate_with_details(
    truth: TruthTable,
    tracks: TrackTable,
    gate_m: float = DEFAULT_GATE_M,
    situations: SituationTable | None = None,
    unused: Collection[str] = (),
) -> Evaluation:
    """Evaluate one tracker; return its metrics and their details. Raises as `evaluate_tracks`.

    `situations` of the run: disposal (`twin.evaluate.accuracy`) is None without. `unused`: sensors that the tracker does not
    use; causes of misses depend on it (`twin.evaluate.causes`). Errors of heads and of the pelvis's height are means of
    absolute differences over the matches in which truth and track both have a value.
    OSPA (c = 1 m, p = 1) and GOSPA (c = 1 m, p = 2, α = 2) are means over frames. `judged` holds the n of the metrics.
    """
    aligned = _aligned(truth, tracks, gate_m)
    frames = aligned.frames
    all_people = match_all_people(frames, gate_m)
    judged, pair_matrices, matches = _inside(frames, all_people, gate_m)
    switches = switch_events(judged, find_switches(pair_matrices, matches))
    misidentifications, lost = continuity(frames, judged, matches)
    ospa_m, gospa_m = _set_distances(pair_matrices)
    scores = clear(pair_matrices, gate_m, matches)
    stamps = np.array([frame.stamp_ns for frame in judged], dtype=np.int64)
    people = person_frames(frames, all_people, gate_m)
    errors = errors_by_cause(truth, judged, matches, gate_m, unused)
    apart = misplaced(judged, gate_m, tracks.source)
    pose_errors, n_head = _pose_errors(judged, matches)
    metrics: dict[str, Any] = {
        **_matrix_metrics(pair_matrices, gate_m, matches, scores),
        "gospa_m": float(gospa_m.mean()),
        "ospa_m": float(ospa_m.mean()),
        "false_positives": scores.false_positives,
        "misses": scores.misses,
        "misidentifications": len(misidentifications),
        "lost_tracks": len(lost),
        "errors": errors.counts(sight=bool(truth.visible), status=not (tracks.status == "").any()),
        **people.metrics(),
        "disposal": disposal(people, stamps, situations) if situations is not None else None,
        **pose_errors,
        "right_at_end": right_at_end(judged, matches),
        "within_radius": within_radius(judged, matches),
        "gate_m": float(gate_m),
        "at_1m": _wide_metrics(frames),
        "judged": {**aligned.counts(), "person_frames": scores.persons, "matches": scores.matches, "heads": n_head},
    }
    return Evaluation(
        metrics=metrics,
        stamps_ns=stamps,
        ospa_m=ospa_m,
        gospa_m=gospa_m,
        **_matched_pairs(judged, matches),
        events=tuple(sorted([*switches, *misidentifications, *lost], key=lambda event: event.stamp_ns)),
        people=people,
        situations=situations,
        errors=errors,
        notes=(*_notes_of_tables(truth, tracks, aligned, scores.persons, gate_m), *[apart] * bool(apart)),
        is_misplaced=bool(apart),
    )


MOST_PAIRS, MOST_IN_FRAME, MOST_OF_IDS = 200_000_000, 25_000_000, 50_000_000
"""Pairs of a person and a track: in all frames, in one, and of their ids over the run; 8 bytes each, some times over."""
PAIRS = "pairs of a person of the truth and a track"


def _check_size(frames: Sequence[Frame], source: str) -> None:
    """Raise InputError where the matrices of people and tracks would not fit a usual memory."""
    pairs = [frame.person_ids.size * frame.track_ids.size for frame in frames]
    persons = np.unique(np.concatenate([frame.person_ids for frame in frames]))
    own = np.unique(np.concatenate([frame.track_ids for frame in frames]))
    check_limit(max(pairs), MOST_IN_FRAME, f"{source}: a frame holds", PAIRS)
    check_limit(sum(pairs), MOST_PAIRS, f"{source}: its frames hold", PAIRS)
    check_limit(persons.size * own.size, MOST_OF_IDS, f"{source}: its ids make", PAIRS)


def _inside(
    frames: Sequence[Frame], all_people: Sequence[FrameMatches], gate_m: float
) -> tuple[Sequence[Frame], list[PairMatrix], Sequence[FrameMatches]]:
    """Return the frames inside the area, their distances and their correspondence, which is that of all people where no frame
    loses anybody.
    """
    judged = restrict_to_area(frames, all_people)
    pair_matrices = [frame.pair_matrix() for frame in judged]
    is_whole = all(inside is frame for inside, frame in zip(judged, frames, strict=True))
    return judged, pair_matrices, all_people if is_whole else match_frames(pair_matrices, gate_m)


def _check_tables(truth: object, tracks: object) -> None:
    if not isinstance(truth, TruthTable) or not isinstance(tracks, TrackTable):
        raise InputError(
            f"truth is a {type(truth).__name__} and tracks a {type(tracks).__name__}; a TruthTable (twin.read_truth) and a "
            "TrackTable (twin.read_tracks), in this order, are expected"
        )


def _check_gate(gate_m: float) -> None:
    """Raise InputError for a gate that is not a positive distance."""
    is_number = isinstance(gate_m, Real) and not isinstance(gate_m, bool | np.bool_)
    if not (is_number and isfinite(gate_m) and gate_m > 0):
        raise InputError(f"gate is {gate_m!r} m; a positive number of metres is expected")


def _all_outside(frames: Sequence[Frame], n_owed: int, source: str) -> list[str]:
    """Return a note where there are people, and none of them in the area."""
    if n_owed or not any(frame.person_ids.size for frame in frames):
        return []
    return [
        f"{source}: nobody is in the area in any of {len(frames)} frames, so that nobody is to be tracked; an area in which "
        "people are, or in_area of 1 where they are to be tracked, is expected"
    ]


_WIDEST_GATE_M = 3.0
"""Distance over which a track is no track of a person."""


def _wide_gate(gate_m: float) -> list[str]:
    """Return a note on a gate within which tracks match people elsewhere in the room."""
    said = f"gate: {gate_m:g} m matches tracks with people across a room; metres, 0.5 or 1 for instance, are expected"
    return [said] if gate_m > _WIDEST_GATE_M else []


_MANY_ROWS = 20


def _without_identity(*tables: TruthTable | TrackTable) -> list[str]:
    """Return a note per table in which no id occurs twice, in many rows."""
    return [
        f"{each.source}: no id is in two of {each.id.size} rows, as of detections; the same id from frame to frame, for a "
        "person or a track, is expected"
        for each in tables
        if each.id.size >= _MANY_ROWS and np.unique(each.id).size == each.id.size
    ]


def _matched_pairs(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> dict[str, NDArray[Any]]:
    """Collect the k pairs of all frames, and count the unpaired in each of the f frames."""
    frames = list(zip(judged, matches, strict=True))
    return {
        "misses": np.array([f.person_ids.size - p.rows.size for f, p in frames]),
        "false_positives": np.array([f.track_ids.size - p.rows.size for f, p in frames]),
        "match_stamps_ns": np.concatenate([np.full(p.rows.size, f.stamp_ns, dtype=np.int64) for f, p in frames]),
        "match_person_ids": np.concatenate([f.person_ids[p.rows] for f, p in frames]),
        "match_track_ids": np.concatenate([f.track_ids[p.columns] for f, p in frames]),
        "match_distances_m": np.concatenate([p.distances for _, p in frames]),
    }


def _set_distances(pair_matrices: Sequence[PairMatrix]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute OSPA and GOSPA [m] of each frame, (f,) each."""
    ospa_m = np.array([ospa(pairs.values, CUTOFF_M, OSPA_ORDER) for pairs in pair_matrices])
    return ospa_m, np.array([gospa(pairs.values, CUTOFF_M, GOSPA_ORDER).distance for pairs in pair_matrices])


def _wide_metrics(frames: Sequence[Frame]) -> dict[str, Any]:
    """Compute `at_1m` of `metrics.json`."""
    _, pair_matrices, matches = _inside(frames, match_all_people(frames, WIDE_GATE_M), WIDE_GATE_M)
    found = _matrix_metrics(pair_matrices, WIDE_GATE_M, matches, clear(pair_matrices, WIDE_GATE_M, matches))
    return {name: found[name] for name in ("mota", "motp_m", "idf1", "hota", "id_switches")}


def _matrix_metrics(
    pair_matrices: Sequence[PairMatrix], gate_m: float, matches: Sequence[FrameMatches], scores: ClearScores
) -> dict[str, Any]:
    """Compute the metrics that need only the distances; `matches` and their `scores` at this gate."""
    similarities = [
        PairMatrix(pairs.person_ids, pairs.track_ids, np.maximum(0.0, 1.0 - pairs.values / (2 * gate_m)))
        for pairs in pair_matrices
    ]
    higher_order = hota(similarities)
    applies = higher_order.applies
    return {
        "mota": scores.mota,
        "motp_m": scores.motp,
        "idf1": identity(pair_matrices, gate_m).idf1,
        "hota": float(higher_order.hota.mean()) if applies else None,
        "hota_cap": hota_cap(
            1 - np.concatenate([pairs.distances for pairs in matches]) / (2 * gate_m),
            np.concatenate([of.person_ids[pairs.rows] for of, pairs in zip(pair_matrices, matches, strict=True)]),
        ),
        "deta": float(higher_order.det_a.mean()) if applies else None,
        "assa": float(higher_order.ass_a.mean()) if applies else None,
        "id_switches": scores.id_switches,
    }


def _pose_errors(judged: Sequence[Frame], matches: Sequence[FrameMatches]) -> tuple[dict[str, Any], int]:
    """Compute absolute errors of the head per axis [m] and in yaw [rad], and of the pelvis's height [m]; None: not
    estimated.

    Also returns the number of matches with a head in both truth and track.
    """
    gaps = np.concatenate(
        [
            frame.track_pose[pairs.columns] - frame.person_pose[pairs.rows]
            for frame, pairs in zip(judged, matches, strict=True)
        ]
    )  # (k, 5)
    gaps[:, 3] = wrap_angle(gaps[:, 3])
    means = [_mean_absolute(gaps[:, axis]) for axis in range(5)]
    turned = np.abs(gaps[:, 3][~np.isnan(gaps[:, 3])])
    errors = {
        "head_error_m": dict(zip("xyz", means[:3], strict=True)),
        "head_yaw_error_rad": means[3],
        "head_yaw_median_rad": float(np.median(turned)) if turned.size else None,
        "body_height_error_m": means[4],
    }
    return errors, int(np.count_nonzero(~np.isnan(gaps[:, :3]).any(axis=1)))


def _aligned(truth: TruthTable, tracks: TrackTable, gate_m: float) -> Alignment:
    _check_gate(gate_m)
    _check_tables(truth, tracks)
    aligned = align(truth, tracks)
    _check_size(aligned.frames, tracks.source)
    return aligned


def _notes_of_tables(
    truth: TruthTable, tracks: TrackTable, aligned: Alignment, n_person: int, gate_m: float
) -> tuple[str, ...]:
    return (
        *truth.notes,
        *tracks.notes,
        *_wide_gate(gate_m),
        *_without_identity(truth, tracks),
        *aligned.notes,
        *_all_outside(aligned.frames, n_person, truth.source),
    )


def _mean_absolute(values: NDArray[np.float64]) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.abs(known).mean()) if known.size else None


@dataclass(frozen=True)
class Gospa:
    """GOSPA [m] with α = 2, and its parts [m^p]: distance = (localisation + missed + false)^(1/p)."""

    distance: float
    localisation: float
    missed: float
    false: float


def ospa(distances: NDArray[np.float64], cutoff: float, order: float) -> float:
    """Compute OSPA [m] of distances (n, m) [m] between people and tracks; 0 for two empty sets.

    Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object filters", 2008.

    Each distance counts `cutoff` at most, each surplus person or track `cutoff`; averaged over the larger of the two sets.
    """
    n, m = distances.shape
    if max(n, m) == 0:
        return 0.0
    costs = np.minimum(distances, cutoff) ** order
    total = costs[linear_sum_assignment(costs)].sum() + cutoff**order * abs(n - m)
    return float((total / max(n, m)) ** (1 / order))


def gospa(distances: NDArray[np.float64], cutoff: float, order: float) -> Gospa:
    """Compute GOSPA with α = 2 of distances (n, m) [m]; not averaged.

    Pairs nearer than `cutoff` cost their distance, every unpaired person and track half a cut-off, to the power of `order`.
    Rahmathullah, García-Fernández and Svensson, "Generalized optimal sub-pattern assignment metric", 2017.
    """
    n, m = distances.shape
    costs = np.minimum(distances, cutoff) ** order
    rows, columns = linear_sum_assignment(costs)
    paired = distances[rows, columns] < cutoff
    n_paired = int(np.count_nonzero(paired))
    half = cutoff**order / 2
    localisation = float(costs[rows, columns][paired].sum())
    missed, false = half * (n - n_paired), half * (m - n_paired)
    return Gospa(float((localisation + missed + false) ** (1 / order)), localisation, missed, false)
