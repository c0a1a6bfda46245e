"""Roster of tracks: identities and the times used by track management, around any batch of states; and association in stages.

In each stage some tracks and the free measurements are paired one to one at least total cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.filters.gating import global_nearest_neighbour, max_weight_assignment
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
    state: State  # of the filter
    born_ns: Int[Index, "n"]  # stamp of the first measurement
    measured_ns: Int[Index, "n"]  # stamp of the last one
    n_measured: Int[Index, "n"]  # measurements so far
    confirmed: Bool[Mask, "n"]  # false: tentative

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
        return self.state.mean_over_modes[:2].T

    def in_state(self, state: ImmState) -> Self:
        """Return the tracks with another state."""
        return self.changed(roster=self.roster.changed(state=state))


@dataclass(frozen=True, eq=False)
class Stage:
    """Participating tracks; costs of the pairs, summed; a pair in any veto mask is forbidden.

    unpaired: cost of each track without a measurement; None: as many pairs as possible, at any cost.
    """

    tracks: Bool[Mask, "n"]
    terms: Sequence[Float[Array, "n k"]]
    vetoes: Sequence[Bool[Mask, "n k"]] = ()
    unpaired: Float[Array, "n"] | None = None


_NO_PAIRS = np.empty(0, np.intp), np.empty(0, np.intp)


def associate(
    stages: Sequence[Stage], paired: tuple[Int[Index, "before"], Int[Index, "before"]] = _NO_PAIRS
) -> tuple[Int[Index, "p"], Int[Index, "p"]]:
    """Return pairs (tracks, measurements) by the global nearest neighbour of each stage in turn, after those `paired` before.

    Tracks and measurements paired in one stage are excluded from later ones. Pairs are in the order of their stages.
    """
    rows, columns = paired
    for stage in stages:
        allowed = stage.tracks[:, None].repeat(stage.terms[0].shape[1], axis=1)
        for veto in stage.vetoes:
            allowed &= ~veto
        allowed[rows] = allowed[:, columns] = False
        if not np.count_nonzero(allowed):
            continue
        cost = sum(stage.terms[1:], start=stage.terms[0])
        if stage.unpaired is None:
            more_rows, more_columns = global_nearest_neighbour(cost, allowed)
        else:
            more_rows, more_columns = max_weight_assignment(np.where(allowed, stage.unpaired[:, None] - cost, 0.0))
        rows, columns = np.concatenate([rows, more_rows]), np.concatenate([columns, more_columns])
    return rows, columns


def left_over(n: int, taken: Int[Index, "p"]) -> Int[Index, "rest"]:
    """Return the indices below n that are not `taken`."""
    is_taken = np.zeros(n, np.bool_)
    is_taken[taken] = True
    return (~is_taken).nonzero()[0]
