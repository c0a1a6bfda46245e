"""Does a camera see anything of where people walk?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from twin.instant.snapshot import Snapshot
from twin.truth.visibility import SensorView, visible_share

_SPACING_M = 0.25
_MOST_PLACES = 1000
_HEIGHTS_M = (0.1, 0.9, 1.6)
"""Feet, middle and head of somebody who stands there [m]."""

_NOBODY = np.array([np.iinfo(np.int16).max], dtype=np.int16)


def sees_some_of(view: SensorView, empty: Snapshot, area: NDArray[np.float64]) -> bool:
    """Whether a ray from the camera reaches any point in which a body in the area (k, 2) [m] of the empty room might be."""
    return bool(visible_share(view, empty, _points(area)[None], _NOBODY)[0] > 0)


def _points(area: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points over the area, at a few heights, (n, 3) [m]; the corners' middle alone where it is narrower than the grid."""
    low, high = area.min(axis=0), area.max(axis=0)
    spacing_m = max(_SPACING_M, float(np.sqrt(np.prod(high - low) / _MOST_PLACES)))
    x, y = np.meshgrid(np.arange(low[0], high[0], spacing_m), np.arange(low[1], high[1], spacing_m))
    places = np.stack([x.ravel(), y.ravel()], axis=-1) + spacing_m / 2
    inside = Area(area).contains(places)
    places = places[inside] if inside.any() else area.mean(axis=0, keepdims=True)
    return np.concatenate([np.column_stack([places, np.full(len(places), height)]) for height in _HEIGHTS_M])
