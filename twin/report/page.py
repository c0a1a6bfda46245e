"""Report of a run: one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from trackers.observations import NS_PER_S
from trackers.rig import Rig
from twin.evaluate.accuracy import WITHIN, calibration_curve
from twin.evaluate.causes import FALSE_POSITIVES, MISSES, POSTURES, Errors
from twin.evaluate.continuity import track_counts
from twin.evaluate.summary import Evaluation
from twin.recording.atomic_file import write_atomic
from twin.recording.tables import TrackTable, TruthTable
from twin.report.birdseye import Site
from twin.report.metrics_table import METRICS, format_judged, format_number, grouped_rows, headline_rows, judged_note
from twin.report.palette import IDENTITY_COLOURS, IdentityColours, data_uri, hex_colour, page_template
from twin.report.path_map import Drive, ScanDensity, path_map, standing
from twin.report.sensor_stills import RunPictures
from twin.report.time_axis import TimeAxis, time_origin_ns
from twin.report.timeline import describe_event, distance_chart, glyph, identity_timeline, track_timeline

_SIDE, _LEFT, _TOP, _BOTTOM, _RIGHT = 220.0, 44.0, 10.0, 40.0, 190.0
_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)

Curve = Sequence[tuple[float, float]]
"""Stated and found shares, by probability."""


def calibration_chart(curves: Sequence[tuple[str, int, Curve]]) -> str:
    """Draw curves as SVG: the name of a tracker, its index among all (for its colour), and its curve.

    On the diagonal a tracker is calibrated; below it is overconfident.
    """
    width, height = _LEFT + _SIDE + _RIGHT, _TOP + _SIDE + _BOTTOM
    parts = [
        f'<svg viewBox="0 0 {width:g} {height:g}" style="max-width:{width:g}px;min-width:0" role="img" '
        'aria-label="Calibration of the stated radii">',
        f'<path class="frame" fill="none" d="M{_x(0):g} {_y(0):g}V{_y(1):g}H{_x(1):g}V{_y(0):g}Z"/>',
        f'<path class="frame" stroke-dasharray="3 3" d="M{_x(0):g} {_y(0):g}L{_x(1):g} {_y(1):g}"/>',
    ]
    for share in _TICKS:
        parts.append(
            f'<text class="axis" x="{_x(share):g}" y="{_y(0) + 15:g}" text-anchor="middle">{100 * share:g}</text>'
            f'<text class="axis" x="{_LEFT - 6:g}" y="{_y(share) + 4:g}" text-anchor="end">{100 * share:g}</text>'
        )
    parts.append(
        f'<text class="axis" x="{_x(0.5):g}" y="{height - 6:g}" text-anchor="middle">claimed [%]</text>'
        f'<text class="axis" transform="translate(11 {_y(0.5):g}) rotate(-90)" text-anchor="middle">found [%]</text>'
    )
    for row, (name, slot, curve) in enumerate(curves):
        colour, y = slot % len(IDENTITY_COLOURS), _TOP + 14 + 18 * row
        points = "L".join(f"{_x(claimed):.1f} {_y(found):.1f}" for claimed, found in curve)
        parts.append(f'<path class="s{colour}" fill="none" stroke-width="2" d="M{points}"/>')
        parts += [
            f'<circle class="f{colour}" cx="{_x(claimed):.1f}" cy="{_y(found):.1f}" r="2.6">'
            f"<title>{escape(name)}: {found:.1%} within what it claims for {claimed:.0%}</title></circle>"
            for claimed, found in curve
        ]
        x = _LEFT + _SIDE + 14
        parts.append(
            f'<path class="s{colour}" stroke-width="3" d="M{x:g} {y - 4:g}h14"/>'
            f'<text x="{x + 20:g}" y="{y:g}">{escape(name)}</text>'
        )
    return "".join(parts) + "</svg>"


def _x(share: float) -> float:
    return _LEFT + share * _SIDE


def _y(share: float) -> float:
    return _TOP + (1 - share) * _SIDE


_MOST_EVENTS = 500
EVENT_NAMES = {"switch": "identity switch", "misidentification": "misidentified", "lost": "lost"}


@dataclass(frozen=True)
class TrackerResult:
    """One tracker's run; without truth there is no evaluation.

    ms_per_frame: mean and p95 [ms], None if unknown; note: on its paths, for the caption.
    """

    name: str
    tracks: TrackTable
    evaluation: Evaluation | None = None
    ms_per_frame: Mapping[str, float | None] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run, for the head and the foot of the page.

    title: the scenario or recording; versions: all that determine the result, by name; sensors: by name, `frames` and
    `ms_mean` (None: unknown) as in `metrics.json`; command: repeats the run; notes: sentences on the physics, the
    background, discarded data; start_stamp_ns: the stamp of t = 0 [ns].
    """

    title: str
    duration_s: float
    seed: int | None = None
    description: str = ""
    realtime_factor: float | None = None
    versions: Mapping[str, str | None] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    command: str = ""
    start_stamp_ns: int = 0
    notes: Sequence[str] = ()


