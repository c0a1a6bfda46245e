"""Where cases run, as options of a command: so many processes here, or the workers of a Dask scheduler."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from twin.suites.run import Place

Jobs = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Processes; default: one a core. 1: in this process, no time limit holds."),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://host:8786, instead of --jobs.")
]
Resource = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=N", help="What a case needs of a worker, e.g. GPU=1 (a Dask resource). Repeatable."),
]


def place_of(jobs: int | None, scheduler: str | None, resource: list[str] | None) -> Place:
    """The place that these options name. Raises InputError where both kinds are given, or a resource is none."""
    from trackers.errors import InputError
    from twin.suites.cluster import read_resources
    from twin.suites.run import Place

    if scheduler is not None and jobs is not None:
        raise InputError(
            f"--jobs {jobs} --scheduler {scheduler}: a scheduler has its own workers; one of them is expected"
        )
    return Place(jobs, scheduler, read_resources(resource or []))
