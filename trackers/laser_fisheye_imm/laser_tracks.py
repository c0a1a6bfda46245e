"""Tracks of this system: a roster of IMM states, appearance, and measured positions; and posture by the legs (ours).

The legs of an upright person are under the trunk, those of a sitting one half a metre before it. People get up before
leaving a seat. So a sitting person who is no longer detected, where an upright one would be, is lying there below the scans:
the pelvis stays at the seat, and trunk and legs reappear within a body's length of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from trackers.arrays import Array, Bool, Float, Index, Int, Mask
from trackers.configuration import Strict
from trackers.filters.imm import ImmState
from trackers.filters.motion import MEASUREMENT_VARIANCE_M2
from trackers.filters.rows import Rows, written
from trackers.tracking.roster import NEVER_NS, ImmTracks, Roster
from trackers.vision.histogram import Appearance

_MEMORY = 0.7
"""Retained share of the average when legs and trunk are detected together."""


class PostureOptions(Strict):
    """Options of sitting by the legs, and of missed sitting people."""

    seated_m: float | None = Field(
        default=0.3,
        gt=0,
        description="distance on average of the legs' middle from the trunk, from which a person sits [m]; null: nobody does "
        "(ours)",
    )
    length_m: ClassVar[float] = 1.2
    """Distance from the seat within which a sitting or lying person's trunk and legs stay, and no track is initiated [m]."""
    place_m: ClassVar[float] = 0.35
    """Standard deviation of a lying person's trunk from the seat on reappearing [m]."""
    lean_m: ClassVar[float] = 0.07
    """Standard deviation, on each axis, of a sitting person's trunk from the pelvis [m]."""
    lies_down_s: ClassVar[float] = 10.0
    """Mean time for which a person sits before lying down [s]."""
    stays_s: ClassVar[float] = 600.0
    """Mean time for which an undetected person who sits or lies stays, in place of `track_management.survival_s` [s]."""


@dataclass(frozen=True, eq=False)
class LegPosture(Rows):
    """Postures of n people."""

    knees: Float[Array, "n 2"]  # from the trunk to the middle of the legs, on average [m]
    seat: Float[Array, "n 2"]  # last position of the trunk while sitting [m]; NaN: not sitting
    low: Float[Array, "n"]  # probability of being below the scans, given existence

    @classmethod
    def upright(cls, n: int) -> Self:
        """Make postures of n people who have not sat yet."""
        return cls(np.zeros((n, 2)), np.full((n, 2), np.nan), np.zeros(n))

    @property
    def lying(self) -> Bool[Mask, "n"]:
        """Mask of people probably lying below the scans."""
        return self.low > 0.5

    def seated(self, place: Float[Array, "n 2"], options: PostureOptions) -> Bool[Mask, "n"]:
        """Return a mask of people sitting or lying, last measured at these positions [m]."""
        off = place - self.seat
        return np.hypot(off[:, 0], off[:, 1]) < options.length_m  # NaN compares False

    def measured(
        self, track: Int[Index, "p"], trunk: Float[Array, "p 2"], legs: Float[Array, "p 2"], options: PostureOptions
    ) -> Self:
        """Return the postures after measurements of those at `track`; legs: their middle [m], NaN if not detected with the
        trunk.
        """
        low = written(self.low, track, 0.0)
        both = ~np.isnan(legs[:, 0])
        if options.seated_m is None or not np.count_nonzero(both):
            return self.changed(low=low)
        track, trunk = track[both], trunk[both]
        knees = _MEMORY * self.knees[track] + (1 - _MEMORY) * (legs[both] - trunk)
        sits = np.hypot(*knees.T) > options.seated_m
        before = np.where(np.isnan(self.seat[track]), trunk, self.seat[track])
        seat = np.where(sits[:, None], _MEMORY * before + (1 - _MEMORY) * trunk, np.nan)
        return self.changed(knees=written(self.knees, track, knees), seat=written(self.seat, track, seat), low=low)

    def missed(
        self,
        seated: Bool[Mask, "n"],
        chance: Float[Array, "n"],
        free: Bool[Mask, "n"],
        elapsed_s: float,
        options: PostureOptions,
    ) -> tuple[Self, Float[Array, "n"]]:
        """Return the postures, and miss probabilities, after a frame `elapsed_s` after the last one without detections.

        chance: miss probability of upright people; free: people whose seat no other occupies.
        """
        lies_down = -np.expm1(-elapsed_s / options.lies_down_s)
        low = np.where(seated & free, self.low + (1 - self.low) * lies_down, 0.0)
        missed = low + (1 - low) * chance
        return self.changed(low=low / missed), missed


