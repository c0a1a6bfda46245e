"""The baseline by the camera alone in the library hall: what a picture costs, and whom its detector finds."""

from __future__ import annotations

import tempfile
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import cv2
from person_detector.found import found
from person_detector.samples import scenes

from benchmarks.figure import Figure
from trackers.feeding import track_frames
from trackers.presets import make_tracker
from trackers.vision.person_detector import PersonModel
from twin.recording.reader import Recording
from twin.run.live import run_scenario
from twin.scenario import load_scenario

_TRACKER = "laser-vision-learning-vision"
_SEED, _SECONDS, _ROUNDS = 2020, 12, 3


def measure() -> Iterator[Figure]:
    """CPU time of a picture of about ten people, the least of some rounds; recall and precision of the detector."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        changes = [f"seed={_SEED}", f"duration_s={_SECONDS}", "sensors.west=null", "sensors.east=null"]
        run_scenario(load_scenario("library-hall", changes), trackers=(), out=out, video=False)
        bag = Recording(out / "recording.mcap")
        background, pictures = bag.background, list(bag.observations())
        spent_s = []
        for _ in range(_ROUNDS):
            tracker = make_tracker(_TRACKER, bag.rig, background)
            start = time.process_time()
            deque(track_frames(tracker, bag.rig, pictures), maxlen=0)
            spent_s.append(time.process_time() - start)
        (scene,) = scenes(out)
        recall, precision, error_m = found(scene, PersonModel.load())
    yield Figure(f"{_TRACKER}: a picture of 640 × 480 in the hall", 1e3 * min(spent_s) / len(pictures), "ms of CPU", "")
    yield Figure("detector of people in the hall: recall of who is in plain sight", recall, "", ">= 0.95")
    yield Figure("detector of people in the hall: precision", precision, "", ">= 0.95")
    yield Figure("detector of people in the hall: mean error of the position", error_m, "m", "<= 0.08")
