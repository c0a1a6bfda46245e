"""`twin evaluate`: metrics of two tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from twin.options import NoLimits


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
    pairs = read_situations(situations) if situations is not None else None
    evaluation = evaluate_with_details(*tables, gate_m=gate, situations=pairs)
    print_warnings(evaluation.notes)
    sys.stderr.write(f"twin: {describe_judged(evaluation.stamps_ns, len(tables[1].frame_stamps_ns))}\n")
    typer.echo(json.dumps(evaluation.metrics, indent=2))
