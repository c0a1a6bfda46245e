"""Figures 6 and 7 as SVG: the walk, and the filters' errors over its scans with the maneuvers marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.report.palette import IDENTITY_COLOURS, hex_colour
from twin.reproduce.drawing import INK, QUIET, SHADE, look, svg_of
from twin.reproduce.intervals import band
from twin.reproduce.laser_fisheye_imm.figure7 import FILTERS
from twin.reproduce.laser_fisheye_imm.figure7_results import Curves
from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, Walk

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = dict(zip(FILTERS, [hex_colour(IDENTITY_COLOURS[slot]) for slot in (0, 4, 2)], strict=True))
_DASHES = dict(zip(FILTERS, ["-", "-", (0, (5, 2))], strict=True))  # as in the paper: thick, thin, dashed
_WIDTHS = dict(zip(FILTERS, [2.2, 1.3, 1.3], strict=True))


def walk_svg(walk: Walk) -> str:
    """Figure 6: footprint, linear velocity and turning velocity of the walk, as an SVG document."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 4.1), layout="constrained")
        footprint, *timed = figure.subplot_mosaic([["a", "b"], ["a", "c"]], width_ratios=[1, 1.6]).values()
        _footprint(footprint, walk)
        scans = walk.t / PERIOD_S
        for axes, values, label in zip(
            timed,
            (walk.speed, walk.turn_rate),
            ("(b) linear velocity [m/s]", "(c) turning velocity [rad/s]"),
            strict=True,
        ):
            _maneuvers(axes, walk, named=axes is timed[0])
            stepped = (
                "steps-pre" if values is walk.turn_rate else "default"
            )  # the rate of the leg that ends at the scan
            axes.plot(scans, values, color=INK, linewidth=1.5, drawstyle=stepped)
            axes.set(xlim=(0, scans[-1]), xlabel="scan" if axes is timed[1] else "")
            axes.set_title(label, loc="left", pad=17 if axes is timed[0] else 6)
        return svg_of(figure)


def errors_svg(walk: Walk, scans: np.ndarray, found: Sequence[Curves]) -> str:
    """Figure 7: NPE and NVE at each scan with their 95 % bands, as an SVG document."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 3.3 * len(found)), layout="constrained")
        rows = figure.subplots(len(found), 1, sharex=True)
        for place, (axes, curves) in enumerate(zip(rows, found, strict=True)):
            _maneuvers(axes, walk, named=place == 0)
            axes.axhline(1, color=QUIET, linewidth=1, linestyle=":")
            for name in reversed(FILTERS):  # the IMM on top
                middle, low, high = band(curves.by_filter[name])
                axes.fill_between(scans, low, high, color=_COLOURS[name], alpha=0.15, linewidth=0)
                axes.plot(
                    scans, middle, color=_COLOURS[name], linestyle=_DASHES[name], linewidth=_WIDTHS[name], label=name
                )
            axes.set(xlim=(0, len(walk) - 1), ylim=(0, None))
            axes.set_title(f"({'ab'[place]}) {curves.name}", loc="left", pad=17 if place == 0 else 6)
        handles, labels = rows[0].get_legend_handles_labels()
        rows[-1].legend(handles[::-1], labels[::-1], loc="upper right", frameon=False, ncols=3)
        rows[-1].set_xlabel("scan")
        return svg_of(figure)


def _footprint(axes: Axes, walk: Walk) -> None:
    x, y = walk.position.T
    axes.plot(x, y, color=INK, linewidth=1.0)
    axes.scatter(x, y, s=7, color=INK, linewidths=0, label="scan")
    axes.plot(*walk.position[0], "o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start")
    axes.plot(0, 0, "s", markersize=7, color=_COLOURS["IMM"], label="rig")
    for (x_m, y_m), text in _maneuver_places(walk):
        axes.annotate(text, (x_m, y_m), xytext=(6, -5), textcoords="offset points", va="top", color=QUIET, fontsize=8)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]", xlim=(-0.4, x.max() + 1.2), ylim=(-0.4, y.max() + 0.4))
    axes.set_title("(a) footprint", loc="left")
    axes.legend(loc="lower right", frameon=False)


def _maneuver_places(walk: Walk) -> list[tuple[np.ndarray, str]]:
    """Where maneuvers begin and what they are called; those within half a metre of each other share a place."""
    places: list[tuple[np.ndarray, str]] = []
    for maneuver in walk.maneuvers:
        scan = round(maneuver.start_t / PERIOD_S)
        at, text = walk.position[scan], f"{maneuver.kind} {scan}"
        if places and np.linalg.norm(places[-1][0] - at) < 0.5:
            places[-1] = (places[-1][0], f"{places[-1][1]}\n{text}")
        else:
            places.append((at, text))
    return places


def _maneuvers(axes: Axes, walk: Walk, named: bool) -> None:
    for maneuver in walk.maneuvers:
        start, end = maneuver.start_t / PERIOD_S, maneuver.end_t / PERIOD_S
        axes.axvspan(start, end, color=SHADE, linewidth=0)
        if named:
            axes.annotate(
                maneuver.kind,
                ((start + end) / 2, 1),
                xycoords=axes.get_xaxis_transform(),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                color=QUIET,
                fontsize=9,
            )
