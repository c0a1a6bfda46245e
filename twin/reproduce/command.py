"""`twin reproduce`: a paper's figures, theirs beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

NAMES = ("laser-fisheye-imm",)
FEWEST_SEEDS = 2
"""One run has no spread, and so no interval."""


def reproduce(
    name: Annotated[str, typer.Argument(help="The paper's short name: laser-fisheye-imm (figure 7).")],
    seeds: Annotated[int, typer.Option(metavar="N", help="How many runs, one a seed.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/reproduce-<name>.")] = None,
) -> None:
    """A paper's figures, theirs beside ours."""
    from trackers.errors import InputError

    if name not in NAMES:
        raise InputError(f"reproduce: there is nothing of {name!r}; valid are {', '.join(NAMES)}")
    if seeds < FEWEST_SEEDS:
        raise InputError(f"--seeds {seeds}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected")

    from twin.console import print_paths, progress
    from twin.reproduce.laser_fisheye_imm import write_reproduction
    from twin.reproduce.terminal import print_results

    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    with progress() as report:
        results, written = write_reproduction(folder, range(seed, seed + seeds), on_progress=report)
    print_results(f"{name}, {seeds} runs", results)
    print_paths(written)
