"""The people that `fusion` follows: body, head, existence, posture, and what tells them from others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm import ImmState
from trackers.filters.rows import written
from trackers.fusion.heads import Heads
from trackers.fusion.look import Expected
from trackers.tracking.appearance import Appearance
from trackers.tracking.roster import NEVER_NS, ImmTracks, Roster

_USUAL_STATURE_M = 1.7
_CROWN_M = 0.12
"""Height of the crown above the middle of a head [m]."""

LENGTH_M = 1.2
"""Trunk and legs of a person who sits or lies are this near to the place [m]."""
_SEATED_M, _KNEES_MEMORY = 0.3, 0.7
"""Distance of the legs from the trunk, on average, from which a person sits [m]; share of the old average that is kept."""

_SLOW_M_S = 0.4
"""A person who sits is slower [m/s]."""


@dataclass(frozen=True, eq=False)
class People(ImmTracks):
    """n tracks, oldest first."""

    serial: Int[Index, "n"]  # one of its own, tentative or not
    roster: Roster[ImmState]
    heads: Heads
    clothes: Appearance
    stature_m: Float[Array, "n"]  # NaN: not known
    load_n: Float[Array, "n"]  # on a pressure floor, NaN: not known
    place: Float[Array, "n 2"]  # after the last measurement [m]
    offset_m2: Float[Array, "n"]  # variance of what stays of the errors, on each axis
    existence: Float[Array, "n"]
    low: Float[Array, "n"]  # how probably they sit or lie, lower than trunks are looked for
    knees: Float[Array, "n 2"]  # from the place to the middle of the legs, on average [m]
    seat: Float[Array, "n 2"]  # where they sit [m], NaN: they do not
    doubled_s: Float[Array, "n"]  # for how long they have been where an older track is [s]
    seen_ns: Int[Index, "n s"]  # by each source, the stamp of the last measurement
    seen_at: Float[Array, "n s 2"]  # and its place [m]

    @classmethod
    def started(
        cls, state: ImmState, place: Float[Array, "n 2"], ns: int, n_colour: int, n_source: int, first_serial: int
    ) -> Self:
        """Make tentative tracks measured at places [m] at stamp ns."""
        n = len(place)
        return cls(
            serial=first_serial + np.arange(n),
            roster=Roster.started(state, ns),
            heads=Heads.over(place),
            clothes=Appearance.started(np.zeros((n, n_colour)), np.zeros(n, np.int64)),
            stature_m=np.full(n, np.nan),
            load_n=np.full(n, np.nan),
            place=place,
            offset_m2=np.zeros(n),
            existence=np.full(n, 0.5),
            low=np.zeros(n),
            knees=np.zeros((n, 2)),
            seat=np.full((n, 2), np.nan),
            doubled_s=np.zeros(n),
            seen_ns=np.full((n, n_source), NEVER_NS),
            seen_at=np.full((n, n_source, 2), np.nan),
        )

    @property
    def velocity(self) -> Float[Array, "n 2"]:
        """Each track's velocity over its modes [m/s]."""
        return (self.state.mean[2:] * self.state.probability).sum(axis=1).T

    @property
    def stature(self) -> Float[Array, "n"]:
        """Statures [m], the usual one where it is not known."""
        return np.where(np.isnan(self.stature_m), _USUAL_STATURE_M, self.stature_m)

    @property
    def seated(self) -> Bool[Mask, "n"]:
        """The people who sit, or have lain down where they sat."""
        return ~np.isnan(self.seat[:, 0])

    @property
    def seated_knees(self) -> Float[Array, "n 2"]:
        """Offsets of the legs of people who sit or are sitting down [m]; 0 of walkers, whose legs swing about them."""
        before = self.seated | (np.hypot(*self.knees.T) > _SEATED_M / 2)
        return np.where(before[:, None], self.knees, 0.0)

    @property
    def at_rest(self) -> Bool[Mask, "n"]:
        """The people who sit or lie: those whose legs are far from the trunk while they walk are shown wrongly."""
        return (self.seated & (np.hypot(*self.velocity.T) < _SLOW_M_S)) | (self.low > 0.5)

    def upright(self) -> Self:
        """Return the tracks as if nobody had sat down."""
        return self.changed(knees=np.zeros_like(self.knees), seat=np.full_like(self.seat, np.nan))

    def learn_knees(self, row: Int[Index, "k"], legs: Float[Array, "k 2"], both: Bool[Mask, "k"]) -> Self:
        """Learn where the legs of people at `row` are from the trunk [m]; only where both are seen may they have sat down."""
        knees = self.knees.copy()
        knees[row] = _KNEES_MEMORY * knees[row] + (1 - _KNEES_MEMORY) * legs
        sits = np.hypot(*knees[row].T) > _SEATED_M
        sits &= both | self.seated[row]
        before = np.where(self.seated[row, None], self.seat[row], self.positions[row])
        now = _KNEES_MEMORY * before + (1 - _KNEES_MEMORY) * self.positions[row]
        return self.changed(knees=knees, seat=written(self.seat, row, np.where(sits[:, None], now, np.nan)))

    def stood_up(self, row: Int[Index, "k"], place: Float[Array, "k 2"]) -> Self:
        """Return the tracks, those at `row` upright that are measured out of the reach of their seats [m]."""
        up = row[np.hypot(*(place - self.seat[row]).T) > LENGTH_M]
        return (
            self.changed(knees=written(self.knees, up, 0.0), seat=written(self.seat, up, np.nan)) if up.size else self
        )

    def expected(self) -> Expected:
        """Return what sources are told of the tracks."""
        return Expected(self.positions, self.heads.mean[:, :3], self.confirmed, self.seated_knees, self.low > 0.5)

    def learn_stature(self, row: Int[Index, "k"], memory: float) -> Self:
        """Learn the statures of people at `row`, whose heads are seen: the highest that they hold them, slowly forgotten."""
        crown = self.heads.mean[row, 2] + _CROWN_M
        old = self.stature_m[row]
        learned = np.where(crown > old, memory * old + (1 - memory) * crown, 0.995 * old + 0.005 * crown)
        stature = self.stature_m.copy()
        stature[row] = np.where(np.isnan(old), crown, learned)
        return self.changed(stature_m=stature)
