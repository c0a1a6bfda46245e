"""`twin suite`: run a suite, look at its results, compare two runs, empty the cache."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.options import Jobs, NoLimits, Resource, RoomRoot, Scheduler

app = typer.Typer(
    name="suite",
    help="Many scenarios, seeds and trackers at once; and whether anything got worse.",
    invoke_without_command=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

EXIT_FELL_SHORT = 1

Folder = Annotated[Path, typer.Argument(help="A folder that `twin suite run` has written.")]


@app.callback()
def _alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command(epilog="Example: twin suite run smoke --jobs 2 --baseline models/suites/baselines/smoke.json")
def run(
    suite: Annotated[str, typer.Argument(help="Name of a shipped suite (see `twin list`) or path of a YAML file.")],
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    resource: Resource = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Do the rest of an interrupted run, and what failed.")
    ] = False,
    baseline: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Compare with the results in this file; exit 1 where worse.")
    ] = None,
    update_baseline: Annotated[
        bool, typer.Option("--update-baseline", help="Write the results to the --baseline file instead.")
    ] = False,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Change a field in every case, e.g. a tracker's. Repeatable."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Add this to every seed of the suite: other people, other noise.")
    ] = None,
    no_limits: NoLimits = False,
    room_root: RoomRoot = None,
    allow_plugins: Annotated[
        bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that the suite's files name.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/suite-<name>.")] = None,
) -> None:
    """Run every case of a suite."""
    from trackers.errors import InputError
    from twin.run.inputs import TrustedClasses, import_from_here, typed_classes, typed_schedulers
    from twin.suites.cluster import parse_workers
    from twin.suites.gate import run_gate

    if update_baseline and baseline is None:
        raise InputError("--update-baseline: writes to the file of --baseline; --baseline FILE is expected beside it")
    workers = parse_workers(jobs, scheduler, resource)
    typed = typed_classes(set_ or [])
    import_from_here(typed, files_trusted=allow_plugins)
    well = run_gate(
        suite,
        out,
        workers,
        resume=resume,
        baseline=baseline,
        update_baseline=update_baseline,
        seed_offset=seed or 0,
        changes=set_ or [],
        limits=not no_limits,
        trusted=TrustedClasses(typed | typed_schedulers(set_ or []), every=allow_plugins),
    )
    if not well:
        raise typer.Exit(EXIT_FELL_SHORT)


@app.command(epilog="Example: twin suite show out/suite-smoke")
def show(
    folder: Folder,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Verdict and means, for a README or a pull request.")
    ] = False,
) -> None:
    """Show the table of a run, finished or not, and write its page."""
    from twin.suites.gate import show_markdown, show_results

    (show_markdown if markdown else show_results)(folder)


@app.command(epilog="Example: twin suite compare out/before out/now --out compare.html")
def compare(
    before: Annotated[Path, typer.Argument(metavar="A", help="A run's folder, or a baseline file.")],
    now: Annotated[Path, typer.Argument(metavar="B", help="A run's folder, or a baseline file.")],
    markdown: Annotated[
        bool, typer.Option("--markdown", help="The figures that changed, as a table for a pull request.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Write a page too.")] = None,
) -> None:
    """Show what is worse and what is better in B than in A; exit 1 where something is worse."""
    from twin.suites.gate import compare_results

    if not compare_results(before, now, out, markdown=markdown):
        raise typer.Exit(EXIT_FELL_SHORT)


@app.command(epilog="Example: twin suite cache --empty")
def cache(
    empty: Annotated[bool, typer.Option("--empty", help="Remove every recording that is not in use.")] = False,
) -> None:
    """Show the folder of the recordings and how much they take."""
    from twin.models import cache_folder
    from twin.suites.cache import RecordingCache, cache_limit_bytes

    recordings = RecordingCache(cache_folder(), cache_limit_bytes())
    if empty:
        n, freed = recordings.empty()
        typer.echo(f"{n} recordings removed, {freed / 1e9:.2f} GB")
    n, held = recordings.size()
    typer.echo(
        f"{recordings.folder}: {n} recordings, {held / 1e9:.2f} GB of at most {recordings.limit_bytes / 1e9:g} GB"
    )
