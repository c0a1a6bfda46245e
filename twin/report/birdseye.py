"""Bird's-eye view: the map from floor to picture, and the room, tracked area and sensors on it.

Shared by the preview video (pixels, OpenCV) and the report (SVG).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from math import ceil, floor, log10

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.observations import LaserScan, Odometry
from trackers.rig import Pose, Rig
from twin.report.palette import LETTER_PX, RGB, SvgLabels

Polygon = NDArray[np.float64]  # (k, 2) corners on the floor [m], room frame

_MARGIN_M = 0.4
"""Floor shown around the room [m]."""
_PLAN_ASPECTS = 0.7, 1.8
"""Limits of a plan's width over its height."""
SHIFT = 4  # cv2 draws at 1/16 pixel
_SHELL_M2 = 4.0
_SAME_PLACE_PX = 12.0
_FARTHEST_PX = 20_000  # clipping distance, as int32 would overflow


@dataclass(frozen=True, eq=False)
class Site:
    """Surroundings of a run: rig of the trackers, walls and furniture (k, 2) [m], and people's names by id, as far as known.

    glass: panes among them; true_rig: true poses of the sensors, where `rig` differs; shown: points (k, 2) a plan fits [m].
    """

    rig: Rig
    outline: Sequence[Polygon] = ()
    person_names: Mapping[int, str] = field(default_factory=dict)
    true_rig: Rig | None = None
    glass: Sequence[Polygon] = ()
    shown: Polygon | None = None


