"""Resampling schemes by name: from weights to the particles that live on, batched over n particle sets.

Each scheme takes weights (n, p), rows that sum to 1, and a Generator, and returns the ancestors (n, p): for each place in
the new set the index of the particle that fills it. Every scheme is unbiased: particle i is drawn p·wᵢ times on average.
A particle of weight 0 is never drawn. They differ in the variance they add (Douc, Cappé and Moulines, "Comparison of
resampling schemes for particle filtering", 2005):

    plain        p independent draws (multinomial, "simple random resampling"); more variance
    systematic   one draw from each of p equal slices of the cumulative weight, with one offset shared by all slices:
                 ⌊p·wᵢ⌋ or ⌈p·wᵢ⌉ copies; one random number a set
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from trackers.arrays import Array, Float, Index, Int
from trackers.errors import InputError, valid_names

Scheme = Callable[[Array, np.random.Generator], Index]


def resample(scheme: str, weights: Array, rng: np.random.Generator) -> Int[Index, "n p"]:
    """Draw ancestors by the scheme of this name for weights (n, p) that are ≥ 0 and sum to 1 in each row.

    Raises InputError for a name that is not in `SCHEMES`, and for weights that are negative, not finite, or do not sum to 1
    within 1e-6 (such as all-zero weights, which `LogWeights` never holds).
    """
    chosen = scheme_of(scheme)
    weights = np.asarray(weights, float)
    if weights.ndim != 2 or weights.shape[1] == 0:
        raise InputError(f"resampling weights of shape {weights.shape}; (sets, particles) with a particle is expected")
    if not (np.isfinite(weights).all() and (weights >= 0).all() and (abs(weights.sum(axis=1) - 1) < 1e-6).all()):
        raise InputError(
            "resampling weights hold a row that is no distribution; numbers ≥ 0 that sum to 1 are expected"
        )
    return chosen(weights / weights.sum(axis=1, keepdims=True), rng)


def scheme_of(name: str) -> Scheme:
    """Return the scheme of this name. Raises InputError naming the valid ones."""
    if name not in SCHEMES:
        raise InputError(f"there is no resampling scheme {name!r}; {valid_names(name, SCHEMES)}")
    return SCHEMES[name]


def _plain(weights: Float[Array, "n p"], rng: np.random.Generator) -> Int[Index, "n p"]:
    return _inverse(_cumulative(weights), rng.random(weights.shape))


def _systematic(weights: Float[Array, "n p"], rng: np.random.Generator) -> Int[Index, "n p"]:
    offset = rng.random((len(weights), 1))
    p = weights.shape[1]
    cumulative = _cumulative(weights)
    # where rounding could lose the last place, nothing is rounded
    below = np.where(cumulative == 1, p, np.ceil(p * cumulative - offset)).astype(np.intp)
    counts = np.diff(below, axis=1, prepend=0)
    return np.repeat(np.broadcast_to(np.arange(p), counts.shape).ravel(), counts.ravel()).reshape(counts.shape)


SCHEMES: Mapping[str, Scheme] = MappingProxyType({"systematic": _systematic, "plain": _plain})
"""The schemes by name."""


def _cumulative(weights: Float[Array, "n p"]) -> Float[Array, "n p"]:
    """Compute running sums of the rows, the last exactly 1, equal where a weight is 0."""
    sums = np.cumsum(weights, axis=1)
    return sums / sums[:, -1:]


def _inverse(cumulative: Float[Array, "n p"], uniform: Float[Array, "n p"]) -> Int[Index, "n p"]:
    """Find the particle whose share of the cumulative weight contains each number in [0, 1)."""
    n, p = cumulative.shape
    rows = np.arange(n)[:, None]
    # one sorted table for all rows; a number must not be rounded up into the next row
    sought = np.minimum(rows + uniform, np.nextafter(rows + 1.0, 0.0))
    found = np.searchsorted((rows + cumulative).ravel(), sought.ravel(), side="right").reshape(n, p)
    return found - p * rows
