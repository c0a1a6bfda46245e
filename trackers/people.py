"""The people a tracker follows, as arrays, and the rules of track management (Bai and Takahashi, section III B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from trackers.configuration import Strict
from trackers.filters.imm_state import ImmState
from trackers.vision.histogram import updated_reference

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


class ManagementOptions(Strict):
    """When a track is believed, and when it is given up."""

    confirm_after_s: float = Field(
        default=0.3,
        ge=0,
        description="where the empty room is known, a tentative track measured for longer, each scan standing for its period, "
        "is a person [s] (ours; the paper: 0.5 s)",
    )
    confirm_learned_after_s: float = Field(
        default=0.5, ge=0, description="the same where the background is learned as it goes [s] (the paper's)"
    )
    confirm_unsure_after_s: float = Field(
        default=1.0,
        ge=0,
        description="the same for whoever may be somebody known who is out of sight: where waists are scanned, who has shown "
        "no trunk; where a camera looks as well, who has shown too little of a shirt where somebody known can have come [s] "
        "(ours)",
    )
    confirm_looks: int = Field(
        default=3, ge=0, description="less than this many clear looks is too little of a shirt (ours)"
    )
    confirm_moved_m: float = Field(
        default=0.15,
        ge=0,
        description="where the background is learned as it goes, only who has come this far from where first measured is a "
        "person: nothing else tells somebody standing from furniture seen now and then [m] (ours)",
    )
    coast_s: float = Field(default=1.5, ge=0, description="a person not measured for this long is gone [s]")
    coast_hidden_s: float = Field(
        default=3.0,
        ge=0,
        description="a person not measured for this long is gone even where nothing in the rig's area would show them; "
        "without an area there is only coast_s [s] (ours)",
    )
    hidden_above: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="one whom the last look would have missed likelier than this counts as out of everybody's sight (ours)",
    )
    coast_slowdown_s: float | None = Field(
        default=0.6,
        gt=0,
        description="a coasting person's speed fades with this time constant; none: it stays [s] (ours)",
    )
    tentative_coast_s: float = Field(
        default=0.15,
        ge=0,
        description="a tentative track not measured for longer was a false alarm [s] (ours: one scan may miss)",
    )
    body_radius_m: float = Field(
        default=0.45,
        ge=0,
        description="nothing new starts this near to a person already tracked or just measured [m] (ours)",
    )
    area_margin_m: float = Field(
        default=0.3, ge=0, description="how far outside the rig's area people are still followed [m]"
    )


@dataclass(frozen=True, eq=False)
class People:
    """n tracks, oldest first; tentative ones among them until they are confirmed."""

    id: NDArray[np.int64]  # (n,) 0 while tentative
    state: ImmState
    born_t: Array  # (n,) [s]
    measured_t: Array  # (n,) last measured [s]
    n_measured: NDArray[np.int64]  # (n,)
    shown_trunk: Mask  # (n,) whether ever by a trunk
    born_at: Array  # (n, 2) first measured position [m]
    measured_at: Array  # (n, 2) last measured position [m]
    confirmed: Mask  # (n,)
    reference: Array  # (n, bins) colour histogram
    n_look: NDArray[np.int64]  # (n,) how often the reference was learned from; 0: there is none
    n_refused: NDArray[np.int64]  # (n,) how many looks in a row it was not learned from, as doubtful
    looked_t: Array  # (n,) when last [s]; when first measured where never
    looked_at: Array  # (n, 2) and where [m]

    def __len__(self) -> int:
        return self.id.size

    @classmethod
    def born(
        cls,
        state: ImmState,
        position: Array,
        t: float,
        by_trunk: Mask,
        reference: Array,
        n_look: NDArray[np.int64],
    ) -> People:
        """Tentative tracks first measured at `position` (n, 2) at time t, some of them by their trunk, (n,)."""
        n = len(state)
        return cls(
            id=np.zeros(n, np.int64),
            state=state,
            born_t=np.full(n, t),
            measured_t=np.full(n, t),
            n_measured=np.ones(n, np.int64),
            shown_trunk=by_trunk,
            born_at=position,
            measured_at=position,
            confirmed=np.zeros(n, np.bool_),
            reference=reference,
            n_look=n_look,
            n_refused=np.zeros(n, np.int64),
            looked_t=np.full(n, t),
            looked_at=position,
        )

    @property
    def positions(self) -> Array:
        """Each track's position over its modes, (n, 2) [m]."""
        return (self.state.mean[:2] * self.state.probability).sum(axis=1).T

    @property
    def has_reference(self) -> Mask:
        """Who has been seen clearly at least once, (n,)."""
        return self.n_look > 0

    def changed(self, **arrays: Any) -> People:
        """These tracks with some of their arrays exchanged."""
        return People(**(vars(self) | arrays))

    def measured(self, track: Index, position: Array, t: float, by_trunk: Mask, state: ImmState) -> People:
        """These tracks in `state`, with those at `track` (p,) measured at `position` (p, 2) at time t, by trunks or legs."""
        measured_t, measured_at = self.measured_t.copy(), self.measured_at.copy()
        n_measured, shown_trunk = self.n_measured.copy(), self.shown_trunk.copy()
        measured_t[track] = t
        measured_at[track] = position
        n_measured[track] += 1
        shown_trunk[track] |= by_trunk
        return self.changed(
            state=state,
            measured_t=measured_t,
            measured_at=measured_at,
            n_measured=n_measured,
            shown_trunk=shown_trunk,
        )

    def looked_upon(
        self, track: Index, histogram: Array, doubtful: Mask, patience: int, memory: float, t: float
    ) -> People:
        """These tracks after clear looks upon those at `track` (p,) at time t, which showed histograms (p, bins).

        A `doubtful` look (p,), which may be of somebody else, teaches nothing; but after `patience` of them in a row it is the
        shirt that looks otherwise now, or the light. memory: the share of the old reference that is kept.
        """
        refused = doubtful & (self.n_refused[track] < patience)
        n_refused = self.n_refused.copy()
        n_refused[track] = np.where(refused, n_refused[track] + 1, 0)
        if refused.any():
            track, histogram = track[~refused], histogram[~refused]
        reference, n_look = self.reference.copy(), self.n_look.copy()
        looked_t, looked_at = self.looked_t.copy(), self.looked_at.copy()
        blended = updated_reference(reference[track], histogram, memory)
        reference[track] = np.where(self.has_reference[track, None], blended, histogram)
        n_look[track] += 1
        looked_t[track] = t
        looked_at[track] = self.measured_at[track]
        return self.changed(
            reference=reference, n_look=n_look, n_refused=n_refused, looked_t=looked_t, looked_at=looked_at
        )

    def merged(self, track: Index, other: Index) -> People:
        """These tracks with those at `track` (p,) gone on as those at `other` (p,), which are no more."""
        arrays = {name: getattr(self, name).copy() for name in ("measured_t", "measured_at", "looked_t", "looked_at")}
        for array in arrays.values():
            array[track] = array[other]
        kept = np.ones(len(self), np.bool_)
        kept[other] = False
        state = self.state.replaced(track, self.state.select(other))
        return self.changed(state=state, **arrays).select(kept)

    def select(self, kept: Mask) -> People:
        """The tracks of a mask (n,)."""
        if kept.all():
            return self
        state = self.state.select(kept)
        return self.changed(state=state, **{name: array[kept] for name, array in self._arrays().items()})

    def joined(self, other: People) -> People:
        """These tracks followed by `other`."""
        if len(other) == 0:
            return self
        others = other._arrays()
        arrays = {name: np.concatenate([array, others[name]]) for name, array in self._arrays().items()}
        return self.changed(state=self.state.joined(other.state), **arrays)

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Everything but the state, a row a track."""
        return {name: value for name, value in vars(self).items() if name != "state"}

    def alive(self, t: float, options: ManagementOptions, hidden: Mask | bool) -> Mask:
        """Which tracks go on: confirmed ones measured within the coasting time, tentative ones measured lately, (n,).

        hidden: who likely could not be seen, (n,).
        """
        # half a microsecond: stamps are decimal, sums of periods are not
        since = t - self.measured_t - 5e-7
        coast_s = np.where(hidden, max(options.coast_s, options.coast_hidden_s), options.coast_s)
        return since <= np.where(self.confirmed, coast_s, options.tentative_coast_s)
