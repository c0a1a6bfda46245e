"""Reproduction of Suzuki et al. for `twin reproduce rgbd-head`.

One recording is replayed for the spread of table 3, the trap of figures 11 and 12, and the debug state at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Array
from trackers.environment import Environment, load_environment
from twin.environment.run import write_environment
from twin.messages import OnProgress, no_progress
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import data_uri
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import (
    ResultRow,
    SystemValue,
    format_rows,
    make_folder,
    pivot_each,
    rows_of,
    write_pictures,
    write_reproduction,
)
from twin.reproduce.rgbd_head.figures import (
    environment_svg,
    errors_svg,
    head_views,
    trajectories_svg,
    trap_svg,
    weights_picture,
)
from twin.reproduce.rgbd_head.results import (
    ABLATION,
    BEYOND,
    CAUGHT,
    CHOICE,
    EXPERIMENTS,
    FIRST,
    NEEDED,
    OURS,
    PAPER,
    SECOND,
    SPREAD,
    STREAM,
    TRAP,
    WHERE,
    head_errors,
    read_conditions,
    results_of,
    spread_cm,
)
from twin.reproduce.suite_runs import (
    LoadedRecording,
    SuiteRuns,
    case_tracks,
    case_truth,
    check_entries,
    load_seeded_suite,
    run_conditions,
)
from twin.scenario import load_scenario
from twin.suites.spec import Suite

_WAYS: Mapping[str, tuple[str, bool]] = {
    "colour without environment": (f"{PAPER}-colour", False),
    "colour": (f"{PAPER}-colour", True),
    "both cues without environment": (f"{PAPER}-no-environment", False),
    "both cues": (PAPER, True),
    "ours": (OURS, True),
}
"""The trap's systems: preset, and whether it is given the environment."""


def options_of(preset: str, truth: TruthTable) -> dict[str, Any]:
    """Return options of a system: of the paper's the head's true position and direction at the start, which it assumes known."""
    if preset == OURS:
        return {}
    place = [float(truth.head_x[0]), float(truth.head_y[0]), float(truth.head_z[0])]
    return {"start": [{"place": place, "yaw_deg": float(np.degrees(truth.head_yaw[0]))}]}


def spread_results(seen: LoadedRecording, n_run: int, on_progress: OnProgress) -> list[ResultRow]:
    """Compute table 3: the spread of runs on one recording with other random numbers, of ours and of the paper's system."""
    spreads = {}
    for number, preset in enumerate((OURS, PAPER)):
        runs, options = {}, options_of(preset, seen.truth)
        for seed in range(n_run):
            on_progress("runs of one recording", number * n_run + seed, 2 * n_run)
            runs[seed] = seen.track(preset, seed, options)
        spreads[preset] = {
            f"{axis} {name}": float(of(spread))
            for axis, spread in zip(("XY", "Z"), spread_cm(runs), strict=True)
            for name, of in (("mean", np.mean), ("largest", np.max))
        }
    printed = {"XY mean": 0.36, "XY largest": 0.68, "Z mean": 0.27, "Z largest": 0.50}
    alike = {name: SystemValue(PAPER, value, (value, value)) for name, value in spreads[PAPER].items()}
    return [
        ResultRow(SPREAD, "spread", name, printed[name], value, (value, value), "cm", n_run, alike[name])
        for name, value in spreads[OURS].items()
    ]


def trap_results(
    seen: LoadedRecording, n_run: int, on_progress: OnProgress
) -> tuple[list[ResultRow], dict[str, TrackTable]]:
    """Compute figures 11 and 12: the share of runs lost by the clock and out of the room; and the first run of each system."""
    found, first = [], {}
    assert seen.environment is not None
    for number, (name, (preset, has_environment)) in enumerate(_WAYS.items()):
        lost, left, options = np.zeros(n_run), np.zeros(n_run), options_of(preset, seen.truth)
        given = seen if has_environment else replace(seen, environment=None)
        for seed in range(n_run):
            on_progress("runs of the trap", number * n_run + seed, len(_WAYS) * n_run)
            tracks = given.track(preset, seed, options)
            first.setdefault(name, tracks)
            lost[seed] = head_errors(seen.truth, tracks, seen.rig).lost
            places = np.column_stack([tracks.head_x, tracks.head_y, tracks.head_z])
            left[seed] = not seen.environment.head_weight(places).all()
        for row, values in (("lost", lost), ("left the room", left)):
            found += ResultRow.of_runs(CAUGHT, name, row, 100 * values, "%", 0, STREAM)
    return found, first


