"""`twin reproduce`: a paper's figures and tables with our results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from twin.reproduce.registry import REPRODUCTIONS, Request

FEWEST_SEEDS = 2
"""Fewest runs that give an interval."""


def _names_with(option: str) -> str:
    return ", ".join(name for name, each in REPRODUCTIONS.items() if option in each.options)


def reproduce(
    name: Annotated[
        str, typer.Argument(help=" or ".join(f"{name} ({each.summary})" for name, each in REPRODUCTIONS.items()) + ".")
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
            help=f"Runs of figure 7 (default 100) or of one recording (30), as in the papers. ({_names_with('--runs')})",
        ),
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            help=f"The suite of conditions, a name or a YAML file; default: the shipped. ({_names_with('--suite')})"
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help=f"Processes; default: one a core. 1: in this process. ({_names_with('--jobs')})"
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help=f"Do the rest of an interrupted reproduction. ({_names_with('--resume')})")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(help=f"The folder of the recording subject01_walk1_grf.mot. ({_names_with('--data')})"),
    ] = None,
) -> None:
    """Reproduce a paper's figures and tables, theirs beside ours."""
    own = {"--runs": runs, "--suite": suite, "--jobs": jobs, "--resume": resume or None, "--data": data}
    _check_options(name, {"--seeds": seeds, "--runs": runs}, own)
    from twin.console import print_paths, progress
    from twin.reproduce.results import print_results

    reproduction = REPRODUCTIONS[name]
    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    request = Request(name, seed, seeds or reproduction.n_seed, runs, suite, jobs, resume, data)
    with progress() as report:
        results, written = reproduction.run(folder, request, report)
    beyond = reproduction.beyond
    print_results(
        f"{name}, {request.n_seed} seeds", [each for each in results if not (beyond and each.where.startswith(beyond))]
    )
    print_paths(written)


def _check_options(name: str, numbers: Mapping[str, int | None], own: Mapping[str, object]) -> None:
    """Raise InputError for an unknown reproduction, too few runs, or an option that it lacks."""
    from trackers.errors import InputError

    if name not in REPRODUCTIONS:
        raise InputError(f"reproduce: unknown reproduction {name!r}; valid are {', '.join(REPRODUCTIONS)}")
    for option, number in numbers.items():
        if number is not None and number < FEWEST_SEEDS:
            raise InputError(
                f"{option} {number}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected"
            )
    for option, value in own.items():
        if value is not None and option not in REPRODUCTIONS[name].options:
            raise InputError(f"{option}: is an option of `reproduce {_names_with(option)}` only; {name} takes none")
