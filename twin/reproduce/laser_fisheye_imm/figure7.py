"""Figure 7 of Bai and Takahashi: position and speed errors of three filters on a maneuvering walk, Monte Carlo.

One person, always detected. Run i measures the walk with noise of seed i, R = diag(0.01, 0.01) m²; all filters get the same
measurements and start. Scans 0 and 1 give the start: the position from the second, the velocity from both, shrunk towards
rest by its uncertainty as in the tracker (a filter over heading and speed cannot find the heading of a person estimated at
rest). Errors count from scan 2 on, the first after a prediction and update.

The speed of the state is signed, and (θ, v) and (θ + π, −v) are one motion: after a stop a filter may follow the person
backwards. The paper does not say how it reads the speed then. We compare the mean magnitude, over particles as over modes of
the IMM, with the true speed; `READINGS` also lists two others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from trackers.arrays import Array
from trackers.filters.imm import Imm, ImmState, kalman
from trackers.filters.motion import HEADING, MEASUREMENT_VARIANCE_M2, SPEED, MotionModel, propagate
from trackers.filters.particle import Cloud, ParticleFilter
from twin.messages import OnProgress, no_progress
from twin.reproduce.laser_fisheye_imm.walk import PERIOD_S, ManeuveringWalk
from twin.reproduce.results import Bootstrap, ResultRow, interval
from twin.streams import stream

FIRST_SCAN = 2
"""The first scan whose errors count."""

START_SPEED_M_S = 1.0
"""Standard deviation of a new person's speed, as in the tracker (ours)."""

N_PARTICLE = 1000
PARTICLE_MODEL = MotionModel(turn_persists=True, acceleration_variance=250.0, turn_acceleration_variance=250.0)
"""Model 3 with the paper's Q = diag(250, 250) for the particle filter."""

IMM, KALMAN, PARTICLE = "IMM", "Kalman filter", "particle filter"
FILTERS = (IMM, KALMAN, PARTICLE)

MEAN_MAGNITUDE, MAGNITUDE_OF_MEAN, MEAN_VELOCITY = "mean of |v|", "|mean of v|", "length of the mean velocity"
READINGS = (MEAN_MAGNITUDE, MAGNITUDE_OF_MEAN, MEAN_VELOCITY)
"""Readings of a speed from modes or particles; all equal for the Kalman filter, which has one mode."""

_BLOCK = 20  # runs at a time: their particles fit the processor's cache, and memory does not grow with the runs


@dataclass(frozen=True, eq=False)
class Estimates:
    """Estimates of a filter in n runs of k scans."""

    position: Array  # (n, k, 2) [m]
    speed: Array  # (n, k, 3) [m/s] ≥ 0, one a reading


