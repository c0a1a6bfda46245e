"""What a picture and a moment cost `rgbd-head`, and what the points looked at in each ellipse are worth."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from benchmarks.figure import Figure
from trackers.knowledge import Knowledge
from trackers.observations import DepthImage
from trackers.presets import make_tracker
from trackers.rgbd_head.colours import HeadColours
from trackers.rgbd_head.learned import SHIPPED, load_learned
from trackers.rgbd_head.options import WeightOptions
from trackers.rgbd_head.picture import Watcher
from trackers.rig import StereoSensor
from twin import Simulation, load_scenario

_S = 5


def measure() -> Iterator[Figure]:
    """CPU time on one core, `meeting-three-people`, four cameras of 320 x 240, 512 hypotheses a person."""
    cv2.setNumThreads(1)
    for n_person, bound in ((1, 6), (3, 12)):
        gone = [f"people.{name}=null" for name in ("ben", "cleo")[: 3 - n_person]]
        with Simulation(load_scenario("meeting-three-people", [f"duration_s={_S}", *gone])) as simulation:
            rig, known, seen = simulation.rig, Knowledge.of(simulation.background()), list(simulation)
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
    learned, options = load_learned(SHIPPED), WeightOptions()
    watcher = Watcher(sensor, [each for each in known if each.sensor == "stereo_1"], learned, options)
    picture = watcher.ready(image)
    assert picture is not None
    heads = np.random.default_rng(0).normal([[[0]], [[0]], [[1.4]], [[0]]], 0.2, (4, 1, 512)).astype(np.float32)
    tables = HeadColours.unknown(1).tables(learned.common, options.colour)
    yield Figure("512 hypotheses on one picture", _ms(lambda: watcher.weights(picture, heads, tables)), "ms", "<= 0.6")
    yield Figure("a picture made ready", _ms(lambda: watcher.ready(image)), "ms", "")


def _ms(what: Callable[[], object], times: int = 200) -> float:
    """Median CPU time of a call [ms]."""
    costs = []
    for _ in range(times):
        start = time.process_time()
        what()
        costs.append(time.process_time() - start)
    return 1e3 * float(np.median(costs))
