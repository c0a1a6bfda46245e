"""Bundles of rays from one point: what they meet, and how far away."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.snapshot import RAY_GROUPS, Snapshot

_HIDDEN_GROUP = 5  # neither drawn nor met by rays


def cast(
    snapshot: Snapshot,
    origin_m: NDArray[np.float64],
    directions: NDArray[np.float64],
    geom: NDArray[np.int32],
    distance_m: NDArray[np.float64],
    *,
    normal: NDArray[np.float64] | None = None,
    range_max_m: float = mujoco.mjMAXVAL,
) -> None:
    """Fill the geom (n,) that each ray meets first (-1: none) and its distance (n,) [m] (-1).

    `origin_m` (3,) and the unit `directions` (n, 3) are in the room frame. Where all rays lie in one plane, its
    `normal` (3,) saves more than half of the cost: geoms whose bounding sphere stays clear of the plane are left out.
    """
    model, data = snapshot.model, snapshot.data
    arguments = (directions.reshape(-1), RAY_GROUPS, True, -1, geom, distance_m, None, geom.size, range_max_m)
    if normal is None:
        mujoco.mj_multiRay(model, data, origin_m, *arguments)
        return
    # Planes and height fields have no bounding sphere (radius 0): always asked.
    clear = (np.abs((data.geom_xpos - origin_m) @ normal) > model.geom_rbound) & (model.geom_rbound > 0)
    groups = model.geom_group.copy()
    try:
        model.geom_group[clear] = _HIDDEN_GROUP
        mujoco.mj_multiRay(model, data, origin_m, *arguments)
    finally:
        model.geom_group[:] = groups
