"""State of every track: particles, roster entry, serial number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float, Int

from trackers.arrays import Array, Index
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows, written
from trackers.laser_vision_learning.walking import HEADING, SPEED
from trackers.tracking.roster import Roster


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, oldest first."""

    serial: Int[Index, "n"]  # number in the order of starts; unlike identities it never changes
    roster: Roster[Cloud]
    missing_s: Float[
        Array, "n"
    ]  # time in which they should have been detected and were not, less that of detections since
    pictured_ns: Int[Index, "n"]  # stamp of the last moment at which a camera's detection measured them, −1 before any

    @classmethod
    def started(cls, state: Cloud, ns: int, first: int) -> Self:
        """Make tentative tracks in `state`, first measured at stamp ns, numbered from `first` on."""
        n = len(state)
        return cls(first + np.arange(n), Roster.started(state, ns), np.zeros(n), np.full(n, -1))

    @property
    def cloud(self) -> Cloud:
        """Particles of all tracks."""
        return self.roster.state

    @property
    def places(self) -> Float[Array, "n 2"]:
        """Mean positions [m]."""
        return self.cloud.expectation(self.cloud.state[:2]).T

    @property
    def velocities(self) -> Float[Array, "n 2"]:
        """Mean velocities [m/s]."""
        heading, speed = self.cloud.state[[HEADING, SPEED]].astype(np.float32)
        return self.cloud.expectation(np.stack([speed * np.cos(heading), speed * np.sin(heading)])).T

    def continued_as(self, track: Int[Index, "p"], other: Int[Index, "p"]) -> Self:
        """Return the tracks with those at `track` moved to the states of those at `other`, which have turned out to be the
        same.
        """
        roster, source = self.roster, self.roster.select(other)
        roster = roster.changed(
            state=roster.state.replaced(track, source.state),
            measured_ns=written(roster.measured_ns, track, source.measured_ns),
        )
        return self.changed(roster=roster, missing_s=written(self.missing_s, track, self.missing_s[other]))
