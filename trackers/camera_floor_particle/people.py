"""Tracks of people: a roster of clouds of body particles, the cloud of each head, and the appearance to each camera."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.tracking.roster import Roster

PAN_BINS = 12
"""References of the head, one for each 30° under which a camera sees it; 0 is the face."""


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, measured when floor or cameras show them. Histograms are kept as their roots, which similarity takes."""

    roster: Roster[Cloud]  # x, y, z of the middle of the body [m]
    head: Cloud  # x, y, z of the middle of the head [m], pan [rad]
    place: Float[Array, "n 3"]  # the body's estimate [m]
    velocity: Float[Array, "n 3"]  # [m/s]
    head_place: Float[Array, "n 3"]
    head_velocity: Float[Array, "n 3"]
    pan: Float[Array, "n"]  # [rad]
    clothes: Float[Array, "n cameras bins"]
    facing: Float[Array, "n steps"]  # how likely each direction of a grid is the pan, from 0 on
    hair: Float[Array, "n pans colours"]  # of each part of the head's window, one part after another
    course: Float[Array, "n 2"]  # velocity over the last third of a second [m/s]
    skin_true: Float[Array, "n"]  # how far the skin of their heads has been where they walk, from −1 to 1
    pan_known: Bool[Mask, "n"]  # whether steps have told where forward is
    weight_n: Float[Array, "n"]  # on the floor, learned [N]
    height_m: Float[Array, "n"]
    lost: Bool[Mask, "n"]  # nothing was left of the particles: they coast

    @property
    def body(self) -> Cloud:
        """Particles of the middles of bodies, x, y, z [m]."""
        return self.roster.state

    @property
    def ids(self) -> Int[Index, "n"]:
        """Ids of the tracks."""
        return self.roster.id
