"""The building: its outline from above, and the places for mounting (indoors, in free space, out of people's way)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.arrays import Array, Mask
from trackers.errors import InputError
from trackers.rig import StereoSensor
from twin.geometry.geom_hull import PLANE_M, hull_points, stands_still
from twin.geometry.polygon import ConvexHull, Delaunay, counter_clockwise
from twin.instant.snapshot import RAY_GROUPS, Snapshot
from twin.room.obstacles import OBSTACLE_REACH_M, Footprints
from twin.room.walkable import ENCLOSED_M2, Plan, common_direction, outdoors_of, standing_footprints
from twin.scenario import Scenario
from twin.scenario.housings import base_of, rig_sensor
from twin.scenario.sensor_descriptions import FloorDescription, check_floor

_ROUGH_M = 0.03
"""Greatest error of the outline of the walls as drawn on a grid [m]."""
_DRAWN_M = 0.1
"""Distance from its outline within which a ray's hit counts as the wall, with an exact position [m]."""

_UPRIGHT = 0.99
"""Least horizontal component of an upright wall's normal."""

_STRAIGHT, _LEAST_FACE_M = 0.999, 0.3
"""Cosine between an axis and what faces a wall across it, and the least length of the wall [m]."""
_RAY_M, _LOOKED_AT_M = 0.15, 1.2
"""Distance before a wall, and height, from which rays find its face [m]."""
_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Places of the rays along a wall."""


@dataclass(frozen=True, eq=False)
class Building:
    """A room as needed for mounting: indoors, solid parts, and where people walk.

    outline (k, 2): the inner face of the walls around the largest part of the floor, counter-clockwise [m].
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    plan: Plan
    indoors: NDArray[np.uint8]  # of the plan's cells, walls included
    outline: Array
    walkable: Area
    furniture: Footprints

    @classmethod
    def of(
        cls, model: mujoco.MjModel, data: mujoco.MjData, floor: list[Array], walkable: Array, furniture: Footprints
    ) -> Building:
        """Build from an empty room; `floor`: convex pieces (k, 2), `walkable` (k, 2): limit of bodies' middles [m]."""
        walls, standing = standing_footprints(model, data)
        plan = Plan.over(floor, standing, common_direction(walls or floor))
        ground = plan.within(plan.drawn(floor))
        outdoors, wall = outdoors_of(plan.drawn(standing), plan), plan.drawn(walls)
        indoors = (ground | wall) & ~outdoors & 1
        if np.count_nonzero(indoors & ~wall) * plan.cell_m**2 < ENCLOSED_M2:  # a yard: all of its floor
            indoors = ground | plan.within(wall)
        outlines, _ = cv2.findContours(indoors & ~wall & 1, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        widest = max(outlines, key=cv2.contourArea)
        outline = counter_clockwise(plan.corners(widest, _ROUGH_M))
        return cls(model, data, plan, indoors.astype(np.uint8), outline, Area(walkable), furniture)

    def is_indoors(self, places_m: Array) -> Mask:
        """Return a mask of the places (n, 2 or 3) [m] above the building's floor, or in its walls."""
        cells = np.rint(self.plan.cells_of(places_m[:, :2])).astype(int)
        rows, columns = self.plan.shape
        there = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
        inside = np.zeros(len(places_m), dtype=bool)
        inside[there] = self.indoors[cells[there, 1], cells[there, 0]] > 0
        return inside

    def is_solid(self, places_m: Array) -> Mask:
        """Return a mask of the places (n, 3) [m] inside a wall or object; a mesh counts as its convex hull."""
        model, data = self.model, self.data
        solid = np.zeros(len(places_m), dtype=bool)
        for geom in np.flatnonzero(stands_still(model)).tolist():
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                corners = hull_points(model, data, geom)
                if corners is not None:
                    solid |= Delaunay(corners, qhull_options="QJ").find_simplex(places_m) >= 0
                continue
            solid |= is_within(model, data, geom, places_m)
        return solid

    def is_walked(self, places_m: Array, below_m: float) -> Mask:
        """Return a mask of the places (n, 3) [m] lower than this where people walk: not right beside, or above, furniture."""
        walked = (places_m[:, 2] < below_m) & self.walkable.contains(places_m[:, :2])
        if len(self.furniture) and walked.any():
            _, gap_m = self.furniture.gaps(places_m[walked, 0] + 1j * places_m[walked, 1])
            walked[walked] = (gap_m > OBSTACLE_REACH_M).all(axis=1)
        return walked

    def open_edges(self) -> list[Array]:
        """Return the pieces (k, 2) [m] of the outline without a wall: the edge of a yard's floor, a doorway."""
        walls, _ = standing_footprints(self.model, self.data)
        near = 2 * self.plan.cells(_DRAWN_M) + 1
        wall = cv2.dilate(self.plan.drawn(walls).astype(np.uint8), np.ones((near, near), np.uint8))
        ends = np.roll(self.outline, -1, axis=0)
        steps = np.maximum(np.ceil(np.hypot(*(ends - self.outline).T) / _ROUGH_M).astype(int), 1)
        line = np.concatenate([np.linspace(a, b, n + 1) for a, b, n in zip(self.outline, ends, steps, strict=True)])
        cells = np.rint(self.plan.cells_of(line)).astype(int)
        is_open = wall[np.clip(cells[:, 1], 0, len(wall) - 1), np.clip(cells[:, 0], 0, wall.shape[1] - 1)] == 0
        pieces = np.split(np.arange(len(line)), np.flatnonzero(np.diff(is_open)) + 1)
        return [line[piece] for piece in pieces if is_open[piece[0]] and len(piece) > 1]

    def along_walls(self, every_m: float, off_m: float, heights_m: Sequence[float]) -> tuple[Array, Array]:
        """Return places (n, 3) [m] this far off the walls at most this far apart, and the directions that the walls face
        (n,) [rad].
        """
        places, facing = [np.zeros((0, 3))], [np.zeros(0)]
        for start, way in zip(self.outline, np.roll(self.outline, -1, axis=0) - self.outline, strict=True):
            length = float(np.hypot(*way))
            if length < 2 * off_m:
                continue
            inwards = np.array([-way[1], way[0], 0.0]) / length
            share = (np.arange(np.ceil(length / every_m - 1e-9)) + 0.5) / np.ceil(length / every_m - 1e-9)
            on_floor = start + share[:, None] * way + off_m * inwards[:2]
            for height_m in heights_m:
                found = np.column_stack([on_floor, np.full(len(on_floor), height_m)])
                wall_m = np.array([self.free_m(place, -inwards) for place in found])
                off = np.where(np.abs(wall_m - off_m) < _DRAWN_M, off_m - wall_m, 0.0)
                places.append(found + off[:, None] * inwards)
                facing.append(np.full(len(found), np.arctan2(inwards[1], inwards[0])))
        found = np.concatenate(places)
        free = self.is_indoors(found)
        return found[free], np.concatenate(facing)[free]

    def free_m(self, place_m: Array, direction: Array, normal: Array | None = None) -> float:
        """Return the distance from a place (3,) [m] to the first surface in a direction; inf without one. `normal` (3,)
        receives its normal.
        """
        geom = np.zeros(1, dtype=np.int32)
        found = mujoco.mj_ray(self.model, self.data, place_m, direction, RAY_GROUPS, 1, -1, geom, normal)
        return found if found >= 0 else np.inf

    def ceiling_m(self, places_m: Array, from_m: float = 2.0) -> Array:
        """Return the height (n,) [m] of the ceiling, looked for from this height up, over places (n, 2); inf under the sky."""
        up = np.array([0.0, 0.0, 1.0])
        return np.array([from_m + self.free_m(np.array([x, y, from_m]), up) for x, y in places_m])

    def walls_nearest(self, place_m: Array) -> list[tuple[float, Array, Array]]:
        """Return the two nearest walls that are not parallel: distance [m], foot (2,) on the outline, the wall's direction
        (2,), with the room on its left.
        """
        ends = np.roll(self.outline, -1, axis=0)
        way = ends - self.outline
        length = np.hypot(way[:, 0], way[:, 1])
        along = ((place_m[:2] - self.outline) * way).sum(axis=1) / length**2
        adjacent = (along >= 0) & (along <= 1)
        foot = self.outline + np.clip(along, 0, 1)[:, None] * way
        gap = np.hypot(*(foot - place_m[:2]).T)
        unit = way / length[:, None]
        found: list[tuple[float, Array, Array]] = []
        for edge in sorted(np.flatnonzero(adjacent), key=lambda each: gap[each]):
            if all(abs(unit[edge] @ other) < 0.5 for _, _, other in found):
                wall_m, wall = self._wall_behind(place_m, unit[edge])
                is_this = abs(wall_m - gap[edge]) < _DRAWN_M
                found.append((wall_m, foot[edge], wall) if is_this else (float(gap[edge]), foot[edge], unit[edge]))
        return found[:2]

    def faces_m(self, axis: int) -> Array | None:
        """Return the faces (2,) [m] of the outermost walls across an axis; None where a side has no such wall."""
        ends = np.roll(self.outline, -1, axis=0)
        way = ends - self.outline
        length = np.hypot(way[:, 0], way[:, 1])
        outwards = np.column_stack([way[:, 1], -way[:, 0]]) / length[:, None]
        faces = []
        for side in (-1, 1):
            found = []
            for edge in np.flatnonzero((side * outwards[:, axis] > _STRAIGHT) & (length > _LEAST_FACE_M)):
                for share in _SHARES:  # a picture on the wall is not its face
                    inside = self.outline[edge] + share * way[edge] - _RAY_M * outwards[edge]
                    wall_m = self.free_m(np.append(inside, _LOOKED_AT_M), np.append(outwards[edge], 0.0))
                    found += [inside[axis] * side + wall_m] * (abs(wall_m - _RAY_M) < _DRAWN_M)
            if not found:
                return None
            faces.append(side * max(found))
        return np.array(faces)

    def _wall_behind(self, place_m: Array, along: Array) -> tuple[float, Array]:
        """Return the distance [m] to the surface behind an edge of the outline, perpendicular to it, and its direction (2,)."""
        normal = np.zeros(3)
        wall_m = self.free_m(place_m, np.array([along[1], -along[0], 0.0]), normal)
        level = np.hypot(*normal[:2])
        if not np.isfinite(wall_m) or level < _UPRIGHT:
            return wall_m, along
        inwards = normal / level * [1, 1, 0]
        return self.free_m(place_m, -inwards), np.array([inwards[1], -inwards[0]])


_SLACK_M = 1e-6
"""Added to a geom's bounding sphere [m]: nothing of the geom is outside."""


def check_mounts(scenario: Scenario, names: Iterable[str], empty: Snapshot, floor: Array) -> None:
    """Raise InputError for a sensor in a wall or outside the room, by either eye of a stereo camera; not for one that drives.

    empty: the room without people; floor: the room's, a simple polygon (k, 2) [m], which a pressure floor may not leave.
    """
    for name in names:
        field, description = f"{scenario.source}: sensors.{name}", scenario.sensors[name]
        if isinstance(description, FloorDescription):
            check_floor(description, floor, field)
        elif base_of(scenario, name) is None:
            sensor = rig_sensor(scenario, name)
            eyes_m = sensor.eyes_m() if isinstance(sensor, StereoSensor) else [sensor.room_from_sensor.translation]
            for eye_m in eyes_m:
                check_mount(empty.model, empty.data, f"{field}.mount.xyz", eye_m)


def check_mount(model: mujoco.MjModel, data: mujoco.MjData, field: str, xyz: NDArray[np.float64]) -> None:
    """Raise InputError naming field and geom if the point (3,) [m] lies in a static geom of the room, or outside its walls."""
    is_there = stands_still(model)
    near = is_there & (((data.geom_xpos - xyz) ** 2).sum(axis=1) <= _reach_m(model) ** 2)
    within = (geom for geom in np.flatnonzero(near).tolist() if is_within(model, data, geom, xyz[None]).any())
    geom, where = next(within, None), "inside {} of the room"
    if geom is None:
        geom, where = _wall_before(model, data, xyz, is_there), "outside the room, behind {}"
    if geom is not None:
        thing, place = repr(model.geom(geom).name or f"geom {geom}"), f"[{xyz[0]:g}, {xyz[1]:g}, {xyz[2]:g}]"
        raise InputError(f"{field}: {place} is {where.format(thing)}; a point in free space is expected")


def _wall_before(model: mujoco.MjModel, data: mujoco.MjData, xyz: Array, is_there: Mask) -> int | None:
    """Return the upright plane before a point (3,) [m] outside the room, the nearest; None for a point inside.

    A plane is seen from its front alone. Outside, as in the notch of an L-shaped room, every level ray that meets anything
    passes the back of a plane first.
    """
    upright = np.hypot(data.geom_xmat[:, 2], data.geom_xmat[:, 5]) >= _UPRIGHT
    planes = np.flatnonzero(is_there & upright & (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE))
    axes = data.geom_xmat[planes].reshape(-1, 3, 3)
    at = np.einsum("pab,pa->pb", axes, xyz - data.geom_xpos[planes])[:, None]  # in each plane's frame
    if not (at[..., 2] < 0).any():
        return None
    ways = np.einsum("pab,na->pnb", axes, _LEVEL)
    from_behind = (at[..., 2] < 0) & (ways[..., 2] > _SLACK_M)
    passed_m = -at[..., 2] / np.where(from_behind, ways[..., 2], 1.0)
    half = model.geom_size[planes, None, :2]  # 0: without end; corners are closed
    on_plane = (np.abs(at[..., :2] + passed_m[..., None] * ways[..., :2]) <= half + PLANE_M) | (half == 0)
    passed_m = np.where(from_behind & on_plane.all(axis=-1), passed_m, np.inf)
    met_m, first = np.empty(len(_LEVEL)), np.empty(len(_LEVEL), dtype=np.int32)
    flat = _LEVEL.ravel()
    mujoco.mj_multiRay(model, data, xyz, flat, RAY_GROUPS, 1, -1, first, met_m, None, len(_LEVEL), mujoco.mjMAXVAL)
    before_m = passed_m.min(axis=0)
    through = np.isfinite(before_m) & (before_m <= np.where(first < 0, np.inf, met_m) + PLANE_M)
    if not through.any() or (~through & (first >= 0)).any():
        return None
    return int(planes[passed_m.min(axis=1).argmin()])


_AROUND = np.deg2rad(np.arange(0, 360, 5))
_LEVEL = np.stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(len(_AROUND))], axis=1)
"""Level directions, unit vectors (n, 3)."""


