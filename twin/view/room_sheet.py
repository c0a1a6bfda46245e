"""Sheet of a room without a scenario: a picture from above, and its plan with axes in metres, furniture, seats and walkable
area.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from twin import models
from twin.geometry.geom_hull import hull_points
from twin.report.palette import LAYER_COLOURS, hex_colour
from twin.report.scene_pictures import check_picture_name, render_picture, tile_pictures, write_png
from twin.room.building import Building, room_outline
from twin.room.doorways import doorways, width_m
from twin.room.floor_surface import floor_of
from twin.room.furniture import Bed, Seat, furniture_of
from twin.room.mjcf import DARK_LIGHT, ENOUGH_LIGHT, light_of
from twin.room.obstacles import Footprints
from twin.scenario import Scenario
from twin.sensors.render import OffscreenRenderer
from twin.view.free_camera import CameraSpace, overview
from twin.world.empty_room import empty_room
from twin.world.world import World

_TILE_PX = (760, 640)
_LOW_M, _TALL_M, _WIDE_M = 0.1, 1.8, 1.2
"""Limits for naming an object on the plan: it reaches over the first, begins below the second and is no wider [m]."""
_LETTER = (0.009, 0.04)
"""Width and height that a letter of a name takes, as shares of the room."""
_FINER = 2
_CELL_M, _MOST_CELLS = 0.02, 400
"""Edge of the cells by which an area without furniture is measured [m], and most of them on a side."""
_BACKDROP = (24, 24, 27)
_BESIDE_M, _FACES = 0.42, 0.5
"""Distance of a name from its seat or bed [m], and sine of the yaw from which that faces up or down on the plan."""
_DOOR = "#9a5b13"
_LABEL: dict[str, Any] = {"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8}


def write_room(name: str, path: Path) -> list[str]:
    """Write a PNG of a room, shipped or a user's file; return hints on its light.

    Raises InputError for an invalid room, and a file that cannot be written.
    """
    check_picture_name(path)
    file, world = models.find("rooms", name), empty_world(name)
    picture, plan = _picture(world), _plan(world, file.name)
    write_png(path, tile_pictures([picture, plan], 2, _BACKDROP))
    return _hints(world.scene.model, file)


def empty_world(name: str) -> World:
    """Build a room, shipped or a user's file, without people and sensors. Raises InputError for an invalid room."""
    return World(_scenario_of(name))


def left_out(name: str) -> list[str]:
    """Return a sentence for each part that the walls of a room keep from its walkable area."""
    return empty_room(_scenario_of(name)).left_out()


def _scenario_of(name: str) -> Scenario:
    fields: dict[str, Any] = {
        field: each.get_default(call_default_factory=True) for field, each in Scenario.model_fields.items()
    }
    fields |= {"name": Path(name).stem, "room": name, "duration_s": 1.0, "people": {}, "sensors": {}}
    return Scenario.model_construct(None, **fields)  # a scenario without sensors is invalid


def extent_text(area: NDArray[np.float64], obstacles: Iterable[NDArray[np.float64]] = ()) -> str:
    """Format what a walkable polygon (k, 2) [m] covers: its area, without `obstacles` (k, 2) [m], corners, and box."""
    (wide_m, deep_m), low = np.ptp(area, axis=0), area.min(axis=0)
    area_m2 = cv2.contourArea(np.asarray(area, dtype=np.float32))
    cell_m = max(_CELL_M, float(max(wide_m, deep_m)) / _MOST_CELLS)
    middles = [np.arange(cell_m / 2, each, cell_m) for each in (wide_m, deep_m)]
    places = low + np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, 2)
    places = free = places[Area(area).contains(places)]
    for corners in obstacles:
        free = free[~Area(corners).contains(free)]
    free_m2 = area_m2 * len(free) / max(len(places), 1)
    box = f"{len(area)} corners, {wide_m:.3g} m x {deep_m:.3g} m over all"
    if f"{free_m2:.3g}" == f"{area_m2:.3g}":
        return f"{area_m2:.3g} m² to walk ({box})"
    return f"{free_m2:.3g} m² to walk, without the furniture in {area_m2:.3g} m² ({box})"


def _hints(model: mujoco.MjModel, file: Path) -> list[str]:
    light = light_of(model)
    if light >= ENOUGH_LIGHT:
        return []
    what = "cameras see next to nothing" if light < DARK_LIGHT else "cameras see little"
    return [
        f"{file}: is dark (light {light:.2g}, {ENOUGH_LIGHT:g} shows what is there), so that {what}; the picture is lit for the "
        'eye. A lamp helps: <light pos="0 0 2.5" dir="0 0 -1" cutoff="80" exponent="1" diffuse="0.8 0.8 0.8"/>'
    ]


def _picture(world: World) -> NDArray[np.uint8]:
    """Draw the room from a free place that shows most of the walkable area."""
    scene, snapshot = world.scene, world.empty_snapshot(0.0)
    points = [np.column_stack([scene.walkable, np.full(len(scene.walkable), height)]) for height in (0.1, 1.0)]
    stand = overview(snapshot, CameraSpace(snapshot, scene.floor), np.concatenate(points), _TILE_PX[0] / _TILE_PX[1])
    with OffscreenRenderer(scene.model) as renderer:
        return render_picture(renderer, snapshot.data, stand, _TILE_PX, finer=_FINER)


