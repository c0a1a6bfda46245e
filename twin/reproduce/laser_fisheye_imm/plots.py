"""Plots as SVG: the walk and its errors (figures 6 and 7), paths of a run (figure 9), table I, densities and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.report.palette import IDENTITY_COLOURS, INK, QUIET, SHADE, hex_colour, plot_style, to_svg
from twin.report.time_axis import median_period_ns, split_at_gaps
from twin.reproduce.laser_fisheye_imm.figure7 import FILTERS, Curves
from twin.reproduce.laser_fisheye_imm.runs import COLUMNS, IMM, SENSOR_SETS, LabCondition, LabRun
from twin.reproduce.laser_fisheye_imm.table_one import LOST, MISIDENTIFIED, TOTAL, cell, error_rate, values
from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, ManeuveringWalk
from twin.reproduce.results import band
from twin.scenario.person import wardrobe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FILTER_COLOURS = dict(zip(FILTERS, [hex_colour(IDENTITY_COLOURS[slot]) for slot in (0, 4, 2)], strict=True))
_DASHES = dict(zip(FILTERS, ["-", "-", (0, (5, 2))], strict=True))  # as in the paper: thick, thin, dashed
_WIDTHS = dict(zip(FILTERS, [2.2, 1.3, 1.3], strict=True))


def walk_svg(walk: ManeuveringWalk) -> str:
    """Draw figure 6: footprint, linear velocity and turning velocity of the walk."""
    from matplotlib.figure import Figure

    with plot_style():
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
        return to_svg(figure)


def errors_svg(walk: ManeuveringWalk, scans: np.ndarray, found: Sequence[Curves]) -> str:
    """Draw figure 7: NPE and NVE at each scan with their 95 % bands, maneuvers shaded."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 3.3 * len(found)), layout="constrained")
        rows = figure.subplots(len(found), 1, sharex=True)
        for place, (axes, curves) in enumerate(zip(rows, found, strict=True)):
            _maneuvers(axes, walk, named=place == 0)
            axes.axhline(1, color=QUIET, linewidth=1, linestyle=":")
            for name in reversed(FILTERS):  # the IMM on top
                middle, low, high = band(curves.by_filter[name])
                axes.fill_between(scans, low, high, color=_FILTER_COLOURS[name], alpha=0.15, linewidth=0)
                axes.plot(
                    scans,
                    middle,
                    color=_FILTER_COLOURS[name],
                    linestyle=_DASHES[name],
                    linewidth=_WIDTHS[name],
                    label=name,
                )
            axes.set(xlim=(0, len(walk) - 1), ylim=(0, None))
            axes.set_title(f"({'ab'[place]}) {curves.name}", loc="left", pad=17 if place == 0 else 6)
        handles, labels = rows[0].get_legend_handles_labels()
        rows[-1].legend(handles[::-1], labels[::-1], loc="upper right", frameon=False, ncols=3)
        rows[-1].set_xlabel("scan")
        return to_svg(figure)


def _footprint(axes: Axes, walk: ManeuveringWalk) -> None:
    x, y = walk.position.T
    axes.plot(x, y, color=INK, linewidth=1.0)
    axes.scatter(x, y, s=7, color=INK, linewidths=0, label="scan")
    axes.plot(*walk.position[0], "o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start")
    axes.plot(0, 0, "s", markersize=7, color=_FILTER_COLOURS["IMM"], label="rig")
    for (x_m, y_m), text in _maneuver_places(walk):
        axes.annotate(text, (x_m, y_m), xytext=(6, -5), textcoords="offset points", va="top", color=QUIET, fontsize=8)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]", xlim=(-0.4, x.max() + 1.2), ylim=(-0.4, y.max() + 0.4))
    axes.set_title("(a) footprint", loc="left")
    axes.legend(loc="lower right", frameon=False)


def _maneuver_places(walk: ManeuveringWalk) -> list[tuple[np.ndarray, str]]:
    """Find the starts of maneuvers and their labels, merged within half a metre."""
    places: list[tuple[np.ndarray, str]] = []
    for maneuver in walk.maneuvers:
        scan = round(maneuver.start_t / PERIOD_S)
        at, text = walk.position[scan], f"{maneuver.kind} {scan}"
        if places and np.linalg.norm(places[-1][0] - at) < 0.5:
            places[-1] = (places[-1][0], f"{places[-1][1]}\n{text}")
        else:
            places.append((at, text))
    return places


def _maneuvers(axes: Axes, walk: ManeuveringWalk, named: bool) -> None:
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


_LIGHTEST = 0.72
_EVENTS = {"misidentification": ("X", "misidentified"), "lost": ("d", "lost")}


def figure9_svg(run: LabRun, area: np.ndarray) -> str:
    """Draw figure 9: footprints, x and y against time; truth broad and pale, tracks thin and dark. area: its corners (k, 2)
    [m].
    """
    from matplotlib.figure import Figure

    with plot_style():
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
        return to_svg(figure)


