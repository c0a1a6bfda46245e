"""Misses and false positives by cause: a table by posture and distance, and marks on the plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackers.rig import Rig
from twin.evaluate.causes import FALSE_POSITIVES, MISSES, POSTURES, Errors
from twin.report.birdseye import FloorView
from twin.report.figures_table import FIGURES

_NAMES = {figure.key: figure for figure in FIGURES}
_FAR_M = (3.0, 6.0)

DISTANCES = (f"up to {_FAR_M[0]:g} m", f"to {_FAR_M[1]:g} m", "farther")
"""Headings of the last columns of the table: from the nearest sensor."""


@dataclass(frozen=True)
class CauseRow:
    """One cause that occurred: its name and meaning, frames in all, by posture (none for tracks), by distance."""

    name: str
    meaning: str
    frames: int
    by_posture: tuple[int | None, ...]
    by_distance: tuple[int, ...]


def cause_rows(errors: Errors, rig: Rig) -> list[CauseRow]:
    """The causes that occurred, misses first."""
    sensors = np.array([sensor.room_from_sensor.translation[:2] for sensor in rig.sensors.values()])
    distance_m = np.linalg.norm(errors.xy[:, None] - sensors, axis=2).min(axis=1, initial=np.inf)
    ring = np.digitize(distance_m, _FAR_M)
    rows = []
    for kind, causes in (("missed", MISSES), ("false_positive", FALSE_POSITIVES)):
        for cause in causes:
            mine = errors.cause == cause
            if mine.any():
                figure = _NAMES[f"errors.{kind}.{cause}"]
                postures = [int(np.count_nonzero(mine & (errors.posture == each))) for each in POSTURES]
                rows.append(
                    CauseRow(
                        figure.name,
                        figure.meaning,
                        int(np.count_nonzero(mine)),
                        tuple(postures) if kind == "missed" else (None,) * len(POSTURES),
                        tuple(np.bincount(ring[mine], minlength=len(DISTANCES)).tolist()),
                    )
                )
    return rows


def cause_marks(view: FloorView, errors: Errors) -> str:
    """SVG: a dot where somebody was missed, another where a track stood near nobody, one path a cause."""
    parts = []
    for kind, causes in (("missed", MISSES), ("false_positive", FALSE_POSITIVES)):
        for cause in causes:
            mine = errors.cause == cause
            if mine.any():
                dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in view.pixels(errors.xy[mine]).tolist())
                name = _NAMES[f"errors.{kind}.{cause}"].name
                parts.append(f'<path class="dots {kind}" d="{dots}"><title>{name}</title></path>')
    return "".join(parts)
