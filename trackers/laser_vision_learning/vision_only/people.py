"""Whom this tracker follows: a roster of clouds of particles (x, y, vx, vy), and what everybody wears."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.tracking.appearance import Appearance
from trackers.tracking.roster import Roster

_PATIENCE = 5
"""So many looks in a row that resemble another's are not learned from."""


@dataclass(frozen=True, eq=False)
class People(Rows):
    """n tracks, oldest first, tentative ones among them."""

    roster: Roster[Cloud]
    clothes: Appearance

    @classmethod
    def nobody(cls, particles: int, bins: int) -> Self:
        """No tracks, of as many particles and as many bins of colour as others will have."""
        cloud = Cloud.of(np.empty((4, 0, particles)))
        return cls.started(cloud, np.empty((0, bins)), np.empty(0, np.bool_), 0)

    @classmethod
    def started(cls, cloud: Cloud, looks: Float[Array, "n bins"], clear: Bool[Mask, "n"], ns: int) -> Self:
        """Tentative tracks, with a first look where it is `clear`."""
        looks = np.where(clear[:, None], looks, 0.0)
        return cls(Roster.started(cloud, ns), Appearance.started(looks, clear.astype(np.int64)))

    @property
    def positions(self) -> Float[Array, "n 2"]:
        """Where everybody is [m]."""
        cloud = self.roster.state
        return cloud.expectation(cloud.state[:2]).T

    def expected(self, elapsed_s: float) -> tuple[Float[Array, "n 2"], Float[Array, "n 2 2"]]:
        """Mean and covariance of where everybody is after that time at the speed that they have [m, m²]."""
        cloud = self.roster.state
        ahead = cloud.state[:2] + cloud.state[2:] * elapsed_s
        mean = cloud.expectation(ahead)
        off = ahead - mean[..., None]
        return mean.T, np.einsum("inp,jnp,np->nij", off, off, cloud.weights.normalised)

    def learned(
        self, track: Int[Index, "p"], looks: Float[Array, "p bins"], unlike: Float[Array, "n p"], memory: float
    ) -> Self:
        """After clear looks at those at `track`; one that is `unlike` another track less than its own is doubted."""
        if track.size == 0:
            return self
        to_all = np.nan_to_num(unlike, nan=np.inf)
        pairs = track, np.arange(track.size)
        own = np.where(np.isinf(to_all[pairs]), 0.0, to_all[pairs])
        to_all[pairs] = np.inf
        doubtful = to_all.min(axis=0) < own
        return self.changed(clothes=self.clothes.learned(track, looks, doubtful, _PATIENCE, memory))
