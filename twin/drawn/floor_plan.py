"""Plan of a drawn building: outline, rooms, partitions with doorways, exterior doors.

All in the plan's frame: metres, axis-aligned, the outline's lower left corner at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers.area import meets_itself_at
from trackers.arrays import Array, Index, Mask
from twin.drawn.distributions import DrawnRoom, draw_count
from twin.geometry.polygon import inset

PARTITION_M = 0.1
"""Thickness of a partition [m]."""
DOOR_M = 0.9
"""Width of an exterior door [m]."""
_FROM_CORNER_M = 0.35
"""Least distance of a door's or doorway's edge from a corner [m]."""
_BEFORE_M = 0.6
"""Distance before a door or doorway at which people stand [m]."""


@dataclass(frozen=True)
class Rectangle:
    """Axis-aligned part of the floor [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def area_m2(self) -> float:
        """Its area [m²]."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def middle(self) -> Array:
        """Its middle (2,) [m]."""
        return np.array([self.x0 + self.x1, self.y0 + self.y1]) / 2


@dataclass(frozen=True)
class Wall:
    """Wall along an axis, seen from inside: from `start` to `end` [m], the room to its left."""

    start: tuple[float, float]
    end: tuple[float, float]

    @property
    def length_m(self) -> float:
        """Its length [m]."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def along(self) -> Array:
        """Unit vector (2,) from start to end."""
        return (np.array(self.end) - self.start) / self.length_m

    @property
    def inwards(self) -> Array:
        """Unit vector (2,) from the wall into the room."""
        return np.array([-self.along[1], self.along[0]])

    @property
    def yaw(self) -> float:
        """Direction from start to end [rad]."""
        return float(np.arctan2(self.along[1], self.along[0]))

    @property
    def faces(self) -> float:
        """Direction into the room [rad]."""
        return float(np.arctan2(self.inwards[1], self.inwards[0]))

    def at(self, along_m: float, off_m: float = 0.0) -> Array:
        """Return the place (2,) at a distance along the wall and off it, into the room [m]."""
        return np.array(self.start) + along_m * self.along + off_m * self.inwards


@dataclass(frozen=True)
class Partition:
    """Wall between two rooms, from `start` to `end` [m], with one doorway from `gap_m[0]` to `gap_m[1]` along it."""

    start: tuple[float, float]
    end: tuple[float, float]
    gap_m: tuple[float, float]
    is_glass: bool

    @property
    def wall(self) -> Wall:
        """Its line."""
        return Wall(self.start, self.end)


@dataclass(frozen=True)
class Door:
    """Exterior door: its wall, and the position of its middle along it [m]."""

    wall: Wall
    along_m: float

    def before(self, off_m: float) -> Array:
        """Return the place (2,) before the door, `off_m` into the room [m]."""
        return self.wall.at(self.along_m, off_m)


@dataclass(frozen=True)
class FloorPlan:
    """Building: outline (k, 2) counter-clockwise [m], rooms, walls around it, partitions, exterior doors."""

    outline: Array
    rooms: tuple[Rectangle, ...]
    walls: tuple[Wall, ...]
    partitions: tuple[Partition, ...]
    doors: tuple[Door, ...]
    height_m: float

    @property
    def size_m(self) -> Array:
        """Length and width (2,) [m]."""
        return self.outline.max(axis=0)

    def thresholds(self) -> Array:
        """Return the places (n, 2) [m] before each door and on both sides of each doorway."""
        inside = [door.before(_BEFORE_M) for door in self.doors]
        between = [
            each.wall.at(sum(each.gap_m) / 2, off) for each in self.partitions for off in (-_BEFORE_M, _BEFORE_M)
        ]
        return np.array([*inside, *between]).reshape(-1, 2)

    def is_within(self, places: Array) -> Mask:
        """Return which places (n, 2) [m] are over the floor."""
        return np.any(
            [
                (places[:, 0] >= room.x0) & (places[:, 0] <= room.x1) & (places[:, 1] >= room.y0) & (places[:, 1] <= room.y1)
                for room in self.rooms
            ],
            axis=0,
        )  # fmt: skip


def draw_floor_plan(options: DrawnRoom, rng: np.random.Generator) -> FloorPlan:
    """Draw a building's plan."""
    length, width = (round(rng.uniform(*bounds), 2) for bounds in (options.length_m, options.width_m))
    parts = [Rectangle(0.0, 0.0, length, width)]
    outline = np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])
    partitions: list[Partition] = []
    least = options.least_room_m
    if rng.random() < options.l_shape and min(length, width) >= 2 * least:
        cut_x = round(length * rng.uniform(0.3, 0.6), 2)
        cut_y = round(width * rng.uniform(0.3, 0.55), 2)
        x, y = max(length - cut_x, least), max(width - cut_y, least)
        outline = np.array([[0.0, 0.0], [length, 0.0], [length, y], [x, y], [x, width], [0.0, width]])
        parts = [Rectangle(0.0, 0.0, length, y), Rectangle(0.0, y, x, width)]
    n_room = draw_count(options.rooms, rng)
    joined = parts  # two of them are one room where nothing divides an L
    if len(parts) == 2 and n_room > 1 and rng.random() < 0.5:
        partitions.append(_partition((0.0, parts[0].y1), (parts[1].x1, parts[0].y1), options, rng))
    while 1 + len(partitions) < n_room:
        divided = _divided(joined, partitions, options, rng)
        if divided is None:
            break
        joined = divided
    walls = tuple(
        Wall(_pair(corner), _pair(following))
        for corner, following in zip(outline, np.roll(outline, -1, axis=0), strict=True)
    )
    height_m = round(rng.uniform(*options.height_m), 2)
    doors = _doors(walls, partitions, draw_count(options.doors, rng), rng)
    return FloorPlan(outline, tuple(joined), walls, tuple(partitions), doors, height_m)


