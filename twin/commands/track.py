"""`twin track` and `twin detections`: run trackers, or their detectors, on a recording."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from twin.commands.exit_codes import exit_with_failures
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
    from twin.run.detections import write_detections
    from twin.run.inputs import environment_change, import_from_here, typed_classes

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
