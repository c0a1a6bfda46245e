"""Timelines of a run: tracks per person, breaks of identity, false tracks, and distances over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from twin.evaluate.continuity import TrackEvent
from twin.evaluate.summary import Evaluation
from twin.recording.situation_table import SituationTable
from twin.recording.tables import TrackTable, TruthTable
from twin.report.birdseye import svg_path
from twin.report.palette import IDENTITY_COLOURS, IdentityColours, is_light
from twin.report.time_axis import (
    LEFT,
    RIGHT,
    WIDTH,
    Span,
    TimeAxis,
    median_period_ns,
    spans_of,
    split_at_gaps,
    subtract_spans,
)

_BAR = 20
_STRIP = 4
_LEVELS = 5  # shades of hiddenness
_GLYPHS = {
    "switch": '<path class="glyph" d="M0 -6.5L6 4.5H-6Z"/>',
    "misidentification": '<path class="glyph cross" d="M-5 -5L5 5M-5 5L5 -5"/>',
    "lost": '<path class="glyph hollow" d="M0 -6.5L6.5 0L0 6.5L-6.5 0Z"/>',
}


def glyph(kind: str) -> str:
    """Return the mark of a kind of event, an SVG for a legend."""
    return f'<svg class="key" viewBox="-9 -9 18 18" aria-hidden="true">{_GLYPHS[kind]}</svg>'


def describe_event(event: TrackEvent, names: Mapping[int, str]) -> str:
    """Describe an event in one sentence."""
    person = names.get(event.person_id, f"person {event.person_id}")
    match event.kind:
        case "switch":
            return f"{person} goes on as #{event.track_id}, was #{event.previous_track_id}"
        case "misidentification":
            before = event.previous_person_id
            previous = names.get(before, f"person {before}") if before is not None else "another person"
            return f"#{event.track_id} goes on with {person}, was {previous}"
        case "lost":
            return f"#{event.track_id} ends while {person} stays"


def identity_timeline(
    axis: TimeAxis,
    truth: TruthTable,
    tracks: TrackTable,
    evaluation: Evaluation,
    colours: IdentityColours,
    names: Mapping[int, str],
) -> str:
    """Draw as SVG a row per person, coloured by the matched track, with marks at breaks; false tracks below.

    The line over a row marks when the scanners together cannot separate the person from another; the strips under it show
    how hidden the person is from each sensor (darker: more hidden).
    """
    period = median_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    strips = len(truth.visible)
    parts, y = [], 0.0
    for person in np.unique(truth.id).tolist():
        rows = truth.id == person
        present = spans_of(truth.stamps_ns[rows & truth.in_area], period)
        mine = evaluation.match_person_ids == person
        matched = spans_of(evaluation.match_stamps_ns[mine], period, evaluation.match_track_ids[mine])
        bar = y + 16
        parts.append(_row_name(names.get(person, f"person {person}"), bar))
        parts.append(_present(axis, present, bar + _BAR / 2))
        parts.append(_bars(axis, matched, bar, colours))
        for place, (sensor, share) in enumerate(truth.visible.items()):
            top = bar + _BAR + 2 + place * (_STRIP + 1)
            parts.append(_hidden_strip(axis, truth.stamps_ns[rows], share[rows], period, top, sensor))
        parts.append(_merged(axis, evaluation.situations, person, bar - 4, names))
        parts.append(_marks(axis, [event for event in evaluation.events if event.person_id == person], y + 8, names))
        y = bar + _BAR + strips * (_STRIP + 1) + 6
    false_stamps, false_ids = false_positive_tracks(truth, tracks, evaluation)
    if false_ids.size:
        parts.append(f'<path class="rule" d="M0 {y + 8:.0f}H{WIDTH}"/>')
        parts.append(f'<text class="group" x="0" y="{y + 24:.0f}">Tracks without a person</text>')
        y += 30
        lanes = _lanes(
            sorted(
                (
                    span
                    for track in np.unique(false_ids).tolist()
                    for span in spans_of(
                        false_stamps[false_ids == track], period, np.full(np.count_nonzero(false_ids == track), track)
                    )
                ),
                key=lambda span: (span.start_ns, span.label),
            )
        )
        for lane in lanes:
            parts.append(_bars(axis, lane, y, colours, height=14, kind="false"))
            y += 18
    return axis.chart(y + 6, "".join(parts), "Timeline of identities, one row per person")


def track_timeline(axis: TimeAxis, tracks: TrackTable, colours: IdentityColours) -> str:
    """Draw as SVG a row per track in order of appearance, solid while confirmed, pale while it coasts."""
    period = median_period_ns(tracks.frame_stamps_ns)
    ids, first = np.unique(tracks.id, return_index=True)
    height = 16 if ids.size <= 40 else 10
    parts, y = [], 4.0
    for track in ids[np.argsort(first, kind="stable")].tolist():
        rows = tracks.id == track
        # Pale for all of its life, solid over it while confirmed.
        stamps, confirmed = tracks.stamps_ns[rows], tracks.status[rows] == "confirmed"
        for state, seen in (("coasting", stamps), ("confirmed", stamps[confirmed])):
            for span in spans_of(seen, period):
                bar = Span(span.start_ns, span.end_ns, track)
                parts.append(_bar(axis, bar, y, colours, height, state, f"#{track} {state}", named=False))
        # The name stands before the bar, for short bars too; at the left edge it would be cut.
        x = max(float(axis.x(int(stamps[0]))) - 6, LEFT - 6)
        parts.append(f'<text class="id" x="{x:.1f}" y="{y + height - 3:.1f}" text-anchor="end">#{track}</text>')
        y += height + 3
    return axis.chart(y + 4, "".join(parts), "Timeline of tracks, one row per track")


def false_positive_tracks(
    truth: TruthTable, tracks: TrackTable, evaluation: Evaluation
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the tracks counted as false positives: stamps and ids, (n,) each, ordered by stamp.

    The evaluation gives their number per frame. Further unmatched tracks are of people outside the tracked area: those
    nearest to a person outside.
    """
    matched = set(zip(evaluation.match_stamps_ns.tolist(), evaluation.match_track_ids.tolist(), strict=True))
    counted = dict(zip(evaluation.stamps_ns.tolist(), evaluation.false_positives.tolist(), strict=True))
    unmatched: dict[int, list[int]] = {}
    for row, (stamp, track) in enumerate(zip(tracks.stamps_ns.tolist(), tracks.id.tolist(), strict=True)):
        if counted.get(stamp, 0) and (stamp, track) not in matched:
            unmatched.setdefault(stamp, []).append(row)
    chosen: list[int] = []
    outside = np.flatnonzero(~truth.in_area)
    for stamp, rows in unmatched.items():
        if len(rows) > counted[stamp]:
            near = outside[np.abs(truth.stamps_ns[outside] - stamp) <= 125_000_000]
            gap = np.hypot(tracks.x[rows][:, None] - truth.x[near], tracks.y[rows][:, None] - truth.y[near]).min(
                axis=1, initial=np.inf
            )
            rows = [rows[i] for i in np.argsort(-gap, kind="stable")[: counted[stamp]]]
        chosen.extend(sorted(rows))
    return tracks.stamps_ns[chosen], tracks.id[chosen]


