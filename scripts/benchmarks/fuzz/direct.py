"""Mutants through the Python interface: observations straight into trackers, environments as trackers load them.

And what a suite's worker says of a case where results are needed, whichever they are.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from benchmarks.fuzz.values import FLOATS
from trackers.environment import load_environment
from trackers.feeding import track_frames
from trackers.observations import NS_PER_S, Image, LaserScan, Observation
from trackers.presets import PRESETS, make_tracker
from twin.recording.reader import Recording
from twin.recording.tables import number_cell
from twin.suites.worker import CaseResult, CaseWork, Incident

_JUMPS_S = (0.05, -0.05, 1.0, -1.0, 86_400 * 30, -86_400 * 30, 1_700_000_000, 9e9)


def track_messages(arguments: list[str]) -> None:
    """Feed the recording at arguments[0], corrupted as the seed arguments[1] says, to a tracker; its numbers must be finite."""
    recording, rng = Recording(Path(arguments[0])), Random(arguments[1])
    background, observations = list(recording.background), list(recording.observations())
    if rng.random() < 0.3:
        background = rng.choice(([], _corrupted(background, rng)))
    fed = _corrupted(observations, rng)
    tracker = make_tracker(rng.choice(list(PRESETS)), recording.rig, background, np.random.default_rng(0))
    for frame in track_frames(tracker, recording.rig, fed):
        for track in frame.tracks:
            if not np.isfinite([track.x, track.y]).all():
                raise ValueError(f"track {track.id} is at ({track.x}, {track.y})")
            number_cell(track.vx)
            number_cell(track.vy)


def _corrupted(observations: list[Observation], rng: Random) -> list[Observation]:
    """The observations with a stretch of them corrupted in one or two ways."""
    fed = list(observations)
    for _ in range(rng.choice((1, 1, 2))):
        first = rng.randrange(len(fed) + 1)
        last = rng.choice((first + 1, first + 5, len(fed)))
        how = rng.choice(("content", "content", "content", "jump", "twice", "backwards", "shuffle", "missing", "name"))
        stretch = fed[first:last]
        if how == "content":
            stretch = [_other(each, rng) for each in stretch]
        elif how == "jump":
            jump_ns = round(rng.choice(_JUMPS_S) * NS_PER_S)
            stretch = [replace(each, stamp_ns=each.stamp_ns + jump_ns) for each in stretch]
        elif how == "twice":
            stretch = [each for each in stretch for _ in range(2)]
        elif how == "backwards":
            stretch.reverse()
        elif how == "shuffle":
            rng.shuffle(stretch)
        elif how == "missing":
            stretch = []
        else:
            stretch = [replace(each, sensor=rng.choice(("nobody", "waist", "knee", "fisheye"))) for each in stretch]
        fed[first:last] = stretch
    return fed


def _other(observation: Observation, rng: Random) -> Observation:
    if isinstance(observation, LaserScan):
        names = ("angle_min_rad", "angle_increment_rad", "range_min_m", "range_max_m", "sweep_time_s")
        name = rng.choice((*names, "ranges_m", "ranges_m", "ranges_m", "ranges_m", "stamp_ns"))
        if name == "ranges_m":
            return replace(observation, ranges_m=_other_ranges(observation.ranges_m, rng))
        if name == "stamp_ns":
            return replace(observation, stamp_ns=rng.choice((0, -1, 2**62, -(2**62), observation.stamp_ns + 1)))
        return replace(observation, **{name: rng.choice(FLOATS)})
    if isinstance(observation, Image):
        shape = rng.choice(((0, 0, 3), (1, 1, 3), observation.rgb.shape, (3000, 3000, 3)))
        return replace(observation, rgb=np.full(shape, rng.randrange(256), np.uint8))
    return observation


def _other_ranges(ranges_m: Any, rng: Random) -> Any:
    numbers = np.random.default_rng(rng.randrange(2**32))
    whole = np.full_like(ranges_m, rng.choice((np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-30, 0.03, 1.0, 7.99, 3e38)))
    sized = rng.choice((0, 1, 2, ranges_m.size - 1, ranges_m.size + 1, 100_000))
    mixed = np.where(numbers.random(ranges_m.size) < 0.5, ranges_m, whole).astype(np.float32)
    random = numbers.uniform(0, 8, ranges_m.size).astype(np.float32)
    return rng.choice((whole, np.resize(ranges_m, sized), mixed, random))


def environment(arguments: list[str]) -> None:
    """Load the environment at arguments[0] and ask it what trackers ask."""
    loaded = load_environment(Path(arguments[0]))
    points = np.array([[0.0, 0.0, 1.0], [1.0, -0.5, 0.2], [1e6, 0.0, -3.0]])
    loaded.is_free(points)
    loaded.distance_to_surface(points)
    loaded.height_under(points)
    loaded.head_weight(points)
    loaded.visible(points[0], points)


def made_up(work: CaseWork) -> CaseResult:
    """A case's figures without recording or tracking it."""
    metrics = {"mota": 0.9, "motp_m": 0.06, "idf1": 0.9, "hota": 0.9, "misses": work.case.seed % 7}
    return CaseResult(metrics, (Incident(0.1, "missed", "two misses", 2.0),), {"report.html": b"a page"}, "none")
