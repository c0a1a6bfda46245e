"""A likelihood in stages, cheap ones first: a particle that one stage makes impossible costs the next nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from trackers.arrays import Array, Index
from trackers.filters.particle import LogLikelihood

LikelihoodStage = Callable[[Array, Index], Array]
"""Surviving particles (components, k) and the set each belongs to (k,) → their log-likelihood, (k,); −∞ drops one."""


def cascade(stages: Sequence[LikelihoodStage]) -> LogLikelihood:
    """The sum of the stages' log-likelihoods, each asked only about the particles that those before have left."""

    def log_likelihood(state: Array) -> Array:
        components, n, p = state.shape
        particles, of_set, total = state.reshape(components, n * p), np.repeat(np.arange(n), p), np.zeros(n * p)
        alive = np.arange(n * p)
        for stage in stages:
            if alive.size == 0:
                break
            total = total + stage(particles, of_set)
            left = ~np.isneginf(total)
            if not left.all():
                particles, of_set, total, alive = particles[:, left], of_set[left], total[left], alive[left]
        every = np.full(n * p, -np.inf)
        every[alive] = total
        return every.reshape(n, p)

    return log_likelihood
