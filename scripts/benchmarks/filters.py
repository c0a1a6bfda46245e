"""The batched IMM beside filterpy's, what a track of it costs in larger batches, and a Monte-Carlo figure 7."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator

from benchmarks.figure import Figure
from trackers.filters.imm import Imm, ImmState
from trackers.filters.motion import IMM_MODELS, MotionModel, linearise
from twin.reproduce.laser_fisheye_imm.figure7 import simulate
from twin.reproduce.laser_fisheye_imm.walk import maneuvering_walk

_PERIOD_S = 0.1
_ROUNDS = 7


def imm() -> Iterator[Figure]:
    """CPU time of a step (predict and update) of a track: filterpy's over ours at 50 tracks, and ours from 5 to 500."""
    ours = {n: _step_s(n) for n in (5, 50, 500)}
    for n, seconds in ours.items():
        yield Figure(f"batched IMM: a step of a track, {n} tracks", 1e6 * seconds, "us", "")
    yield Figure("filterpy's IMM over ours, a track of 50", _filterpy_step_s() / ours[50], "x", ">= 30")
    yield Figure("batched IMM: a track of 50 over a track of 5", ours[50] / ours[5], "x", "<= 1")
    yield Figure("batched IMM: a track of 500 over a track of 50", ours[500] / ours[50], "x", "<= 1")


def figure7() -> Iterator[Figure]:
    """CPU time of 100 Monte-Carlo runs of figure 7, the three filters together."""
    walk = maneuvering_walk()
    start = time.process_time()
    simulate(walk, range(100))
    yield Figure("figure 7, 100 Monte-Carlo runs", time.process_time() - start, "s", "<= 20")


def _best_s(call: Callable[[], object], n: int) -> float:
    """Least CPU time of one call, over rounds of n calls: a shared machine only ever adds to it."""
    best = np.inf
    for _ in range(_ROUNDS):
        start = time.process_time()
        for _ in range(n):
            call()
        best = min(best, (time.process_time() - start) / n)
    return float(best)


def _step_s(n: int) -> float:
    """CPU time of a step of one track among n, each measured."""
    rng = np.random.default_rng(0)
    filters, everyone = Imm(), np.arange(n)
    state = filters.start(rng.normal(size=(n, 2)), rng.normal(size=(n, 2)))
    measured = state.positions[:, 0] + rng.normal(0, 0.1, (n, 2))
    return _best_s(lambda: filters.update(filters.predict(state, _PERIOD_S), everyone, measured), 200) / n


class _ModelFilter(ExtendedKalmanFilter):
    """filterpy's extended Kalman filter with one of our motion models."""

    def __init__(self, model: MotionModel, mean: np.ndarray, covariance: np.ndarray, R: np.ndarray) -> None:
        super().__init__(5, 2)
        self.model, self.x, self.P, self.R = model, mean.copy(), covariance.copy(), R

    def predict(self, u: int = 0) -> None:
        self.x, F, G = linearise(self.x, np.zeros(2), _PERIOD_S, float(self.model.turn_persists))
        Q = np.diag([self.model.acceleration_variance, self.model.turn_acceleration_variance])
        self.P = F @ self.P @ F.T + G @ Q @ G.T

    def update(self, z: np.ndarray) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        super().update(z, lambda x: np.eye(2, 5), lambda x: x[:2])


def _filterpy_step_s() -> float:
    """CPU time of a step of filterpy's estimator of one track over the same models."""
    filters = Imm()
    start: ImmState = filters.start(np.zeros((1, 2)), np.ones((1, 2)))
    modes = [
        _ModelFilter(model, start.mean[:, mode, 0], start.covariance[:, :, mode, 0], filters.R)
        for mode, model in enumerate(IMM_MODELS)
    ]
    estimator = IMMEstimator(modes, start.probability[:, 0], filters.transition)

    def step() -> None:
        estimator.predict()
        estimator.update(np.array([0.1, 0.1]))

    return _best_s(step, 50)
