"""The command `twin`: one function a subcommand; what each does lives elsewhere and is imported when it is asked for."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.environment.command import environment as scan_environment
from twin.interruption import heed_interrupts
from twin.reproduce.command import reproduce
from twin.studies.command import app as studies
from twin.suites.command import app as suites

if TYPE_CHECKING:
    from twin.scenario import Scenario

EXIT_DONE, EXIT_FELL_SHORT, EXIT_BAD_INPUT, EXIT_OUR_FAULT, EXIT_INTERRUPTED = 0, 1, 2, 70, 130

app = typer.Typer(
    name="twin",
    help="Describe a room, its people and its sensors; get what the sensors would report, the truth, and any tracker's score.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ScenarioName = Annotated[
    str, typer.Argument(help="Name of a shipped scenario (see `twin list`) or path of a YAML file.")
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change a field, e.g. sensors.waist.rate_hz=20. May be repeated."),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of all randomness; default: the scenario's.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; default: out/<scenario>-<seed>.")]
Duration = Annotated[float | None, typer.Option(metavar="S", help="Seconds to simulate; default: the scenario's.")]
Trackers = Annotated[
    list[str] | None,
    typer.Option("--tracker", metavar="NAME", help="A preset, one the scenario defines, or module:Class. Repeatable."),
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that the scenario itself names.")
]
Environment = Annotated[
    Path | None, typer.Option(metavar="FILE.npz", help="What trackers may know of the room, by `twin environment`.")
]
NoVideo = Annotated[bool, typer.Option("--no-video", help="Write no preview.mp4.")]
NoLimits = Annotated[
    bool, typer.Option("--no-limits", help="Make even what is larger than limits meant to catch mistakes.")
]
NoImages = Annotated[bool, typer.Option("--no-images", help="Leave the cameras out: no rendering at all.")]


def _overrides(changes: list[str] | None, seed: int | None, duration_s: float | None) -> list[str]:
    extra = [] if seed is None else [f"seed={seed}"]
    if duration_s is not None:
        extra.append(f"duration_s={duration_s}")
    return [*(changes or []), *extra]


def _tell_size(scenario: Scenario, *, images: bool, limits: bool) -> None:
    """Say on stderr what a run will make; raise InputError where that is more than the limits, if they hold."""
    from twin.scenario.size import check_size, size_of

    if limits:
        check_size(scenario, images=images)
    sys.stderr.write(f"twin: to make: {size_of(scenario, images=images)}\n")


@app.command(epilog="Example: twin run lab-five-people --tracker laser-imm --seed 3 --set background=none")
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
    no_limits: NoLimits = False,
    allow_plugins: AllowPlugins = False,
) -> None:
    """Simulate, record, track, evaluate and report."""
    from twin.console import print_metrics, print_paths, print_warning, progress
    from twin.run.chosen_trackers import TrustedClasses, import_from_here, typed_classes, typed_schedulers
    from twin.run.knowledge import environment_change
    from twin.run.live import run_scenario
    from twin.scenario import load_scenario

    loaded = load_scenario(scenario, [*_overrides(set_, seed, duration), *environment_change(environment)])
    _tell_size(loaded, images=not no_images, limits=not no_limits)
    typed = typed_classes(set_ or [])
    import_from_here([*typed, *(tracker or [])])
    with progress() as report:
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
        )
    if result.metrics is not None:
        print_metrics(result.metrics)
    print_paths(result.files)
    _tell_failures(result.failures)


def _tell_failures(failures: Sequence[str]) -> None:
    """What plug-ins did wrong beside trackers that have results: the exit code is that of a check that fell short."""
    for failure in failures:
        sys.stderr.write(f"twin: {failure}\n")
    if failures:
        raise typer.Exit(EXIT_FELL_SHORT)


@app.command(epilog="Example: twin render lab-five-people --duration 10 --out out/ten-seconds")
def render(
    scenario: ScenarioName,
    set_: Set = None,
    seed: Seed = None,
    duration: Duration = None,
    out: Out = None,
    no_video: NoVideo = False,
    no_images: NoImages = False,
    no_limits: NoLimits = False,
) -> None:
    """Simulate and record only."""
    from twin.console import print_paths, print_warning, progress
    from twin.run.live import run_scenario
    from twin.scenario import load_scenario

    loaded = load_scenario(scenario, _overrides(set_, seed, duration))
    _tell_size(loaded, images=not no_images, limits=not no_limits)
    with progress() as report:
        result = run_scenario(
            loaded,
            trackers=[],
            out=out,
            video=not no_video,
            images=not no_images,
            on_progress=report,
            on_warning=print_warning,
        )
    print_paths(result.files)


@app.command(epilog="Example: twin track walk.bag --tracker laser-imm --rig rig.yaml --out out/walk")
def track(
    recording: Annotated[
        Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's ROS 1 or ROS 2 bag.")
    ],
    tracker: Trackers = None,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml: which topic is which sensor, and where it is.")] = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: out/<recording's name>.")] = None,
    no_video: NoVideo = False,
    bag: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help="Write a copy of the recording with the tracks in it.")
    ] = None,
) -> None:
    """Track a recording: the twin's or a robot's."""
    from twin.console import print_metrics, print_paths, print_warning, progress
    from twin.run.chosen_trackers import import_from_here, typed_classes
    from twin.run.knowledge import environment_change
    from twin.run.replay import track_recording

    import_from_here([*typed_classes(set_ or []), *(tracker or [])])
    with progress() as report:
        result = track_recording(
            recording,
            trackers=tracker or ["laser-fisheye-imm"],
            rig_path=rig,
            changes=[*(set_ or []), *environment_change(environment)],
            seed=seed,
            out=out,
            video=not no_video,
            bag_copy=bag,
            on_progress=report,
            on_warning=print_warning,
        )
    if result.metrics is not None:
        print_metrics(result.metrics)
    print_paths(result.files)
    _tell_failures(result.failures)


@app.command(epilog="Example: twin detections out/library-hall-0/recording.mcap --tracker sort --out seen.csv")
def detections(
    recording: Annotated[Path, typer.Argument(help="A bag: the twin's recording.mcap, or a robot's.")],
    tracker: Annotated[
        str, typer.Option(metavar="NAME", help="Whose detector: a preset, one the scenario defines, or module:Class.")
    ] = "sort",
    rig: Annotated[Path | None, typer.Option(help="rig.yaml: which topic is which sensor, and where it is.")] = None,
    set_: Set = None,
    environment: Environment = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="Table to write; default: stdout.")] = None,
) -> None:
    """What a tracker's detector saw, as a CSV table: t,sensors,role,x,y,variance,width in the room frame [s, m, m²]."""
    from functools import partial

    from twin.console import print_paths, print_warning
    from twin.run.chosen_trackers import import_from_here, typed_classes
    from twin.run.detections import write_detections
    from twin.run.knowledge import environment_change

    import_from_here([*typed_classes(set_ or []), tracker])
    write = partial(
        write_detections,
        recording,
        tracker=tracker,
        rig_path=rig,
        changes=[*(set_ or []), *environment_change(environment)],
        seed=seed,
        on_warning=print_warning,
    )
    if out is None:
        write(sys.stdout)
        return
    from twin.recording.whole_file import whole_file

    with whole_file(out) as file:
        write(file)
    print_paths({"detections": out})


