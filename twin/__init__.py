"""The digital twin of a room with people and sensors: observations, truth, and scores of any tracker.

    scenario = twin.load_scenario("lab-five-people")
    with twin.Simulation(scenario) as simulation: ...

What stands here is loaded when it is first used, so that importing `twin` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "InputError": "trackers.errors",
    "make_tracker": "trackers.presets",
    "track_frames": "trackers.tracks",
    "evaluate_tracks": "twin.evaluate",
    "evaluate_with_details": "twin.evaluate",
    "Recording": "twin.recording.reader",
    "read_tracks": "twin.recording.tables",
    "read_truth": "twin.recording.tables",
    "track_table": "twin.recording.tables",
    "truth_table": "twin.recording.tables",
    "run_scenario": "twin.run",
    "Scenario": "twin.scenario",
    "load_scenario": "twin.scenario",
    "Simulation": "twin.simulation",
    "stream": "twin.streams",
    "track_recording": "twin.track",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'twin' has no attribute {name!r}; it has {', '.join(sorted(_HOMES))}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOMES)
