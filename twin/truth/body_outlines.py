"""Gaps between bodies' outlines, seen from above."""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.geometry.geom_hull import hull_points
from twin.instant.snapshot import RAY_GROUPS
from twin.truth.situations import every_pair

_DIRECTIONS = 200
"""Number of directions; of each part of a body the outermost point in each is kept: to 3 mm for a trunk."""
_COARSE = 48
_FINE = 33
"""Separating directions are searched over the circle, then between the neighbours of the best: to 0.25°, 1 mm.

An outline's corners are its outermost points in the first of these; a round one loses 0.2 % of its radius between two.
"""
_CIRCLES_SPARE_M = 0.05
"""More than a gap over those directions may be smaller than the true one [m]."""
_MAY_TOUCH_M = -0.1
"""Outlines whose gap is below this in every coarse direction overlap in the fine ones too."""


class BodyOutlines:
    """Outlines of a model's people: the convex hull of all body parts that rays meet, projected onto the floor.

    It includes arms, bags, the swinging foot, and the space between them. People stand as in `data`; nothing depends on a
    sensor.
    """

    def __init__(self, model: mujoco.MjModel, person_of_geom: NDArray[np.int16]) -> None:
        """Prepare the geoms; `person_of_geom` (n_geom,): id of the person a geom belongs to, 0 for the room."""
        self.model = model
        met = RAY_GROUPS[model.geom_group].astype(np.bool_)
        ids = np.unique(person_of_geom[person_of_geom > 0])
        self._geoms = [np.flatnonzero((person_of_geom == id_) & met) for id_ in ids]
        self._all_geoms = np.concatenate([*self._geoms, np.zeros(0, dtype=np.intp)])
        self._count = np.array([len(geoms) for geoms in self._geoms], dtype=np.intp)
        self._first = np.cumsum(self._count) - self._count  # of each person's geoms among all
        self._place = {int(id_): place for place, id_ in enumerate(ids)}

    def nearer(
        self, data: mujoco.MjData, ids: NDArray[np.integer], limit_m: float
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Find pairs of `ids` (n,) whose outlines are less than `limit_m` apart: their indices in `ids` (m, 2), first < second.

        Also returns the gap of each (m,) [m], 0 where outlines overlap. `data` needs kinematics.
        """
        pairs = every_pair(len(ids))
        if not len(pairs):
            return pairs, np.zeros(0)
        places = np.array([self._place[id_] for id_ in ids.tolist()], dtype=np.intp)
        pairs = pairs[self._circles_gap(data)[places[pairs[:, 0]], places[pairs[:, 1]]] < limit_m + _CIRCLES_SPARE_M]
        if not len(pairs):
            return pairs, np.zeros(0)
        near, among = _members(pairs, len(ids))
        pairs = pairs[_strips(self._boxes_reach(data, places[near]), among).max(axis=1) < limit_m]
        if not len(pairs):
            return pairs, np.zeros(0)
        near, among = _members(pairs, len(ids))
        gap = _gaps(self._corners(data, places[near]), among)
        return pairs[gap < limit_m], gap[gap < limit_m]

    def _circles_gap(self, data: mujoco.MjData) -> Array:
        """Return the gaps between circles about the people (n, n) [m], by the bounding spheres of their geoms."""
        place = data.geom_xpos[self._all_geoms, :2]
        middle = place[self._first]
        off = place - middle.repeat(self._count, axis=0)
        reach = np.hypot(off[:, 0], off[:, 1]) + self.model.geom_rbound[self._all_geoms]
        radius = np.maximum.reduceat(reach, self._first)
        apart = middle[:, None] - middle
        return np.hypot(apart[..., 0], apart[..., 1]) - radius[:, None] - radius

    def _boxes_reach(self, data: mujoco.MjData, places: NDArray[np.intp]) -> Array:
        """Return the reach of people with these indices (n,) in coarse directions, by boxes about geoms, (n, _COARSE) [m]."""
        geoms = np.concatenate([self._geoms[place] for place in places])
        first = np.cumsum(self._count[places]) - self._count[places]
        sides = data.geom_xmat.reshape(-1, 3, 3)[geoms, :2].swapaxes(1, 2).reshape(-1, 2)  # seen from above
        along = (sides @ _HALF_TURN.T).reshape(-1, 3, _COARSE // 2)
        offset, half = self.model.geom_aabb[geoms, :, None].reshape(-1, 2, 3, 1).swapaxes(0, 1)
        middle = data.geom_xpos[geoms, :2] @ _HALF_TURN.T + (offset * along).sum(axis=1)
        spread = (half * np.abs(along)).sum(axis=1)
        return np.maximum.reduceat(np.concatenate([spread + middle, spread - middle], axis=1), first, axis=0)

    def _corners(self, data: mujoco.MjData, places: NDArray[np.intp]) -> Array:
        """Return the outermost points, seen from above, of people with these indices (n,), by coarse direction,
        (n, 2, _COARSE) [m].
        """
        # x, y of the axes and of the middle of each geom (8, n_geom)
        pose = np.concatenate([data.geom_xmat[:, [0, 3, 1, 4, 2, 5]], data.geom_xpos[:, :2]], axis=1).T.copy()
        corners = np.empty((len(places), 2, _COARSE))
        for number, place in enumerate(places.tolist()):  # one by one, within the processor's cache
            geom, (x, y, z) = self._kept[place]
            of_x, of_y, of_z, middle = pose.take(geom, axis=1).reshape(4, 2, -1)
            own = middle + (of_x * x + of_z * z + of_y * y)
            along = _HALF_TURN @ own  # how far each point lies in each direction
            corners[number] = own.take(np.concatenate([along.argmax(axis=1), along.argmin(axis=1)]), axis=1)
        return corners

    @cached_property
    def _kept(self) -> list[tuple[NDArray[np.intp], Array]]:
        """For each person the geom (k,) and position in its frame (3, k) of points."""
        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        directions = _sphere(_DIRECTIONS)
        rows = []
        for geoms in self._geoms:
            owners, places = [], []
            for geom in geoms:
                points = hull_points(self.model, data, int(geom))
                if points is None:
                    raise ValueError(f"geom {self.model.geom(int(geom)).name!r} of a person has no hull")
                outermost = points[np.unique((points @ directions.T).argmax(axis=0))]
                places.append((outermost - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3))
                owners.append(np.full(len(outermost), geom))
            rows.append((np.concatenate(owners), np.concatenate(places).T.copy()))
        return rows


def _members(pairs: NDArray[np.intp], count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which of `count` are in pairs (m, 2), (n,), and the pairs as indices of these."""
    present = np.zeros(count, dtype=np.bool_)
    present[pairs] = True
    return present.nonzero()[0], (present.cumsum() - 1)[pairs]


def _gaps(corners: Array, pairs: NDArray[np.intp]) -> Array:
    """Return the distance (m,) [m] between convex hulls of corners (n, 2, _COARSE) for pairs (m, 2); 0 for an overlap.

    It is the width of the widest separating strip over all directions. For disjoint hulls the width has one maximum, so a
    coarse search finds where to refine.
    """
    width = _strips((corners * _COARSE_DIRECTIONS.T).sum(axis=1), pairs)
    best = width.argmax(axis=1)
    gap = width.max(axis=1)
    apart = (gap > _MAY_TOUCH_M).nonzero()[0]
    fine = _unit(_COARSE_ANGLES[best[apart], None] + _FINE_STEPS)  # (a, _FINE, 2)
    first, second = (corners[pairs[apart, side]] for side in (0, 1))  # (a, 2, _COARSE)
    gap[apart] = ((fine @ second).min(axis=2) - (fine @ first).max(axis=2)).max(axis=1)
    return np.maximum(gap, 0.0)


def _strips(reach: Array, pairs: NDArray[np.intp]) -> Array:
    """Return the width (m, _COARSE) [m] of the strip between two outlines per coarse direction, negative for an overlap.

    reach (n, _COARSE): of each outline in each direction [m]; pairs (m, 2) of them.
    """
    first, second = pairs.T
    return -reach.take(_OPPOSITE, axis=1).take(second, axis=0) - reach.take(first, axis=0)


def _unit(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


_COARSE_ANGLES = 2 * np.pi * np.arange(_COARSE) / _COARSE
_FINE_STEPS = np.linspace(-2 * np.pi / _COARSE, 2 * np.pi / _COARSE, _FINE)
_HALF_TURN = _unit(_COARSE_ANGLES[: _COARSE // 2])
_COARSE_DIRECTIONS = np.concatenate([_HALF_TURN, -_HALF_TURN])
_OPPOSITE = np.roll(np.arange(_COARSE), _COARSE // 2)  # of each coarse direction


def _sphere(count: int) -> Array:
    """Return directions (count, 3) spread evenly over the sphere: a Fibonacci lattice."""
    place = np.arange(count) + 0.5
    z, turn = 1 - 2 * place / count, np.pi * (1 + np.sqrt(5)) * place
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
