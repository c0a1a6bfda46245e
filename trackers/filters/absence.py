"""What it says of a target that a sensor did not see it: it is likelier where it could not be seen.

The density is multiplied by the probability of a miss, p(x | not seen) ∝ p(x) (1 − P_D(x)), and made Gaussian again by its
moments (W. Koch, "On exploiting 'negative' sensor evidence for target tracking and sensor data fusion", Information Fusion
8, 2007). P_D depends on the position only; the rest of the state follows by its covariance with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from trackers.arrays import Array
from trackers.filters.imm_state import ImmState
from trackers.filters.particle import Cloud

_STEPS = np.linspace(-2.4, 2.4, 9)
_Z = np.stack(np.meshgrid(_STEPS, _STEPS)).reshape(2, -1)  # (2, k) places, in standard deviations
_DENSITY = np.exp(-0.5 * (_Z**2).sum(axis=0))
_DENSITY /= _DENSITY.sum()
_PRODUCTS = np.stack([_Z[0] * _Z[0], _Z[0] * _Z[1], _Z[1] * _Z[1]])
_PRODUCTS /= _DENSITY @ _PRODUCTS[0]  # the grid ends where the density does not
_MOMENTS = np.concatenate([np.ones((1, _Z.shape[1])), _Z, _PRODUCTS]).T  # (k, 6)
_NOTHING_TOLD = np.array([0.0, 0, 1, 0, 1])[:, None, None]
_LEAST_VARIANCE_M2 = 1e-12


def not_seen(
    state: ImmState, missed: Callable[[Array], Array], least: float = 1e-3
) -> tuple[ImmState, Float[Array, "n"]]:
    """The n tracks after a look that did not show them, and how probably it would not.

    missed: the probability that the look does not show a target at positions (2, m, n, k) [m], (m, n, k). A mode that it
    would have shown (all but surely, to `least`) stays as it is: then it is the model that is wrong.
    """
    P = state.covariance  # (s, s, m, n)
    points, l_xx, l_yx, l_yy = _places(state)
    moments = ((_DENSITY * missed(points)) @ _MOMENTS).transpose(2, 0, 1)  # (6, m, n)
    chance = moments[0]
    possible = chance > least
    mean_x, mean_y, xx, xy, yy = np.where(possible, moments[1:] / np.where(possible, chance, 1.0), _NOTHING_TOLD)
    chance = np.where(possible, chance, least)
    xy = xy - mean_x * mean_y
    change = np.array([[xx - mean_x**2 - 1, xy], [xy, yy - mean_y**2 - 1]])
    # what a standard deviation of position does to the state: P Hᵀ L⁻ᵀ
    by_x = P[0] / l_xx
    by_y = (P[1] - l_yx * by_x) / l_yy
    gain = np.stack([by_x, by_y])  # (2, s, m, n)
    covariance = P + np.einsum("pamn,pqmn,qbmn->abmn", gain, change, gain)
    covariance = 0.5 * (covariance + covariance.swapaxes(0, 1))
    joint = state.probability * chance
    missed_all = joint.sum(axis=0)
    return ImmState(state.mean + by_x * mean_x + by_y * mean_y, covariance, joint / missed_all), missed_all


def chance_unseen(state: ImmState, missed: Callable[[Array], Array]) -> Float[Array, "n"]:
    """How probably a look does not show the n tracks, over all the places where they may be; missed: as of `not_seen`."""
    points, *_ = _places(state)
    return (state.probability * (missed(points) @ _DENSITY)).sum(axis=0)


def _places(
    state: ImmState,
) -> tuple[Float[Array, "2 m n k"], Float[Array, "m n"], Float[Array, "m n"], Float[Array, "m n"]]:
    """Places that stand for each mode's density, and the root L of the position's covariance, L Lᵀ = H P Hᵀ [m]."""
    P = state.covariance
    l_xx = np.sqrt(np.maximum(P[0, 0], _LEAST_VARIANCE_M2))
    l_yx = P[0, 1] / l_xx
    l_yy = np.sqrt(np.maximum(P[1, 1] - l_yx**2, _LEAST_VARIANCE_M2))
    x = state.mean[0, ..., None] + l_xx[..., None] * _Z[0]
    y = state.mean[1, ..., None] + l_yx[..., None] * _Z[0] + l_yy[..., None] * _Z[1]
    return np.stack([x, y]), l_xx, l_yx, l_yy


def existence_unseen(
    existence: Float[Array, "n"], missed: Float[Array, "n"], elapsed_s: float, survival_s: Float[Array, "n"] | float
) -> Float[Array, "n"]:
    """How probably the n tracks still are somebody, after a look that did not show them.

    existence: before the look, `elapsed_s` ago; missed: how probably the look would not show them, as by `not_seen`. Who is
    not seen stays on average for `survival_s`. With e' = e exp(−Δt / survival_s) it is e' m / (1 − e' + e' m) (D. Mušicki,
    R. Evans and S. Stanković, "Integrated probabilistic data association", IEEE Trans. Automatic Control 39, 1994).
    """
    there = existence * np.exp(-elapsed_s / survival_s)
    unseen = there * missed
    return unseen / (1 - there + unseen)


def existence_measured(existence: Float[Array, "n"], likelihood_ratio: Float[Array, "n"]) -> Float[Array, "n"]:
    """How probably the n tracks still are somebody, after a measurement taken for theirs.

    likelihood_ratio: its density if it is theirs, over that of whatever else it may be. With e before it, it is
    e L / (1 − e + e L) (Mušicki et al., as above, with one measurement in the gate).
    """
    theirs = existence * likelihood_ratio
    return theirs / (1 - existence + theirs)


def cloud_not_seen(cloud: Cloud, missed: Callable[[Array], Array]) -> tuple[Cloud, Float[Array, "n"]]:
    """The n sets of particles after a look that did not show their targets, and how probably it would not.

    missed: the probability that the look does not show a target at positions (2, n, p) [m], the first two components of the
    state, (n, p). A set of which it would have shown every particle keeps its weights, and is marked `lost`.
    """
    chance = missed(cloud.state[:2])
    with np.errstate(divide="ignore"):  # a particle in full view has no weight left
        weights = cloud.weights.updated(np.log(chance))
    return Cloud(cloud.state, weights), np.exp(weights.log_mean)
