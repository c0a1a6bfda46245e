"""The people this tracker follows: a roster of IMM states, their clothes, and where they were measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm_state import ImmState
from trackers.filters.rows import Rows, written
from trackers.tracking.appearance import Appearance
from trackers.tracking.roster import Roster


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, oldest first."""

    roster: Roster[ImmState]
    clothes: Appearance
    born_at: Array  # (n, 2) first measured position [m]
    measured_at: Array  # (n, 2) last measured position [m]

    @classmethod
    def started(
        cls,
        state: ImmState,
        position: Array,
        ns: int,
        reference: Array,
        n_look: NDArray[np.int64],
    ) -> Self:
        """Tentative tracks first measured at `position` (n, 2) at stamp ns."""
        clothes = Appearance.started(reference, n_look, ns, position)
        return cls(Roster.started(state, ns), clothes, position, position)

    @property
    def state(self) -> ImmState:
        """What the filter knows of them."""
        return self.roster.state

    @property
    def confirmed(self) -> Mask:
        """Who is confirmed, (n,)."""
        return self.roster.confirmed

    @property
    def positions(self) -> Array:
        """Each track's position over its modes, (n, 2) [m]."""
        return (self.state.mean[:2] * self.state.probability).sum(axis=1).T

    def in_state(self, state: ImmState) -> Self:
        """These tracks with another state."""
        return self.changed(roster=self.roster.changed(state=state))

    def measured(self, track: Index, position: Array, ns: int, state: ImmState) -> Self:
        """These tracks in `state`, with those at `track` (p,) measured at `position` (p, 2) at ns."""
        return self.changed(
            roster=self.roster.measured(track, ns, state),
            measured_at=written(self.measured_at, track, position),
        )
