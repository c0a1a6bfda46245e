"""`twin reproduce`: published figures, theirs beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

LASER_FISHEYE, GAIT = "laser-fisheye-imm", "gait"
NAMES = (LASER_FISHEYE, GAIT)
FEWEST_SEEDS = 2
"""One run has no spread, and so no interval."""
GAIT_BODIES = 100


def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            help="laser-fisheye-imm (the paper's figures 7 and 9 and table I, and beyond) or gait (how people load the floor)."
        ),
    ],
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="How many runs of the twin, one a seed, in each condition (default 10); of gait: bodies (default 100).",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/reproduce-<name>.")] = None,
    runs: Annotated[
        int | None,
        typer.Option(metavar="N", help="Of laser-fisheye-imm: Monte-Carlo runs of figure 7; default: the paper's 100."),
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            help="Of laser-fisheye-imm: the suite of conditions, a name or a YAML file; default: the shipped."
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Of laser-fisheye-imm: processes; default: one a core. 1: in this process."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Of laser-fisheye-imm: do the rest of an interrupted reproduction.")
    ] = False,
    data: Annotated[
        Path | None, typer.Option(help="Of gait: the folder of the recording subject01_walk1_grf.mot.")
    ] = None,
) -> None:
    """Published figures, theirs beside ours."""
    from trackers.errors import InputError

    if name not in NAMES:
        raise InputError(f"reproduce: there is nothing of {name!r}; valid are {', '.join(NAMES)}")
    for option, number in (("--seeds", seeds), ("--runs", runs)):
        if number is not None and number < FEWEST_SEEDS:
            raise InputError(
                f"{option} {number}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected"
            )
    if data is not None and name != GAIT:
        raise InputError(f"--data {data}: is read by `reproduce gait` only; {name} needs none")
    own = {"--runs": runs, "--suite": suite, "--jobs": jobs, "--resume": resume or None}
    for option, value in own.items():
        if value is not None and name != LASER_FISHEYE:
            raise InputError(f"{option}: is an option of `reproduce {LASER_FISHEYE}` only; {name} takes none")

    from twin.console import print_paths, progress
    from twin.reproduce.terminal import print_results

    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    with progress() as report:
        if name == GAIT:
            from twin.reproduce.gait import write_gait

            n_run = GAIT_BODIES if seeds is None else seeds
            results, written = write_gait(folder, range(seed, seed + n_run), data, on_progress=report)
        else:
            from twin.reproduce.laser_fisheye_imm import N_RUN, N_SEED, SUITE, Asked, write_reproduction
            from twin.reproduce.table_one import BEYOND

            asked = Asked(seed, seeds or N_SEED, runs or N_RUN, suite or SUITE, jobs, resume)
            n_run = asked.n_seed
            results, written = write_reproduction(folder, asked, on_progress=report)
            results = [each for each in results if not each.where.startswith(BEYOND)]  # those are for the page
    print_results(f"{name}, {n_run} seeds", results)
    print_paths(written)