_RUNS = 30
"""Runs of one recording, as in the paper."""
_ROOM = "head-trap"
"""Scenario whose empty room is scanned; its room is that of the suite's scenarios."""
_SHOWN_S = {FIRST: (4.0, 9.0, 15.0), SECOND: (4.0, 9.0)}
"""Times of the views of figures 6 and 8 [s]."""
_CLOCK = np.array([0.35, -2.45])
"""Place of the skin-coloured clock of the meeting room [m]."""


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Scan the room, run the suite, and write results, plots, pictures and the page into `folder`.

    Raises InputError for a suite without the paper's experiments, for a folder with another reproduction's runs (or the same
    one's, without `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    environment = scan_environment(folder, request.resume, on_progress)
    suite = suite.model_copy(update={"set": {**suite.set, "prior.environment": str(environment.resolve())}})
    runs = run_conditions(folder, suite, path, request, on_progress)
    return write_all(folder, runs, load_environment(environment), request, on_progress)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite that lacks one of the paper's experiments, or a tracker in one."""
    needed = {name: "an experiment of the paper" for name in NEEDED}
    check_entries(suite, path, needed, [OURS], {FIRST: [PAPER], SECOND: [PAPER]})


def scan_environment(folder: Path, resume: bool, on_progress: OnProgress) -> Path:
    """Scan the environment of the meeting room; a resumed reproduction keeps its own."""
    path = folder / "meeting_room.npz"
    if not (resume and path.is_file()):
        make_folder(folder)
        write_environment(load_scenario(_ROOM), [], out=path, on_progress=on_progress)
    return path


def write_all(
    folder: Path, runs: SuiteRuns, environment: Environment, request: Request, on_progress: OnProgress
) -> Outputs:
    """Write results, plots, pictures and page. Raises InputError where a file cannot be written."""
    conditions = read_conditions(runs)
    n_run = request.runs or _RUNS
    sat = LoadedRecording.of(runs.first_cases(FIRST)[OURS], runs, environment)
    results = [*results_of(conditions), *spread_results(sat, n_run, on_progress)]
    pictures = _pictures(runs, FIRST, sat) | {"figure 10": _figure_10(sat, runs)}
    pictures |= _pictures(runs, SECOND, LoadedRecording.of(runs.first_cases(SECOND)[OURS], runs, environment))
    caught = LoadedRecording.of(runs.first_cases(TRAP)[OURS], runs, environment)
    lost, ways = trap_results(caught, n_run, on_progress)
    results += lost
    drawn = {
        "figure5": environment_svg(environment),
        "figure7": _trajectories(runs, FIRST),
        "figure9": _trajectories(runs, SECOND),
        "figure11": trap_svg(caught.truth, ways, _CLOCK),
        "errors": errors_svg({name: conditions[name].errors[0] for name in (FIRST, SECOND)}),
    }
    write_pictures(folder, {name.replace(", ", "-").replace(" ", "-"): jpeg for name, jpeg in pictures.items()})
    seeds = conditions[FIRST].seeds
    return results, write_reproduction(
        folder,
        request.command,
        "rgbd_head/page.html.j2",
        results,
        drawn,
        grids=pivot_each(results, EXPERIMENTS, SPREAD, CAUGHT, BEYOND, CHOICE, WHERE),
        ablations=format_rows(rows_of(results, ABLATION)),
        pictures={caption: data_uri(jpeg) for caption, jpeg in pictures.items()},
        n_run=len(seeds),
        n_replay=n_run,
        seeds=f"{seeds[0]} to {seeds[-1]}",
        not_done=runs.not_done,
    )


def _trajectories(runs: SuiteRuns, condition: str) -> str:
    first = runs.first_cases(condition)
    cases = {"ours": first[OURS], "the paper's cues": first[PAPER]}
    truth = case_truth(cases["ours"], runs)
    return trajectories_svg(truth, {name: case_tracks(case, runs) for name, case in cases.items()})


def _pictures(runs: SuiteRuns, condition: str, seen: LoadedRecording) -> dict[str, bytes]:
    """Draw the views of figure 6 or 8."""
    tracks = case_tracks(runs.first_cases(condition)[OURS], runs)
    figure = "figure 6" if condition == FIRST else "figure 8"
    return {
        f"{figure}, {at_s:g} s": head_views(seen.observations, seen.rig, at_s, _head(tracks, at_s))
        for at_s in _SHOWN_S[condition]
    }


def _figure_10(seen: LoadedRecording, runs: SuiteRuns) -> bytes:
    """Draw the paper's two cues, in the camera nearest to the head."""
    at_s = _SHOWN_S[FIRST][1]
    head = _head(case_tracks(runs.first_cases(FIRST)[OURS], runs), at_s)
    tracker = seen.tracker(PAPER, 0, options_of(PAPER, seen.truth))
    for observation in seen.observations:
        frames = tracker.update(observation)
        if frames and frames[-1].stamp_ns >= at_s * 1e9:
            break
    state = tracker.debug_state()
    cameras = seen.rig.cameras()
    nearest = min(
        state.likelihoods, key=lambda name: float(np.linalg.norm(cameras[name].room_from_sensor.xyz - head[:3]))
    )
    return weights_picture(seen.observations, seen.rig, at_s, state, nearest)


def _head(tracks: TrackTable, at_s: float) -> Array:
    """Look up the first track's head nearest to a time."""
    row = int(np.abs(tracks.stamps_ns - at_s * 1e9).argmin())
    return np.array([tracks.head_x[row], tracks.head_y[row], tracks.head_z[row], tracks.head_yaw[row]])
