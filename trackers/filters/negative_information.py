"""Negative information: a target not detected by a sensor is likelier where it is not detectable.

The density is multiplied by the probability of a miss, p(x | not seen) ∝ p(x) (1 − P_D(x)), and approximated as a Gaussian
by its moments (W. Koch, "On exploiting 'negative' sensor evidence for target tracking and sensor data fusion", Information
Fusion 8, 2007). P_D depends on the position only; the rest of the state follows by its covariance.

The density is sampled on a grid along and across each target's own motion (`along`), not along the room's x and y, so that
the grid turns with the room.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackers.arrays import Array, Float
from trackers.filters.imm import ImmState
from trackers.filters.particle import Cloud
from trackers.scipy_functions import chdtri, ndtr

_STEPS = np.linspace(-2.4, 2.4, 9)
_Z = np.stack(np.meshgrid(_STEPS, _STEPS)).reshape(2, -1)  # (2, k) places, in standard deviations
_DENSITY = np.exp(-0.5 * (_Z**2).sum(axis=0))
_DENSITY /= _DENSITY.sum()
_PRODUCTS = np.stack([_Z[0] * _Z[0], _Z[0] * _Z[1], _Z[1] * _Z[1]])
_PRODUCTS /= _DENSITY @ _PRODUCTS[0]  # corrects for the density beyond the grid
_MOMENTS = np.concatenate([np.ones((1, _Z.shape[1])), _Z, _PRODUCTS]).T  # (k, 6)
_NO_INFORMATION = np.array([0.0, 0, 1, 0, 1])[:, None, None]
_LEAST_VARIANCE_M2 = 1e-12
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_LEAST = 1e-3
_TAILS = 6.0  # standard deviations beyond which the density is negligible


def update_missed(
    state: ImmState, missed: Callable[[Array], Array], along: Float[Array, "2 n"]
) -> tuple[ImmState, Float[Array, "n"]]:
    """Update n tracks that a scan did not detect; return them and the probability of the miss.

    missed: the miss probability (m, n, k) of a target at positions (2, m, n, k) [m]. A mode whose miss probability is below
    `_LEAST` stays unchanged: then the detection model is wrong. along: the direction of motion of each target, of any length,
    in the room frame.
    """
    P = state.covariance  # (s, s, m, n)
    u, v = _axes(along)
    points, l_uu, l_vu, l_vv = _places(state, u, v)
    sums = ((_DENSITY * missed(points)) @ _MOMENTS).transpose(2, 0, 1)  # (6, m, n)
    chance = sums[0]
    possible = chance > _LEAST
    mean_u, mean_v, uu, uv, vv = np.where(possible, sums[1:] / np.where(possible, chance, 1.0), _NO_INFORMATION)
    chance = np.where(possible, chance, _LEAST)
    uv = uv - mean_u * mean_v
    change = np.array([[uu - mean_u**2 - 1, uv], [uv, vv - mean_v**2 - 1]])
    # effect of a standard deviation of position on the state: P Hᵀ L⁻ᵀ
    by_u = (u[0] * P[0] + u[1] * P[1]) / l_uu
    by_v = (v[0] * P[0] + v[1] * P[1] - l_vu * by_u) / l_vv
    gain = np.array([by_u, by_v])  # (2, s, m, n)
    covariance = P + np.einsum("pamn,pqmn,qbmn->abmn", gain, change, gain)
    covariance = 0.5 * (covariance + covariance.swapaxes(0, 1))
    joint = state.probability * chance
    missed_all = joint.sum(axis=0)
    return ImmState(state.mean + by_u * mean_u + by_v * mean_v, covariance, joint / missed_all), missed_all


def miss_probability(
    state: ImmState, missed: Callable[[Array], Array], along: Float[Array, "2 n"]
) -> Float[Array, "n"]:
    """Return the probability that a frame misses each of n tracks, over their density; arguments: as of `update_missed`."""
    points, *_ = _places(state, *_axes(along))
    return (state.probability * (missed(points) @ _DENSITY)).sum(axis=0)


def _axes(along: Float[Array, "2 n"]) -> tuple[Float[Array, "2 n"], Float[Array, "2 n"]]:
    """Return unit vectors along and across the motion; x and y for a target at rest."""
    length = np.hypot(along[0], along[1])
    u = np.where(length > 0, along, np.array([[1.0], [0.0]])) / np.where(length > 0, length, 1.0)
    return u, np.array([-u[1], u[0]])


def probability_within(
    state: ImmState, centre: Float[Array, "n 2"], radius_m: float, along: Float[Array, "2 n"]
) -> Float[Array, "n"]:
    """Return the probability that the n tracks are within `radius_m` of `centre` [m]; along: as of `update_missed`.

    Along the motion by Gauss and Legendre's rule over the circle, across it by the conditional normal distribution.
    """
    u, v = _axes(along)
    l_uu, l_vu, l_vv = (each[..., None] for each in _root(state, u, v))
    off_x, off_y = state.mean[0] - centre[:, 0], state.mean[1] - centre[:, 1]  # (m, n)
    middle, across_m = (u[0] * off_x + u[1] * off_y)[..., None], (v[0] * off_x + v[1] * off_y)[..., None]
    low, high = np.maximum(middle - _TAILS * l_uu, -radius_m), np.minimum(middle + _TAILS * l_uu, radius_m)
    half = 0.5 * np.maximum(high - low, 0.0)
    at = low + half * (1 + _NODES)
    z, chord = (at - middle) / l_uu, np.sqrt(np.maximum(radius_m**2 - at * at, 0.0))
    across_m = across_m + l_vu * z
    across = ndtr((chord - across_m) / l_vv) - ndtr((-chord - across_m) / l_vv)
    chance = (half / l_uu)[..., 0] * ((np.exp(-0.5 * z * z) * across) @ _WEIGHTS) / np.sqrt(2 * np.pi)
    return (state.probability * chance).sum(axis=0)


def radius_containing(
    state: ImmState, centre: Float[Array, "n 2"], share: float, offset_m2: float | Float[Array, "n"] = 0.0
) -> Float[Array, "n"]:
    """Return the radius about `centre` [m] that holds a `share` of each of n mixture densities.

    offset_m2: variance to add on each axis, of an error common to all measurements of a target (S. F. Schmidt's considered
    bias, which the filter neither estimates nor forgets).

    The squared distance is approximated by a scaled χ² of its mean and variance over the modes (F. E. Satterthwaite, "An
    approximate distribution of estimates of variance components", Biometrics Bulletin 2, 1946): exact for circles and for
    lines.
    """
    off_x, off_y = state.mean[0] - centre[:, 0], state.mean[1] - centre[:, 1]  # (m, n)
    xx, xy, yy = state.covariance[0, 0] + offset_m2, state.covariance[0, 1], state.covariance[1, 1] + offset_m2
    square = xx + yy + off_x**2 + off_y**2
    spread = 2 * (xx**2 + 2 * xy**2 + yy**2) + 4 * (xx * off_x**2 + 2 * xy * off_x * off_y + yy * off_y**2)
    mean = np.maximum((state.probability * square).sum(axis=0), _LEAST_VARIANCE_M2)
    variance = (state.probability * (spread + square**2)).sum(axis=0) - mean**2
    degrees = 2 * mean**2 / np.maximum(variance, _LEAST_VARIANCE_M2**2)
    return np.sqrt(mean / degrees * chdtri(degrees, 1 - share))


def _places(
    state: ImmState, u: Float[Array, "2 n"], v: Float[Array, "2 n"]
) -> tuple[Float[Array, "2 m n k"], Float[Array, "m n"], Float[Array, "m n"], Float[Array, "m n"]]:
    """Return sample positions of each mode's density, and the root of the position's covariance (`_root`)."""
    l_uu, l_vu, l_vv = _root(state, u, v)
    (u_x, u_y), (v_x, v_y) = u[..., None], v[..., None]
    along = l_uu[..., None] * _Z[0]
    across = l_vu[..., None] * _Z[0] + l_vv[..., None] * _Z[1]
    x = state.mean[0, ..., None] + u_x * along + v_x * across
    y = state.mean[1, ..., None] + u_y * along + v_y * across
    return np.array([x, y]), l_uu, l_vu, l_vv


def _root(
    state: ImmState, u: Float[Array, "2 n"], v: Float[Array, "2 n"]
) -> tuple[Float[Array, "m n"], Float[Array, "m n"], Float[Array, "m n"]]:
    """Factor the position covariance over axes u, v [m]: the elements uu, vu, vv of its root L."""
    xx, xy, yy = state.covariance[0, 0], state.covariance[0, 1], state.covariance[1, 1]
    (u_x, u_y), (v_x, v_y) = u, v
    uu = u_x * u_x * xx + 2 * u_x * u_y * xy + u_y * u_y * yy
    vu = u_x * v_x * xx + (u_x * v_y + u_y * v_x) * xy + u_y * v_y * yy
    vv = v_x * v_x * xx + 2 * v_x * v_y * xy + v_y * v_y * yy
    l_uu = np.sqrt(np.maximum(uu, _LEAST_VARIANCE_M2))
    l_vu = vu / l_uu
    return l_uu, l_vu, np.sqrt(np.maximum(vv - l_vu**2, _LEAST_VARIANCE_M2))


LEAVES = 0.2
"""Share of those predicted beyond the area's border who leave there, by a door; the others turn at the wall. Measured in drawn
rooms."""


def existence_after_miss(
    existence: Float[Array, "n"],
    missed: Float[Array, "n"],
    elapsed_s: float,
    survival_s: Float[Array, "n"] | float,
    beyond: Float[Array, "n"] | float = 0.0,
) -> Float[Array, "n"]:
    """Return the probability that n tracks exist in the area, after a frame that missed them.

    existence: before the frame, `elapsed_s` ago; missed: probability m of being in the area and missed, as by `update_missed`;
    survival_s: mean survival without detection; beyond: share b of the density beyond the area's border. With
    e' = e exp(−Δt / survival_s) and b = 0 it is e' m / (1 − e' + e' m) (D. Mušicki, R. Evans and S. Stanković, "Integrated
    probabilistic data association", IEEE Trans. Automatic Control 39, 1994). Of b, `LEAVES` has left, and the rest is
    behind walls, where nobody is.
    """
    there = existence * np.exp(-elapsed_s / survival_s)
    missed_there, left = there * missed, LEAVES * beyond
    return missed_there / ((1 - there) * (1 - beyond + left) + there * left + missed_there)


def existence_after_detection(existence: Float[Array, "n"], likelihood_ratio: Float[Array, "n"]) -> Float[Array, "n"]:
    """Return the probability that n tracks exist, after a measurement assigned to them.

    likelihood_ratio: its density as theirs over that of any other origin. With e before it, it is e L / (1 − e + e L)
    (Mušicki et al., as above, with one measurement in the gate).
    """
    theirs = existence * likelihood_ratio
    return theirs / (1 - existence + theirs)


def update_missed_particles(cloud: Cloud, missed: Callable[[Array], Array]) -> tuple[Cloud, Float[Array, "n"]]:
    """Update n sets of particles whose targets a scan did not detect; return them and the probability of the miss.

    missed: the miss probability (n, p) of a target at positions (2, n, p) [m], the first two components of the state. A set whose
    miss probabilities are all 0 keeps its weights and is marked `lost`.
    """
    chance = missed(cloud.state[:2])
    with np.errstate(divide="ignore"):  # a particle in full view gets weight 0
        weights = cloud.weights.updated(np.log(chance))
    return Cloud(cloud.state, weights), np.exp(weights.log_mean)
