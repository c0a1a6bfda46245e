"""Cost of pictures over the bare call to OpenGL, cost of the renderer's switches, and error of depth."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pydantic import TypeAdapter

from benchmarks.figure import Figure, median_ratio
from trackers.rig import StereoSensor
from twin.instant.snapshot import Snapshot
from twin.scenario import load_scenario
from twin.scenario.camera_descriptions import PinholeDescription
from twin.scenario.sensor_descriptions import SensorDescription, build_sensor
from twin.sensors.camera import CAMERA_NOISE
from twin.sensors.fisheye import Fisheye
from twin.sensors.pinhole import Pinhole
from twin.sensors.rays import trace_rays
from twin.sensors.render import OffscreenRenderer, RendererOnDemand
from twin.sensors.render_scene import point_cameras
from twin.sensors.sensor import Noisy, Sensor
from twin.world.simulation import Simulation
from twin.world.world import World

_AT_S = 8.0
_DESCRIBE: TypeAdapter[SensorDescription] = TypeAdapter(SensorDescription)
_FARTHEST_M = 8.0


def _home() -> tuple[Snapshot, PinholeDescription]:
    """Three people in the sensing room, and one of the cameras in its corners."""
    scenario = load_scenario("home-cameras")
    description = scenario.sensors["camera_1"]
    assert isinstance(description, PinholeDescription)
    return World(scenario).snapshot(_AT_S), description


def picture() -> Iterator[Figure]:
    """One 320 × 240 picture of three people, against drawing and reading the same pixels without anything around it."""
    snapshot, description = _home()
    rng = np.random.default_rng(0)
    for name, noise, distortion, target in (
        ("", "off", {}, "<= 1.15"),
        (", noise included", "default", {}, ""),
        (", distorted", "off", {"k1": -0.25, "k2": 0.05}, ""),
    ):
        content = description.model_dump() | {"noise": noise, "distortion": distortion}
        with ExitStack() as stack:
            renderer = stack.enter_context(RendererOnDemand(snapshot.model, keep_still=False))
            sensor = build_sensor("camera", _DESCRIBE.validate_python(content), renderer)
            ideal = sensor.ideal if isinstance(sensor, Noisy) else sensor
            assert isinstance(ideal, Pinhole)
            bare = stack.enter_context(Bare(snapshot, ideal))
            state = None

            def measured(sensor: Sensor = sensor) -> None:
                nonlocal state
                _, state = sensor.observe(0, [snapshot], state, rng)

            measured()
            ratio = median_ratio(measured, bare.draw, 100)
        yield Figure(f"camera picture{name}, over bare mjr_render and mjr_readPixels", ratio, "×", target)


class Bare:
    """Nothing but `mjr_render` and `mjr_readPixels` of all that a camera sees; a context manager."""

    def __init__(self, snapshot: Snapshot, camera: Pinhole | Fisheye) -> None:
        self._views = camera.views
        self._eye_m = camera.rig_sensor().room_from_sensor.translation
        width, height = camera.buffer_px
        self._pixels = np.zeros((height, width, 4), dtype=np.uint8)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._renderer = OffscreenRenderer(snapshot.model, keep_still=False)
        self._renderer.render(snapshot.data, self._eye_m, self._views, self._pixels)

    def __enter__(self) -> Bare:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def draw(self) -> None:
        """Draw the scene and read it."""
        scene, context = self._renderer.drawing()
        cameras = scene.camera[0], scene.camera[1]
        for view in self._views:
            if len(self._views) > 1:
                point_cameras(cameras, self._eye_m, view)
            mujoco.mjr_render(mujoco.MjrRect(*view.viewport), scene, context)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, context)


_LAB_MOUNT = {"xyz": [0.0, 0.0, 1.05], "yaw_deg": 90}
_STILL = {
    "lab": ("lab-five-people", ("home-cameras", "camera_1"), {"mount": _LAB_MOUNT, "size": [640, 480]}, "<= 0.3"),
    "hall": ("library-hall", ("library-hall", "camera"), {}, "<= 0.35"),
    "home": ("home-cameras", ("home-cameras", "camera_1"), {"size": [640, 480]}, "<= 0.2"),
    "lab by the fisheye": ("lab-five-people", ("lab-five-people", "fisheye"), {}, ""),
}
"""By room: scenario, the camera, what is changed of it, and what a picture may cost over the bare call for the whole of it."""


def still_rooms() -> Iterator[Figure]:
    """A picture of a still room, whose walls are kept, against drawing and reading all of it: CPU time, people walking."""
    for name, (scenario_name, (source, camera), changes, target) in _STILL.items():
        world = World(load_scenario(scenario_name))
        content = load_scenario(source).sensors[camera].model_dump() | changes | {"noise": "off"}
        description = _DESCRIBE.validate_python(content)
        rng = np.random.default_rng(0)
        for kept, said, bound in ((True, "", target), (False, ", nothing kept", "<= 1.15")):
            if not kept and not target:
                continue
            ratios = []
            with ExitStack() as stack:
                renderer = stack.enter_context(RendererOnDemand(world.snapshot(0.0).model, keep_still=kept))
                sensor = build_sensor(camera, description, renderer)
                assert isinstance(sensor, Pinhole | Fisheye)
                for t in np.arange(5) / 2 if kept else [2.0]:
                    snapshot = world.snapshot(float(t))
                    bare = stack.enter_context(Bare(snapshot, sensor))
                    look = partial(sensor.observe, 0, [snapshot], None, rng)
                    look()
                    look()
                    ratios.append(median_ratio(look, bare.draw, 15, time.process_time))
            yield Figure(f"picture of the {name}{said}, over the bare calls", statistics.median(ratios), "×", bound)


def switches() -> Iterator[Figure]:
    """Measure the cost of a picture with each of the renderer's switches turned, over the cost as shipped."""
    snapshot, description = _home()
    quiet = description.model_copy(update={"noise": CAMERA_NOISE["off"]})
    model = snapshot.model
    variants: tuple[tuple[str, dict[str, Any]], ...] = (
        ("drawing also what is out of sight", {"cull": False}),
        ("people alone, without the static room", {"static": False}),
        ("multisampling 4 ×", {"samples": 4}),
        ("shadows of one lamp", {"shadows": True}),
        ("shadows and multisampling 4 ×", {"shadows": True, "samples": 4}),
    )
    rng = np.random.default_rng(0)
    with RendererOnDemand(model) as renderer:
        plain = build_sensor("camera", quiet, renderer)
        yield Figure("camera picture as it is", _median_ms(plain, snapshot), "ms", "")
        for name, options in variants:
            with RendererOnDemand(model, **options) as other:
                turned = build_sensor("camera", quiet, other)
                turned.observe(0, [snapshot], None, rng)
                ratio = median_ratio(
                    partial(turned.observe, 0, [snapshot], None, rng),
                    partial(plain.observe, 0, [snapshot], None, rng),
                    30,
                )
            yield Figure(f"camera picture, {name}, over as it is", ratio, "×", "")


