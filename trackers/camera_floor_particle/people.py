"""Tracks of people: a roster of clouds of body particles, the cloud of each head, and the appearance in each camera."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.tracking.roster import Roster

PAN_BINS = 12
"""References of the head, one per 30° of viewing angle; 0 is the face."""


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, detected when floor or cameras show them. Histograms are stored as roots, for similarity."""

    roster: Roster[Cloud]  # x, y, z of the middle of the body [m]
    head: Cloud  # x, y, z of the middle of the head [m], pan [rad]
    place: Float[Array, "n 3"]  # the body's estimate [m]
    velocity: Float[Array, "n 3"]  # [m/s]
    head_place: Float[Array, "n 3"]
    head_velocity: Float[Array, "n 3"]
    pan: Float[Array, "n"]  # [rad]
    clothes: Float[Array, "n cameras bins"]
    facing: Float[Array, "n steps"]  # probability of each pan in a grid of directions, from 0 on
    hair: Float[Array, "n pans colours"]  # of each part of the head's window, concatenated
    course: Float[Array, "n 2"]  # velocity over the last third of a second [m/s]
    skin_true: Float[Array, "n"]  # agreement of the skin on their heads with their walking direction, from −1 to 1
    pan_known: Bool[Mask, "n"]  # whether steps have shown the forward direction
    weight_n: Float[Array, "n"]  # on the floor, learned [N]
    height_m: Float[Array, "n"]
    lost: Bool[Mask, "n"]  # without particles left: they coast

    @property
    def body(self) -> Cloud:
        """Particles of the middles of bodies, x, y, z [m]."""
        return self.roster.state

    @property
    def ids(self) -> Int[Index, "n"]:
        """Ids of the tracks."""
        return self.roster.id
