"""One tracker at work: fed with observations, timed, its frames written down as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from trackers.errors import InputError
from trackers.observations import Observation
from trackers.presets import available, make_tracker
from trackers.rig import Rig
from trackers.tracks import FedTracker, Tracker, TrackFrame
from twin.recording.tables import TrackWriter, track_writer
from twin.scenario.model import TrackerChoice
from twin.streams import stream


class TrackerAtWork:
    """A tracker, the file its frames go to, and what a frame costs."""

    def __init__(self, name: str, tracker: Any, rig: Rig, writer: TrackWriter) -> None:
        self.name = name
        self.tracker = tracker
        self._fed = FedTracker(tracker, rig)
        self._writer = writer
        self._pending_ms = 0.0
        self._frame_ms: list[float] = []

    @property
    def discarded(self) -> int:
        """Observations dropped so far because they came too late or twice."""
        return self._fed.discarded

    def update(self, observation: Observation) -> list[TrackFrame]:
        """The frames that this observation completes, written and timed."""
        start = time.perf_counter()
        frames = self._fed.update(observation)
        return self._keep(frames, 1e3 * (time.perf_counter() - start))

    def finish(self) -> list[TrackFrame]:
        """The frames the tracker still held back."""
        start = time.perf_counter()
        frames = self._fed.finish()
        return self._keep(frames, 1e3 * (time.perf_counter() - start))

    def _keep(self, frames: list[TrackFrame], spent_ms: float) -> list[TrackFrame]:
        self._pending_ms += spent_ms
        for frame in frames:
            self._writer.write(frame)
        if frames:
            self._frame_ms += [self._pending_ms / len(frames)] * len(frames)
            self._pending_ms = 0.0
        return frames

    def ms_per_frame(self) -> dict[str, float | None]:
        """Mean and 95th percentile of what a frame cost [ms]; None before the first."""
        if not self._frame_ms:
            return {"mean": None, "p95": None}
        return {"mean": float(np.mean(self._frame_ms)), "p95": float(np.percentile(self._frame_ms, 95))}


def file_name(tracker: str) -> str:
    """The name of a tracker's table without its suffix: 'my_lab.tracker:Mine' becomes 'my_lab.tracker-Mine'."""
    return tracker.replace(":", "-").replace("/", "-")


@contextmanager
def trackers_at_work(
    names: Sequence[str],
    defined: Mapping[str, TrackerChoice],
    rig: Rig,
    background: Sequence[Observation],
    seed: int,
    folder: Path,
) -> Iterator[list[TrackerAtWork]]:
    """Trackers by name (as defined, or presets, or 'module:Class'), each writing `folder/<name>.csv` as the block runs.

    Raises InputError for an unknown tracker or option, or one named twice, before anything is written.
    """
    if len(set(names)) < len(names):
        raise InputError(f"--tracker {' --tracker '.join(names)}: one is named twice; each name once is expected")
    for name, choice in defined.items():
        if name not in names and (choice.preset or name) not in available() and ":" not in (choice.preset or name):
            raise InputError(
                f"trackers.{name}: there is no tracker {choice.preset or name!r}; valid are {', '.join(available())}, "
                "module:Class, or a preset: beside the options"
            )
    built = []
    for name in names:
        choice = defined.get(name, TrackerChoice())
        rng = stream(seed, "tracker", name)
        tracker = make_tracker(choice.preset or name, rig, background, rng, choice.options)
        if not isinstance(tracker, Tracker):
            raise InputError(f"--tracker {name}: has not both update(observation) and tracks(); a tracker has")
        built.append((name, tracker))
    with ExitStack() as stack:
        yield [
            TrackerAtWork(name, tracker, rig, stack.enter_context(track_writer(folder / f"{file_name(name)}.csv")))
            for name, tracker in built
        ]
