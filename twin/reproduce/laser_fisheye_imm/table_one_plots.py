"""Plots of the lab's runs as SVG: errors of every run by column and condition, and errors against density."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.report.palette import IDENTITY_COLOURS, hex_colour
from twin.reproduce.drawing import INK, QUIET, look, svg_of
from twin.reproduce.laser_fisheye_imm.conditions import COLUMNS, IMM, SENSOR_SETS, Column, Condition
from twin.reproduce.laser_fisheye_imm.table_one import LOST, MISIDENTIFIED, TOTAL, cell, error_rate, values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = {sensors: hex_colour(IDENTITY_COLOURS[slot]) for sensors, slot in zip(SENSOR_SETS, (0, 1, 2), strict=True)}
_MARKERS = {sensors: marker for sensors, marker in zip(SENSOR_SETS, "osD", strict=True)}
_TITLES = {MISIDENTIFIED: "misidentified", LOST: "lost", TOTAL: "misidentified + lost"}


def table_one_svg(condition: Condition) -> str:
    """Misidentified and lost in every run of a condition, a row a column of the table, as an SVG document."""
    return _rows_svg([(condition, MISIDENTIFIED, "(a) misidentified"), (condition, LOST, "(b) lost")], height=2.9)


def conditions_svg(conditions: Sequence[Condition]) -> str:
    """Misidentified and lost together in every run, a panel a condition, as an SVG document."""
    return _rows_svg([(each, TOTAL, each.name) for each in conditions], height=2.7)


def densities_svg(densities: Sequence[Condition], area_m2: float) -> str:
    """Errors per minute of a person in the area against people there, every column, as an SVG document."""
    from matplotlib.figure import Figure

    with look():
        figure = Figure(figsize=(10, 3.9), layout="constrained")
        panels = figure.subplots(1, len(SENSOR_SETS), sharey=True)
        people = np.array([each.n_person for each in densities])
        for axes, sensors in zip(panels, SENSOR_SETS, strict=True):
            for column in (each for each in COLUMNS if each.sensors == sensors):
                found = [error_rate(each, column) for each in densities]
                middle = np.array([each.value for each in found])
                away = np.abs(np.array([(each.low, each.high) for each in found]).T - middle)
                axes.errorbar(
                    people + (-0.12 if column.filter == IMM else 0.12),
                    middle,
                    away,
                    color=_COLOURS[sensors],
                    linestyle="-" if column.filter == IMM else (0, (4, 2)),
                    linewidth=1.6,
                    elinewidth=1.1,
                    capsize=3,
                    marker=_MARKERS[sensors],
                    markersize=5.5,
                    markerfacecolor=_COLOURS[sensors] if column.filter == IMM else "white",
                    label=column.filter,
                )
            axes.set_title(sensors, loc="left")
            axes.set_xticks(people, [f"{n}\n{n / area_m2:.2f}/m²" for n in people])
            axes.set_xlim(people.min() - 0.7, people.max() + 0.7)
            axes.legend(loc="upper left", frameon=False)
        panels[0].set_ylim(bottom=0)  # once all are drawn: it ends the scaling to what is drawn, for all panels
        panels[0].set_ylabel("errors per person-minute")
        panels[1].set_xlabel("people in the area")
        return svg_of(figure)


def _rows_svg(panels: Sequence[tuple[Condition, str, str]], height: float) -> str:
    from matplotlib.figure import Figure

    with look():
        n_across = min(2, len(panels))
        n_down = -(-len(panels) // n_across)
        figure = Figure(figsize=(10, height * n_down), layout="constrained")
        grid = figure.subplots(n_down, n_across, sharey=True, squeeze=False).ravel()
        for axes, (condition, row, title) in zip(grid, panels, strict=False):
            _dots(axes, condition, row)
            axes.set_title(title, loc="left")
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes in grid[max(0, len(panels) - n_across) : len(panels)]:
            axes.set_xlabel("events in a run")
        return svg_of(figure)


def _dots(axes: Axes, condition: Condition, row: str) -> None:
    """Every run a pale dot (equal ones beside each other), the mean a mark with its interval."""
    from matplotlib.ticker import MaxNLocator

    for place, column in enumerate(COLUMNS):
        found = values(condition, column, row)
        colour = _COLOURS[column.sensors]
        axes.scatter(found, place + _spread(found), s=17, color=colour, alpha=0.4, linewidths=0)
        mean = cell(condition, column, row)
        axes.errorbar(
            mean.value,
            place,
            xerr=[[mean.value - mean.low], [mean.high - mean.value]],
            color=INK,
            elinewidth=1.3,
            capsize=3,
            marker=_MARKERS[column.sensors],
            markersize=6,
            markerfacecolor=INK if column.filter == IMM else "white",
            zorder=3,
        )
    axes.axhline(len(COLUMNS) / 2 - 0.5, color=QUIET, linewidth=0.8)
    axes.set_yticks(range(len(COLUMNS)), [_label(each) for each in COLUMNS])
    axes.set(ylim=(len(COLUMNS) - 0.5, -0.5), xlim=(-0.4, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="x")
    axes.grid(visible=False, axis="y")


def _label(column: Column) -> str:
    return f"{column.filter}, {column.sensors}"


def _spread(found: np.ndarray) -> np.ndarray:
    """How far off its row each run's dot stands, so that equal ones do not cover each other, (n,)."""
    off = np.zeros(len(found))
    for value in np.unique(found):
        same = np.flatnonzero(found == value)
        off[same] = (np.arange(same.size) - (same.size - 1) / 2) * min(0.09, 0.7 / same.size)
    return off
