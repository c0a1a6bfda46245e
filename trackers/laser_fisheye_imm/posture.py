"""Posture by the legs: sitting people, who may lie down below the scans (ours).

The legs of an upright person are under the trunk, those of a sitting one half a metre before it. People get up before
leaving a seat. So a sitting person who is no longer detected, where an upright one would be, is lying there below the scans:
the pelvis stays at the seat, and trunk and legs reappear within a body's length of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Bool, Float, Int
from pydantic import Field

from trackers.arrays import Array, Index, Mask
from trackers.configuration import Strict
from trackers.filters.rows import Rows, written

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
class Posture(Rows):
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
        return np.hypot(*(place - self.seat).T) < options.length_m  # NaN compares False

    def measured(
        self, track: Int[Index, "p"], trunk: Float[Array, "p 2"], legs: Float[Array, "p 2"], options: PostureOptions
    ) -> Self:
        """Return the postures after measurements of those at `track`; legs: their middle [m], NaN if not detected with the
        trunk.
        """
        low = written(self.low, track, 0.0)
        both = ~np.isnan(legs[:, 0])
        if options.seated_m is None or not both.any():
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
