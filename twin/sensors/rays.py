"""Ray casting from one point: first hit and distance of each ray, once, or repeatedly from a fixed point."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from twin.instant.snapshot import RAY_GROUPS, Snapshot, base_body

_HIDDEN_GROUP = 5  # neither drawn nor met by rays
_MARGIN_M = 1e-6
"""Margin added to bounding spheres against rounding errors [m]."""


def trace_rays(
    snapshot: Snapshot,
    origin_m: Array,
    directions: Array,
    geom: NDArray[np.int32],
    distance_m: Array,
    *,
    normal: Array | None = None,
    left_out: Mask | None = None,
    range_max_m: float = mujoco.mjMAXVAL,
    base: str | None = None,
    faces: Array | None = None,
) -> None:
    """Fill in the geom (n,) and the distance (n,) [m] of each ray's first hit; -1 for none.

    `origin_m` (3,) and the unit `directions` (n, 3) are in the room frame. For rays in one plane, its `normal` (3,) saves more
    than half of the cost: geoms whose bounding sphere does not meet the plane are skipped. Rays pass through the geoms of
    `left_out` (n_geom,) and through the body, if any, of the housing `base` that the sensor drives on. `faces` (n, 3) is
    filled with the unit normals of the surfaces hit.
    """
    model, data = snapshot.model, snapshot.data
    # -1, of no body, for a housing without one too
    own_body = -1 if base is None else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, base_body(base))
    arguments = (
        directions.reshape(-1),
        RAY_GROUPS,
        True,
        own_body,
        geom,
        distance_m,
        None if faces is None else faces.reshape(-1),
        geom.size,
        range_max_m,
    )
    if normal is not None:
        clear = ~crosses_plane(snapshot, origin_m, normal)
        left_out = clear if left_out is None else clear | left_out
    if left_out is None:
        mujoco.mj_multiRay(model, data, origin_m, *arguments)
        return
    groups = model.geom_group.copy()
    try:
        model.geom_group[left_out] = _HIDDEN_GROUP
        mujoco.mj_multiRay(model, data, origin_m, *arguments)
    finally:
        model.geom_group[:] = groups


def crosses_plane(snapshot: Snapshot, origin_m: Array, normal: Array) -> Mask:
    """Return a mask (n_geom,) of geoms whose bounding sphere meets a plane; planes and height fields, without bounds, do."""
    radius = snapshot.model.geom_rbound  # 0 without bounds
    return (np.abs((snapshot.data.geom_xpos - origin_m) @ normal) <= radius) | (radius <= 0)


def passes_spheres(directions: Array, reach_m: Array | float, centre_m: Array, radius_m: Array) -> Mask:
    """Return a mask (n, m) of rays that may enter spheres; True for every ray that does.

    `directions` (n, 3): unit vectors; `reach_m` (n,): lengths of the rays [m]; `centre_m` (m, 3): relative to their origin.
    """
    radius_m = radius_m + _MARGIN_M
    along = directions @ centre_m.T  # (n, m): to the place nearest to each centre
    miss_m2 = (centre_m * centre_m).sum(axis=1) - along * along
    return (
        (miss_m2 <= radius_m * radius_m) & (along > -radius_m) & (along < np.asarray(reach_m).reshape(-1, 1) + radius_m)
    )


Hits = tuple[NDArray[np.int32], Array]
"""First hits of rays: geom (n,) and distance (n,) [m]; both -1 for none."""


class RayFan:
    """Rays in one plane with cached ranges of the empty room. Only rays near people are cast again, and only at people.

    Results are bit-identical to casting all rays at everything. The cache is valid while only people move; every trace checks
    that.
    """

    def __init__(self, origin_m: Array, directions: Array, normal: Array, range_max_m: float) -> None:
        """Prepare the rays; `origin_m` (3,), unit `directions` (n, 3) and `normal` (3,) of their plane are in the room frame."""
        self.origin_m = origin_m
        self.directions = directions
        self._normal = normal
        self._range_max_m = range_max_m
        ahead = directions[:1] if len(directions) else np.zeros((1, 3))
        self._axes = np.concatenate([ahead, np.cross(normal, ahead)]).T  # (3, 2) of the plane
        bearing = _bearing(directions @ self._axes)
        self._order = bearing.argsort()
        self._bearing = bearing[self._order]  # (n,), ascending
        self._model: mujoco.MjModel | None = None
        self._may_move = np.zeros(0, dtype=np.intp)
        self._poses = np.zeros((0, 12))
        self._kept: Hits = np.zeros(0, dtype=np.int32), np.zeros(0)

    def trace(self, snapshot: Snapshot, rays: slice) -> Hits:
        """Return the first hits of some of the rays."""
        room, room_m = self._in_the_room(snapshot)
        geom, distance_m = room[rays].copy(), room_m[rays].copy()
        people = (snapshot.person_of_geom > 0) & crosses_plane(snapshot, self.origin_m, self._normal)
        near = self._near(snapshot, people)[rays].nonzero()[0]
        if near.size:
            person, person_m = self._meet(snapshot, self.directions[rays][near], ~people)
            nearer = (person_m >= 0) & ((person_m < distance_m[near]) | (distance_m[near] < 0))
            geom[near[nearer]], distance_m[near[nearer]] = person[nearer], person_m[nearer]
        return geom, distance_m

    def _near(self, snapshot: Snapshot, geoms: Mask) -> Mask:
        """Return which rays (n,) may meet one of some geoms (n_geom,): those between the tangents of its bounding sphere,
        cut by their plane."""
        offset, whole = snapshot.data.geom_xpos[geoms] - self.origin_m, snapshot.model.geom_rbound[geoms] + _MARGIN_M
        in_plane, beside = offset @ self._axes, offset @ self._normal
        radius = (
            np.sqrt(np.maximum(whole * whole - beside * beside, 0.0)) + _MARGIN_M
        )  # of the sphere's circle in the plane
        far = np.hypot(in_plane[:, 0], in_plane[:, 1])
        half = np.where(far > radius, np.arcsin(radius / np.maximum(far, radius)), np.pi)
        half[far > self._range_max_m + radius] = -1.0  # none
        middle = _bearing(in_plane) + _TURNS
        first = self._bearing.searchsorted((middle - half).ravel())
        stop = np.maximum(self._bearing.searchsorted((middle + half).ravel(), side="right"), first)
        count = len(self._bearing)
        change = np.bincount(first, minlength=count + 1) - np.bincount(stop, minlength=count + 1)
        near = np.empty(count, dtype=np.bool_)
        near[self._order] = change[:count].cumsum() > 0
        return near

    def _in_the_room(self, snapshot: Snapshot) -> Hits:
        """Return the first hits of all rays in the empty room."""
        model, data = snapshot.model, snapshot.data
        if model is self._model and not self._may_move.size:
            return self._kept
        if model is not self._model:
            in_room = snapshot.person_of_geom == 0
            self._may_move = np.flatnonzero(in_room & (model.body_weldid[model.geom_bodyid] > 0))
        poses = np.concatenate([data.geom_xpos[self._may_move], data.geom_xmat[self._may_move]], axis=1)
        if model is not self._model or not np.array_equal(poses, self._poses):
            self._model, self._poses = model, poses
            left_out = (snapshot.person_of_geom > 0) | ~crosses_plane(snapshot, self.origin_m, self._normal)
            self._kept = self._meet(snapshot, self.directions, left_out)
        return self._kept

    def _meet(self, snapshot: Snapshot, directions: Array, left_out: Mask) -> Hits:
        geom, distance_m = np.empty(len(directions), dtype=np.int32), np.empty(len(directions))
        trace_rays(
            snapshot, self.origin_m, directions, geom, distance_m, left_out=left_out, range_max_m=self._range_max_m
        )
        return geom, distance_m


_TURNS = 2 * np.pi * np.array([[-1.0], [0.0], [1.0]])


def _bearing(in_plane: Array) -> Array:
    """Return the bearing (n,) [rad] of points (n, 2)."""
    return np.arctan2(in_plane[:, 1], in_plane[:, 0])
