"""Particle filter, batched over n particle sets of p particles each: sets are people, runs, hypotheses.

The algorithm is frozen and holds no state; the cloud of particles is an argument and a return value. Two functions define a
filter: the motion of a particle, and the log-likelihood of the measurements given its state. `cascade` evaluates a
log-likelihood in stages, cheap ones first, and drops impossible particles early.

filter = ParticleFilter(resampling="systematic")
    cloud = Cloud.of(state)                                          # (components, n, p)
    cloud = filter.step(cloud, move, log_likelihood, rng)            # move(state, rng), log_likelihood(state) -> (n, p)
    mean = cloud.expectation(cloud.state)                            # (components, n)

One step: resample the sets whose effective sample size has fallen, move, weight. Estimate from the weighted cloud that
`step` returns, before the next resampling adds noise (Arulampalam et al., "A tutorial on particle filters", 2002; the split
into move and likelihood after Chopin and Papaspiliopoulos, "An introduction to sequential Monte Carlo", 2020).

Edge cases: if a measurement is impossible for every particle of a set (log-likelihood −∞ throughout), the set keeps its
weights and is marked in `LogWeights.lost`. A log-likelihood of NaN or +∞, and a particle that is not finite, are refused
with InputError.

A bootstrap filter draws from the motion model alone. Drawing from another density q as well, a proposal given by a detector
or a model of the body, needs a correction: each particle's weight is multiplied by p(x) / q(x), p the motion model's density
given all particles before (Isard and Blake, "ICONDENSATION: unifying low-level and high-level tracking in a stochastic
framework", 1998; Doucet, Godsill and Andrieu, "On sequential Monte Carlo sampling methods", 2000).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trackers.arrays import Array, Bool, Float, Index, Mask
from trackers.errors import InputError
from trackers.filters.resampling import resample, scheme_of
from trackers.filters.rows import Rows, Selection

Move = Callable[[Array, np.random.Generator], Array]
"""State (components, n, p) and generator → state one step later, same shape."""
Propose = Callable[["Cloud", np.random.Generator], tuple[Array, Array | None]]
"""Cloud and generator → state one step later (components, n, p), and the log of each weight's correction, (n, p) or none."""
LogLikelihood = Callable[[Array], Array]
"""State (components, n, p) → log-likelihood of the measurement at each particle, (n, p), up to a constant per set."""


@dataclass(frozen=True, eq=False)
class LogWeights(Rows):
    """Weights of n sets of p particles as normalised logarithms, which no small likelihood underflows.

    Made by `uniform`, `of` and `updated`; every row is a distribution.
    """

    log: Float[Array, "n p"]  # ≤ 0, −∞ for a weight of 0; exp of a row sums to 1
    normalised: Float[Array, "n p"]  # exp(log)
    log_mean: Float[Array, "n"]  # log of the weighted mean of the last likelihood: its evidence; 0 before any
    lost: Bool[Mask, "n"]  # whether the last measurement was impossible for every particle of the set

    @classmethod
    def uniform(cls, n: int, n_particle: int) -> LogWeights:
        """Return equal weights for n sets. Raises InputError without a particle."""
        if n_particle < 1:
            raise InputError(f"a cloud of {n_particle} particles; at least 1 is expected")
        return cls._equal(n, n_particle)

    @classmethod
    def of(cls, log: Array) -> LogWeights:
        """Normalize log-weights (n, p); −∞ is a weight of 0.

        A set with only weights 0 gets equal weights and is marked `lost`. Raises InputError for NaN, +∞ or no particle.
        """
        log = np.asarray(log, float)
        if log.ndim != 2:
            raise InputError(f"log-weights of shape {log.shape}; (sets, particles) is expected")
        return cls.uniform(*log.shape).updated(log)

    def __len__(self) -> int:
        return len(self.log)

    @property
    def effective_sample_size(self) -> Float[Array, "n"]:
        """1 / Σ w² of each set: from 1, all weight on one particle, to p, equal weights (Kong et al., 1994)."""
        return 1.0 / np.einsum("np,np->n", self.normalised, self.normalised)

    def updated(self, log_likelihood: Array) -> LogWeights:
        """Multiply the weights by exp of `log_likelihood` (n, p) and normalise them.

        A set without any weight left keeps its old weights and is marked `lost`; its evidence is −∞. Raises InputError for
        NaN, +∞ or another shape.
        """
        log_likelihood = np.asarray(log_likelihood, float)
        if log_likelihood.shape != self.log.shape:
            raise InputError(f"log-likelihood of shape {log_likelihood.shape}; {self.log.shape} is expected")
        if not (log_likelihood < np.inf).all():  # NaN compares False
            raise InputError(
                "a log-likelihood is NaN or +infinity; finite numbers, or -infinity for impossible, are expected"
            )
        with np.errstate(over="ignore"):  # a logarithm below the least number becomes −∞: a weight of 0
            log = self.log + log_likelihood
            top = log.max(axis=1)
            lost = np.isneginf(top)
            log -= np.where(lost, 0.0, top)[:, None]
        weight = np.exp(log)
        total = np.where(lost, 1.0, weight.sum(axis=1))
        log_total = np.log(total)
        weight /= total[:, None]
        log -= log_total[:, None]
        log_mean = np.where(lost, -np.inf, top + log_total)
        if lost.any():
            weight[lost], log[lost] = self.normalised[lost], self.log[lost]
        return LogWeights(log, weight, log_mean, lost)

    def resampled(self, which: Bool[Mask, "n"]) -> LogWeights:
        """Set the weights of the masked sets equal, as after resampling."""
        equal = self._equal(*self.log.shape)
        chosen = which[:, None]
        return LogWeights(
            np.where(chosen, equal.log, self.log),
            np.where(chosen, equal.normalised, self.normalised),
            self.log_mean,
            self.lost,
        )

    @classmethod
    def _equal(cls, n: int, n_particle: int) -> LogWeights:
        return cls(
            np.full((n, n_particle), -np.log(n_particle)),
            np.full((n, n_particle), 1.0 / n_particle),
            np.zeros(n),
            np.zeros(n, bool),
        )


