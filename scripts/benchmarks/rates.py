"""MOTA of each tracker at other sensor rates, over that at 10 Hz.

Scans and pictures come at 4 to 40 Hz with 2 ms of jitter, with a tenth of them lost, and from sensors of unlike rates. Seeds
from 3000 on; nothing is chosen by them. Where one person lost is a tenth of a run's MOTA, more seeds are needed: as many as
the ground's pictures allow. Runs go side by side, one a core.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from multiprocessing.pool import AsyncResult
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figure import Figure
from benchmarks.real_twins import f1
from benchmarks.recorded_legs import DATA
from benchmarks.recorded_twin import recording
from trackers.observations import NS_PER_S
from trackers.presets import PRESETS
from twin.environment.run import write_environment
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario

FIRST_SEED = "BENCH_RATES_SEED"
"""Environment variable: the first seed, where it shall not be the one below."""

_FIRST_SEED = 3424
_RATES_HZ = (4.0, 5.0, 7.5, 9.0, 9.97, 12.5, 20.0, 40.0)
_FEW_RATES_HZ = (4.0, 7.5, 9.97, 20.0)
_USUAL_HZ = 10.0
_JITTER_S = 0.002
_LOST = 0.1
_RESTAMPED = {
    "with stamps 5 % of a period off": (1.0, 0.05, 1),
    "with a clock 1000 ppm fast and such stamps": (1.001, 0.05, 1),
    "with every other scan": (1.0, 0.0, 2),
}
"""Rate of the clock, deviation of stamps in periods, and how many scans apart."""


@dataclass(frozen=True)
class _Change:
    """Rates of a scenario's sensors [Hz], one after the other, jitter of their stamps [s] and share of what is lost."""

    how: str
    rates_hz: tuple[float, ...] = (_USUAL_HZ,)
    jitter_s: float | None = None
    dropout: float | None = None
    least: float = 0.9

    def of(self, scenario: Scenario) -> Scenario:
        """Return the scenario with changed sensors; a scanner sweeps for the same share of its period."""
        reported = {"jitter_s": self.jitter_s, "dropout": self.dropout}
        sensors = {}
        for number, (sensor, description) in enumerate(scenario.sensors.items()):
            fields = {name: value for name, value in reported.items() if value is not None}
            fields["rate_hz"] = self.rates_hz[number % len(self.rates_hz)]
            if sweep_s := getattr(description, "sweep_time_s", 0.0):
                fields["sweep_time_s"] = sweep_s * description.rate_hz / fields["rate_hz"]
            sensors[sensor] = description.model_copy(update=fields)
        return scenario.model_copy(update={"sensors": sensors})


_USUAL = _Change("at the usual rate")
_LOST_OR_UNLIKE = (
    _Change("with a tenth lost", dropout=_LOST, least=0.97 * (1 - _LOST)),  # at a lost frame nothing is reported
    _Change("with unlike rates", (_USUAL_HZ, 0.7 * _USUAL_HZ, 1.3 * _USUAL_HZ)),
)


