"""The same recording said otherwise must give the same tracks: every tracker, every restatement, deviation and tolerance."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.figure import Figure
from benchmarks.restated import (
    CLOSE,
    EXACT,
    OTHER_SEEDS,
    REDRAWN,
    ROUNDING_M,
    UNLIKE,
    Restated,
    Scene,
    deviation_m,
    disagreement,
    redrawn_disagreement,
)
from trackers.presets import PRESETS
from trackers.tracks import TrackFrame
from twin import Simulation
from twin.scenario import load_scenario

_SAMPLING = ("vision-learning", "particle", "rgbd")
"""In the names of trackers that draw at random."""
_SCENES = {"rgbd": ("meeting-three-people", 4.0), "floor": ("home-three-people", 4.0), "": ("lab-five-people", 10.0)}


def measure() -> Iterator[Figure]:
    """Each preset on its scene: the largest deviation [m] where it must repeat itself, else the share of unlike tracks."""
    scenes = {key: _recorded(*each) for key, each in _SCENES.items()}
    for tracker in PRESETS:
        scene = scenes[next(key for key in scenes if key in tracker)]
        first = scene.frames(tracker)
        spread = max(disagreement(first, Restated(scene), scene.frames(tracker, seed)) for seed in OTHER_SEEDS)
        for name, restate in EXACT.items():
            yield _judged(tracker, name, first, restate(scene), spread)
        for name, restate in CLOSE.items():
            restated = restate(scene)
            frames = restated.scene.frames(tracker)
            judged = [frame for frame in first if not frames or frame.stamp_ns >= frames[len(frames) // 4].stamp_ns]
            unlike = disagreement(judged, restated, frames)
            yield Figure(f"{tracker}: {name}", unlike, "of the tracks", f"<= {spread + 2 * UNLIKE:.3f}")


def _judged(tracker: str, name: str, first: list[TrackFrame], restated: Restated, spread: float) -> Figure:
    if name in REDRAWN and any(each in tracker for each in _SAMPLING):
        unlike = redrawn_disagreement(first, restated, tracker)
        return Figure(f"{tracker}: {name}", unlike, "of the tracks", f"<= {spread + UNLIKE:.3f}")
    frames = restated.scene.frames(tracker)
    return Figure(f"{tracker}: {name}", deviation_m(first, restated, frames), "m", f"<= {ROUNDING_M:g}")


def _recorded(scenario: str, duration_s: float) -> Scene:
    with Simulation(load_scenario(scenario, [f"duration_s={duration_s}"])) as simulation:
        background = list(simulation.background())
        return Scene(simulation.rig, background, list(simulation))
