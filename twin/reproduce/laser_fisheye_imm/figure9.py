"""Figure 9: the paths of one run, truth and tracks, as SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.report.spans import unbroken, usual_period_ns
from twin.reproduce.drawing import INK, QUIET, look, svg_of
from twin.reproduce.laser_fisheye_imm.conditions import OneRun
from twin.scenario.people import wardrobe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIGHTEST = 0.72
_EVENTS = {"misidentification": ("X", "misidentified"), "lost": ("d", "lost")}


def figure9_svg(run: OneRun, area: np.ndarray) -> str:
    """Footprints, and x and y against time: truth broad and pale, tracks thin and dark; area: its corners (k, 2) [m]."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 9.6), layout="constrained")
        footprint, over_x, over_y = figure.subplot_mosaic([["a"], ["b"], ["c"]], height_ratios=[2.5, 1, 1]).values()
        _area(footprint, area)
        t, truth, tracks = run.truth.t, run.truth, run.tracks
        for axes, across, up in ((footprint, truth.x, truth.y), (over_x, t, truth.x), (over_y, t, truth.y)):
            _true_paths(axes, run, across, up)
        t = tracks.t
        for axes, across, up in ((footprint, tracks.x, tracks.y), (over_x, t, tracks.x), (over_y, t, tracks.y)):
            _tracks(axes, run, across, up)
            _events(axes, run, across, up)
        footprint.set_aspect("equal")
        footprint.set(xlabel="x [m]", ylabel="y [m]")
        footprint.set_title("(a) footprints", loc="left")
        footprint.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
        for axes, letter, name in ((over_x, "b", "x"), (over_y, "c", "y")):
            axes.set_title(f"({letter}) {name} [m]", loc="left")
            axes.set(xlim=(float(truth.t.min()), float(truth.t.max())))
        over_y.set_xlabel("time [s]")
        return svg_of(figure)


def _true_paths(axes: Axes, run: OneRun, across: np.ndarray, up: np.ndarray) -> None:
    for person, name in run.names.items():
        rows = np.flatnonzero(run.truth.id == person)
        colour = _on_white(run.shirts[person])
        axes.plot(across[rows], up[rows], color=colour, alpha=0.55, linewidth=5, solid_capstyle="round", label=name)


def _on_white(shirt: str | None) -> tuple[float, float, float]:
    """A shirt's colour as it can be seen on white paper; grey for a shirt that was drawn at random."""
    rgb = (0.5, 0.5, 0.5) if shirt is None else wardrobe().rgb("shirt", shirt)
    light = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
    scale = min(1.0, _LIGHTEST / max(light, 1e-6))
    return rgb[0] * scale, rgb[1] * scale, rgb[2] * scale * (0.85 if scale < 1 else 1.0)  # what was white is straw


def _tracks(axes: Axes, run: OneRun, across: np.ndarray, up: np.ndarray) -> None:
    tracks = run.tracks
    period_ns = usual_period_ns(tracks.frame_stamps_ns)
    for track in np.unique(tracks.id).tolist():
        rows = np.flatnonzero(tracks.id == track)
        coasting = (tracks.status[rows] == "coasting").astype(np.int64)
        for piece in unbroken(tracks.stamps_ns[rows], period_ns, coasting):
            own = rows[np.concatenate([piece[:1] - 1, piece]) if piece[0] > 0 else piece]
            dotted = bool(coasting[piece[0]])
            axes.plot(across[own], up[own], color=INK, linewidth=1.0, linestyle=":" if dotted else "-")
    axes.plot([], [], color=INK, linewidth=1.0, label="track, measured")
    axes.plot([], [], color=INK, linewidth=1.0, linestyle=":", label="track, coasting")


def _events(axes: Axes, run: OneRun, across: np.ndarray, up: np.ndarray) -> None:
    """A mark where a track goes over to somebody else, or ends too early."""
    for kind, (marker, word) in _EVENTS.items():
        found = [event for event in run.evaluation.events if event.kind == kind]
        at = [
            row
            for event in found
            for row in np.flatnonzero((run.tracks.id == event.track_id) & (run.tracks.stamps_ns == event.stamp_ns))
        ]
        if at:
            axes.plot(
                across[at], up[at], marker, color="white", markeredgecolor=INK, markersize=9, linestyle="", label=word
            )


def _area(axes: Axes, area: np.ndarray) -> None:
    corners = np.concatenate([area, area[:1]])
    axes.plot(*corners.T, color=QUIET, linewidth=1.0, linestyle="--", label="tracked area")
    axes.plot(0, 0, "s", markersize=7, color=INK, label="rig")
