"""Reproduction of Mori et al. for `twin reproduce camera-floor-particle`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from trackers.arrays import Array
from trackers.observations import NS_PER_S
from twin.messages import OnProgress, no_progress
from twin.recording.tables import TrackTable, TruthTable
from twin.report.palette import IDENTITY_COLOURS, INK, QUIET, data_uri, hex_colour, plot_style, to_svg
from twin.reproduce.camera_floor_particle.results import (
    ABLATION,
    BEYOND,
    CHOICE,
    COURSE,
    EXPERIMENTS,
    HOME,
    MOVEMENTS,
    NEEDED,
    OURS,
    PAIR,
    SEED,
    TIME,
    closest_pair_s,
    compare_choices,
    frame_picture,
    lowest_head_s,
    mask_results,
    read_conditions,
    results_of,
    tracker_label,
)
from twin.reproduce.registry import Outputs, Request
from twin.reproduce.results import ResultRow, format_rows, pivot_each, rows_of, write_pictures, write_reproduction
from twin.reproduce.suite_runs import (
    SuiteRuns,
    case_tracks,
    case_truth,
    check_entries,
    load_seeded_suite,
    run_conditions,
)
from twin.suites.spec import Suite

_SHOWN = (("crossing", "figure 4"), ("going-back", "figure 4"), (PAIR, "one cluster"), (HOME, "figure 5"))
"""Conditions of which a frame is drawn, and its figure in the paper."""


def reproduce(folder: Path, request: Request, on_progress: OnProgress = no_progress) -> Outputs:
    """Run the suite and write results, plots, pictures of frames and the page into `folder`.

    Raises InputError for a suite without the paper's experiments, for a folder with another reproduction's runs (or the same
    one's, without `resume`), for conditions with fewer than two complete runs, and where a file cannot be written.
    """
    suite, path = load_seeded_suite(request)
    check_suite(suite, path)
    runs = run_conditions(folder, suite, path, request, on_progress)
    return write_all(folder, runs, [*mask_results(runs), *compare_choices(runs.cache, on_progress)], request.command)


def check_suite(suite: Suite, path: Path) -> None:
    """Raise InputError for a suite that lacks one of the paper's experiments, or the tracker in one."""
    check_entries(suite, path, dict.fromkeys(NEEDED, "an experiment of the paper"), [OURS])


def write_all(folder: Path, runs: SuiteRuns, more: Sequence[ResultRow], command: str) -> Outputs:
    """Write results, plots, pictures and page. Raises InputError where a file cannot be written."""
    conditions = read_conditions(runs)
    results = [*results_of(conditions), *more]
    cases = {name: runs.first_cases(name) for name in NEEDED}
    course = {tracker_label(name): case_tracks(case, runs) for name, case in cases[COURSE].items()}
    errors = [
        head_errors_since_detection(case_truth(cases[name][OURS], runs), case_tracks(cases[name][OURS], runs))
        for name in MOVEMENTS
    ]
    drawn = {"figure6": course_svg(case_truth(cases[COURSE][OURS], runs), course), "heads": heads_svg(errors)}
    pictures = {}
    for name, what in _SHOWN:
        case = cases[name][OURS]
        truth = case_truth(case, runs)
        at_s = lowest_head_s(truth) if name == HOME else closest_pair_s(truth)
        pictures[f"{name}, seed {case.seed}, {at_s:.2f} s ({what})"] = frame_picture(case, runs.cache, at_s)
    write_pictures(folder, {f"frame-{caption.split(',')[0]}": jpeg for caption, jpeg in pictures.items()})
    paths = write_reproduction(
        folder,
        command,
        "camera_floor_particle/page.html.j2",
        results,
        drawn,
        grids=pivot_each(results, EXPERIMENTS, BEYOND) | pivot_each(results, CHOICE, TIME, intervals=False),
        four_columns=format_rows(
            [each for each in rows_of(results, EXPERIMENTS) if each.paper_system or each.baseline]
        ),
        ablations=format_rows(rows_of(results, ABLATION)),
        pictures={caption: data_uri(jpeg) for caption, jpeg in pictures.items()},
        n_run=len(conditions[HOME].seeds),
        seeds=f"{conditions[HOME].seeds[0]} to {conditions[HOME].seeds[-1]}",
        not_done=runs.not_done,
        choice_seed=SEED,
    )
    return results, paths


HeadErrorsOverTime = tuple[Array, Array]
"""Time since the detection of a track [s], and the errors of the head along x, y, z there [m], (n,) and (n, 3)."""


def course_svg(truth: TruthTable, by_system: Mapping[str, TrackTable]) -> str:
    """Draw figure 6: trajectories on the floor of the straight course, one panel per system, the truth in grey."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(10, 1.9 * len(by_system)), layout="constrained")
        panels = figure.subplots(len(by_system), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
        for slot, (axes, (name, tracks)) in enumerate(zip(panels, by_system.items(), strict=True)):
            axes.plot(truth.x, truth.y, color=QUIET, linewidth=4, alpha=0.35, label="truth")
            axes.plot(tracks.x, tracks.y, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.1, label=name)
            axes.set(ylabel="y [m]", ylim=(truth.y.min() - 0.35, truth.y.max() + 0.35))
            axes.legend(loc="upper right", frameon=False, ncols=2)
        panels[-1].set_xlabel("x [m]")
        return to_svg(figure)


def heads_svg(errors: Sequence[HeadErrorsOverTime]) -> str:
    """Draw the mean absolute error of the head on each axis against time since detection, all runs together."""
    from matplotlib.figure import Figure

    since, off = np.concatenate([each[0] for each in errors]), np.abs(np.concatenate([each[1] for each in errors]))
    edges = np.arange(0.0, since.max() + 0.5, 0.5)
    bin_of = np.digitize(since, edges) - 1
    with plot_style():
        figure = Figure(figsize=(10, 3.2), layout="constrained")
        axes = figure.subplots()
        for slot, axis in enumerate("xyz"):
            means = [100 * off[bin_of == k, slot].mean() if (bin_of == k).any() else np.nan for k in range(len(edges))]
            axes.plot(edges + 0.25, means, color=hex_colour(IDENTITY_COLOURS[slot]), linewidth=1.6, label=axis)
        axes.axhline(5.0, color=INK, linewidth=0.8, linestyle=":", label="the paper, about")
        axes.set(xlabel="time since detection [s]", ylabel="mean absolute error [cm]", ylim=(0, None))
        axes.legend(loc="upper right", frameon=False, ncols=4)
        return to_svg(figure)


_GATE_M = 0.5


def head_errors_since_detection(truth: TruthTable, tracks: TrackTable) -> HeadErrorsOverTime:
    """Compute errors of heads matched within the gate, and the time since each track's first row."""
    since, off = [], []
    began = {number: tracks.stamps_ns[tracks.id == number].min() for number in np.unique(tracks.id).tolist()}
    for stamp in np.unique(tracks.stamps_ns):
        there, rows = np.flatnonzero(truth.stamps_ns == stamp), np.flatnonzero(tracks.stamps_ns == stamp)
        there = there[~np.isnan(truth.head_x[there])]
        if not there.size:
            continue
        away = np.hypot(tracks.x[rows, None] - truth.x[there], tracks.y[rows, None] - truth.y[there])
        nearest = away.argmin(axis=1)
        for row, person, distance in zip(rows, there[nearest], away.min(axis=1), strict=True):
            if distance < _GATE_M and not np.isnan(tracks.head_x[row]):
                since.append((stamp - began[int(tracks.id[row])]) / NS_PER_S)
                off.append([getattr(tracks, f"head_{k}")[row] - getattr(truth, f"head_{k}")[person] for k in "xyz"])
    return np.array(since, float), np.array(off, float).reshape(-1, 3)
