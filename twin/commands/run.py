"""`twin run` and `twin render`: simulate a scenario, with or without trackers; `twin environment`: scan its empty room."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackers.errors import InputError, valid_names
from trackers.user_input.plain_data import parse_number
from twin.command_options import (
    AllowPlugins,
    Duration,
    Environment,
    NoImages,
    NoLimits,
    NoVideo,
    Out,
    RoomRoot,
    ScenarioName,
    Seed,
    Set,
    SetOfScenario,
    Trackers,
    Truth,
    Verbose,
    number,
    overrides,
)
from twin.commands.memory import exit_with_failures, loading
from twin.messages import no_warning

if TYPE_CHECKING:
    from twin.run.live import TruthKept
    from twin.scenario import Scenario


def run(
    scenario: ScenarioName,
    tracker: Trackers = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    duration: Duration = None,
    out: Out = None,
    no_video: NoVideo = False,
    no_images: NoImages = False,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    allow_plugins: AllowPlugins = False,
    truth: Truth = "all",
    verbose: Verbose = False,
) -> None:
    """Simulate, record, track, evaluate and report."""
    with loading():
        from twin.console import print_metrics, print_paths, print_warning, progress
        from twin.run.inputs import (
            TrustedClasses,
            import_from_here,
            typed_classes,
            typed_schedulers,
            unused_changes,
        )
        from twin.run.live import run_scenario
        from twin.scenario import load_scenario

    loaded = load_scenario(scenario, overrides(set_, seed, duration, environment))
    planned = _planned(loaded, images=not no_images)
    typed = typed_classes(set_ or [])
    import_from_here([*typed, *(tracker or [])], files_trusted=allow_plugins)
    for warning in unused_changes(set_ or [], tracker) if tracker else ():
        print_warning(warning)
    with progress(planned) as report:
        result = run_scenario(
            loaded,
            trackers=tracker,
            out=out,
            video=not no_video,
            images=not no_images,
            trusted=TrustedClasses(typed | typed_schedulers(set_ or []), every=allow_plugins),
            source=scenario,
            on_progress=report,
            on_warning=print_warning,
            truth=_kept_truth(truth),
            on_note=_print_note if verbose else no_warning,
        )
    if result.metrics is not None:
        print_metrics(result.metrics)
    print_paths(result.files)
    exit_with_failures(result.failures)


def render(
    scenario: ScenarioName,
    set_: Set = None,
    seed: Seed = None,
    duration: Duration = None,
    out: Out = None,
    no_video: NoVideo = False,
    no_images: NoImages = False,
    room_root: RoomRoot = None,
    no_limits: NoLimits = False,
    truth: Truth = "all",
    verbose: Verbose = False,
) -> None:
    """Simulate and record only."""
    with loading():
        from twin.console import print_paths, print_warning, progress
        from twin.run.live import run_scenario
        from twin.scenario import load_scenario

    loaded = load_scenario(scenario, overrides(set_, seed, duration))
    planned = _planned(loaded, images=not no_images)
    with progress(planned) as report:
        result = run_scenario(
            loaded,
            trackers=[],
            out=out,
            video=not no_video,
            images=not no_images,
            on_progress=report,
            on_warning=print_warning,
            truth=_kept_truth(truth),
            on_note=_print_note if verbose else no_warning,
        )
    print_paths(result.files)


def _kept_truth(name: str) -> TruthKept:
    if name == "all" or name == "positions":
        return name
    raise InputError(f"--truth {name}: is not known; all or positions is expected")


def _print_note(note: str) -> None:
    sys.stderr.write(f"twin: {note}\n")


def _planned(scenario: Scenario, *, images: bool) -> str:
    """Return a line with the size of a run; raise InputError above the limits, if they hold."""
    from twin.scenario.run_size import check_size, size_of

    check_size(scenario, images=images)
    return f"twin: planned: {size_of(scenario, images=images)}"


_NOISE = ("off", "default", "worse")


def environment(
    scenario: ScenarioName,
    station: Annotated[
        list[str] | None,
        typer.Option(
            "--station", metavar="X,Y[,Z]", help="Place of the tripod [m]; Z 1.2. Repeatable; default: chosen."
        ),
    ] = None,
    voxel: Annotated[float | None, number("--voxel", "Side of a voxel [m]; default: 0.05.", metavar="M")] = None,
    noise: Annotated[str, typer.Option(help="The scanner's errors: off, default or worse.")] = "default",
    no_limits: NoLimits = False,
    room_root: RoomRoot = None,
    set_: SetOfScenario = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="The file to write, .npz; default: out/<room>.npz.")] = None,
    cloud: Annotated[Path | None, typer.Option(help="Write the point cloud too, as .ply.")] = None,
) -> None:
    """Scan the empty room with a tilting scanner: walls, furniture and free space, in a file for trackers."""
    from trackers.environment import EnvironmentOptions
    from twin.console import print_paths, progress
    from twin.environment.run import write_environment
    from twin.scenario import load_scenario

    if noise not in _NOISE:
        raise InputError(f"--noise {noise}: there is no such noise; {valid_names(noise, _NOISE)}")
    if voxel is not None and not 0.01 <= voxel <= 0.5:
        raise InputError(f"--voxel {voxel:g}: is not the side of a voxel; 0.01 to 0.5 m is expected")
    stations = [_point(text) for text in station or []]
    options = EnvironmentOptions() if voxel is None else EnvironmentOptions(voxel_m=voxel)
    with progress() as report:
        files = write_environment(
            load_scenario(scenario, overrides(set_, seed)),
            stations,
            noise=noise,
            options=options,
            out=out,
            cloud_path=cloud,
            on_progress=report,
        )
    print_paths(files)


def _point(text: str) -> tuple[float, ...]:
    """Parse 'X,Y' or 'X,Y,Z'; raise InputError for anything else."""
    numbers = [parse_number(part.strip()) for part in text.split(",")]
    place = tuple(float(each) for each in numbers if each is not None)
    if len(place) not in (2, 3) or len(place) < len(numbers):
        raise InputError(f"--station {text}: is no place; X,Y or X,Y,Z [m] is expected, 1.5,0.8 for instance")
    return place
