"""Where to put the tripod of a scanner: the places asked for, or some from which most of the room is seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers.area import Area
from trackers.arrays import Array
from trackers.errors import InputError
from twin.environment.scan import HEIGHT_M
from twin.instant.snapshot import Snapshot
from twin.people.crowd.crowd import planar
from twin.room.mounts import check_mount
from twin.room.obstacles import Footprints
from twin.sensors.rays import cast
from twin.world.scene import Scene

_TRIPOD_M = 0.4
"""The tripod's feet reach this far from its middle [m]."""
_SPACING_M = 0.5
_MOST_CANDIDATES = 80
_MOST_STATIONS = 8
_WORTH_IT = 0.04
"""Another station has to see at least this share more than those before it."""
_CELL_M = 0.15
"""Small enough that a far station's rays leave most of them out: what is well seen is seen from near."""
_LOOK_RAYS = 8000
_LOOK_M = 30.0


def given_stations(places: Sequence[tuple[float, float, float]], scene: Scene, snapshot: Snapshot, field: str) -> Array:
    """The stations (s, 3) [m] asked for; raises InputError, opening with `field`, for one inside things or off the floor."""
    for place in places:
        x, y, z = place
        written = f"{field} {x:g},{y:g},{z:g}"
        if not np.isfinite(place).all() or not Area(scene.floor).contains(np.array([[x, y]]))[0]:
            low, high = scene.floor.min(axis=0), scene.floor.max(axis=0)
            raise InputError(
                f"{written}: is not over the room's floor; a place within x {low[0]:g} to {high[0]:g} m, "
                f"y {low[1]:g} to {high[1]:g} m is expected"
            )
        if z <= 0:
            raise InputError(f"{written}: is not above the floor; a height above 0 m is expected")
        check_mount(snapshot.model, snapshot.data, written, np.array(place))
        if (_look(snapshot, np.array(place))[0] >= 0).mean() < 0.2:
            raise InputError(f"{written}: sees next to nothing of the room; a place between its walls is expected")
    return np.array(places, dtype=float).reshape(-1, 3)


def chosen_stations(scene: Scene, snapshot: Snapshot, height_m: float = HEIGHT_M) -> Array:
    """Up to eight free places (s, 3) [m] for the tripod, each the one that adds most to what the others see.

    What the person who carries the tripod does by eye is done here with a coarse look from places all over the walkable
    area (next best view, Connolly 1985, by greedy cover). Raises InputError where nowhere is room for a tripod.
    """
    places = _candidates(scene, snapshot, height_m)
    seen = [_cells_seen(snapshot, place) for place in places]
    chosen: list[int] = []
    covered: set[int] = set()
    while len(chosen) < _MOST_STATIONS:
        gains = [len(cells - covered) for cells in seen]
        best = int(np.argmax(gains))
        if chosen and gains[best] < _WORTH_IT * len(covered):
            break
        chosen.append(best)
        covered |= seen[best]
    return places[chosen]


def _candidates(scene: Scene, snapshot: Snapshot, height_m: float) -> Array:
    """Places (c, 3) [m] on a square grid over the walkable area where a tripod can stand."""
    area = scene.walkable
    low, high = area.min(axis=0), area.max(axis=0)
    spacing = max(_SPACING_M, float(np.sqrt((high - low).prod() / _MOST_CANDIDATES)))
    ticks = [np.arange(low[axis] + spacing / 2, high[axis], spacing) for axis in (0, 1)]
    grid = np.stack(np.meshgrid(*ticks), axis=-1).reshape(-1, 2)
    grid = grid[Area(area).contains(grid)]
    obstacles = scene.ground.obstacles
    if len(obstacles) and len(grid):
        grid = grid[Footprints(obstacles).gaps(planar(grid))[1].min(axis=1) >= _TRIPOD_M]
    free = [place for place in np.column_stack([grid, np.full(len(grid), height_m)]) if _is_free(snapshot, place)]
    if not free:
        raise InputError(
            f"--station: furniture leaves no place {_TRIPOD_M:g} m clear of everything for the scanner's tripod; a place "
            "as X,Y,Z [m] is expected"
        )
    return np.array(free)


def _is_free(snapshot: Snapshot, place: Array) -> bool:
    try:
        check_mount(snapshot.model, snapshot.data, "", place)
    except InputError:
        return False
    return True


def _cells_seen(snapshot: Snapshot, place: Array) -> set[int]:
    """The cells in which a coarse look from a place meets something."""
    distance, directions = _look(snapshot, place)
    met = distance >= 0
    cell = np.floor((place + distance[met, None] * directions[met]) / _CELL_M).astype(np.int64) + 2**15
    return set(((cell[:, 0] << 40) + (cell[:, 1] << 20) + cell[:, 2]).tolist())


def _look(snapshot: Snapshot, place: Array) -> tuple[Array, Array]:
    """Distances (n,) [m], -1 for nothing, along directions (n, 3) spread evenly over the sphere (a golden spiral)."""
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(_LOOK_RAYS)
    up = 1 - (2 * np.arange(_LOOK_RAYS) + 1) / _LOOK_RAYS
    flat = np.sqrt(1 - up**2)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
    geom, distance = np.empty(_LOOK_RAYS, dtype=np.int32), np.empty(_LOOK_RAYS)
    cast(snapshot, place, directions, geom, distance, range_max_m=_LOOK_M)
    return distance, directions
