"""Posture by the legs: who sits, and may lie down where no scan looks (ours).

The legs of somebody upright are under the trunk, those of somebody who sits half a metre before it. Nobody leaves from a seat
without getting up first. So whoever sat and is not seen any more, where a scan would show them upright, lies there, lower than
scans look: the pelvis stays where it sat, and trunk and legs come up again within a body's length of it.
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
"""Share of the old average that is kept when legs and trunk are seen together."""


class PostureOptions(Strict):
    """Options of how the legs tell a sitting person, and what becomes of one that no scan shows."""

    seated_m: float | None = Field(
        default=0.3,
        gt=0,
        description="distance on average of the legs' middle from the trunk, from which a person sits [m]; null: nobody does "
        "(ours)",
    )
    length_m: ClassVar[float] = 1.2
    """Distance from the seat within which trunk and legs of a sitting or lying person stay, and no track is initiated [m]."""
    place_m: ClassVar[float] = 0.35
    """Standard deviation of a lying person's trunk from the seat when it comes up again [m]."""
    lean_m: ClassVar[float] = 0.07
    """Standard deviation, on each axis, of a sitting person's trunk from the pelvis [m]."""
    lies_down_s: float = Field(
        default=10.0, gt=0, description="how long a sitting person sits on average before lying down [s] (ours)"
    )
    stays_s: float = Field(
        default=600.0,
        gt=0,
        description="how long a sitting or lying person whom nothing shows stays on average [s], in place of "
        "`track_management.survival_s` (ours)",
    )


@dataclass(frozen=True, eq=False)
class Posture(Rows):
    """Postures of n people."""

    knees: Float[Array, "n 2"]  # from the trunk to the middle of the legs, on average [m]
    seat: Float[Array, "n 2"]  # where the trunk was when they last sat [m]; NaN: they do not
    low: Float[Array, "n"]  # how probably they are lower than scans look, if they are there

    @classmethod
    def upright(cls, n: int) -> Self:
        """Of n people who have not sat yet."""
        return cls(np.zeros((n, 2)), np.full((n, 2), np.nan), np.zeros(n))

    @property
    def lying(self) -> Bool[Mask, "n"]:
        """The people who probably lie, lower than scans look."""
        return self.low > 0.5

    def seated(self, place: Float[Array, "n 2"], options: PostureOptions) -> Bool[Mask, "n"]:
        """Select the people who sit or lie, measured last at these places [m]."""
        return np.hypot(*(place - self.seat).T) < options.length_m  # NaN is not

    def measured(
        self, track: Int[Index, "p"], trunk: Float[Array, "p 2"], legs: Float[Array, "p 2"], options: PostureOptions
    ) -> Self:
        """After those at `track` were measured; legs: the middle of theirs [m], NaN where not seen with the trunk."""
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
        """After a look, `elapsed_s` after the last one, that showed nobody of them, and how probably it would not.

        chance: how probably the look shows nothing of them upright; free: whose seat nobody else is at.
        """
        lies_down = -np.expm1(-elapsed_s / options.lies_down_s)
        low = np.where(seated & free, self.low + (1 - self.low) * lies_down, 0.0)
        missed = low + (1 - low) * chance
        return self.changed(low=low / missed), missed
