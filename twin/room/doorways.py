"""Doorways of a room, and cables along its walls, which go over them.

A doorway is a gap of the walls around the room, a gap of a door's width in a wall within it, or what is called a door: a
geom with `door` as a word of its name, as long and as high as one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from trackers.area import edge_gaps
from trackers.arrays import Array
from twin.geometry.geom_hull import hull_points, stands_still
from twin.geometry.polygon import foot_on, thickness_m
from twin.room.building import Building
from twin.room.walkable import standing_footprints

_WALL_M = 0.1
"""Distance from a wall within which the outline is its face [m]: gaps end that much before it."""
_WIDTH_M = (0.6, 1.3)
"""Width of a doorway in a wall within the room, and least width of any [m]."""
_OPEN_M = 3.0
"""Width beyond which a gap under the sky is an open side [m]."""
_LEAF_HIGH_M = 1.5
"""Least height of a geom that is a door [m]."""
_THIN_M = 0.4
"""Thickness below which what reaches high is a wall, not a wardrobe [m]."""
_SAME_M = 0.35
"""Distance of two doorways that are one, and of a door from the outline that it is in [m]."""
_STEP_M = 0.02
_OFF_M = (0.02, 0.05, 0.1, 0.15)
"""Distances beyond the face of a wall at which the lintel is looked for [m]."""
_JAMB_M = 1.0
"""Height at which the width of a doorway counts [m]."""
_EDGES = 8
"""Number of edges around each end of a zone by a door."""
_NAME = re.compile(r"(?<![a-z])doors?(?![a-z])", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Doorway:
    """Doorway on the plan: its ends (2, 2) [m], and the height of its lintel [m], of the ceiling without one; inf: the sky.

    span_m: where it begins and ends along the building's outline, counter-clockwise [m]; None: it is in no outer wall.
    """

    ends: Array
    top_m: float
    span_m: tuple[float, float] | None = None

    def zone(self, within_m: float) -> Array:
        """Return the corners (k, 2) [m] of what is no farther from it on the plan than this."""
        start, end = self.ends
        turn = np.arctan2(*(end - start)[::-1])
        around = turn + np.pi / 2 + np.pi * np.linspace(0, 1, _EDGES + 1)
        rim = within_m / np.cos(np.pi / _EDGES / 2) * np.column_stack([np.cos(around), np.sin(around)])
        rim[[0, -1]] = within_m * np.column_stack([np.cos(around), np.sin(around)])[[0, -1]]
        return np.concatenate([start + rim, end - rim])


@lru_cache(maxsize=2)
def doorways(building: Building) -> tuple[Doorway, ...]:
    """Return the doorways of a building: gaps of the outer walls, named doors, gaps in walls within."""
    found: list[Doorway] = []
    for ends, is_outer in [*_gaps(building), *((each, True) for each in _named(building)), *_inner(building)]:
        middle = ends.mean(axis=0)
        if any(edge_gaps(each.ends, middle[None]).min() < _SAME_M for each in found):
            continue
        top_m = _top_m(building, ends)
        if np.isinf(top_m) and np.hypot(*(ends[1] - ends[0])) > _OPEN_M:
            continue
        on_edge = is_outer and edge_gaps(building.outline, middle[None]).min() < _SAME_M
        span = _span(building.outline, ends) if on_edge else None
        found.append(Doorway(ends, top_m, span))
    return tuple(found)


def _gaps(building: Building) -> list[tuple[Array, bool]]:
    """Return the ends (2, 2) [m] of the gaps in the outer walls."""
    found = []
    for piece in building.open_edges():
        ends = piece[[0, -1]]
        way_m = float(np.hypot(*(ends[1] - ends[0])))
        if way_m > 0:
            found.append((ends + np.array([[-1], [1]]) * _WALL_M * (ends[1] - ends[0]) / way_m, True))
    return [each for each in found if np.hypot(*np.ptp(each[0], axis=0)) >= _WIDTH_M[0]]


def _named(building: Building) -> list[Array]:
    """Return the ends (2, 2) [m] of geoms called doors, the longest first."""
    model, found = building.model, []
    for geom in np.flatnonzero(stands_still(model)).tolist():
        if not _NAME.search(model.geom(geom).name.replace("_", " ")):
            continue
        points = hull_points(model, building.data, geom)
        if points is None or points[:, 2].max() < _LEAF_HIGH_M:
            continue
        flat = points[:, :2]
        apart = np.hypot(*np.moveaxis(flat[:, None] - flat, -1, 0))
        one, other = np.unravel_index(apart.argmax(), apart.shape)
        if apart[one, other] >= _WIDTH_M[0]:
            found.append(flat[[one, other]])
    return sorted(found, key=lambda ends: -float(np.hypot(*(ends[1] - ends[0]))))


def _inner(building: Building) -> list[tuple[Array, bool]]:
    """Return the ends (2, 2) [m] of gaps of a door's width from the end of a wall, along it, to the next wall."""
    walls, _ = standing_footprints(building.model, building.data)
    drawn = building.plan.drawn(walls)
    found = []
    for wall in walls:
        sides = np.roll(wall, -1, axis=0) - wall
        length = np.hypot(*sides.T)
        if thickness_m(wall) > _THIN_M or length.max() < _WALL_M:
            continue
        along = sides[length.argmax()] / length.max()
        reach = wall @ along
        middle = wall.mean(axis=0)
        for way, most in ((along, reach.max()), (-along, -reach.min())):
            end = middle + (most - middle @ way) * way
            steps = np.arange(2 * _STEP_M, _WIDTH_M[1] + _STEP_M, _STEP_M)
            cells = np.rint(building.plan.cells_of(end + steps[:, None] * way)).astype(int)
            inside = (cells >= 0).all(axis=1) & (cells < drawn.shape[::-1]).all(axis=1)
            hit = np.zeros(len(steps), dtype=bool)
            hit[inside] = drawn[cells[inside, 1], cells[inside, 0]] > 0
            gap_m = steps[hit.argmax()] if hit.any() else 0.0
            beside = end + gap_m / 2 * way + np.outer([-_SAME_M, _SAME_M], [-way[1], way[0]])
            if gap_m >= _WIDTH_M[0] and _is_free(building, drawn, beside):
                found.append((np.array([end, end + gap_m * way]), False))
    return found


