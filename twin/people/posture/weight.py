"""How the motions of postures weigh on the feet: their share of the weight, and how the centre of mass rises and falls."""

from __future__ import annotations

import numpy as np

from trackers.arrays import Array
from twin.people.posture.measures import BodyMeasures
from twin.people.posture.rows import (
    ACCELERATION,
    BACK,
    DROP,
    HELD_HIGH,
    OFF_FEET,
    PELVIS_PITCH,
    PLACE_Z,
    PRESSURE,
    SPINE_PITCH,
)

_UPPER_BODY_SHARE = 0.678
_UPPER_BODY_UP = 0.18
"""Mass of head, arms and trunk as a share of the body's, and their centre above the hips as a share of the stature (D. A.
Winter, "Biomechanics and Motor Control of Human Movement", table 4.1)."""
_THIGHS_SHARE = 0.16
"""Share of the mass that the legs add to what rises with the hips."""


class CentreOfMass:
    """The heights of n people's centres of mass about that of standing, and their rates, as postures move them."""

    def __init__(self, measures: BodyMeasures) -> None:
        self._measures = measures
        self._up = np.zeros(len(measures))
        self._rate = np.zeros(len(measures))

    @property
    def moves(self) -> bool:
        """Whether anybody's centre of mass is not where standing has it, at rest."""
        return bool(self._up.any() or self._rate.any())

    def step(self, rows: Array, dt: float) -> None:
        """Write the vertical acceleration into rows (POSTURE_ROWS, n), which are how it is `dt` [s] after the last call.

        A difference of heights, so one tick late. Arms and lower legs are taken to keep their height.
        """
        if not (rows.any() or self.moves):
            return
        up = self._height(rows)
        rate = (up - self._up) / dt
        rows[ACCELERATION] = (rate - self._rate) / dt
        self._up, self._rate = up, rate

    def begin(self, rows: Array) -> None:
        """Begin at rest in rows (POSTURE_ROWS, n)."""
        self._up, self._rate = self._height(rows), np.zeros(len(self._measures))

    def _height(self, rows: Array) -> Array:
        rest = hips_up(np.zeros_like(rows), self._measures)
        lean = rows[PELVIS_PITCH] + rows[SPINE_PITCH]
        upper = _UPPER_BODY_SHARE * _UPPER_BODY_UP * self._measures.stature * (np.cos(lean) - 1.0)
        return (_UPPER_BODY_SHARE + _THIGHS_SHARE) * (hips_up(rows, self._measures) - rest) + upper


def hips_up(rows: Array, measures: BodyMeasures) -> Array:
    """Height of the hip joints (n,) [m], the gait's small motions left out."""
    over_ankles = np.sqrt(np.maximum(measures.leg**2 - rows[BACK] ** 2, 0.0)) - rows[DROP]
    return (1 - rows[HELD_HIGH]) * (over_ankles + measures.ankle_height) + rows[PLACE_Z]


def support(rows: Array) -> tuple[Array, Array]:
    """Share of the weight on the feet, and vertical acceleration of the centre of mass [m/s²], (n,) each.

    The feet of somebody of mass m carry share · m · (g + acceleration).
    """
    return 1.0 - rows[OFF_FEET], rows[ACCELERATION]


def pressure_shift_m(rows: Array) -> Array:
    """How far the postures move the centre of pressure forward under the feet, (n,) [m]."""
    return rows[PRESSURE]
