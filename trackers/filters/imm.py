"""Interacting multiple model estimator of (extended) Kalman filters, batched over tracks (Bar-Shalom; Bai and Takahashi).

An `Imm` is the immutable algorithm; an `ImmState` holds the arrays of n tracks with m modes each and is passed in and
returned. With one mode it is an extended Kalman filter (`kalman`). A `Motion` moves the modes.

predicted = imm.predict(state, period_s)          # a track that is not measured now coasts on this: nothing more to do
    state = imm.update(predicted, index, positions)   # the tracks `index` measured at `positions`

After `predict` the mode probabilities are the predicted ones, c̄ = μ M: a coasting track keeps them.

Edge cases: a period of 0 changes nothing (no time, no switching); a negative or non-finite period, a non-finite measurement
and a covariance that overflows raise InputError; a singular covariance is allowed, because the measurement noise, which must
be positive definite, keeps every innovation covariance invertible.

Tracks are in the last axis of every array (`ImmState`): operations along them are several times faster than products of many
small matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackers.arrays import Array, Float, Index, Int
from trackers.errors import InputError
from trackers.filters.motion import (
    KALMAN_MODELS,
    MEASUREMENT_VARIANCE_M2,
    HeadingMotion,
    MotionModel,
    VelocityMotion,
    transition_matrix,
)
from trackers.filters.rows import Selection


@dataclass(frozen=True, eq=False)
class ImmState:
    """n tracks with m modes each, in the last axes, so that every operation runs along the tracks."""

    mean: Float[Array, "s m n"]  # position first [m]
    covariance: Float[Array, "s s m n"]
    probability: Float[Array, "m n"]  # each column sums to 1

    def __len__(self) -> int:
        return self.mean.shape[-1]

    @property
    def positions(self) -> Float[Array, "n m 2"]:
        """Position of each track in each mode [m]."""
        return self.mean[:2].T

    @cached_property
    def mean_over_modes(self) -> Float[Array, "s n"]:
        """Mean of each track over its modes, where no component is an angle (`Imm.average`); read-only."""
        mean = (self.mean * self.probability).sum(axis=1)
        mean.flags.writeable = False  # kept with the state
        return mean

    def select(self, index: Selection) -> ImmState:
        """Return the tracks at `index`."""
        if index.dtype == np.bool_:
            index = np.flatnonzero(index)
        # unlike an index, `take` leaves the tracks last in memory too, where every operation on them is several times faster
        return ImmState(*(each.take(index, axis=-1) for each in (self.mean, self.covariance, self.probability)))

    def joined(self, other: ImmState) -> ImmState:
        """Concatenate these tracks and `other`."""
        return ImmState(
            np.concatenate([self.mean, other.mean], axis=-1),
            np.concatenate([self.covariance, other.covariance], axis=-1),
            np.concatenate([self.probability, other.probability], axis=-1),
        )

    def replaced(self, index: Selection, other: ImmState) -> ImmState:
        """Replace the tracks at `index` by `other`."""
        mean, covariance, probability = self.mean.copy(), self.covariance.copy(), self.probability.copy()
        mean[..., index], covariance[..., index], probability[..., index] = (
            other.mean,
            other.covariance,
            other.probability,
        )
        return ImmState(mean, covariance, probability)


_TINY = np.finfo(float).tiny


Motion = HeadingMotion | VelocityMotion
"""Motion of the modes, over a state that starts with the position."""


class Imm:
    """IMM over the state of a motion, measured in (x, y), for any number of modes.

    motion: of the modes (None: the paper's three); transition: (m, m) mode transition probabilities per step, row: from,
    column: to (None: 0.9 to stay, the rest shared evenly); measurement_covariance: R (2, 2) [m²] (None: the paper's). Raises
    InputError for a motion without modes, an invalid transition matrix or an R that is not positive definite.
    """

    def __init__(
        self,
        motion: Motion | None = None,
        transition: Array | None = None,
        measurement_covariance: Array | None = None,
    ) -> None:
        self.motion: Motion = HeadingMotion() if motion is None else motion
        self.n_mode = self.motion.n_mode
        if self.n_mode == 0:
            raise InputError("an IMM needs at least one motion model; none was given")
        self.transition = transition_matrix(self.n_mode) if transition is None else np.asarray(transition, float)
        self.R = (
            np.eye(2) * MEASUREMENT_VARIANCE_M2
            if measurement_covariance is None
            else np.asarray(measurement_covariance, float)
        )
        _check_transition(self.transition, self.n_mode)
        _check_measurement_covariance(self.R)

    def start(
        self,
        position: Float[Array, "n 2"],
        velocity: Float[Array, "n 2"] | None = None,
        position_variance_m2: float | Float[Array, "n"] = MEASUREMENT_VARIANCE_M2,
        speed_variance: float | Float[Array, "n"] = 1.0,
    ) -> ImmState:
        """Start tracks at `position` [m], at rest or with `velocity` [m/s]; `speed_variance` [m²/s²] is that of the speed.

        All modes start equal and equally probable.
        """
        position = np.asarray(position, float).reshape(-1, 2)
        velocity = np.zeros_like(position) if velocity is None else np.asarray(velocity, float).reshape(-1, 2)
        _check_finite(position, "the position of a new track")
        _check_finite(velocity, "the velocity of a new track")
        n = len(position)
        mean, covariance = self.motion.started(position, velocity, position_variance_m2, speed_variance)
        return ImmState(
            np.repeat(mean[:, None], self.n_mode, axis=1),
            np.repeat(covariance[:, :, None], self.n_mode, axis=2),
            np.full((self.n_mode, n), 1 / self.n_mode),
        )

    def predict(self, state: ImmState, period_s: float, share: float = 1.0) -> ImmState:
        """Mix the modes and move each on by one step of `period_s` [s]; the probabilities become the predicted ones (c̄).

        share: of the nominal period of Q and the transition matrix M. Variances grow in proportion, whatever the number of
        steps, and modes change by I + share (M − I), at most M.
        """
        if not (np.isfinite(period_s) and period_s >= 0):
            raise InputError(f"prediction over {period_s!r} s; a finite period of 0 s or more is expected")
        if period_s == 0 or len(state) == 0:
            return state
        mixed = self._mix(state, min(share, 1.0)) if self.n_mode > 1 else state
        mean, covariance = self.motion.moved(mixed.mean, mixed.covariance, period_s, share)
        covariance = _symmetric(covariance)
        _check_finite(mean, "a predicted mean")
        _check_finite(covariance, "a predicted covariance")
        return ImmState(mean, covariance, mixed.probability)

    def predict_over(self, state: ImmState, elapsed_s: float, period_s: float) -> ImmState:
        """Predict over `elapsed_s` in equal steps of about `period_s`, the nominal period of Q and the transition matrix."""
        if not (np.isfinite(elapsed_s) and elapsed_s >= 0):
            raise InputError(f"prediction over {elapsed_s!r} s; a finite time of 0 s or more is expected")
        if len(state) == 0:  # a clock may jump by years without tracks
            return state
        n_step = max(1, round(elapsed_s / period_s))
        for _ in range(n_step):
            state = self.predict(state, elapsed_s / n_step, elapsed_s / n_step / period_s)
        return state

    def update(
        self,
        predicted: ImmState,
        index: Int[Index, "k"],
        position: Float[Array, "k d"],
        measurement_covariance: Float[Array, "k d d"] | None = None,
        observes: Float[Array, "d s"] | None = None,
    ) -> ImmState:
        """Update the tracks at `index` with their measured `position` [m]; leave the others unchanged.

        measurement_covariance: R of each measurement [m²], positive definite; None: the filter's own. observes: H, the measured
        combinations of the state's components; None: its first two.
        """
        index = np.asarray(index, np.intp)
        if index.size == 0:
            return predicted
        position = np.asarray(position, float).reshape(index.size, -1)
        _check_finite(position, "a measured position")
        prior = predicted.select(index)
        P = prior.covariance
        R = self.R[:, :, None] if measurement_covariance is None else measurement_covariance.transpose(1, 2, 0)
        if observes is None:
            expected, HP, HPH = prior.mean[:2], P[:2], P[:2, :2]
        else:
            expected, HP = np.einsum("pa,amn->pmn", observes, prior.mean), np.einsum("pa,abmn->pbmn", observes, P)
            HPH = np.einsum("pbmn,qb->pqmn", HP, observes)
        S = HPH + R[:, :, None]  # (d, d, m, k)
        inverse, determinant = _inverse(S)
        gain = np.einsum("pamn,pqmn->aqmn", HP, inverse)
        innovation = position.T[:, None] - expected  # (d, m, k)
        mean = prior.mean + np.einsum("apmn,pmn->amn", gain, innovation)
        _check_finite(mean, "an updated mean")
        # Joseph's form, (I − KH) P (I − KH)ᵀ + K R Kᵀ = P − K HP − (P Hᵀ − K S) Kᵀ: rounding of K has a second-order
        # effect
        covariance = P - np.einsum("apmn,pbmn->abmn", gain, HP)
        columns = HP.swapaxes(0, 1) - np.einsum("apmn,pqmn->aqmn", gain, S)
        covariance -= np.einsum("apmn,bpmn->abmn", columns, gain)
        _check_finite(covariance, "an updated covariance")
        probability = prior.probability
        if self.n_mode > 1:
            square = np.einsum("pmn,pmn->mn", innovation, np.einsum("pqmn,qmn->pmn", inverse, innovation))
            log_likelihood = -0.5 * (square + np.log(determinant))
            # relative to the best mode, so that a far measurement cannot underflow all modes
            weight = probability * np.exp(log_likelihood - log_likelihood.max(axis=0))
            weight = np.maximum(weight, _TINY)
            probability = weight / weight.sum(axis=0)
        return predicted.replaced(index, ImmState(mean, _symmetric(covariance), probability))

    def average(self, state: ImmState) -> Float[Array, "s n"]:
        """Return the mean of each track over its modes."""
        return (self.motion.aligned(state.mean, state.probability) * state.probability).sum(axis=1)

    def velocity(self, state: ImmState) -> Float[Array, "2 n"]:
        """Return the velocity of each track over its modes [m/s]."""
        return self.motion.velocity(self.average(state))

    def estimate(self, state: ImmState) -> tuple[Float[Array, "n s"], Float[Array, "n s s"]]:
        """Return mean and covariance of each track over its modes."""
        means = self.motion.aligned(state.mean, state.probability)
        mean = (means * state.probability).sum(axis=1)
        spread = means - mean[:, None]
        covariance = ((state.covariance + spread[:, None] * spread) * state.probability).sum(axis=2)
        return mean.T, covariance.T

    def _mix(self, state: ImmState, share: float) -> ImmState:
        """Mix the initial conditions of every mode (eq. 3); return them with the predicted mode probabilities."""
        means = self.motion.aligned(state.mean, state.probability)
        transition = self.transition
        if share != 1:
            transition = share * transition + (1 - share) * np.eye(self.n_mode)
        predicted = transition.T @ state.probability  # (m, n)
        joint = state.probability[:, None] * transition[:, :, None]  # (from, to, n)
        if predicted.min() > 0:
            shares = joint / predicted
        else:  # a mode that cannot be entered (c̄ = 0) is kept unmixed: it has no weight, but must stay finite
            staying = np.broadcast_to(np.eye(self.n_mode)[:, :, None], joint.shape)
            shares = np.where(predicted > 0, joint / np.where(predicted > 0, predicted, 1.0), staying)
        mean = np.einsum("ftn,afn->atn", shares, means)
        covariance = np.einsum("ftn,abfn->abtn", shares, state.covariance)
        spread = means[:, :, None] - mean[:, None]  # (s, from, to, n)
        covariance += np.einsum("aftn,bftn->abtn", spread * shares, spread)
        return ImmState(mean, covariance, predicted)


def _symmetric(matrix: Float[Array, "s s m n"]) -> Float[Array, "s s m n"]:
    return 0.5 * (matrix + matrix.swapaxes(0, 1))


def _inverse(matrix: Float[Array, "d d m n"]) -> tuple[Float[Array, "d d m n"], Float[Array, "m n"]]:
    """Return inverses and determinants of symmetric matrices, those of two rows in closed form."""
    if len(matrix) == 2:
        xx, xy, yy = matrix[0, 0], matrix[0, 1], matrix[1, 1]
        determinant = xx * yy - xy * xy
        return np.array([[yy, -xy], [-xy, xx]]) / determinant, determinant
    each = matrix.transpose(2, 3, 0, 1)
    return np.linalg.inv(each).transpose(2, 3, 0, 1).astype(np.float64), np.linalg.det(each)


def _check_finite(values: Array, what: str) -> None:
    if np.count_nonzero(np.isfinite(values)) < values.size:
        raise InputError(f"{what} holds NaN or infinity; finite numbers are expected")


def _check_transition(transition: Array, n_mode: int) -> None:
    if transition.shape != (n_mode, n_mode):
        raise InputError(f"mode transition matrix of shape {transition.shape}; ({n_mode}, {n_mode}) is expected")
    sums = transition.sum(axis=1)
    if not (np.isfinite(transition).all() and (transition >= 0).all() and np.allclose(sums, 1, atol=1e-9)):
        raise InputError(
            f"mode transition matrix {transition.tolist()}; rows of probabilities that sum to 1 are expected"
        )


def _check_measurement_covariance(R: Array) -> None:
    sound = R.shape == (2, 2) and bool(np.isfinite(R).all()) and bool(np.allclose(R, R.T))
    if not sound or np.linalg.eigvalsh(R).min() <= 0:
        raise InputError(
            f"measurement covariance {R.tolist()}; a symmetric positive definite 2 x 2 matrix [m²] is expected"
        )


def kalman(models: tuple[MotionModel] = KALMAN_MODELS) -> Imm:
    """Make an extended Kalman filter batched over tracks, by default the paper's: model 3 with Q = diag(300, 300)."""
    return Imm(HeadingMotion(models))
