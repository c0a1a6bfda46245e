"""Plots of a study's page: heat maps, the Pareto front, and the room and sensors on any plan. SVG, by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.geometry.polygon import thickness_m
from twin.report.metrics_table import format_number
from twin.report.palette import INK, QUIET, SHADE, plot_style, to_svg
from twin.room.building import Building, room_outline
from twin.room.walkable import standing_footprints
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.sensor_descriptions import FloorDescription

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WALL_M = 0.4
"""Thickness from which what is as high as a wall is drawn as furniture, a wardrobe for instance [m]."""
DOT_PT = 9.5
ACCENT, OLD = "#b5341f", "#98a0ac"
_SAME_WAY, _SAME_M = 0.999, 0.15
"""Cosine between the directions of walls that are in one line, and greatest distance between them [m]."""


@dataclass(frozen=True, eq=False)
class WallDistance:
    """Wall beside a sensor: its letter on the plan, its distance, the nearest point (2,) on it [m], its direction (2,)."""

    letter: str
    gap_m: float
    foot: Array
    along: Array


@dataclass(frozen=True)
class PlanSensor:
    """A sensor on the plan, with its dimensions."""

    number: int
    name: str
    kind: str
    x: float
    y: float
    height_m: float
    yaw_deg: float
    tilt_deg: float
    walls: tuple[WallDistance, ...]
    """The nearest two walls that are not parallel."""

    def label(self) -> str:
        """Format name and yaw."""
        return f"{self.name} {format_number(self.yaw_deg, 0)}°"

    def lines(self) -> tuple[str, str]:
        """Format what the plan says beside the sensor: name; height, yaw, and a tilt."""
        tilt = f", tilt {format_number(self.tilt_deg, 0)}°" if round(self.tilt_deg) else ""
        return self.name, f"h {self.height_m:.2f} m, {format_number(self.yaw_deg, 0)}°{tilt}"

    def ahead(self, reach_m: float) -> tuple[float, float]:
        """Return the point at this distance [m] ahead of the sensor on the plan."""
        yaw = np.deg2rad(self.yaw_deg)
        return float(self.x + reach_m * np.cos(yaw)), float(self.y + reach_m * np.sin(yaw))


def plan_sensors(scenario: Scenario, names: Sequence[str], building: Building) -> list[PlanSensor]:
    """Return the named sensors of a scenario, numbered as on the plan; walls in one line have one letter."""
    rows: list[PlanSensor] = []
    lines: list[tuple[Array, float]] = []
    for number, name in enumerate(names, start=1):
        description = in_the_room(scenario, name)
        mount = description.mount
        tilt = 0.0 if isinstance(description, FloorDescription) else mount.pitch_deg  # pyright: ignore[reportAttributeAccessIssue]
        here, walls = np.array(mount.xyz), list[WallDistance]()
        for gap_m, _, along in building.walls_nearest(here):
            foot = here[:2] + gap_m * np.array([along[1], -along[0]])
            off_m = float(along[0] * foot[1] - along[1] * foot[0])
            same = (n for n, (way, off) in enumerate(lines) if way @ along > _SAME_WAY and abs(off - off_m) < _SAME_M)
            if (place := next(same, None)) is None:
                place = len(lines)
                lines.append((along, off_m))
            walls.append(WallDistance(_letter(place), gap_m, foot, along))
        rows.append(PlanSensor(number, name, description.kind, *mount.xyz, mount.yaw_deg, tilt, tuple(walls)))
    return rows


def _letter(number: int) -> str:
    """Return A to Z, then AA, AB ..."""
    return (_letter(number // 26 - 1) if number >= 26 else "") + chr(ord("A") + number % 26)


def draw_directions(axes: Axes, sensors: Sequence[PlanSensor], reach_m: float) -> None:
    """Draw an arrow of this length in the direction of each sensor [m]."""
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    for each in sensors:
        axes.annotate("", each.ahead(reach_m), (each.x, each.y), arrowprops=arrow, zorder=6.5)


def draw_room(axes: Axes, building: Building, area: Array) -> None:
    """Draw the room: outlines of walls and furniture, and the floor's edge where no wall is."""
    data = building.data
    for polygon in _things(building):
        axes.fill(*polygon.T, facecolor="#d5d9df", edgecolor="#a9b0bb", linewidth=0.5, zorder=2)
    for wall in standing_footprints(building.model, data)[0]:
        if thickness_m(wall) < _WALL_M:
            axes.fill(*wall.T, facecolor="#7a838f", edgecolor="#4a525c", linewidth=0.5, zorder=2)
    for pane in room_outline(building.model, data, glass_only=True):
        axes.fill(*pane.T, facecolor="#bfe3f2", edgecolor="#3b9fc4", linewidth=0.5, zorder=2)
    for piece in building.open_edges():
        axes.plot(*piece.T, color=QUIET, linewidth=0.6, linestyle=":", zorder=3)
    axes.fill(*area.T, facecolor="none", edgecolor=QUIET, linewidth=0.7, linestyle="--", zorder=3)
    axes.set_aspect("equal")


