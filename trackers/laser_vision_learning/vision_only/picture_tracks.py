"""Tracks of the vision-only tracker: a roster of clouds of particles (x, y, vx, vy), and the colours of clothes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from trackers.arrays import Array, Bool, Bytes, Float, Index, Int, Mask, UInt8
from trackers.cameras.placed import PlacedCamera
from trackers.filters.gating import distances
from trackers.filters.particle import Cloud
from trackers.filters.rows import Rows
from trackers.laser_vision_learning.vision_only.options import ParticleOptions
from trackers.tracking.roster import Roster
from trackers.vision.histogram import Appearance, ColourHistogram, HistogramOptions
from trackers.vision.person_windows import largest_overlap, person_windows

_PATIENCE = 5
"""Number of consecutive views resembling another track that are not learned."""


@dataclass(frozen=True, eq=False)
class PictureTracks(Rows):
    """n tracks, oldest first, including tentative ones."""

    roster: Roster[Cloud]
    clothes: Appearance

    @classmethod
    def empty(cls, particles: int, bins: int) -> Self:
        """Return no tracks, with these numbers of particles and colour bins."""
        cloud = Cloud.of(np.empty((4, 0, particles)))
        return cls.started(cloud, np.empty((0, bins)), np.empty(0, np.bool_), 0)

    @classmethod
    def started(cls, cloud: Cloud, looks: Float[Array, "n bins"], clear: Bool[Mask, "n"], ns: int) -> Self:
        """Initiate tentative tracks, with a first appearance where it is `clear`."""
        looks = np.where(clear[:, None], looks, 0.0)
        return cls(Roster.started(cloud, ns), Appearance.started(looks, clear.astype(np.int64)))

    @property
    def positions(self) -> Float[Array, "n 2"]:
        """Mean positions [m]."""
        cloud = self.roster.state
        return cloud.expectation(cloud.state[:2]).T

    def expected(self, elapsed_s: float) -> tuple[Float[Array, "n 2"], Float[Array, "n 2 2"]]:
        """Predict mean and covariance of positions after that time at constant velocity [m, m²]."""
        cloud = self.roster.state
        ahead = cloud.state[:2] + cloud.state[2:] * elapsed_s
        mean = cloud.expectation(ahead)
        off = ahead - mean[..., None]
        return mean.T, np.einsum("inp,jnp,np->nij", off, off, cloud.weights.normalised)

    def learned(
        self, track: Int[Index, "p"], looks: Float[Array, "p bins"], unlike: Float[Array, "n p"], memory: float
    ) -> Self:
        """Learn from clear views of the tracks at `track`; a view closer to another track than to its own is doubtful."""
        if track.size == 0:
            return self
        to_all = np.nan_to_num(unlike, nan=np.inf)
        pairs = track, np.arange(track.size)
        own = np.where(np.isinf(to_all[pairs]), 0.0, to_all[pairs])
        to_all[pairs] = np.inf
        doubtful = to_all.min(axis=0) < own
        return self.changed(clothes=self.clothes.learned(track, looks, doubtful, _PATIENCE, memory))


_ROWS, _COLUMNS = 14, 8
_BODY = (slice(None), slice(2, 12), slice(2, 6))
"""Cells of a window with shirt (the upper half) and trousers, without arms and background."""
_HALF = (5, 4)
_LEAST_SEEN = 0.25
"""Least share of foreground among the samples of each half."""


class ColourReader:
    """Colours of people in the pictures of one camera: `size` numbers per person that sum to 1."""

    def __init__(self, camera: PlacedCamera, options: HistogramOptions) -> None:
        self._camera, self._histogram = camera, ColourHistogram(options)
        self.size = 2 * self._histogram.size

    def looks(
        self, rgb: UInt8[Bytes, "h w 3"], mask: Mask, places_m: Float[Array, "k 2"]
    ) -> tuple[Float[Array, "k bins"], Bool[Mask, "k"], Float[Array, "k"]]:
        """Return colours at positions [m], whether enough is visible, and the share of each window that another covers."""
        windows = person_windows(self._camera, places_m, _ROWS, _COLUMNS)
        shown, k = windows.inside.copy(), len(places_m)
        at = np.rint(windows.pixels[shown]).astype(np.intp)
        shown[shown] = mask[at[:, 1], at[:, 0]]
        pixels, inside = windows.pixels[_BODY].reshape(2 * k, *_HALF, 2), shown[_BODY].reshape(2 * k, *_HALF)
        colours = self._histogram.of_windows(rgb, pixels, inside).reshape(k, self.size)
        known = (inside.mean(axis=(1, 2)) >= _LEAST_SEEN).reshape(k, 2).all(axis=1)
        return 0.5 * colours, known, largest_overlap(windows.pixels[:, :, 2:6])


@dataclass(frozen=True)
class WhiteAcceleration:
    """Motion of particles (x, y, vx, vy) [m, m/s] over `elapsed_s`; `kept` (n,) of each person's velocity is kept.

    Over a time T the velocity changes by w ~ N(0, q T) on each axis and the position by v T + w T / 2 + u,
    u ~ N(0, q T³ / 12): white acceleration of spectral density q, exactly (Bar-Shalom, Li and Kirubarajan, "Estimation with
    applications to tracking and navigation", 2001, section 6.2.2), so that pictures may come at any rate.
    """

    elapsed_s: float
    density: float  # q [m²/s³]
    kept: Float[Array, "n"]

    def __call__(self, state: Float[Array, "4 n p"], rng: np.random.Generator) -> Float[Array, "4 n p"]:
        """Return the particles after that time."""
        T = self.elapsed_s
        w, u = rng.standard_normal((2, 2, *state.shape[1:]))
        velocity = state[2:] * self.kept[:, None]
        kick = np.sqrt(self.density * T) * w
        position = state[:2] + (velocity + kick / 2) * T + np.sqrt(self.density * T**3 / 12) * u
        return np.concatenate([position, velocity + kick])


@dataclass(frozen=True, eq=False)
class AtDetections:
    """Likelihood of n detected people: N(x; z, R) plus a floor; fresh particles are drawn from it."""

    position: Float[Array, "n 2"]  # z [m]
    covariance: Float[Array, "n 2 2"]  # R [m²]
    velocities: Float[Array, "2 n p"]  # of the people's particles [m/s]; fresh ones keep them
    outlier: float

    def draw(self, count: int, rng: np.random.Generator) -> Float[Array, "4 n count"]:
        """Draw particles about the detections."""
        noise = rng.standard_normal((2, len(self.position), count))
        off = np.einsum("nij,jnp->inp", np.linalg.cholesky(self.covariance), noise)
        return np.concatenate([self.position.T[:, :, None] + off, self.velocities[:, :, :count]])

    def log_likelihood(self, state: Float[Array, "4 n p"]) -> Float[Array, "n p"]:
        """Return log(exp(−½ (x − z)ᵀ R⁻¹ (x − z)) + outlier)."""
        off = state[:2] - self.position.T[:, :, None]
        square = np.einsum("inp,nij,jnp->np", off, np.linalg.inv(self.covariance), off)
        return np.log(np.exp(-0.5 * square) + self.outlier)


@dataclass(frozen=True, eq=False)
class WithoutDetection:
    """Likelihood of n people without a detection: by the detector's scores outside detections, and by colours.

    Scores near detected people are theirs, reduced by 1 − exp(−d² / 2 c²) at a distance of d; a particle with colours at a
    Bhattacharyya distance of D from its person's is weighted by exp(−λ D²) (Pérez et al., 2002).
    """

    scores: Callable[[Array], Array]  # positions (2, n, p) → (n, p)
    looks: Callable[[Array], tuple[Array, Mask]]  # positions (k, 2) → colours (k, bins), and whether visible, (k,)
    taken: Float[Array, "k 2"]  # positions of detected people [m]
    reference: Float[Array, "n bins"]
    known: Bool[Mask, "n"]  # people with known colours
    options: ParticleOptions

    def log_likelihood(self, state: Float[Array, "4 n p"]) -> Float[Array, "n p"]:
        """Return log(score · unclaimed · exp(−λ D²) + outlier)."""
        _, n, p = state.shape
        places = state[:2].reshape(2, n * p).T
        nearest_m = distances(places, self.taken).min(axis=1, initial=np.inf).reshape(n, p)
        unclaimed = 1 - np.exp(-0.5 * (nearest_m / self.options.claimed_m) ** 2)
        looks, seen = self.looks(places)
        alike = np.einsum("nb,npb->np", np.sqrt(self.reference), np.sqrt(looks).reshape(n, p, -1))
        square = np.where(seen.reshape(n, p) & self.known[:, None], np.maximum(1 - alike, 0.0), 1.0)
        likelihood = np.clip(self.scores(state[:2]), 0, 1) * unclaimed * np.exp(-self.options.colour_sharpness * square)
        return np.log(likelihood + self.options.outlier)