@app.command(epilog="Example: twin evaluate out/lab-five-people-0/truth.csv out/lab-five-people-0/tracks/laser-imm.csv")
def evaluate(
    truth: Annotated[Path, typer.Argument(help="truth.csv")],
    tracks: Annotated[Path, typer.Argument(help="A tracks table.")],
    situations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="truth_situations.csv of the run, for the disposal of merges.")
    ] = None,
    gate: Annotated[float, typer.Option(metavar="M", help="A track matches a person within this distance [m].")] = 0.5,
    no_limits: Annotated[bool, typer.Option("--no-limits", help="Read tables of more than 256 MiB too.")] = False,
) -> None:
    """Metrics from two tables, as JSON."""
    import json

    from trackers.errors import InputError
    from twin.evaluate import evaluate_tracks
    from twin.recording.situations import read_situations
    from twin.recording.tables import MOST_TABLE_BYTES, read_tracks, read_truth

    if not 0 < gate < float("inf"):
        raise InputError(f"--gate {gate}: is not a distance; a number of metres above 0 is expected")
    most_bytes = None if no_limits else MOST_TABLE_BYTES
    tables = read_truth(truth, most_bytes), read_tracks(tracks, most_bytes)
    pairs = read_situations(situations) if situations is not None else None
    typer.echo(json.dumps(evaluate_tracks(*tables, gate_m=gate, situations=pairs), indent=2))


@app.command(name="list", epilog="Example: twin list")
def list_() -> None:
    """What there is: scenarios, rooms, trackers, sensors, faults."""
    from trackers.presets import available
    from twin import models

    typer.echo("scenarios")
    for name in models.names("scenarios"):
        typer.echo(f"  {name:24}{models.first_description(name)}")
    typer.echo("rooms")
    for name in models.names("rooms"):
        typer.echo(f"  {name}")
    typer.echo("trackers")
    for name, preset in available().items():
        typer.echo(f"  {name:24}{preset.description}")
    typer.echo("sensors")
    for name, description in models.SENSOR_KINDS.items():
        typer.echo(f"  {name:24}{description}")
    typer.echo("suites")
    for name in models.names("suites"):
        typer.echo(f"  {name}")
    typer.echo("studies")
    for name in models.names("studies"):
        typer.echo(f"  {name}")
    typer.echo("faults")
    for name, description in models.FAULTS.items():
        typer.echo(f"  {name:24}{description}")


@app.command(epilog="Example: twin schema > scenario.schema.json")
def schema(
    kind: Annotated[str, typer.Argument(help="'scenario', 'suite', 'study' or 'rig'.")] = "scenario",
) -> None:
    """The JSON schema of a scenario, a suite, a study or a rig, for editors."""
    import json

    from trackers.errors import InputError

    if kind == "scenario":
        from twin.scenario.load import ScenarioFile as Described
    elif kind == "suite":
        from twin.suites.description import Suite as Described
    elif kind == "study":
        from twin.studies.description import Study as Described
    elif kind == "rig":
        from trackers.rig import Rig as Described
    else:
        raise InputError(f"schema: there is none of {kind!r}; valid are scenario, suite, study, rig")
    typer.echo(json.dumps(Described.model_json_schema(), indent=2))