def is_within(model: mujoco.MjModel, data: mujoco.MjData, geom: int, places_m: Array) -> Mask:
    """Return a mask of the places (n, 3) [m] inside a geom; meshes and height fields count as empty.

    Behind a plane is inside it at any depth, but for an upright one with things behind it: a partition, which is thin.
    """
    local = (places_m - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    inside = _within_shape(model.geom_type[geom], model.geom_size[geom], local)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and inside.any() and _is_partition(model, data, geom):
        inside &= local[:, 2] >= -PLANE_M
    return inside


def _is_partition(model: mujoco.MjModel, data: mujoco.MjData, plane: int) -> bool:
    """Return True for a finite upright plane straight behind which something else stands."""
    horizontal = np.hypot(data.geom_xmat[:, 2], data.geom_xmat[:, 5])  # component of each geom's z axis
    if horizontal[plane] < _UPRIGHT or not model.geom_size[plane, :2].all():
        return False
    is_floor = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (horizontal < _UPRIGHT)
    ahead_m = (data.geom_xpos - data.geom_xpos[plane]) @ data.geom_xmat[plane, 2::3]
    is_behind = ahead_m - _reach_m(model) < -2 * PLANE_M  # some of it may be
    for geom in np.flatnonzero(~is_floor & (model.geom_rgba[:, 3] > 0) & is_behind).tolist():
        if geom == plane:
            continue
        points = hull_points(model, data, geom)
        if points is None:
            continue
        local = (points - data.geom_xpos[plane]) @ data.geom_xmat[plane].reshape(3, 3)
        straight = (np.abs(local[:, :2]) <= model.geom_size[plane, :2]).all(axis=1)
        if (straight & (local[:, 2] < -2 * PLANE_M)).any():
            return True
    return False


def _reach_m(model: mujoco.MjModel) -> Array:
    """Return how far each geom reaches from its origin at most (n,) [m]; planes without end."""
    return np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, np.inf, model.geom_rbound + _SLACK_M)


