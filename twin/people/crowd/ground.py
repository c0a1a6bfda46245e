"""Ground: the tracked area, its obstacles, seats and beds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackers.area import TOLERANCE_M, Area, edge_gaps
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from twin.geometry.polygon import inset, nearest_on
from twin.people.crowd.crowd import planar
from twin.people.crowd.routes import Routes
from twin.room.furniture import Bed, Seat
from twin.room.obstacles import KEEP_FROM_EDGE_M, KEEP_FROM_FURNITURE_M, Footprints, Obstacle

_ROUNDS = 500
_ARRIVES_M = 0.04
"""Tolerance for arriving at a place close to the area's edge [m]."""


def free_places(
    area: Array,
    footprints: Footprints,
    count: int,
    rng: np.random.Generator,
    source: str = "area",
    inside: Area | None = None,
) -> Array:
    """Draw places (count, 2) [m], uniform in the polygon `area` (k, 2) at least `KEEP_FROM_FURNITURE_M` from all footprints.

    `inside`: its `Area`, if it was made before. Raises InputError, naming `source`, where almost none of the area is free.
    """
    low, high = area.min(axis=0), area.max(axis=0)
    inside, found = inside or Area(area), np.empty((0, 2))
    for _ in range(_ROUNDS):
        if len(found) >= count:
            return found[:count]
        places = rng.uniform(low, high, (2 * count, 2))
        places = places[inside.contains(places)]
        if len(footprints):
            places = places[footprints.gaps(planar(places))[1].min(axis=1) >= KEEP_FROM_FURNITURE_M]
        found = np.concatenate([found, places])
    raise InputError(
        f"{source}: furniture leaves no place to stand; some floor {KEEP_FROM_FURNITURE_M:g} m clear of everything is expected"
    )


def standing_place(place: Array, walkable: Array) -> Array:
    """Return the place where a person sent to `place` (2,) [m] stands: there, or the nearest place off the area's edge.

    walkable (k, 2): the polygon that middles of bodies stay in [m], `KEEP_FROM_EDGE_M` off its edges. Places by a door lie
    on the edge or beyond it, since doors are in walls.
    """
    reached = inset(walkable, KEEP_FROM_EDGE_M - _ARRIVES_M)
    if reached is None or Area(reached).contains(place[None])[0]:
        return place
    kept = inset(walkable, KEEP_FROM_EDGE_M)
    return place if kept is None else nearest_on(kept, place)


def entry_place(start: Array, walkable: Array) -> Array:
    """Return the place (2,) [m] where a person described to start at `start` (2,) [m] begins: there, or in from a door.

    walkable (k, 2): polygon of bodies' middles [m]. A start beyond it is in a door or before one: see `standing_place`.
    """
    inside = Area(walkable, TOLERANCE_M).contains(start[None])[0]
    return start if inside else standing_place(start, walkable)


def nearest_free(place: Array, area: Array, obstacles: Sequence[Obstacle], clear_m: float) -> Array | None:
    """Return a place (2,) [m] near `place` (2,) in the area and `clear_m` off all obstacles, to 5 cm; None if none is within
    3 m.
    """
    steps = 0.05 * np.arange(-60, 61)
    grid = np.round(place, 2) + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    grid = grid[Area(area).contains(grid)]
    if len(obstacles) and len(grid):
        grid = grid[Footprints(obstacles).gaps(planar(grid))[1].min(axis=1) >= clear_m]
    return grid[np.linalg.norm(grid - place, axis=1).argmin()] if len(grid) else None


_BEYOND_M = 0.1
"""Distance beyond the walkable floor up to which a head may be [m]."""
_MARGIN_M = KEEP_FROM_EDGE_M + 0.1


@dataclass(frozen=True, eq=False)
class Ground:
    """Floor on which the people of a scenario walk.

    `area` (k, 2): polygon in which wanderers stay and starts are drawn, `walkable` (k, 2): limit for all people, room frame
    [m]; `furniture`: seats and beds by name; `source`: description file named in errors; `clearance_m`: least distance of
    people's middles from obstacles [m].
    """

    area: Array
    walkable: Array
    obstacles: Sequence[Obstacle]
    routes: Routes
    furniture: Mapping[str, Seat | Bed]
    source: str
    clearance_m: float = KEEP_FROM_FURNITURE_M

    @cached_property
    def inner(self) -> Array:
        """Area shrunk by the clearance of a body's middle, (k, 2) [m]; raises InputError for a sliver."""
        inner = inset(self.area, _MARGIN_M)
        if inner is None:
            raise InputError(
                f"{self.source}: area: is too narrow to walk in; more than {2 * _MARGIN_M:g} m between its edges is expected"
            )
        return inner

    @cached_property
    def _within(self) -> Area:
        return Area(self.inner)

    @cached_property
    def _footprints(self) -> Footprints:
        return Footprints(self.obstacles)

    def is_clear(self, places: Array, above_m: float, clear_m: float) -> bool:
        """Return whether nothing that rises above a height [m] is nearer than `clear_m` to any of the places (k, 2) [m].

        All must be where people walk, or a hand's breadth beyond: what bounds that may be a wall.
        """
        if not Area(self.walkable, _BEYOND_M).contains(places).all():
            return False
        tall = np.array([each.top_m > above_m for each in self.obstacles], dtype=bool)
        return not tall.any() or bool(self._footprints.gaps(planar(places))[1][:, tall].min() >= clear_m)

    def gap_m(self, place: Array) -> float:
        """Return the distance from a place (2,) [m] to the nearest furniture, wall or edge of the walkable floor [m]."""
        gap_m = self._footprints.gaps(planar(place[None]))[1].min(initial=np.inf)
        return float(min(gap_m, edge_gaps(self.walkable, place[None]).min()))

    def is_free(self, places: Array) -> Mask:
        """Mark the places (k, 2) [m] where a body's middle may be: on the walkable floor, clear of furniture and walls."""
        free = Area(self.walkable).contains(places)
        if len(self._footprints):
            free &= self._footprints.gaps(planar(places))[1].min(axis=1) >= KEEP_FROM_FURNITURE_M
        return free

    def free_places(self, count: int, rng: np.random.Generator) -> Array:
        """Draw places (count, 2) [m] in the area, clear of furniture; raises InputError where there is none."""
        source = f"{self.source}: area"
        return free_places(self.inner, self._footprints, count, rng, source, self._within)