@app.command(epilog="Example: twin check")
def check() -> None:
    """Can this machine render: renderer, versions, frame time; and what to do if not."""
    from twin.check import check_machine

    for line in check_machine():
        typer.echo(line)


app.add_typer(suites, name="suite")
app.add_typer(studies, name="study")
app.command(epilog="Example: twin environment home-three-people --out out/home.npz")(scan_environment)
app.command(epilog="Example: twin reproduce laser-fisheye-imm --seeds 10 --jobs 2")(reproduce)


@app.command(
    epilog="Example: twin view everyday --people --out people.png; twin view everyday --video people.mp4 --to 20"
)
def view(
    scenario: ScenarioName,
    at: Annotated[float, typer.Option(metavar="S", help="The moment to look at [s].")] = 0.0,
    people: Annotated[bool, typer.Option("--people", help="Everybody from all sides, and everything they do.")] = False,
    video: Annotated[Path | None, typer.Option(metavar="FILE.mp4", help="Write a video by a free camera.")] = None,
    from_: Annotated[float, typer.Option("--from", metavar="S", help="Where the video begins [s].")] = 0.0,
    to: Annotated[
        float | None, typer.Option(metavar="S", help="Where it ends [s]; default: with the scenario.")
    ] = None,
    follow: Annotated[str | None, typer.Option(metavar="NAME", help="Whom the video's camera follows.")] = None,
    no_limits: NoLimits = False,
    set_: Set = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="The picture to write; default: view.png or people.png.")] = None,
) -> None:
    """A look inside: the room and every sensor's view at one moment; its people (--people); a video of them (--video)."""
    from twin.console import print_paths, print_warnings, progress
    from twin.scenario import load_scenario
    from twin.scenario.size import check_size
    from twin.view import check_choice, write_people, write_video, write_view

    check_choice(at=at, people=people, video=video, start_s=from_, end_s=to, follow=follow, out=out)
    loaded = load_scenario(scenario, _overrides(set_, seed, None))
    if not no_limits:
        check_size(loaded)
    if video is not None:
        with progress() as report:
            write_video(loaded, video, start_s=from_, end_s=to, follow=follow, on_progress=report)
        print_paths({"video": video})
    elif people:
        path = out or Path("people.png")
        with progress() as report:
            found = write_people(loaded, path, on_progress=report)
        for occasion in found:
            typer.echo(str(occasion))
        print_paths({"people": path})
    else:
        path = out or Path("view.png")
        print_warnings(write_view(loaded, at, path))
        print_paths({"view": path})


def main() -> None:
    """Run the command line; every way out has its exit code (see the README)."""
    from trackers.errors import InputError, PlugInError

    # Small matrices everywhere: threads of BLAS would only get in the way of the work beside them.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Pictures are drawn through EGL here, whatever other programs of the user's draw with.
    os.environ.pop("MUJOCO_GL", None)
    heed_interrupts()
    try:
        _check_none_is_empty(sys.argv[1:])
        code = app(standalone_mode=False)
        if code == EXIT_INTERRUPTED:  # typer's word for Ctrl-C
            sys.stderr.write("twin: interrupted; no file was left half-written under its final name\n")
        sys.exit(code if isinstance(code, int) else EXIT_DONE)
    except InputError as error:
        _fail(str(error))
    except PlugInError as error:
        _fail(str(error), EXIT_FELL_SHORT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(EXIT_DONE)
    except OSError as error:
        if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            _fail(f"{error.filename}: {error.strerror}; the path of a file or folder is expected")
        if error.errno not in (errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EDQUOT, errno.ENOTDIR, errno.EISDIR):
            _our_fault()
        _fail(f"{error.filename or 'output'}: {error.strerror}; a folder that can be written, with space, is expected")
    except Exception as error:
        if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # a usage error of click's
            _fail(error.format_message())  # pyright: ignore[reportAttributeAccessIssue]
        _our_fault()


def _check_none_is_empty(arguments: Sequence[str]) -> None:
    """Raise InputError for an empty argument: an empty path would mean the current folder."""
    from trackers.errors import InputError

    for before, argument in pairwise(["", *arguments]):
        if argument == "" or re.fullmatch("--[a-z-]+=", argument):
            named = argument.removesuffix("=") or (before if before.startswith("-") else f"after {before or 'twin'!r}")
            raise InputError(f"{named}: an argument is empty; a name, path or value is expected")


def _fail(message: str, code: int = EXIT_BAD_INPUT) -> None:
    sys.stderr.write(f"twin: {message}\n")
    sys.exit(code)


def _our_fault() -> None:
    import traceback

    traceback.print_exc()
    sys.stderr.write("twin: this is a fault of ours; please report it with the lines above and the scenario file\n")
    sys.exit(EXIT_OUR_FAULT)


if __name__ == "__main__":
    main()
