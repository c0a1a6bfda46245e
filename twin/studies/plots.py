"""Plots of a study's page: heat maps, the Pareto front, and the room and sensors on any plan. SVG, by matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
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
TEXT_PT = 7.0
"""Size of all text on the plan."""
LETTER_EM, LINE_EM = 0.6, 1.45
"""Width of a letter, and height of a line, of the text's size."""
_LABEL: dict[str, Any] = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8}
_OVER_TEXT = 1000.0
"""Cost of a label over another, beside that of a point that it covers: 1."""
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

    @property
    def yaw(self) -> str:
        """The yaw as written wherever the sensor is on the page."""
        return f"{format_number(self.yaw_deg, 0)}°"

    def label(self) -> str:
        """Format name and yaw."""
        return f"{self.name} {self.yaw}"

    def from_wall(self) -> str:
        """Format the direction as seen with one's back to the nearest wall: the angle from straight off it."""
        if not self.walls:
            return "–"
        wall = self.walls[0]
        straight_deg = np.rad2deg(np.arctan2(wall.along[0], -wall.along[1]))
        turn = round(float((self.yaw_deg - straight_deg + 180) % 360 - 180))
        return (
            f"{abs(turn)}° {'left' if turn > 0 else 'right'} of straight off {wall.letter}"
            if turn
            else f"straight off {wall.letter}"
        )

    def lines(self) -> tuple[str, str]:
        """Format what the plan says beside the sensor: name; height, yaw, and a tilt."""
        tilt = f", tilt {format_number(self.tilt_deg, 0)}°" if round(self.tilt_deg) else ""
        return self.name, f"h {self.height_m:.2f} m, {self.yaw}{tilt}"

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


def wall_middles(sensors: Sequence[PlanSensor], building: Building) -> dict[str, tuple[Array, Array]]:
    """Return the middle (2,) [m] and direction (2,) of each lettered wall: of its longest piece on the outline."""
    found: dict[str, tuple[Array, Array]] = {}
    start, end = building.outline, np.roll(building.outline, -1, axis=0)
    way = end - start
    length_m = np.hypot(*way.T)
    for wall in (each for sensor in sensors for each in sensor.walls):
        outwards = np.array([wall.along[1], -wall.along[0]])
        off_m = np.abs(np.stack([start - wall.foot, end - wall.foot]) @ outwards).max(axis=0)
        pieces = np.flatnonzero((way @ wall.along > _SAME_WAY * length_m) & (off_m < _SAME_M))
        longest = pieces[np.argmax(length_m[pieces])] if len(pieces) else None
        middle = wall.foot if longest is None else (start + end)[longest] / 2
        found.setdefault(wall.letter, (middle, wall.along))
    return found


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
    for polygon in things(building):
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


def things(building: Building) -> list[NDArray[np.float64]]:
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


@dataclass
class Labels:
    """Texts of a plan, each at that of its places where it covers least."""

    axes: Axes
    m_per_pt: float
    low: Array
    high: Array
    points: list[Array] = field(default_factory=list)  # (n, 3): place [m], weight
    boxes: list[tuple[Array, Array]] = field(default_factory=list)  # middle and half the size [m]

    def keep_clear(self, *corners: Array, weight: float = 1.0) -> None:
        """Let labels keep off a line through corners (2,) [m]."""
        step_m = 2 * self.m_per_pt
        for start, end in pairwise((corners[0], *corners)):
            share = np.linspace(0, 1, 2 + int(np.hypot(*(end - start)) / step_m))[:, None]
            line = start + share * (end - start)
            self.points.append(np.column_stack([line, np.full(len(line), weight)]))

    def keep_box(self, middle: Sequence[float] | Array, size_m: Array) -> None:
        """Let labels keep off a box."""
        self.boxes.append((np.asarray(middle, float), size_m / 2))

    def write(self, text: str, places: Array, *, turn_deg: float = 0.0, **style: Any) -> None:
        """Write text on a light background, its middle at one of the places (n, 2) [m]: the first of those that cover least."""
        lines = text.split("\n")
        style.setdefault("bbox", _LABEL)
        size_pt = TEXT_PT * np.array([LETTER_EM * max(map(len, lines)), LINE_EM * len(lines)])
        turn = np.deg2rad(turn_deg)
        half = np.abs([[np.cos(turn), np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ size_pt * self.m_per_pt / 2
        points = np.concatenate(self.points) if self.points else np.zeros((0, 3))
        costs = [self._cost(each, half, points) for each in places]
        best = places[int(np.argmin(np.round(costs, 6)))]
        self.keep_box(best, 2 * half)
        self.axes.text(
            best[0], best[1], text, fontsize=TEXT_PT, ha="center", va="center", zorder=6, rotation=turn_deg, **style
        )  # fmt: skip

    def _cost(self, middle: Array, half: Array, points: Array) -> float:
        covered = (np.abs(points[:, :2] - middle) < half).all(axis=1)
        overlaps = [np.prod(np.clip(half + other - np.abs(middle - at), 0, None)) for at, other in self.boxes]
        beyond = np.clip(self.low - middle + half, 0, None) + np.clip(middle + half - self.high, 0, None)
        own = float(np.prod(2 * half))
        return float(points[covered, 2].sum() + _OVER_TEXT * (sum(overlaps) / own + beyond.sum()))


def around(middle: Array | Sequence[float], first_m: float, start_rad: float = 0.0, steps: int = 4) -> Array:
    """Return places (n, 2) [m] around one, nearest first, from a direction on."""
    turns = start_rad + np.deg2rad([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([np.asarray(middle) + first_m * (1 + 0.4 * ring) * around for ring in range(steps)])


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
            style = {"cmap": "autumn", "vmin": 0, "vmax": 4, "interpolation": "nearest", "zorder": 2.6}
            axes.imshow(blind.T, origin="lower", extent=extent, **style)
        for polygon in things(building):
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
