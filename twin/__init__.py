"""Digital twin of a room with people and sensors: observations, truth, and the evaluation of any tracker.

    scenario = twin.load_scenario("lab-five-people")
    with twin.Simulation(scenario) as simulation: ...

What stands here is loaded when it is first used, so that importing `twin` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what editors and type checkers see; a test holds it against the table below
    from trackers.errors import InputError as InputError
    from trackers.feeding import track_frames as track_frames
    from trackers.presets import make_tracker as make_tracker
    from twin.evaluate import evaluate_tracks as evaluate_tracks, evaluate_with_details as evaluate_with_details
    from twin.recording.reader import Recording as Recording
    from twin.recording.tables import (
        read_tracks as read_tracks,
        read_truth as read_truth,
        track_table as track_table,
        truth_table as truth_table,
    )
    from twin.run.live import run_scenario as run_scenario
    from twin.run.replay import track_recording as track_recording
    from twin.scenario import Scenario as Scenario, load_scenario as load_scenario
    from twin.streams import stream as stream
    from twin.world.simulation import Simulation as Simulation

_HOMES = {
    "InputError": "trackers.errors",
    "make_tracker": "trackers.presets",
    "track_frames": "trackers.feeding",
    "evaluate_tracks": "twin.evaluate",
    "evaluate_with_details": "twin.evaluate",
    "Recording": "twin.recording.reader",
    "read_tracks": "twin.recording.tables",
    "read_truth": "twin.recording.tables",
    "track_table": "twin.recording.tables",
    "truth_table": "twin.recording.tables",
    "run_scenario": "twin.run.live",
    "Scenario": "twin.scenario",
    "load_scenario": "twin.scenario",
    "Simulation": "twin.world.simulation",
    "stream": "twin.streams",
    "track_recording": "twin.run.replay",
}

_DISTRIBUTION = "roomtwin"

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def other_trackers() -> str | None:
    """Describe a package `trackers` that is not ours; None for ours."""
    try:
        import trackers
    except ImportError as error:  # one of its own dependencies may be missing
        where = f"cannot be imported ({error})"
    else:
        if getattr(trackers, "DISTRIBUTION", None) == _DISTRIBUTION:
            return None
        where = f"in {trackers.__file__ or 'this environment'} is another one"
    return (
        f"the package 'trackers' {where}; that of {_DISTRIBUTION} is expected: in an environment of its own, "
        "pip install -e . in the checkout"
    )


def version_of(distribution: str) -> str:
    """Return the version of a distribution, or "unknown" where its files lie without one: a source tree, another build."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(distribution)
    except PackageNotFoundError:
        return "unknown"


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return version_of(_DISTRIBUTION)
    if name not in _HOMES:
        raise AttributeError(f"module 'twin' has no attribute {name!r}; it has {', '.join(sorted(_HOMES))}")
    if (fault := other_trackers()) is not None:
        raise ImportError(fault)
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOMES)