@dataclass(frozen=True, eq=False)
class Cloud:
    """n sets of p weighted particles."""

    state: Float[Array, "components n p"]  # components first, as `trackers.filters.motion.propagate` takes them
    weights: LogWeights

    @classmethod
    def of(cls, state: Array) -> Cloud:
        """Return particles (components, n, p) of equal weight. Raises InputError for another number of axes and for NaN or
        infinity.
        """
        state = np.asarray(state, float)
        if state.ndim != 3:
            raise InputError(f"particles of shape {state.shape}; (components, sets, particles) is expected")
        _check_finite(state)
        return cls(state, LogWeights.uniform(*state.shape[1:]))

    @classmethod
    def normal(
        cls, mean: Float[Array, "n c"], covariance: Float[Array, "n c c"], n_particle: int, rng: np.random.Generator
    ) -> Cloud:
        """Draw particles from normal distributions, whose covariance may be singular.

        Raises InputError for a covariance that is not symmetric positive semi-definite, and for NaN or infinity.
        """
        mean, covariance = np.asarray(mean, float), np.asarray(covariance, float)
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise InputError("the start of a cloud of particles holds NaN or infinity; finite numbers are expected")
        if not np.allclose(covariance, covariance.swapaxes(-1, -2)):
            raise InputError("the covariance of a cloud of particles is not symmetric")
        variance, axes = np.linalg.eigh(covariance)
        if (variance < -1e-9 * np.abs(variance).max(axis=-1, keepdims=True)).any():
            raise InputError("the covariance of a cloud of particles has a negative variance; at least 0 is expected")
        root = axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :]  # rounding may leave values slightly below 0
        drawn = np.einsum("nij,jnp->inp", root, rng.standard_normal((mean.shape[1], len(mean), n_particle)))
        return cls.of(drawn + mean.T[:, :, None])

    def __len__(self) -> int:
        return self.state.shape[1]

    def select(self, index: Selection) -> Cloud:
        """Return the sets at `index`."""
        return Cloud(self.state[:, index], self.weights.select(index))

    def joined(self, other: Cloud) -> Cloud:
        """Concatenate these sets and `other`, with the same number of particles."""
        return Cloud(np.concatenate([self.state, other.state], axis=1), self.weights.joined(other.weights))

    def replaced(self, index: Selection, other: Cloud) -> Cloud:
        """Replace the sets at `index` by `other`."""
        state = self.state.copy()
        state[:, index] = other.state
        return Cloud(state, self.weights.replaced(index, other.weights))

    def expectation(self, values: Float[Array, "*c n p"]) -> Float[Array, "*c n"]:
        """Return the weighted mean over each set of values per particle."""
        return np.einsum("...np,np->...n", values, self.weights.normalised)


