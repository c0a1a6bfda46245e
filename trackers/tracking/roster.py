"""Roster of tracks: identities and the times used by track management, around any batch of states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Self, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm import ImmState
from trackers.filters.rows import Batched, Rows, Selection, written

State = TypeVar("State", bound=Batched)

NEVER_NS = -(2**60)
"""Stamp of what has not happened yet [ns]: long before any clock starts, and its distance to stamps until 2225 fits int64."""


@dataclass(frozen=True, eq=False)
class Roster(Rows, Generic[State]):
    """n tracks, oldest first, including tentative ones.

    `state`: the filter's state, `ImmState`, `Cloud`, or any other batch of n (`trackers.filters.rows.Batched`).
    """

    id: Int[Index, "n"]  # 0 while tentative
    state: State
    born_ns: Int[Index, "n"]  # stamp of the first measurement
    measured_ns: Int[Index, "n"]  # stamp of the last one
    n_measured: Int[Index, "n"]
    confirmed: Bool[Mask, "n"]

    @classmethod
    def started(cls, state: State, ns: int) -> Self:
        """Make tentative tracks in `state`, first measured at stamp ns."""
        n = len(state)
        return cls(
            id=np.zeros(n, np.int64),
            state=state,
            born_ns=np.full(n, ns),
            measured_ns=np.full(n, ns),
            n_measured=np.ones(n, np.int64),
            confirmed=np.zeros(n, np.bool_),
        )

    def __len__(self) -> int:
        return self.id.size

    def measured(self, track: Int[Index, "p"], ns: int, state: State) -> Self:
        """Return the tracks in `state`, with those at `track` measured at stamp ns."""
        n_measured = written(self.n_measured, track, self.n_measured[track] + 1)
        return self.changed(state=state, measured_ns=written(self.measured_ns, track, ns), n_measured=n_measured)

    def confirm(self, track: Selection, first_id: int) -> Self:
        """Return the tracks with those at `track` confirmed, numbered from `first_id` on."""
        ids = first_id + np.arange(self.id[track].size)
        return self.changed(id=written(self.id, track, ids), confirmed=written(self.confirmed, track, True))


class ImmTracks(Rows):
    """Base of a frozen dataclass of n tracks whose roster holds the states of an IMM filter, position and velocity."""

    roster: Roster[ImmState]

    @property
    def state(self) -> ImmState:
        """The state of the filter."""
        return self.roster.state

    @property
    def confirmed(self) -> Bool[Mask, "n"]:
        """The confirmed tracks."""
        return self.roster.confirmed

    @property
    def positions(self) -> Float[Array, "n 2"]:
        """Position of each track over its modes [m]."""
        return (self.state.mean[:2] * self.state.probability).sum(axis=1).T

    def in_state(self, state: ImmState) -> Self:
        """Return the tracks with another state."""
        return self.changed(roster=self.roster.changed(state=state))