def _things(building: Building) -> list[NDArray[np.float64]]:
    """Return the outlines (k, 2) [m] of walls and furniture, without what is around or under the whole room."""
    mujoco.mj_kinematics(building.model, building.data)
    size_m = np.ptp(building.outline, axis=0)
    every = room_outline(building.model, building.data)
    return [each for each in every if (np.ptp(each, axis=0) < 0.9 * size_m).any()]


def draw_numbered(axes: Axes, sensors: Sequence[PlanSensor], m_per_pt: float) -> None:
    """Draw dots with the sensors' numbers; those whose dots would overlap share a longer one, in their middle."""
    groups: list[list[PlanSensor]] = []
    for each in sensors:
        near = (group for group in groups if np.hypot(each.x - group[0].x, each.y - group[0].y) < DOT_PT * m_per_pt)
        if group := next(near, None):
            group.append(each)
        else:
            groups.append([each])
    for group in groups:
        x, y = np.mean([[each.x, each.y] for each in group], axis=0)
        numbers = ",".join(str(each.number) for each in group)
        axes.plot(x, y, "o", color=INK, markersize=DOT_PT, zorder=7)
        style = {"color": "white", "fontsize": 0.74 * DOT_PT, "ha": "center", "va": "center_baseline", "zorder": 8}
        if len(group) > 1:
            style["bbox"] = {"boxstyle": "round,pad=0.25,rounding_size=0.6", "fc": INK, "ec": "none"}
        axes.text(x, y, numbers, **style)