@dataclass(frozen=True)
class ParticleFilter:
    """Bootstrap particle filter: the motion model moves particles, the measurement weights them.

    resampling: a name of `trackers.filters.resampling.SCHEMES`; threshold: greatest effective sample size, as a share of the
    particles, at which a set is resampled: 1 whenever its weights differ, 0 never. Raises InputError for other values.
    """

    resampling: str = "systematic"
    threshold: float = 0.5

    def __post_init__(self) -> None:
        scheme_of(self.resampling)
        if not 0 <= self.threshold <= 1:
            raise InputError(f"resampling threshold {self.threshold}; a share of the particles from 0 to 1 is expected")

    def step(self, cloud: Cloud, move: Move, log_likelihood: LogLikelihood | None, rng: np.random.Generator) -> Cloud:
        """Resample where due, move, weight; without a measurement (`log_likelihood` None) only the first two.

        A set that is not measured among others that are is coasted by log-likelihoods of 0.
        """
        return self.step_proposed(cloud, lambda before, rng: (move(before.state, rng), None), log_likelihood, rng)

    def step_proposed(
        self,
        cloud: Cloud,
        propose: Propose,
        log_likelihood: LogLikelihood | None,
        rng: np.random.Generator,
    ) -> Cloud:
        """Step with particles drawn from a proposal that corrects their weights, such as `MixtureProposal`."""
        cloud = self.resampled(cloud, rng)
        state, correction = propose(cloud, rng)
        if state.shape != cloud.state.shape:
            raise ValueError(f"move made {state.shape} of particles of shape {cloud.state.shape}")
        _check_finite(state)
        weights = cloud.weights if correction is None else cloud.weights.updated(correction)
        if log_likelihood is not None:
            weights = weights.updated(log_likelihood(state))
        return Cloud(state, weights)

    def resampled(self, cloud: Cloud, rng: np.random.Generator) -> Cloud:
        """Resample the sets whose effective sample size has fallen to the threshold."""
        share = cloud.weights.effective_sample_size / cloud.state.shape[2]
        # equal weights (a share of 1 up to rounding) gain nothing from another draw
        due = (share <= self.threshold) & (share < 1 - 1e-9)
        if not due.any():
            return cloud
        components, n, p = cloud.state.shape
        ancestors = np.arange(n * p).reshape(n, p)  # of all sets, one after the other
        ancestors[due] = ancestors[due, :1] + resample(self.resampling, cloud.weights.normalised[due], rng)
        state = cloud.state.reshape(components, n * p).take(ancestors, axis=1)
        return Cloud(state, cloud.weights.resampled(due))


def _check_finite(state: Array) -> None:
    if not np.isfinite(state).all():
        raise InputError("a particle holds NaN or infinity; finite numbers are expected")


LikelihoodStage = Callable[[Array, Index], Array]
"""Surviving particles (components, k) and the set of each (k,) → their log-likelihood, (k,); −∞ drops one."""


def cascade(stages: Sequence[LikelihoodStage]) -> LogLikelihood:
    """Sum the stages' log-likelihoods; evaluate each stage only for the particles still possible after earlier ones."""

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


Draw = Callable[[int, np.random.Generator], Array]
"""Number of particles per set, and generator → that many fresh particles of each set, (components, n, p)."""
LogDensity = Callable[[Array], Array]
"""Positions (components, n, p) → log-density there, (n, p)."""
TransitionDensity = Callable[[Array, Array], Array]
"""Positions (components, n, p, 1) and particles before (components, n, 1, q) → log-density of the step, (n, p, q)."""


@dataclass(frozen=True)
class MixtureProposal:
    """A share of each set's particles is drawn afresh, the rest moves on from the particles before.

    share: of particles from `draw` (α). log_draw: the log-density of `draw`; log_transition: that of `move`. With both,
    weights are corrected by p / (α g + (1 − α) p). Without, fresh particles weigh as if moved there, as in Mori et al.
    Raises InputError for a share outside 0 to 1, and for one density without the other.
    """

    share: float
    move: Move
    draw: Draw
    log_draw: LogDensity | None = None
    log_transition: TransitionDensity | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"share of fresh particles {self.share}; a number from 0 to 1 is expected")
        if (self.log_draw is None) != (self.log_transition is None):
            raise InputError("a mixture proposal has one density of two; both, or none, are expected")

    def __call__(
        self, cloud: Cloud, rng: np.random.Generator
    ) -> tuple[Float[Array, "components n p"], Float[Array, "n p"]]:
        """Return the particles and the logarithms of their weight corrections, fresh ones first."""
        n_particle = cloud.state.shape[2]
        n_fresh = round(self.share * n_particle)
        moved = self.move(cloud.state, rng)
        state = np.concatenate([self.draw(n_fresh, rng), moved[..., n_fresh:]], axis=2) if n_fresh else moved
        if self.log_draw is None or self.log_transition is None or n_fresh == 0:
            return state, np.zeros(state.shape[1:])
        each = self.log_transition(state[..., None], cloud.state[:, :, None, :]) + cloud.weights.log[:, None, :]
        log_p = np.logaddexp.reduce(each, axis=-1)
        share = n_fresh / n_particle
        with np.errstate(divide="ignore"):  # with a share of 1 no particle comes from the motion model
            log_q = np.logaddexp(np.log(share) + self.log_draw(state), np.log1p(-share) + log_p)
        return state, log_p - log_q
