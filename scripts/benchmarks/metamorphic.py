"""The same recording said otherwise must give the same tracks: every tracker, every restatement, deviation and tolerance."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from typing import Any

import numpy as np

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
from trackers.feeding import track_frames
from trackers.filters.gating import distances
from trackers.laser_fisheye_imm.rules import RULES
from trackers.laser_fisheye_imm.tracker import LaserFisheyeImm
from trackers.presets import PRESETS
from trackers.tracks import TrackFrame
from twin import Simulation
from twin.evaluate.summary import ospa
from twin.scenario import load_scenario
from twin.truth.truth_types import TruthFrame

Truth = Mapping[int, np.ndarray]
"""Positions (n, 2) [m] of the people by stamp [ns]."""

_SAMPLING = ("vision-learning", "particle", "rgbd", "fusion")
"""In the names of trackers that draw at random, or weigh a picture at points spread along the room's axes."""
_BAI = tuple(
    name for name, preset in PRESETS.items() if preset.target.endswith(":LaserFisheyeImm") and "-paper" in name
)
NOT_INVARIANT: Mapping[str, tuple[str, str]] = {
    "turned by 37°, moved by 1 km": (
        "velocities",
        "the paper's heading of a person at rest starts along the room's x axis, and a step along it alone is expected",
    ),
    "every other beam": (
        "arms",
        "the paper counts points: what is enough for a person, an arm or a leg is not with half the beams",
    ),
    "cut in two": (
        "leg-pairs",
        "the paper takes a second leg for a second person, who stays while anybody is near: it matters when it all begins",
    ),
}
"""Of the own rules of Bai and Takahashi, by restatement: the rule of ours that mends it, and why. Measured with that rule
instead in each of their presets."""
_SCENES = {
    "rgbd-head-paper": ("head-sequence-1", 6.0),
    "rgbd": ("meeting-three-people", 4.0),
    "floor": ("home-three-people", 4.0),
    "": ("lab-five-people", 10.0),
}
"""Scenario and length [s] by a part of the tracker's name; the paper's head tracker is for one person."""


def measure() -> Iterator[Figure]:
    """Each preset on its scene: the largest deviation [m] where it must repeat itself, else the share of unlike tracks.

    A tracker whose tracks differ from seed to seed has no tracks that fewer readings could repeat: its errors are compared.
    """
    scenes = {key: _recorded(*each) for key, each in _SCENES.items()}
    for tracker in PRESETS:
        scene, truth = scenes[next(key for key in scenes if key in tracker)]
        first = _while_all_report(scene, scene.frames(tracker))
        if not any(frame.tracks for frame in first):
            print(f"metamorphic: {tracker}: not compared, it follows nobody here", file=sys.stderr)
            continue
        spread = max(disagreement(first, Restated(scene), scene.frames(tracker, seed)) for seed in OTHER_SEEDS)
        for name, restate in EXACT.items():
            yield from _by_the_paper(tracker, name, scene, restate)
            if not _excused(tracker, name):
                yield _judged(tracker, name, first, restate(scene), spread)
        for name, restate in CLOSE.items():
            yield from _by_the_paper(tracker, name, scene, restate)
            if _excused(tracker, name):
                continue
            restated = restate(scene)
            frames = restated.scene.frames(tracker)
            judged = _after_the_start(first, frames)
            if spread > 2 * UNLIKE:
                stamps = {frame.stamp_ns for frame in judged}
                least_m = max(_error_m(scene.frames(tracker, seed), stamps, truth) for seed in (0, *OTHER_SEEDS))
                error_m = _error_m(frames, stamps, truth)
                yield Figure(f"{tracker}: {name}, mean OSPA", error_m, "m", f"<= {least_m + UNLIKE:.3f}")
                continue
            unlike = disagreement(judged, restated, frames)
            yield Figure(f"{tracker}: {name}", unlike, "of the tracks", f"<= {spread + 2 * UNLIKE:.3f}")


def _excused(tracker: str, name: str) -> bool:
    return tracker in _BAI and name in NOT_INVARIANT


