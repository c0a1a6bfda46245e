"""MOTA of each tracker at other sensor rates, over that at 10 Hz.

Scans and pictures come at 4 to 40 Hz with 2 ms of jitter, with a tenth of them lost, and from sensors of unlike rates. Seeds
from 3000 on; nothing is chosen by them. Where one person lost is a tenth of a run's MOTA, more seeds are needed: as many as
the ground's pictures allow.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figure import Figure
from benchmarks.real_twins import f1, recorded_people
from benchmarks.recorded_legs import DATA
from trackers.observations import NS_PER_S
from trackers.presets import PRESETS
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario

Change = Callable[[Any, int], dict[str, float]]
"""Fields of a sensor to change, by its description and number."""

_FIRST_SEED = 3404
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
class _Ground:
    scenario: str
    trackers: tuple[str, ...]
    duration_s: float
    rates_hz: tuple[float, ...]
    n_seeds: int = 2
    images: bool = True

    def mota(self, change: Change) -> dict[str, float]:
        """Mean MOTA by tracker; `change`: fields of a sensor by its description and number."""
        total = dict.fromkeys(self.trackers, 0.0)
        for seed in range(_FIRST_SEED, _FIRST_SEED + self.n_seeds):
            scenario = load_scenario(self.scenario, [f"seed={seed}", f"duration_s={self.duration_s}"])
            with tempfile.TemporaryDirectory() as folder:
                run = run_scenario(
                    _changed(scenario, change),
                    trackers=self.trackers,
                    out=Path(folder) / "run",
                    video=False,
                    images=self.images,
                )
            assert run.metrics is not None
            for tracker in self.trackers:
                total[tracker] += run.metrics["trackers"][tracker]["mota"] / self.n_seeds
        return total

    def rows(self, how: str, got: dict[str, float], usual: dict[str, float], least: float) -> Iterator[Figure]:
        """One row per tracker that follows anybody at the usual rate."""
        for tracker, mota in got.items():
            at = f"{self.scenario}, {tracker} {how}"
            if usual[tracker] <= 0:
                print(
                    f"rates: {at}: not compared, its MOTA at {_USUAL_HZ:g} Hz is {usual[tracker]:.3f}", file=sys.stderr
                )
                continue
            name = f"{at}: MOTA {mota:.3f} over the usual {usual[tracker]:.3f}, {self.n_seeds} seeds"
            yield Figure(name, mota / usual[tracker], "", f">= {least}")


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
        tuple(name for name in PRESETS if name.startswith("camera-floor") and name not in _FLOORS),
        10.0,
        _FEW_RATES_HZ,
    ),
    _Ground("home-cameras", ("floor-colour-kalman",), 10.0, _FEW_RATES_HZ, 6),
    _Ground("home-cameras", _FLOORS, 10.0, _FEW_RATES_HZ, 20, images=False),
    _Ground("meeting-three-people", tuple(name for name in PRESETS if name.startswith("rgbd")), 10.0, (4.0, 7.5, 20.0)),
)
"""Pictures are dear: as many seeds as they allow. Every tracker that is not another with one option off is here."""


def measure() -> Iterator[Figure]:
    """A row per ground, tracker and rate; the last of each ground are lost and unlike scans."""
    for ground in _GROUNDS:
        usual = ground.mota(lambda each, _: {"rate_hz": _USUAL_HZ})
        for rate_hz in ground.rates_hz:
            got = ground.mota(lambda each, _, hz=rate_hz: {"rate_hz": hz, "jitter_s": _JITTER_S})
            yield from ground.rows(f"at {rate_hz:g} Hz with jitter", got, usual, 0.90 if rate_hz <= 5 else 0.97)
        lost = ground.mota(lambda each, _: {"rate_hz": _USUAL_HZ, "dropout": _LOST})
        yield from ground.rows("with a tenth lost", lost, usual, 0.9)
        unlike = ground.mota(lambda each, n: {"rate_hz": _USUAL_HZ * (1.0, 0.7, 1.3)[n % 3]})
        yield from ground.rows("with unlike rates", unlike, usual, 0.9)
    yield from _recorded()


def _recorded() -> Iterator[Figure]:
    """Yield what restamping, and leaving scans out, costs `laser-legs` on labelled recordings of 7.5 Hz."""
    if not DATA.is_dir():
        print(f"rates: recorded scans skipped, there are none at {DATA}", file=sys.stderr)
        return
    for number in (1, 2, 3):
        scans, people, box = recorded_people(number)
        usual = f1("laser-legs", scans, people, box)
        for how, (rate, jitter, every) in _RESTAMPED.items():
            rng, start_ns = np.random.default_rng(number), scans[0].stamp_ns
            told, there = [], {}
            for scan in scans[::every]:
                off_ns = jitter * NS_PER_S / 7.5 * rng.normal()
                stamp_ns = round(start_ns + (scan.stamp_ns - start_ns) * rate + off_ns)
                told.append(replace(scan, stamp_ns=stamp_ns))
                there[stamp_ns] = people[scan.stamp_ns]
            got = f1("laser-legs", sorted(told, key=lambda scan: scan.stamp_ns), there, box)
            name = f"positive_{number}, laser-legs {how}: F1 {got:.3f}, less {usual:.3f} as recorded"
            yield Figure(name, got - usual, "", ">= -0.03")


def _changed(scenario: Scenario, change: Change) -> Scenario:
    """Change fields of the sensors; a scanner sweeps for the same share of its period."""
    sensors = {}
    for number, (sensor, description) in enumerate(scenario.sensors.items()):
        fields = change(description, number)
        if sweep_s := getattr(description, "sweep_time_s", 0.0):
            fields |= {"sweep_time_s": sweep_s * description.rate_hz / fields["rate_hz"]}
        sensors[sensor] = description.model_copy(update=fields)
    return scenario.model_copy(update={"sensors": sensors})
