"""How well background subtraction finds people: the tracker's foreground beside the pixels that truly show them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trackers.area import Area
from trackers.camera_floor_particle.options import CameraFloorParticleOptions
from trackers.camera_floor_particle.views import CameraFrontEnds
from trackers.observations import NS_PER_S, Image
from twin.recording.reader import Recording
from twin.reproduce.camera_floor_particle.tables import BEYOND
from twin.reproduce.results import Result
from twin.reproduce.suite_runs import SuiteRuns, recording_of
from twin.suites.cache import RecordingCache
from twin.suites.expansion import Case
from twin.suites.worker import RECORDING, resolved_scenario
from twin.world.simulation import Simulation

SHOWN = ("crossing", "shadows")
"""Conditions that differ in shadows alone."""
_EVERY_S = 0.5


def mask_results(runs: SuiteRuns) -> list[Result]:
    """Recall and precision of the foreground's pixels in the first run of each of these conditions, all cameras together."""
    found = []
    for name in SHOWN:
        if name not in runs.by_condition:
            continue
        case = next(iter(next(iter(runs.by_condition[name].values())).values()))
        recall, precision = mask_quality(case, runs.cache)
        for row, share in (("of people's pixels, foreground", recall), ("of foreground, people's", precision)):
            value = 100 * share
            found.append(Result(BEYOND, f"{name}, {row}", "ours", None, value, (value, value), "%", 1))
    return found


def mask_quality(case: Case, cache: RecordingCache) -> tuple[float, float]:
    """What share of people's pixels are foreground, and what share of the foreground is people's."""
    both = people = found = 0
    with recording_of(case, cache) as entry, Simulation(resolved_scenario(case)) as simulation:
        for image, mask in _foreground(entry / RECORDING):
            true = simulation.person_images(image.stamp_ns / NS_PER_S)[image.sensor] > 0
            both, people, found = both + (mask & true).sum(), people + true.sum(), found + mask.sum()
    return float(both / people), float(both / found)


def _foreground(path: Path) -> Iterator[tuple[Image, NDArray[np.bool_]]]:
    """The tracker's foreground in each camera's pictures, one in half a second."""
    bag = Recording(path)
    area = None if bag.rig.area is None else Area(bag.rig.area)
    watchers = CameraFrontEnds(bag.rig.cameras(), list(bag.background), CameraFloorParticleOptions(), area)
    last_ns: dict[str, int] = {}
    for image in bag.observations():
        if isinstance(image, Image) and image.stamp_ns - last_ns.get(image.sensor, -NS_PER_S) >= _EVERY_S * NS_PER_S:
            last_ns[image.sensor] = image.stamp_ns
            for view in watchers.views({image.sensor: image}):
                yield image, view.mask
