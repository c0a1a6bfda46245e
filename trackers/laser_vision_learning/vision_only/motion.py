"""How the particles of people move: position and velocity, the velocity driven by white noise.

Over a time T the velocity changes by w ~ N(0, q T) on each axis and the position by v T + w T / 2 + u, u ~ N(0, q T³ / 12):
white acceleration of spectral density q, exactly (Bar-Shalom, Li and Kirubarajan, "Estimation with applications to tracking
and navigation", 2001, section 6.2.2), so that pictures may come at any rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array


@dataclass(frozen=True)
class WhiteAcceleration:
    """Moves particles (x, y, vx, vy) [m, m/s] over `elapsed_s`; `kept` (n,) of each person's velocity is kept."""

    elapsed_s: float
    density: float  # q [m²/s³]
    kept: Float[Array, "n"]

    def __call__(self, state: Float[Array, "4 n p"], rng: np.random.Generator) -> Float[Array, "4 n p"]:
        """The particles after that time."""
        T = self.elapsed_s
        w, u = rng.standard_normal((2, 2, *state.shape[1:]))
        velocity = state[2:] * self.kept[:, None]
        kick = np.sqrt(self.density * T) * w
        position = state[:2] + (velocity + kick / 2) * T + np.sqrt(self.density * T**3 / 12) * u
        return np.concatenate([position, velocity + kick])