_FAR_M = (3.0, 6.0)

DISTANCES = (f"up to {_FAR_M[0]:g}\u00a0m", f"to {_FAR_M[1]:g}\u00a0m", "farther")
"""Headings of the last columns of the table, by distance from the nearest sensor."""


@dataclass(frozen=True)
class CauseRow:
    """One cause that occurred: its name and meaning, frames in total, by posture (None for tracks), by distance."""

    name: str
    meaning: str
    frames: int
    by_posture: tuple[int | None, ...]
    by_distance: tuple[int, ...]


def cause_rows(errors: Errors, rig: Rig, drives: Sequence[Drive] = ()) -> list[CauseRow]:
    """Count the errors of each cause that occurred, misses first; sensors on a base are where it is at the time."""
    still = standing(rig)
    places = [np.broadcast_to(still.pose_at(name).translation[:2], errors.xy.shape) for name in still.sensors]
    places += [each.at(errors.stamps_ns) for each in drives]
    distances_m = [np.linalg.norm(errors.xy - each, axis=1) for each in places]
    distance_m = np.min([np.full(len(errors.xy), np.inf), *distances_m], axis=0)
    ring = np.digitize(distance_m, _FAR_M)
    rows = []
    for kind, causes in (("missed", MISSES), ("false_positive", FALSE_POSITIVES)):
        for cause in causes:
            mine = errors.cause == cause
            if mine.any():
                metric = METRICS[f"errors.{kind}.{cause}"]
                postures = [int(np.count_nonzero(mine & (errors.posture == each))) for each in POSTURES]
                rows.append(
                    CauseRow(
                        metric.name,
                        metric.meaning,
                        int(np.count_nonzero(mine)),
                        tuple(postures) if kind == "missed" else (None,) * len(POSTURES),
                        tuple(np.bincount(ring[mine], minlength=len(DISTANCES)).tolist()),
                    )
                )
    return rows


def write_report(
    path: Path,
    facts: RunFacts,
    trackers: Sequence[TrackerResult],
    site: Site,
    *,
    truth: TruthTable | None = None,
    scans: ScanDensity | None = None,
    pictures: RunPictures | None = None,
    silent: Collection[str] = (),
    drives: Sequence[Drive] = (),
    links: Mapping[str, str] | None = None,
) -> None:
    """Write the report to `path`; it takes its name when complete.

    `scans`: returns of the scanners, drawn under the paths (for a recording without a plan of the room); `silent`: sensors
    without reports; `drives`: ways of moving bases; `pictures`: stills of the sensors; `links`: files beside the page by kind,
    of which 'preview' is the video shown.

    Raises InputError where the file cannot be written, ValueError for an evaluation without truth.
    """
    for tracker in trackers:
        if tracker.evaluation is not None and truth is None:
            raise ValueError(f"tracker {tracker.name!r} has an evaluation, but no truth was handed in")
    axis = _axis(truth, [tracker.tracks for tracker in trackers])
    metrics = [_metrics(tracker) for tracker in trackers]
    page = page_template("twin.report", "page.html.j2").render(
        facts=facts,
        tracker_names=[tracker.name for tracker in trackers],
        groups=grouped_rows(metrics),
        timed=any(cost.get("ms_mean") is not None for cost in facts.sensors.values()),
        judged=[format_judged(own) for own in metrics],
        judged_note=judged_note({each.name: own for each, own in zip(trackers, metrics, strict=True)}),
        sections=[
            _section(tracker, own, axis, site, truth, scans, silent, drives)
            for tracker, own in zip(trackers, metrics, strict=True)
        ],
        has_truth=truth is not None,
        n_people=0 if truth is None else int(np.unique(truth.id).size),
        postures=POSTURES,
        distances=DISTANCES,
        sensors_seen=[] if truth is None else list(truth.visible),
        glyphs=[(Markup(glyph(kind)), name) for kind, name in EVENT_NAMES.items()],
        headline=headline_rows(metrics),
        stills=[] if pictures is None else [(data_uri(each.jpeg), each) for each in pictures.stills],
        stills_at="" if pictures is None else axis.format(pictures.stamp_ns),
        poster=data_uri(pictures.poster) if pictures is not None and pictures.poster else "",
        links=dict(links or {}),
        shown=f"{axis.format(axis.start_ns).removesuffix(' s')} to {axis.format(axis.end_ns)}",
        slots=[hex_colour(colour) for colour in IDENTITY_COLOURS],
    )
    write_atomic(path, page)


