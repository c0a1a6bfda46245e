"""The world at one moment, as sensors and truth look at it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

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
        """Points at which the weight acts on the floor, (n, 2, 2) x, y [m]."""
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
    """Give the loads (2, n) of feet that are still, or already, off the floor to the other foot.

    height: (2, n) above the floor [m]. Between two ticks, of which a foot stands at one only, both its height and its load
    are partly there.
    """
    lifted = height > _TOUCHES_M
    moved = np.where(lifted & ~lifted[::-1], load, 0.0)
    return np.where(lifted, 0.0, load) + moved[::-1]


if TYPE_CHECKING:
    import mujoco

RAY_GROUPS = np.array([1, 1, 1, 1, 0, 0], dtype=np.uint8)
"""Geom groups that rays (scanners, visibility) meet: 0 to 2, which are drawn too, and 3, for rays only."""

DRAWN_GROUPS = np.array([1, 1, 1, 0, 1, 0], dtype=np.uint8)
"""Geom groups that cameras draw: 0 to 2, which rays meet too, and 4, drawn only (eyes, trim). Group 5: neither."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The scene at time `t` [s since the start]: kinematics, camera and light poses of `data` are computed for it.

    `data` is shared and valid only until the next snapshot is taken: work with one before asking for another.
    `person_of_geom` (n_geom,) holds the id (from 1) of the person a geom belongs to, 0 for the room. `feet`: everybody's
    soles and the weight on them, None in the empty room.
    """

    t: float
    model: mujoco.MjModel
    data: mujoco.MjData
    person_of_geom: NDArray[np.int16]
    feet: Feet | None = None


class SnapshotSource(Protocol):
    """A world: gives the scene at any time of the last second or so, moving forward."""

    def snapshot(self, t: float) -> Snapshot:
        """Return the scene at time t [s]; the snapshot given before becomes invalid."""
        ...
