"""`twin suite`, `twin study` and `twin reproduce`: many runs at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from trackers.errors import InputError, valid_names
from twin.command_options import (
    Jobs,
    NoLimits,
    Resource,
    RoomRoot,
    ScenarioName,
    Scheduler,
    SetOfCases,
    SetOfScenario,
    command_group,
    completed_from,
    number,
    overrides,
    shipped,
    whole_number,
)
from twin.commands.memory import EXIT_FELL_SHORT
from twin.reproduce.registry import REPRODUCTIONS, Request

suite_app = command_group("Many scenarios, seeds and trackers at once; and whether anything got worse.")
study_app = command_group("Where should the sensors go, how many, and what is lost with one fewer?")


@suite_app.command("run", epilog="Example: twin suite run smoke --jobs 2 --baseline models/suites/baselines/smoke.json")
def run_suite(
    suite: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped suite (see `twin list`) or path of a YAML file.", autocompletion=shipped("suites")
        ),
    ],
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
    set_: SetOfCases = None,
    seed: Annotated[
        int | None, whole_number("--seed", "Add this to every seed of the suite: other people, other noise.")
    ] = None,
    no_limits: NoLimits = False,
    room_root: RoomRoot = None,
    allow_plugins: Annotated[
        bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that the suite's files name.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/suite-<name>.")] = None,
) -> None:
    """Run every case of a suite."""
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


@suite_app.command("show", epilog="Example: twin suite show out/suite-smoke")
def show_suite(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER", help="A folder of `twin suite run`; the cases of several are pooled."),
    ],
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Verdict and means, for a README or a pull request.")
    ] = False,
    reference: Annotated[
        str | None, typer.Option(metavar="TRACKER", help="Compare with this tracker, not with the suite's reference.")
    ] = None,
) -> None:
    """Show the table of a run, finished or not, and write its page; or the tables of several runs as of one."""
    from twin.suites.gate import show_markdown, show_pooled, show_results

    if len(folders) > 1 or reference is not None:
        if markdown:
            raise InputError("--markdown: is for one folder without --reference")
        show_pooled(folders, reference)
    else:
        (show_markdown if markdown else show_results)(folders[0])


@suite_app.command("compare", epilog="Example: twin suite compare out/before out/now --out compare.html")
def compare_suite(
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


@suite_app.command("cache", epilog="Example: twin suite cache --empty")
def cache_suite(
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


Out = Annotated[Path | None, typer.Option(help="Folder for the results.")]


@study_app.command("run", epilog="Example: twin study run lab-scanner-place --jobs 2 --out out/place")
def run_study(
    study: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped study (see `twin list`) or path of a YAML file.", autocompletion=shipped("studies")
        ),
    ],
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    resource: Resource = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run, to the same results.")
    ] = False,
    seed: Annotated[
        int | None, whole_number("--seed", "Add this to every seed of the study: other people, other noise.")
    ] = None,
    allow_plugins: Annotated[
        bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that the study names.")
    ] = False,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    out: Out = None,
) -> None:
    """Search for the best placement; leaves tables, a scenario and a page to build by in out/study-<name>."""
    from twin.console import print_paths
    from twin.run.inputs import TrustedClasses, import_from_here
    from twin.studies.results import print_summary
    from twin.studies.run import run_study, write_results
    from twin.suites.cluster import parse_workers

    place = parse_workers(jobs, scheduler, resource)
    trusted = TrustedClasses(every=allow_plugins)
    import_from_here((), files_trusted=allow_plugins)
    with run_study(study, out, place, resume=resume, seed_offset=seed or 0, trusted=trusted) as (results, folder):
        files = write_results(folder, results)
    print_summary(folder)
    print_paths(files)


@study_app.command(
    "coverage", epilog="Example: twin study coverage library-hall --set sensors.west.mount.xyz='[-12.8, 0, 0.9]'"
)
def coverage_study(
    scenario: ScenarioName,
    set_: SetOfScenario = None,
    seed: Annotated[int | None, whole_number("--seed", "Seed of the people's motion; default: the scenario's.")] = None,
    beams: Annotated[
        int | None, whole_number("--beams", "A scanner sees a body that so many beams meet; default: 6.", least=1)
    ] = None,
    px_per_m: Annotated[
        float | None,
        number(
            "--px-per-m", "A camera sees at so many pixels per metre (EN 62676-4); default: 125.", metavar="N", least=1
        ),
    ] = None,
    samples: Annotated[int | None, whole_number("--samples", "Time samples of the run; default: 100.", least=1)] = None,
    former_samples: Annotated[
        int | None, whole_number("--moments", "Former name of --samples.", least=1, hidden=True)
    ] = None,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    out: Out = None,
) -> None:
    """Measure the baseline coverage of a scenario: metrics, and a page with maps."""
    from trackers.configuration import validate
    from trackers.user_input.former_options import warn_of_former_name
    from twin.console import print_paths
    from twin.scenario import load_scenario
    from twin.studies.run import print_coverage, write_coverage
    from twin.studies.spec import Coverage

    if former_samples is not None:
        warn_of_former_name("", "--moments", "--samples")
        if samples is not None:
            raise InputError(f"--moments {former_samples}, --samples {samples}: are one option; --samples is expected")
        samples = former_samples
    loaded = load_scenario(scenario, overrides(set_, seed))
    folder = out or Path("out") / f"coverage-{loaded.name}"
    given = {"beams": beams, "px_per_m": px_per_m, "samples": samples}
    asked = validate(Coverage, {name: value for name, value in given.items() if value is not None}, "study coverage")
    found = write_coverage(loaded, folder, asked)
    print_coverage(found)
    print_paths({"coverage": folder / "coverage.json", "page": folder / "coverage.html"})


@study_app.command("show", epilog="Example: twin study show out/study-lab-scanner-place")
def show_study(folder: Annotated[Path, typer.Argument(help="A folder that `twin study run` has written.")]) -> None:
    """Show the results of a finished study."""
    from twin.studies.results import print_summary

    print_summary(folder)


FEWEST_SEEDS = 2
"""Fewest runs that give an interval."""


def _names_with(option: str) -> str:
    return ", ".join(name for name, each in REPRODUCTIONS.items() if option in each.options)


def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            help=" or ".join(f"{name} ({each.summary})" for name, each in REPRODUCTIONS.items()) + ".",
            autocompletion=completed_from(lambda: REPRODUCTIONS),
        ),
    ],
    seeds: Annotated[
        int | None,
        whole_number(
            "--seeds",
            "How many runs in each condition, one a seed; of gait: bodies. Default: "
            + ", ".join(f"{each.n_seed} ({name})" for name, each in REPRODUCTIONS.items())
            + ".",
        ),
    ] = None,
    seed: Annotated[int, whole_number("--seed", "The first seed.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/reproduce-<name>.")] = None,
    runs: Annotated[
        int | None,
        whole_number(
            "--runs",
            "Runs of figure 7 (default 100) or of one recording (30), as in the papers; of fusion: subsets of the sensors (13). "
            f"({_names_with('--runs')})",
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
        whole_number(
            "--jobs", f"Processes; default: one a core. 1: in this process. ({_names_with('--jobs')})", least=1
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
    from twin.run.out_folder import check_others

    reproduction = REPRODUCTIONS[name]
    folder = out if out is not None else Path("out") / f"reproduce-{name}"
    check_others(folder, () if resume else ("report.html",), "results.json")
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
    if name not in REPRODUCTIONS:
        raise InputError(f"reproduce: unknown reproduction {name!r}; {valid_names(name, REPRODUCTIONS)}")
    for option, count in numbers.items():
        if count is not None and count < FEWEST_SEEDS:
            raise InputError(
                f"{option} {count}: is too few for an interval; a number of {FEWEST_SEEDS} or more is expected"
            )
    for option, value in own.items():
        if value is not None and option not in REPRODUCTIONS[name].options:
            raise InputError(f"{option}: is an option of `reproduce {_names_with(option)}` only; {name} takes none")
