"""The parameters of walking as they follow from speed."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from twin.models import MODELS
from twin.people.skeleton import Skeleton

Array = NDArray[np.float64]

_SPEED_STEP_M_S = 0.05


class GaitStyle(NamedTuple):
    """How n people walk at their speeds now, each (n,); the rows of `models/people/gait.yaml`.

    step_time [s]; double_support: share of a step; step_width, clearance (of the swinging foot), pelvis_drop, bob [m];
    toe_up (of the foot before it lands), trunk_lean, elbow [rad].
    """

    step_time: Array
    double_support: Array
    step_width: Array
    clearance: Array
    toe_up: Array
    pelvis_drop: Array
    bob: Array
    trunk_lean: Array
    elbow: Array


_ROWS = (
    "step_time_s", "double_support", "step_width_m", "clearance_m", "toe_up_rad", "pelvis_drop_m", "bob_m",
    "trunk_lean_rad", "elbow_rad",
)  # fmt: skip
_TIMES = (0,)
_LENGTHS = (2, 3, 5, 6)


@cache
def _table() -> tuple[Array, float]:
    """The table resampled to even steps of speed (parameters, speeds), and its last speed [m/s]."""
    content = yaml.safe_load((MODELS / "people" / "gait.yaml").read_text(encoding="utf-8"))
    top = float(content["speed_m_s"][-1])
    speeds = np.arange(0.0, top + 2 * _SPEED_STEP_M_S, _SPEED_STEP_M_S)
    return np.stack([np.interp(speeds, content["speed_m_s"], content[name]) for name in _ROWS]), top


class GaitTable:
    """Looks up how each of n people walks, scaled to their legs by dynamic similarity (equal Froude number)."""

    def __init__(self, skeleton: Skeleton) -> None:
        self._table, self._top = _table()
        self._factors = np.ones((len(_ROWS), len(skeleton.scale)))
        self._factors[_TIMES, :] = np.sqrt(skeleton.scale)
        self._factors[_LENGTHS, :] = skeleton.scale
        self._per_speed = 1.0 / np.sqrt(skeleton.scale)

    def at(self, speed: Array) -> GaitStyle:
        """The parameters at these speeds (n,) [m/s]; beyond the table's last speed those of the last."""
        place = np.minimum(speed * self._per_speed, self._top) * (1.0 / _SPEED_STEP_M_S)
        row = place.astype(np.intp)
        low = self._table[:, row]
        return GaitStyle(*((low + (place - row) * (self._table[:, row + 1] - low)) * self._factors))
