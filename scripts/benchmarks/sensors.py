"""Cost of a scan and a picture over the bare call to MuJoCo, and error of the picture."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.cameras import Bare
from benchmarks.figure import Figure, median_ratio
from twin.instant.snapshot import RAY_GROUPS
from twin.scenario import load_scenario
from twin.scenario.sensor_descriptions import build_sensor
from twin.sensors.fisheye import Fisheye
from twin.sensors.laser import Laser
from twin.sensors.render import RendererOnDemand
from twin.sensors.sensor import Noisy
from twin.world.world import World

_AT_S = 3.0


def laser() -> Iterator[Figure]:
    """One 361-beam scan of five people with noise and labels, against `mj_multiRay` of the same beams."""
    scenario = load_scenario("lab-five-people")
    world = World(scenario)
    snapshot = world.snapshot(_AT_S)
    sensor = build_sensor("waist", scenario.sensors["waist"], RendererOnDemand(snapshot.model))
    assert isinstance(sensor, Noisy)
    ideal = sensor.ideal
    assert isinstance(ideal, Laser)
    directions = ideal.directions.ravel()
    beams = directions.size // 3
    geom, distance = np.empty(beams, dtype=np.int32), np.empty(beams)
    rng = np.random.default_rng(0)

    def bare() -> None:
        mujoco.mj_multiRay(
            snapshot.model, snapshot.data, ideal.origin_m, directions, RAY_GROUPS, True, -1,
            geom, distance, None, beams, ideal.range_max_m,
        )  # fmt: skip

    ratio = median_ratio(lambda: sensor.observe(0, [snapshot], None, rng), bare, 400)
    yield Figure("361-beam scan, noise and labels, over bare mj_multiRay", ratio, "×", "<= 1.5")


def fisheye() -> Iterator[Figure]:
    """One picture of five people, noise included, against the bare render of its faces."""
    scenario = load_scenario("lab-five-people")
    world = World(scenario)
    snapshot = world.snapshot(_AT_S)
    with RendererOnDemand(snapshot.model) as renderer:
        sensor = build_sensor("fisheye", scenario.sensors["fisheye"], renderer)
        assert isinstance(sensor, Noisy)
        ideal = sensor.ideal
        assert isinstance(ideal, Fisheye)
        rng = np.random.default_rng(0)
        state = None

        def measured() -> None:
            nonlocal state
            _, state = sensor.observe(0, [snapshot], state, rng)

        measured()
        with Bare(snapshot, ideal) as bare:
            ratio = median_ratio(measured, bare.draw, 60)
    yield Figure("fisheye picture, noise included, over the bare render of its faces", ratio, "×", "<= 1.3")


def silhouettes() -> Iterator[Figure]:
    """Measure the distance of people's outlines from those of rays, over the full 185°."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "twin" / "sensors"))
    from silhouettes import description, silhouette_displacements

    displacement, _ = silhouette_displacements(description())
    yield Figure("silhouettes against rays, mean", float(displacement.mean()), "px", "<= 0.4")
    yield Figure("silhouettes against rays, 95th percentile", float(np.quantile(displacement, 0.95)), "px", "<= 1")
