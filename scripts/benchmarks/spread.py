"""Spread of a suite's metrics when nothing but image noise changes: the yardstick for tolerances.

Figures are measured on _N_SEED seeds of the lab, each with _N_NOISE draws of the camera's noise. Two draws of a seed are a
harmless change; three seeds with a pair each are what `smoke` would see of it. What a figure is allowed
(`twin.suites.metrics.GATED`) is to be at least SIGMA standard deviations of such a mean, pooled over trackers.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figure import Figure
from trackers.arrays import Array
from twin.models import cache_folder
from twin.scenario import load_scenario
from twin.suites.cache import RecordingCache, cache_limit_bytes
from twin.suites.metrics import GATED, allowed_by_default
from twin.suites.result_files import read_results
from twin.suites.results import GroupKey, Results
from twin.suites.run import run_suite
from twin.suites.spec import Suite, SuiteScenario

SIGMA = 3.0
_SCENARIO = "lab-five-people"
_TRACKERS = ("laser-fisheye-imm", "waist-fisheye-imm", "laser-fisheye-kalman", "waist-fisheye-kalman")
_CAMERA = "fisheye"
_FIRST_SEED, _N_SEED, _N_NOISE = 1000, 6, 4
_SEEDS_OF_A_RUN = 3


def measure() -> Iterator[Figure]:
    """Each figure's spread beside what it is allowed."""
    with tempfile.TemporaryDirectory() as folder:
        run_suite(_suite(), Path("spread.yaml"), Path(folder), RecordingCache(cache_folder(), cache_limit_bytes()))
        values = _values(read_results(Path(folder)))
    for metric in GATED:
        measured = [values[tracker, metric] for tracker in _TRACKERS if (tracker, metric) in values]
        if not measured:
            continue
        for tracker in _TRACKERS:
            if (tracker, metric) in values:
                sys.stderr.write(
                    f"{metric} {tracker}: σ of a change of the mean {_sigma([values[tracker, metric]]):.4g}\n"
                )
        sigma, level = _sigma(measured), float(np.mean([each.mean() for each in measured]))
        yield Figure(f"{metric}: σ of the mean over three seeds when only the image's noise changes", sigma, "", "")
        needed = SIGMA * sigma / allowed_by_default(metric, level)
        yield Figure(f"{metric}: {SIGMA:g} σ over what is allowed at {level:.3g}", needed, "", "<= 1")


def other_noise(number: int, *sensors: str) -> dict[str, Any]:
    """Overrides of the lab after which these sensors draw other noise: a sensor's name is what its stream is made from."""
    described = load_scenario(_SCENARIO).model_dump(mode="json", exclude_none=True)["sensors"]
    without = {f"sensors.{name}": None for name in sensors}
    return without | {f"sensors.{name}_{number}": described[name] for name in sensors}


def _suite() -> Suite:
    seeds = tuple(range(_FIRST_SEED, _FIRST_SEED + _N_SEED))
    variants = [other_noise(number, _CAMERA) for number in range(_N_NOISE)]
    scenario = SuiteScenario.model_validate({"scenario": _SCENARIO, "variants": variants})
    return Suite(name="spread", seeds=seeds, trackers=_TRACKERS, scenarios=[scenario])


def _values(results: Results) -> dict[tuple[str, str], Array]:
    """Every figure of a tracker, (n_seed, n_noise); figures that some case lacks are left out."""
    groups: dict[str, list[GroupKey]] = {}
    for key in results.groups:
        groups.setdefault(key.tracker, []).append(key)
    found = {}
    for tracker, keys in groups.items():
        for metric in GATED:
            rows = [[each.get(metric) for _, each in sorted(results.groups[key].seeds.items())] for key in keys]
            if all(value is not None for row in rows for value in row):
                found[tracker, metric] = np.array(rows, dtype=float).T
    return found


def _sigma(values: list[Array]) -> float:
    """σ of the change, from one draw of noise to another, of a mean over the seeds of a run; pooled over trackers."""
    variance = np.mean([each.var(axis=1, ddof=1).mean() for each in values])
    return float(np.sqrt(2 * variance / _SEEDS_OF_A_RUN))
