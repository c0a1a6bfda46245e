"""Bodies led over the floor at a steady speed, and what their feet carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from twin.people.body.proportions import Skeleton, proportions_of
from twin.people.gait.gait import Gait
from twin.people.gait.pose import GaitState, foot_loads
from twin.people.poses import TICK_S

Flags = NDArray[np.bool_]

FINE_HZ = 600.0
"""Loads between the people's ticks are read as a floor does, by interpolation: at the rate of the force plates."""

_SPEEDS_UP_S = 4.0
_ACCELERATION_M_S2 = 4.0


@dataclass(frozen=True, eq=False)
class Steady:
    """n people at one speed in their stride: what each foot carries, and where it stands."""

    speed_m_s: float
    stature_m: Array  # (n,)
    t: Array  # (k,) [s]
    load: Array  # (k, 2, n) [body weights], left and right foot
    place: NDArray[np.complex128]  # (k, 2, n) x + iy [m]; they walk along x
    pressure_m: Array  # (k, 2, n): where the load acts, ahead of the shoe's heel
    shoe_m: Array  # (n,)


@dataclass
class _Led:
    """What a crowd offers the gait, for people who all go straight ahead."""

    place: NDArray[np.complex128]
    velocity: NDArray[np.complex128]
    acceleration: NDArray[np.complex128]
    heading: Array
    facing: NDArray[np.complex128]
    turn_rate: Array

    @classmethod
    def standing(cls, count: int) -> _Led:
        still = np.zeros(count, dtype=complex)
        return cls(still, still, still, np.zeros(count), np.ones(count, dtype=complex), np.zeros(count))

    def go(self, speed_m_s: float) -> None:
        velocity = np.full(len(self.place), speed_m_s, dtype=complex)
        self.acceleration = (velocity - self.velocity) / TICK_S
        self.velocity = velocity
        self.place = self.place + velocity * TICK_S


def steady(speed_m_s: float, statures_m: Sequence[float], seconds: float = 12.0) -> Steady:
    """People of these statures [m] who walk or run at one speed for so long, after they have started from standing."""
    count = len(statures_m)
    led = _Led.standing(count)
    skeleton = Skeleton([proportions_of(stature) for stature in statures_m])
    gait = Gait(skeleton, led)
    t, load, place, ahead = [], [], [], []
    for tick in range(1, round((seconds + _SPEEDS_UP_S) / TICK_S) + 1):
        now = tick * TICK_S
        led.go(min(speed_m_s, _ACCELERATION_M_S2 * now))
        gait.step(led, np.zeros(count), TICK_S)
        if now > _SPEEDS_UP_S:
            feet = foot_loads(GaitState(gait.state.floor.copy(), gait.state.rows.copy()), skeleton)
            t.append(now)
            load.append(feet.load.copy())
            place.append(feet.place.copy())
            ahead.append(feet.pressure_ahead.copy())
    coarse = np.array(t)
    fine = np.arange(coarse[0], coarse[-1], 1 / FINE_HZ)
    return Steady(
        speed_m_s, np.array(statures_m), fine, _between(fine, coarse, np.array(load)),
        _between(fine, coarse, np.array(place).real) + 1j * _between(fine, coarse, np.array(place).imag),
        _between(fine, coarse, np.array(ahead) + skeleton.heel), skeleton.shoe,
    )  # fmt: skip


def _between(fine: Array, coarse: Array, values: Array) -> Array:
    """Values (k, ...) at the coarse times, at the fine ones (j, ...)."""
    after = np.clip(np.searchsorted(coarse, fine, side="right"), 1, len(coarse) - 1)
    share = (fine - coarse[after - 1]) / (coarse[after] - coarse[after - 1])
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return values[after - 1] + share * (values[after] - values[after - 1])