def _plan(world: World, name: str) -> NDArray[np.uint8]:
    """Draw the plan with numbered axes [m]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene, snapshot = world.scene, world.empty_snapshot(0.0)
    model, data = scene.model, snapshot.data
    figure = Figure(figsize=(_TILE_PX[0] / 100, _TILE_PX[1] / 100), dpi=100)
    figure.set_layout_engine("constrained", rect=(0, 0.04, 1, 0.95))  # a title may be higher than is reserved
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    for outline in room_outline(model, data):
        axes.fill(*outline.T, facecolor="#c9cdd4", edgecolor="#7d8594", linewidth=0.7)
    for outline in room_outline(model, data, glass_only=True):
        axes.fill(*outline.T, facecolor="#bfe3f2", edgecolor="#3b9fc4", linewidth=0.9)
    walked = np.vstack([scene.walkable, scene.walkable[:1]])
    axes.plot(*walked.T, color="#2e8b57", linestyle="--", linewidth=1.2, label="walkable area")
    colour = hex_colour(LAYER_COLOURS[0])
    used = furniture_of(model, name).values()
    for each in used:
        x, y = each.place[:2]
        ahead = 0.35 * np.array([np.cos(each.yaw), np.sin(each.yaw)])
        axes.annotate("", (x + ahead[0], y + ahead[1]), (x, y), arrowprops={"arrowstyle": "-|>", "color": colour})
        kind = "bed" if isinstance(each, Bed) else "seat"
        x, y = _beside(each).tolist()
        axes.text(x, y, f"{kind} {each.name}", fontsize=8, ha="center", va="center", bbox=_LABEL, zorder=5)
    seats = [(_beside(each), len(f"seat {each.name}")) for each in used]
    _name_things(axes, model, data, seats, {each.furniture for each in used})
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    furniture = [each.corners for each in scene.ground.obstacles]
    axes.set_title(f"{name}: {extent_text(scene.walkable, furniture)}", fontsize=9, wrap=True)
    _mark_doors(axes, world)
    axes.grid(alpha=0.35, linewidth=0.6)
    figure.legend(loc="outside lower right", fontsize=8, frameon=False)
    canvas.draw()
    rgba = np.asarray(canvas.buffer_rgba())
    return cv2.cvtColor(cv2.resize(rgba, _TILE_PX), cv2.COLOR_RGBA2RGB).astype(np.uint8)


def _beside(furniture: Seat | Bed) -> NDArray[np.float64]:
    """Return the place (2,) [m] of the name of a seat or bed: below it on the plan, or above where it faces down."""
    aside_m = _BESIDE_M if np.sin(furniture.yaw) < -_FACES else -_BESIDE_M
    return np.array(furniture.place[:2]) + np.array([0.0, aside_m])


def _mark_doors(axes: Any, world: World) -> None:
    """Draw a line across each doorway, with its width and the height of its lintel."""
    model, data, walkable = world.scene.model, world.empty_snapshot(0.0).data, world.scene.walkable
    building = Building.of(
        model,
        data,
        floor_of(model, data, world.scene.room_file.name),
        walkable,
        Footprints(world.scene.ground.obstacles),
    )
    for door in doorways(building):
        axes.plot(*door.ends.T, color=_DOOR, linewidth=3, solid_capstyle="butt", zorder=4)
        height = " m wide" if np.isinf(door.top_m) else f" × {door.top_m:.2f} m"
        x, y = middle = door.ends.mean(axis=0)
        along = (door.ends[1] - door.ends[0]) / np.hypot(*(door.ends[1] - door.ends[0]))
        inwards = np.array([-along[1], along[0]])
        inwards *= np.sign(inwards @ (walkable.mean(axis=0) - middle)) or 1.0
        style = {"fontsize": 7, "color": _DOOR, "ha": "center", "va": "center", "bbox": _LABEL, "zorder": 5}
        axes.annotate(
            f"door {width_m(building, door):.2f}{height}",
            (x, y),
            tuple(inwards * (42, 9)),
            textcoords="offset points",
            **style,
        )


def _name_things(
    axes: Any, model: mujoco.MjModel, data: mujoco.MjData, taken: list[tuple[NDArray[np.float64], int]], named: set[str]
) -> None:
    """Write the names of low objects at their middles, the largest first, where they meet none of the names at `taken`.

    `taken`: middles (2,) [m] and letters; `named`: objects already named.
    """
    letter = np.ptp(data.geom_xpos[:, :2], axis=0) * _LETTER
    for geom in np.argsort(-model.geom_rbound, kind="stable"):
        body, radius, (x, y, _) = model.geom_bodyid[geom], model.geom_rbound[geom], data.geom_xpos[geom]
        name = model.body(body).name if body else model.geom(geom).name
        heights = points[:, 2] if (points := hull_points(model, data, geom)) is not None else np.array([np.inf])
        is_low = heights.max() > _LOW_M and heights.min() < _TALL_M and radius < _WIDE_M
        is_free = all((np.abs(each - (x, y)) > letter * ((count + len(name)) / 2, 1)).any() for each, count in taken)
        if name and name not in named and is_low and is_free:
            axes.text(x, y, name, fontsize=6.5, color="#4a5160", ha="center", va="center", clip_on=True)
            taken.append((np.array([x, y]), len(name)))
            named.add(name)
