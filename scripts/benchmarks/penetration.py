"""Penetration of bodies into each other and into the room: the depth of every overlap in a posed world.

Overlaps are measured between MuJoCo's own geoms (`mj_geomDistance`: exact for convex shapes), after a broad phase on
bounding spheres for all pairs at once. Of a person the geoms of group 1 count (the body and its clothes; not eyes, ears and
mouth), of the room all static ones that rise above the floor. Feet on the floor are no overlap, nor is what the caller
allows, such as the chair of a sitting person.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.instant.snapshot import Snapshot, SnapshotSource
from twin.people.body.person_spec import GEOM_GROUP
from twin.room.furniture import Bed, Seat
from twin.world.world import World

Allowed = Mapping[int, Collection[int]]
"""For ids of people: geoms of the room that they may touch and press into."""

TOLERANCE_M = 0.01
"""Depth up to which flesh and cloth give way [m]."""
LOW_M = 0.05
"""Height below which geoms belong to the floor: rugs, marks, tiles, thresholds [m]."""

_UNDER_THE_FLOOR_M = -1.0


@dataclass(frozen=True)
class Penetration:
    """Deepest overlap of one person with another, or with one geom of the room, at one time.

    `person` and `other` are ids, `other` 0 for the room; `geom` and `other_geom`: names of the overlapping geoms.
    """

    t: float
    person: int
    other: int
    geom: str
    other_geom: str
    depth_m: float


class PenetrationCheck:
    """Overlaps of one model's people over time; made once, as it sorts the geoms."""

    def __init__(self, model: mujoco.MjModel, person_of_geom: NDArray[np.int16]) -> None:
        """`person_of_geom` (n_geom,): id of the person a geom belongs to, 0 for the room."""
        self.model = model
        self._owner = person_of_geom
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._body = np.flatnonzero((person_of_geom > 0) & (model.geom_group == GEOM_GROUP))
        self._reach = model.geom_rbound[self._body]
        kind = model.geom_type
        still = (model.body_weldid[model.geom_bodyid] == 0) & (person_of_geom == 0) & (model.geom_rgba[:, 3] > 0)
        shaped = (kind != mujoco.mjtGeom.mjGEOM_PLANE) & (kind != mujoco.mjtGeom.mjGEOM_HFIELD)
        self._things = np.array(
            [geom for geom in np.flatnonzero(still & shaped) if _top(model, data, int(geom)) > LOW_M], dtype=np.intp
        )
        upright = np.abs(data.geom_xmat[:, 8]) < 0.7
        self._walls = np.flatnonzero(still & (kind == mujoco.mjtGeom.mjGEOM_PLANE) & upright)

    def at(self, snapshot: Snapshot, allowed: Allowed | None = None, least_m: float = TOLERANCE_M) -> list[Penetration]:
        """Find overlaps deeper than `least_m` [m], by ids: one per pair of people, one per person and room geom.

        People far below the floor are not in the room.
        """
        data = snapshot.data
        place = data.geom_xpos[self._body]
        inside = place[:, 2] > _UNDER_THE_FLOOR_M
        body, place, reach = self._body[inside], place[inside], self._reach[inside]
        deepest: dict[tuple[int, int, int], Penetration] = {}
        for first, second in self._near(data, body, place, reach):
            person, other = int(self._owner[first]), int(self._owner[second])
            if not other and allowed is not None and second in allowed.get(person, ()):
                continue
            depth = -float(mujoco.mj_geomDistance(self.model, data, first, second, 0.0, None))
            if depth <= least_m:
                continue
            if 0 < other < person:
                person, other, first, second = other, person, second, first
            key = (person, other, 0 if other else second)
            if key not in deepest or depth > deepest[key].depth_m:
                names = self._name(first), self._name(second)
                deepest[key] = Penetration(snapshot.t, person, other, *names, depth)
        return [deepest[key] for key in sorted(deepest)]

    def _near(self, data: Any, body: NDArray[np.intp], place: Array, reach: Array) -> Iterable[tuple[int, int]]:
        """Yield pairs of geoms whose bounding spheres meet: a person's, then another person's or the room's."""
        owner = self._owner[body]
        pairs = (owner[:, None] < owner) & (_apart(place, place) < reach[:, None] + reach)
        for first, second in np.argwhere(pairs):
            yield int(body[first]), int(body[second])
        things = self._things
        touches = _apart(place, data.geom_xpos[things]) < reach[:, None] + self.model.geom_rbound[things]
        for first, second in np.argwhere(touches):
            yield int(body[first]), int(things[second])
        for wall in self._walls:
            turn = data.geom_xmat[wall].reshape(3, 3)
            offset = (place - data.geom_xpos[wall]) @ turn
            size = self.model.geom_size[wall, :2]
            adjacent = (np.abs(offset[:, :2]) < np.where(size > 0, size, np.inf)).all(axis=1)
            # a geom wholly behind it is in the next room, not in the wall
            for first in np.flatnonzero(adjacent & (np.abs(offset[:, 2]) < reach)):
                yield int(body[first]), int(wall)

    def _name(self, geom: int) -> str:
        return self.model.geom(geom).name or f"geom {geom}"


