"""The fused tracker and its laser half in the library hall: the cost of a frame, and the people tracked in it."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.figure import Figure
from trackers.observations import Observation
from trackers.presets import make_tracker
from twin.recording.reader import Recording
from twin.run.live import run_scenario
from twin.scenario import load_scenario

_SEED, _SECONDS, _ROUNDS = 2021, 12, 3
_LASER, _FUSED = "laser-vision-learning-laser", "laser-vision-learning"


def measure() -> Iterator[Figure]:
    """CPU time of each frame, the least of some rounds: mean, 99th percentile, and of those in which nobody interacts."""
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        changes = [f"seed={_SEED}", f"duration_s={_SECONDS}"]
        run_scenario(load_scenario("library-hall", changes), trackers=(), out=out, video=False)
        bag = Recording(out / "recording.mcap")
        background, given = list(bag.background), list(bag.observations())
    least: dict[str, np.ndarray] = {}
    people: list[int] = []
    alone: list[bool] = []
    for name in (_LASER, _FUSED):
        rounds = []
        for _ in range(_ROUNDS):
            tracker = make_tracker(name, bag.rig, background, np.random.default_rng(0))
            spent, people, alone = _frames(tracker, given)
            rounds.append(spent)
        least[name] = np.min(rounds, axis=0)
    apart = np.array(alone)
    yield Figure("laser-vision-learning: people followed a frame in the hall", float(np.mean(people)), "", "")
    yield Figure(f"{_LASER}: a frame of two scans, mean", 1e3 * float(least[_LASER].mean()), "ms of CPU", "<= 3")
    yield Figure(f"{_FUSED}: a frame in the hall, mean", 1e3 * float(least[_FUSED].mean()), "ms of CPU", "<= 10")
    yield Figure(f"{_FUSED}: 99th percentile", 1e3 * float(np.quantile(least[_FUSED], 0.99)), "ms of CPU", "<= 25")
    if apart.any():
        ratio = float(least[_FUSED][apart].mean() / least[_LASER][apart].mean())
        yield Figure(f"{_FUSED}: nobody interacting, over laser only", ratio, "x", "<= 1.1")


def _frames(tracker: Any, given: list[Observation]) -> tuple[np.ndarray, list[int], list[bool]]:
    """CPU time of each frame [s], how many people it has, and whether all of them are apart."""
    spent, people, alone, since = [], [], [], 0.0
    for each in given:
        start = time.process_time()
        frames = tracker.update(each)
        since += time.process_time() - start
        if frames:
            spent.append(since)
            people.append(len(frames[-1].tracks))
            alone.append(set(tracker.situations().values()) <= {"apart"})
            since = 0.0
    return np.array(spent), people, alone