def _is_free(building: Building, walls: NDArray[np.uint8], places_m: Array) -> bool:
    """Return True where all places (n, 2) [m] are indoors and in no wall, `walls` of the plan's cells."""
    if not building.is_indoors(places_m).all():
        return False
    cells = np.rint(building.plan.cells_of(places_m)).astype(int)
    return not walls[cells[:, 1], cells[:, 0]].any()


def _top_m(building: Building, ends: Array) -> float:
    """Return the height of what is over the middle of a doorway [m]."""
    middle, along = ends.mean(axis=0), ends[1] - ends[0]
    across = np.array([along[1], -along[0]]) / np.hypot(*along)
    off_m = np.array([0.0, *_OFF_M, *(-each for each in _OFF_M)])
    over = building.ceiling_m(middle + off_m[:, None] * across, from_m=1.0)
    return float(min((each for each in over if each > 1.0 + _STEP_M), default=np.inf))


def width_m(building: Building, door: Doorway) -> float:
    """Return the clear width of a doorway between its jambs [m]; of one closed by a leaf, or without jambs, that of its ends."""
    middle, way = door.ends.mean(axis=0), door.ends[1] - door.ends[0]
    drawn_m = float(np.hypot(*way))
    along = np.append(way / drawn_m, 0.0)
    across = np.array([along[1], -along[0]])
    found = []
    for off_m in (0.0, *_OFF_M, *(-each for each in _OFF_M)):
        place = np.append(middle + off_m * across, _JAMB_M)
        clear_m = building.free_m(place, along) + building.free_m(place, -along)
        found += [clear_m] * (abs(clear_m - drawn_m) < 2 * _WALL_M)
    return min(found, default=drawn_m)


def _around_m(outline: Array) -> float:
    return float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())


def _span(outline: Array, ends: Array) -> tuple[float, float]:
    """Return where a doorway begins and ends along the outline, by the shorter way [m]; the end may be beyond one turn."""
    around_m = _around_m(outline)
    one, other = (foot_on(outline, each)[0] for each in ends)
    width = (other - one) % around_m
    return (one, one + width) if width <= around_m / 2 else (other, other + around_m - width)


@dataclass(frozen=True, eq=False)
class CableRoute:
    """Cable from a start to a device, along the walls: corners (k, 2) on the plan, its length, and what it goes over [m].

    It runs at the height of the higher end. Before a doorway whose lintel is higher it rises to the lintel, and comes down
    after the last; under the open sky it stays.
    """

    corners: Array
    length_m: float
    over: tuple[Doorway, ...]


def cable_route(building: Building, doors: Sequence[Doorway], start_m: Array, place_m: Array) -> CableRoute:
    """Return the shorter of the two routes along the walls between two points (3,) [m]: to the wall, along it, and off it."""
    outline, around_m = building.outline, _around_m(building.outline)
    (first_m, foot), (last_m, end) = (foot_on(outline, each[:2]) for each in (start_m, place_m))
    corners_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
    off_m = float(np.hypot(*(foot - start_m[:2])) + np.hypot(*(end - place_m[:2])) + abs(place_m[2] - start_m[2]))
    routes = []
    for begin_m, turn in ((first_m, 1), (last_m, -1)):
        way_m = (last_m - first_m) * turn % around_m
        past = (corners_m - begin_m) % around_m
        passed = outline[np.argsort(past, kind="stable")][np.sort(past) < way_m][::turn]
        over = tuple(each for each in doors if _is_passed(each, begin_m, way_m, around_m))
        rise_m = highest_m(over) - max(start_m[2], place_m[2])
        length_m = off_m + way_m + 2 * max(0.0, rise_m)
        routes.append(
            CableRoute(np.vstack([start_m[:2], foot, passed, end, place_m[:2]]), length_m, over if rise_m > 0 else ())
        )
    return min(routes, key=lambda each: each.length_m)


def highest_m(over: tuple[Doorway, ...]) -> float:
    """Return the height of the highest lintel [m]; -inf without any, and under the sky."""
    return max((each.top_m for each in over if np.isfinite(each.top_m)), default=-np.inf)


def _is_passed(door: Doorway, begin_m: float, way_m: float, around_m: float) -> bool:
    """Return True where a way along the outline leads across a doorway, not just to its edge."""
    if door.span_m is None:
        return False
    low, high = door.span_m
    middle = (low + high) / 2
    return any(begin_m < middle + turn * around_m < begin_m + way_m for turn in (-1, 0, 1))


def piece_across(outline: Array, door: Doorway) -> Array:
    """Return the corners (k, 2) [m] of the outline's piece across a doorway."""
    low, high = door.span_m or (0.0, 0.0)
    around_m = _around_m(outline)
    corners_m = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T))])
    closed = np.vstack([outline, outline[:1]])
    within = np.sort(np.concatenate([[low, high], *(corners_m + turn * around_m for turn in (0, 1))]))
    within = within[(within >= low) & (within <= high)] % around_m
    return np.column_stack([np.interp(within, corners_m, closed[:, axis]) for axis in (0, 1)])
