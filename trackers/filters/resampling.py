"""Resampling schemes by name: from weights to the particles that live on, batched over n particle sets.

Each scheme takes weights (n, p), rows that sum to 1, and a Generator, and returns the ancestors (n, p): for each place in
the new set the index of the particle that fills it. Every scheme is unbiased: particle i is drawn p·wᵢ times on average.
A particle of weight 0 is never drawn. They differ in the variance they add (Douc, Cappé and Moulines, "Comparison of
resampling schemes for particle filtering", 2005):

    plain        p independent draws (multinomial, "simple random resampling"); the most variance
    residual     ⌊p·wᵢ⌋ copies for certain, the rest by independent draws from what remains
    stratified   one draw from each of p equal slices of the cumulative weight
    systematic   the same, with one offset shared by all slices: ⌊p·wᵢ⌋ or ⌈p·wᵢ⌉ copies; one random number a set
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


def _residual(weights: Float[Array, "n p"], rng: np.random.Generator) -> Int[Index, "n p"]:
    n, p = weights.shape
    expected = p * weights
    certain = np.floor(expected * (1 + 1e-12))  # 49 · (1/49) is a whole copy, despite rounding
    left = np.maximum(expected - certain, 0.0)
    missing = p - certain.sum(axis=1)  # (n,): number still to be drawn
    # a row without a remainder draws nothing; its weights only keep the sum from being 0
    remainder = np.where(missing[:, None] > 0, left, weights)
    drawn = _inverse(_cumulative(remainder), rng.random(weights.shape))
    needed = np.arange(p) < missing[:, None]
    flat = (drawn + p * np.arange(n)[:, None])[needed]
    counts = certain.astype(np.intp) + np.bincount(flat, minlength=n * p).reshape(n, p)
    return _from_counts(counts)


def _stratified(weights: Float[Array, "n p"], rng: np.random.Generator) -> Int[Index, "n p"]:
    offsets = rng.random(weights.shape)
    places = weights.shape[1] * _cumulative(weights)
    whole = np.floor(places)
    slice_of = np.minimum(whole, weights.shape[1] - 1).astype(np.intp)
    below = whole + (np.take_along_axis(offsets, slice_of, axis=1) < places - whole)
    return _from_places_below(below, weights.shape[1])


def _systematic(weights: Float[Array, "n p"], rng: np.random.Generator) -> Int[Index, "n p"]:
    offset = rng.random((len(weights), 1))
    p = weights.shape[1]
    cumulative = _cumulative(weights)
    # where rounding could lose the last place, nothing is rounded
    return _from_places_below(np.where(cumulative == 1, p, np.ceil(p * cumulative - offset)), p)


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {"systematic": _systematic, "stratified": _stratified, "residual": _residual, "plain": _plain}
)
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


def _from_places_below(below: Float[Array, "n {p}"], p: int) -> Int[Index, "n {p}"]:
    """Return ancestors from the number of places below each running sum."""
    return _from_counts(np.diff(below.astype(np.intp), axis=1, prepend=0))


def _from_counts(counts: Int[Index, "n p"]) -> Int[Index, "n p"]:
    """Return ancestors in ascending order from the counts of each particle, rows that sum to p."""
    n, p = counts.shape
    particle = np.broadcast_to(np.arange(p), (n, p))
    return np.repeat(particle.ravel(), counts.ravel()).reshape(n, p)
