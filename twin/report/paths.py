"""Paths over the room: where people walked and where each track says they did."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape

import numpy as np

from trackers.observations import NS_PER_S
from trackers.rig import Rig
from twin.evaluate.summary import Evaluation
from twin.recording.tables import TrackTable, TruthTable
from twin.report.beliefs import beliefs_svg
from twin.report.birdseye import FloorView, Polygon, floor_extent, room_svg, sensor_names_svg, svg_path
from twin.report.error_causes import cause_marks
from twin.report.palette import IdentityColours
from twin.report.scan_density import ScanDensity
from twin.report.spans import unbroken, usual_period_ns
from twin.report.timeline import describe

_WIDTH_PX = 1000
_STANDING = 0.05  # share of the greatest count from which a cell is taken for something that stands
_LONG_NS = 90 * NS_PER_S  # beyond, paths cover each other and are drawn lighter


def path_map(
    rig: Rig,
    true_rig: Rig | None,
    outline: Sequence[Polygon],
    truth: TruthTable | None,
    tracks: TrackTable,
    evaluation: Evaluation | None,
    scans: ScanDensity | None,
    colours: IdentityColours,
    names: Mapping[int, str],
    silent: Collection[str] = (),
) -> str:
    """SVG: the room (or, without a plan, what the scans hit), true paths thin and grey, tracks in their colours.

    A track is solid while confirmed and dashed while it coasts; its id stands where it ends. Sensors are drawn where they
    truly are (`true_rig`), and dashed where trackers believe them (`rig`); those that reported nothing are hollow.
    """
    hits = []
    if scans is not None:
        cells, counts = scans.cells()
        hits.append(cells[counts > _STANDING * counts.max(initial=0)])
    view = FloorView.fit(
        floor_extent(true_rig or rig, outline, *hits, np.column_stack([tracks.x, tracks.y])), _WIDTH_PX
    )
    parts = [room_svg(view, true_rig or rig, outline, silent), beliefs_svg(view, rig, true_rig)]
    if scans is not None:
        parts.append(f'<image href="{scans.png(view)}" width="{view.width_px}" height="{view.height_px}"/>')
    if truth is not None:
        parts.append(_true_paths(view, truth, tracks, names))
    parts.append(_track_paths(view, tracks, colours))
    parts.append(sensor_names_svg(view, true_rig or rig, silent))
    if evaluation is not None:
        parts.append(cause_marks(view, evaluation.errors))
        parts.extend(_event_marks(view, tracks, evaluation, names))
    span_ns = np.ptp(tracks.frame_stamps_ns) if tracks.frame_stamps_ns.size else 0
    kind = "map long" if span_ns > _LONG_NS else "map"
    return (
        f'<svg class="{kind}" viewBox="0 0 {view.width_px} {view.height_px}" role="img" '
        f'aria-label="Paths over the room, from above">{"".join(parts)}</svg>'
    )


def _true_paths(view: FloorView, truth: TruthTable, tracks: TrackTable, names: Mapping[int, str]) -> str:
    period = usual_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    parts = []
    for person in np.unique(truth.id).tolist():
        rows = np.flatnonzero(truth.id == person)
        pixels = view.pixels(np.column_stack([truth.x[rows], truth.y[rows]]))
        line = "".join(svg_path(pixels[piece]) for piece in unbroken(truth.stamps_ns[rows], period) if piece.size > 1)
        name = escape(names.get(person, f"person {person}"))
        x, y = pixels[0]
        parts.append(
            f'<g><path class="true" d="{line}"/><circle class="start" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'
            f'<text class="who halo" x="{x + 8:.1f}" y="{y + 4:.1f}">{name}</text><title>{name}, truth</title></g>'
        )
    return "".join(parts)


def _track_paths(view: FloorView, tracks: TrackTable, colours: IdentityColours) -> str:
    period = usual_period_ns(tracks.frame_stamps_ns)
    lines, labels = [], []
    placed: list[tuple[float, float]] = []
    for track in np.unique(tracks.id).tolist():
        rows = np.flatnonzero(tracks.id == track)
        pixels = view.pixels(np.column_stack([tracks.x[rows], tracks.y[rows]]))
        coasting = (tracks.status[rows] == "coasting").astype(np.int64)
        slot = colours.slot(track)
        for piece in unbroken(tracks.stamps_ns[rows], period):
            for part in unbroken(tracks.stamps_ns[rows][piece], period, coasting[piece]):
                own = piece[part]
                # From the sample before on, so that a change of status leaves no hole.
                joined = np.concatenate([own[:1] - 1, own]) if own[0] > piece[0] else own
                if joined.size > 1:
                    state = " coasting" if coasting[own[0]] else ""
                    line = svg_path(pixels[joined])
                    lines.append(f'<path class="s{slot} track{state}" d="{line}"><title>#{track}</title></path>')
        x, y = pixels[-1]
        while any(abs(x - other_x) < 26 and abs(y - other_y) < 13 for other_x, other_y in placed):
            y -= 13
        placed.append((x, y))
        lines.append(f'<circle class="f{slot}" cx="{pixels[-1, 0]:.1f}" cy="{pixels[-1, 1]:.1f}" r="4.5"/>')
        labels.append(f'<text class="f{slot} last halo" x="{x + 8:.1f}" y="{y + 4:.1f}">#{track}</text>')
    return "".join(lines + labels)


def _event_marks(view: FloorView, tracks: TrackTable, evaluation: Evaluation, names: Mapping[int, str]) -> list[str]:
    """A ring where a track's break happened, on the track."""
    marks = []
    for event in evaluation.events:
        rows = np.flatnonzero((tracks.id == event.track_id) & (tracks.stamps_ns == event.stamp_ns))
        if rows.size:
            x, y = view.pixels(np.array([tracks.x[rows[0]], tracks.y[rows[0]]]))
            text = escape(f"{event.kind}: {describe(event, names)}")
            marks.append(f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="9"><title>{text}</title></circle>')
    return marks