def penetrations(snapshot: Snapshot, allowed: Allowed | None = None, least_m: float = TOLERANCE_M) -> list[Penetration]:
    """Find overlaps of people with each other and with the room in one snapshot, deeper than `least_m` [m]."""
    return PenetrationCheck(snapshot.model, snapshot.person_of_geom).at(snapshot, allowed, least_m)


@dataclass
class PenetrationCount:
    """Overlaps of a run: number of times, of those with an overlap, and the deepest overlap of each pair."""

    samples: int = 0
    with_overlap: int = 0
    deepest: dict[tuple[int, int, str], Penetration] = field(default_factory=dict)

    @property
    def depth_m(self) -> float:
        """The deepest overlap of the run [m], 0 without any."""
        return max((each.depth_m for each in self.deepest.values()), default=0.0)

    def add(self, found: Iterable[Penetration]) -> None:
        """Count one time and its overlaps."""
        self.samples += 1
        any_found = False
        for each in found:
            any_found = True
            key = (each.person, each.other, "" if each.other else each.other_geom)
            if key not in self.deepest or each.depth_m > self.deepest[key].depth_m:
                self.deepest[key] = each
        self.with_overlap += any_found

    def __str__(self) -> str:
        """One line a pair, deepest first."""
        worst = sorted(self.deepest.values(), key=lambda each: -each.depth_m)
        lines = [
            f"t = {each.t:.2f} s: {each.geom} {100 * each.depth_m:.1f} cm inside {each.other_geom}" for each in worst
        ]
        return "\n".join([f"{self.with_overlap} of {self.samples} samples hold overlaps", *lines])


def count_penetrations(
    world: SnapshotSource,
    times: Iterable[float],
    allowed: Callable[[float], Allowed] | None = None,
    least_m: float = TOLERANCE_M,
) -> PenetrationCount:
    """Count overlaps over a simulation at rising `times` [s]; `allowed(t)`: exceptions at that time."""
    count = PenetrationCount()
    check: PenetrationCheck | None = None
    for t in times:
        snapshot = world.snapshot(t)
        if check is None or check.model is not snapshot.model:
            check = PenetrationCheck(snapshot.model, snapshot.person_of_geom)
        count.add(check.at(snapshot, allowed(t) if allowed is not None else None, least_m))
    return count


def furniture_in_use(world: World) -> Allowed:
    """Return the geoms that people press into who sit or lie, or are about to."""
    ids, names = world.scene.ids, world.population.names
    in_use: dict[int, list[int]] = {}
    for name, number in world.population._context.taken.items():
        furniture = world.scene.ground.furniture[name]
        assert isinstance(furniture, Seat | Bed)
        in_use[ids[names[number]]] = sorted(furniture.geoms)
    return in_use


def _apart(first: Array, second: Array) -> Array:
    """Return distances (n, m) [m] between points (n, 3) and (m, 3)."""
    return np.linalg.norm(first[:, None] - second, axis=-1)


def _top(model: Any, data: Any, geom: int) -> float:
    """Return the greatest height of a geom by its bounding box [m]."""
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    turn = data.geom_xmat[geom].reshape(3, 3)
    return float(data.geom_xpos[geom, 2] + turn[2] @ middle + np.abs(turn[2]) @ half)
