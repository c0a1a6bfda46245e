"""Plan to scale that sensors are mounted by: dimensions to lettered walls, zones, cables (an SVG); and their parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trackers.area import Area
from trackers.arrays import Array
from trackers.cameras.intrinsics import FisheyeIntrinsics
from twin.report.palette import INK, QUIET, plot_style, to_svg
from twin.room.building import Building
from twin.room.doorways import Doorway, cable_route, doorways, highest_m, piece_across
from twin.scenario import Scenario
from twin.scenario.housings import in_the_room
from twin.scenario.sensor_descriptions import FloorDescription, LaserDescription
from twin.studies.apply_placement import apply_placement
from twin.studies.candidate_set import CandidatePose
from twin.studies.devices import Cable, Constraints, Device, KeepFreeZone, format_price
from twin.studies.plots import (
    ACCENT,
    DOT_PT,
    LETTER_EM,
    LINE_EM,
    OLD,
    TEXT_PT,
    Labels,
    PlanSensor,
    around,
    draw_directions,
    draw_numbered,
    draw_room,
    things,
    wall_middles,
)
from twin.studies.results import StudyResults
from twin.studies.validation import moved_sensors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MM = 1 / 25.4
_WIDEST_MM, _HIGHEST_MM = 180.0, 215.0
_BAR_MM = 6.0
"""Height of the strip below the plan for the scale bar."""
_SCALES = (10, 20, 25, 50, 100, 150, 200, 250, 500, 1000)
_MARGIN_MM = 17.0
"""Around the room: letters of walls, and its overall dimensions."""
_OVERALL_MM = 11.0
"""Distance of the overall dimensions from the room."""
_SHORTEST_MM = 9.0
"""Length from which a dimension's number stands along its line."""
_CABLE = "#2678c4"
_ORIGIN_M = 0.5
"""Length of the axes at the origin [m]."""


def margin_m(scale: int) -> float:
    """Return the margin around the room at a scale of 1 : n [m]."""
    return 0.001 * _MARGIN_MM * scale


def floor_plan(
    scenario: Scenario,
    own: Scenario,
    sensors: Sequence[PlanSensor],
    building: Building,
    area: Array,
    constraints: Constraints,
    devices_m: Sequence[Array] = (),
    zones: Sequence[KeepFreeZone] = (),
) -> tuple[str, int, float]:
    """Draw the plan; return its SVG, the scale 1 : n, and its width [mm].

    own: the scenario before the study; constraints: of the cables to draw; devices_m: ends of the cables (3,) [m]; zones: as
    polygons.
    """
    from matplotlib.figure import Figure

    low, high = building.outline.min(axis=0), building.outline.max(axis=0)
    most_mm = np.array([_WIDEST_MM, _HIGHEST_MM - _BAR_MM]) - 2 * _MARGIN_MM
    scale = next((each for each in _SCALES if np.all(1000 * (high - low) / each <= most_mm)), _SCALES[-1])
    low, high = low - margin_m(scale), high + margin_m(scale)
    low[1] -= _BAR_MM * scale / 1000
    size_m = high - low
    width_mm, height_mm = 1000 * size_m / scale
    with plot_style():
        figure = Figure(figsize=(width_mm * _MM, height_mm * _MM))
        axes = figure.add_axes((0, 0, 1, 1))
        draw_room(axes, building, area)
        labels = Labels(axes, scale * 0.0254 / 72, low, high)
        labels.keep_clear(*building.outline[np.r_[: len(building.outline), 0]], weight=0.2)
        for corners in things(building):
            labels.keep_clear(*corners[np.r_[: len(corners), 0]], weight=0.6)
        _overall(axes, building, labels, scale)
        before: list[Array] = []
        for name, each in own.sensors.items():
            if not isinstance(each, FloorDescription) and scenario.sensors.get(name) != each:
                x, y, _ = in_the_room(own, name).mount.xyz
                axes.plot(x, y, "x", color=OLD, markersize=5, zorder=4)
                labels.keep_clear(np.array([x, y]), weight=10)
                before.append(np.array([x, y]))
        over = _cables(axes, constraints.cable, building, devices_m, labels)
        places = list({(round(each.x, 2), round(each.y, 2)): each for each in reversed(sensors)}.values())
        reach_m = 0.007 * scale
        for each in sensors:
            labels.keep_clear(np.array([each.x, each.y]), np.array(each.ahead(reach_m)), weight=3)
            labels.keep_box((each.x, each.y), np.full(2, 1.1 * DOT_PT * labels.m_per_pt))
        for each in places:
            _dimension_lines(axes, each, labels)
        for letter, (middle, along) in wall_middles(places, building).items():
            _wall_letter(letter, middle, along, labels, scale)
        for each in places:
            _dimensions(each, labels, scale)
        draw_directions(axes, sensors, reach_m)
        draw_numbered(axes, sensors, labels.m_per_pt)
        for each in sensors:
            _name(each, labels, reach_m)
        _zones(axes, zones, building.outline, labels)
        for place in {tuple(each.round(2)): each for each in before}.values():
            labels.write("before", around(place, 0.003 * scale, -np.pi / 2), color=QUIET)
        for door in over:
            labels.write(f"over {door.top_m:.2f} m", around(door.ends.mean(axis=0), 0.004 * scale), color=_CABLE)
        _origin(axes, low, high, labels, scale)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])
        for side in axes.spines.values():
            side.set_visible(False)
        axes.grid(False)
        metre = 1.0 if size_m[0] > 3 else 0.5
        axes.plot([low[0] + 0.1, low[0] + 0.1 + metre], [low[1] + 0.12] * 2, color=INK, lw=1.5, zorder=9)
        axes.text(low[0] + 0.1 + metre / 2, low[1] + 0.16, f"{metre:g} m", fontsize=TEXT_PT, ha="center", va="bottom")
        return to_svg(figure), scale, float(width_mm)


