"""`twin reproduce`: published figures, theirs beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.reproduce.registry import REPRODUCTIONS, Asked

FEWEST_SEEDS = 2
"""One run has no spread, and so no interval."""


def _takers(option: str) -> str:
    return ", ".join(name for name, each in REPRODUCTIONS.items() if option in each.takes)


def reproduce(
    name: Annotated[
        str, typer.Argument(help=" or ".join(f"{name} ({each.what})" for name, each in REPRODUCTIONS.items()) + ".")
    ],
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="How many runs in each condition, one a seed; of gait: bodies. Default: "
            + ", ".join(f"{each.n_seed} ({name})" for name, each in REPRODUCTIONS.items())
            + ".",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/reproduce-<name>.")] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help=f"Runs of figure 7 (default 100) or of one recording (30), as in the papers. ({_takers('--runs')})",
        ),
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            help=f"The suite of conditions, a name or a YAML file; default: the shipped. ({_takers('--suite')})"
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help=f"Processes; default: one a core. 1: in this process. ({_takers('--jobs')})"
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help=f"Do the rest of an interrupted reproduction. ({_takers('--resume')})")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(help=f"The folder of the recording subject01_walk1_grf.mot. ({_takers('--data')})"),
    ] = None,
) -> None:
    """Published figures, theirs beside ours."""
    from trackers.errors import InputError

    if name not in REPRODUCTIONS:
        raise InputError(f"reproduce: there is nothing of {name!r}; valid are {', '.join(REPRODUCTIONS)}")
    for option, number in (("--seeds", seeds), ("--runs", runs)):
        if number is not None and number < FEWEST_SEEDS:
            raise InputError(
                f"{option} {number}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected"
            )
    own = {"--runs": runs, "--suite": suite, "--jobs": jobs, "--resume": resume or None, "--data": data}
    reproduction = REPRODUCTIONS[name]
    for option, value in own.items():
        if value is not None and option not in reproduction.takes:
            raise InputError(f"{option}: is an option of `reproduce {_takers(option)}` only; {name} takes none")

    from twin.console import print_paths, progress
    from twin.reproduce.terminal import print_results

    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    asked = Asked(name, seed, seeds or reproduction.n_seed, runs, suite, jobs, resume, data)
    with progress() as report:
        results, written = reproduction.run(folder, asked, report)
    beyond = reproduction.beyond
    print_results(
        f"{name}, {asked.n_seed} seeds", [each for each in results if not (beyond and each.where.startswith(beyond))]
    )
    print_paths(written)
