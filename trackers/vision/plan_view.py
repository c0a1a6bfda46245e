"""Plan view of foreground: heads at the tops of heaps of points, seen from above.

After M. Harville, "Stereo person tracking with adaptive plan-view templates of height and occupancy statistics" (2004): points
are counted by the area that each shows, in cells of the floor; the highest of a heap show the head.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from trackers.arrays import Array

_CELL_M = 0.1
_ABOUT_M = 0.3
"""Points this near to the middle of a heap are one person's."""
_CROWN = 0.93
"""Share of a person's area up to which the crown's level is looked for: what is above is noise of the distances."""
_HEAD_M = 0.25
"""Height of a head with its neck."""
_BELOW_CROWN_M = 0.1
_MOST = 3
"""Greatest number of new heads per frame."""


def heads_in_plan(points: Float[Array, "4 k"], least_m2: float, apart_m: float) -> Float[Array, "m 3"]:
    """Return middles of heads [m] that points (x, y, z [m], area [m²]) of unassigned foreground show.

    least_m2: area of a heap that shows a person [m²]; apart_m: points nearer to a head than this belong to it [m].
    """
    found: list[Array] = []
    for _ in range(_MOST):
        if found:
            points = points[:, np.hypot(*(points[:2] - found[-1][:2, None])) > apart_m]
        if points.shape[1] == 0 or points[3].sum() < least_m2:
            break
        low = points[:2].min(axis=1) - 2 * _CELL_M
        cell = ((points[:2] - low[:, None]) / _CELL_M).astype(np.intp)
        size = cell.max(axis=1) + 3
        heap = np.bincount(cell[0] * size[1] + cell[1], points[3], size.prod()).reshape(size)
        heap = ndimage.uniform_filter(heap, 5, mode="constant") * 25
        top = np.unravel_index(heap.argmax(), heap.shape)
        if heap[top] < least_m2:
            break
        middle = low + (np.array(top) + 0.5) * _CELL_M
        found.append(head_of(points[:, np.hypot(*(points[:2] - middle[:, None])) < _ABOUT_M]))
    return np.array(found).reshape(-1, 3)


def head_of(points: Float[Array, "4 k"]) -> Float[Array, "3"]:
    """Return the middle of a person's head [m] from at least one point (x, y, z [m], area [m²])."""
    x, y, z, area = points
    order = np.argsort(z)
    crown = z[order][np.searchsorted(np.cumsum(area[order]), _CROWN * area.sum())]
    head = z > crown - _HEAD_M
    at = np.average(x[head], weights=area[head]), np.average(y[head], weights=area[head])
    return np.array([*at, crown - _BELOW_CROWN_M])