@dataclass(frozen=True)
class _Ground:
    scenario: str
    trackers: tuple[str, ...]
    duration_s: float
    rates_hz: tuple[float, ...]
    n_seeds: int = 2
    images: bool = True
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Options of every tracker here."""
    environment: bool = False
    """Hand the trackers an environment that was scanned beforehand."""

    @property
    def changes(self) -> tuple[_Change, ...]:
        """Return each change of the sensors, the usual first."""
        rates = (
            _Change(f"at {hz:g} Hz with jitter", (hz,), _JITTER_S, least=0.9 if hz <= 5 else 0.97)
            for hz in self.rates_hz
        )
        return _USUAL, *rates, *_LOST_OR_UNLIKE

    def mota(self, change: _Change, seed: int) -> dict[str, float]:
        """Run once; return MOTA by tracker."""
        with tempfile.TemporaryDirectory() as folder:
            reported = [f"seed={seed}", f"duration_s={self.duration_s}"]
            reported += [f"trackers.{name}={json.dumps({'preset': name, **self.options})}" for name in self.trackers]
            if self.environment:
                path = Path(folder) / "environment.npz"
                write_environment(load_scenario(self.scenario, reported), [], out=path)
                reported.append(f"prior.environment={path}")
            scenario = change.of(load_scenario(self.scenario, reported))
            run = run_scenario(
                scenario, trackers=self.trackers, out=Path(folder) / "run", video=False, images=self.images
            )
        assert run.metrics is not None
        return {tracker: run.metrics["trackers"][tracker]["mota"] for tracker in self.trackers}

    def rows(self, change: _Change, got: dict[str, float], usual: dict[str, float]) -> Iterator[Figure]:
        """One row per tracker that follows anybody at the usual rate."""
        for tracker, mota in got.items():
            at = f"{self.scenario}, {tracker} {change.how}"
            if usual[tracker] <= 0:
                print(
                    f"rates: {at}: not compared, its MOTA at {_USUAL_HZ:g} Hz is {usual[tracker]:.3f}", file=sys.stderr
                )
                continue
            name = f"{at}: MOTA {mota:.3f} over the usual {usual[tracker]:.3f}, {self.n_seeds} seeds"
            yield Figure(name, mota / usual[tracker], "", f">= {change.least}")


_STEREO_HZ = (4.0, 7.5, 20.0)
_LASERS = ("laser-imm", "laser-kalman", "laser-vision-learning-laser", "sort")
_FLOORS = ("camera-floor-particle-floor", "floor-kalman")
_GROUNDS = (
    _Ground("lab-five-people", _LASERS, 15.0, _RATES_HZ, images=False),
    _Ground(
        "lab-five-people",
        (
            "laser-fisheye-imm",
            "laser-fisheye-kalman",
            "waist-fisheye-imm",
            "waist-fisheye-kalman",
            "laser-fisheye-imm-paper",
            "fusion",
        ),
        12.0,
        _FEW_RATES_HZ,
        4,
    ),
    _Ground(
        "library-hall",
        ("laser-imm", "laser-vision-learning-laser", "sort"),
        10.0,
        (4.0, 7.5, 25.0, 40.0),
        images=False,
    ),
    _Ground("library-hall", ("laser-vision-learning", "laser-vision-learning-vision"), 10.0, (4.0, 7.5, 25.0)),
    _Ground("robot-passes-crowd", ("laser-legs",), 10.0, (3.0, 5.0, 20.0, 40.0), 6, images=False),
    _Ground(
        "home-cameras",
        (*(name for name in PRESETS if name.startswith("camera-floor") and name not in _FLOORS), "fusion"),
        10.0,
        _FEW_RATES_HZ,
    ),
    _Ground("home-cameras", ("floor-colour-kalman",), 10.0, _FEW_RATES_HZ, 6),
    _Ground("home-cameras", _FLOORS, 10.0, _FEW_RATES_HZ, 20, images=False),
    _Ground("meeting-three-people", ("rgbd-head",), 10.0, _STEREO_HZ, 4),
    _Ground(
        "head-sequence-1",
        tuple(name for name in PRESETS if name.startswith("rgbd")),
        10.0,
        _STEREO_HZ,
        4,
        options={"start": [{"place": [-0.66, -0.97, 1.22], "yaw_deg": 6}]},
        environment=True,
    ),
)
"""Pictures are dear: as many seeds as they allow. Every tracker that is not another with one option off is here."""


def measure() -> Iterator[Figure]:
    """A row per ground, tracker and rate; the last of each ground are lost and unlike scans."""
    first = int(os.environ.get(FIRST_SEED, _FIRST_SEED))
    spawn = multiprocessing.get_context("spawn")
    # an executor with `max_tasks_per_child` stops for ever once its workers end (python/cpython#115634)
    with spawn.Pool(len(os.sched_getaffinity(0)), maxtasksperchild=8) as pool:
        runs = {
            (ground, change): [pool.apply_async(ground.mota, (change, first + n)) for n in range(ground.n_seeds)]
            for ground in _GROUNDS
            for change in ground.changes
        }
        for ground in _GROUNDS:
            usual = _mean(runs[ground, _USUAL])
            for change in ground.changes[1:]:
                yield from ground.rows(change, _mean(runs[ground, change]), usual)
    yield from _recorded()


def _mean(runs: list[AsyncResult[dict[str, float]]]) -> dict[str, float]:
    each = [run.get() for run in runs]
    return {tracker: sum(mota[tracker] for mota in each) / len(each) for tracker in each[0]}


def _recorded() -> Iterator[Figure]:
    """Yield what restamping, and leaving scans out, costs `laser-legs` on labelled recordings of 7.5 Hz."""
    if not DATA.is_dir():
        print(f"rates: recorded scans skipped, there are none at {DATA}", file=sys.stderr)
        return
    for number in (1, 2, 3):
        real = recording(number)
        usual, start_ns = f1("laser-legs", real), real.scans[0].stamp_ns
        for how, (rate, jitter, every) in _RESTAMPED.items():
            rng, scores = np.random.default_rng(number), []
            for first in range(every):  # each of the scans is in one of the series
                stamps_ns = {}
                for place in range(first, len(real.scans), every):
                    off_ns = jitter * NS_PER_S / 7.5 * rng.normal()
                    stamps_ns[place] = round(start_ns + (real.scans[place].stamp_ns - start_ns) * rate + off_ns)
                scores.append(f1("laser-legs", real.restamped(stamps_ns)))
            got = float(np.mean(scores))
            name = f"positive_{number}, laser-legs {how}: F1 {got:.3f}, less {usual:.3f} as recorded"
            yield Figure(name, got - usual, "", ">= -0.03")
