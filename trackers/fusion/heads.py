"""Heads: a Gaussian each over place and velocity, weighed at points by every picture; and the direction that each faces.

A picture's likelihood of a head's place is no Gaussian, so the density is taken at fixed points z of the unit Gaussian,
x = m + L z, weighed, and made Gaussian again by its sums (J. Kotecha and P. Djurić, "Gaussian particle filtering", IEEE Trans.
Signal Processing 51, 2003). The points are those of an additive recurrence with irrational steps, so that nothing is random.
Directions are a density over a whole turn: colours of face and hair weigh it, and people who walk face ahead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.area import Area
from trackers.arrays import Array, Index, Mask
from trackers.cameras.placed import PlacedCamera
from trackers.filters.gating import distances
from trackers.filters.rows import Rows, written
from trackers.fusion.options import HeadEvidenceOptions
from trackers.likelihood.stereo_head import StereoHeadOptions, StereoHeads
from trackers.tracking.roster import NEVER_NS
from trackers.vision.head_colours import HeadColours, HeadModel
from trackers.vision.head_outlines import ASPECTS
from trackers.vision.stereo_picture import PackedPicture

_DIRECTIONS = (np.arange(ASPECTS[0]) + 0.5) * (2 * np.pi / ASPECTS[0])
_UPRIGHT_M, _UPRIGHT_SIGMA_M = 1.55, 0.17
"""Height of the middle of a head that nobody has seen yet [m]."""
_FAR_M, _LOWEST_M, _SAME_M = 0.4, 0.2, 0.18
"""Largest offset of a head from an upright body, lowest head, and distance within which two heads are one [m]."""
_LEAST_SIGMA_M = 0.012
"""No picture tells a place better than this [m]."""
_KNOWS_NOTHING = 0.1
"""Information of a place from which on a picture tells something of it [1/m²]."""
_OUTSIDE = 20.0
"""Log-likelihood that a head outside the area loses."""
_LEAST_SHOWN = 0.4
"""Share of foreground in an ellipse times that of background over it, from which a head is seen."""
_TURNS_RAD2_S = 0.6
"""Variance by which a direction spreads in a second [rad²/s]."""
_AHEAD, _WALKS_M_S = 4.0, 0.4
"""Concentration about the way, per second, of the direction that people face who walk faster than this [m/s]."""
_SURE = 0.6
"""Mean resultant length of a direction from which colours are learned at it."""


@dataclass(frozen=True, eq=False)
class Heads(Rows):
    """Heads of n people."""

    mean: Float[Array, "n 6"]  # place and velocity [m, m/s]
    covariance: Float[Array, "n 6 6"]
    facing: Float[Array, "n directions"]
    seen_ns: Int[Index, "n"]
    colours: HeadColours

    @classmethod
    def over(cls, place: Float[Array, "n 2"]) -> Self:
        """Make heads that nobody has seen, over people's places [m]."""
        n = len(place)
        mean = np.zeros((n, 6))
        mean[:, :2], mean[:, 2] = place, _UPRIGHT_M
        sigma = np.array([0.12, 0.12, _UPRIGHT_SIGMA_M, 0.7, 0.7, 0.2])
        facing = np.full((n, ASPECTS[0]), 1 / ASPECTS[0])
        covariance = np.tile(np.diag(sigma**2), (n, 1, 1))
        return cls(mean, covariance, facing, np.full(n, NEVER_NS), HeadColours.unknown(n))

    @property
    def direction(self) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        """Mean direction [rad] and its resultant length, 0 where it is not known."""
        resultant = self.facing @ np.exp(1j * _DIRECTIONS)
        return np.angle(resultant), np.abs(resultant)

    def predicted(self, dt: float, velocity: Float[Array, "n 2"], options: HeadEvidenceOptions) -> Self:
        """Return the heads `dt` later [s]; velocity: of the bodies [m/s], the way of which walkers face."""
        F, acceleration = np.eye(6), options.acceleration_m_s2**2
        F[:3, 3:] = dt * np.eye(3)
        Q = np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * 0.1 * acceleration, np.eye(3))
        spread = np.fft.rfft(_turned(_TURNS_RAD2_S * dt))
        facing = np.maximum(np.fft.irfft(np.fft.rfft(self.facing, axis=1) * spread, ASPECTS[0], axis=1), 1e-12)
        speed = np.hypot(*velocity.T)
        ahead = np.cos(_DIRECTIONS - np.arctan2(velocity[:, 1], velocity[:, 0])[:, None])
        facing = facing * np.exp(_AHEAD * dt * np.where(speed > _WALKS_M_S, 1.0, 0.0)[:, None] * ahead)
        return self.changed(
            mean=self.mean @ F.T,
            covariance=F @ self.covariance @ F.T + Q,
            facing=facing / facing.sum(axis=1, keepdims=True),
        )

    def measured(self, row: Int[Index, "k"], place: Float[Array, "k d"], variance_m2: Float[Array, "k d"]) -> Self:
        """Update the heads at `row` by the first d coordinates of their places [m], each with a variance: a Kalman filter."""
        d = place.shape[1]
        P = self.covariance[row]
        S = P[:, :d, :d] + variance_m2[:, :, None] * np.eye(d)
        gain = P[:, :, :d] @ np.linalg.inv(S)
        mean = self.mean[row] + np.einsum("nab,nb->na", gain, place - self.mean[row, :d])
        covariance = P - gain @ S @ gain.transpose(0, 2, 1)
        return self.changed(mean=written(self.mean, row, mean), covariance=written(self.covariance, row, covariance))

    def again_over(self, place: Float[Array, "n 2"]) -> Heads:
        """Return the heads, those that have strayed from their bodies at these places [m] as nobody has seen them."""
        off_m = np.hypot(*(self.mean[:, :2] - place).T)
        strayed = np.flatnonzero(
            (off_m > _FAR_M + np.maximum(_UPRIGHT_M - self.mean[:, 2], 0)) | (self.mean[:, 2] < _LOWEST_M)
        )
        return Heads.replaced(self, strayed, Heads.over(place[strayed])) if strayed.size else self

    @property
    def own(self) -> Bool[Mask, "n"]:
        """The heads that are in no older one."""
        return ~np.logical_or.reduce(np.tril(distances(self.mean[:, :2], self.mean[:, :2]) < _SAME_M, -1), axis=1)

    def at(self, place: Float[Array, "n 3"]) -> Float[Array, "4 1 n"]:
        """Return heads at places as pictures are asked about them, with their directions."""
        return np.concatenate([place.T, self.direction[0][None]])[:, None]