_WALKS_M_S = 0.4
"""Speed above which people walk forwards: below, it is their sway that moves a track, and tells no way [m/s]."""


@dataclass(frozen=True, eq=False)
class LaserTracks(ImmTracks):
    """n tracks, oldest first."""

    serial: Int[Index, "n"]  # ascending; unique, also for tentative tracks
    roster: Roster[ImmState]
    clothes: Appearance
    born_at: Float[Array, "n 2"]  # first measured position [m]
    measured_at: Float[Array, "n 2"]  # last measured position [m]
    variance_m2: Float[Array, "n"]  # of that position, on each axis
    single_ns: Int[Index, "n"]  # stamp of the last measurement by a single leg; before any: `NEVER_NS`
    facing: Float[Array, "n 2"]  # unit vector of the way they walked last; 0 where they have not walked yet
    posture: LegPosture
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
        variance_m2: float | Float[Array, "n"] = MEASUREMENT_VARIANCE_M2,
    ) -> Self:
        """Make tentative tracks first measured at `position` at stamp ns."""
        clothes = Appearance.started(reference, n_look)
        serial = first_serial + np.arange(len(position))
        n, roster = len(position), Roster.started(state, ns)
        variance, never, facing = np.full(n, variance_m2), np.full(n, NEVER_NS), np.zeros((n, 2))
        return cls(
            serial, roster, clothes, position, position, variance, never, facing, LegPosture.upright(n), np.ones(n)
        )

    def exist(self, above: float) -> Bool[Mask, "n"]:
        """Return a mask of the tracks with a larger existence probability than `above`."""
        return self.existence > above

    def continued(self, old: Int[Index, "p"], new: Int[Index, "p"]) -> Self:
        """Return the tracks with those at `old` continued as those at `new`, which are no tracks of their own any more."""
        before, after = self.select(old), self.select(new)
        roster = after.roster.changed(id=before.roster.id, born_ns=before.roster.born_ns, confirmed=before.confirmed)
        after = after.changed(serial=before.serial, roster=roster, clothes=before.clothes, born_at=before.born_at)
        kept = written(np.ones(len(self), np.bool_), new, False)
        return self.replaced(old, after).select(kept)

    def turned(self, velocity: Float[Array, "2 n"]) -> Self:
        """These tracks, facing the way of their velocity [m/s] where they walk; those who stand face the way they came."""
        speed = np.hypot(velocity[0], velocity[1])
        walks = speed > _WALKS_M_S
        return self.changed(
            facing=np.where(walks[:, None], velocity.T / np.where(walks, speed, 1.0)[:, None], self.facing)
        )

    def measured(
        self,
        track: Int[Index, "p"],
        position: Float[Array, "p 2"],
        variance_m2: Float[Array, "p"],
        ns: int,
        state: ImmState,
        existence: Float[Array, "p"],
    ) -> Self:
        """Return the tracks in `state`, with those at `track` measured at `position` at ns, existing with new probabilities."""
        return self.changed(
            roster=self.roster.measured(track, ns, state),
            measured_at=written(self.measured_at, track, position),
            variance_m2=written(self.variance_m2, track, variance_m2),
            existence=written(self.existence, track, existence),
        )