def _pair(place: Array) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def _divided(
    rooms: list[Rectangle], partitions: list[Partition], options: DrawnRoom, rng: np.random.Generator
) -> list[Rectangle] | None:
    """Divide the largest divisible room in two, adding its partition; return the rooms, None if none is divisible."""
    for room in sorted(rooms, key=lambda each: -each.area_m2):
        sides = np.array([room.x1 - room.x0, room.y1 - room.y0])
        axis = int(sides.argmax())
        if sides[axis] < 2 * options.least_room_m or sides[1 - axis] < options.doorway_m[0] + 2 * _FROM_CORNER_M:
            continue
        low, high = options.least_room_m, sides[axis] - options.least_room_m
        for _ in range(8):
            cut = round(float((room.x0, room.y0)[axis] + rng.uniform(low, high)), 2)
            start, end = ((cut, room.y0), (cut, room.y1)) if axis == 0 else ((room.x0, cut), (room.x1, cut))
            if not _meets_a_doorway(start, end, partitions):
                break
        else:
            continue
        partitions.append(_partition(start, end, options, rng))
        one = Rectangle(room.x0, room.y0, *((cut, room.y1) if axis == 0 else (room.x1, cut)))
        other = Rectangle(*((cut, room.y0) if axis == 0 else (room.x0, cut)), room.x1, room.y1)
        return [each for each in rooms if each is not room] + [one, other]
    return None


def _meets_a_doorway(start: tuple[float, float], end: tuple[float, float], partitions: list[Partition]) -> bool:
    """Return whether a partition would end in or beside a doorway of another."""
    for each in partitions:
        for place in (start, end):
            off = np.array(place) - each.start
            along, across = float(off @ each.wall.along), float(off @ each.wall.inwards)
            if abs(across) < 0.01 and each.gap_m[0] - _FROM_CORNER_M < along < each.gap_m[1] + _FROM_CORNER_M:
                return True
    return False


def _partition(
    start: tuple[float, float],
    end: tuple[float, float],
    options: DrawnRoom,
    rng: np.random.Generator,
) -> Partition:
    """Draw a partition with its doorway, away from both ends."""
    length = Wall(start, end).length_m
    gap = min(round(rng.uniform(*options.doorway_m), 2), length - 2 * _FROM_CORNER_M)
    first = round(_FROM_CORNER_M + rng.uniform(0.0, max(length - 2 * _FROM_CORNER_M - gap, 0.0)), 2)
    return Partition(start, end, (first, first + gap), bool(rng.random() < options.glass))


def _doors(
    walls: tuple[Wall, ...], partitions: list[Partition], count: int, rng: np.random.Generator
) -> tuple[Door, ...]:
    """Draw exterior doors, apart from each other, from corners and from ends of partitions."""
    ends = np.array([place for each in partitions for place in (each.start, each.end)]).reshape(-1, 2)
    doors: list[Door] = []
    lengths = np.array([wall.length_m for wall in walls])
    for _ in range(40 * count):
        if len(doors) == count:
            break
        wall = walls[int(rng.choice(len(walls), p=lengths / lengths.sum()))]
        room_for = wall.length_m - 2 * _FROM_CORNER_M - DOOR_M
        if room_for < 0:
            continue
        door = Door(wall, round(_FROM_CORNER_M + DOOR_M / 2 + rng.uniform(0, room_for), 2))
        place = door.before(0.0)
        apart = [np.hypot(*(other.before(0.0) - place)) for other in doors]
        clear = np.hypot(*(ends - place).T).min(initial=np.inf)
        if min(apart, default=np.inf) > 2.0 and clear > DOOR_M / 2 + _FROM_CORNER_M:
            doors.append(door)
    return tuple(doors)


