"""The walkable area of a room that does not say it, from its floor and its walls.

On a grid of 2 cm (coarser over 40 m), turned as most of the walls are:

1. The floor is what is level at z = 0 (`twin.room.floor_surface`). Of a floor of 100 m and more a side, an endless plane for one,
   counts what is up to 10 m beyond what stands on it, or around the origin where nothing does.
2. Walls are what stands still, begins at most 0.5 m above the floor and reaches 1.8 m or more: shelves too. All else is
   furniture; it stays in the area, and people go around it as they do in any room (`twin.room.obstacles`).
3. Outdoors is what a square of 1.5 m, pushed in from beyond everything, comes to without touching walls or furniture. It
   fits through no door: a door gap that leads out closes the room, one between two rooms that are both closed joins them.
4. The area is the largest part of the floor that is neither wall nor outdoors. Where that is under 4 m², as in a
   yard, a hall with an open side or a plane without walls, it is the largest part of the whole floor, to its own edge.
5. It is drawn in so that people keep from walls as from furniture, cleared of what is too narrow to walk in (bays under 1 m
   between walls, gaps under 0.8 m), and made a simple polygon; what stands in the middle of it is not cut out.

Its limits: a mesh counts as its convex hull where it is a wall, and as it is where it is floor; steps and slopes lead
nowhere; a low barrier right across a room, a counter say, leaves both its sides in; round rooms become polygons, within a
few centimetres. A room that means something else says so: `<custom><numeric name="walkable_area" data="x1 y1 x2 y2 ..."/>`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.area import meets_itself_at
from trackers.arrays import Array
from trackers.errors import InputError, text_near_bound
from twin.geometry.geom_hull import ENDLESS_M, hull_points, stands_still, unlikely_meshes
from twin.geometry.polygon import ConvexHull, QhullError, counter_clockwise, inset, polygon_area
from twin.room.obstacles import KEEP_FROM_EDGE_M, OBSTACLE_REACH_M, is_in_the_way

Mask = NDArray[np.uint8]

_CELL_M, _MOST_CELLS = 0.02, 2000
_COARSEST_M = 0.2
"""Greatest cell: a door of 0.8 m is four."""
_BEYOND_M = 10.0
_WALL_FROM_M, _WALL_TO_M = 0.5, 1.8
_DOOR_M = 1.5
_EDGE_M = 2 * _DOOR_M
_SEAM_M = 0.06
"""Gaps up to this width between pieces of floor are floor [m]."""
_ALIKE_DEG, _AGREED = 1.0, 0.2
"""Greatest angle between aligned edges [degrees], and their least share by length for turning the grid."""
_FAR, _NEAR = (slice(1, None), slice(None)), (slice(-1), slice(None))
_RIGHT, _LEFT = (slice(None), slice(1, None)), (slice(None), slice(-1))
_SHIFT = 8  # fractional bits of OpenCV's coordinates
ENCLOSED_M2 = 4.0
_LEAST_M2 = 1.0
_PART_M2, _SLIT_M = 0.5, 0.3
"""Least part of a room that is worth a word [m²], and its least width [m]."""
_WAY_M, _BAY_M = 0.4, 0.6
"""Widths of the area below which people cannot pass, and below which they walk only if it leads on [m]."""
NARROWEST_DOOR_M = 0.85
"""Width of a gap in a wall from which on it joins two rooms, whatever its place on the grid [m]."""
_ROUGH_M = (0.03, 0.06, 0.12, 0.2)
_MARGINS_M = (KEEP_FROM_EDGE_M + 0.03, KEEP_FROM_EDGE_M + 0.1)
"""Distances of routes and of wanderers' goals from the polygon's edge, for both of which it must be wide enough [m]."""


def walkable_area(model: mujoco.MjModel, data: mujoco.MjData, floor: Sequence[Array], source: str) -> Array:
    """Compute the area for the middles of bodies: a simple polygon (k, 2), counter-clockwise, in the room frame [m].

    `floor`: convex pieces (k, 2) [m]; `data` needs kinematics. Raises InputError, naming `source`, where there is none.
    """
    walls, standing = standing_footprints(model, data)
    plan = Plan.over(floor, standing, common_direction(walls or floor))
    if plan.cell_m > _COARSEST_M:
        most_m = _COARSEST_M * _MOST_CELLS
        wide_m = text_near_bound(float(np.ptp(np.concatenate(floor), axis=0).max()), most_m, ".0f")
        raise InputError(
            f"{source}: its floor is {wide_m} m wide, as of a room in mm or cm; lengths in metres, a floor of at most "
            f"{most_m:g} m, or a numeric walkable_area under <custom>, is expected"
            + "".join(f"; {each}" for each in unlikely_meshes(model))
        )
    wall = plan.drawn(walls)
    ground = plan.within(_closed(plan.drawn(floor), plan.cells(_SEAM_M))) & ~wall
    outdoors = outdoors_of(plan.drawn(standing), plan)
    for outside, least_m2 in ((outdoors, ENCLOSED_M2), (np.zeros_like(outdoors), _LEAST_M2)):
        area = _walked(ground & ~outside, outside, plan)
        if np.count_nonzero(area) * plan.cell_m**2 >= least_m2:
            return _polygon(area, plan, source)
    raise InputError(
        f"{source}: its floor leaves nowhere to walk: no part of {_LEAST_M2:g} m² is free {OBSTACLE_REACH_M:g} m off the "
        "walls; a larger floor at z = 0, or a numeric walkable_area under <custom>, is expected"
    )


def rooms_left_out(
    model: mujoco.MjModel, data: mujoco.MjData, floor: Sequence[Array], area: Array
) -> list[tuple[float, Array]]:
    """Return the size [m²], and a place (2,) [m], of each part that walls enclose and a walkable area (k, 2) leaves out.

    Its gap is too narrow a door, or it is too small for an area of its own. `data` needs kinematics.
    """
    walls, standing = standing_footprints(model, data)
    plan = Plan.over(floor, standing, common_direction(walls or floor))
    if plan.cell_m > _COARSEST_M:
        return []
    inside = plan.within(_closed(plan.drawn(floor), plan.cells(_SEAM_M))) & ~plan.drawn(walls)
    outdoors = outdoors_of(plan.drawn(standing), plan)
    inside &= ~outdoors
    is_outdoors = np.count_nonzero(_walked(inside, outdoors, plan)) * plan.cell_m**2 < ENCLOSED_M2
    margin = _square(2 * plan.cells(OBSTACLE_REACH_M))
    rest = cv2.erode(inside, margin, borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(np.uint8)
    if not is_outdoors:
        rest &= 1 - cv2.dilate(plan.filled(area), _square(plan.cells(_SLIT_M))).astype(np.uint8)
    return _parts(rest, plan)


def parts_cut_off(
    model: mujoco.MjModel, data: mujoco.MjData, floor: Sequence[Array], area: Array
) -> list[tuple[float, Array]]:
    """Return the size [m²], and a place (2,) [m], of each part of an area (k, 2) [m] that walls divide from its largest one.

    `data` needs kinematics.
    """
    walls, standing = standing_footprints(model, data)
    if not walls:
        return []
    plan = Plan.over([*floor, area], [*standing, area], common_direction(walls))
    margin = _square(2 * plan.cells(OBSTACLE_REACH_M))
    free = plan.filled(area) & (1 - cv2.dilate(plan.drawn(walls), margin).astype(np.uint8))
    parts = sorted(_parts(free, plan), key=lambda part: part[0])
    return [] if plan.cell_m > _COARSEST_M else parts[:-1]


def _parts(mask: Mask, plan: Plan) -> list[tuple[float, Array]]:
    """Return the size [m²], and the innermost place (2,) [m], of each part that is neither small nor a slit."""
    _, number, stats, _ = cv2.connectedComponentsWithStats(_opened(mask, plan.cells(_SLIT_M)), connectivity=4)
    found = []
    for part in np.flatnonzero(stats[:, cv2.CC_STAT_AREA] * plan.cell_m**2 >= _PART_M2).tolist():
        if part > 0:  # 0 is all around
            deepest = cv2.distanceTransform((number == part).astype(np.uint8), cv2.DIST_L2, 3)
            place = np.array(np.unravel_index(deepest.argmax(), deepest.shape))[None, ::-1]
            found.append((float(stats[part, cv2.CC_STAT_AREA] * plan.cell_m**2), plan.places(place.astype(float))[0]))
    return found


@dataclass(frozen=True)
class Plan:
    """Grid over the floor: the room turned by -turn [rad], from `low` (2,) [m] in cells of `cell_m` [m].

    The part that counts is surrounded by an outdoor edge wider than a door.
    """

    turn: float
    low: Array
    shape: tuple[int, int]
    cell_m: float

    @classmethod
    def over(cls, floor: Sequence[Array], standing: Sequence[Array], turn: float) -> Plan:
        """Make the grid that holds the counted part of the floor."""
        points = _turned(np.concatenate(floor), -turn)
        low, high = points.min(axis=0), points.max(axis=0)
        things = _turned(np.concatenate(standing), -turn) if standing else np.zeros((1, 2))
        is_endless = high - low >= 2 * ENDLESS_M * (1 - 1e-6)
        low = np.where(is_endless, np.maximum(low, things.min(axis=0) - _BEYOND_M), low)
        high = np.where(is_endless, np.minimum(high, things.max(axis=0) + _BEYOND_M), high)
        cell_m = max(_CELL_M, float((high - low).max()) / _MOST_CELLS)
        columns, rows = np.ceil((high - low + 2 * _EDGE_M) / cell_m).astype(int) + 1
        return cls(turn, low - _EDGE_M, (int(rows), int(columns)), cell_m)

    def cells(self, length_m: float) -> int:
        """Return a length in whole cells, at least one."""
        return max(1, round(length_m / self.cell_m))

    def drawn(self, shapes: Iterable[Array]) -> Mask:
        """Draw the convex polygons (k, 2) [m] filled with 1, including every touched cell."""
        mask = np.zeros(self.shape, dtype=np.uint8)
        for shape in shapes:
            cells = self.cells_of(shape)
            cv2.fillConvexPoly(mask, np.round(cells * 2**_SHIFT).astype(np.int32), 1, shift=_SHIFT)
        return mask

    def filled(self, polygon: Array) -> Mask:
        """Draw any simple polygon (k, 2) [m] filled with 1."""
        return cv2.fillPoly(
            np.zeros(self.shape, np.uint8), [np.round(self.cells_of(polygon)).astype(np.int32)], 1
        ).astype(np.uint8)

    def within(self, mask: Mask) -> Mask:
        """Return the mask without the edge of the grid."""
        edge = self.cells(_EDGE_M)
        inner = np.zeros_like(mask)
        inner[edge:-edge, edge:-edge] = mask[edge:-edge, edge:-edge]
        return inner

    def cells_of(self, places: Array) -> Array:
        """Return the unrounded cells (n, 2), column and row, of places (n, 2) [m] of the room frame."""
        return (_turned(places, -self.turn) - self.low) / self.cell_m

    def places(self, cells: Array) -> Array:
        """Return the places (n, 2) [m] of cells (n, 2), in the room frame."""
        return _turned(cells * self.cell_m + self.low, self.turn)

    def corners(self, outline: NDArray, rough_m: float) -> Array:
        """Return the corners (k, 2) [m] of an outline of cells as OpenCV finds it, simplified by at most `rough_m`, or a cell."""
        cells = cv2.approxPolyDP(outline, max(rough_m / self.cell_m, 1.0), closed=True)
        return self.places(cells[:, 0].astype(float))


def standing_footprints(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[list[Array], list[Array]]:
    """Return the footprints (k, 2) [m] of the walls, and of all obstacles, walls included."""
    walls, standing = [], []
    for geom in np.flatnonzero(stands_still(model)).tolist():
        points = hull_points(model, data, geom)
        if points is None or not is_in_the_way(model, data, geom, points):
            continue
        footprint = _outline(points[:, :2])
        standing.append(footprint)
        if points[:, 2].min() <= _WALL_FROM_M and points[:, 2].max() >= _WALL_TO_M:
            walls.append(footprint)
    return walls, standing


def _outline(points: Array) -> Array:
    """Return the convex hull (k, 2) of points (n, 2) [m]; of collinear points their ends."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        along = (points - points[0]) @ np.linalg.svd(points - points.mean(axis=0))[2][0]
        return points[[int(along.argmin()), int(along.argmax())]]


