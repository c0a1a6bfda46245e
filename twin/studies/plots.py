"""Plots of a study's page: a plan to scale with dimensions, heat maps, the Pareto front. SVG, by matplotlib."""

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
from twin.studies.devices import Cable, Constraints, KeepFreeZone

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MM = 1 / 25.4
_WIDEST_MM, _HIGHEST_MM = 180.0, 215.0
_BAR_MM = 6.0
"""Height of the strip below the plan for the scale bar."""
_SCALES = (10, 20, 25, 50, 100, 150, 200, 250, 500, 1000)
_MARGIN_M = 0.4
_WALL_M = 0.4
"""Thickness from which what is as high as a wall is drawn as furniture, a wardrobe for instance [m]."""
_SHORTEST_MM = 9.0
_TEXT_PT = 7.0
"""Size of all text on the plan."""
_DOT_PT = 9.5
_ACCENT, _OLD, _CABLE = "#b5341f", "#98a0ac", "#2678c4"
_LABEL: dict[str, Any] = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8}


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
    walls_m: tuple[float, ...]
    """Distances to the nearest two walls that are not parallel [m]."""

    def label(self) -> str:
        """Format name and yaw."""
        return f"{self.name} {format_number(self.yaw_deg, 0)}°"

    def ahead(self, reach_m: float) -> tuple[float, float]:
        """Return the point at this distance [m] ahead of the sensor on the plan."""
        yaw = np.deg2rad(self.yaw_deg)
        return float(self.x + reach_m * np.cos(yaw)), float(self.y + reach_m * np.sin(yaw))


def plan_sensors(scenario: Scenario, names: Sequence[str], building: Building) -> list[PlanSensor]:
    """Return the named sensors of a scenario, numbered as on the plan."""
    rows = []
    for number, name in enumerate(names, start=1):
        description = in_the_room(scenario, name)
        mount = description.mount
        tilt = 0.0 if isinstance(description, FloorDescription) else mount.pitch_deg  # pyright: ignore[reportAttributeAccessIssue]
        walls = building.walls_nearest(np.array(mount.xyz))
        rows.append(
            PlanSensor(
                number, name, description.kind, *mount.xyz, mount.yaw_deg, tilt, tuple(each[0] for each in walls)
            )
        )
    return rows


def floor_plan(
    scenario: Scenario,
    own: Scenario,
    sensors: Sequence[PlanSensor],
    building: Building,
    area: Array,
    constraints: Constraints,
    devices_m: Sequence[Array] = (),
) -> tuple[str, int, float]:
    """Draw the plan; return its SVG, the scale 1 : n, and its width [mm].

    own: the scenario before the study; constraints: zones and cables to draw; devices_m: ends of the cables (3,) [m].
    """
    from matplotlib.figure import Figure

    low, high = building.outline.min(axis=0) - _MARGIN_M, building.outline.max(axis=0) + _MARGIN_M
    most_mm = np.array([_WIDEST_MM, _HIGHEST_MM - _BAR_MM])
    scale = next((each for each in _SCALES if np.all(1000 * (high - low) / each <= most_mm)), _SCALES[-1])
    low[1] -= _BAR_MM * scale / 1000
    size_m = high - low
    width_mm, height_mm = 1000 * size_m / scale
    with plot_style():
        figure = Figure(figsize=(width_mm * _MM, height_mm * _MM))
        axes = figure.add_axes((0, 0, 1, 1))
        _room(axes, building, area)
        _zones(axes, constraints.keep_free)
        if constraints.cable is not None:
            _cables(axes, constraints.cable, building, devices_m)
        for name, each in own.sensors.items():
            if not isinstance(each, FloorDescription) and scenario.sensors.get(name) != each:
                x, y, _ = in_the_room(own, name).mount.xyz
                axes.plot(x, y, "x", color=_OLD, markersize=5, zorder=4)
        for each in {(round(each.x, 2), round(each.y, 2)): each for each in reversed(sensors)}.values():
            _dimensions(axes, each, building, scale)
        m_per_pt = scale * 0.0254 / 72
        _directions(axes, sensors, 0.007 * scale)
        _numbered(axes, sensors, m_per_pt)
        _names(axes, sensors, 0.0085 * scale, m_per_pt)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])
        for side in axes.spines.values():
            side.set_visible(False)
        axes.grid(False)
        metre = 1.0 if size_m[0] > 3 else 0.5
        axes.plot([low[0] + 0.1, low[0] + 0.1 + metre], [low[1] + 0.12] * 2, color=INK, lw=1.5, zorder=9)
        _write(axes, (low[0] + 0.1 + metre / 2, low[1] + 0.16), f"{metre:g} m", va="bottom")
        return to_svg(figure), scale, float(width_mm)


def _write(axes: Axes, at: Sequence[float] | Array, text: str, **style: Any) -> None:
    """Write text on a light background in the plan's size, centred unless styled otherwise."""
    axes.text(
        at[0],
        at[1],
        text,
        **{"fontsize": _TEXT_PT, "ha": "center", "va": "center", "zorder": 6, "bbox": _LABEL, **style},
    )


def _zones(axes: Axes, zones: Sequence[KeepFreeZone]) -> None:
    """Hatch and name the zones without devices."""
    for zone in zones:
        corners = np.array(zone.polygon)
        axes.fill(*corners.T, facecolor="none", edgecolor=_ACCENT, linewidth=0.6, hatch="///", alpha=0.5, zorder=3.5)
        _write(axes, corners.mean(axis=0), zone.name, color=_ACCENT)


def _directions(axes: Axes, sensors: Sequence[PlanSensor], reach_m: float) -> None:
    """Draw an arrow of this length in the direction of each sensor [m]."""
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    for each in sensors:
        axes.annotate("", each.ahead(reach_m), (each.x, each.y), arrowprops=arrow, zorder=6.5)


