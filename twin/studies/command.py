"""`twin study`: search for the best placement of sensors, measure the coverage of a scenario's own, show results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.options import Jobs, NoLimits, Resource, RoomRoot, ScenarioName, Scheduler, SetOfScenario, overrides

app = typer.Typer(
    name="study",
    help="Where should the sensors go, how many, and what is lost with one fewer?",
    invoke_without_command=True,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Out = Annotated[Path | None, typer.Option(help="Folder for the results.")]


@app.callback()
def _alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command(epilog="Example: twin study run lab-scanner-place --jobs 2 --out out/place")
def run(
    study: Annotated[str, typer.Argument(help="Name of a shipped study (see `twin list`) or path of a YAML file.")],
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    resource: Resource = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run, to the same results.")
    ] = False,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Add this to every seed of the study: other people, other noise.")
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


@app.command(epilog="Example: twin study coverage library-hall --set sensors.west.mount.xyz='[-12.8, 0, 0.9]'")
def coverage(
    scenario: ScenarioName,
    set_: SetOfScenario = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the people's motion; default: the scenario's.")
    ] = None,
    beams: Annotated[int, typer.Option(min=1, help="A scanner sees a body that so many beams meet.")] = 6,
    px_per_m: Annotated[
        float, typer.Option(min=1, help="A camera sees at so many pixels per metre (EN 62676-4).")
    ] = 125.0,
    samples: Annotated[int, typer.Option(min=1, help="Time samples of the run.")] = 100,
    former_samples: Annotated[
        int | None, typer.Option("--moments", min=1, hidden=True, help="Former name of --samples.")
    ] = None,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    out: Out = None,
) -> None:
    """Measure the baseline coverage of a scenario: metrics, and a page with maps."""
    from trackers.configuration import warn_of_former_name
    from twin.console import print_paths
    from twin.scenario import load_scenario
    from twin.studies.run import print_coverage, write_coverage

    if former_samples is not None:
        warn_of_former_name("", "--moments", "--samples")
        samples = former_samples
    loaded = load_scenario(scenario, overrides(set_, seed))
    folder = out or Path("out") / f"coverage-{loaded.name}"
    found = write_coverage(loaded, folder, beams=beams, px_per_m=px_per_m, samples=samples)
    print_coverage(found)
    print_paths({"coverage": folder / "coverage.json", "page": folder / "coverage.html"})


@app.command(epilog="Example: twin study show out/study-lab-scanner-place")
def show(folder: Annotated[Path, typer.Argument(help="A folder that `twin study run` has written.")]) -> None:
    """Show the results of a finished study."""
    from twin.studies.results import print_summary

    print_summary(folder)