class HeadWeighing:
    """Weighs heads by the pictures of one camera. area: where people are (None: everywhere)."""

    def __init__(self, camera: PlacedCamera, model: HeadModel, options: HeadEvidenceOptions, area: Area | None) -> None:
        self._area = area
        self._common = model.common
        self._heads = StereoHeads([camera], model, StereoHeadOptions())
        self._z = unit_points(options.samples)

    def updated(
        self, heads: Heads, row: Int[Index, "k"], picture: PackedPicture, share: Float[Array, "k"], ns: int
    ) -> tuple[Heads, Bool[Mask, "k"]]:
        """Update the heads at `row` by a picture; return them, and which of those it shows. share: of a look's evidence."""
        if not row.size:
            return heads, np.empty(0, np.bool_)
        prior = heads.select(row)
        root = np.linalg.cholesky(prior.covariance[:, :3, :3] + 1e-10 * np.eye(3)).astype(np.float64)
        places = prior.mean[:, None, :3] + self._z @ root.transpose(0, 2, 1)  # (k, p, 3)
        asked = np.concatenate(
            [places.transpose(2, 0, 1), np.tile(prior.direction[0][:, None], (1, len(self._z)))[None]]
        )
        found = self._heads.log_likelihood([picture], asked[:, None].astype(np.float32), None)[0]
        log = (found.colour + found.depth).reshape(len(row), -1).astype(float) * share[:, None]
        if self._area is not None:
            log[~self._area.contains(places[..., :2].reshape(-1, 2)).reshape(log.shape)] -= _OUTSIDE
        weight = np.exp(log - log.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        shown = (weight * found.p_detect.reshape(weight.shape)).sum(axis=1) >= _LEAST_SHOWN
        shown &= found.seen.reshape(weight.shape).all(axis=1)
        posterior = _regressed(prior, root, self._z, weight)
        heads = heads.replaced(row[shown], posterior.select(shown))
        heads = heads.changed(seen_ns=written(heads.seen_ns, row[shown], ns))
        return self._faced(heads, row[shown], picture, share[shown]), shown

    def _faced(self, heads: Heads, row: Int[Index, "k"], picture: PackedPicture, share: Float[Array, "k"]) -> Heads:
        """Weigh the directions of heads that a picture shows, and learn the colours of those whose is known."""
        if not row.size:
            return heads
        seen = heads.select(row)
        at = seen.at(seen.mean[:, :3])
        log = self._heads.facing([picture], at, seen.colours.expected(self._common).tables)[0] * share[:, None]
        facing = seen.facing * np.exp(log - log.max(axis=1, keepdims=True))
        seen = seen.changed(facing=facing / facing.sum(axis=1, keepdims=True))
        length = seen.direction[1]
        sure = np.flatnonzero(length > _SURE)
        if sure.size:
            person, step, colour = self._heads.colours_on([picture], seen.at(seen.mean[:, :3])[..., sure])
            seen = seen.changed(colours=seen.colours.learned(sure[person], step, colour, self._common))
        return heads.replaced(row, seen)


def _regressed(prior: Heads, root: Float[Array, "k 3 3"], z: Float[Array, "p 3"], weight: Float[Array, "k p"]) -> Heads:
    """Return heads with the mean and the covariance of the weighed points, velocities by their covariance with places."""
    mean = weight @ z
    second = np.einsum("kp,pa,pb->kab", weight, z, z) - mean[:, :, None] * mean[:, None, :]
    gain = np.linalg.solve(root, prior.covariance[:, :3]).transpose(0, 2, 1)  # P Hᵀ L⁻ᵀ
    covariance = prior.covariance + gain @ (second - np.eye(3)) @ gain.transpose(0, 2, 1)
    covariance[:, [0, 1, 2], [0, 1, 2]] += _LEAST_SIGMA_M**2 / 4
    return prior.changed(mean=prior.mean + np.einsum("kab,kb->ka", gain, mean), covariance=covariance)


def gained(before: Heads, after: Heads) -> tuple[Float[Array, "k 2"], Float[Array, "k 2 2"]]:
    """Return what pictures alone told of the ground points of heads: places [m] and covariances, large where they told nothing.

    The information of a likelihood is that of the posterior less that of the prior, so that nothing is counted twice.
    """
    P, prior = (np.linalg.inv(each.covariance[:, :2, :2]) for each in (after, before))
    values, axes = np.linalg.eigh(P - prior)
    variance = 1 / np.maximum(values, _KNOWS_NOTHING)
    covariance = np.einsum("kab,kb,kcb->kac", axes, variance, axes)
    moved = np.einsum("kab,kb->ka", P, after.mean[:, :2] - before.mean[:, :2])
    informative = np.where(values > _KNOWS_NOTHING, variance, 0.0)
    return before.mean[:, :2] + np.einsum("kab,kb,kcb,kc->ka", axes, informative, axes, moved), covariance


@lru_cache(maxsize=4)
def unit_points(count: int) -> Float[Array, "p 3"]:
    """Spread points over the unit Gaussian evenly, with mean 0 and covariance 1.

    An additive recurrence with the powers of the root of x⁴ = x + 1 (M. Roberts, "The unreasonable effectiveness of quasirandom
    sequences", 2018), through the inverse of the normal distribution.
    """
    from scipy.special import ndtri

    golden = 1.2207440846057596
    uniform = (0.5 + np.arange(1, count + 1)[:, None] * golden ** -np.arange(1.0, 4.0)) % 1.0
    z = ndtri(uniform)
    z -= z.mean(axis=0)
    z = z @ np.linalg.inv(np.linalg.cholesky(z.T @ z / count)).T
    z.setflags(write=False)
    return z


def _turned(variance: float) -> Float[Array, "directions"]:
    """Return the density of a turn of this variance [rad²] over the steps of a whole turn, from 0 on."""
    angle = np.minimum(_DIRECTIONS - _DIRECTIONS[0], 2 * np.pi - (_DIRECTIONS - _DIRECTIONS[0]))
    density = np.exp(-0.5 * angle**2 / max(variance, 1e-5))
    return density / density.sum()