def _axis(truth: TruthTable | None, tables: Sequence[TrackTable]) -> TimeAxis:
    stamps = [table.frame_stamps_ns for table in (*([truth] if truth is not None else []), *tables)]
    known = np.concatenate([part for part in stamps if part.size] or [np.array([0, NS_PER_S])])
    first, last = int(known.min()), int(known.max())
    return TimeAxis(first, max(last, first + NS_PER_S // 10), time_origin_ns(first))


def _metrics(tracker: TrackerResult) -> dict[str, Any]:
    measured = tracker.evaluation.metrics if tracker.evaluation is not None else {}
    return {**measured, "ms_per_frame": tracker.ms_per_frame}


def _section(
    tracker: TrackerResult,
    metrics: Mapping[str, Any],
    axis: TimeAxis,
    site: Site,
    truth: TruthTable | None,
    scans: ScanDensity | None,
    silent: Collection[str],
    drives: Sequence[Drive],
) -> dict[str, Any]:
    """Build the content of the page for one tracker."""
    tracks, evaluation, names = tracker.tracks, tracker.evaluation, site.person_names
    ids, first = np.unique(tracks.id, return_index=True)
    colours = IdentityColours(ids[np.argsort(first, kind="stable")].tolist())
    section: dict[str, Any] = {
        "name": tracker.name,
        "map": Markup(path_map(site, truth, tracks, evaluation, scans, colours, silent, drives)),
        "note": tracker.note,
        "drives": drives,
        "unplaced": sorted(site.rig.mounted().keys() - {name for each in drives for name in each.sensors}),
        "n_tracks": int(ids.size),
        "tiles": [],
        "counts": [],
        "judged": "",
        "events": [],
        "n_events_left_out": 0,
        "distances": "",
        "timeline": "",
        "merges": 0,
        "causes": [],
        "calibration": "",
    }
    if truth is not None and evaluation is not None:
        section["tiles"] = [(row.metric, row.cells[0]) for row in headline_rows([metrics])]
        section["judged"] = format_judged(metrics)
        section["gate"] = f"{evaluation.metrics['gate_m']:g} m"
        section["distances"] = Markup(distance_chart(axis, truth, tracks, evaluation, colours, names))
        section["timeline"] = Markup(identity_timeline(axis, truth, tracks, evaluation, colours, names))
        section["causes"] = cause_rows(evaluation.errors, site.rig, drives)
        if curve := calibration_curve(metrics):
            section["calibration"] = Markup(calibration_chart([(tracker.name, 0, curve)]))
            section["n_radius"] = metrics[WITHIN]["n"]
        situations = evaluation.situations
        section["merges"] = 0 if situations is None else len(situations.select("merged_rig"))
        section["events"] = [
            (axis.format(event.stamp_ns), EVENT_NAMES[event.kind], describe_event(event, names))
            for event in evaluation.events[:_MOST_EVENTS]
        ]
        section["n_events_left_out"] = max(0, len(evaluation.events) - _MOST_EVENTS)
    else:
        section["counts"] = _counts(tracks)
        section["timeline"] = Markup(track_timeline(axis, tracks, colours)) if ids.size else ""
    return section


def _counts(tracks: TrackTable) -> list[tuple[str, str, str]]:
    """Format what tracks say without any truth: value, unit and meaning."""
    counts = track_counts(tracks)
    coasting = counts["coasting"]
    return [
        (format_number(counts["tracks_per_frame"], 2), "", "tracks per frame, mean"),
        (format_number(counts["most_per_frame"], 0), "", "tracks per frame, most"),
        (str(counts["track_count"]), "", "tracks in all"),
        (format_number(counts["duration_s"]["median"], 1), "s", "length of a track, median"),
        (format_number(counts["duration_s"]["longest"], 1), "s", "length of a track, longest"),
        (format_number(None if coasting is None else 100 * coasting, 1), "%", "of rows are predictions (coasting)"),
    ]
