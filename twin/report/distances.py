"""Errors over time: how far the track that follows a person is from them."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

from twin.evaluate.summary import Evaluation
from twin.recording.tables import TrackTable, TruthTable
from twin.report.birdseye import svg_path
from twin.report.palette import IdentityColours
from twin.report.spans import unbroken, usual_period_ns
from twin.report.time_axis import LEFT, RIGHT, WIDTH, TimeAxis
from twin.report.timeline import missed_spans

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
    """SVG: a row a person, distance [m] to the track that follows (in its colour) from 0 to the gate; misses shaded.

    Where a run has more frames than the chart has columns the line is the mean of each column, in a band from its
    least to its greatest distance.
    """
    gate_m = float(evaluation.metrics["gate_m"])
    period = usual_period_ns(truth.frame_stamps_ns, tracks.frame_stamps_ns)
    parts = []
    persons = np.unique(truth.id).tolist()
    for row, person in enumerate(persons):
        base = row * _ROW + _PLOT + 6
        mine = evaluation.match_person_ids == person
        stamps, labels = evaluation.match_stamps_ns[mine], evaluation.match_track_ids[mine]
        distances = evaluation.match_distances_m[mine]
        mean = f"mean {distances.mean():.2f} m" if distances.size else "never followed"
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
        for piece in unbroken(stamps, period, labels):
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
