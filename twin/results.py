"""The folder a run leaves: metrics.json, the report, and what both are made of."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from twin.evaluate import Evaluation, evaluate_with_details
from twin.recording.tables import TrackTable, TruthTable, read_tracks, read_truth
from twin.recording.whole_file import whole_file
from twin.sensors.render import GlInfo
from twin.tracking import TrackerAtWork, file_name


@dataclass(frozen=True, eq=False)
class RunResult:
    """What a run left: its metrics (None where there is no truth) and its files by name."""

    metrics: dict[str, Any] | None
    files: dict[str, Path]


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Truth, tracks and figures of one run, read back from its tables."""

    truth: TruthTable | None
    tracks: dict[str, TrackTable]
    evaluations: dict[str, Evaluation] = field(default_factory=dict)


def evaluate_folder(folder: Path, trackers: Sequence[str]) -> Evaluated:
    """Evaluate the tables in a run's folder; without truth.csv there is nothing to evaluate."""
    tracks = {name: read_tracks(folder / "tracks" / f"{file_name(name)}.csv") for name in trackers}
    path = folder / "truth.csv"
    if not path.exists():
        return Evaluated(None, tracks)
    truth = read_truth(path)
    return Evaluated(truth, tracks, {name: evaluate_with_details(truth, table) for name, table in tracks.items()})


def versions(gl: GlInfo | None) -> dict[str, str | None]:
    """What a result depends on besides the scenario."""
    features = np.show_config(mode="dicts")["SIMD Extensions"]  # pyright: ignore[reportIndexIssue, reportOptionalSubscript]
    return {
        "twin": version("roomtwin"),
        "mujoco": version("mujoco"),
        "numpy": version("numpy"),
        "opencv": version("opencv-python-headless"),
        "cpu_features": " ".join(features.get("found", [])),
        "gl_renderer": gl.renderer if gl else None,
        "gl_version": gl.version if gl else None,
    }


def metrics_document(
    *,
    scenario: str,
    seed: int,
    duration_s: float,
    gl: GlInfo | None,
    realtime_factor: float,
    sensors: Mapping[str, Any],
    at_work: Sequence[TrackerAtWork],
    evaluations: Mapping[str, Evaluation],
) -> dict[str, Any]:
    """The content of metrics.json."""
    return {
        "scenario": scenario,
        "seed": seed,
        "duration_s": duration_s,
        "versions": versions(gl),
        "realtime_factor": realtime_factor,
        "sensors": dict(sensors),
        "trackers": {
            each.name: evaluations[each.name].metrics | {"ms_per_frame": each.ms_per_frame()}
            for each in at_work
            if each.name in evaluations
        },
    }


def write_json(path: Path, content: Any) -> None:
    """Write JSON that appears under its name when it is whole."""
    with whole_file(path) as stream:
        json.dump(content, stream, indent=2, allow_nan=False)
        stream.write("\n")


def remove_earlier(folder: Path, kept: Sequence[Path]) -> None:
    """Remove what an earlier run into this folder left and this one does not make anew, so that no two runs mix."""
    names = ("truth.csv", "recording.mcap", "metrics.json", "report.html", "preview.mp4", "scenario.yaml")
    for path in (*(folder / name for name in names), *(folder / "tracks").glob("*.csv")):
        if path not in kept:
            path.unlink(missing_ok=True)