def common_direction(shapes: Iterable[Array]) -> float:
    """Return the angle [rad], from -45 to 45 degrees, of the dominant direction of the edges of shapes (k, 2), by length."""
    ways = np.concatenate([(np.roll(shape, -1, axis=0) - shape) @ np.array([1, 1j]) for shape in shapes])
    degrees, length = np.rad2deg(np.angle(ways)) % 90, np.abs(ways)
    near = [np.abs((degrees - each + 45) % 90 - 45) < _ALIKE_DEG for each in range(90)]
    most = max(near, key=lambda those: length[those].sum())
    if length[most].sum() < _AGREED * length.sum():
        return 0.0
    return float(np.angle(np.sum((length * np.exp(4j * np.angle(ways)))[most])) / 4)


def outdoors_of(standing: Mask, plan: Plan) -> Mask:
    """Return the cells that a door-wide square reaches from the edge of the grid."""
    door = plan.cells(_DOOR_M)
    middles = cv2.erode(1 - standing, _square(door), borderType=cv2.BORDER_CONSTANT, borderValue=1)
    number = _numbered(middles.astype(np.uint8))
    rim = np.concatenate([number[0], number[-1], number[:, 0], number[:, -1]])
    touches_rim = np.zeros(int(number.max()) + 1, dtype=np.uint8)
    touches_rim[rim] = 1
    touches_rim[0] = 0
    from_outside = touches_rim[number]
    return cv2.dilate(from_outside, _square(door)).astype(np.uint8)