def _by_the_paper(tracker: str, name: str, scene: Scene, restate: Callable[[Scene], Restated]) -> Iterator[Figure]:
    """Yield what a paper's own rule makes of a restatement, and our rule in its place."""
    if not _excused(tracker, name):
        return
    rule, why = NOT_INVARIANT[name]
    restated, by_the_paper = restate(scene), PRESETS[tracker].options
    for options, said in (
        (by_the_paper, f"not invariant: {why}"),
        (_at_default(by_the_paper, RULES[rule]), f"with our rule '{rule}'"),
    ):
        first, frames = (_tracked(each, options) for each in (scene, restated.scene))
        first = first if name in EXACT else _after_the_start(_while_all_report(scene, first), frames)
        target = f"<= {ROUNDING_M:g}" if name in EXACT and options is not by_the_paper else ""
        value = deviation_m(first, restated, frames) if name in EXACT else disagreement(first, restated, frames)
        yield Figure(f"{tracker}: {name}, {said}", value, "m" if name in EXACT else "of the tracks", target)


def _at_default(options: Mapping[str, Any], paths: Iterable[str]) -> dict[str, Any]:
    """Return a copy of the options without those at dotted paths."""
    left = deepcopy(dict(options))
    for path in paths:
        *groups, last = path.split(".")
        group = left
        for each in groups:
            group = group.get(each, {})
        group.pop(last, None)
    return left


def _tracked(scene: Scene, options: Mapping[str, Any]) -> list[TrackFrame]:
    tracker = LaserFisheyeImm(scene.rig, list(scene.background), np.random.default_rng(0), **options)
    return list(track_frames(tracker, scene.rig, scene.observations))


def _judged(tracker: str, name: str, first: list[TrackFrame], restated: Restated, spread: float) -> Figure:
    if name in REDRAWN and any(each in tracker for each in _SAMPLING):
        unlike = redrawn_disagreement(first, restated, tracker, spread + UNLIKE)
        return Figure(f"{tracker}: {name}", unlike, "of the tracks", f"<= {spread + UNLIKE:.3f}")
    frames = restated.scene.frames(tracker)
    return Figure(f"{tracker}: {name}", deviation_m(first, restated, frames), "m", f"<= {ROUNDING_M:g}")


def _while_all_report(scene: Scene, frames: list[TrackFrame]) -> list[TrackFrame]:
    """Return the frames up to the last stamp of the main sensor: one after it lacks the sensors that have ended."""
    last_ns = max(each.stamp_ns for each in scene.observations if each.sensor == scene.rig.main_sensor)
    return [frame for frame in frames if frame.stamp_ns <= last_ns]


def _after_the_start(first: list[TrackFrame], frames: list[TrackFrame]) -> list[TrackFrame]:
    """Return the frames from the stamp on at which a quarter of the others is over: everybody is confirmed by then."""
    return [frame for frame in first if not frames or frame.stamp_ns >= frames[len(frames) // 4].stamp_ns]


def _error_m(frames: list[TrackFrame], stamps: set[int], truth: Truth) -> float:
    """Return the mean OSPA (p = 1, c = 1 m) over those stamps at which the truth is known."""
    tracks = {frame.stamp_ns: np.array([(each.x, each.y) for each in frame.tracks]).reshape(-1, 2) for frame in frames}
    no_one = np.empty((0, 2))
    return float(
        np.mean([ospa(distances(truth[ns], tracks.get(ns, no_one)), 1.0, 1.0) for ns in stamps & truth.keys()])
    )


def _recorded(scenario: str, duration_s: float) -> tuple[Scene, Truth]:
    truth: list[TruthFrame] = []
    with Simulation(load_scenario(scenario, [f"duration_s={duration_s}"]), on_truth=truth.append) as simulation:
        background = list(simulation.background())
        scene = Scene(simulation.rig, background, list(simulation))
    return scene, {each.stamp_ns: np.array([(p.x, p.y) for p in each.people]).reshape(-1, 2) for each in truth}
