"""`twin track`, `twin detections` and `twin evaluate`: trackers, or their detectors, on a recording; metrics of two tables."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from twin.commands.memory import exit_with_failures, loading
from twin.options import Environment, NoLimits, NoVideo, Rig, Seed, Set, Trackers


def track(
    recording: Annotated[
        Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's ROS 1 or ROS 2 bag.")
    ],
    tracker: Trackers = None,
    rig: Rig = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv", help="Table of truth (t,id,x,y suffice) to evaluate against; default: the bag's."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/<recording's name>.")] = None,
    no_video: NoVideo = False,
    bag: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help="Write a copy of the recording with the tracks in it.")
    ] = None,
    no_limits: NoLimits = False,
) -> None:
    """Track a recording: the twin's or a robot's."""
    with loading():
        from twin.console import print_metrics, print_paths, print_warning, progress
        from twin.evaluate.judged_frames import describe_judged
        from twin.run.inputs import environment_change, import_from_here, typed_classes
        from twin.run.replay import track_recording

    import_from_here([*typed_classes(set_ or []), *(tracker or [])])
    with progress() as report:
        result = track_recording(
            recording,
            trackers=tracker or ["laser-fisheye-imm"],
            rig_path=rig,
            truth_path=truth,
            changes=[*(set_ or []), *environment_change(environment)],
            seed=seed,
            out=out,
            video=not no_video,
            bag_copy=bag,
            on_progress=report,
            on_warning=print_warning,
        )
    if result.metrics is not None:
        print_metrics(result.metrics)
    if truth is not None:
        for name, evaluation in result.evaluations.items():
            judged = describe_judged(evaluation.stamps_ns, evaluation.metrics["judged"]["frames_total"])
            sys.stderr.write(f"twin: {name}: {judged}\n")
    print_paths(result.files)
    exit_with_failures(result.failures)


def detections(
    recording: Annotated[Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's.")],
    tracker: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Tracker whose detector runs: a preset, one the scenario defines, or module:Class."
        ),
    ] = "sort",
    rig: Rig = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Table to write; default: stdout.")] = None,
    no_limits: NoLimits = False,
) -> None:
    """Write the detections of a tracker as CSV: t,sensors,role,x,y,variance,width in the room frame [s, m, m²]."""
    from functools import partial

    from twin.console import print_paths, print_warning
    from twin.run.inputs import environment_change, import_from_here, typed_classes
    from twin.run.tracker_runner import write_detections

    import_from_here([*typed_classes(set_ or []), tracker])
    write = partial(
        write_detections,
        recording,
        tracker=tracker,
        rig_path=rig,
        changes=[*(set_ or []), *environment_change(environment)],
        seed=seed,
        on_warning=print_warning,
    )
    if out is None:
        write(sys.stdout)
        return
    from twin.recording.atomic_file import open_atomic

    with open_atomic(out) as file:
        write(file)
    print_paths({"detections": out})


def evaluate(
    truth: Annotated[Path, typer.Argument(help="truth.csv")],
    tracks: Annotated[Path, typer.Argument(help="A tracks table.")],
    situations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="truth_situations.csv of the run, for the disposal of merges.")
    ] = None,
    gate: Annotated[float, typer.Option(metavar="M", help="A track matches a person within this distance [m].")] = 0.5,
    frame_rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Frames a second, for tables that count frames [Hz].")
    ] = None,
    format_: Annotated[
        Literal["csv", "mot"],
        typer.Option("--format", help="Tables with t,id,x,y in any order, or MOT text with places on the ground."),
    ] = "csv",
    no_limits: NoLimits = False,
) -> None:
    """Compute metrics from two tables, as JSON."""
    import json
    import sys
    from dataclasses import replace

    import numpy as np

    from trackers.errors import InputError
    from trackers.observations import NS_PER_S
    from twin.console import print_warnings
    from twin.evaluate import evaluate_with_details
    from twin.evaluate.judged_frames import describe_judged
    from twin.recording.situation_table import read_situations
    from twin.recording.tables import MOST_TABLE_BYTES, read_tracks, read_truth
    from twin.recording.truth_tables import on_clock_of_tracks
    from twin.tables.headerless import sequence_info

    if not 0 < gate < float("inf"):
        raise InputError(f"--gate {gate}: is not a distance; a number of metres above 0 is expected")
    is_mot, n_frame = format_ == "mot", 0
    if is_mot:
        rate_hz, n_frame = sequence_info(truth)
        frame_rate = frame_rate if frame_rate is not None else rate_hz
    how = MOST_TABLE_BYTES, frame_rate, "--frame-rate"
    tables = read_truth(truth, *how, mot=is_mot), read_tracks(tracks, *how, mot=is_mot)
    if is_mot:  # a frame without rows is a frame without people
        stamps = np.unique(np.concatenate([each.frame_stamps_ns for each in tables]))
        if n_frame and frame_rate is not None:
            stamps = np.union1d(stamps, [round(NS_PER_S * number / frame_rate) for number in range(1, n_frame + 1)])
        tables = replace(tables[0], frame_stamps_ns=stamps), replace(tables[1], frame_stamps_ns=stamps)
    tables = on_clock_of_tracks(tables[0], tables[1], tracks), tables[1]
    pairs = read_situations(situations) if situations is not None else None
    evaluation = evaluate_with_details(*tables, gate_m=gate, situations=pairs)
    print_warnings(evaluation.notes)
    sys.stderr.write(f"twin: {describe_judged(evaluation.stamps_ns, len(tables[1].frame_stamps_ns))}\n")
    typer.echo(json.dumps(evaluation.metrics, indent=2))