def _median_ms(sensor: Sensor, snapshot: Snapshot, rounds: int = 40) -> float:
    rng, spent = np.random.default_rng(0), []
    for _ in range(rounds):
        start = time.perf_counter()
        sensor.observe(0, [snapshot], None, rng)
        spent.append(1e3 * (time.perf_counter() - start))
    return statistics.median(spent)


def depth() -> Iterator[Figure]:
    """Ideal depth against rays, and how the error of disparities grows with distance."""
    scenario = load_scenario("meeting-three-people")
    snapshot = World(scenario).snapshot(_AT_S)
    content = scenario.sensors["stereo_1"].model_dump() | {"mode": "ideal"}
    with RendererOnDemand(snapshot.model) as renderer:
        ideal_m, true_m = _depths(content, renderer, snapshot)
        near = (true_m < _FARTHEST_M) & (ideal_m > 0)
        errors_mm = 1e3 * np.abs(ideal_m - true_m)[near]
        yield Figure("ideal depth against rays within 8 m, median", float(np.median(errors_mm)), "mm", "<= 1")
        yield Figure(
            "ideal depth against rays within 8 m, 95th percentile", float(np.quantile(errors_mm, 0.95)), "mm", ""
        )
        content |= {"mode": "disparity-noise"}
        noisy_m, true_m = _depths(content, renderer, snapshot)
        description = _DESCRIBE.validate_python(content)
        rig = description.rig_sensor("stereo")
        assert isinstance(rig, StereoSensor)
        assert rig.baseline_m is not None
        per_square = description.noise.disparity_sigma_px / (rig.intrinsics.fx * rig.baseline_m)
        for low_m, high_m in ((2.0, 3.0), (3.0, 4.0), (4.0, 6.0), (6.0, 8.0)):
            at = (true_m >= low_m) & (true_m < high_m) & (noisy_m > 0)
            ratio = float(np.std((noisy_m - true_m)[at] / (per_square * true_m[at] ** 2)))
            yield Figure(
                f"disparity-noise: σ of depth at {low_m:g}–{high_m:g} m over z² σ_d / (f b)", ratio, "×", "<= 1.2"
            )


def _depths(content: dict, renderer: RendererOnDemand, snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    """Return depth [m] of a stereo camera, and that of rays through its pixels' centres."""
    description = _DESCRIBE.validate_python(content)
    sensor = build_sensor("stereo", description, renderer)
    reading, _ = sensor.observe(0, [snapshot], None, np.random.default_rng(0))
    rig = sensor.rig_sensor()
    assert isinstance(rig, StereoSensor)
    rays = rig.intrinsics.directions()
    length = np.linalg.norm(rays, axis=2)
    unit = (rays / length[..., None]).reshape(-1, 3) @ rig.room_from_sensor.rotation.T
    geom, distance = np.empty(len(unit), dtype=np.int32), np.empty(len(unit))
    trace_rays(snapshot, rig.room_from_sensor.translation, np.ascontiguousarray(unit), geom, distance)
    return reading.observation.depth_m, distance.reshape(length.shape) / length


def four_cameras() -> Iterator[Figure]:
    """Four cameras of 320 × 240 at 20 Hz, three people and the floor, recorded: simulated time over time spent."""
    from twin.recording.writer import BagWriter

    scenario = load_scenario("home-cameras", ["duration_s=6", "background=none"])
    with tempfile.TemporaryDirectory() as folder, Simulation(scenario) as simulation:
        with BagWriter(Path(folder) / "recording.mcap", simulation.rig) as bag:
            deliveries = simulation.deliveries()
            first = next(deliveries)  # what is made once, buffers and bodies, is start-up
            bag.observation(first.encoded, first.arrival_ns)
            start = time.perf_counter()
            for delivered in deliveries:
                bag.observation(delivered.encoded, delivered.arrival_ns)
            spent_s = time.perf_counter() - start
        costs = simulation.sensor_costs()
    yield Figure("four cameras at 20 Hz and the floor, recorded", scenario.duration_s / spent_s, "× real time", ">= 1")
    mean_ms = [costs[name]["ms_mean"] for name in costs if name.startswith("camera")]
    yield Figure(
        "four cameras: a picture, noise included", float(np.mean([each for each in mean_ms if each])), "ms", ""
    )