@dataclass(frozen=True, eq=False)
class SquaredErrors:
    """Squared errors of a quantity in n runs of k scans, by filter, and of the measurements."""

    by_filter: dict[str, Array]  # name -> (n, k)
    measured: Array  # (n, k)


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Squared errors of all runs at the counted scans: of position [m²] and, by reading, of speed [m²/s²]."""

    seeds: range
    walk: ManeuveringWalk
    scans: NDArray[np.intp]  # (k,)
    position: SquaredErrors
    speed: dict[str, SquaredErrors]


def simulate(walk: ManeuveringWalk, seeds: range, on_progress: OnProgress = no_progress) -> MonteCarlo:
    """Run the three filters on the walk, once per seed. The particles of a block of runs share a stream."""
    measured = measurements(walk, seeds)
    parts: dict[str, list[Estimates]] = {name: [] for name in FILTERS}
    for first in range(0, len(seeds), _BLOCK):
        some = measured[first : first + _BLOCK]
        parts[IMM].append(kalman_estimates(Imm(), some))
        parts[KALMAN].append(kalman_estimates(kalman(), some))
        parts[PARTICLE].append(particle_estimates(some, stream(seeds[first], "reproduce", "particles")))
        on_progress("runs", min(first + _BLOCK, len(seeds)), len(seeds))
    true_position, true_speed = walk.position[FIRST_SCAN:], walk.speed[FIRST_SCAN:]
    position = {name: np.concatenate([part.position for part in made]) for name, made in parts.items()}
    speed = {name: np.concatenate([part.speed for part in made]) for name, made in parts.items()}
    measured_speed = np.linalg.norm(np.diff(measured, axis=1), axis=-1)[:, FIRST_SCAN - 1 :] / PERIOD_S  # eq. 9
    measured_speed_error = (measured_speed - true_speed) ** 2
    return MonteCarlo(
        seeds,
        walk,
        np.arange(FIRST_SCAN, len(walk)),
        SquaredErrors(
            {name: _squared(made, true_position) for name, made in position.items()},
            _squared(measured[:, FIRST_SCAN:], true_position),
        ),
        {
            reading: SquaredErrors(
                {name: (made[..., place] - true_speed) ** 2 for name, made in speed.items()}, measured_speed_error
            )
            for place, reading in enumerate(READINGS)
        },
    )


def measurements(walk: ManeuveringWalk, seeds: range) -> Array:
    """Measure the walk in each run, (n, k, 2) [m]; the noise of a seed does not depend on the other seeds."""
    deviation = np.sqrt(MEASUREMENT_VARIANCE_M2)
    noise = [stream(seed, "reproduce", "measurements").normal(0.0, deviation, walk.position.shape) for seed in seeds]
    return walk.position + np.array(noise)


def initial_state(imm: Imm, measured: Array) -> ImmState:
    """Initiate a filter at scan 1, from the first two measurements of (n, k, 2) [m]."""
    prior = START_SPEED_M_S**2
    trust = prior / (prior + 2 * MEASUREMENT_VARIANCE_M2 / PERIOD_S**2)
    velocity = (measured[:, 1] - measured[:, 0]) / PERIOD_S
    return imm.start(measured[:, 1], velocity * trust, MEASUREMENT_VARIANCE_M2, prior * (1 - trust))


def kalman_estimates(imm: Imm, measured: Array) -> Estimates:
    """Run the IMM, or with one mode the extended Kalman filter, over measurements (n, k, 2) [m], from scan 2 on."""
    state, everyone = initial_state(imm, measured), np.arange(len(measured))
    position, speed = [], []
    for scan in range(FIRST_SCAN, measured.shape[1]):
        state = imm.update(imm.predict(state, PERIOD_S), everyone, measured[:, scan])
        mean, _ = imm.estimate(state)
        position.append(mean[:, :2])
        probability = state.probability
        speed.append(_speeds(state.mean, lambda values, p=probability: (values * p).sum(axis=0)))
    return Estimates(np.stack(position, axis=1), np.stack(speed, axis=1))


def particle_estimates(measured: Array, rng: np.random.Generator, n_particle: int = N_PARTICLE) -> Estimates:
    """Run the particle filter over measurements (n, k, 2) [m], from scan 2 on: model 3, plain resampling at every scan."""
    single = kalman((PARTICLE_MODEL,))
    mean, covariance = single.estimate(initial_state(single, measured))
    algorithm = ParticleFilter(resampling="plain", threshold=1.0)
    cloud = Cloud.normal(mean, covariance, n_particle, rng)
    position, speed = [], []
    for scan in range(FIRST_SCAN, measured.shape[1]):
        cloud = algorithm.step(cloud, _propagate, partial(_log_likelihood, measured[:, scan]), rng)
        position.append(cloud.expectation(cloud.state[:2]).T)
        speed.append(_speeds(cloud.state, cloud.expectation))
    return Estimates(np.stack(position, axis=1), np.stack(speed, axis=1))


def _speeds(state: Array, mean: Callable[[Array], Array]) -> Array:
    """Compute the speed of n people in each of `READINGS`, (n, 3) [m/s], from modes or particles (5, ...) and their mean."""
    speed, heading = state[SPEED], state[HEADING]
    along_x, along_y = mean(speed * np.cos(heading)), mean(speed * np.sin(heading))
    return np.stack([mean(np.abs(speed)), np.abs(mean(speed)), np.hypot(along_x, along_y)], axis=-1)


def _propagate(state: Array, rng: np.random.Generator) -> Array:
    """Move particles (5, n, p) by one scan, each under its own disturbance."""
    disturbance = rng.standard_normal((2, *state.shape[1:]))
    disturbance[0] *= np.sqrt(PARTICLE_MODEL.acceleration_variance)
    disturbance[1] *= np.sqrt(PARTICLE_MODEL.turn_acceleration_variance)
    return propagate(state, disturbance, PERIOD_S, float(PARTICLE_MODEL.turn_persists))


def _log_likelihood(position: Array, state: Array) -> Array:
    """Compute the log-likelihood of measured positions (n, 2) [m] at each particle (5, n, p), up to a constant."""
    away_x = state[0] - position[:, 0, None]
    away_y = state[1] - position[:, 1, None]
    return (away_x * away_x + away_y * away_y) * (-0.5 / MEASUREMENT_VARIANCE_M2)


def _squared(position: Array, true: Array) -> Array:
    return ((position - true) ** 2).sum(axis=-1)


NPE, NVE = "figure 7 (a)", "figure 7 (b)"


@dataclass(frozen=True, eq=False)
class Curves:
    """NPE or NVE of each filter at each scan, in every replicate of the bootstrap, (1 + replicates, k).

    A filter's squared error, summed over the runs, over that of the measurements (eq. 8).
    """

    where: str
    name: str
    by_filter: dict[str, Array]

    def lowest(self) -> Array:
        """Return where the IMM is below both others, (1 + replicates, k)."""
        return np.all([self.by_filter[IMM] < curve for name, curve in self.by_filter.items() if name != IMM], axis=0)


def curves(runs: MonteCarlo) -> tuple[Curves, Curves]:
    """Compute NPE and NVE, on the same bootstrap replicates."""
    bootstrap = _bootstrap(runs)
    return (
        _curves(NPE, "NPE", runs.position, bootstrap),
        _curves(NVE, "NVE", runs.speed[MEAN_MAGNITUDE], bootstrap),
    )


def figure7_results(runs: MonteCarlo) -> list[ResultRow]:
    """Compute every result of figure 7: means over the scans, the IMM against the others, and the other readings of a speed.

    The paper prints curves only.
    """
    bootstrap, n_run, rows = _bootstrap(runs), len(runs.seeds), []

    def add(where: str, row: str, column: str, values: Array, unit: str) -> None:
        rows.append(ResultRow.of(where, row, column, interval(values), unit, n_run))

    for found in curves(runs):
        mean = {name: curve.mean(axis=1) for name, curve in found.by_filter.items()}
        for name in FILTERS:
            add(found.where, name, f"{found.name}, mean over scans", mean[name], "1")
        for name in FILTERS[1:]:
            add(
                found.where,
                f"IMM below {name}",
                f"{found.name}, mean over scans",
                100 * (1 - mean[IMM] / mean[name]),
                "%",
            )
        add(found.where, IMM, f"scans at which its {found.name} is the lowest", 100 * found.lowest().mean(axis=1), "%")
    for reading in READINGS[1:]:
        other = _curves(NVE, "NVE", runs.speed[reading], bootstrap)
        for name in FILTERS:
            column = f"NVE, mean over scans, speed read as {reading}"
            add(NVE, name, column, other.by_filter[name].mean(axis=1), "1")
    return rows


def _curves(where: str, name: str, errors: SquaredErrors, bootstrap: Bootstrap) -> Curves:
    return Curves(
        where,
        name,
        {key: bootstrap.ratio(squared, errors.measured) for key, squared in errors.by_filter.items()},
    )


def _bootstrap(runs: MonteCarlo) -> Bootstrap:
    return Bootstrap(len(runs.seeds), stream(runs.seeds.start, "reproduce", "bootstrap"))
