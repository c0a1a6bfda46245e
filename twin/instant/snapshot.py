"""The world at one instant, for sensors and truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array

_TOUCHES_M = 1e-3


@dataclass(frozen=True, eq=False)
class Feet:
    """Feet of n people, left first, in the room frame; people ordered by name.

    place (n, 2, 2): x, y of the sole's point under the ankle of the flat foot [m]; yaw (n, 2) [rad]; height (n, 2): of the
    lowest point of the sole above the floor [m]; load_n (n, 2): weight on the foot, 0 in the air [N]; pressure_ahead_m (n,
    2): point of load, ahead of the ankle along the foot [m]; present (n,): False outside the room (then the load is 0).
    """

    place: Array
    yaw: Array
    height: Array
    load_n: Array
    pressure_ahead_m: Array
    present: NDArray[np.bool_]

    @property
    def pressure_point(self) -> Array:
        """Points of load on the floor, (n, 2, 2) x, y [m]."""
        ahead = np.stack([np.cos(self.yaw), np.sin(self.yaw)], axis=-1)
        return self.place + self.pressure_ahead_m[..., None] * ahead


@dataclass(frozen=True, eq=False)
class FootShapes:
    """Measures of the soles of n people, (n,) each [m]: heel behind the ankle, ball before it, whole length, breadth."""

    heel: Array
    ball: Array
    length: Array
    breadth: Array


def on_the_floor(load: Array, height: Array) -> Array:
    """Move the loads (2, n) of feet still, or already, off the floor to the other foot.

    height: (2, n) above the floor [m]. Between two ticks of which a foot stands at one only, height and load are
    interpolated and both nonzero.
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
    """Scene at time `t` [s since the start], with kinematics, camera and light poses in `data` computed.

    `data` is shared and valid only until the next snapshot is taken. `person_of_geom` (n_geom,): id (from 1) of the geom's
    person, 0 for the room. `feet`: soles and loads of all people, None in the empty room.
    """

    t: float
    model: mujoco.MjModel
    data: mujoco.MjData
    person_of_geom: NDArray[np.int16]
    feet: Feet | None = None
    bases: Mapping[str, Array] = field(default_factory=dict)


def base_body(name: str) -> str:
    """Return the name in the model of a driving housing's body."""
    return f"housing/{name}"


class SnapshotSource(Protocol):
    """World that yields the scene at any time of the last second or so, moving forward."""

    def snapshot(self, t: float) -> Snapshot:
        """Return the scene at time t [s]; the previous snapshot becomes invalid."""
        ...
