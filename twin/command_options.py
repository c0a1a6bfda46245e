"""Arguments and options shared by several commands, as typer declares them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from trackers.errors import InputError
from trackers.user_input.plain_data import parse_number
from twin import models
from twin.messages import printable

_MOST_WHOLE = 2**63 - 1
"""Largest whole number that files and tables hold."""


class WrongNumber(typer.BadParameter):
    """Value of a numeric option that is not one: a sentence that names option, value and what is valid."""

    def format_message(self) -> str:
        """Return the sentence alone."""
        return self.message


def number(option: str, help_: str, *, metavar: str, least: float | None = None) -> Any:
    """Declare an option that takes a finite number, as files do: no blanks, underscores or other digits than 0 to 9."""
    expected = "a number" if least is None else f"a number of {least:g} or more"

    def is_valid(value: float) -> bool:
        return least is None or value >= least

    def parse(text: Any) -> float:
        value = parse_number(text) if isinstance(text, str) else text
        if value is None or not is_valid(value):
            raise WrongNumber(f"{option} {text}: {_meant(text, is_valid)}{expected} is expected")
        return float(value)

    return typer.Option(option, metavar=metavar, help=help_, parser=parse)


def _meant(text: Any, is_valid: Callable[[float], bool]) -> str:
    """Return a hint where a text is a valid number to Python alone, as 1_0 and 010 are, or a whole one with a fraction of 0."""
    try:
        plain = f"{float(text):.15g}"
    except ValueError:
        return ""
    value = parse_number(plain)
    return f"did you mean {plain}? " if value is not None and plain != text and is_valid(value) else ""


def whole_number(
    option: str, help_: str, *, least: int = 0, most: int = _MOST_WHOLE, metavar: str = "N", hidden: bool = False
) -> Any:
    """Declare an option that takes a whole number in digits, from `least` to `most`."""

    def is_valid(value: float) -> bool:
        return isinstance(value, int) and least <= value <= most

    def parse(text: Any) -> int:
        value = parse_number(text) if isinstance(text, str) else text
        if isinstance(value, int) and is_valid(value):
            return value
        is_large = isinstance(value, int) and value > most
        valid = f"from {least} to {most}" if is_large or most < _MOST_WHOLE else f"of {least} or more"
        raise WrongNumber(f"{option} {text}: {_meant(text, is_valid)}a whole number {valid} is expected")

    return typer.Option(option, metavar=metavar, help=help_, parser=parse, hidden=hidden)


def _each_path_once(changes: list[str] | None) -> list[str] | None:
    """Raise InputError where two of the changes, 'path=value' texts, are of one field: the first would have no effect."""
    first: dict[str, str] = {}
    for change in changes or ():
        path = change.partition("=")[0].strip()
        if path in first:
            raise InputError(f"--set {first[path]}, --set {change}: are of one field; each field once is expected")
        first[path] = change
    return changes


def _lift_limits(is_asked: bool) -> bool:
    """Lift the limits of this process and its workers for --no-limits."""
    from trackers.user_input.text_file import lift_limits

    if is_asked:
        lift_limits()
    return is_asked


def _allow_room_root(folder: Path | None) -> Path | None:
    """Let rooms read files of the folder that --room-root names, here and in workers."""
    from twin.room.files import allow_room_root

    if folder is not None:
        allow_room_root(folder)
    return folder


def completed_from(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return what completes these names in a shell, which completes paths by itself."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def shipped(*folders: str) -> Callable[[str], list[str]]:
    """Return what completes the names of what is shipped in these folders, of models, in a shell."""
    return completed_from(lambda: [name for folder in folders for name in models.names(folder)])


def presets() -> Iterable[str]:
    """Return the names of trackers, for a shell."""
    from trackers.presets import available

    return available()


def _with_rules() -> Iterable[str]:
    from trackers.presets import PRESETS

    return (name for name, preset in PRESETS.items() if preset.rules)


PARTS = "scenarios", "rooms", "trackers", "sensors", "suites", "studies", "faults"
CheckedTracker = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Check a tracker instead: a preset or module:Class.",
        autocompletion=completed_from(presets),
    ),
]
ListedPart = Annotated[
    str | None,
    typer.Argument(help=f"One of {', '.join(PARTS)}; default: all.", autocompletion=completed_from(lambda: PARTS)),
]
RulesOf = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Print the rules of a paper's own system (e.g. laser-fisheye-imm-paper) as a table: stated by the paper, filled "
        "where it is silent, chosen where it is empirical.",
        autocompletion=completed_from(_with_rules),
    ),
]
OptionsOf = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Print the options of a tracker, a preset or module:Class, as a table: default, unit, meaning.",
        autocompletion=completed_from(presets),
    ),
]
ScenarioName = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario (see `twin list`) or path of a YAML file.", autocompletion=shipped("scenarios")
    ),
]


def _set(what: str) -> Any:
    return typer.Option("--set", metavar="PATH=VALUE", callback=_each_path_once, help=what)


Set = Annotated[list[str] | None, _set("Change a field, e.g. sensors.waist.rate_hz=20. May be repeated.")]
SetOfScenario = Annotated[list[str] | None, _set("Change a field of the scenario. Repeatable.")]
SetOfCases = Annotated[list[str] | None, _set("Change a field in every case, e.g. a tracker's. Repeatable.")]
Seed = Annotated[int | None, whole_number("--seed", "Seed of all randomness; default: the scenario's.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; default: out/<scenario>-<seed>.")]
Duration = Annotated[float | None, number("--duration", "Seconds to simulate; default: the scenario's.", metavar="S")]
Trackers = Annotated[
    list[str] | None,
    typer.Option(
        "--tracker",
        metavar="NAME",
        help="A preset, one the scenario defines, or module:Class. Repeatable.",
        autocompletion=completed_from(presets),
    ),
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="Run the classes (module:Class) that the scenario itself names.")
]
Rig = Annotated[Path | None, typer.Option(help="rig.yaml: which topic is which sensor, and where it is.")]
Environment = Annotated[
    Path | None, typer.Option(metavar="FILE.npz", help="Prior of the room for trackers, made by `twin environment`.")
]
NoVideo = Annotated[bool, typer.Option("--no-video", help="Write no preview.mp4.")]
NoLimits = Annotated[
    bool,
    typer.Option(
        "--no-limits",
        callback=_lift_limits,
        help="Make, and read, even what is larger than limits meant to catch mistakes and attacks.",
    ),
]
RoomRoot = Annotated[
    Path | None,
    typer.Option(
        "--room-root",
        metavar="DIR",
        callback=_allow_room_root,
        help="Let rooms read files of this folder too; without it, of the room's own alone.",
    ),
]
NoImages = Annotated[bool, typer.Option("--no-images", help="Leave the cameras out: no rendering at all.")]
Truth = Annotated[
    str,
    typer.Option(
        "--truth",
        metavar="all|positions",
        help="What to find out of the truth: all, or where people are and nothing that costs more.",
    ),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", help="Say on stderr what cost time that it need not, such as pictures drawn whole.")
]


def overrides(
    changes: list[str] | None,
    seed: int | None = None,
    duration_s: float | None = None,
    environment: Path | None = None,
) -> list[str]:
    """Collect `--set`, `--seed`, `--duration` and `--environment` as changes of a scenario, 'path=value' texts.

    Raises InputError where `--set` sets what another option does, and for a missing environment.
    """
    from twin.run.inputs import environment_change

    options = [("--seed", "seed", seed), ("--duration", "duration_s", duration_s)]
    for option, path, value in (*options, ("--environment", "prior.environment", environment)):
        for change in changes or ():
            if value is not None and change.partition("=")[0].strip() == path:
                raise InputError(f"{option} {value}, --set {change}: are of one field; one of the two is expected")
    extra = [f"{path}={value}" for _, path, value in options if value is not None]
    return [*(changes or []), *extra, *environment_change(environment)]


Jobs = Annotated[
    int | None,
    whole_number("--jobs", "Processes; default: one a core. 1: in this process, no time limit holds.", least=1),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://host:8786, instead of --jobs.")
]
Resource = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=N", help="What a case needs of a worker, e.g. GPU=1 (a Dask resource). Repeatable."),
]


def command_group(help_: str) -> typer.Typer:
    """Make a group of commands, which prints its help where it is called without one."""
    options = {"help_option_names": ["-h", "--help"]}
    group = typer.Typer(help=help_, invoke_without_command=True, rich_markup_mode=None, context_settings=options)

    @group.callback()
    def help_if_alone(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            typer.echo(context.get_help())

    return group


def print_listed(title: str, entries: Mapping[str, str]) -> None:
    """Print a table on a terminal; else one line per entry, of any length, for other programs."""
    if not sys.stdout.isatty():
        typer.echo(title)
        column = max(map(len, entries)) + 2
        for name, description in entries.items():
            typer.echo(printable(f"  {name:{column}}{description}".rstrip()))
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from twin.console import PlainConsole

    table = Table(box=SIMPLE_HEAD, padding=(0, 1))
    table.add_column(title, no_wrap=True)
    table.add_column("")
    for name, description in entries.items():
        table.add_row(name, description)
    PlainConsole().print(table)