def heat_map(
    cells_m: Array, values: Array, cell_m: float, sensors: Sequence[PlanSensor], building: Building, area: Array, *,
    label: str, least: float | None = None, most: float | None = None,
) -> str:  # fmt: skip
    """Draw values (n,) at cells (n, 2) [m] as SVG; those below `least` are hatched as blind."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = area.min(axis=0), area.max(axis=0)
    shape = tuple(np.ceil((high - low) / cell_m - 1e-6).astype(int))
    grid = np.full(shape, np.nan)
    where = np.clip(((cells_m - low) / cell_m).astype(int), 0, np.array(shape) - 1)
    grid[where[:, 0], where[:, 1]] = values
    extent = (low[0], low[0] + shape[0] * cell_m, low[1], low[1] + shape[1] * cell_m)
    size = building.outline.max(axis=0) - building.outline.min(axis=0)
    with plot_style():
        figure = Figure(figsize=(5.4, 5.4 * float(np.clip(size[1] / size[0], 0.4, 1.2)) * 0.85), layout="constrained")
        axes = figure.add_subplot()
        draw_room(axes, building, area)
        norm: Any = None
        if least is not None:
            norm = LogNorm(least, max(2 * least, float(np.nanmax(grid, initial=least))))
        shown = np.where(grid >= (least or -np.inf), grid, np.nan).T
        ends: dict[str, Any] = (
            {"norm": norm, "cmap": "viridis"} if norm else {"vmin": 0.0, "vmax": most, "cmap": "magma_r"}
        )
        image = axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest", zorder=2.5, **ends)
        if least is not None and (grid < least).any():
            blind = np.ma.masked_where(~(grid < least), np.ones(shape))
            axes.imshow(
                blind.T,
                origin="lower",
                extent=extent,
                cmap="autumn",
                vmin=0,
                vmax=4,
                interpolation="nearest",
                zorder=2.6,
            )
        for polygon in _things(building):
            if thickness_m(polygon) >= _WALL_M:  # furniture and columns, which show through the colours
                axes.fill(*polygon.T, facecolor="white", edgecolor="white", alpha=0.45, linewidth=0.6, zorder=2.7)
        draw_directions(axes, sensors, 0.09 * float(size.max()))
        draw_numbered(axes, sensors, 0.0036 * float(size.max()))  # of a map that is some 280 points wide
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(False)
        bar = figure.colorbar(image, ax=axes, shrink=0.8, label=label)
        if norm is not None:
            bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            bar.ax.yaxis.set_major_formatter("{x:g}")
            bar.ax.yaxis.set_minor_formatter(NullFormatter())
        bar.ax.tick_params(labelsize=8)
        return to_svg(figure)


def pareto_plot(
    points: NDArray[np.float64], front: NDArray[np.bool_], own: int, best: int, labels: tuple[str, str], errors: Array
) -> str:
    """Draw placements (n, 2) as SVG, the second value over the first, with the front connected; errors (n,): of the second."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(6.6, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.errorbar(*points.T, yerr=errors, fmt="none", ecolor=SHADE, zorder=1)
        axes.plot(*points[~front].T, "o", color=OLD, markersize=3, label="tried", zorder=2)
        order = np.argsort(points[front][:, 0])
        axes.plot(
            *points[front][order].T, "-o", color="#2678c4", markersize=5, label="nothing is better in all", zorder=3
        )
        axes.plot(*points[own], "X", color=INK, markersize=9, label="baseline", zorder=4)
        axes.plot(*points[best], "*", color=ACCENT, markersize=14, label="recommended", zorder=5)
        axes.set(xlabel=labels[0], ylabel=labels[1])
        axes.legend(frameon=False, fontsize=8)
        return to_svg(figure)


def trial_map(
    places_m: Array,
    values: Array,
    own_m: Array,
    sensors: Sequence[PlanSensor],
    building: Building,
    area: Array,
    label: str,
) -> str:
    """Draw the positions of trials' devices (n, 2) [m], the best last, coloured by their values (n,), as SVG.

    own_m: the baseline's (k, 2) [m]; sensors: recommended ones.
    """
    from matplotlib.figure import Figure

    size = building.outline.max(axis=0) - building.outline.min(axis=0)
    with plot_style():
        figure = Figure(figsize=(6.6, 6.0 * float(np.clip(size[1] / size[0], 0.4, 1.2)) * 0.85), layout="constrained")
        axes = figure.add_subplot()
        draw_room(axes, building, area)
        low = float(np.quantile(values, 0.1))  # a few complete failures would use up the range of colours
        dots = axes.scatter(*places_m.T, c=values, vmin=low, cmap="viridis", s=42, edgecolors="white", lw=0.6, zorder=5)
        axes.plot(*own_m.T, "x", color=INK, markersize=8, markeredgewidth=2, zorder=6)
        for each in sensors:
            axes.plot(each.x, each.y, "o", color="none", markeredgecolor=ACCENT, markersize=11, mew=1.6, zorder=7)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(False)
        bar = figure.colorbar(dots, ax=axes, shrink=0.8, label=label, extend="min")
        bar.ax.tick_params(labelsize=8)
        return to_svg(figure)
