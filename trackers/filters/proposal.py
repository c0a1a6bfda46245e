"""Proposals: distributions from which particles are drawn, and their weight corrections.

A bootstrap filter draws from the motion model alone. Drawing from another density q as well, given by a detector or a model
of the body, needs a correction: each particle's weight is multiplied by p(x) / q(x), p the motion model's density given all
particles before (Isard and Blake, "ICONDENSATION: unifying low-level and high-level tracking in a stochastic framework",
1998; Doucet, Godsill and Andrieu, "On sequential Monte Carlo sampling methods", 2000).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.errors import InputError
from trackers.filters.particle import Cloud, Move

Draw = Callable[[int, np.random.Generator], Array]
"""Number of particles per set, and generator → that many fresh particles of each set, (components, n, p)."""
LogDensity = Callable[[Array], Array]
"""Positions (components, n, p) → log-density there, (n, p)."""
TransitionDensity = Callable[[Array, Array], Array]
"""Positions (components, n, p, 1) and particles before (components, n, 1, q) → log-density of the step, (n, p, q)."""


@dataclass(frozen=True)
class MixtureProposal:
    """A share of each set's particles is drawn afresh, the rest moves on from the particles before.

    share: of particles from `draw` (α). log_draw: the log-density of `draw`; log_transition: that of `move`. With both,
    weights are corrected by p / (α g + (1 − α) p). Without, fresh particles weigh as if moved there, as in Mori et al.
    Raises InputError for a share outside 0 to 1, and for one density without the other.
    """

    share: float
    move: Move
    draw: Draw
    log_draw: LogDensity | None = None
    log_transition: TransitionDensity | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"share of fresh particles {self.share}; a number from 0 to 1 is expected")
        if (self.log_draw is None) != (self.log_transition is None):
            raise InputError("a mixture proposal has one density of two; both, or none, are expected")

    def __call__(
        self, cloud: Cloud, rng: np.random.Generator
    ) -> tuple[Float[Array, "components n p"], Float[Array, "n p"]]:
        """Return the particles and the logarithms of their weight corrections, fresh ones first."""
        n_particle = cloud.state.shape[2]
        n_fresh = round(self.share * n_particle)
        moved = self.move(cloud.state, rng)
        state = np.concatenate([self.draw(n_fresh, rng), moved[..., n_fresh:]], axis=2) if n_fresh else moved
        if self.log_draw is None or self.log_transition is None or n_fresh == 0:
            return state, np.zeros(state.shape[1:])
        each = self.log_transition(state[..., None], cloud.state[:, :, None, :]) + cloud.weights.log[:, None, :]
        log_p = np.logaddexp.reduce(each, axis=-1)
        share = n_fresh / n_particle
        with np.errstate(divide="ignore"):  # with a share of 1 no particle comes from the motion model
            log_q = np.logaddexp(np.log(share) + self.log_draw(state), np.log1p(-share) + log_p)
        return state, log_p - log_q
