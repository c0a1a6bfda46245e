"""The table of figures: what each is called, what it means, its unit, and which way is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal


@dataclass(frozen=True)
class Figure:
    """One row: `key` is its dotted place in a tracker's entry of `metrics.json`."""

    key: str
    name: str
    unit: str
    meaning: str
    better: Literal["more", "less"]
    decimals: int


@dataclass(frozen=True)
class Row:
    """A row as shown: the figure, a text a tracker, and whether that tracker has the best of several."""

    figure: Figure
    cells: tuple[str, ...]
    best: tuple[bool, ...]


_MAIN = (
    Figure("mota", "MOTA", "", "1 − (misses + false positives + switches) / people, over all frames", "more", 3),
    Figure("motp_m", "MOTP", "m", "mean distance of a track from its person", "less", 3),
    Figure("idf1", "IDF1", "", "how consistently identities are kept over the run", "more", 3),
    Figure("hota", "HOTA", "", "detection and association together, over 19 thresholds", "more", 3),
    Figure("deta", "DetA", "", "detection part of HOTA", "more", 3),
    Figure("assa", "AssA", "", "association part of HOTA", "more", 3),
    Figure("gospa_m", "GOSPA", "m", "mean error of the whole set, c = 1 m, p = 2, α = 2", "less", 3),
    Figure("ospa_m", "OSPA", "m", "mean error of the whole set, c = 1 m, p = 1", "less", 3),
    Figure("misidentifications", "Misidentified", "", "a confirmed track goes on with another person", "less", 0),
    Figure("lost_tracks", "Lost", "", "a confirmed track ends while its person is in the area", "less", 0),
    Figure("id_switches", "Identity switches", "", "a person goes on under another id", "less", 0),
    Figure("misses", "Misses", "", "people without a track, summed over frames", "less", 0),
    Figure("false_positives", "False positives", "", "tracks without a person, summed over frames", "less", 0),
)
_CAUSES = (
    Figure("errors.missed.start_up", "Missed at the start", "", "before their first track in the area", "less", 0),
    Figure("errors.missed.seen", "Missed in sight", "", "followed before, and a used sensor sees them", "less", 0),
    Figure("errors.missed.unused", "Missed, unused", "", "only sensors see them that are not used", "less", 0),
    Figure("errors.missed.unseen", "Missed, unseen", "", "no ray of any sensor reaches them", "less", 0),
    Figure("errors.false_positive.ghost", "Ghosts", "", "coasting near nobody", "less", 0),
    Figure("errors.false_positive.ghost_unseen", "Ghosts, unseen", "", "the same, their person unseen", "less", 0),
    Figure("errors.false_positive.double", "Doubles", "", "a second track on a person", "less", 0),
    Figure("errors.false_positive.clutter", "Clutter", "", "measured near nobody", "less", 0),
)
_ACCURACY = (
    Figure("accuracy", "Accuracy", "", "1 − (missed + false locations + identity wrong) / people", "more", 3),
    Figure("failures.missed", "Missed", "", "people with no track near, summed over frames", "less", 0),
    Figure("failures.false_location", "False locations", "", "tracks near nobody, summed over frames", "less", 0),
    Figure(
        "failures.identity_wrong", "Identity wrong", "", "people with another's track, summed over frames", "less", 0
    ),
    Figure("disposal.correlated.share", "Correlated, right", "", "pairs less than 0.3 m apart, both right", "more", 3),
    Figure("disposal.merge_split.share", "Merges, right", "", "both right from the merge to 1 s after", "more", 3),
)
_HEAD = (
    Figure("head_error_m.x", "Head, x", "m", "mean absolute error", "less", 3),
    Figure("head_error_m.y", "Head, y", "m", "mean absolute error", "less", 3),
    Figure("head_error_m.z", "Head, z", "m", "mean absolute error", "less", 3),
    Figure("head_yaw_error_rad", "Head, yaw", "rad", "mean absolute error", "less", 3),
    Figure("head_yaw_median_rad", "Head, yaw, median", "rad", "median absolute error", "less", 3),
    Figure("body_height_error_m", "Body, height", "m", "mean absolute error of the pelvis's height", "less", 3),
    Figure(
        "right_at_end",
        "Right at the end",
        "",
        "people whose track is their first one still, in the last frame",
        "more",
        3,
    ),
)
_WIDE = tuple(
    Figure(f"at_1m.{figure.key}", figure.name, figure.unit, figure.meaning, figure.better, figure.decimals)
    for figure in _MAIN
    if figure.key in ("mota", "motp_m", "idf1", "hota", "id_switches")
)
_COST = (
    Figure("ms_per_frame.mean", "Time per frame, mean", "ms", "tracker only, on one core", "less", 2),
    Figure("ms_per_frame.p95", "Time per frame, 95 %", "ms", "19 of 20 frames take less", "less", 2),
)
FIGURES = (*_MAIN, *_CAUSES, *_ACCURACY, *_HEAD, *_WIDE, *_COST)
"""Every figure there is, those of the narrow gate first."""
_NONE = "–"
HEADLINES = ("mota", "motp_m", "idf1", "hota", "misidentifications", "lost_tracks")


def headline_figures() -> list[Figure]:
    """The figures to see first, in order."""
    return [figure for key in HEADLINES for figure in _MAIN if figure.key == key]


def grouped_rows(trackers: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Row]]]:
    """The rows under their headings, a cell a tracker; a group in which nothing applies is left out."""
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
    for heading, figures in headed.items():
        values = [[value_of(tracker, figure) for tracker in trackers] for figure in figures]
        if any(value is not None for row in values for value in row):
            groups.append((heading, [_row(figure, row) for figure, row in zip(figures, values, strict=True)]))
    return groups


def judged_text(tracker: Mapping[str, Any]) -> str:
    """The n of a tracker's figures as a person reads it; a dash where they have none."""
    judged = tracker.get("judged")
    if judged is None:
        return _NONE
    share = "" if judged["share"] == 1 else f" ({judged['share']:.1%})"
    return f"{judged['frames']} of {judged['frames_total']} frames{share}, {judged['person_frames']} person-frames"


def value_of(tracker: Mapping[str, Any], figure: Figure) -> float | None:
    """A figure in a tracker's entry of `metrics.json`; None where it is not there or does not apply."""
    value: Any = tracker
    for part in figure.key.split("."):
        value = value.get(part) if value is not None else None
    return value


def text_of(figure: Figure, value: float | None) -> str:
    """A figure as written, without its unit; a dash where it does not apply."""
    if value is None or not isfinite(value):
        return _NONE
    return f"{value:.{figure.decimals}f}".replace("-", "−")


def _row(figure: Figure, values: Sequence[float | None]) -> Row:
    texts = tuple(text_of(figure, value) for value in values)
    known = [value for value in values if value is not None and isfinite(value)]
    best = text_of(figure, (max if figure.better == "more" else min)(known, default=None))
    # Compared as written: a difference that is not shown makes nobody the best.
    differ = len({text for text in texts if text != _NONE}) > 1
    return Row(figure, texts, tuple(differ and text == best for text in texts))
