"""Confidence intervals by the percentile bootstrap over runs (Efron and Tibshirani, 1993).

The number of scans at which one curve is below another is not smooth: where curves are close, a replicate's noise decides,
so the interval of a count near all or none is drawn to the middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np

from trackers.arrays import Array

N_REPLICATE = 2000
CONFIDENCE = 0.95
POISSON_ZERO_UPPER = -log((1 - CONFIDENCE) / 2)
"""Upper end of Poisson's exact interval for no event: 3.69 events."""


@dataclass(frozen=True)
class Interval:
    """A value over all runs, and its percentile interval."""

    value: float
    low: float
    high: float


class Bootstrap:
    """Multiplicity of each of n runs in each replicate; row 0 is the original sample.

    All metrics share the draws, so that they are compared run by run.
    """

    def __init__(self, n_run: int, rng: np.random.Generator, n_replicate: int = N_REPLICATE) -> None:
        drawn = rng.multinomial(n_run, np.full(n_run, 1 / n_run), size=n_replicate)
        self.counts: Array = np.concatenate([np.ones((1, n_run)), drawn])  # (1 + replicates, runs)

    def ratio(self, above: Array, below: Array) -> Array:
        """Compute Σ above / Σ below over the runs (n, k) at each scan, in every replicate, (1 + replicates, k)."""
        return (self.counts @ above) / (self.counts @ below)

    def mean(self, values: Array) -> Array:
        """Compute the mean of (n,) values over the runs, in every replicate, (1 + replicates,)."""
        return self.counts @ values / len(values)

    def difference(self, change: Array) -> Interval:
        """Compute the mean of differences of counts (n,), paired by run, with its interval.

        If no run differs, the interval is that of `rate` for no event, on both sides.
        """
        if not change.any():
            return Interval(0.0, -POISSON_ZERO_UPPER / len(change), POISSON_ZERO_UPPER / len(change))
        return interval(self.mean(change))

    def rate(self, counts: Array, exposure: Array) -> Interval:
        """Compute events per exposure, from counts (n,) and exposures (n,) of each run, with its interval.

        Without any event the bootstrap interval has no width; the upper end is then that of Poisson's exact interval,
        `POISSON_ZERO_UPPER` events in all exposure together (Garwood, Biometrika 28, 1936).
        """
        if not counts.any():
            return Interval(0.0, 0.0, POISSON_ZERO_UPPER / float(exposure.sum()))
        return interval(self.ratio(counts[:, None], exposure[:, None])[:, 0])


def interval(values: Array) -> Interval:
    """Compute the interval of (1 + replicates,) values, the first of the original sample."""
    low, high = np.quantile(values[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(values[0]), float(low), float(high))


def band(values: Array) -> tuple[Array, Array, Array]:
    """Compute `interval` at each scan of (1 + replicates, k): the curve and its lower and upper border, (k,) each."""
    low, high = np.quantile(values[1:], [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    return values[0], low, high
