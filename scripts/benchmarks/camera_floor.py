"""Cost per frame of `camera-floor-particle` against people, particles and the stride of windows, pictures decoded."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import psutil

from benchmarks.figure import Figure
from trackers.observations import NS_PER_S, Observation
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rig import Rig
from twin import Simulation
from twin.reproduce.camera_floor_particle.results import standing_people

_S = 4
_MINUTES = 10
_Recorded = tuple[Rig, Prior, Sequence[Observation], int]


def measure() -> Iterator[Figure]:
    """CPU time on one core of the frames after the first second, four cameras of 320 × 240 at 20 Hz."""
    cv2.setNumThreads(1)
    few, many = _recorded(3), _recorded(10)
    cost = _cost(few)
    yield Figure("camera-floor-particle, 3 people, a frame", float(np.median(cost)), "ms", "<= 12")
    yield Figure(
        "the same, 95th percentile over the median", float(np.quantile(cost, 0.95) / np.median(cost)), "×", "<= 1.5"
    )
    all_ten = float(np.median(_cost(many)))
    yield Figure("camera-floor-particle, 10 people, a frame", all_ten, "ms", "<= 36")
    empty = float(np.median(_cost(_recorded(0))))
    per_person = [(float(np.median(cost)) - empty) / 3, (all_ten - empty) / 10]
    yield Figure("a person of ten over a person of three", per_person[1] / per_person[0], "×", "<= 1.2")
    yield Figure("camera-floor-particle, no people: masks and bins", empty, "ms", "")
    for what, options in (
        ("half the particles", {"body": {"particles": 125}, "head": {"particles": 75}}),
        ("twice the particles", {"body": {"particles": 500}, "head": {"particles": 300}}),
        ("strides of 3 and 2", {"body": {"window": {"stride": 3}}, "head": {"window": {"stride": 2}}}),
        ("strides of 8 and 4", {"body": {"window": {"stride": 8}}, "head": {"window": {"stride": 4}}}),
    ):
        yield Figure(f"the same with 3 people, {what}", float(np.median(_cost(few, options))), "ms", "")
    yield Figure(f"the same, memory after {_MINUTES} minutes over that after one", _growth(few), "×", "<= 1.02")


def _recorded(n_person: int) -> _Recorded:
    with Simulation(standing_people(n_person, _S)) as simulation:
        background = Prior.of(simulation.background())
        return simulation.rig, background, list(simulation), n_person


def _cost(recorded: _Recorded, options: Mapping[str, Any] | None = None) -> np.ndarray:
    """CPU time of each frame from the second second on [ms]."""
    rig, background, observations, n_person = recorded
    tracker, costs = make_tracker("camera-floor-particle", rig, background, np.random.default_rng(0), options), []
    spent = 0.0
    for observation in observations:
        start = time.process_time()
        frames = tracker.update(observation)
        spent += time.process_time() - start
        if frames:
            if observation.t > 1:
                costs.append(1e3 * spent / len(frames))
            spent = 0.0
    assert len(tracker.tracks()) == n_person, f"{len(tracker.tracks())} of {n_person} people are tracked"
    return np.array(costs)


def _growth(recorded: _Recorded) -> float:
    """Memory of the process after ten minutes of the same seconds again and again, over that after the first minute."""
    rig, background, observations, n_person = recorded
    tracker, process = (
        make_tracker("camera-floor-particle", rig, background, np.random.default_rng(0)),
        psutil.Process(),
    )
    kept: list[int] = []
    for again in range(_MINUTES * 60 // _S):
        for observation in observations:
            tracker.update(replace(observation, stamp_ns=observation.stamp_ns + again * _S * NS_PER_S))
        kept.append(process.memory_info().rss)
    assert len(tracker.tracks()) == n_person, f"{len(tracker.tracks())} of {n_person} people are tracked"
    return kept[-1] / kept[60 // _S - 1]
