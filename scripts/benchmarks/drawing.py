"""One process that draws one camera for a while: what `benchmarks.processes` starts several of.

`python -m benchmarks.drawing NAME SECONDS` prints `{"renderer"}` when its first frames are drawn, waits for a line on its
input, draws for so long, and prints `{"frames", "spent_s"}`.
"""

from __future__ import annotations

import json
import os
import sys
import time

import numpy as np
from pydantic import TypeAdapter

from twin.scenario import load_scenario
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.render import RendererOnDemand
from twin.world.world import World

CAMERAS = {
    "fisheye 480 × 480": ("lab-five-people", "fisheye", {"size": [480, 480]}),
    "camera 640 × 480": ("home-cameras", "camera_1", {"size": [640, 480]}),
    "stereo 320 × 240, matched": ("meeting-three-people", "stereo_1", {"mode": "matched"}),
    "stereo 320 × 240, ideal": ("meeting-three-people", "stereo_1", {"mode": "ideal"}),
}
"""By name: the scenario, its sensor, and what is changed of it."""

_AT_S = 5.0
_WARM = 3


def draw(name: str, seconds: float) -> None:
    """Draw one of `CAMERAS`, noise as its scenario has it, of people who stand still: what is measured is the camera."""
    say = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a driver prints is no answer
    scenario_name, sensor_name, changes = CAMERAS[name]
    scenario = load_scenario(scenario_name)
    content = scenario.sensors[sensor_name].model_dump() | changes
    snapshot = World(scenario).snapshot(_AT_S)
    rng, state = np.random.default_rng(0), None
    with RendererOnDemand(snapshot.model) as renderer:
        description = TypeAdapter(SensorDescription).validate_python(content)
        sensor = build_sensor(sensor_name, description, renderer)
        for _ in range(_WARM):
            _, state = sensor.observe(0, [snapshot], state, rng)
        print(json.dumps({"renderer": renderer().gl_info().renderer}), file=say, flush=True)
        sys.stdin.readline()
        frames, start = 0, time.perf_counter()
        while (spent_s := time.perf_counter() - start) < seconds:
            _, state = sensor.observe(0, [snapshot], state, rng)
            frames += 1
        print(json.dumps({"frames": frames, "spent_s": spent_s}), file=say, flush=True)


if __name__ == "__main__":
    draw(sys.argv[1], float(sys.argv[2]))