@dataclass(frozen=True)
class FloorView:
    """Part of the floor in a picture: room x to the right, room y up, equal scale on both axes.

    `scale` [px/m]; (`x_min_m`, `y_max_m`): the picture's top left corner; `width_px`, `height_px`: its size.
    """

    x_min_m: float
    y_max_m: float
    scale: float
    width_px: int
    height_px: int

    @classmethod
    def fit(cls, extent: Polygon, width_px: int, height_px: int | None = None) -> FloorView:
        """Fit a view to the bounding box of `extent` (k, 2) [m], centred in a picture of this size.

        Without a height the picture follows the box, between a third and four fifths of the width.
        """
        low, high = extent.min(axis=0) - _MARGIN_M, extent.max(axis=0) + _MARGIN_M
        size = np.maximum(high - low, 1.0)
        if height_px is None:
            height_px = round(float(np.clip(size[1] / size[0], 1 / 3, 0.8)) * width_px)
        scale = float(min(width_px / size[0], height_px / size[1]))
        centre = (low + high) / 2
        return cls(
            x_min_m=float(centre[0] - width_px / scale / 2),
            y_max_m=float(centre[1] + height_px / scale / 2),
            scale=scale,
            width_px=width_px,
            height_px=height_px,
        )

    def pixels(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert floor points (..., 2) [m] to picture coordinates (..., 2) [px], x right and y down."""
        return (xy_m - np.array([self.x_min_m, self.y_max_m])) * np.array([self.scale, -self.scale])

    @property
    def drawable_m(self) -> float:
        """Distance from anywhere in the picture up to which `fixed_point` keeps the end of a line [m]."""
        return (_FARTHEST_PX - max(self.width_px, self.height_px)) / self.scale

    def inside(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which picture coordinates (..., 2) lie in the picture, (...,)."""
        x, y = pixels[..., 0], pixels[..., 1]
        return (x >= 0) & (x < self.width_px) & (y >= 0) & (y < self.height_px)

    def metre_lines(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Find the whole metres (every 1, 2, 5, 10 ... m, at least 36 px apart) across the x and the y axis [m]."""
        power = 10 ** max(0, floor(log10(36 / self.scale)))
        step = next(s * power for s in (1, 2, 5, 10, 20) if s * power * self.scale >= 36)
        x_max, y_min = self.x_min_m + self.width_px / self.scale, self.y_max_m - self.height_px / self.scale
        return (
            np.arange(ceil(self.x_min_m / step) * step, x_max, step, dtype=float),
            np.arange(ceil(y_min / step) * step, self.y_max_m, step, dtype=float),
        )


def floor_extent(rig: Rig, outline: Sequence[Polygon], *seen: Polygon) -> Polygon:
    """Collect the floor points (k, 2) [m] that a drawing must show: the room, the tracked area and the sensors.

    Without room and area, sets of points (n, 2) [m] (of scans, paths) replace them: of each the middle 96 % on either axis,
    so that a stray return down a corridor does not shrink the rest.
    """
    parts = [np.asarray(polygon, dtype=float) for polygon in outline]
    if rig.area is not None:
        parts.append(np.array(rig.area, dtype=float))
    if not parts:
        parts.extend(np.percentile(points, (2, 98), axis=0) for points in seen if len(points))
    parts.extend(rig.pose_at(name).translation[None, :2] for name in rig.sensors)
    extent = np.concatenate(parts) if parts else np.zeros((1, 2))
    if np.ptp(extent, axis=0).max() < 1.0:  # a single sensor: show the metres around it
        extent = np.concatenate([extent - 3.0, extent + 3.0])
    return extent


def plan_width_px(rig: Rig, outline: Sequence[Polygon], height_px: int, shown: Polygon | None = None) -> int:
    """Return the width of a plan of this height without empty borders [px]; a square where neither is known."""
    if not outline and shown is None:
        return height_px
    across = np.ptp(floor_extent(rig, outline) if shown is None else shown, axis=0) + 2 * _MARGIN_M
    return round(height_px * float(np.clip(across[0] / across[1], *_PLAN_ASPECTS)))


class ScannerOnFloor:
    """Projection of a scanner's beams to the floor."""

    def __init__(self, room_from_sensor: Pose) -> None:
        self._rotation = room_from_sensor.rotation[:2, :2]
        self._origin = room_from_sensor.translation[:2]

    @property
    def place(self) -> NDArray[np.float64]:
        """Place of the scanner, (2,) [m]."""
        return self._origin

    @staticmethod
    def of(rig: Rig, odometry: Odometry | None = None) -> dict[str, ScannerOnFloor]:
        """Return the scanners of a rig by name: all, or those on the base of which this odometry speaks, where they are."""
        if odometry is None:
            return {name: ScannerOnFloor(rig.pose_at(name)) for name in rig.lasers()}
        on_it = [name for name, base in rig.mounted().items() if base == odometry.sensor and name in rig.lasers()]
        return {name: ScannerOnFloor(rig.pose_at(name, odometry.frame_from_base)) for name in on_it}

    def points(self, scan: LaserScan) -> Polygon:
        """Project the valid returns of a scan, (n, 2) [m] in the room frame."""
        ranges = scan.ranges_m.astype(float)
        valid = np.isfinite(ranges) & (ranges >= scan.range_min_m) & (ranges <= scan.range_max_m)
        return self._ends(ranges[valid], scan.angles_rad[valid])

    def free_space(self, scan: LaserScan, within_m: float) -> Polygon:
        """Build the polygon (n + 1, 2) [m] of floor that a scan saw through, from the scanner to each return.

        A beam without return reaches the range limit; an invalid one (NaN) sees nothing. All are cut at `within_m` along the
        beam: cut per axis in the picture they would change direction (`FloorView.drawable_m`).
        """
        farthest_m = min(scan.range_max_m, within_m)
        ranges = np.clip(np.nan_to_num(scan.ranges_m.astype(float), nan=0.0, posinf=farthest_m), 0.0, farthest_m)
        return np.concatenate([self._origin[None], self._ends(ranges, scan.angles_rad)])

    def reach(self, scan: LaserScan) -> Polygon:
        """Estimate the reach of a scanner, (k, 2) [m]: its returns, and their median range all around, since people may walk
        where nothing returns a beam.

        Empty without returns.
        """
        hits = self.points(scan)
        if not len(hits):
            return hits
        median_m = float(np.median(np.hypot(*(hits - self._origin).T)))
        return np.concatenate([hits, self._ends(np.full(scan.ranges_m.size, median_m), scan.angles_rad)])

    def _ends(self, ranges_m: NDArray[np.float64], angles_rad: NDArray[np.float64]) -> Polygon:
        in_plane = np.stack([ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)], axis=-1)
        return in_plane @ self._rotation.T + self._origin


# ---------------------------------------------------------------------------------------------- pixels


@dataclass(frozen=True)
class FloorColours:
    """RGB of the parts of a drawn room."""

    floor: RGB
    grid: RGB
    structure: RGB
    structure_edge: RGB
    area: RGB
    sensor: RGB
    glass: RGB


def fixed_point(pixels: NDArray[np.float64]) -> NDArray[np.int32]:
    """Convert picture coordinates for cv2 with `shift=SHIFT` (1/16 px), clipped where int32 would overflow."""
    return np.rint(np.minimum(np.maximum(pixels, -_FARTHEST_PX), _FARTHEST_PX) * (1 << SHIFT)).astype(np.int32)


def paint_room(
    canvas: NDArray[np.uint8],
    view: FloorView,
    rig: Rig,
    outline: Sequence[Polygon],
    colours: FloorColours,
    glass: Sequence[Polygon] = (),
) -> None:
    """Draw floor, metre grid, outlines and panes of the room, the tracked area (dashed) and the sensors on an RGB canvas."""
    canvas[:] = colours.floor
    x_lines, y_lines = view.metre_lines()
    for x in view.pixels(np.stack([x_lines, np.zeros_like(x_lines)], axis=-1))[:, 0]:
        cv2.line(canvas, (round(x), 0), (round(x), view.height_px), colours.grid, 1)
    for y in view.pixels(np.stack([np.zeros_like(y_lines), y_lines], axis=-1))[:, 1]:
        cv2.line(canvas, (0, round(y)), (view.width_px, round(y)), colours.grid, 1)
    for polygon in outline:
        corners = fixed_point(view.pixels(polygon))
        if not _is_shell(polygon, rig):
            cv2.fillPoly(canvas, [corners], colours.structure, cv2.LINE_AA, SHIFT)
        cv2.polylines(canvas, [corners], True, colours.structure_edge, 1, cv2.LINE_AA, SHIFT)
    for pane in glass:
        corners = fixed_point(view.pixels(pane))
        cv2.fillPoly(canvas, [corners], colours.glass, cv2.LINE_AA, SHIFT)
        cv2.polylines(canvas, [corners], True, colours.glass, 1, cv2.LINE_AA, SHIFT)
    if rig.area is not None:
        for start, end in dashes(view.pixels(np.array(rig.area)), 7.0, 5.0):
            cv2.line(
                canvas,
                fixed_point(start).tolist(),
                fixed_point(end).tolist(),
                colours.area,
                1,
                cv2.LINE_AA,
                SHIFT,
            )
    moving = {*rig.mounted(), *rig.odometry()}
    for pose in (rig.pose_at(name) for name in rig.sensors if name not in moving):
        centre = fixed_point(view.pixels(pose.translation[:2])).tolist()
        cv2.circle(canvas, centre, 5 << SHIFT, colours.sensor, -1, cv2.LINE_AA, SHIFT)


def dashes(
    corners: NDArray[np.float64], dash_px: float, gap_px: float
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Cut a closed polygon (k, 2) into dashes (start, end) [px]."""
    dashes = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        if length == 0.0:
            continue
        along = (end - start) / length
        for offset in np.arange(0.0, length, dash_px + gap_px):
            dashes.append((start + along * offset, start + along * min(offset + dash_px, length)))
    return dashes


def _is_shell(polygon: Polygon, rig: Rig) -> bool:
    """Return whether a polygon, filled, would hide all else: the room around the tracked area (or sensors)."""
    corners = np.asarray(polygon, dtype=np.float32)
    sensors = [rig.pose_at(name).translation[:2] for name in rig.sensors]
    inner = np.array(rig.area if rig.area is not None else sensors, dtype=float).reshape(-1, 2)
    enclosed = all(cv2.pointPolygonTest(corners, (float(x), float(y)), False) >= 0 for x, y in inner)
    return enclosed and cv2.contourArea(corners) > _SHELL_M2


# ------------------------------------------------------------------------------------------------- SVG


def room_svg(
    view: FloorView,
    rig: Rig,
    outline: Sequence[Polygon],
    silent: Collection[str] = (),
    glass: Sequence[Polygon] = (),
) -> str:
    """Draw the same room as SVG elements (classes `floor grid axis structure shell glass area sensor silent`, coloured by the
    page).

    `silent`: sensors without reports.
    """
    x_lines, y_lines = view.metre_lines()
    parts = [f'<rect class="floor" width="{view.width_px}" height="{view.height_px}"/>']
    x_px = view.pixels(np.stack([x_lines, np.zeros_like(x_lines)], axis=-1))[:, 0]
    y_px = view.pixels(np.stack([np.zeros_like(y_lines), y_lines], axis=-1))[:, 1]
    grid = "".join(f"M{x:.1f} 0V{view.height_px}" for x in x_px) + "".join(f"M0 {y:.1f}H{view.width_px}" for y in y_px)
    parts.append(f'<path class="grid" d="{grid}"/>')
    for polygon in outline:
        kind = "shell" if _is_shell(polygon, rig) else "structure"
        parts.append(f'<path class="{kind}" d="{svg_path(view.pixels(polygon), closed=True)}"/>')
    parts.extend(f'<path class="glass" d="{svg_path(view.pixels(pane), closed=True)}"/>' for pane in glass)
    if rig.area is not None:
        area = svg_path(view.pixels(np.array(rig.area)), closed=True)
        parts.append(f'<path class="area" d="{area}"><title>Tracked area</title></path>')
    parts.extend(
        f'<text class="axis" x="{x:.1f}" y="{view.height_px - 5}" text-anchor="middle">{_signed(metres)}</text>'
        for x, metres in zip(x_px, x_lines, strict=True)
        if 14 < x < view.width_px - 14
    )
    parts.extend(
        f'<text class="axis" x="5" y="{y + 3.5:.1f}">{_signed(metres)}</text>'
        for y, metres in zip(y_px, y_lines, strict=True)
        if 14 < y < view.height_px - 18
    )
    for name in rig.sensors:
        x, y = view.pixels(rig.pose_at(name).translation[:2])
        kind, text = ("sensor silent", f"{name}: silent") if name in silent else ("sensor", name)
        parts.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="5"><title>{escape(text)}</title></circle>')
    return "".join(parts)


def sensor_names_svg(view: FloorView, rig: Rig, labels: SvgLabels, silent: Collection[str] = ()) -> str:
    """Write the names of the sensors beside them (class `sensor-name`); sensors above each other share a line.

    `silent`: sensors without reports, which is noted.
    """
    together: list[tuple[NDArray[np.float64], list[str]]] = []
    for name in rig.sensors:
        at = view.pixels(rig.pose_at(name).translation[:2])
        if not view.inside(at):
            continue
        for place, names in together:
            if np.hypot(*(place - at)) < _SAME_PLACE_PX:
                names.append(name)
                break
        else:
            together.append((at, [name]))
    parts = []
    for (x, y), names in together:
        text = ", ".join(f"{name}: silent" if name in silent else name for name in names)
        turned = x + 9 + LETTER_PX * len(text) > view.width_px
        y = min(max(y, 14.0), view.height_px - 22.0)  # clear of the metres along the edge
        parts.append(labels.write("sensor-name", text, x - 9 if turned else x + 9, y - 5, "end" if turned else "start"))
    return "".join(parts)


def svg_path(pixels: NDArray[np.float64], closed: bool = False) -> str:
    """Format a line through picture coordinates (k, 2) as path data, simplified to 0.3 px."""
    if len(pixels) > 3:
        thin = cv2.approxPolyDP(np.asarray(pixels, dtype=np.float32)[:, None], 0.3, closed)
        pixels = np.asarray(thin[:, 0], dtype=np.float64)
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in pixels) + ("Z" if closed else "")


def _signed(metres: float) -> str:
    return f"{metres:g}".replace("-", "−")
