"""Table of metrics: the name, meaning, unit and better direction of each, and its format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal


@dataclass(frozen=True)
class Metric:
    """A metric; `key` is its dotted path in a tracker's entry of `metrics.json`."""

    key: str
    name: str
    unit: str
    meaning: str
    better: Literal["more", "less"]
    decimals: int


@dataclass(frozen=True)
class MetricRow:
    """A row as shown: the metric, a text per tracker, and a mark for the best of several."""

    metric: Metric
    cells: tuple[str, ...]
    best: tuple[bool, ...]


_MAIN = (
    Metric("mota", "MOTA", "", "1 − (misses + false positives + switches) / people, over all frames", "more", 3),
    Metric("motp_m", "MOTP", "m", "mean distance of a track from its person", "less", 3),
    Metric("idf1", "IDF1", "", "how consistently identities are kept over the run", "more", 3),
    Metric("hota", "HOTA", "", "detection and association together, over 19 thresholds", "more", 3),
    Metric("hota_cap", "HOTA cap", "", "HOTA with perfect detection and identities at this position error", "more", 3),
    Metric("deta", "DetA", "", "detection part of HOTA", "more", 3),
    Metric("assa", "AssA", "", "association part of HOTA", "more", 3),
    Metric("gospa_m", "GOSPA", "m", "mean error of the whole set, c = 1 m, p = 2, α = 2", "less", 3),
    Metric("ospa_m", "OSPA", "m", "mean error of the whole set, c = 1 m, p = 1", "less", 3),
    Metric("misidentifications", "Misidentified", "", "a confirmed track goes on with another person", "less", 0),
    Metric("lost_tracks", "Lost", "", "a confirmed track ends while its person is in the area", "less", 0),
    Metric("id_switches", "Identity switches", "", "a person goes on under another id", "less", 0),
    Metric("misses", "Misses", "", "people without a matched track, summed over frames", "less", 0),
    Metric("false_positives", "False positives", "", "tracks without a person, summed over frames", "less", 0),
)
_CAUSES = (
    Metric("errors.missed.start_up", "Missed at the start", "", "before their first track in the area", "less", 0),
    Metric("errors.missed.seen", "Missed in sight", "", "followed before, and a used sensor sees them", "less", 0),
    Metric("errors.missed.unused", "Missed, unused", "", "only sensors see them that are not used", "less", 0),
    Metric("errors.missed.unseen", "Missed, unseen", "", "no ray of any sensor reaches them", "less", 0),
    Metric("errors.false_positive.ghost", "Ghosts", "", "coasting, far from any person", "less", 0),
    Metric("errors.false_positive.ghost_unseen", "Ghosts, unseen", "", "the same, their person unseen", "less", 0),
    Metric("errors.false_positive.double", "Doubles", "", "a second track on a person", "less", 0),
    Metric("errors.false_positive.clutter", "Clutter", "", "measured, far from any person", "less", 0),
)
_ACCURACY = (
    Metric("accuracy", "Accuracy", "", "1 − (missed + false locations + identity wrong) / people", "more", 3),
    Metric(
        "failures.missed",
        "Missed",
        "",
        "people with no track within the gate, summed over frames",
        "less",
        0,
    ),
    Metric(
        "failures.false_location", "False locations", "", "tracks far from any person, summed over frames", "less", 0
    ),
    Metric(
        "failures.identity_wrong", "Identity wrong", "", "people with another's track, summed over frames", "less", 0
    ),
    Metric("disposal.correlated.share", "Correlated, right", "", "pairs less than 0.3 m apart, both right", "more", 3),
    Metric("disposal.merge_split.share", "Merges, right", "", "both right from the merge to 1 s after", "more", 3),
    Metric("disposal.identity_after.share", "Merges, right after", "", "both right 1 s after the merge", "more", 3),
)
_HEAD = (
    Metric("head_error_m.x", "Head, x", "m", "mean absolute error", "less", 3),
    Metric("head_error_m.y", "Head, y", "m", "mean absolute error", "less", 3),
    Metric("head_error_m.z", "Head, z", "m", "mean absolute error", "less", 3),
    Metric("head_yaw_error_rad", "Head, yaw", "rad", "mean absolute error", "less", 3),
    Metric("head_yaw_median_rad", "Head, yaw, median", "rad", "median absolute error", "less", 3),
    Metric("body_height_error_m", "Body, height", "m", "mean absolute error of the pelvis's height", "less", 3),
    Metric(
        "right_at_end",
        "Right at the end",
        "",
        "people whose track is their first one still, in the last frame",
        "more",
        3,
    ),
)
_WIDE = tuple(
    Metric(f"at_1m.{metric.key}", metric.name, metric.unit, metric.meaning, metric.better, metric.decimals)
    for metric in _MAIN
    if metric.key in ("mota", "motp_m", "idf1", "hota", "id_switches")
)
_COST = (
    Metric("ms_per_frame.mean", "Time per frame, mean", "ms", "tracker only, on one core", "less", 2),
    Metric("ms_per_frame.p95", "Time per frame, 95 %", "ms", "19 of 20 frames take less", "less", 2),
)
METRICS: Mapping[str, Metric] = {
    metric.key: metric for metric in (*_MAIN, *_CAUSES, *_ACCURACY, *_HEAD, *_WIDE, *_COST)
}
"""Every metric by its dotted path in a tracker's entry of `metrics.json`, those of the narrow gate first."""
_NONE = "–"
SUMMED_OVER_FRAMES = ("misses", "false_positives")
"""Compared counts that grow with the number of evaluated frames; the other counts are of events in a recording."""
HEADLINE_METRICS = ("mota", "motp_m", "idf1", "hota", "misidentifications", "lost_tracks")


