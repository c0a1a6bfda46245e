"""Association of a look's measurements with tracks, by likelihood ratios against clutter and against not being shown.

A measurement z with covariance R is a track's by e p(z), p the density of its prediction; or clutter's, by its density λ. A track
without a measurement was not shown, by 1 − e + e m (D. Mušicki, R. Evans and S. Stanković, "Integrated probabilistic data
association", IEEE Trans. Automatic Control 39, 1994). One assignment of the greatest product of ratios pairs them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from trackers.arrays import Array, Index, Mask
from trackers.filters.imm import ImmState
from trackers.fusion.look import Look
from trackers.fusion.people import People
from trackers.tracking.roster import Stage, associate

LEAST_EXISTENCE, _LEAST_MISSED, _LEAST_SHOWN = 1e-4, 1e-2, 1e-2
_NEAR_M, _GATE = 0.3, 4.0
"""A measurement nearer than this to a prediction [m], or nearer than so many standard deviations, is never gated off."""

_EXPLAINED = 3.0
"""A measurement nearer to a track than so many standard deviations initiates none."""


def log_density(
    state: ImmState, position: Float[Array, "k 2"], covariance: Float[Array, "k 2 2"]
) -> tuple[Float[Array, "n k"], Float[Array, "n k"]]:
    """Return ln p(z) [ln 1/m²] of measurements about the likeliest mode of each track, and its Mahalanobis distance."""
    P = state.covariance[:2, :2].T[:, :, None]  # (n, m, 1, 2, 2)
    S = P + covariance
    off = position - state.positions[:, :, None]  # (n, m, k, 2)
    s_xx, s_xy, s_yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    determinant = s_xx * s_yy - s_xy**2
    x, y = off[..., 0], off[..., 1]
    square = (s_yy * x * x - 2 * s_xy * x * y + s_xx * y * y) / determinant
    log = -0.5 * (square + np.log(determinant)) - np.log(2 * np.pi)
    return log.max(axis=1), np.sqrt(np.maximum(square.min(axis=1), 0.0))


def pairs(
    people: People, look: Look, missed: Float[Array, "n"], colour: Float[Array, "n k"] | float = 0.0
) -> tuple[Int[Index, "p"], Int[Index, "p"], Float[Array, "p"]]:
    """Pair tracks with measurements; return both, and the log-likelihood ratios against clutter.

    missed: how probably the look would not show each track; colour: log-likelihood ratios of what pictures show of each pair.
    Measurements that a source has shared out itself keep their owners.
    """
    log, away = log_density(people.state, look.position, look.covariance)
    # a scanner that measures a person there sees that place; a silhouette may be of another one on the same line of sight
    shown = people.posture.shown(look.by_posture) if look.is_sharp else 1 - missed
    shown = np.maximum(shown, _LEAST_SHOWN)[:, None]
    ratio = log - np.log(look.kind.clutter_m2) + np.log(shown)
    given = np.flatnonzero(look.owner >= 0)
    owners = look.owner[given]
    near = np.hypot(*(look.position - people.positions[:, None]).transpose(2, 0, 1)) < _NEAR_M
    forbidden = ((away > _GATE) & ~near) | (look.owner >= 0)
    forbidden[owners] = True
    e = np.maximum(people.existence, LEAST_EXISTENCE)
    unpaired = -2 * np.log((1 - e + e * np.maximum(missed, _LEAST_MISSED)) / e)
    every = np.ones(len(people), np.bool_)
    rows, columns = associate([Stage(every, [-2 * (ratio + colour)], [forbidden], unpaired)])
    fits = (away[owners, given] <= _GATE) | near[owners, given]
    rows, columns = np.concatenate([owners[fits], rows]), np.concatenate([given[fits], columns])
    return rows, columns, ratio[rows, columns]


def explained(people: People, look: Look) -> Bool[Mask, "k"]:
    """Mark the measurements that a track explains, though it may have had another one."""
    if not len(people):
        return np.zeros(len(look.position), np.bool_)
    return np.logical_or.reduce(log_density(people.state, look.position, look.covariance)[1] < _EXPLAINED, axis=0)
