"""`twin evaluate`: metrics of two tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
    no_limits: NoLimits = False,
) -> None:
    """Compute metrics from two tables, as JSON."""
    import json

    from trackers.errors import InputError
    from twin.console import print_warnings
    from twin.evaluate import evaluate_with_details
    from twin.recording.situation_table import read_situations
    from twin.recording.tables import MOST_TABLE_BYTES, read_tracks, read_truth

    if not 0 < gate < float("inf"):
        raise InputError(f"--gate {gate}: is not a distance; a number of metres above 0 is expected")
    how = MOST_TABLE_BYTES, frame_rate, "--frame-rate"
    tables = read_truth(truth, *how), read_tracks(tracks, *how)
    pairs = read_situations(situations) if situations is not None else None
    evaluation = evaluate_with_details(*tables, gate_m=gate, situations=pairs)
    print_warnings(evaluation.notes)
    typer.echo(json.dumps(evaluation.metrics, indent=2))
