"""Noise of a scanner against a real one's, and cost of faults."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.figure import Figure, median_ratio
from twin.scenario import load_scenario
from twin.scenario.sensor_descriptions import build_sensor
from twin.sensors.fault_kinds import BlockedSector, DeadBeams, Fault, LensOcclusion
from twin.sensors.laser_noise import LASER_NOISE
from twin.sensors.render import RendererOnDemand
from twin.sensors.sensor import with_faults
from twin.world.world import World

_AT_S = 3.0
_SCANS = 3000


def scanner_noise() -> Iterator[Figure]:
    """The preset 'hokuyo' beside the real scanner on walls that stand still: how far its σ and its drop-out are off.

    Nothing is measured where the recording is not there (../shared/data/lasers).
    """
    sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "twin" / "sensors"))
    from static_walls import HOKUYO_SCANS, hokuyo_ranges, simulated, walls_in

    if not HOKUYO_SCANS.exists():
        sys.stderr.write(f"scanner noise: no real scans at {HOKUYO_SCANS}; left out\n")
        return
    noise = LASER_NOISE["hokuyo"]
    ranges, limits = hokuyo_ranges()
    real = walls_in(ranges)
    ideal = np.full(ranges.shape[1], np.nan)
    ideal[real.beams] = real.range_m
    sigma_m = np.nanstd(simulated(ideal, limits, noise, _SCANS)[:, real.beams], axis=0)
    measured_m = float(np.median(real.sigma_m))
    off = abs(float(np.median(sigma_m)) / measured_m - 1)
    yield Figure("real scanner on static walls, σ", 1e3 * measured_m, "mm", "")
    yield Figure("'hokuyo' on static walls, σ off the real one by", off, "", "<= 0.2")
    rms_off = abs(float(np.sqrt(np.mean(sigma_m**2) / np.mean(real.sigma_m**2))) - 1)
    yield Figure("'hokuyo' on static walls, root mean square σ off the real one by", rms_off, "", "<= 0.2")
    yield Figure(f"real scanner on static walls, drop-out over {real.readings} readings", real.drop_out, "", "")
    yield Figure("'hokuyo', drop-out off the real one by", abs(noise.dropout / real.drop_out - 1), "", "<= 0.2")


def cost() -> Iterator[Figure]:
    """A scan and a picture with faults over those without."""
    scenario = load_scenario("lab-five-people")
    snapshot = World(scenario).snapshot(_AT_S)
    faults: dict[str, dict[str, Fault]] = {
        "waist": {
            "coat": BlockedSector(sensor=("waist",), kind="blocked_sector", bearings_deg=(20, 50)),
            "dead": DeadBeams(sensor=("waist",), kind="dead_beams", share=0.05),
        },
        "fisheye": {"thumb": LensOcclusion(sensor=("fisheye",), kind="occlusion")},
    }
    with RendererOnDemand(snapshot.model) as renderer:
        for name, own in faults.items():
            healthy = build_sensor(name, scenario.sensors[name], renderer)
            faulty = with_faults(healthy, own, 0)
            rng = np.random.default_rng(0)
            states = {False: None, True: None}

            def observe(is_faulty: bool) -> None:
                sensor = faulty if is_faulty else healthy  # noqa: B023
                _, states[is_faulty] = sensor.observe(0, [snapshot], states[is_faulty], rng)  # noqa: B023

            observe(False)
            observe(True)
            ratio = median_ratio(lambda: observe(True), lambda: observe(False), 60)
            yield Figure(f"{name} with {' and '.join(own)}, over without", ratio, "×", "")
