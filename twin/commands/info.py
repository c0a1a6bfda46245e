"""`twin list`, `twin schema` and `twin check`: what there is, how it is described, and whether this machine can draw it."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping
from typing import Annotated

import typer

from twin.shown import shown

_DESCRIBED = "scenarios", "suites", "studies"
_LEAST_COLUMN = 30
"""A column of text that is narrower is hard to read."""


def list_() -> None:
    """What there is: scenarios, rooms, trackers, sensors, faults."""
    from trackers.presets import available
    from twin import models

    described = {
        folder: {name: models.first_description(folder, name) for name in models.names(folder)} for folder in _DESCRIBED
    }
    parts = {
        "scenarios": described["scenarios"],
        "rooms": dict.fromkeys(models.names("rooms"), ""),
        "trackers": {name: preset.description for name, preset in available().items()},
        "sensors": models.SENSOR_KINDS,
        "suites": described["suites"],
        "studies": described["studies"],
        "faults": models.FAULTS,
    }
    for title, entries in parts.items():
        typer.echo(title)
        for line in _lines(entries, shutil.get_terminal_size().columns if sys.stdout.isatty() else None):
            typer.echo(line)


def _lines(entries: Mapping[str, str], width: int | None) -> Iterator[str]:
    """Names and descriptions in two columns, within `width` characters a line (None: a line an entry, whatever its length).

    Where a terminal has no room for two columns, a description stands under its name.
    """
    column = max(map(len, entries)) + 4
    for name, description in entries.items():
        if width is None:
            yield shown(f"  {name:{column - 2}}{description}".rstrip())
        elif width - column >= _LEAST_COLUMN:
            first, *rest = textwrap.wrap(shown(description), width - column) or [""]
            yield shown(f"  {name:{column - 2}}{first}".rstrip())
            yield from (" " * column + line for line in rest)
        else:
            yield shown(f"  {name}")
            yield from textwrap.wrap(shown(description), width, initial_indent="    ", subsequent_indent="    ")


def schema(
    kind: Annotated[str, typer.Argument(help="'scenario', 'suite', 'study' or 'rig'.")] = "scenario",
) -> None:
    """The JSON schema of a scenario, a suite, a study or a rig, for editors."""
    import json

    from trackers.errors import InputError

    if kind == "scenario":
        from twin.scenario.load import DrawableScenarioFile as Described
    elif kind == "suite":
        from twin.suites.spec import Suite as Described
    elif kind == "study":
        from twin.studies.spec import Study as Described
    elif kind == "rig":
        from trackers.rig import Rig as Described
    else:
        raise InputError(f"schema: there is none of {kind!r}; valid are scenario, suite, study, rig")
    typer.echo(json.dumps(Described.model_json_schema(), indent=2))


def check() -> None:
    """Can this machine render: renderer, versions, frame time; and what to do if not."""
    from twin.check import check_machine

    for line in check_machine():
        typer.echo(line)