CELL_M = 0.05
KEEP_M = 0.46
"""Distance of people's middles from walls and furniture in this check [m]; they walk a little closer."""

WALKED_M = 0.2
"""Distance from walls of the area of people's middles [m]."""
_MARGINS_M = (0.18, 0.2)
"""Distance of routes from the edge of that area, which must be wide enough for them everywhere [m]."""


class FreeSpace:
    """Grid of the floor with walls and furniture.

    Places are in the plan's frame [m]. Reachable is the largest connected free part.
    """

    def __init__(self, plan: FloorPlan) -> None:
        columns, rows = np.ceil(plan.size_m / CELL_M).astype(int) + 1
        y, x = np.mgrid[:rows, :columns] * CELL_M
        inside = plan.is_within(np.column_stack([x.ravel(), y.ravel()])).reshape(rows, columns)
        self._taken = np.pad((~inside).astype(np.uint8), 1, constant_values=1)
        for partition in plan.partitions:
            for first, last in ((0.0, partition.gap_m[0]), (partition.gap_m[1], partition.wall.length_m)):
                self.take(np.array([partition.wall.at(first), partition.wall.at(last)]))
        self._number: NDArray[np.int32] | None = None

    def copy(self) -> FreeSpace:
        """Return an independent copy of the grid."""
        other = object.__new__(FreeSpace)
        other._taken, other._number = self._taken.copy(), self._number
        return other

    def take(self, corners: Array) -> None:
        """Mark a convex footprint (k, 2) [m], or a line of two corners, as taken."""
        cells = np.rint((corners / CELL_M + 1) * 256).astype(np.int32)
        if len(corners) == 2:
            cv2.line(self._taken, cells[0].tolist(), cells[1].tolist(), 1, thickness=2, shift=8)
        else:
            cv2.fillConvexPoly(self._taken, cells, 1, shift=8)
        self._number = None

    @property
    def _parts(self) -> NDArray[np.int32]:
        """Connected parts for a body's middle, numbered from 1 by size; 0: taken."""
        if self._number is None:
            gap_m = cv2.distanceTransform(1 - self._taken, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M
            found = cv2.connectedComponentsWithStats((gap_m >= KEEP_M).astype(np.uint8), connectivity=4)
            number, stats = np.asarray(found[1], np.int32), np.asarray(found[2])
            order = np.zeros(len(stats), np.int32)
            order[1 + (-stats[1:, cv2.CC_STAT_AREA]).argsort(kind="stable")] = np.arange(1, len(stats))
            self._number = order[number]
        return self._number

    def is_reached(self, places: Array) -> NDArray[np.bool_]:
        """Return a mask of the places (n, 2) [m] that are free and in the largest free part."""
        parts = self._parts
        cells = np.rint(places / CELL_M + 1).astype(int)
        there = ((cells >= 0) & (cells < parts.shape[::-1])).all(axis=1)
        reached = np.zeros(len(places), bool)
        reached[there] = parts[cells[there, 1], cells[there, 0]] == 1
        return reached

    @property
    def area_m2(self) -> float:
        """Area for middles in the largest part [m²]."""
        return float(np.count_nonzero(self._parts == 1)) * CELL_M**2

    def walkable_area(self) -> Array | None:
        """Return the outline (k, 2) [m] of the largest part `WALKED_M` off all taken cells; None if it is too ragged."""
        gap_m = cv2.distanceTransform(1 - self._taken, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M
        outlines, _ = cv2.findContours((gap_m >= WALKED_M).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        outline = max(outlines, key=cv2.contourArea)
        for rough_cells in (0.6, 1.2, 2.4):
            corners = (cv2.approxPolyDP(outline, rough_cells, closed=True)[:, 0].astype(np.float64) - 1) * CELL_M
            if meets_itself_at(corners) is None and all(inset(corners, each) is not None for each in _MARGINS_M):
                return corners
        return None

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw places (count, 2) [m] of the largest free part, uniformly."""
        rows, columns = np.nonzero(self._parts == 1)
        chosen: Index = rng.integers(len(rows), size=count)
        return (np.column_stack([columns[chosen], rows[chosen]]).astype(np.float64) - 1) * CELL_M