def _walked(free: Mask, outdoors: Mask, plan: Plan) -> Mask:
    """Return the largest part of the free cells in which a body's middle can walk about."""
    margin = plan.cells(OBSTACLE_REACH_M)
    area = cv2.erode(free, _square(2 * margin), borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(np.uint8)
    area = _opened(area, plan.cells(_WAY_M))
    area = _without_dead_ends(area, plan.cells(_BAY_M))
    thresholds = cv2.dilate(outdoors, _square(2 * margin + 2)).astype(np.uint8)
    area = _without_dead_ends(area, plan.cells(_DOOR_M) - 2 * margin, thresholds)
    _, number, stats, _ = cv2.connectedComponentsWithStats(area, connectivity=4)
    if len(stats) == 1:
        return area  # empty
    return (number == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()).astype(np.uint8)


def _without_dead_ends(area: Mask, cells: int, only_at: Mask | None = None) -> Mask:
    """Return the area without narrow parts, except those that connect wide ones; `only_at`: or do not touch it."""
    wide = _opened(area, cells)
    number = _numbered(wide)
    narrow = _numbered(area & ~wide)
    count = int(narrow.max()) + 1
    n_wide = int(number.max()) + 1
    touching = []
    for one, other in ((_FAR, _NEAR), (_RIGHT, _LEFT)):
        for here, there in ((one, other), (other, one)):
            both = (narrow[here] > 0) & (number[there] > 0)
            touching.append(narrow[here][both].astype(np.int64) * n_wide + number[there][both])
    leads_to = np.unique(np.concatenate(touching)) // n_wide
    stays = np.bincount(leads_to, minlength=count) >= 2
    if only_at is not None:
        is_elsewhere = np.ones(count, dtype=bool)
        is_elsewhere[narrow[only_at > 0]] = False
        stays |= is_elsewhere
    stays[0] = False
    return wide | stays[narrow].astype(np.uint8)


def _polygon(area: Mask, plan: Plan, source: str) -> Array:
    """Return the outline of a part, simplified as far as the distance to its edge allows."""
    outlines, _ = cv2.findContours(area, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=cv2.contourArea)
    for rough_m in _ROUGH_M:
        corners = np.round(plan.corners(outline, rough_m), 3)
        if len(corners) < 3 or meets_itself_at(corners) is not None:
            continue
        if all(inset(corners, margin_m) is not None for margin_m in _MARGINS_M):
            return counter_clockwise(corners)
    raise InputError(
        f"{source}: its walkable area, of {polygon_area(plan.places(outline[:, 0].astype(float))):.1f} m², is too ragged to "
        "walk in; a numeric walkable_area under <custom>, x1 y1 x2 y2 ... [m], is expected"
    )


def _numbered(mask: Mask) -> NDArray[np.int32]:
    """Return the connected parts of a mask, numbered from 1; 0 where it is 0."""
    return cv2.connectedComponents(mask, connectivity=4)[1].astype(np.int32, copy=False)


def _opened(mask: Mask, cells: int) -> Mask:
    return cv2.morphologyEx(mask, cv2.MORPH_OPEN, _square(cells)).astype(np.uint8)


def _closed(mask: Mask, cells: int) -> Mask:
    return cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _square(cells)).astype(np.uint8)


def _square(cells: int) -> Mask:
    """Return a square of `cells` cells, or one more, so that its middle is a cell."""
    return np.ones((cells | 1, cells | 1), dtype=np.uint8)


def _turned(points: Array, angle: float) -> Array:
    """Return points (n, 2) turned about the origin by an angle [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[cos, sin], [-sin, cos]])