def _name(sensor: PlanSensor, labels: Labels, reach_m: float) -> None:
    """Write name, height and direction of a sensor near its arrow."""
    text = "\n".join(sensor.lines())
    half = TEXT_PT * labels.m_per_pt * np.array([LETTER_EM * max(map(len, sensor.lines())), 2 * LINE_EM]) / 2
    turns = np.deg2rad(sensor.yaw_deg) + np.deg2rad(np.arange(0, 181, 15))[:, None] * [1, -1]
    ways = np.column_stack([np.cos(turns.ravel()), np.sin(turns.ravel())])
    rings = [0.55 * reach_m, 1.2 * reach_m, 2 * reach_m, 3 * reach_m]
    here = np.array([sensor.x, sensor.y])
    labels.write(text, np.concatenate([here + ways * (ring + half) for ring in rings]))


def _zone_text(zone: KeepFreeZone) -> str:
    """Format the name of a zone and its meaning."""
    text = "keep free" if zone.doors_m is None else f"keep free, {zone.doors_m:g} m"
    return f"{zone.name}\n{text}"


def _zones(axes: Axes, zones: Sequence[KeepFreeZone], outline: Array, labels: Labels) -> None:
    """Hatch and name the zones without devices, within the outline of the building."""
    from matplotlib.patches import Polygon

    for zone in zones:
        corners = np.array(zone.polygon)
        (drawn,) = axes.fill(
            *corners.T, facecolor="none", edgecolor=ACCENT, linewidth=0.6, hatch="///", alpha=0.5, zorder=3.5
        )
        drawn.set_clip_path(Polygon(outline, transform=axes.transData))
        inside = np.array([each for each in corners if Area(outline).contains(each[None])[0]] or corners)
        middle = inside.mean(axis=0)
        reach_m = np.hypot(*np.ptp(corners, axis=0)) / 2
        places = np.vstack([middle, around(middle, 0.3 * reach_m, np.pi / 2)])
        labels.write(_zone_text(zone), places, color=ACCENT)


