"""Cost of a picture and a frame in `rgbd-head`, and the worth of the points sampled per ellipse."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
from distributed import LocalCluster

from benchmarks.figure import Figure
from trackers.likelihood.stereo_head import StereoHeadOptions, StereoHeads
from trackers.observations import DepthImage, Observation
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import Rig, StereoSensor
from trackers.vision.front_end import CameraFrontEnd, FrontEndOptions
from trackers.vision.head_colours import HeadColours, load_head_model
from trackers.vision.stereo_picture import StereoCamera
from twin import Simulation, load_scenario

_S = 5
_HEADS = (256, 1024, 4096)
"""Numbers of hypotheses by which it is measured what Dask workers cost and save."""


def measure() -> Iterator[Figure]:
    """CPU time on one core, `meeting-three-people`, four cameras of 320 x 240, 512 hypotheses a person."""
    cv2.setNumThreads(1)
    for n_person, bound in ((1, 6), (3, 12)):
        absent = [f"people.{name}=null" for name in ("ben", "cleo")[: 3 - n_person]]
        with Simulation(load_scenario("meeting-three-people", [f"duration_s={_S}", *absent])) as simulation:
            rig, known, seen = simulation.rig, Prior.of(simulation.background()), list(simulation)
        tracker, costs, spent = make_tracker("rgbd-head", rig, known, np.random.default_rng(0)), [], 0.0
        for observation in seen:
            start = time.process_time()
            frames = tracker.update(observation)
            spent += time.process_time() - start
            if frames and observation.t > 2:
                costs.append(1e3 * spent)
            spent = 0.0 if frames else spent
        yield Figure(f"rgbd-head, four pictures, {n_person} of them", float(np.median(costs)), "ms", f"<= {bound}")
    sensor, image = rig.sensors["stereo_1"], next(each for each in seen if each.sensor == "stereo_1" and each.t > 2)
    assert isinstance(sensor, StereoSensor)
    assert isinstance(image, DepthImage)
    model = load_head_model()
    camera = StereoCamera(CameraFrontEnd("stereo_1", sensor, list(known), FrontEndOptions()), sensor, None)
    picture = camera.pack(image)
    assert picture is not None
    likelihood = StereoHeads([camera.camera], model, StereoHeadOptions())
    heads = (
        np.random.default_rng(0)
        .normal(np.reshape([0, 0, 1.4, 0], (4, 1, 1, 1)), 0.2, (4, 1, 1, 512))
        .astype(np.float32)
    )
    tables = HeadColours.unknown(1).expected(model.common).tables
    yield Figure(
        "512 hypotheses on one picture",
        _ms(lambda: likelihood.log_likelihood([picture], heads, tables)),
        "ms",
        "<= 0.6",
    )
    images = itertools.cycle([each for each in seen if isinstance(each, DepthImage) and each.sensor == "stereo_1"])
    yield Figure("a picture made ready", _ms(lambda: camera.pack(next(images))), "ms", "")
    yield from _on_workers(rig, known, [each for each in seen if each.t < 3.5])


def _on_workers(rig: Rig, known: Prior, seen: Sequence[Observation]) -> Iterator[Figure]:
    """Measure a frame of three people with each camera on a Dask worker, and from how many hypotheses on it takes less."""
    with LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50) as cluster:
        here, there = (
            np.array([_frame_ms(rig, known, seen, {"heads": heads, "scheduler": address}) for heads in _HEADS])
            for address in (None, cluster.scheduler_address)
        )
    for heads, *ms in zip(_HEADS, here, there, strict=True):
        for where, each in zip(("here", "on four Dask workers"), ms, strict=True):
            yield Figure(f"a frame of three people, {heads} hypotheses, {where}", float(each), "ms", "")
    # both grow in proportion to the hypotheses, beyond what is the same for any number
    (slope, level), (slope_there, level_there) = (np.polyfit(_HEADS, each, 1) for each in (here, there))
    if slope > slope_there:
        even = max((level_there - level) / (slope - slope_there), 0.0)
        yield Figure("hypotheses from which four Dask workers are faster", float(even), "", "")


def _frame_ms(rig: Rig, known: Prior, seen: Sequence[Observation], options: dict[str, object]) -> float:
    """Median wall time of a frame, from the first one on that everybody is found in [ms]."""
    tracker, costs, spent = make_tracker("rgbd-head", rig, known, np.random.default_rng(0), options), [], 0.0
    for observation in seen:
        start = time.perf_counter()
        frames = tracker.update(observation)
        spent += time.perf_counter() - start
        if frames:
            costs += [1e3 * spent] if observation.t > 1.5 else []
            spent = 0.0
    tracker.finish()
    return float(np.median(costs))


def _ms(what: Callable[[], object], times: int = 200) -> float:
    """Median CPU time of a call [ms]."""
    costs = []
    for _ in range(times):
        start = time.process_time()
        what()
        costs.append(time.process_time() - start)
    return 1e3 * float(np.median(costs))
