"""How a picture weighs the particles of people: of those whom the detector found, and of those whom it did not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from trackers.arrays import Array, Mask
from trackers.filters.gating import distances
from trackers.laser_vision_learning.vision_only.options import ParticleOptions


@dataclass(frozen=True, eq=False)
class AtDetections:
    """n detected people: particles are weighed by N(x; z, R) and a floor, and fresh ones drawn from it."""

    position: Float[Array, "n 2"]  # z [m]
    covariance: Float[Array, "n 2 2"]  # R [m²]
    velocities: Float[Array, "2 n p"]  # that the people's particles had [m/s]; fresh ones keep them
    outlier: float

    def draw(self, count: int, rng: np.random.Generator) -> Float[Array, "4 n count"]:
        """Particles about the detections."""
        noise = rng.standard_normal((2, len(self.position), count))
        off = np.einsum("nij,jnp->inp", np.linalg.cholesky(self.covariance), noise)
        return np.concatenate([self.position.T[:, :, None] + off, self.velocities[:, :, :count]])

    def log_likelihood(self, state: Float[Array, "4 n p"]) -> Float[Array, "n p"]:
        """log(exp(−½ (x − z)ᵀ R⁻¹ (x − z)) + outlier)."""
        off = state[:2] - self.position.T[:, :, None]
        square = np.einsum("inp,nij,jnp->np", off, np.linalg.inv(self.covariance), off)
        return np.log(np.exp(-0.5 * square) + self.outlier)


@dataclass(frozen=True, eq=False)
class WithoutDetection:
    """n people whom the detector has no peak for: weighed by its scores where nobody detected claims them, and by colours.

    Only scores near detected people are theirs, by 1 − exp(−d² / 2 c²) at a distance of d; a particle with colours at a
    Bhattacharyya distance of D from its person's counts by exp(−λ D²) (Pérez et al., 2002).
    """

    scores: Callable[[Array], Array]  # positions (2, n, p) → (n, p)
    looks: Callable[[Array], tuple[Array, Mask]]  # places (k, 2) → colours (k, bins), and whether they are seen, (k,)
    taken: Float[Array, "k 2"]  # where detected people are [m]
    reference: Float[Array, "n bins"]
    known: Bool[Mask, "n"]  # whose colours are
    options: ParticleOptions

    def log_likelihood(self, state: Float[Array, "4 n p"]) -> Float[Array, "n p"]:
        """log(score · unclaimed · exp(−λ D²) + outlier)."""
        _, n, p = state.shape
        places = state[:2].reshape(2, n * p).T
        nearest_m = distances(places, self.taken).min(axis=1, initial=np.inf).reshape(n, p)
        unclaimed = 1 - np.exp(-0.5 * (nearest_m / self.options.claimed_m) ** 2)
        looks, seen = self.looks(places)
        alike = np.einsum("nb,npb->np", np.sqrt(self.reference), np.sqrt(looks).reshape(n, p, -1))
        square = np.where(seen.reshape(n, p) & self.known[:, None], np.maximum(1 - alike, 0.0), 1.0)
        likelihood = np.clip(self.scores(state[:2]), 0, 1) * unclaimed * np.exp(-self.options.colour_sharpness * square)
        return np.log(likelihood + self.options.outlier)
