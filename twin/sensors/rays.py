"""Bundles of rays from one point: what they meet, and how far away."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Mask
from twin.instant.snapshot import RAY_GROUPS, Snapshot

_HIDDEN_GROUP = 5  # neither drawn nor met by rays
_MARGIN_M = 1e-6
"""By how much bounds are wider than they are, so that rounding leaves nothing out [m]."""


def cast(
    snapshot: Snapshot,
    origin_m: Array,
    directions: Array,
    geom: NDArray[np.int32],
    distance_m: Array,
    *,
    normal: Array | None = None,
    left_out: Mask | None = None,
    range_max_m: float = mujoco.mjMAXVAL,
) -> None:
    """Fill the geom (n,) that each ray meets first (-1: none) and its distance (n,) [m] (-1).

    `origin_m` (3,) and the unit `directions` (n, 3) are in the room frame. Where all rays lie in one plane, its
    `normal` (3,) saves more than half of the cost: geoms whose bounding sphere stays clear of the plane are left out.
    So are those of `left_out` (n_geom,): rays pass through them.
    """
    model, data = snapshot.model, snapshot.data
    arguments = (directions.reshape(-1), RAY_GROUPS, True, -1, geom, distance_m, None, geom.size, range_max_m)
    if normal is not None:
        clear = np.abs((data.geom_xpos - origin_m) @ normal) > bounding_radius(model)
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


def bounding_radius(model: mujoco.MjModel) -> Array:
    """Radius of the bounding sphere about each geom's place (n_geom,) [m]; infinite for planes and height fields."""
    return np.where(model.geom_rbound > 0, model.geom_rbound, np.inf)


def passes_spheres(directions: Array, reach_m: Array | float, centre_m: Array, radius_m: Array) -> Mask:
    """Whether rays may enter spheres, (n, m): never False for one that does.

    The unit `directions` (n, 3) go `reach_m` (n,) [m] far; `centre_m` (m, 3) is seen from where they begin [m].
    """
    radius_m = radius_m + _MARGIN_M
    along = directions @ centre_m.T  # (n, m): to the place nearest to each centre
    aside = (centre_m * centre_m).sum(axis=1) - along * along
    return (aside <= radius_m * radius_m) & (along > -radius_m) & (along < np.reshape(reach_m, (-1, 1)) + radius_m)