def headline_rows(trackers: Sequence[Mapping[str, Any]]) -> list[MetricRow]:
    """Return the headline rows in order, one cell per tracker."""
    return [
        _row(metric, [metric_value(tracker, metric) for tracker in trackers])
        for metric in (METRICS[key] for key in HEADLINE_METRICS)
    ]


def grouped_rows(trackers: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[MetricRow]]]:
    """Group the rows under their headings, one cell per tracker.

    Without rows in which nothing applies, and without causes of errors that never occurred.
    """
    gates = sorted({float(tracker["gate_m"]) for tracker in trackers if tracker.get("gate_m") is not None})
    main = "Gate " + " / ".join(f"{gate:g} m" for gate in gates)
    groups = []
    headed = {
        main: _MAIN,
        "Misses and false positives by cause": _CAUSES,
        "Accuracy": _ACCURACY,
        "Gate 1 m": _WIDE,
        "Head": _HEAD,
        "Cost": _COST,
    }
    for heading, metrics in headed.items():
        values = {metric: [metric_value(tracker, metric) for tracker in trackers] for metric in metrics}
        if metrics is _CAUSES:
            values = {metric: row for metric, row in values.items() if any(row)}
        rows = [_row(metric, row) for metric, row in values.items() if any(value is not None for value in row)]
        if rows:
            groups.append((heading, rows))
    return groups


def format_judged(tracker: Mapping[str, Any]) -> str:
    """Format the n of a tracker's metrics; a dash without one."""
    judged = tracker.get("judged")
    if judged is None:
        return _NONE
    share = "" if judged["share"] == 1 else f" ({judged['share']:.1%})"
    return f"{judged['frames']} of {judged['frames_total']} frames{share}, {judged['person_frames']} person-frames"


def frames_note(person_frames: Mapping[str, float], where: str = "") -> str | None:
    """Say that trackers, by name, are evaluated in different numbers of person-frames; None where they are not.

    where: the scenario of these numbers, if one of several.
    """
    if len(set(person_frames.values())) < 2:
        return None
    each = ", ".join(f"{name} in {count:.0f}" for name, count in person_frames.items())
    return (
        f"the trackers are evaluated in different person-frames{where and f' ({where})'}: {each}; each is evaluated at the "
        "stamps at which it reports, so compare misses and false positives per 1,000 person-frames, other counts per recording"
    )


def judged_note(trackers: Mapping[str, Mapping[str, Any]]) -> str | None:
    """Return `frames_note` of the entries of `metrics.json` by tracker, of those that are evaluated."""
    return frames_note({name: own["judged"]["person_frames"] for name, own in trackers.items() if own.get("judged")})


def metric_value(tracker: Mapping[str, Any], metric: Metric) -> float | None:
    """Look up a metric in a tracker's entry of `metrics.json`; None where it is missing or does not apply."""
    value: Any = tracker
    for part in metric.key.split("."):
        value = value.get(part) if value is not None else None
    return value


def format_value(metric: Metric, value: float | None) -> str:
    """Format a metric without its unit; a dash where it does not apply."""
    return format_number(value, metric.decimals)


def format_number(value: float | None, decimals: int, unit: str = "", *, sign: bool = False) -> str:
    """Format a number with a minus sign, and its unit if any; sign: a plus too. A dash if not finite."""
    if value is None or not isfinite(value):
        return _NONE
    text = f"{value:{'+' if sign else ''}.{decimals}f}".replace("-", "−")
    return f"{text} {unit}" if unit else text


def _row(metric: Metric, values: Sequence[float | None]) -> MetricRow:
    texts = tuple(format_value(metric, value) for value in values)
    known = [value for value in values if value is not None and isfinite(value)]
    best = format_value(metric, (max if metric.better == "more" else min)(known, default=None))
    # Compared as written: a difference that is not shown makes no tracker the best.
    differ = len({text for text in texts if text != _NONE}) > 1
    return MetricRow(metric, texts, tuple(differ and text == best for text in texts))
