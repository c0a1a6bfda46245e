"""Replays of one recording: the spread of table 3, the trap of figures 11 and 12, and the debug state at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackers.environment import Environment
from trackers.observations import Observation
from trackers.presets import make_tracker
from trackers.prior import Prior
from trackers.rgbd_head.tracker import DebugState
from trackers.rig import Rig
from trackers.tracks import TrackFrame
from twin.messages import OnProgress
from twin.recording.reader import Recording
from twin.recording.tables import TrackTable, TruthTable, read_truth, track_table
from twin.reproduce.results import ResultRow, SystemValue
from twin.reproduce.rgbd_head.head_errors import head_errors, spread_cm
from twin.reproduce.rgbd_head.results import CAUGHT, OURS, SPREAD, mean_of
from twin.streams import stream
from twin.suites.worker import RECORDING, TRUTH

_ALIKE = "rgbd-head-paper"
_WAYS: Mapping[str, tuple[str, bool]] = {
    "colour without environment": (f"{_ALIKE}-colour", False),
    "colour": (f"{_ALIKE}-colour", True),
    "both cues": (_ALIKE, True),
    "ours": (OURS, True),
}
"""The trap's systems: preset, and whether it is given the environment."""


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """Recording in memory, the input of every replay."""

    rig: Rig
    background: Sequence[Observation]
    observations: Sequence[Observation]
    truth: TruthTable
    environment: Environment | None

    @classmethod
    def of(cls, entry: Path, environment: Environment) -> LoadedRecording:
        """Load the recording in a folder of the cache."""
        bag = Recording(entry / RECORDING)
        return cls(bag.rig, bag.background, list(bag.observations()), read_truth(entry / TRUTH), environment)

    def start(self) -> list[dict[str, Any]]:
        """Return the head's initial true position and direction, which the paper assumes known."""
        truth = self.truth
        return [
            {
                "place": [float(truth.head_x[0]), float(truth.head_y[0]), float(truth.head_z[0])],
                "yaw_deg": float(np.degrees(truth.head_yaw[0])),
            }
        ]

    def tracker(self, preset: str, seed: int, options: Mapping[str, Any], has_environment: bool = True) -> Any:
        """Make a tracker as a run of this seed does."""
        known = Prior(self.background, self.environment if has_environment else None)
        return make_tracker(preset, self.rig, known, stream(seed, "tracker", preset), options)

    def track(self, preset: str, seed: int, options: Mapping[str, Any], has_environment: bool = True) -> TrackTable:
        """Run a tracker; return its tracks."""
        tracker = self.tracker(preset, seed, options, has_environment)
        frames: list[TrackFrame] = []
        for observation in self.observations:
            frames += tracker.update(observation)
        return track_table([*frames, *tracker.finish()])

    def debug_state(self, preset: str, seed: int, options: Mapping[str, Any], t_s: float) -> DebugState:
        """Run a tracker up to a time; return its debug state."""
        tracker = self.tracker(preset, seed, options)
        for observation in self.observations:
            frames = tracker.update(observation)
            if frames and frames[-1].stamp_ns >= t_s * 1e9:
                break
        return tracker.debug_state()


def spread_results(seen: LoadedRecording, n_run: int, on_progress: OnProgress | None) -> list[ResultRow]:
    """Compute table 3: the spread of runs on one recording with other random numbers, of ours and of the paper's system."""
    spreads = {}
    for number, (preset, options) in enumerate({OURS: {}, _ALIKE: {"start": seen.start()}}.items()):
        runs = {}
        for seed in range(n_run):
            if on_progress is not None:
                on_progress("runs of one recording", number * n_run + seed, 2 * n_run)
            runs[seed] = seen.track(preset, seed, options)
        spreads[preset] = {
            f"{axis} {name}": float(of(spread))
            for axis, spread in zip(("XY", "Z"), spread_cm(runs), strict=True)
            for name, of in (("mean", np.mean), ("largest", np.max))
        }
    printed = {"XY mean": 0.36, "XY largest": 0.68, "Z mean": 0.27, "Z largest": 0.50}
    alike = {name: SystemValue(_ALIKE, value, (value, value)) for name, value in spreads[_ALIKE].items()}
    return [
        ResultRow(SPREAD, "spread", name, printed[name], value, (value, value), "cm", n_run, alike[name])
        for name, value in spreads[OURS].items()
    ]


def trap_results(
    seen: LoadedRecording, n_run: int, on_progress: OnProgress | None
) -> tuple[list[ResultRow], dict[str, TrackTable]]:
    """Compute figures 11 and 12: the share of runs lost by the clock and out of the room; and the first run of each system."""
    found, first = [], {}
    assert seen.environment is not None
    for number, (name, (preset, has_environment)) in enumerate(_WAYS.items()):
        lost, left = np.zeros(n_run), np.zeros(n_run)
        options = {} if preset == OURS else {"start": seen.start()}
        for seed in range(n_run):
            if on_progress is not None:
                on_progress("runs of the trap", number * n_run + seed, len(_WAYS) * n_run)
            tracks = seen.track(preset, seed, options, has_environment)
            first.setdefault(name, tracks)
            lost[seed] = head_errors(seen.truth, tracks, seen.rig).lost
            places = np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z])
            left[seed] = not seen.environment.head_weight(places).all()
        for row, values in (("lost", lost), ("left the room", left)):
            found.append(ResultRow.of(CAUGHT, name, row, mean_of(100 * values, 0), "%", n_run))
    return found, first
