"""The world at one moment, as sensors and truth look at it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.instant.feet import Feet

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
        """The scene at time t [s]; the snapshot given before becomes invalid."""
        ...
