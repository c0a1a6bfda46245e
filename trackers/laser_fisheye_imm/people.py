"""Tracks of this system: a roster of IMM states, appearance, and measured positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm import ImmState
from trackers.filters.rows import written
from trackers.laser_fisheye_imm.posture import Posture
from trackers.tracking.appearance import Appearance
from trackers.tracking.roster import NEVER_NS, ImmTracks, Roster

_WALKS_M_S = 0.4
"""Speed above which people walk forwards: below, it is their sway that moves a track, and tells no way [m/s]."""


@dataclass(frozen=True, eq=False)
class People(ImmTracks):
    """n tracks, oldest first."""

    serial: Int[Index, "n"]  # ascending; unique, also for tentative tracks
    roster: Roster[ImmState]
    clothes: Appearance
    born_at: Float[Array, "n 2"]  # first measured position [m]
    measured_at: Float[Array, "n 2"]  # last measured position [m]
    single_ns: Int[Index, "n"]  # stamp of the last measurement by a single leg; before any: `NEVER_NS`
    offset_m2: Float[Array, "n"]  # variance of what stays of the error of the last measurement, on each axis
    facing: Float[Array, "n 2"]  # unit vector of the way they walked last; 0 where they have not walked yet
    posture: Posture
    existence: Float[Array, "n"]  # existence probability

    @classmethod
    def started(
        cls,
        state: ImmState,
        position: Float[Array, "n 2"],
        ns: int,
        reference: Float[Array, "n bins"],
        n_look: Int[Index, "n"],
        first_serial: int = 0,
    ) -> Self:
        """Make tentative tracks first measured at `position` at stamp ns."""
        clothes = Appearance.started(reference, n_look)
        serial = first_serial + np.arange(len(position))
        n, roster = len(position), Roster.started(state, ns)
        never, offset_m2, facing = np.full(n, NEVER_NS), np.zeros(n), np.zeros((n, 2))
        return cls(
            serial, roster, clothes, position, position, never, offset_m2, facing, Posture.upright(n), np.ones(n)
        )

    def exist(self, above: float) -> Bool[Mask, "n"]:
        """Return a mask of the tracks with a larger existence probability than `above`."""
        return self.existence > above

    def continued(self, old: Int[Index, "p"], new: Int[Index, "p"]) -> Self:
        """These tracks, with those at `old` going on as those at `new`, which are no tracks of their own any more."""
        before, after = self.select(old), self.select(new)
        roster = after.roster.changed(id=before.roster.id, born_ns=before.roster.born_ns, confirmed=before.confirmed)
        after = after.changed(serial=before.serial, roster=roster, clothes=before.clothes, born_at=before.born_at)
        kept = written(np.ones(len(self), np.bool_), new, False)
        return self.replaced(old, after).select(kept)

    def turned(self, velocity: Float[Array, "2 n"]) -> Self:
        """These tracks, facing the way of their velocity [m/s] where they walk; whoever stands faces the way they came."""
        speed = np.hypot(*velocity)
        walks = speed > _WALKS_M_S
        return self.changed(
            facing=np.where(walks[:, None], velocity.T / np.where(walks, speed, 1.0)[:, None], self.facing)
        )

    def measured(
        self,
        track: Int[Index, "p"],
        position: Float[Array, "p 2"],
        ns: int,
        state: ImmState,
        existence: Float[Array, "p"],
        offset_m2: Float[Array, "p"],
    ) -> Self:
        """Return the tracks in `state`, with those at `track` measured at `position` at ns, with new existence
        probabilities.

        offset_m2: variance of the persistent error.
        """
        return self.changed(
            roster=self.roster.measured(track, ns, state),
            measured_at=written(self.measured_at, track, position),
            existence=written(self.existence, track, existence),
            offset_m2=written(self.offset_m2, track, offset_m2),
        )