def _cables(axes: Axes, cable: Cable, building: Building, devices_m: Sequence[Array]) -> None:
    """Draw the route of the cable to each device (3,) [m], and their common start."""
    start = np.array(cable.start)
    for place in devices_m:
        straight = np.vstack([start[:2], place[:2]])
        way = straight if cable.along == "straight" else building.route_along_walls(start, place)
        axes.plot(*way.T, color=_CABLE, linewidth=1.1, linestyle=(0, (4, 1.5)), zorder=4)
    axes.plot(*start[:2], "s", color=_CABLE, markersize=5, zorder=6)


def _dimensions(axes: Axes, sensor: PlanSensor, building: Building, scale: int) -> None:
    """Draw the distances of a sensor from the nearest two walls, with a number if it fits."""
    here = np.array([sensor.x, sensor.y, sensor.height_m])
    arrow = {"arrowstyle": "<->", "color": _ACCENT, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
    for gap_m, _, along in building.walls_nearest(here):
        foot = here[:2] + gap_m * np.array([along[1], -along[0]])
        axes.annotate("", tuple(here[:2]), tuple(foot), arrowprops=arrow)
        if 1000 * gap_m / scale < _SHORTEST_MM:  # listed in the table
            continue
        share = (0.3, 0.5, 0.7)[sensor.number % 3]  # numbers of coinciding lines stay apart
        at = here[:2] + share * (foot - here[:2]) + 0.0012 * scale * along
        turn = 90 - (90 - np.rad2deg(np.arctan2(*(foot - here[:2])[::-1]))) % 180  # along the line, never upside down
        _write(axes, at, f"{gap_m:.2f}", color=_ACCENT, rotation=turn)


def _names(axes: Axes, sensors: Sequence[PlanSensor], reach_m: float, m_per_pt: float) -> None:
    """Write name and yaw of each sensor beyond its arrow, or where the next line is free of other names."""
    line_m, written = 1.5 * _TEXT_PT * m_per_pt, list[tuple[float, float, float]]()  # left, right, y
    for each in sensors:
        x, y = each.ahead(reach_m)
        along = np.cos(np.deg2rad(each.yaw_deg))
        side = "center" if abs(along) < 0.5 else "left" if along > 0 else "right"
        step = line_m if y > each.y and abs(along) <= 0.85 else -line_m
        if abs(along) <= 0.85:
            y += step / 2  # the text begins or ends there
        width = 0.62 * _TEXT_PT * m_per_pt * len(each.label())
        left = x - width * {"left": 0.0, "center": 0.5, "right": 1.0}[side]
        while any(left < end and start < left + width and abs(y - at) < 0.99 * line_m for start, end, at in written):
            y += step
        written.append((left, left + width, y))
        _write(axes, (x, y), each.label(), ha=side)


def _room(axes: Axes, building: Building, area: Array) -> None:
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


def _numbered(axes: Axes, sensors: Sequence[PlanSensor], m_per_pt: float) -> None:
    """Draw dots with the sensors' numbers; those whose dots would overlap share a longer one, in their middle."""
    groups: list[list[PlanSensor]] = []
    for each in sensors:
        near = (group for group in groups if np.hypot(each.x - group[0].x, each.y - group[0].y) < _DOT_PT * m_per_pt)
        if group := next(near, None):
            group.append(each)
        else:
            groups.append([each])
    for group in groups:
        x, y = np.mean([[each.x, each.y] for each in group], axis=0)
        numbers = ",".join(str(each.number) for each in group)
        axes.plot(x, y, "o", color=INK, markersize=_DOT_PT, zorder=7)
        style = {"color": "white", "fontsize": 0.74 * _DOT_PT, "ha": "center", "va": "center_baseline", "zorder": 8}
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
        _room(axes, building, area)
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
        _directions(axes, sensors, 0.09 * float(size.max()))
        _numbered(axes, sensors, 0.0036 * float(size.max()))  # of a map that is some 280 points wide
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
        axes.plot(*points[~front].T, "o", color=_OLD, markersize=3, label="tried", zorder=2)
        order = np.argsort(points[front][:, 0])
        axes.plot(
            *points[front][order].T, "-o", color="#2678c4", markersize=5, label="nothing is better in all", zorder=3
        )
        axes.plot(*points[own], "X", color=INK, markersize=9, label="the scenario's own", zorder=4)
        axes.plot(*points[best], "*", color=_ACCENT, markersize=14, label="recommended", zorder=5)
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

    own_m: the scenario's own (k, 2) [m]; sensors: recommended ones.
    """
    from matplotlib.figure import Figure

    size = building.outline.max(axis=0) - building.outline.min(axis=0)
    with plot_style():
        figure = Figure(figsize=(6.6, 6.0 * float(np.clip(size[1] / size[0], 0.4, 1.2)) * 0.85), layout="constrained")
        axes = figure.add_subplot()
        _room(axes, building, area)
        low = float(np.quantile(values, 0.1))  # a few complete failures would use up the range of colours
        dots = axes.scatter(*places_m.T, c=values, vmin=low, cmap="viridis", s=42, edgecolors="white", lw=0.6, zorder=5)
        axes.plot(*own_m.T, "x", color=INK, markersize=8, markeredgewidth=2, zorder=6)
        for each in sensors:
            axes.plot(each.x, each.y, "o", color="none", markeredgecolor=_ACCENT, markersize=11, mew=1.6, zorder=7)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.grid(False)
        bar = figure.colorbar(dots, ax=axes, shrink=0.8, label=label, extend="min")
        bar.ax.tick_params(labelsize=8)
        return to_svg(figure)
