"""`twin reproduce`: published figures, theirs beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

FIGURE_7, GAIT = "laser-fisheye-imm", "gait"
NAMES = (FIGURE_7, GAIT)
FEWEST_SEEDS = 2
"""One run has no spread, and so no interval."""


def reproduce(
    name: Annotated[
        str, typer.Argument(help="laser-fisheye-imm (the paper's figure 7) or gait (how people load the floor).")
    ],
    seeds: Annotated[int, typer.Option(metavar="N", help="How many runs, one a seed; of gait: bodies.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/reproduce-<name>.")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Of gait: the folder of the recording subject01_walk1_grf.mot.")
    ] = None,
) -> None:
    """Published figures, theirs beside ours."""
    from trackers.errors import InputError

    if name not in NAMES:
        raise InputError(f"reproduce: there is nothing of {name!r}; valid are {', '.join(NAMES)}")
    if seeds < FEWEST_SEEDS:
        raise InputError(f"--seeds {seeds}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected")
    if data is not None and name != GAIT:
        raise InputError(f"--data {data}: is read by `reproduce gait` only; {name} needs none")

    from twin.console import print_paths, progress
    from twin.reproduce.terminal import print_results

    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    chosen = range(seed, seed + seeds)
    with progress() as report:
        if name == GAIT:
            from twin.reproduce.gait import write_gait

            results, written = write_gait(folder, chosen, data, on_progress=report)
        else:
            from twin.reproduce.laser_fisheye_imm import write_reproduction

            results, written = write_reproduction(folder, chosen, on_progress=report)
    print_results(f"{name}, {seeds} runs", results)
    print_paths(written)