def _cables(
    axes: Axes, cable: Cable | None, building: Building, devices_m: Sequence[Array], labels: Labels
) -> list[Doorway]:
    """Draw the cable to each device (3,) [m], dotted across doorways, and their start; return the doorways that they go over."""
    if cable is None:
        return []
    start, over = np.array(cable.start), dict[int, Doorway]()
    for place in devices_m:
        way = np.vstack([start[:2], place[:2]])
        if cable.along == "walls":
            route = cable_route(building, doorways(building), start, place)
            way = route.corners
            over |= {id(each): each for each in route.over if each.top_m > max(start[2], place[2])}
        axes.plot(*way.T, color=_CABLE, linewidth=1.1, linestyle=(0, (4, 1.5)), zorder=4)
        labels.keep_clear(*way)
    for door in over.values():
        across = piece_across(building.outline, door)
        axes.plot(*across.T, color="white", linewidth=2.2, zorder=4.1)
        axes.plot(*across.T, color=_CABLE, linewidth=1.1, linestyle=(0, (1, 1)), zorder=4.2)
    axes.plot(*start[:2], "s", color=_CABLE, markersize=5, zorder=6)
    labels.keep_box(start[:2], np.full(2, 6 * labels.m_per_pt))
    return [each for each in over.values() if np.isfinite(highest_m((each,)))]