def _true_paths(axes: Axes, run: LabRun, across: np.ndarray, up: np.ndarray) -> None:
    for person, name in run.names.items():
        rows = np.flatnonzero(run.truth.id == person)
        colour = _on_white(run.shirts[person])
        axes.plot(across[rows], up[rows], color=colour, alpha=0.55, linewidth=5, solid_capstyle="round", label=name)


def _on_white(shirt: str | None) -> tuple[float, float, float]:
    """Darken a shirt's colour for white paper; grey for a randomly drawn shirt."""
    rgb = (0.5, 0.5, 0.5) if shirt is None else wardrobe().rgb("shirt", shirt)
    light = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
    scale = min(1.0, _LIGHTEST / max(light, 1e-6))
    return rgb[0] * scale, rgb[1] * scale, rgb[2] * scale * (0.85 if scale < 1 else 1.0)  # white becomes straw


def _tracks(axes: Axes, run: LabRun, across: np.ndarray, up: np.ndarray) -> None:
    tracks = run.tracks
    period_ns = median_period_ns(tracks.frame_stamps_ns)
    for track in np.unique(tracks.id).tolist():
        rows = np.flatnonzero(tracks.id == track)
        coasting = (tracks.status[rows] == "coasting").astype(np.int64)
        for piece in split_at_gaps(tracks.stamps_ns[rows], period_ns, coasting):
            own = rows[np.concatenate([piece[:1] - 1, piece]) if piece[0] > 0 else piece]
            dotted = bool(coasting[piece[0]])
            axes.plot(across[own], up[own], color=INK, linewidth=1.0, linestyle=":" if dotted else "-")
    axes.plot([], [], color=INK, linewidth=1.0, label="track, measured")
    axes.plot([], [], color=INK, linewidth=1.0, linestyle=":", label="track, coasting")


def _events(axes: Axes, run: LabRun, across: np.ndarray, up: np.ndarray) -> None:
    """Mark where a track changes to another person, or ends too early."""
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


_SENSOR_COLOURS = {
    sensors: hex_colour(IDENTITY_COLOURS[slot]) for sensors, slot in zip(SENSOR_SETS, (0, 1, 2), strict=True)
}
_MARKERS = dict[str, str](zip(SENSOR_SETS, "osD", strict=True))


def table_one_svg(condition: LabCondition) -> str:
    """Draw misidentified and lost in every run of a condition, one row per column of the table."""
    return _rows_svg([(condition, MISIDENTIFIED, "(a) misidentified"), (condition, LOST, "(b) lost")], height=2.9)


def conditions_svg(conditions: Sequence[LabCondition]) -> str:
    """Draw the sum of misidentified and lost in every run, one panel per condition."""
    return _rows_svg([(each, TOTAL, each.name) for each in conditions], height=2.7)


def densities_svg(densities: Sequence[LabCondition], area_m2: float) -> str:
    """Draw errors per minute of a person in the area against the number of people, every column."""
    from matplotlib.figure import Figure

    with plot_style():
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
                    color=_SENSOR_COLOURS[sensors],
                    linestyle="-" if column.filter == IMM else (0, (4, 2)),
                    linewidth=1.6,
                    elinewidth=1.1,
                    capsize=3,
                    marker=_MARKERS[sensors],
                    markersize=5.5,
                    markerfacecolor=_SENSOR_COLOURS[sensors] if column.filter == IMM else "white",
                    label=column.filter,
                )
            axes.set_title(sensors, loc="left")
            axes.set_xticks(people, [f"{n}\n{n / area_m2:.2f}/m²" for n in people])
            axes.set_xlim(people.min() - 0.7, people.max() + 0.7)
            axes.legend(loc="upper left", frameon=False)
        panels[0].set_ylim(bottom=0)  # after all are drawn: it ends autoscaling of all panels
        panels[0].set_ylabel("errors per person-minute")
        panels[1].set_xlabel("people in the area")
        return to_svg(figure)


def _rows_svg(panels: Sequence[tuple[LabCondition, str, str]], height: float) -> str:
    from matplotlib.figure import Figure

    with plot_style():
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
        return to_svg(figure)


def _dots(axes: Axes, condition: LabCondition, row: str) -> None:
    """Draw every run as a pale dot (equal ones side by side), the mean as a mark with its interval."""
    from matplotlib.ticker import MaxNLocator

    for place, column in enumerate(COLUMNS):
        found = values(condition, column.tracker, row)
        colour = _SENSOR_COLOURS[column.sensors]
        axes.scatter(found, place + _spread(found), s=17, color=colour, alpha=0.4, linewidths=0)
        mean = cell(condition, column.tracker, row)
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
    axes.set_yticks(range(len(COLUMNS)), [each.name for each in COLUMNS])
    axes.set(ylim=(len(COLUMNS) - 0.5, -0.5), xlim=(-0.4, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="x")
    axes.grid(visible=False, axis="y")


def _spread(found: np.ndarray) -> np.ndarray:
    """Shift each run's dot off its row, so that equal ones do not overlap, (n,)."""
    off = np.zeros(len(found))
    for value in np.unique(found):
        same = np.flatnonzero(found == value)
        off[same] = (np.arange(same.size) - (same.size - 1) / 2) * min(0.09, 0.7 / same.size)
    return off
