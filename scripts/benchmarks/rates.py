"""MOTA of each tracker at other sensor rates, over that at 10 Hz.

Scans and pictures come at 4 to 40 Hz with 2 ms of jitter, with a tenth of them lost, and from sensors of unlike rates. Seeds
from 3000 on; nothing is chosen by them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.figure import Figure
from trackers.presets import PRESETS
from twin.run.live import run_scenario
from twin.scenario import Scenario, load_scenario

Change = Callable[[Any, int], dict[str, float]]
"""Fields of a sensor to change, by its description and number."""

SEEDS = range(3402, 3404)
_RATES_HZ = (4.0, 5.0, 7.5, 9.0, 9.97, 12.5, 20.0, 40.0)
_USUAL_HZ = 10.0
_JITTER_S = 0.002
_LOST = 0.1

_GROUNDS: tuple[tuple[str, tuple[str, ...], float, tuple[float, ...]], ...] = (
    ("lab-five-people", ("laser-imm", "laser-kalman", "laser-vision-learning-laser", "sort"), 15.0, _RATES_HZ),
    (
        "lab-five-people",
        (
            "laser-fisheye-imm",
            "laser-fisheye-kalman",
            "waist-fisheye-imm",
            "waist-fisheye-kalman",
            "laser-fisheye-imm-paper",
        ),
        12.0,
        (4.0, 7.5, 9.97, 20.0),
    ),
    ("library-hall", ("laser-imm", "laser-vision-learning-laser", "sort"), 10.0, (4.0, 7.5, 25.0, 40.0)),
    ("library-hall", ("laser-vision-learning", "laser-vision-learning-vision"), 10.0, (4.0, 7.5, 25.0)),
    (
        "home-cameras",
        tuple(name for name in PRESETS if name.startswith("camera-floor") or name.startswith("floor")),
        10.0,
        (4.0, 7.5, 9.97, 20.0),
    ),
    ("meeting-three-people", tuple(name for name in PRESETS if name.startswith("rgbd")), 10.0, (4.0, 7.5, 20.0)),
)
"""Scenario, trackers, duration [s], rates tried [Hz]; cameras are dear. Every preset is in one of them."""
_WITHOUT_PICTURES = {"laser-imm", "laser-kalman", "laser-vision-learning-laser", "sort"}


def measure() -> Iterator[Figure]:
    """A row per ground, tracker and rate; the last of each ground are lost and unlike scans."""
    for name, trackers, duration_s, rates in _GROUNDS:
        usual = _mota(name, trackers, duration_s, lambda each, _: {"rate_hz": _USUAL_HZ})
        for rate_hz in rates:
            got = _mota(name, trackers, duration_s, lambda each, _, hz=rate_hz: {"rate_hz": hz, "jitter_s": _JITTER_S})
            yield from _rows(name, f"at {rate_hz:g} Hz with jitter", got, usual, 0.90 if rate_hz <= 5 else 0.97)
        lost = _mota(name, trackers, duration_s, lambda each, _: {"rate_hz": _USUAL_HZ, "dropout": _LOST})
        yield from _rows(
            name, "with a tenth lost", lost, usual, 0.97 * (1 - _LOST)
        )  # one sensor alone has no frame then
        unlike = _mota(name, trackers, duration_s, lambda each, n: {"rate_hz": _USUAL_HZ * (1.0, 0.7, 1.3)[n % 3]})
        yield from _rows(name, "with unlike rates", unlike, usual, 0.9)


def _rows(name: str, how: str, got: dict[str, float], usual: dict[str, float], least: float) -> Iterator[Figure]:
    for tracker, mota in got.items():
        yield Figure(
            f"{name}, {tracker} {how}: MOTA {mota:.3f} over the usual {usual[tracker]:.3f}, {len(SEEDS)} seeds",
            mota / usual[tracker],
            "",
            f">= {least}",
        )


def _mota(name: str, trackers: Sequence[str], duration_s: float, change: Change) -> dict[str, float]:
    """Mean MOTA by tracker; `change`: fields of a sensor by its description and number."""
    total = dict.fromkeys(trackers, 0.0)
    for seed in SEEDS:
        scenario = _changed(load_scenario(name, [f"seed={seed}", f"duration_s={duration_s}"]), change)
        with tempfile.TemporaryDirectory() as folder:
            images = not _WITHOUT_PICTURES.issuperset(trackers)
            run = run_scenario(scenario, trackers=trackers, out=Path(folder) / "run", video=False, images=images)
            assert run.metrics is not None
            for tracker in trackers:
                total[tracker] += run.metrics["trackers"][tracker]["mota"] / len(SEEDS)
    return total


def _changed(scenario: Scenario, change: Change) -> Scenario:
    sensors = {
        sensor: description.model_copy(update=change(description, number))
        for number, (sensor, description) in enumerate(scenario.sensors.items())
    }
    return scenario.model_copy(update={"sensors": sensors})