def _dimension_lines(axes: Axes, sensor: PlanSensor, labels: Labels) -> None:
    """Draw the distances of a sensor from the nearest two walls."""
    here = np.array([sensor.x, sensor.y])
    arrow = {"arrowstyle": "<->", "color": ACCENT, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
    for wall in sensor.walls:
        axes.annotate("", tuple(here), tuple(wall.foot), arrowprops=arrow)
        labels.keep_clear(here, wall.foot)


def _dimensions(sensor: PlanSensor, labels: Labels, scale: int) -> None:
    """Write the length of each of a sensor's dimension lines with the letter of its wall: along it, or beside a short one."""
    here = np.array([sensor.x, sensor.y])
    for wall in sensor.walls:
        text, way = f"{wall.gap_m:.2f} {wall.letter}", wall.foot - here
        outwards = np.array([wall.along[1], -wall.along[0]])
        if 1000 * wall.gap_m / scale < _SHORTEST_MM:  # outside the wall, or else beside the line
            half = TEXT_PT * labels.m_per_pt / 2 * np.array([LETTER_EM * len(text), LINE_EM])
            off_m = 0.0012 * scale + float(np.abs(outwards) @ half)
            aside = np.array([0, 1, -1, 2, -2])[:, None] * wall.along * float(np.abs(wall.along) @ half)
            outside = np.concatenate([wall.foot + (off_m + n * 0.001 * scale) * outwards + aside for n in range(3)])
            start = float(np.arctan2(*outwards[::-1]))
            labels.write(text, np.concatenate([outside, around(here + way / 2, 0.0045 * scale, start)]), color=ACCENT)
            continue
        shares = np.array([0.5, 0.35, 0.65, 0.25, 0.75])[:, None]
        sides = 0.8 * TEXT_PT * labels.m_per_pt * wall.along
        places = np.concatenate([here + shares * way + side * sides for side in (1, -1)])
        turn = 90 - (90 - np.rad2deg(np.arctan2(*way[::-1]))) % 180  # along the line, never upside down
        labels.write(text, places, turn_deg=float(turn), color=ACCENT)


def _wall_letter(letter: str, middle: Array, along: Array, labels: Labels, scale: int) -> None:
    """Write the letter of a wall in a ring, outside its middle."""
    outwards = np.array([along[1], -along[0]])
    off = 0.001 * scale * np.array([4.0, 5.0, 6.0, 7.0])[:, None] * outwards
    aside = 0.001 * scale * np.array([0, 6, -6, 12, -12, 18, -18])[:, None] * along
    places = np.concatenate([middle + each + off for each in aside])
    ring = {"boxstyle": "circle,pad=0.25", "fc": "white", "ec": ACCENT, "lw": 0.6}
    labels.write(letter, places, color=ACCENT, weight="bold", bbox=ring)


def _overall(axes: Axes, building: Building, labels: Labels, scale: int) -> None:
    """Draw the room's dimensions below and to the left of it, between the faces of its outer walls."""
    low, high = building.outline.min(axis=0), building.outline.max(axis=0)
    arrow = {"arrowstyle": "<->", "color": INK, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
    for axis in (0, 1):
        faces = building.faces_m(axis)
        ends = np.tile(low - 0.001 * scale * _OVERALL_MM, (2, 1))
        ends[:, axis] = faces if faces is not None else (low[axis], high[axis])
        axes.annotate("", tuple(ends[0]), tuple(ends[1]), arrowprops=arrow)
        labels.keep_clear(*ends)
        text = f"{'' if faces is not None else '≈ '}{np.ptp(ends[:, axis]):.{2 if faces is not None else 1}f} m"
        shares = np.array([0.5, 0.4, 0.6, 0.3, 0.7])[:, None]
        labels.write(text, ends[0] + shares * (ends[1] - ends[0]), turn_deg=90.0 * axis)


def _origin(axes: Axes, low: Array, high: Array, labels: Labels, scale: int) -> None:
    """Draw the axes at the origin of x and y, or at a point of whole metres where the origin is off the plan."""
    room = 0.3 + _ORIGIN_M
    at = np.zeros(2) if (low + 0.3 < 0).all() and (high - room > 0).all() else np.ceil(low + margin_m(scale))
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6}
    for axis, way in zip("xy", _ORIGIN_M * np.eye(2), strict=True):
        (x, y), (far_x, far_y) = at.tolist(), (at + way).tolist()
        axes.annotate("", (far_x, far_y), (x, y), arrowprops=arrow, zorder=5)
        labels.keep_clear(at, at + way)
        labels.write(axis, around(at + way, 1.2 * TEXT_PT * labels.m_per_pt, float(np.arctan2(*way[::-1])), 2))
    labels.write(f"{at[0]:g}, {at[1]:g}", around(at, 2 * TEXT_PT * labels.m_per_pt, -0.75 * np.pi, 2))


def parts_list(results: StudyResults) -> list[dict[str, str]]:
    """List the parts to buy: device and kind, what it sees, number, unit price, metres of cable and their price, and the sum."""
    candidate_set, study, rows = results.prepared.candidate_set, results.prepared.study, []
    per_m = study.constraints.cable.price_per_m if study.constraints.cable else 0.0
    for name, device in study.devices.items():
        for number, kind in enumerate(device.kinds):
            mine = [
                candidate_set.poses[each]
                for each in results.best.placement
                if candidate_set.poses[each].device == name and candidate_set.poses[each].kind == number
            ]
            if mine:
                what = f"{name}: {_device_label(device, results.prepared.scenario)}" + (
                    "" if kind.name == "as-is" else f", {kind.name}"
                )
                cable = sum(pose.cable_m for pose in mine)
                count = sum(len(pose.mounts) for pose in mine)
                price = sum(pose.price for pose in mine)
                rows.append({
                    "what": what,
                    "sees": _sees(results, mine[0]),
                    "count": str(count),
                    "each": format_price(device.price_of(kind)),
                    "cable": f"{cable:.1f} m" if cable else "–",
                    "cable_price": format_price(per_m * cable) if cable else "–",
                    "price": format_price(price),
                })  # fmt: skip
    return rows


def _sees(results: StudyResults, pose: CandidatePose) -> str:
    """Describe the field of view of the device of a pose, of each of its sensors once."""
    prepared = results.prepared
    placed = apply_placement(prepared.study, prepared.scenario, [pose])
    moved = moved_sensors(prepared.study, prepared.scenario, placed)
    return "; ".join(dict.fromkeys(_field_of_view(placed.sensors[name]) for name in moved))


def _field_of_view(sensor: Any) -> str:
    if isinstance(sensor, LaserDescription):
        return f"{sensor.field_of_view_deg:g}°, {sensor.n_beam} beams, to {sensor.range_max_m:g} m"
    lens = sensor.intrinsics()
    if isinstance(lens, FisheyeIntrinsics):
        return f"fisheye {np.rad2deg(lens.field_of_view_rad):.0f}°, {lens.width} × {lens.height} px"
    wide, high = (2 * np.rad2deg(np.arctan(n / f / 2)) for n, f in ((lens.width, lens.fx), (lens.height, lens.fy)))
    return f"{wide:.0f}° × {high:.0f}°, {lens.width} × {lens.height} px"


def _device_label(device: Device, scenario: Scenario) -> str:
    """Name a device for the list of parts."""
    kind = scenario.sensors[device.sensors_in(scenario)[0]].kind
    held = len(device.together) or 1
    return kind if held == 1 else f"{kind} and {held - 1} more on one mount"
