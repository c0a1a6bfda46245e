"""The soles of everybody at one moment, and the weight on them: what a pressure floor feels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array

_TOUCHES_M = 1e-3


@dataclass(frozen=True, eq=False)
class Feet:
    """Two feet each of n people, left first, in the room frame; people in the order of their names.

    place (n, 2, 2): x, y of the point of the sole under the ankle, as if the foot were flat [m]; yaw (n, 2) [rad];
    height (n, 2): of the lowest point of the sole above the floor [m]; load_n (n, 2): weight that the leg carries down,
    0 for a foot in the air [N]; pressure_ahead_m (n, 2): where it acts, ahead of the ankle along the foot [m];
    present (n,): False for somebody who is not in the room (then the load is 0).
    """

    place: Array
    yaw: Array
    height: Array
    load_n: Array
    pressure_ahead_m: Array
    present: NDArray[np.bool_]

    @property
    def pressure_point(self) -> Array:
        """Where the weight acts on the floor, (n, 2, 2) x, y [m]."""
        ahead = np.stack([np.cos(self.yaw), np.sin(self.yaw)], axis=-1)
        return self.place + self.pressure_ahead_m[..., None] * ahead


@dataclass(frozen=True, eq=False)
class FootShapes:
    """The soles' measures of n people, (n,) each [m]: heel behind the ankle, ball before it, whole length, breadth."""

    heel: Array
    ball: Array
    length: Array
    breadth: Array


def on_the_floor(load: Array, height: Array) -> Array:
    """Loads (2, n) with those of feet that are still, or already, off the floor given to the other foot.

    height: (2, n) above the floor [m]. Between two ticks, of which a foot stands at one only, both its height and its load
    are partly there.
    """
    lifted = height > _TOUCHES_M
    moved = np.where(lifted & ~lifted[::-1], load, 0.0)
    return np.where(lifted, 0.0, load) + moved[::-1]
