"""The room without people: its static model and what people and sensors need of it, measured once per content."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from trackers.area import check_polygon
from trackers.arrays import Array
from trackers.errors import InputError
from trackers.user_input.text_file import are_limits_lifted, check_limit
from twin import models
from twin.geometry.geom_hull import check_extent
from twin.people.crowd.routes import Routes
from twin.room.building import room_outline
from twin.room.files import ROOM_ROOT, room_files
from twin.room.floor_surface import check_floor_under, floor_hull, floor_of
from twin.room.furniture import Bed, Seat, furniture_of
from twin.room.mjcf import compiled, load_room
from twin.room.obstacles import MOST_OBSTACLES, OBSTACLE_REACH_M, Obstacle, obstacles_of, within_reach
from twin.room.walkable import NARROWEST_DOOR_M, parts_cut_off, rooms_left_out, walkable_area
from twin.scenario import Scenario
from twin.scenario.person import Person

_MOST_CORNERS = 500
"""Greatest number of corners of the walkable area: routes connect each with every other."""
_MOST_KEPT, _MOST_PEOPLE = 4, 1000


class EmptyRoom:
    """A room of an MJCF file; nothing of it may be changed, as later worlds share it (`empty_room`).

    Raises InputError for a room that reads files outside its folder, does not compile, has no floor or nowhere to walk. Its
    obstacles and routes, which not every use needs, are worked out when asked for.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.spec: mujoco.MjSpec = load_room(path)
        self.model: mujoco.MjModel = compiled(self.spec, path)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.data)
        check_extent(self.model, self.data, str(path))
        pieces = floor_of(self.model, self.data, str(path))
        own = _own_walkable_area(self.spec, path)
        if own is not None:
            check_floor_under(own, pieces, str(path))
        self.walkable: Array = walkable_area(self.model, self.data, pieces, str(path)) if own is None else own
        """Limit of bodies' middles (k, 2) [m, room frame]: the room's own, or from its geometry."""
        self.floor: Array = floor_hull(pieces)
        """Hull of the floor, polygon (k, 2) [m, room frame]."""
        self._fitting: set[Person] = set()

    @cached_property
    def furniture(self) -> dict[str, Seat | Bed]:
        """Seats and beds by name."""
        return furniture_of(self.model, self.path.name)

    @cached_property
    def obstacles(self) -> list[Obstacle]:
        """Footprints of furniture and walls within people's reach."""
        near = within_reach(obstacles_of(self.model, self.path.name), self.walkable, OBSTACLE_REACH_M)
        check_limit(len(near), MOST_OBSTACLES, f"{self.path}: stands in people's way with", "things")
        return near

    @cached_property
    def outline(self) -> list[Array]:
        """Convex outlines (k, 2) [m] of what stands in the room, for plans."""
        return room_outline(self.model, self.data)

    @cached_property
    def glass(self) -> list[Array]:
        """Those of the outlines that rays pass."""
        return room_outline(self.model, self.data, glass_only=True)

    def left_out(self) -> list[str]:
        """Return a sentence for each part that a computed walkable area leaves out, or that walls divide from the own one."""
        pieces = floor_of(self.model, self.data, str(self.path))
        if _own_walkable_area(self.spec, self.path) is not None:
            return [
                f"{self.path.name}: walkable_area: walls divide {size_m2:.3g} m² around [{x:.1f}, {y:.1f}] from the rest; an "
                f"area within its walls, or a gap of {NARROWEST_DOOR_M:g} m between the parts, is expected"
                for size_m2, (x, y) in parts_cut_off(self.model, self.data, pieces, self.walkable)
            ]
        return [
            f"{self.path.name}: {size_m2:.3g} m² around [{x:.1f}, {y:.1f}], which walls enclose, are not in the walkable area; a "
            f"gap of {NARROWEST_DOOR_M:g} m that leads there, or a numeric walkable_area under <custom>, is expected"
            for size_m2, (x, y) in rooms_left_out(self.model, self.data, pieces, self.walkable)
        ]

    def fitting_people(self) -> set[Person]:
        """Return the people known to fit between walls and furniture, for the checks of placement to extend."""
        if len(self._fitting) > _MOST_PEOPLE:
            self._fitting.clear()
        return self._fitting

    @cached_property
    def routes(self) -> Routes:
        """Shortest ways around the obstacles. Raises InputError for an area too narrow to walk in."""
        return Routes(self.walkable, self.obstacles)


@dataclass(frozen=True)
class _KeptFiles:
    files: dict[Path, bytes]
    limits: tuple[str | None, bool]
    room: EmptyRoom

    def is_current(self) -> bool:
        """Return whether the room would be read from the same files with the same contents."""
        if self.limits != _limits():
            return False
        return all(path.is_file() and path.read_bytes() == content for path, content in self.files.items())


_kept: dict[Path, _KeptFiles] = {}


def empty_room(scenario: Scenario) -> EmptyRoom:
    """Return the room of a scenario, the same one while its files are unchanged: a worker's runs often share one."""
    path = models.find("rooms", scenario.room, asked_by=f"{scenario.source}: room")
    kept = _kept.pop(path, None)
    if kept is None or not kept.is_current():
        kept = _KeptFiles(room_files(path), _limits(), EmptyRoom(path))
    _kept[path] = kept
    while len(_kept) > _MOST_KEPT:
        del _kept[next(iter(_kept))]  # the one that was not asked for longest
    return kept.room


def _limits() -> tuple[str | None, bool]:
    """Return the settings of the process that decide which rooms may be read."""
    return os.environ.get(ROOM_ROOT), are_limits_lifted()


def _own_walkable_area(spec: mujoco.MjSpec, path: Path) -> Array | None:
    """Return the polygon (k, 2) [m] in the room's `<custom><numeric name="walkable_area"/>`, None where the room has none.

    Raises InputError for one that is no polygon, or is called otherwise.
    """
    for numeric in spec.numerics:
        if numeric.name == "walkable_area":
            data = np.array(numeric.data, dtype=float)
            if len(data) < 6 or len(data) % 2:
                raise InputError(
                    f"{path}: walkable_area: {len(data)} numbers are not a polygon; "
                    "x1 y1 x2 y2 ... [m] of at least 3 corners are expected"
                )
            corners = data.reshape(-1, 2)
            check_limit(len(corners), _MOST_CORNERS, f"{path}: walkable_area: is a polygon of", "corners")
            try:
                check_polygon(corners)
            except ValueError as error:
                raise InputError(f"{path}: walkable_area: {error}") from error
            return corners
    for custom in (*spec.numerics, *spec.texts):
        if re.sub("[^a-z]", "", custom.name.lower()) == "walkablearea":
            raise InputError(
                f'{path}: {custom.name}: is not read; <numeric name="walkable_area" data="x1 y1 x2 y2 ..."/> is expected'
            )
    return None