def _within_shape(kind: int, size: NDArray[np.float64], local: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask (n,) of the points (n, 3), in the geom's frame, inside it."""
    match kind:
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return (local[:, 2] < 0) & ((np.abs(local[:, :2]) <= size[:2]) | (size[:2] == 0)).all(axis=1)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return (np.abs(local) - size).max(axis=1) <= 0
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return (local * local).sum(axis=1) <= size[0] ** 2
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ((local / size) ** 2).sum(axis=1) <= 1
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return (np.hypot(local[:, 0], local[:, 1]) <= size[0]) & (np.abs(local[:, 2]) <= size[1])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            beyond = local[:, 2] - np.clip(local[:, 2], -size[1], size[1])
            return local[:, 0] ** 2 + local[:, 1] ** 2 + beyond**2 <= size[0] ** 2
        case _:
            return np.zeros(len(local), dtype=bool)


_LOW_M, _HIGH_M = 0.1, 1.8
"""Range of heights in which an object must have a part to appear on the plan [m]: excludes floor marks and lamps."""


def room_outline(model: mujoco.MjModel, data: mujoco.MjData, *, glass_only: bool = False) -> list[NDArray[np.float64]]:
    """Return convex outlines (k, 2) [m] of the room's static geoms, or of those that rays pass; `data` needs kinematics."""
    outlines = []
    for geom in np.flatnonzero(stands_still(model)).tolist():
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and not model.geom_size[geom, :2].all():
            continue
        if glass_only and RAY_GROUPS[model.geom_group[geom]]:
            continue
        corners = hull_points(model, data, geom)
        if corners is None or corners[:, 2].max() < _LOW_M or corners[:, 2].min() > _HIGH_M:
            continue
        flat = corners[:, :2]
        if np.ptp(flat, axis=0).min() > 1e-6:
            outlines.append(flat[ConvexHull(flat).vertices])
    return outlines