def missed_spans(truth: TruthTable, tracks: TrackTable, evaluation: Evaluation, person: int) -> list[Span]:
    """Find the spans in which a person was in the tracked area and no track was matched."""
    period = median_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    present = spans_of(truth.stamps_ns[(truth.id == person) & truth.in_area], period)
    matched = spans_of(evaluation.match_stamps_ns[evaluation.match_person_ids == person], period)
    return subtract_spans(present, matched, period // 2)


def _marks(axis: TimeAxis, events: Sequence[TrackEvent], y: float, names: Mapping[int, str]) -> str:
    """Draw the marks of events in order of time; overlapping ones stand side by side."""
    parts, x = [], -np.inf
    for event in events:
        x = max(_clip(axis, event.stamp_ns), x + 13)
        parts.append(
            f'<g class="event" transform="translate({x:.1f} {y:.1f})">{_GLYPHS[event.kind]}'
            f"<title>{axis.format(event.stamp_ns)}: {escape(describe_event(event, names))}</title></g>"
        )
    return "".join(parts)


def _row_name(name: str, bar: float) -> str:
    shown = name if len(name) <= 14 else name[:13] + "…"
    return f'<text class="name" x="{LEFT - 10}" y="{bar + 14.5:.1f}" text-anchor="end">{escape(shown)}</text>'


def _present(axis: TimeAxis, stretches: Sequence[Span], y: float) -> str:
    line = "".join(f"M{_clip(axis, span.start_ns):.1f} {y:.1f}H{_clip(axis, span.end_ns):.1f}" for span in stretches)
    return f'<path class="present" d="{line}"/>' if line else ""


def _bars(
    axis: TimeAxis, stretches: Sequence[Span], y: float, colours: IdentityColours, height: int = _BAR, kind: str = ""
) -> str:
    return "".join(
        _bar(axis, span, y, colours, height, kind, f"#{span.label}{' (false positive)' if kind == 'false' else ''}")
        for span in stretches
    )


def _bar(
    axis: TimeAxis,
    span: Span,
    y: float,
    colours: IdentityColours,
    height: int,
    kind: str,
    title: str,
    named: bool = True,
) -> str:
    start, end = _clip(axis, span.start_ns), _clip(axis, span.end_ns)
    slot = colours.slot(span.label)
    text = ""
    if named and end - start > 12 + 8 * len(str(span.label)):
        ink = "dark" if is_light(IDENTITY_COLOURS[slot]) else "pale"
        text = f'<text class="id {ink}" x="{start + 5:.1f}" y="{y + height / 2 + 4:.1f}">#{span.label}</text>'
    when = f"{axis.format(span.start_ns)} to {axis.format(span.end_ns)}"
    # Slightly narrower, so that two bars of similar colours stay apart.
    width = max(end - start - (0.8 if named else 0.0), 0.8)
    return (
        f'<rect class="f{slot} {kind}" x="{start:.1f}" y="{y:.1f}" width="{width:.1f}" '
        f'height="{height}" rx="2"><title>{title}, {when}</title></rect>{text}'
    )


def _hidden_strip(
    axis: TimeAxis, stamps_ns: NDArray[np.int64], share: NDArray[np.float64], period: int, y: float, sensor: str
) -> str:
    known = ~np.isnan(share)
    level = np.round((1 - share[known]) * _LEVELS).astype(np.int64)
    column = np.floor(axis.x(stamps_ns[known]) * 2).astype(np.int64)  # half a unit wide, the visible limit
    first = np.flatnonzero(np.diff(column, prepend=-1))
    if first.size == 0:
        return ""
    worst, stamps = np.maximum.reduceat(level, first), stamps_ns[known][first]
    step = max(period, median_period_ns(stamps))
    boxes: dict[int, str] = {}
    for span in spans_of(stamps, step, worst):
        start, end = _clip(axis, span.start_ns), _clip(axis, span.end_ns)
        boxes[span.label] = boxes.get(span.label, "") + f"M{start:.1f} {y:.1f}H{end:.1f}v{_STRIP}H{start:.1f}Z"
    shaded = "".join(
        f'<path class="hidden" opacity="{0.1 + 0.9 * level / _LEVELS:.2f}" d="{d}"/>'
        for level, d in boxes.items()
        if level
    )
    seen = f'<path class="seen" d="{boxes[0]}"/>' if 0 in boxes else ""
    return f"<g>{seen}{shaded}<title>{escape(sensor)}: hidden where dark</title></g>"


def _merged(axis: TimeAxis, situations: SituationTable | None, person: int, y: float, names: Mapping[int, str]) -> str:
    """Draw lines for the merges of a person with others for all scanners of the rig."""
    if situations is None:
        return ""
    merged = situations.select("merged_rig")
    parts = []
    for row in np.flatnonzero((merged.first_id == person) | (merged.second_id == person)).tolist():
        other = int(merged.first_id[row] + merged.second_id[row]) - person
        start_ns, end_ns = int(merged.start_ns[row]), int(merged.end_ns[row])
        title = f"merged with {names.get(other, f'person {other}')}, {axis.format(start_ns)} to {axis.format(end_ns)}"
        line = f"M{_clip(axis, start_ns):.1f} {y:.1f}H{_clip(axis, end_ns):.1f}"
        parts.append(f'<path class="merged" d="{line}"><title>{escape(title)}</title></path>')
    return "".join(parts)


def _lanes(stretches: Sequence[Span]) -> list[list[Span]]:
    """Pack spans, ordered by start, into as few rows as possible without overlap."""
    lanes: list[list[Span]] = []
    for span in stretches:
        lane = next((lane for lane in lanes if lane[-1].end_ns <= span.start_ns), None)
        if lane is None:
            lanes.append([span])
        else:
            lane.append(span)
    return lanes


def _clip(axis: TimeAxis, stamp_ns: int) -> float:
    return float(np.clip(axis.x(stamp_ns), LEFT, WIDTH - RIGHT))


_ROW = 52
_PLOT = 42


def distance_chart(
    axis: TimeAxis,
    truth: TruthTable,
    tracks: TrackTable,
    evaluation: Evaluation,
    colours: IdentityColours,
    names: Mapping[int, str],
) -> str:
    """Draw as SVG a row per person: distance [m] to the matched track (in its colour) from 0 to the gate; misses shaded.

    With more frames than columns, the line is the mean of each column, in a band from its least to its greatest distance.
    """
    gate_m = float(evaluation.metrics["gate_m"])
    period = median_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    parts = []
    persons = np.unique(truth.id).tolist()
    for row, person in enumerate(persons):
        base = row * _ROW + _PLOT + 6
        mine = evaluation.match_person_ids == person
        stamps, labels = evaluation.match_stamps_ns[mine], evaluation.match_track_ids[mine]
        distances = evaluation.match_distances_m[mine]
        mean = f"mean {distances.mean():.2f} m" if distances.size else "never matched"
        missed = "".join(
            f"M{x0:.1f} {base - _PLOT}H{x1:.1f}V{base}H{x0:.1f}Z"
            for x0, x1 in (
                np.clip(axis.x(np.array([span.start_ns, span.end_ns])), LEFT, WIDTH - RIGHT)
                for span in missed_spans(truth, tracks, evaluation, person)
            )
        )
        if missed:
            parts.append(f'<path class="missed" d="{missed}"><title>no track within {gate_m:g} m</title></path>')
        parts.append(
            f'<path class="frame" d="M{LEFT} {base}H{WIDTH - RIGHT}"/>'
            f'<path class="gate" d="M{LEFT} {base - _PLOT}H{WIDTH - RIGHT}"/>'
            f'<text class="name" x="{LEFT - 10}" y="{base - 22}" text-anchor="end">'
            f"{escape(names.get(person, f'person {person}')[:16])}</text>"
            f'<text class="axis" x="{LEFT - 10}" y="{base - 7}" text-anchor="end">{mean}</text>'
        )
        x, y = axis.x(stamps), base - _PLOT * distances / gate_m
        for piece in split_at_gaps(stamps, period, labels):
            parts.append(_line(x[piece], y[piece], colours.slot(int(labels[piece[0]]))))
    if persons:
        parts.append(f'<text class="axis halo" x="{LEFT + 3}" y="{6 + 10}">{gate_m:g} m</text>')
    return axis.chart(len(persons) * _ROW + 2, "".join(parts), "Distance between each person and their track over time")


def _line(x: NDArray[np.float64], y: NDArray[np.float64], slot: int) -> str:
    column = np.floor(x)
    first = np.flatnonzero(np.diff(column, prepend=-1.0))
    if first.size * 2 > x.size:
        if x.size == 1:
            return f'<circle class="f{slot}" cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="1.2"/>'
        return f'<path class="s{slot} error" d="{svg_path(np.column_stack([x, y]))}"/>'
    counts = np.diff(first, append=x.size)
    middle, mean = np.add.reduceat(x, first) / counts, np.add.reduceat(y, first) / counts
    low, high = np.minimum.reduceat(y, first), np.maximum.reduceat(y, first)
    band = np.concatenate([np.column_stack([middle, low]), np.column_stack([middle, high])[::-1]])
    return (
        f'<path class="f{slot} band" d="{svg_path(band, closed=True)}"/>'
        f'<path class="s{slot} error" d="{svg_path(np.column_stack([middle, mean]))}"/>'
    )
