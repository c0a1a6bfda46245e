"""The timeline of identities: which track follows whom, and where that breaks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from twin.evaluate.continuity import Event
from twin.evaluate.summary import Evaluation
from twin.recording.situation_table import SituationTable
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import IDENTITY_COLOURS, IdentityColours, is_light
from twin.report.spans import Span, spans, usual_period_ns, without
from twin.report.time_axis import LEFT, RIGHT, WIDTH, TimeAxis

_BAR = 20
_STRIP = 4
_LEVELS = 5  # shades of hiddenness
_GLYPHS = {
    "switch": '<path class="glyph" d="M0 -6.5L6 4.5H-6Z"/>',
    "misidentification": '<path class="glyph cross" d="M-5 -5L5 5M-5 5L5 -5"/>',
    "lost": '<path class="glyph hollow" d="M0 -6.5L6.5 0L0 6.5L-6.5 0Z"/>',
}


def glyph(kind: str) -> str:
    """The mark of a kind of event, an SVG of its own for a legend."""
    return f'<svg class="key" viewBox="-9 -9 18 18" aria-hidden="true">{_GLYPHS[kind]}</svg>'


def describe(event: Event, names: Mapping[int, str]) -> str:
    """What an event says, one sentence."""
    person = names.get(event.person_id, f"person {event.person_id}")
    match event.kind:
        case "switch":
            return f"{person} goes on as #{event.track_id}, was #{event.previous_track_id}"
        case "misidentification":
            before = event.previous_person_id
            previous = names.get(before, f"person {before}") if before is not None else "somebody else"
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
    """SVG: a row a person, coloured by the track that follows; marks where it breaks; false tracks below.

    The line over a row says when the scanners together cannot tell the person from another; the strips under it, how hidden
    the person is from each sensor (one strip a sensor, darker the more hidden).
    """
    period = usual_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    strips = len(truth.visible)
    parts, y = [], 0.0
    for person in np.unique(truth.id).tolist():
        rows = truth.id == person
        owed = spans(truth.stamps_ns[rows & truth.in_area], period)
        mine = evaluation.match_person_ids == person
        followed = spans(evaluation.match_stamps_ns[mine], period, evaluation.match_track_ids[mine])
        bar = y + 16
        parts.append(_row_name(names.get(person, f"person {person}"), bar))
        parts.append(_thin(axis, owed, bar + _BAR / 2, "owed"))
        parts.append(_bars(axis, followed, bar, colours))
        for place, (sensor, share) in enumerate(truth.visible.items()):
            top = bar + _BAR + 2 + place * (_STRIP + 1)
            parts.append(_hidden_strip(axis, truth.stamps_ns[rows], share[rows], period, top, sensor))
        parts.append(_merged(axis, evaluation.situations, person, bar - 4, names))
        parts.append(_marks(axis, [event for event in evaluation.events if event.person_id == person], y + 8, names))
        y = bar + _BAR + strips * (_STRIP + 1) + 6
    false_stamps, false_ids = false_tracks(truth, tracks, evaluation)
    if false_ids.size:
        parts.append(f'<path class="rule" d="M0 {y + 8:.0f}H{WIDTH}"/>')
        parts.append(f'<text class="group" x="0" y="{y + 24:.0f}">Tracks that follow nobody</text>')
        y += 30
        lanes = _lanes(
            sorted(
                (
                    span
                    for track in np.unique(false_ids).tolist()
                    for span in spans(
                        false_stamps[false_ids == track], period, np.full(np.count_nonzero(false_ids == track), track)
                    )
                ),
                key=lambda span: (span.start_ns, span.label),
            )
        )
        for lane in lanes:
            parts.append(_bars(axis, lane, y, colours, height=14, kind="false"))
            y += 18
    return axis.chart(y + 6, "".join(parts), "Timeline of identities, one row a person")


def track_timeline(axis: TimeAxis, tracks: TrackTable, colours: IdentityColours) -> str:
    """SVG: a row a track in order of appearance, solid while confirmed, pale while it coasts."""
    period = usual_period_ns(tracks.frame_stamps_ns)
    ids, first = np.unique(tracks.id, return_index=True)
    height = 16 if ids.size <= 40 else 10
    parts, y = [], 4.0
    for track in ids[np.argsort(first, kind="stable")].tolist():
        rows = tracks.id == track
        # Pale for all of its life, solid over it while confirmed.
        stamps, confirmed = tracks.stamps_ns[rows], tracks.status[rows] == "confirmed"
        for state, seen in (("coasting", stamps), ("confirmed", stamps[confirmed])):
            for span in spans(seen, period):
                bar = Span(span.start_ns, span.end_ns, track)
                parts.append(_bar(axis, bar, y, colours, height, state, f"#{track} {state}", named=False))
        # The name stands before the bar, so that a short one has its name too; at the left edge it would be cut.
        x = max(float(axis.x(int(stamps[0]))) - 6, LEFT - 6)
        parts.append(f'<text class="id" x="{x:.1f}" y="{y + height - 3:.1f}" text-anchor="end">#{track}</text>')
        y += height + 3
    return axis.chart(y + 4, "".join(parts), "Timeline of tracks, one row a track")


def false_tracks(
    truth: TruthTable, tracks: TrackTable, evaluation: Evaluation
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stamps and ids, (n,) each and ordered by stamp, of the tracks that were counted as false positives.

    The evaluation says how many a frame holds. Where more tracks are unmatched than that, the others follow people
    outside the tracked area and were left out: those nearest to somebody outside.
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
    """When a person was in the tracked area and no track was with them."""
    period = usual_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    owed = spans(truth.stamps_ns[(truth.id == person) & truth.in_area], period)
    followed = spans(evaluation.match_stamps_ns[evaluation.match_person_ids == person], period)
    return without(owed, followed, period // 2)


def _marks(axis: TimeAxis, events: Sequence[Event], y: float, names: Mapping[int, str]) -> str:
    """The marks of events in order of time; those that would cover each other stand side by side."""
    parts, x = [], -np.inf
    for event in events:
        x = max(_clip(axis, event.stamp_ns), x + 13)
        parts.append(
            f'<g class="event" transform="translate({x:.1f} {y:.1f})">{_GLYPHS[event.kind]}'
            f"<title>{axis.text(event.stamp_ns)}: {escape(describe(event, names))}</title></g>"
        )
    return "".join(parts)


def _row_name(name: str, bar: float) -> str:
    shown = name if len(name) <= 14 else name[:13] + "…"
    return f'<text class="name" x="{LEFT - 10}" y="{bar + 14.5:.1f}" text-anchor="end">{escape(shown)}</text>'


def _thin(axis: TimeAxis, stretches: Sequence[Span], y: float, kind: str) -> str:
    line = "".join(f"M{_clip(axis, span.start_ns):.1f} {y:.1f}H{_clip(axis, span.end_ns):.1f}" for span in stretches)
    return f'<path class="{kind}" d="{line}"/>' if line else ""


def _bars(
    axis: TimeAxis, stretches: Sequence[Span], y: float, colours: IdentityColours, height: int = _BAR, kind: str = ""
) -> str:
    return "".join(
        _bar(axis, span, y, colours, height, kind, f"#{span.label}{' (nobody)' if kind == 'false' else ''}")
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
    when = f"{axis.text(span.start_ns)} to {axis.text(span.end_ns)}"
    # A hair narrower, so that two bars of like colours stay two.
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
    column = np.floor(axis.x(stamps_ns[known]) * 2).astype(np.int64)  # half a unit wide: finer cannot be seen
    first = np.flatnonzero(np.diff(column, prepend=-1))
    if first.size == 0:
        return ""
    worst, stamps = np.maximum.reduceat(level, first), stamps_ns[known][first]
    step = max(period, usual_period_ns(stamps))
    boxes: dict[int, str] = {}
    for span in spans(stamps, step, worst):
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
    """Lines for the merges of a person with others, those for all scanners of the rig."""
    if situations is None:
        return ""
    merged = situations.select("merged_rig")
    parts = []
    for row in np.flatnonzero((merged.first_id == person) | (merged.second_id == person)).tolist():
        other = int(merged.first_id[row] + merged.second_id[row]) - person
        start_ns, end_ns = int(merged.start_ns[row]), int(merged.end_ns[row])
        said = f"merged with {names.get(other, f'person {other}')}, {axis.text(start_ns)} to {axis.text(end_ns)}"
        line = f"M{_clip(axis, start_ns):.1f} {y:.1f}H{_clip(axis, end_ns):.1f}"
        parts.append(f'<path class="merged" d="{line}"><title>{escape(said)}</title></path>')
    return "".join(parts)


def _lanes(stretches: Sequence[Span]) -> list[list[Span]]:
    """Spans in order of start packed into as few rows as go without overlap."""
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
